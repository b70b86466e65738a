"""The onboard table: every pair of catalogue stars that fits into the field, in whole microradians."""

import hashlib
import math
import mmap
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xxhash
from numpy.lib import format as npy
from numpy.typing import NDArray
from platformdirs import user_cache_dir

from gse.catalog import Neighbours, StarCatalog
from gse.errors import CatalogError
from gse.values.camera import Camera

# Tables of the identifiers on disk, mapped into memory by every run that needs them.
#
# A file is a line ``gse tables 2 XXH3`` of what follows, and the columns as numpy writes them, each from a multiple of
# 64 bytes on. Columns are mapped copy-on-write: processes share their memory, and compiled code finds the same types as
# in tables that were made anew.

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


MICRORADIANS = 1e6
MOST_PAIRS = 20_000_000
"""At 32 bytes a pair, and 18 of the neighbour technique, this bounds a table to 1 GB; the built-in has 0.28 million."""

_SAMPLED_STARS = 200
"""Stars whose neighbours are counted to estimate the size of a table before memory is taken for it."""


class PairTable(NamedTuple):
    """Pairs of stars no farther apart than the field is wide; stars are row numbers of the catalogue.

    A tuple, because compiled functions take tuples whole.

    By pair (P,), in the order of their distance: ``distance_urad`` (whole microradians), ``brighter`` and ``dimmer``.
    By star, figure 2-5 of the LAPAN paper: the neighbours of star i are ``neighbour[first[i]:first[i + 1]]``, their
    distances ``neighbour_urad`` beside them, nearest first; ``first`` is (N + 1,) int64, the others int32.
    """

    distance_urad: NDArray[np.int32]
    brighter: NDArray[np.int32]
    dimmer: NDArray[np.int32]
    first: NDArray[np.int64]
    neighbour: NDArray[np.int32]
    neighbour_urad: NDArray[np.int32]


def field_diameter_rad(camera: Camera) -> float:
    """The greatest angle between two corners of the detector, distortion included."""
    right, bottom = camera.columns - 0.5, camera.rows - 0.5
    corners = camera.directions(np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]]))
    return float(max(angles_rad(corners[:1], corners[3:])[0], angles_rad(corners[1:2], corners[2:3])[0]))


def tolerance_rad(camera: Camera, tolerance_px: float) -> float:
    """d_m of the LAPAN paper, eq 2-1, the angle of ``tolerance_px`` at the boresight."""
    return 2 * math.atan2(tolerance_px / 2, camera.focal_length_px)


