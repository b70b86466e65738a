"""Parts of columns: where the rows of each of many panoramas stand."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray


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
