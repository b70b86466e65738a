"""Errors of single stars: blends and wrong places of the catalogue.

Residuals are turned to east and north at each star. The fit of a frame's attitude takes part of the error of each of
its stars over to the others, so that offsets of stars and shifts of frames are solved together, by turns. The errors of
a star's offset are those of means over a minute, in which pixel phases average, and what stars without fault show
beside: the robust scatter of all offsets, tails included.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.campaign.atlas import sigmas_of_place
from gse.values.constants import MAD_TO_SIGMA

SIGMAS = 5.0
"""A star is named from so many standard deviations on."""
MIN_BLOCKS = 5
BLOCK_NS = 60_000_000_000
_TURNS = 60
_SETTLED_ARCSEC = 0.01
_SHARES = ((50.0, MAD_TO_SIGMA), (90.0, 0.6080))
"""Percentiles of the absolute value of a normal deviate, and what makes a standard deviation of each."""
_ROBUST_STARS = 10


@dataclass(frozen=True, slots=True)
class StarOffsets:
    """Offsets of stars from their catalogue places as columns (S,), arcsec: measured minus expected.

    ``variance_arcsec2`` is that of each offset along one axis, from the star's own ``minutes``.
    """

    star: NDArray[np.int64]
    east_arcsec: NDArray[np.float64]
    north_arcsec: NDArray[np.float64]
    variance_arcsec2: NDArray[np.float64]
    residuals: NDArray[np.int64]
    minutes: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class NamedStar:
    """One star's offset in arcsec, its standard error along one axis, and its significance."""

    star: int
    east_arcsec: float
    north_arcsec: float
    error_arcsec: float
    sigmas: float
    nights: int
    residuals: int


def to_sky(
    residuals_arcsec: NDArray[np.float64], field_deg: NDArray[np.float64], boresight_deg: NDArray[np.float64]
) -> NDArray[np.float64]:
    """East and north (N, 2) of residuals along columns and rows (N, 2) of stars at field angles (N, 2).

    ``boresight_deg`` (N, 3) is RA, DE and roll of each frame.
    """
    _, de, roll = np.radians(boresight_deg).T
    pole = np.column_stack([np.cos(de) * np.sin(roll), -np.cos(de) * np.cos(roll), np.sin(de)])
    tangent = np.tan(np.radians(field_deg))
    star = np.column_stack([tangent, np.ones(len(tangent))])
    star /= np.linalg.norm(star, axis=1)[:, None]
    east = np.cross(pole, star)
    east /= np.maximum(np.linalg.norm(east, axis=1), 1e-12)[:, None]
    north = np.cross(star, east)
    flat = np.column_stack([residuals_arcsec, np.zeros(len(residuals_arcsec))])
    return np.column_stack([(flat * east).sum(axis=1), (flat * north).sum(axis=1)])


def star_offsets(
    sky_arcsec: NDArray[np.float64], star: NDArray[np.int64], frame: NDArray[np.int64], utc_ns: NDArray[np.int64]
) -> StarOffsets:
    """Offsets of the stars of a session from residuals (N, 2) to east and north."""
    names, of_star = np.unique(star, return_inverse=True)
    _, of_frame = np.unique(frame, return_inverse=True)
    count, in_frame = np.bincount(of_star), np.bincount(of_frame)
    offsets = np.zeros((len(names), 2))
    shifts = np.zeros((len(in_frame), 2))
    for _ in range(_TURNS):
        shifts = _means(sky_arcsec - offsets[of_star], of_frame, in_frame)
        renewed = _means(sky_arcsec - shifts[of_frame], of_star, count)
        renewed -= np.median(renewed, axis=0)  # what all stars share is the attitude's
        moved = float(np.abs(renewed - offsets).max())
        offsets = renewed
        if moved < _SETTLED_ARCSEC:
            break
    left = sky_arcsec - offsets[of_star] - shifts[of_frame]
    variance, minutes = _variance(left, of_star, utc_ns, len(names))
    return StarOffsets(names, offsets[:, 0], offsets[:, 1], variance, count, minutes)


def named_stars(sessions: list[StarOffsets]) -> list[NamedStar]:
    """The stars of several sessions with their significance, the most significant first."""
    if not sessions:
        return []
    columns = {
        name: np.concatenate([getattr(of, name) for of in sessions])
        for name in ("star", "east_arcsec", "north_arcsec", "variance_arcsec2", "residuals", "minutes")
    }
    usable = np.isfinite(columns["variance_arcsec2"])
    columns = {name: values[usable] for name, values in columns.items()}
    stars, place = np.unique(columns["star"], return_inverse=True)
    if len(stars) < _ROBUST_STARS:
        return []
    count = columns["residuals"].astype(np.float64)
    weight = np.bincount(place, weights=count)
    offsets = np.column_stack(
        [np.bincount(place, weights=count * columns[name]) / weight for name in ("east_arcsec", "north_arcsec")]
    )
    variance = np.bincount(place, weights=count**2 * columns["variance_arcsec2"]) / weight**2
    variance = variance + _floor_arcsec2(offsets, variance)
    chi2 = (offsets**2).sum(axis=1) / variance
    nights = np.bincount(place)
    minutes = np.bincount(place, weights=columns["minutes"]) - nights + 1
    order = np.argsort(-chi2, kind="stable")
    return [
        NamedStar(
            int(stars[row]),
            float(offsets[row, 0]),
            float(offsets[row, 1]),
            math.sqrt(variance[row]),
            sigmas_of_place(float(chi2[row]), float(minutes[row])),
            int(nights[row]),
            int(weight[row]),
        )
        for row in order
    ]


def _floor_arcsec2(offsets: NDArray[np.float64], variance: NDArray[np.float64]) -> float:
    """What offsets scatter beyond their own errors, by percentiles, so that a few faulty stars do not count."""
    scatter = max(factor * float(np.percentile(np.abs(offsets), percent)) for percent, factor in _SHARES)
    return max(scatter**2 - float(np.median(variance)), 0.0)


def _means(values: NDArray[np.float64], place: NDArray[np.int64], count: NDArray[np.int64]) -> NDArray[np.float64]:
    sums = [np.bincount(place, weights=column, minlength=len(count)) for column in values.T]
    return np.column_stack(sums) / count[:, None]


def _variance(
    left: NDArray[np.float64], of_star: NDArray[np.int64], utc_ns: NDArray[np.int64], stars: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Of each star's mean along one axis, from its means over minutes, NaN of too few; and the number of minutes."""
    minute = utc_ns // BLOCK_NS
    minute -= minute.min() if len(minute) else 0
    pair, place = np.unique(of_star * (int(minute.max()) + 1 if len(minute) else 1) + minute, return_inverse=True)
    sums = np.column_stack([np.bincount(place, weights=column) for column in left.T])
    owner = np.zeros(len(pair), dtype=np.int64)
    owner[place] = of_star
    blocks, total = np.bincount(owner, minlength=stars), np.bincount(of_star, minlength=stars)
    squares = np.bincount(owner, weights=(sums**2).sum(axis=1) / 2, minlength=stars)
    enough = blocks >= MIN_BLOCKS
    variance = np.full(stars, np.nan)
    variance[enough] = squares[enough] / total[enough] ** 2 * blocks[enough] / (blocks[enough] - 1)
    return variance, blocks
