"""Coverage-guided fuzzing of decoder and messages with atheris (pip install atheris).

    python benchmarks/fuzz_protocols.py -max_total_time=900

Each input is fed whole and in pieces to the decoder of every built-in protocol, and behind right checksums to the
messages. Any exception, or bytes that do not add up, is a find.
"""

import contextlib
import sys

import atheris  # type: ignore[import-not-found]

with atheris.instrument_imports(include=["protocols"]):
    from protocols import Discard, Frame, FrameDecoder, Protocol, built_in_names, load_protocol
    from protocols.errors import EncodeError

PROTOCOLS = [load_protocol(name) for name in built_in_names()]


def decoded(protocol: Protocol, *pieces: bytes) -> list[Frame | Discard]:
    """All that a stream in these pieces gives; its bytes must add up."""
    decoder = FrameDecoder(protocol)
    found = [item for piece in pieces for item in decoder.feed(piece)] + decoder.finish()
    assert decoder.bytes_in == decoder.bytes_framed + decoder.bytes_discarded
    for item in found:
        if isinstance(item, Frame):
            protocol.decode(item)
    return found


def one_input(data: bytes) -> None:
    """One input of the fuzzer."""
    for protocol in PROTOCOLS:
        cut = data[0] if data else 0
        assert decoded(protocol, data) == decoded(protocol, data[:cut], data[cut : 2 * cut], data[2 * cut :])
        for code, name in protocol.frame_layout.names.items():
            size = protocol.frame_layout.sizes[code]
            with contextlib.suppress(EncodeError):  # a line of text has no word for each number
                decoded(protocol, protocol.encode_payload(name, data[:size].ljust(size, b"\0"), cut))


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
