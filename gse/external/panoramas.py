"""Panoramas as an external identifier gets them: raw y, x and index value in wire units, in the order of the wire."""

import functools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.values import instant
from gse.values.camera import Camera
from gse.values.panorama import Panorama

PANORAMA = "gse.panorama/1"
SENSOR = "gse.sensor/1"
_WHOLE_WITHIN = 1e-6
"""Counts of a wire are whole; those of a panorama table need not be."""


@dataclass(frozen=True, slots=True)
class WireUnit:
    """What a count on the wire means: value = factor * count + zero, in px, or in index values."""

    factor: float = 1.0
    zero: float = 0.0


@dataclass(frozen=True)
class SensorDescription:
    """The sensor as an external identifier gets it, once, at its start."""

    name: str
    camera: Camera
    index_max: int
    y: WireUnit = WireUnit()
    x: WireUnit = WireUnit()
    index: WireUnit = WireUnit()

    def document(self) -> dict[str, Any]:
        """The JSON of schema gse.sensor/1."""
        camera = asdict(self.camera)
        units = {name: asdict(getattr(self, name)) for name in ("y", "x", "index")}
        return {"schema": SENSOR, "name": self.name, **camera, "index_max": self.index_max, "units": units}

    def counts(self, panoramas: Sequence[Panorama]) -> "Counts":
        """The counts of some panoramas."""
        sizes = [len(panorama.brightness) for panorama in panoramas]
        first = np.cumsum([0, *sizes])
        measured = np.empty((first[-1], 3))
        np.concatenate([panorama.xy_px for panorama in panoramas], out=measured[:, 1::-1])
        np.concatenate([panorama.brightness for panorama in panoramas], out=measured[:, 2])
        counts = (measured - self._zeros) / self._factors
        whole = np.rint(counts)
        counts = np.where(np.abs(counts - whole) < _WHOLE_WITHIN, whole, counts)
        on_wire = np.empty_like(counts)
        on_wire[_wire_places(panoramas, first.tolist())] = counts
        return Counts(on_wire, first)

    @functools.cached_property
    def _zeros(self) -> NDArray[np.float64]:
        return np.array([unit.zero for unit in (self.y, self.x, self.index)])

    @functools.cached_property
    def _factors(self) -> NDArray[np.float64]:
        return np.array([unit.factor for unit in (self.y, self.x, self.index)])

    def lines(self, panoramas: Sequence[Panorama]) -> list[bytes]:
        """The lines of schema gse.panorama/1, by templates: a JSON encoder takes twice as long."""
        objects = self.counts(panoramas).texts()
        return [
            f'{{"schema":"{PANORAMA}","frame_no":{panorama.frame_no},"utc":"{instant.to_text(panorama.utc_ns, 9)}",'
            f'"time_us":{panorama.time_us},"exposure_us":{_exposure_text(panorama.exposure_s)},'
            f'"objects":{text}}}\n'.encode()
            for panorama, text in zip(panoramas, objects, strict=True)
        ]


@dataclass(frozen=True, slots=True, eq=False)
class Counts:
    """Raw y, x and index value (M, 3) of the objects of P panoramas, in the order of the wire.

    Those of panorama k are rows ``first[k]`` to ``first[k + 1]``; ``first`` is (P + 1,).
    """

    values: NDArray[np.float64]
    first: NDArray[np.int64]

    def texts(self) -> list[str]:
        """The list ``objects`` of each panorama as JSON; whole numbers where all of a panorama are whole."""
        whole = np.rint(self.values)
        numbers = whole.astype(np.int64)
        is_whole = whole == self.values
        if is_whole.all() and self._are_known(numbers):
            return self._known_texts(numbers)
        ends = list(pairwise(self.first.tolist()))
        return [
            _template("%d", end - begin) % tuple(numbers[begin:end].ravel().tolist())
            if is_whole[begin:end].all()
            else _template("%r", end - begin) % tuple(self.values[begin:end].ravel().tolist())
            for begin, end in ends
        ]

    @staticmethod
    def _are_known(numbers: NDArray[np.int64]) -> bool:
        return not numbers.size or bool(numbers.min() >= 0 and numbers.max() < _MOST_KNOWN)

    def _known_texts(self, numbers: NDArray[np.int64]) -> list[str]:
        """Of small whole numbers, whose texts are known: three times as fast as a template."""
        data, size = _known_words()[_COLUMNS, numbers].tobytes(), 3 * _WORD.itemsize
        ends = pairwise((size * self.first).tolist())
        return ["[" + data[begin:end].replace(b"\0", b"")[:-1].decode() + "]" for begin, end in ends]


_WORD = np.dtype("S6")
_MOST_KNOWN = 8192
"""Rows, columns and index values of most sensors are smaller."""


_COLUMNS = np.arange(3)


@functools.cache
def _known_words() -> NDArray[np.bytes_]:
    """The numbers below _MOST_KNOWN as y, x and index value of an object in JSON, (3, _MOST_KNOWN)."""
    forms = (b"[%d,", b"%d,", b"%d],")
    return np.array([[form % number for number in range(_MOST_KNOWN)] for form in forms], _WORD)


@functools.cache
def _template(number: str, objects: int) -> str:
    return "[" + ",".join([f"[{number},{number},{number}]"] * objects) + "]"


def _wire_places(panoramas: Sequence[Panorama], first: list[int]) -> NDArray[np.int64] | slice:
    """The places on the wire of all objects, as rows of the panoramas one after the other."""
    if all(panorama.wire_rows is None for panorama in panoramas):
        return slice(None)
    return np.concatenate(
        [
            np.arange(begin, end) if panorama.wire_rows is None else begin + panorama.wire_rows
            for panorama, (begin, end) in zip(panoramas, pairwise(first), strict=True)
        ]
    )


def _exposure_text(exposure_s: float) -> str:
    return str(round(1e6 * exposure_s)) if math.isfinite(exposure_s) else "null"


def rows_here(panorama: Panorama, wire_rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows of the panorama, brightest first, of rows (M,) in the order of the wire."""
    return wire_rows if panorama.wire_rows is None else np.argsort(panorama.wire_rows).take(wire_rows)
