"""Trends of a sensor over its nights, and how its errors follow its temperature from night to night."""

import math
from dataclasses import dataclass
from datetime import date

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.campaign.nights import Session, nightly
from gse.station.results import Subject
from gse.statistics.slopes import theil_sen
from gse.values.axis import AXES

MIN_NIGHTS = 4
"""Fewer show no trend that Sen's interval could bound."""
MIN_RANGE_K = 1.0
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class NightTrend:
    """A quantity over the nights, with its slope per 30 days and the 95 % interval of that; NaN of too few nights."""

    name: str
    unit: str
    nights: tuple[str, ...]
    values: tuple[float, ...]
    mean: float
    std: float
    per_month: float
    low: float
    high: float

    @property
    def significant(self) -> bool:
        """Whether the interval of the slope leaves zero out."""
        return self.low > 0 or self.high < 0


@dataclass(frozen=True, slots=True)
class Thermal:
    """Arcsec per kelvin of one axis: between nights by their means, and within nights as the mean of the nights."""

    axis: str
    between: float
    between_low: float
    between_high: float
    within: float
    within_low: float
    within_high: float
    nights: int
    range_k: float


def trends(nights: dict[str, list[Session]], subject: Subject, scale: dict[str, float]) -> list[NightTrend]:
    """The trends of a sensor, none of one night; ``scale`` is the relative error of the focal length of each night."""
    if len(nights) < 2:
        return []
    who = subject.value
    wanted: list[tuple[str, str, dict[str, float]]] = [
        (f"{axis.label} {what}", axis.unit, nightly(nights, f"{who}_{axis.key}_{column}"))
        for what, column in (("bias", "bias_arcsec"), ("NEA", "nea_arcsec"))
        for axis in AXES
    ]
    wanted.append(("availability", "%", _availability(nights, who)))
    focal = nightly(nights, "camera_focal_length_px")
    wanted.append(
        ("focal length", "px", {night: focal[night] * (1 + scale[night]) for night in scale if night in focal})
    )
    if nightly(nights, "mount_fit_frames"):
        wanted += [
            (f"mount {angle}", "deg", nightly(nights, f"mount_{angle}_deg"))
            for angle in ("azimuth", "altitude", "roll")
        ]
    wanted.append(("temperature", "degC", nightly(nights, "temperature_median_c")))
    wanted.append(("zero point", "mag", nightly(nights, "zero_point_median_mag")))
    return [trend(name, unit, values) for name, unit, values in wanted if values]


def trend(name: str, unit: str, values: dict[str, float]) -> NightTrend:
    """The trend of nightly values."""
    known = {night: value for night, value in values.items() if math.isfinite(value) and night != "unknown"}
    numbers = np.array(list(known.values()))
    slope = low = high = _NAN
    if len(known) >= MIN_NIGHTS:
        found = theil_sen(numbers, np.array([date.fromisoformat(night).toordinal() / 30 for night in known]))
        slope, low, high = found.slope, found.low, found.high
    std = float(numbers.std(ddof=1)) if len(numbers) > 1 else _NAN
    mean = float(numbers.mean()) if len(numbers) else _NAN
    return NightTrend(name, unit, tuple(known), tuple(known.values()), mean, std, slope, low, high)


def thermal(nights: dict[str, list[Session]], subject: Subject) -> list[Thermal]:
    """Arcsec per kelvin of each axis, where the nights tell it."""
    temperature = nightly(nights, "temperature_median_c")
    found = []
    for axis in AXES:
        bias = nightly(nights, f"{subject.value}_{axis.key}_bias_arcsec")
        both = [night for night in bias if night in temperature]
        kelvin, arcsec = (np.array([of[night] for night in both]) for of in (temperature, bias))
        between = _slope(kelvin, arcsec)
        within = _mean(np.array(list(nightly(nights, f"{subject.value}_{axis.key}_thermal_arcsec_per_k").values())))
        range_k = float(np.ptp(kelvin)) if len(kelvin) else _NAN
        if any(math.isfinite(value) for value in (*between, *within)):
            found.append(Thermal(axis.label, *between, *within, len(both), range_k))
    return found


def _availability(nights: dict[str, list[Session]], who: str) -> dict[str, float]:
    sums = {
        night: [sum(session.row[f"{who}_available_{part}"] or 0 for session in sessions) for part in ("count", "of")]
        for night, sessions in nights.items()
    }
    return {night: 100 * count / of for night, (count, of) in sums.items() if of}


_Interval = tuple[float, float, float]


def _slope(at: NDArray[np.float64], values: NDArray[np.float64]) -> _Interval:
    if len(at) < MIN_NIGHTS or np.ptp(at) < MIN_RANGE_K:
        return _NAN, _NAN, _NAN
    found = theil_sen(values, at)
    return found.slope, found.low, found.high


def _mean(values: NDArray[np.float64]) -> _Interval:
    """With the 95 % interval of Student's t, nights as the sample; NaN of one night, which bounds nothing."""
    if len(values) < 2:
        return _NAN, _NAN, _NAN
    mean = float(values.mean())
    half = float(stdtrit(len(values) - 1, 0.975)) * float(values.std(ddof=1)) / math.sqrt(len(values))
    return mean, mean - half, mean + half
