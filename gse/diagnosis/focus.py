"""Focus over a session: single stars that scatter more and more about their places, though they stay as bright."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.constants import ARCSEC_PER_RAD
from gse.diagnosis.slope_within import slope_within
from gse.finding import Finding
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames

LEAST_RATIO = 1.5
_LEAST_SIGMAS = 5.0
_FEWEST_STARS, _FEWEST_ROWS = 6, 200
_HIDDEN_PX = 0.1
"""Residuals that are smaller by chance have no logarithm of use."""
_AS_BRIGHT = 0.75
"""Of the transparency at the beginning: stars behind a cloud are faint, and scatter for that."""


@dataclass(frozen=True, slots=True)
class FocusLoss:
    """Scatter of single stars along one axis in the first and in the last quarter of a session."""

    first_px: float
    last_px: float


def focus_loss(session: SessionData, counted: CountedFrames) -> FocusLoss | None:
    """None where the scatter does not grow, or the stars fade; from the same stars, so that fainter ones do no harm."""
    frames, matches = session.frames.columns, session.frames.matches
    matches = matches.compress(counted.used[matches["frame"]])
    if len(matches) < _FEWEST_ROWS or _fades(frames["transparency"][counted.used]):
        return None
    pixel_arcsec = session.station.sensor.camera().pixel_rad * ARCSEC_PER_RAD
    residuals = np.array([matches["residual_x_arcsec"], matches["residual_y_arcsec"]], dtype=np.float64) / pixel_arcsec
    squares = (residuals**2).mean(axis=0)
    utc_ns = frames["utc_ns"][matches["frame"]]
    at = (utc_ns - utc_ns.min()) / max(int(np.ptp(utc_ns)), 1)
    found = slope_within(at, np.log(squares + _HIDDEN_PX**2), matches["star"], _FEWEST_STARS)
    parts = squares[at < 1 / 4], squares[at >= 3 / 4]
    if found is None or not found[0] > _LEAST_SIGMAS / 1.96 * found[1] or not all(len(part) for part in parts):
        return None
    first_px, last_px = (math.sqrt(float(part.mean())) for part in parts)
    return FocusLoss(first_px, last_px) if last_px >= LEAST_RATIO * first_px else None


def focus_finding(loss: FocusLoss) -> Finding:
    """It in words."""
    return Finding(
        "defocus",
        f"single stars scatter by {loss.last_px:.2f} px in the last quarter of the session, by {loss.first_px:.2f} px "
        "in the first, and are as bright as before",
        ("seeing that grows", "a vibration that smears single stars"),
        "look at focus and temperature of the lens, and repeat the session",
    )


def _fades(transparency: NDArray[np.float32]) -> bool:
    transparency = transparency[np.isfinite(transparency)]
    part = max(len(transparency) // 4, 1)
    return bool(len(transparency)) and bool(
        np.median(transparency[-part:]) < _AS_BRIGHT * np.median(transparency[:part])
    )
