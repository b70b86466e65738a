"""Tables of the robust identifier: star pairs by distance, with their directions, and stars by sky cell.

Rows of the tables are stars brightest first, doubles already merged to what the sensor sees of them.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.identifier.tables import Columns, cache_file, cached_columns
from gse.process.jit import compiled, compiled_part

MAX_FIELD_STARS = 96
"""No more of the brightest catalogue stars in a field are looked at: a panorama has 30 objects."""

_PAIR_STARS_PER_FIELD = 36.0
"""Mean number of stars in a field that pairs are made of: a panorama's 30 objects and some that it missed."""

_MAX_PAIR_STARS = 65_000
"""Rows of pair stars fit 16 bits."""

_PAIRS_AT_ONCE = 1 << 16
_CELLS_AT_ONCE = 256
_MAX_PAIRS = 1_500_000
"""12 MB of pairs; the longest distances are given up first."""

_BUCKETS = 4096

_NEAR_CELLS = 573.0
"""Cells of the map of stars per unit of length: 0.1 deg."""

_NEAR_RAD = math.radians(200 / 3600)
"""A star is near within this: what the attitude of two stars errs by over the field."""

_NEAR_BITS = 1 << 22
"""Half a megabyte, which fits the second-level cache."""

_KINDS = (np.uint16, np.int32, np.int32, np.int32, np.int32, np.uint8)
_COLUMNS = len(_KINDS)
"""The columns that are kept on disk: pairs, pair_start, ring_start, cell_start, cell_stars, near_star."""

_TURN = 65_536
"""Position angles are kept in 1/65,536 turn (20 arcsec)."""


class SkyTables(NamedTuple):
    """What the compiled search reads.

    ``icrs`` (S, 3) and ``magnitude`` (S,) of the stars. ``field`` (6,) on the tangent plane: least and greatest u,
    least and greatest v, squared radius of a round stop (or infinity), area. ``pairs`` (P, 4) uint16 of the first
    ``pair_stars``: rows of the brighter and the dimmer star, position angle of the dimmer at the brighter and of the
    brighter at the dimmer in 1/65,536 turn; those of distance bucket b (of ``bucket_rad``) are ``pair_start[b]`` to
    ``pair_start[b + 1]``, sorted by their dimmer star. Cell c of ring r (of ``ring_rad``) holds the stars
    ``cell_stars[cell_start[c] : cell_start[c + 1]]`` that a field with its centre in the cell can contain, brightest
    first; ring r has its first cell at ``ring_start[r]``. ``near_star`` maps the sky (see ``near_bit``): a bit is set
    where one of the pair stars is near.
    """

    icrs: NDArray[np.float64]
    magnitude: NDArray[np.float64]
    field: NDArray[np.float64]
    pairs: NDArray[np.uint16]
    pair_start: NDArray[np.int32]
    ring_start: NDArray[np.int32]
    cell_start: NDArray[np.int32]
    cell_stars: NDArray[np.int32]
    near_star: NDArray[np.uint8]
    pair_stars: int
    bucket_rad: float
    ring_rad: float


def sky_tables(
    icrs: NDArray[np.float64], magnitude: NDArray[np.float64], field: NDArray[np.float64], cache: Path | None = None
) -> SkyTables:
    """The tables of stars, brightest first, for a field as ``SkyTables`` describes it.

    They come from the cache directory (the user's without ``cache``) where they are there.
    """
    radius_rad, pair_stars = field_radius_rad(field), _pair_stars(len(icrs), float(field[5]))
    reach_rad = _pair_reach_rad(2 * radius_rad, pair_stars)

    def made() -> Columns:
        return *_pair_table(icrs[:pair_stars], reach_rad), *_cells(icrs, radius_rad), near_map(icrs[:pair_stars])

    columns = cached_columns(
        cache_file("sky", (field, icrs), cache), made, lambda found: _fit(found, pair_stars, len(icrs)), _COLUMNS
    )
    pairs, pair_start, ring_start, cell_start, cell_stars, near_star = columns
    return SkyTables(
        icrs,
        magnitude,
        field,
        pairs,
        pair_start,
        ring_start,
        cell_start,
        cell_stars,
        near_star,
        pair_stars,
        reach_rad / _BUCKETS,
        radius_rad / 3,
    )


