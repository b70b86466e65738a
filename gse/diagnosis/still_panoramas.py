"""Panoramas that show the same objects on the same pixels while the sky moves: a sensor whose picture is frozen.

The link detects repeated frames with one time tag (FROZEN); this sensor counts on and sends its last picture again.
Errors then grow with the Earth's turn, which looks like a driven mount or a mount that moves.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.finding import Finding
from gse.instant import NS_PER_S
from gse.station.session_data import SessionData

_FEWEST = 10
_LEAST_MOVED_PX = 5.0
"""Whole pixels of a bright star stay the same while the sky moves by one."""


def still_panoramas(session: SessionData) -> Finding | None:
    """The longest run of them, where the sky moved by some pixels meanwhile; None of a sensor that follows the sky."""
    frames, station = session.frames.columns, session.station
    rows, place = np.unique(session.frames.matches["frame"], return_inverse=True)
    if station.mount.inertial is not None or len(rows) < _FEWEST:
        return None
    first, last = _longest_run(rows, _pictures(session.frames.matches, place))
    camera = station.sensor.camera()
    declination = math.radians(float(np.nan_to_num(frames["de_true_deg"][rows[first]])))
    across = max(math.cos(declination), camera.diagonal_rad / 2)  # at the pole the field turns about its middle
    seconds = float(frames["utc_ns"][rows[last]] - frames["utc_ns"][rows[first]]) / NS_PER_S
    moved_px = EARTH_RATE_ARCSEC_PER_S * seconds * across / (camera.pixel_rad * ARCSEC_PER_RAD)
    if last - first + 1 < _FEWEST or moved_px < _LEAST_MOVED_PX:
        return None
    return Finding(
        "frozen sensor",
        f"{last - first + 1} panoramas in a row show the same objects on the same pixels, for {seconds:.0f} s in which "
        f"the sky moves by {moved_px:.0f} px; their time tags go on",
        ("a sensor that looks at a picture, not at the sky",),
        "switch the sensor off and on: it repeats one picture; ask the maker",
    )


def _pictures(matches: NDArray[np.void], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Number and sums of the places (L, 3) of the stars of each frame, the same where the stars are the same."""
    x, y = matches["x_px"].astype(np.float64), matches["y_px"].astype(np.float64)
    return np.column_stack([np.bincount(place, weights=part) for part in (np.ones(len(place)), x, y)])


def _longest_run(rows: NDArray[np.int64], pictures: NDArray[np.float64]) -> tuple[int, int]:
    """First and last place of the longest run of equal pictures of frames that follow each other."""
    changes = (pictures[1:] != pictures[:-1]).any(axis=1) | (np.diff(rows) > 1)
    edges = np.concatenate([[0], np.flatnonzero(changes) + 1, [len(rows)]])
    longest = int(np.diff(edges).argmax())
    return int(edges[longest]), int(edges[longest + 1]) - 1
