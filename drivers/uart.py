"""What a UART receives from one that sends at another baud rate."""

BITS_PER_BYTE = 10
"""8N1: a start bit, eight data bits, a stop bit."""

USUAL_BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
"""Rates that sensors and adapters have."""


def received_at(data: bytes, sent_baud: int, listening_baud: int) -> bytes:
    """The bytes that come out at one end when ``data`` goes in at the other, without a pause between its bytes.

    8N1: a start bit 0, eight data bits from the lowest on, a stop bit 1. The receiver waits for a falling edge
    and samples each bit in its middle, by its own idea of the rate; as Linux does, it gives a byte with a wrong stop
    bit too.
    """
    if sent_baud == listening_baud:
        return data
    line = [1]
    for byte in data:
        line += [0, *(byte >> bit & 1 for bit in range(8)), 1]
    line += [1] * 12
    step = sent_baud / listening_baud
    received = bytearray()
    position = 0.0
    while (edge := _falling_edge(line, position)) is not None:
        samples = [_level(line, edge + (bit + 1.5) * step) for bit in range(9)]
        received.append(sum(level << bit for bit, level in enumerate(samples[:8])))
        position = edge + 9.5 * step
    return bytes(received)


def _level(line: list[int], position: float) -> int:
    return line[int(position)] if position < len(line) else 1


def _falling_edge(line: list[int], position: float) -> int | None:
    """The first place from ``position`` on where the line goes from 1 to 0."""
    start = int(position)
    for place in range(max(start, 0) + 1, len(line)):
        if line[place - 1] and not line[place]:
            return place
    return None
