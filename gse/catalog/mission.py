"""Mission catalogue: the stars of an identifier, chosen for a camera."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gse.catalog.stars import StarCatalog
from gse.values.camera import Camera
from gse.values.matrices import product
from gse.values.spiral import spiral_directions

STARS_PER_FIELD = 20
"""Catalogue stars in a mean field under ``auto``: it leaves at least 8 in nearly every field.

It makes 4200 stars for the 14 x 14 deg of the LAPAN paper, which has 4000, and 8400 for 11.4 x 8.6 deg.
"""

FEWEST_STARS = 1500
MOST_STARS = 50_000
MERGED_WITHIN_PX = 2.0
"""Closer stars make one object: their light overlaps on the detector."""

_GOLDEN_ANGLE_RAD = math.pi * (3 - math.sqrt(5))

STARS_OF_A_FIELD = 5
DIRECTIONS = 20_000
"""Fields over which the brightest stars are gathered: 1.4 deg apart."""

_STARS_SEARCHED_FOR_COMPANIONS = 2
"""As a multiple of the stars wanted: it reaches 0.6 mag below the faintest of them."""


def stars_for_field(camera: Camera) -> int:
    """The size of the mission catalogue under ``catalog_stars: auto``: 20 stars in a mean field."""
    fields = 4 * math.pi / camera.solid_angle_sr
    return int(round(min(max(STARS_PER_FIELD * fields, FEWEST_STARS), MOST_STARS), -2))


def stars_searched(camera: Camera, stars: int | Literal["auto"] = "auto") -> int:
    """How many stars of its source ``mission_catalog`` looks at."""
    return _STARS_SEARCHED_FOR_COMPANIONS * (stars_for_field(camera) if stars == "auto" else stars)


def mission_catalog(source: StarCatalog, camera: Camera, stars: int | Literal["auto"] = "auto") -> StarCatalog:
    """The brightest ``stars`` as the camera sees them: stars closer than 2 px are one. A flight catalogue as it is."""
    if source.is_flight:
        return source
    searched = source.rows(slice(0, stars_searched(camera, stars)))
    wanted = stars_for_field(camera) if stars == "auto" else stars
    return merge_doubles(searched, MERGED_WITHIN_PX * camera.pixel_rad).rows(slice(0, wanted))


def brightest_per_field(
    catalog: StarCatalog, field_rad: float, *, stars: int = STARS_OF_A_FIELD, directions: int = DIRECTIONS
) -> StarCatalog:
    """The union of the brightest stars of each circular field of this diameter, anywhere in the sky (pivot paper,
    section 3)."""
    from scipy.spatial import cKDTree

    radius = 2 * math.sin(field_rad / 4)
    tree = cKDTree(catalog.icrs)
    chosen: set[int] = set()
    for direction in spiral_directions(directions):
        chosen.update(sorted(tree.query_ball_point(direction, radius))[:stars])
    return catalog.rows(np.array(sorted(chosen), dtype=np.int64))


COVERAGE_DIRECTIONS = 6000
"""Fields of which the coverage is counted: 2.6 deg apart, the share good to 0.3 % where it is 5 %."""
MAP_DEG = 15
"""Width of a cell of the map of coverage, in right ascension and declination."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """How many stars of a catalogue fields hold: ``icrs`` (N, 3) are their boresights, ``stars`` (N,) the counts."""

    icrs: NDArray[np.float64]
    stars: NDArray[np.int64]

    def share_below(self, number: int) -> float:
        """The share of directions with fewer stars."""
        return float((self.stars < number).mean())

    def map_below(self, number: int) -> NDArray[np.float64]:
        """The same in cells of MAP_DEG (rows by declination from north, columns by right ascension from 0)."""
        ra_deg = np.degrees(np.arctan2(self.icrs[:, 1], self.icrs[:, 0])) % 360
        de_deg = np.degrees(np.arctan2(self.icrs[:, 2], np.hypot(self.icrs[:, 0], self.icrs[:, 1])))
        rows, columns = 180 // MAP_DEG, 360 // MAP_DEG
        row = np.clip((90 - de_deg) // MAP_DEG, 0, rows - 1).astype(np.int64)
        cell = row * columns + np.clip(ra_deg // MAP_DEG, 0, columns - 1).astype(np.int64)
        fields = np.bincount(cell, minlength=rows * columns)
        below = np.bincount(cell, weights=self.stars < number, minlength=rows * columns)
        return np.where(fields > 0, below / np.maximum(fields, 1), np.nan).reshape(rows, columns)


def coverage(catalog: StarCatalog, camera: Camera) -> Coverage:
    """Counts of the stars on the detector, for boresights all over the sky, each with another roll."""
    from scipy.spatial import cKDTree

    boresights = spiral_directions(COVERAGE_DIRECTIONS)
    tree = cKDTree(catalog.icrs)
    near = tree.query_ball_point(boresights, 2 * math.sin(0.55 * camera.diagonal_rad))
    east = np.cross([0.0, 0.0, 1.0], boresights)
    east /= np.sqrt((east * east).sum(axis=1))[:, None]
    north = np.cross(boresights, east)
    roll = (np.arange(COVERAGE_DIRECTIONS) * _GOLDEN_ANGLE_RAD)[:, None]
    x, y = np.cos(roll) * east + np.sin(roll) * north, np.cos(roll) * north - np.sin(roll) * east
    axes = np.stack([x, y, boresights], axis=2)
    seen = (camera.pixels(product(catalog.icrs[rows], axes[k])) for k, rows in enumerate(near))
    return Coverage(boresights, np.array([camera.contains(xy_px).sum() for xy_px in seen], dtype=np.int64))


def thinned(catalog: StarCatalog, camera: Camera, stars: int) -> StarCatalog:
    """The brightest ``stars`` of each field as large as the camera's: the others are not needed to fill it."""
    return brightest_per_field(catalog, 2 * math.acos(1 - camera.solid_angle_sr / (2 * math.pi)), stars=stars)


