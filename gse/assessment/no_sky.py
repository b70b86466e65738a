"""Stretches in which there was no sky to see: cloud, cover, daylight.

A stretch counts as such only where the reference identifier finds no star either, for ten seconds or longer, and where
something else shows the reason: the Sun, empty panoramas, or stars that faded before or after. A sensor that fails
under a clear, dark sky is not excused. Empty panoramas have a cause of their own: a blind sensor sends them too.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.instant import NS_PER_S
from gse.site import Site
from gse.station.exclusions import Cause, Exclusion
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status
from gse.truth.solar_system import sun_altitude_deg

SUN_LIMIT_DEG = -12.0
"""Nautical twilight: above it the sky is too bright for the stars of a panorama."""

FADED_MAG = 1.0
"""Stars that are fainter by this much than in the clear part of the session are behind cloud."""

MIN_STRETCH_NS = 10 * NS_PER_S
_BRIDGED_NS = 3 * NS_PER_S
"""Single answers through a gap in the cloud do not end a stretch."""

_BESIDE_NS = 60 * NS_PER_S
_FEWEST_OBJECTS = 3
"""Fewer objects than this are no panorama of a clear sky: no identifier can work on them."""

_CLEAR_PERCENTILE = 90.0


def no_sky(frames: NDArray[np.void], site: Site) -> tuple[Exclusion, ...]:
    """The stretches of frames (rows of FRAME, any order) without a sky; each with its reason in words."""
    if (np.diff(frames["utc_ns"]) < 0).any():  # a step of the clock; a copy of a long session is 40 MB
        frames = frames[np.argsort(frames["utc_ns"], kind="stable")]
    return tuple(_explained(frames, site))


def _explained(frames: NDArray[np.void], site: Site) -> Iterator[Exclusion]:
    utc_ns = frames["utc_ns"]
    for first, last in _blind_stretches(frames):
        found = _reason(frames, first, last, site)
        if found is not None:
            yield Exclusion(int(utc_ns[first]), int(utc_ns[last]) + 1, found[1], found[0])


def _blind_stretches(frames: NDArray[np.void]) -> Iterator[tuple[int, int]]:
    """First and last row of each long stretch without an answer of either identifier."""
    seen = (frames["status"] == STATUSES.index(Status.IDENTIFIED)) | (
        frames["answer_check"] != ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    )
    blind = np.flatnonzero(~seen)
    utc_ns = frames["utc_ns"]
    for part in np.split(blind, np.flatnonzero(np.diff(utc_ns[blind]) > _BRIDGED_NS) + 1):
        if len(part) and utc_ns[part[-1]] - utc_ns[part[0]] >= MIN_STRETCH_NS:
            yield int(part[0]), int(part[-1])


def _reason(frames: NDArray[np.void], first: int, last: int, site: Site) -> tuple[Cause, str] | None:
    """Why there was no sky from one row to another; None where no evidence shows it."""
    part = frames[first : last + 1]
    middle_ns = int(part["utc_ns"][len(part) // 2])
    duration_s = float(part["utc_ns"][-1] - part["utc_ns"][0]) / NS_PER_S
    sun_deg = sun_altitude_deg(site, middle_ns)
    if sun_deg > SUN_LIMIT_DEG:
        side = "above" if sun_deg >= 0 else "below"
        return Cause.NO_SKY, f"Sun {abs(sun_deg):.0f} deg {side} the horizon: no dark sky for {duration_s:.0f} s"
    if (part["status"] == STATUSES.index(Status.SENSOR_FAULT)).any():
        return None  # only daylight explains an overexposed detector
    most = int(np.percentile(part["objects"], _CLEAR_PERCENTILE))
    if most < _FEWEST_OBJECTS:
        objects = "no object at all" if most == 0 else f"at most {most} objects"
        return Cause.NO_OBJECTS, f"{objects} for {duration_s:.0f} s: lens cap, cover or overcast"
    faded_mag = _faded_mag(frames, first, last)
    if faded_mag >= FADED_MAG:
        return Cause.NO_SKY, f"stars {faded_mag:.1f} mag too faint: cloud for {duration_s:.0f} s"
    return None


def _faded_mag(frames: NDArray[np.void], first: int, last: int) -> float:
    """How much fainter than in the clear the stars were just before or after a stretch; 0 where none were seen."""
    zero_point = frames["zero_point_mag"]
    known = np.isfinite(zero_point)
    if not known.any():
        return 0.0
    utc_ns = frames["utc_ns"]
    beside = known & ((utc_ns >= utc_ns[first] - _BESIDE_NS) & (utc_ns <= utc_ns[last] + _BESIDE_NS))
    if not beside.any():
        return 0.0
    clear = np.percentile(zero_point[known], _CLEAR_PERCENTILE)
    return float(clear - zero_point[beside].min())
