"""What stars with lasting errors do to the attitude as they come into the field and leave it.

A double star, a bad place in the catalogue or a star in the blur of the lens keeps its error; the day it leaves the
field the boresight steps. Each star's error is the mean of its residuals and of what the fits of its frames took of it.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gse.assessment.error_series import ErrorSeries
from gse.camera import Camera
from gse.star_influence import attitude_operators, boresight_shifts

_MOST_ROWS = 40_000
_ROUNDS = 5
"""Each takes what the one before left of a star among the others of its frames, a twentieth or less."""


def sampled_matches(matches: NDArray[np.void], series: ErrorSeries) -> NDArray[np.void]:
    """Those that answers name in the frames of a series, of every second, third, ... frame where they are many."""
    matches = matches[matches["named"] & np.isin(matches["frame"], series.rows)]
    numbers = np.unique(matches["frame"])
    return matches[np.isin(matches["frame"], numbers[:: max(-(-len(matches) // _MOST_ROWS), 1)])]


def without_star_changes(
    series: ErrorSeries, matches: NDArray[np.void], residuals_arcsec: NDArray[np.float64], camera: Camera
) -> ErrorSeries:
    """The errors without what a change of the stars makes of their lasting errors; their mean stays.

    ``residuals_arcsec`` (N, 2) are those of matches (rows of MATCH), of some frames at least.
    """
    xy_px = np.column_stack([matches["x_px"], matches["y_px"]]).astype(np.float64)
    directions = camera.directions(xy_px)
    operators = attitude_operators(directions, matches["frame"])
    numbers, place = np.unique(matches["frame"], return_inverse=True)
    _, star, sightings = np.unique(matches["star"], return_inverse=True, return_counts=True)
    turns = np.zeros((len(numbers), 3))
    for _ in range(_ROUNDS):
        errors = residuals_arcsec + np.cross(turns[place], directions)[:, :2]
        kept = np.column_stack([np.bincount(star, weights=part) / sightings for part in errors.T])
        turns = np.zeros((len(numbers), 3))
        np.add.at(turns, place, np.einsum("nij,nj->ni", operators, kept[star]))
    shifts = boresight_shifts(turns)
    made = np.column_stack([np.interp(series.rows, numbers, shift) for shift in shifts.T])
    return replace(series, errors_arcsec=series.errors_arcsec - (made - made.mean(axis=0)))
