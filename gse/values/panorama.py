"""Panoramas: the objects that the sensor saw in an exposure, one by one or many as columns."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Parts of columns: where the rows of each of many panoramas stand.


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """K parts of M rows that follow each other: part k is the rows ``first[k]`` to before ``first[k + 1]``."""

    first: NDArray[np.int64]

    @classmethod
    def of_counts(cls, counts: ArrayLike) -> Self:
        """Parts of so many rows each."""
        counts = np.asarray(counts)
        first = np.zeros(len(counts) + 1, dtype=np.int64)
        counts.cumsum(out=first[1:])
        return cls(first)

    def __len__(self) -> int:
        return len(self.first) - 1

    @property
    def counts(self) -> NDArray[np.int64]:
        """Rows (K,) of each part."""
        return self.first[1:] - self.first[:-1]  # np.diff takes ten times as long for a few

    @property
    def of_row(self) -> NDArray[np.int64]:
        """The part (M,) to which each row belongs."""
        return np.repeat(np.arange(len(self)), self.counts)

    def rows(self, k: int) -> slice:
        """The rows of part k."""
        return slice(int(self.first[k]), int(self.first[k + 1]))

    def part(self, begin: int, end: int) -> tuple[Self, slice]:
        """The parts from ``begin`` to before ``end``, and their rows."""
        first = self.first[begin : end + 1]
        return type(self)(first - first[0]), slice(int(first[0]), int(first[-1]))

    def chosen(self, wanted: NDArray[np.bool_]) -> tuple[Self, NDArray[np.bool_]]:
        """The parts that are wanted (K,), and which rows (M,) are theirs."""
        counts = self.counts
        return self.of_counts(counts[wanted]), np.repeat(wanted, counts)

    def emptied(self, empty: Sequence[int]) -> tuple[Self, NDArray[np.bool_]]:
        """All parts, these of them without rows, and which rows (M,) are left."""
        counts = self.counts
        left = np.ones(len(self), dtype=np.bool_)
        left[empty] = False
        return self.of_counts(counts * left), np.repeat(left, counts)


MAX_OBJECTS = 30
"""Slots of a panorama, [S] section 2."""


@dataclass(frozen=True, slots=True, eq=False)
class Panorama:
    """The objects of one exposure, brightest first, at the UTC of mid-exposure.

    ``xy_px`` is (N, 2), columns x then rows y, 0-based at pixel centres; ``brightness`` is (N,), on the sensor's own
    scale; ``flags`` are the fault bits of the sensor by name ("overexposed", "detector fault", ...).
    ``time_us`` is the sensor's own clock, ``host_utc_ns`` the host's when the frame's first byte was read, 0 if
    unknown, ``sequence`` the frame's number on the wire, ``problems`` what the sensor should not have sent, in words.
    ``wire_rows`` (N,) is the place of each object on the wire, None where that is its place here.
    """

    utc_ns: int
    xy_px: NDArray[np.float64]
    brightness: NDArray[np.float64]
    frame_no: int = 0
    exposure_s: float = 0.0
    time_us: int = 0
    host_utc_ns: int = 0
    sequence: int = 0
    problems: tuple[str, ...] = ()
    temperature_c: float = float("nan")
    flags: frozenset[str] = field(default_factory=frozenset)
    wire_rows: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Panoramas:
    """K panoramas as columns, in their order; ``panoramas[k]`` is a view of one.

    Objects are the rows of ``xy_px`` (M, 2), ``brightness`` (M,) and ``wire_rows`` (M,), in ``parts``. All else has one
    value for each panorama.
    """

    parts: Parts
    xy_px: NDArray[np.float64]
    brightness: NDArray[np.float64]
    wire_rows: NDArray[np.int64]
    utc_ns: NDArray[np.int64]
    host_utc_ns: NDArray[np.int64]
    time_us: NDArray[np.int64]
    frame_no: NDArray[np.int64]
    sequence: NDArray[np.int64]
    exposure_s: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    flags: Sequence[frozenset[str]]
    problems: Sequence[tuple[str, ...]]

    @classmethod
    def from_panoramas(cls, panoramas: Sequence[Panorama]) -> Self:
        """The columns of panoramas given one by one."""

        wire_rows = [
            np.arange(len(panorama.brightness)) if panorama.wire_rows is None else panorama.wire_rows
            for panorama in panoramas
        ]
        return cls(
            Parts.of_counts([len(panorama.brightness) for panorama in panoramas]),
            np.concatenate([np.zeros((0, 2)), *(panorama.xy_px for panorama in panoramas)], dtype=np.float64),
            np.concatenate([np.zeros(0), *(panorama.brightness for panorama in panoramas)], dtype=np.float64),
            np.concatenate([np.zeros(0, dtype=np.int64), *wire_rows]),
            np.array([panorama.utc_ns for panorama in panoramas], dtype=np.int64),
            np.array([panorama.host_utc_ns for panorama in panoramas], dtype=np.int64),
            np.array([panorama.time_us for panorama in panoramas], dtype=np.int64),
            np.array([panorama.frame_no for panorama in panoramas], dtype=np.int64),
            np.array([panorama.sequence for panorama in panoramas], dtype=np.int64),
            np.array([panorama.exposure_s for panorama in panoramas], dtype=np.float64),
            np.array([panorama.temperature_c for panorama in panoramas], dtype=np.float64),
            [panorama.flags for panorama in panoramas],
            [panorama.problems for panorama in panoramas],
        )

    def __len__(self) -> int:
        return len(self.parts)

    def __getitem__(self, k: int) -> Panorama:
        rows = self.parts.rows(k)
        return Panorama(
            utc_ns=int(self.utc_ns[k]),
            xy_px=self.xy_px[rows],
            brightness=self.brightness[rows],
            frame_no=int(self.frame_no[k]),
            exposure_s=float(self.exposure_s[k]),
            time_us=int(self.time_us[k]),
            host_utc_ns=int(self.host_utc_ns[k]),
            sequence=int(self.sequence[k]),
            problems=self.problems[k],
            temperature_c=float(self.temperature_c[k]),
            flags=self.flags[k],
            wire_rows=self.wire_rows[rows],
        )

    def __iter__(self) -> Iterator[Panorama]:
        return (self[k] for k in range(len(self)))

    def part(self, begin: int, end: int) -> Self:
        """The panoramas from ``begin`` to before ``end``."""
        (parts, rows), each = self.parts.part(begin, end), slice(begin, end)
        return type(self)(
            parts,
            self.xy_px[rows],
            self.brightness[rows],
            self.wire_rows[rows],
            self.utc_ns[each],
            self.host_utc_ns[each],
            self.time_us[each],
            self.frame_no[each],
            self.sequence[each],
            self.exposure_s[each],
            self.temperature_c[each],
            self.flags[each],
            self.problems[each],
        )