def _fit(columns: Columns, pair_stars: int, stars: int) -> bool:
    """Whether every row number of the tables exists: the compiled searches do not look again."""
    pairs, pair_start, ring_start, cell_start, cell_stars, near_star = columns
    return (
        all(column.dtype == kind for column, kind in zip(columns, _KINDS, strict=True))
        and pairs.shape == (pair_start[-1], 4)
        and len(pair_start) == _BUCKETS + 1
        and len(cell_start) == ring_start[-1] + 1
        and len(cell_stars) == cell_start[-1]
        and len(near_star) == _NEAR_BITS // 8
        and all(start[0] == 0 and (np.diff(start) >= 0).all() for start in (pair_start, ring_start, cell_start))
        and int(pairs[:, :2].max(initial=0)) < max(pair_stars, 1)
        and 0 <= cell_stars.min(initial=0) <= cell_stars.max(initial=0) < max(stars, 1)
    )


def part_of_sky(tables: SkyTables, near: NDArray[np.bool_]) -> SkyTables:
    """The tables of some of the stars (S,), whose rows count anew."""
    row_of = np.cumsum(near, dtype=np.int64) - 1
    kept = near[tables.pairs[:, 0]] & near[tables.pairs[:, 1]]
    pairs = tables.pairs[kept]
    pairs[:, :2] = row_of[pairs[:, :2]]
    in_cells = near[tables.cell_stars]
    return tables._replace(
        icrs=np.ascontiguousarray(tables.icrs[near]),
        magnitude=np.ascontiguousarray(tables.magnitude[near]),
        pairs=pairs,
        pair_start=_count_before(kept)[tables.pair_start],
        cell_start=_count_before(in_cells)[tables.cell_start],
        cell_stars=row_of[tables.cell_stars[in_cells]].astype(np.int32),
        pair_stars=int(np.count_nonzero(near[: tables.pair_stars])),
    )


def _count_before(kept: NDArray[np.bool_]) -> NDArray[np.int32]:
    """How many of some rows (N,) are kept before each, and of all: (N + 1,)."""
    return np.concatenate([[0], np.cumsum(kept)]).astype(np.int32)


def field_radius_rad(field: NDArray[np.float64]) -> float:
    """Greatest angle from the boresight in a field as ``SkyTables`` describes it."""
    left, right, top, bottom, radius2, _ = field
    corner2 = max(left**2, right**2) + max(top**2, bottom**2)
    return math.atan(math.sqrt(min(corner2, radius2)))


@compiled_part
def near_bit(x: float, y: float, z: float) -> int:
    """The bit of a direction: a cell of 0.1 deg of the cube around the sphere, hashed into the map."""
    i = np.int64((x + 2.0) * _NEAR_CELLS)
    j = np.int64((y + 2.0) * _NEAR_CELLS)
    k = np.int64((z + 2.0) * _NEAR_CELLS)
    return int((i * 73_856_093 ^ j * 19_349_663 ^ k * 83_492_791) & (_NEAR_BITS - 1))