def angles_rad(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles (N,) between the rows of unit vectors (N, 3), exact for small ones."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T  # column by column: np.cross of rows takes five times as long
    across = np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
    return np.asarray(np.arctan2(across, ax * bx + ay * by + az * bz))


def pair_table(catalog: StarCatalog, widest_rad: float, cache: Path | None = None) -> PairTable:
    """The table of all pairs up to ``widest_rad``, from the cache directory where it is there.

    ``cache`` defaults to the user's cache directory. A damaged file there is replaced, and without a writable
    directory the table is made anew each time. A flight catalogue that lists its neighbours has its own table.
    """
    if catalog.neighbours is not None:
        return listed_pairs(catalog.neighbours)
    return PairTable(
        *cached_columns(
            cache_path(catalog, widest_rad, cache),
            lambda: build_pair_table(catalog, widest_rad),
            lambda columns: _fits(PairTable(*columns), len(catalog)),
            len(PairTable._fields),
        )
    )


def listed_pairs(neighbours: Neighbours) -> PairTable:
    """The table of the neighbours that a flight catalogue lists; a pair counts once."""
    star = np.repeat(np.arange(len(neighbours.first) - 1, dtype=np.int32), np.diff(neighbours.first))
    keys = np.column_stack([np.minimum(star, neighbours.star), np.maximum(star, neighbours.star)])
    _, once = np.unique(keys, axis=0, return_index=True)
    order = once[np.lexsort((keys[once, 1], keys[once, 0], neighbours.urad[once]))]
    brighter, dimmer = keys[order].T.astype(np.int32, order="C")
    return PairTable(neighbours.urad[order], brighter, dimmer, neighbours.first, neighbours.star, neighbours.urad)


def listed_neighbours(table: PairTable) -> Neighbours:
    """The neighbours of a table, as a flight catalogue lists them."""
    return Neighbours(table.first, table.neighbour, table.neighbour_urad)


def cache_path(catalog: StarCatalog, widest_rad: float, cache: Path | None = None) -> Path:
    """Where the table of these stars is kept."""
    return cache_file("pairs", (widest_rad, catalog.icrs), cache)


def build_pair_table(catalog: StarCatalog, widest_rad: float) -> PairTable:
    """The table of all pairs up to ``widest_rad``, made anew."""
    from scipy.spatial import cKDTree  # a quarter of a second, which a run with cached tables need not wait

    tree = cKDTree(catalog.icrs)
    reach = 2 * math.sin(min(widest_rad, math.pi) / 2)
    sample = catalog.icrs[:: max(1, len(catalog) // _SAMPLED_STARS)]
    neighbours = tree.query_ball_point(sample, reach, return_length=True)
    expected = int(neighbours.sum() / max(len(sample), 1) * len(catalog) / 2)
    if expected > MOST_PAIRS:
        raise CatalogError(
            f"{len(catalog)} stars make about {expected} pairs in a field of {math.degrees(widest_rad):.1f} deg; "
            f"at most {MOST_PAIRS} are taken: ask for fewer catalog_stars"
        )
    brighter, dimmer = tree.query_pairs(reach, output_type="ndarray").T
    urad = np.rint(MICRORADIANS * angles_rad(catalog.icrs[brighter], catalog.icrs[dimmer])).astype(np.int64)
    urad, brighter, dimmer = _in_order(urad, brighter, dimmer)
    star, neighbour = np.concatenate([brighter, dimmer]), np.concatenate([dimmer, brighter])
    star, neighbour_urad, neighbour = _in_order(star, np.tile(urad, 2), neighbour)
    first = np.searchsorted(star, np.arange(len(catalog) + 1))
    return PairTable(urad, brighter, dimmer, first, neighbour, neighbour_urad)


_FIRST_BIT, _SECOND_BIT = 42, 20
"""Of columns that are sorted as one number of 64 bits: half a turn of microradians has 22, and a million stars have 20,
where a mission catalogue has 100,000 at most."""


def _in_order(*columns: NDArray[np.integer]) -> Any:
    """Three columns (3, N) by the first, then the second, then the third: ten times as fast as np.lexsort."""
    first, second, third = (column.astype(np.uint64) for column in columns)
    packed = first << _FIRST_BIT | second << _SECOND_BIT | third
    packed.sort()
    middle, last = 2 ** (_FIRST_BIT - _SECOND_BIT) - 1, 2**_SECOND_BIT - 1
    return np.array([packed >> _FIRST_BIT, packed >> _SECOND_BIT & middle, packed & last], dtype=np.int32)


def _fits(table: PairTable, stars: int) -> bool:
    """Whether every row number of the table exists: the compiled searches do not look again."""
    pairs = len(table.distance_urad)
    lengths = (pairs, pairs, pairs, stars + 1, 2 * pairs, 2 * pairs)
    types = (np.int32, np.int32, np.int32, np.int64, np.int32, np.int32)
    columns: tuple[NDArray[np.integer], ...] = tuple(table)
    if any(c.shape != (n,) or c.dtype != t for c, n, t in zip(columns, lengths, types, strict=True)):
        return False
    rows = (table.brighter, table.dimmer, table.neighbour)
    ordered = table.first[0] == 0 and table.first[-1] == 2 * pairs and bool((np.diff(table.first) >= 0).all())
    return ordered and (pairs == 0 or all(row.min() >= 0 and row.max() < stars for row in rows))
