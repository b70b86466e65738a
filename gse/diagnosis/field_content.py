"""What the stars of a session's fields make of its accuracy.

Two sessions of the same sensor differ by their stars: how many there are, where they stand, and on which part of their
pixels. The errors of stars tell the second from the sensor: from the matches follows what the fields make of the same
noise of a star, and by how much stars differ from each other, which is the scatter that other fields would show.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from gse.station.session_data import SessionData
from gse.station.session_tables import residuals_of, xy_px_of
from gse.truth import time_blocks
from gse.values.axis import ON_SKY
from gse.values.star_influence import (
    StarCells,
    attitude_operators,
    boresight_shifts,
    star_covariance,
    taken_by_fit,
    unfitted,
)

MIN_STARS = 5
"""Fewer do not tell by how much stars differ."""
_LEAST_LEFT = 0.1
"""Least share of a star's error variance that its residual must keep; a smaller share tells nothing of the error."""


@dataclass(frozen=True, slots=True)
class FieldContent:
    """One axis of the attitude error, as the stars make it.

    ``geometry`` is the error (rms over frames) that one arcsec of noise of each star gives. ``noise_error_share`` and
    ``spread_error_share`` are the standard errors of the noise equivalent angle and of the standard deviation, as
    shares of them, clustered by star. ``bias_error_arcsec`` is what errors that stay with a star leave in the bias.
    """

    geometry: float
    noise_error_share: float
    spread_error_share: float
    bias_error_arcsec: float


def field_content(session: SessionData, false: NDArray[np.bool_]) -> dict[str, FieldContent]:
    """By the key of each of ON_SKY, without ``false`` answers (M,); empty where the matches are of too few stars."""
    frames, matches = session.frames.columns, session.frames.matches
    good = np.isfinite(frames["roll_true_deg"]) & ~false
    matches = matches.compress(good[matches["frame"]] & matches["named"])
    stars = matches["star"]
    if len(np.unique(stars)) < MIN_STARS:
        return {}
    xy_px = xy_px_of(matches)
    residuals = residuals_of(matches)
    directions = session.station.sensor.camera().directions(xy_px)
    rotations = attitude_operators(directions, matches["frame"])
    operators = _towards_east_and_north(rotations, np.radians(frames["roll_true_deg"][matches["frame"]]))
    blocks = time_blocks(frames["utc_ns"])[matches["frame"]]
    count = len(np.unique(matches["frame"]))
    errors = unfitted(residuals, matches["frame"])
    persistent = star_covariance(operators, errors, stars, blocks, within_blocks=False) / count**2
    seen = SeenStars(directions, stars, matches["frame"])
    quick, wandering = residuals - _means(residuals, stars, blocks), residuals - _means(residuals, stars, 0 * blocks)
    return {
        axis.key: FieldContent(
            math.sqrt(float((operators[:, row] ** 2).sum()) / count),
            share_error(operators[:, row], quick, seen),
            share_error(operators[:, row], wandering, seen),
            math.sqrt(float(persistent[row, row])),
        )
        for row, axis in enumerate(ON_SKY)
    }


@dataclass(frozen=True, slots=True, eq=False)
class SeenStars:
    """Stars (N,) with their directions in the sensor frame (N, 3), and the frames (N,) that show them."""

    directions: NDArray[np.float64]
    stars: NDArray[np.int64]
    frames: NDArray[np.int64]


def _towards_east_and_north(rotations: NDArray[np.float64], roll_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation operators (N, 3, 2) as shifts of the boresight towards east and north (N, 2, 2).

    Roll is the position angle of image up, north through east: image right is 90 deg before it.
    """
    by_error = [boresight_shifts(rotations[:, :, axis]) for axis in (0, 1)]
    columns, rows = (np.column_stack([part[:, place] for part in by_error]) for place in (0, 1))
    sine, cosine = np.sin(roll_rad)[:, None], np.cos(roll_rad)[:, None]
    return np.stack([-cosine * columns - sine * rows, sine * columns - cosine * rows], axis=1)


def _means(errors: NDArray[np.float64], stars: NDArray[np.int64], blocks: NDArray[np.int64]) -> NDArray[np.float64]:
    """The mean error (N, 2) of each row's star in its time block."""
    cells = StarCells.from_stars(stars, blocks)
    return cells.means(errors)[cells.of_row]


def share_error(operators: NDArray[np.float64], residuals: NDArray[np.float64], seen: SeenStars) -> float:
    """Standard error of a root mean square of frames, as a share of it, from operators (N, 2) and residuals (N, 2).

    Stars differ (a ratio estimate, clustered by star), and those of the same phase on their pixels move alike for a
    whole session: products of two stars' errors, whose mean over other fields is zero, make the scatter of pairs. The
    fit of a frame takes more of the error of a star that stands alone, and makes its residuals depend on each other;
    both are known and taken into account. Of white noise this is 1 / sqrt(2 M), as it must be.
    """
    star, frame = (np.unique(one, return_inverse=True)[1] for one in (seen.stars, seen.frames))
    taken, squares = taken_by_fit(operators, seen.directions, seen.frames), (operators**2).sum(axis=1)
    products = _products((operators * residuals).sum(axis=1), frame, star)
    made, whole = np.diagonal(products).copy(), np.bincount(star, weights=squares)
    left = np.bincount(star, weights=squares - (taken**2).sum(axis=1))
    ratio = made.sum() / max(float(left.sum()), 1e-300)
    growth = whole / np.maximum(left, _LEAST_LEFT * whole)
    by_fit = sum(_products(one, frame, star) for one in taken.T)
    pairs = (products + ratio * by_fit) * np.sqrt(np.outer(growth, growth))
    np.fill_diagonal(pairs, 0.0)
    few = len(made) / (len(made) - 1)
    variance = few * ((growth * (made - ratio * left)) ** 2).sum() + 2 * (pairs**2).sum()
    return math.sqrt(variance) / 2 / max(float(ratio * whole.sum()), 1e-300)


def _products(values: NDArray[np.float64], frame: NDArray[np.int64], star: NDArray[np.int64]) -> NDArray[np.float64]:
    """Sums (S, S) over frames of the products of the values of two stars."""
    table = scipy.sparse.csr_array((values, (frame, star)))
    return np.asarray((table.T @ table).toarray(), dtype=np.float64)
