"""Tables of the identifiers on disk, mapped into memory by every run that needs them.

A file is a line ``gse tables 2 XXH3`` of what follows, and the columns as numpy writes them, each from a multiple of
64 bytes on. Columns are mapped copy-on-write: processes share their memory, and compiled code finds the same types as
in tables that were made anew.
"""

import hashlib
import mmap
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xxhash
from numpy.lib import format as npy
from numpy.typing import NDArray
from platformdirs import user_cache_dir

Columns = tuple[NDArray[Any], ...]

_HEAD = b"gse tables 2 "
_HEAD_BYTES = 64
_ALIGNED = 64
_KEPT_BYTES_OF_A_KIND = 256_000_000
"""Sessions of two years with one sensor: the stars of each tenth of a year have their tables, 12 MB with 10,000."""
_DAMAGE = (OSError, ValueError, EOFError)
"""All that reading a damaged or foreign file raises."""


def cached_columns(path: Path, make: Callable[[], Columns], fits: Callable[[Columns], bool], count: int) -> Columns:
    """The ``count`` columns of a file, or those that ``make`` returns, which then are written to it.

    What is damaged or does not fit is made anew and replaced; a cache that cannot be written is not an error.
    """
    columns = _read(path, count)
    if columns is None or not fits(columns):
        columns = make()
        _write(path, columns)
    else:
        with suppress(OSError):
            os.utime(path)
    return columns


def cache_file(kind: str, key: tuple[Any, ...], folder: Path | None = None) -> Path:
    """Where the tables of a kind for arrays and numbers are kept; ``folder`` defaults to the user's cache directory."""
    digest = hashlib.sha256(_HEAD)
    for part in key:
        digest.update(np.ascontiguousarray(part, dtype="<f8").tobytes())
    folder = Path(user_cache_dir("gse")) if folder is None else folder
    return folder / f"{kind}-{digest.hexdigest()[:32]}.tables"


def _read(path: Path, count: int) -> Columns | None:
    try:
        with path.open("rb") as file:
            mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
            if file.read(_HEAD_BYTES) != _head(xxhash.xxh3_64_hexdigest(memoryview(mapped)[_HEAD_BYTES:])):
                return None
            return tuple(_column(file, mapped) for _ in range(count))
    except _DAMAGE:
        return None


def _column(file: Any, mapped: mmap.mmap) -> NDArray[Any]:
    """The column that begins where the file is read, which moves on to the next."""
    npy.read_magic(file)
    shape, _, dtype = npy.read_array_header_1_0(file)
    column = np.ndarray(shape, dtype, mapped, file.tell())
    file.seek(_aligned(file.tell() + column.nbytes))
    return column


def _write(path: Path, columns: Columns) -> None:
    """Write a file whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "w+b") as file:
                file.write(_head(""))
                for column in columns:
                    npy.write_array(file, column, (1, 0), allow_pickle=False)
                    file.write(bytes(_aligned(file.tell()) - file.tell()))
                file.seek(_HEAD_BYTES)
                checksum = xxhash.xxh3_64_hexdigest(file.read())
                file.seek(0)
                file.write(_head(checksum))
            os.replace(name, path)
        except OSError:
            os.unlink(name)
            raise
        _remove_unused(path)
    except OSError:
        return


def _head(checksum: str) -> bytes:
    return (_HEAD + checksum.encode()).ljust(_HEAD_BYTES - 1) + b"\n"


def _aligned(offset: int) -> int:
    return -(-offset // _ALIGNED) * _ALIGNED


def _remove_unused(path: Path) -> None:
    """Remove the files of the same kind beside a new one that were used longest ago, where all take too much."""
    kind = path.name.rpartition("-")[0]
    found = [(file, file.stat()) for file in path.parent.glob(f"{kind}-*") if file != path]
    left_bytes = _KEPT_BYTES_OF_A_KIND - path.stat().st_size
    for file, stat in sorted(found, key=lambda pair: pair[1].st_mtime_ns, reverse=True):
        left_bytes -= stat.st_size
        if left_bytes < 0:
            file.unlink()