@compiled
def near_map(icrs: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The map with the bits of all cells set that come within 200 arcsec or so of a star (N, 3)."""
    bits = np.zeros(_NEAR_BITS // 8, dtype=np.uint8)
    for row in range(len(icrs)):
        for i in range(-1, 2):
            for j in range(-1, 2):
                for k in range(-1, 2):
                    bit = near_bit(
                        icrs[row, 0] + i * _NEAR_RAD, icrs[row, 1] + j * _NEAR_RAD, icrs[row, 2] + k * _NEAR_RAD
                    )
                    bits[bit >> 3] |= np.uint8(1 << (bit & 7))
    return bits


def _pair_stars(stars: int, solid_angle_sr: float) -> int:
    return min(stars, _MAX_PAIR_STARS, round(_PAIR_STARS_PER_FIELD * 4 * math.pi / solid_angle_sr))


def _pair_reach_rad(diameter_rad: float, pair_stars: int) -> float:
    mean_pairs = pair_stars**2 / 4
    return min(diameter_rad, math.acos(max(-1.0, 1 - _MAX_PAIRS / max(mean_pairs, 1.0))))


def _pair_table(icrs: NDArray[np.float64], reach_rad: float) -> tuple[NDArray[np.uint16], NDArray[np.int32]]:
    from scipy.spatial import cKDTree  # a quarter of a second, which a run with cached tables need not wait

    stars = np.ascontiguousarray(icrs)
    found = cKDTree(stars).query_pairs(2 * math.sin(reach_rad / 2), output_type="ndarray")
    found.sort(axis=1)
    bucket_rad = reach_rad / _BUCKETS
    bucket = np.empty(len(found), dtype=np.int32)
    pairs = np.empty((len(found), 4), dtype=np.uint16)
    for part in _slices(len(found), _PAIRS_AT_ONCE):
        first, second = stars[found[part, 0]], stars[found[part, 1]]
        distance = 2 * np.arcsin(np.minimum(np.linalg.norm(first - second, axis=1) / 2, 1.0))
        bucket[part] = np.minimum((distance / bucket_rad).astype(np.int32), _BUCKETS - 1)
        pairs[part] = np.column_stack([found[part], _turn(first, second), _turn(second, first)])
    order = np.lexsort((pairs[:, 1], bucket))
    pairs = pairs[order]
    start = np.zeros(_BUCKETS + 1, dtype=np.int32)
    np.cumsum(np.bincount(bucket, minlength=_BUCKETS), out=start[1:])
    return pairs, start


def _turn(at: NDArray[np.float64], towards: NDArray[np.float64]) -> NDArray[np.int64]:
    """Position angle of stars (N, 3) seen from others (N, 3), east through north, in 1/65,536 turn."""
    (x, y, z), (to_x, to_y, to_z) = at.T, towards.T  # column by column: rows of three take three times as long
    is_pole = np.hypot(x, y) < 1e-9
    east_x, east_y = np.where(is_pole, 0.0, -y), np.where(is_pole, 1.0, x)
    length = np.sqrt(east_x**2 + east_y**2)
    east_x, east_y = east_x / length, east_y / length
    northwards = -z * east_y * to_x + z * east_x * to_y + (x * east_y - y * east_x) * to_z
    angle = np.arctan2(northwards, east_x * to_x + east_y * to_y)
    turns: NDArray[np.int64] = np.round(angle * (_TURN / (2 * math.pi))).astype(np.int64) % _TURN
    return turns


def _cells(
    icrs: NDArray[np.float64], radius_rad: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """Rings of declination cut into cells of about a third of the field's radius, and the stars around each."""
    from scipy.spatial import cKDTree

    height = radius_rad / 3
    rings = math.ceil(math.pi / height)
    middle = (np.arange(rings) + 0.5) * height
    per_ring = np.maximum(1, np.ceil(2 * math.pi * np.sin(np.minimum(middle, math.pi)) / height)).astype(np.int64)
    ring_start = np.concatenate([[0], np.cumsum(per_ring)]).astype(np.int32)
    ring = np.repeat(np.arange(rings), per_ring)
    ra = (np.arange(ring_start[-1]) - ring_start[ring] + 0.5) * 2 * math.pi / per_ring[ring]
    colatitude = middle[ring]
    sine = np.sin(colatitude)
    centres = np.column_stack([sine * np.cos(ra), sine * np.sin(ra), np.cos(colatitude)])
    # 0.71 of a cell to its corner, and some more: a cell of a ring that touches the pole is a wide wedge.
    reach = min(radius_rad + 1.2 * height, math.pi)
    tree = cKDTree(icrs)
    around: list[NDArray[np.int32]] = []
    for part in _slices(len(centres), _CELLS_AT_ONCE):
        for found in tree.query_ball_point(centres[part], 2 * math.sin(reach / 2), return_sorted=True):
            around.append(np.array(found[: 4 * MAX_FIELD_STARS], dtype=np.int32))
    cell_start = np.concatenate([[0], np.cumsum([len(stars) for stars in around])]).astype(np.int32)
    return ring_start, cell_start, np.concatenate(around)


def _slices(count: int, at_once: int) -> list[slice]:
    """Parts of so many rows: intermediate results of all at once would take ten times the memory of the tables."""
    return [slice(first, first + at_once) for first in range(0, count, at_once)]
