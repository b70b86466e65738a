"""Summary of the sky over a session: conditions over time, and how deep the stars were seen."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gse.station.columns import SKY_CONDITIONS
from gse.station.frame_columns import Columns
from gse.station.results import SkyCondition
from gse.station.sky_condition import SUN_LIMIT_DEG

MOST_STRETCHES = 200
"""Broken cloud makes thousands; the first ones and the shares tell the story."""


@dataclass(frozen=True, slots=True)
class SkyStretch:
    """Frames of one condition from one instant to another, UTC in nanoseconds; numbers are medians, NaN if unknown."""

    from_ns: int
    until_ns: int
    condition: SkyCondition
    frames: int
    seen_share: float
    transparency: float
    limiting_mag: float


@dataclass(frozen=True, slots=True)
class SkySummary:
    """The sky of a session: shares of its frames by condition, stretches, and the range of what is known of it.

    Ranges are (least, greatest). ``condition`` is that of most frames. ``limiting_mag`` and ``seen_share`` are medians
    under a clear sky, or of all frames with stars where none was clear.
    """

    condition: SkyCondition
    shares: dict[SkyCondition, float]
    stretches: tuple[SkyStretch, ...]
    stretches_more: int
    limiting_mag: float
    seen_share: float
    stars_expected: tuple[float, float]
    sun_altitude_deg: tuple[float, float]
    moon_altitude_deg: tuple[float, float]
    moon_separation_deg: tuple[float, float]


def sky_summary(frames: Columns) -> SkySummary | None:
    """The summary of rows of FRAME; None of none."""
    if not len(frames):
        return None
    counts = np.bincount(frames["sky_condition"], minlength=len(SKY_CONDITIONS))
    clear = frames["sky_condition"] == SKY_CONDITIONS.index(SkyCondition.CLEAR)
    best = clear if clear.any() else frames["stars_seen"] > 0
    stretches = tuple(_stretches(frames))
    return SkySummary(
        condition=SKY_CONDITIONS[int(counts.argmax())],
        shares={name: float(count) / len(frames) for name, count in zip(SKY_CONDITIONS, counts, strict=True) if count},
        stretches=stretches[:MOST_STRETCHES],
        stretches_more=max(len(stretches) - MOST_STRETCHES, 0),
        limiting_mag=_median(frames["limiting_mag"][best]),
        seen_share=_median(seen_share(frames)[best]),
        stars_expected=_range(frames["stars_expected"]),
        sun_altitude_deg=_range(frames["sun_altitude_deg"]),
        moon_altitude_deg=_range(frames["moon_altitude_deg"]),
        moon_separation_deg=_range(frames["moon_separation_deg"]),
    )


def seen_share(frames: Columns) -> NDArray[np.float64]:
    """The share (M,) of the expected stars that was seen, at most 1; NaN where none is expected."""
    expected = frames["stars_expected"].astype(np.float64)
    return np.minimum(frames["stars_seen"] / np.where(expected > 0, expected, np.nan), 1.0)


def zero_point_mag(frames: Columns) -> float:
    """Magnitude of a star with index value 1 in an exposure of 1 s, median of the clear frames in the dark; or NaN.

    That of a night that is known to be clear is what a station file states as ``sensor.zero_point_mag``.
    """
    clear = frames["sky_condition"] == SKY_CONDITIONS.index(SkyCondition.CLEAR)
    clear &= (frames["sun_altitude_deg"] <= SUN_LIMIT_DEG) & (frames["exposure_s"] > 0)
    return _median(frames["zero_point_mag"][clear] - 2.5 * np.log10(frames["exposure_s"][clear]))


def _stretches(frames: Columns) -> Iterator[SkyStretch]:
    changes = np.flatnonzero(np.diff(frames["sky_condition"])) + 1
    utc_ns, condition, seen = frames["utc_ns"], frames["sky_condition"], seen_share(frames)
    for first, until in pairwise([0, *changes.tolist(), len(utc_ns)]):
        yield SkyStretch(
            int(utc_ns[first:until].min()),
            int(utc_ns[first:until].max()),
            SKY_CONDITIONS[int(condition[first])],
            until - first,
            _median(seen[first:until]),
            _median(frames["transparency"][first:until]),
            _median(frames["limiting_mag"][first:until]),
        )


def _median(values: NDArray[np.floating]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


def _range(values: NDArray[np.floating]) -> tuple[float, float]:
    known = values[np.isfinite(values)].astype(np.float64)
    return (float(known.min()), float(known.max())) if len(known) else (math.nan, math.nan)