def merge_doubles(catalog: StarCatalog, within_rad: float) -> StarCatalog:
    """The catalogue with every star and its fainter neighbours within ``within_rad`` made one.

    It stands at their brightness-weighted place, as bright as all together, under the id of the brightest. So close,
    two images of like brightness make one peak between them: a centroid lies there, and so does the brightest pixel;
    where one star outshines the other the weighted place is the bright star's own.
    """
    pairs = _close_pairs(catalog.icrs, 2 * math.sin(within_rad / 2))
    leader = _leaders(len(catalog), pairs)
    flux = 10 ** (-0.4 * catalog.magnitude)
    icrs, total = np.zeros_like(catalog.icrs), np.zeros(len(catalog))
    np.add.at(icrs, leader, flux[:, None] * catalog.icrs)
    np.add.at(total, leader, flux)
    has_grown = np.zeros(len(catalog), dtype=np.bool_)
    has_grown[leader[leader != np.arange(len(catalog))]] = True
    grown = np.flatnonzero(has_grown)
    merged_icrs, magnitude = catalog.icrs.copy(), catalog.magnitude.copy()
    merged_icrs[grown] = icrs[grown] / np.linalg.norm(icrs[grown], axis=1)[:, None]
    magnitude[grown] = -2.5 * np.log10(total[grown])
    kept = np.flatnonzero(leader == np.arange(len(catalog)))
    order = kept[np.argsort(magnitude[kept], kind="stable")]
    return replace(catalog, icrs=merged_icrs, magnitude=magnitude).rows(order)


def _close_pairs(icrs: NDArray[np.float64], within: float) -> NDArray[np.int64]:
    """Rows (P, 2) of the stars no farther apart than ``within``, the brighter first.

    Along z each star is compared with the next ones, as far as that alone is not too far: a few dozen for the doubles
    of a catalogue, where scipy's tree would take a quarter of a second to import.
    """
    order = np.argsort(icrs[:, 2])
    sorted_icrs = icrs[order]
    ends = np.searchsorted(sorted_icrs[:, 2], sorted_icrs[:, 2] + within, side="right")
    found = [np.empty((0, 2), dtype=np.int64)]
    lower = np.arange(len(icrs))
    step = 1
    while len(lower := lower[lower + step < ends[lower]]):
        close = lower[((sorted_icrs[lower] - sorted_icrs[lower + step]) ** 2).sum(axis=1) <= within**2]
        found.append(np.column_stack([order[close], order[close + step]]))
        step += 1
    return np.sort(np.concatenate(found), axis=1)


def _leaders(size: int, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each row the row of the star that it merges with: its brightest neighbour that leads, or itself."""
    leader = np.arange(size, dtype=np.int64)
    for bright, faint in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]:
        if leader[bright] == bright and leader[faint] == faint:
            leader[faint] = bright
    return leader
