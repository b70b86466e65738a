"""Columns of one length by name, in memory or in a temporary file: frames of a day fit into a small memory.

A column in memory is resident for as long as it lives. One in a file is mapped: the system holds what was written, on
the disk where it likes. The pages that this process looked at are given back after each GIVE_BACK_BYTES; they come back
by themselves when they are looked at again.
"""

import mmap
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any, Protocol, Self, overload

import numpy as np
from numpy.typing import NDArray

GIVE_BACK_BYTES = 16 << 20
"""Two columns of a day at 10 Hz."""
_SHARE_OF_DISK = 8
"""A file takes an eighth of the free disk at most: the report needs some of it."""
_LASTING = Path("/var/tmp")
"""Where /tmp lies in memory, as on many systems, a file there would save none."""


class Columns(Protocol):
    """Columns of one length by name: a table of frames, or a structured array."""

    def __len__(self) -> int: ...

    def __getitem__(self, name: str, /) -> NDArray[Any]: ...


class InOrder:
    """Columns in another order of their rows, each put in order when it is asked for."""

    def __init__(self, columns: Columns, order: NDArray[np.int64]) -> None:
        self._columns, self._order = columns, order

    def __len__(self) -> int:
        return len(self._order)

    def __getitem__(self, name: str, /) -> NDArray[Any]:
        ordered: NDArray[Any] = self._columns[name][self._order]
        return ordered


class ColumnStore:
    """Columns of a structured dtype with room for more rows; unused room in memory takes none of it."""

    def __init__(self, dtype: np.dtype[np.void], rows: int) -> None:
        self.dtype, self.used = dtype, 0
        self._fields = {name: dtype[name] for name in dtype.names or ()}
        self._room = {name: np.zeros(rows, kind) for name, kind in self._fields.items()}
        self._map: mmap.mmap | None = None
        self._touched = 0

    @property
    def is_on_disk(self) -> bool:
        """Whether the columns lie in a file."""
        return self._map is not None

    @property
    def rows(self) -> int:
        """How many rows there is room for."""
        return len(next(iter(self._room.values())))

    def extend(self, rows: NDArray[np.void]) -> None:
        """Add rows of the dtype, for which there is room."""
        until = self.used + len(rows)
        for name, column in self._room.items():
            column[self.used : until] = rows[name]
        self.used = until
        self._touch(rows.nbytes)

    def column(self, name: str, first: int, until: int) -> NDArray[Any]:
        """Rows from ``first`` to before ``until`` of a column, as a view."""
        column = self._room[name][first:until]
        self._touch(column.nbytes)
        return column

    def with_room(self, rows: int, *, on_disk: bool) -> "ColumnStore":
        """The same columns with room for more rows; in memory, too, where there is no room on the disk."""
        larger = ColumnStore(self.dtype, 0)
        if not on_disk or not larger._map_file(rows):
            larger._room = {name: np.zeros(rows, kind) for name, kind in self._fields.items()}
        larger.used = self.used
        for name, column in larger._room.items():
            column[: self.used] = self.column(name, 0, self.used)
            larger._touch(column[: self.used].nbytes)
        return larger

    def copied(self) -> Self:
        """A store in memory with copies of the columns, for another thread."""
        copy = type(self)(self.dtype, 0)
        copy._room = {name: column[: self.used].copy() for name, column in self._room.items()}
        copy.used = self.used
        return copy

    def _map_file(self, rows: int) -> bool:
        """Make room in a new file without a name; False where that cannot be done."""
        places, size = {}, 0
        for name, kind in self._fields.items():
            places[name] = size
            size += -(-rows * kind.itemsize // mmap.PAGESIZE) * mmap.PAGESIZE
        try:
            folder = tempfile.gettempdir() if "TMPDIR" in os.environ or not os.access(_LASTING, os.W_OK) else _LASTING
            if shutil.disk_usage(folder).free < _SHARE_OF_DISK * size:
                return False
            with tempfile.TemporaryFile(prefix="gse-frames-", dir=folder) as file:
                os.posix_fallocate(file.fileno(), 0, size)  # a page without room on the disk would end the process
                self._map = mmap.mmap(file.fileno(), size)
        except (OSError, AttributeError):  # a full disk; a system without these calls
            return False
        self._room = {name: np.frombuffer(self._map, kind, rows, places[name]) for name, kind in self._fields.items()}
        return True

    def _touch(self, size: int) -> None:
        if self._map is None:
            return
        self._touched += size
        if self._touched > GIVE_BACK_BYTES:
            self._touched = 0
            self._map.madvise(mmap.MADV_DONTNEED)


class FrameColumns:
    """Rows of a ColumnStore that follow each other: columns are views, and can be written."""

    def __init__(self, store: ColumnStore, first: int, until: int) -> None:
        self._store, self._first, self._until = store, first, until

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The dtype of a row."""
        return self._store.dtype

    def __len__(self) -> int:
        return self._until - self._first

    @overload
    def __getitem__(self, rows: str, /) -> NDArray[Any]: ...

    @overload
    def __getitem__(self, rows: slice, /) -> "FrameColumns": ...

    def __getitem__(self, rows: str | slice, /) -> "NDArray[Any] | FrameColumns":
        if isinstance(rows, str):
            return self._store.column(rows, self._first, self._until)
        first, until, step = rows.indices(len(self))
        if step != 1:
            raise ValueError(f"rows of columns follow each other; got the step {step}")
        return FrameColumns(self._store, self._first + first, self._first + max(first, until))

    def __setitem__(self, name: str, values: Any) -> None:
        self[name][:] = values

    def rows(self, places: NDArray[Any] | slice = slice(None)) -> NDArray[np.void]:
        """A structured array with copies of some rows: places, a mask (M,), or a slice."""
        columns = {name: self[name][places] for name in self.dtype.names or ()}
        copied = np.empty(len(next(iter(columns.values()))), self.dtype)
        for name, column in columns.items():
            copied[name] = column
        return copied
