"""Faults of single bytes: inverted, lost, doubled, inserted, drowned in noise."""

from collections.abc import Callable

import numpy as np

from drivers.faults.options import BYTE_KINDS, Faults, Places

_NOISE_BYTES = (8, 64)


class ByteFaults:
    """Edits the bytes of a stream at places given by their offset in the source."""

    def __init__(self, faults: Faults) -> None:
        self._kinds = [
            (kind, Places(faults.random(f"{kind} places"), faults.rate(kind)), faults.random(f"{kind} values"))
            for kind in BYTE_KINDS
            if faults.rate(kind) > 0
        ]

    def edit(self, offset: int, data: bytes) -> tuple[bytes, list[str]]:
        """The bytes from ``offset`` of the source on with their faults, and a description of each fault."""
        edits = [
            (place, kind, random) for kind, places, random in self._kinds for place in places.before(offset + len(data))
        ]
        if not edits:
            return data, []
        pieces = [data[n : n + 1] for n in range(len(data))]
        texts = []
        # By kind, each kind in order of place: every kind draws from its own stream, whatever the others do.
        for place, kind, random in edits:
            n = place - offset
            pieces[n], text = _EDITS[kind](pieces[n], random)
            texts.append(f"{text} at byte {place}")
        return b"".join(pieces), texts


def _flip(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    bit = int(random.integers(8))
    return bytes([piece[0] ^ 1 << bit]) + piece[1:], f"flip: bit {bit}"


def _drop(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    return b"", "drop: a byte lost"


def _double(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    return piece * 2, "double: twice the byte"


def _insert(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    return random.bytes(1) + piece, "insert: a byte more"


def _noise(piece: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    burst = random.bytes(int(random.integers(_NOISE_BYTES[0], _NOISE_BYTES[1] + 1)))
    return burst + piece, f"noise: {len(burst)} bytes"


_EDITS: dict[str, Callable[[bytes, np.random.Generator], tuple[bytes, str]]] = {
    "flip": _flip,
    "drop": _drop,
    "double": _double,
    "insert": _insert,
    "noise": _noise,
}
