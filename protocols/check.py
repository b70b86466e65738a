"""Properties that a protocol must have, tried on random messages: what ``gse protocol check`` runs."""

import random
import time
from collections.abc import Iterator
from typing import NamedTuple

from protocols.errors import EncodeError
from protocols.frame import Discard, Frame
from protocols.framing import FrameDecoder
from protocols.protocol import Protocol

_FRAMES = 200
_CUTS = 40
_LEAST_PER_S = 2000
"""Frames that a station must keep up with, many times over: 200 Hz is the fastest sensor."""


class Tried(NamedTuple):
    """A property, whether it holds, and what was seen."""

    name: str
    holds: bool
    seen: str


def check_protocol(protocol: Protocol, seed: int = 1) -> Iterator[Tried]:
    """Round trip, cuts, accounting, noise and speed, of the messages that the sensor sends and is sent."""
    draw = random.Random(seed)
    for from_sensor, way in ((True, "from the sensor"), (False, "to the sensor")):
        names = [name for name in protocol.types if protocol.is_from_sensor(name) is from_sensor]
        if not names:
            continue
        sent = list(_payloads(protocol, names, draw))
        wires = [protocol.encode_payload(name, payload, number) for number, (name, payload) in enumerate(sent)]
        yield _round_trip(protocol, sent, wires, way, from_sensor=from_sensor)
        noisy = b"".join(_spoiled(wire, draw) for wire in wires)
        whole = _decoded(protocol, [noisy], from_sensor=from_sensor)
        cuts = sorted(draw.randrange(len(noisy) + 1) for _ in range(_CUTS))
        pieces = [noisy[a:b] for a, b in zip([0, *cuts], [*cuts, len(noisy)], strict=True)]
        same = _decoded(protocol, pieces, from_sensor=from_sensor) == whole
        single = _decoded(protocol, [noisy[n : n + 1] for n in range(len(noisy))], from_sensor=from_sensor) == whole
        yield Tried(f"cuts do not matter ({way})", same and single, f"{len(whole)} frames and discards in noise")
        sizes = [item.size for item in whole]
        starts = [item.start for item in whole]
        in_order = starts == [sum(sizes[:n]) for n in range(len(sizes))]
        seen = f"{sum(sizes)} of {len(noisy)} bytes, one after the other: {'yes' if in_order else 'no'}"
        yield Tried(f"every byte is accounted for ({way})", in_order and sum(sizes) == len(noisy), seen)
    yield _speed(protocol, draw)


def _payloads(protocol: Protocol, names: list[str], draw: random.Random) -> Iterator[tuple[str, bytes]]:
    """Random payloads of lengths that each message can have."""
    for number in range(_FRAMES):
        name = names[number % len(names)]
        payload = protocol.random_payload(name, draw)
        try:
            protocol.encode_payload(name, payload, 0)
        except EncodeError:
            continue
        yield name, payload


def _round_trip(
    protocol: Protocol, sent: list[tuple[str, bytes]], wires: list[bytes], way: str, *, from_sensor: bool
) -> Tried:
    found = [item for item in _decoded(protocol, wires, from_sensor=from_sensor) if isinstance(item, Frame)]
    same = sum(
        item.payload == payload and item.type == name for item, (name, payload) in zip(found, sent, strict=False)
    )
    return Tried(f"round trip ({way})", same == len(sent) == len(found), f"{same} of {len(sent)} frames come back")


def _spoiled(wire: bytes, draw: random.Random) -> bytes:
    """A frame, in one of three cases with a flipped bit, a lost byte, or noise before it."""
    at = draw.randrange(len(wire))
    match draw.randrange(9):
        case 0:
            return wire[:at] + bytes([wire[at] ^ 1 << draw.randrange(8)]) + wire[at + 1 :]
        case 1:
            return wire[:at] + wire[at + 1 :]
        case 2:
            return draw.randbytes(draw.randrange(1, 40)) + wire
    return wire


def _decoded(protocol: Protocol, pieces: list[bytes], *, from_sensor: bool) -> list[Frame | Discard]:
    decoder = FrameDecoder(protocol, from_sensor=from_sensor)
    found = [item for piece in pieces for item in decoder.feed(piece)] + decoder.finish()
    # When a piece was known depends on the pieces for a class that looks ahead; what it is does not.
    return [
        item._replace(known_at=0) if isinstance(item, Frame) else Discard(item.start, item.data, item.reason, 0)
        for item in found
    ]


def _speed(protocol: Protocol, draw: random.Random) -> Tried:
    names = [name for name in protocol.types if protocol.is_from_sensor(name)]
    wires = [protocol.encode_payload(name, payload, 0) for name, payload in _payloads(protocol, names, draw)]
    began_s = time.process_time()
    frames = [item for item in _decoded(protocol, [b"".join(wires)], from_sensor=True) if isinstance(item, Frame)]
    for frame in frames:
        protocol.decode(frame)
    per_s = len(frames) / max(time.process_time() - began_s, 1e-9)
    return Tried("fast enough", per_s >= _LEAST_PER_S, f"{per_s:.0f} frames/s, {_LEAST_PER_S} are asked")
