"""Health of the sensor over a session: hot pixels, false objects, brightness scale, centroids, telemetry."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.station.columns import SKY_CONDITIONS
from gse.station.events import Finding
from gse.station.frame_columns import Columns
from gse.station.housekeeping import firmware_text
from gse.station.results import SkyCondition
from gse.station.session_data import SessionData
from gse.statistics.slopes import slope_within, theil_sen
from gse.values.instant import NS_PER_S
from gse.values.matrices import straight_line
from protocols import StatusMessage

BLOCKS = 60
"""Slopes are of the medians of so many equal parts of the session."""
DARK_DEG = -15.0
"""Altitude of the Sun above which the light of twilight is added to that of stars, by a hundredth or more."""
THIN_CLOUD_S = 600.0
"""A cloud is thin so long before it is told and after: its stars are faint by the cloud."""
MIN_SPAN_S = 600.0
"""A shorter session tells no slope over time."""
MIN_RANGE_K = 2.0
"""A temperature that moved less tells no slope over temperature."""
FROZEN_S, FROZEN_COUNT = 600.0, 100
"""A thermometer that gives exactly the same number for so long and so often stands still."""
MIN_STAR_FRAMES = 30
MIN_STARS = 5
NOISY = 3.0
"""Times the noise that its light explains: a star that is a double, or stands on a bad pixel."""
SUPPLY_DROP = 0.9
_FIRST = 5
"""STATUS frames whose median is the supply at the start."""
_DRIFT_MAG_PER_H = 0.1


@dataclass(frozen=True, slots=True)
class Trend:
    """A slope with its 95 % interval; the name of the field that holds it says per what."""

    slope: float
    low: float
    high: float

    @property
    def is_certain(self) -> bool:
        """Whether the interval excludes zero."""
        return self.low > 0 or self.high < 0


@dataclass(frozen=True, slots=True)
class CentroidNoise:
    """Noise of single stars' centroids on one axis, and how it follows their light.

    The prediction is ``floor_px``^2 + ``photon_px``^2 / index value: what pixels and read-out leave for every star, and
    what few photons add. ``noisy_stars`` of ``stars`` have more than three times that.
    """

    stars: int
    median_px: float
    floor_px: float
    photon_px: float
    noisy_stars: int


@dataclass(frozen=True, slots=True)
class StatusSummary:
    """What STATUS frames told; ranges are (least, greatest), NaN where the protocol has no such field."""

    frames: int
    supply_v: tuple[float, float]
    temperature_c: tuple[float, float]
    modes: tuple[str, ...]
    firmware: tuple[str, ...]
    serial: tuple[int, ...]
    commands_bad: int


@dataclass(frozen=True, slots=True)
class SensorHealth:
    """The health of a sensor; a figure is NaN, or a trend None, where the session does not tell it."""

    objects: float
    hot_pixels: float
    hot_pixels_per_k: Trend | None
    false_objects: float
    brightness_mag_per_h: Trend | None
    centroid_noise: CentroidNoise | None
    housekeeping: StatusSummary | None


def sensor_health(session: SessionData) -> SensorHealth:
    """Measure it; ``objects``, ``hot_pixels`` and ``false_objects`` are means per frame that was identified."""
    frames = session.frames.columns
    seen = frames["stars_seen"] > 0
    return SensorHealth(
        objects=_mean(frames["objects"][seen]),
        hot_pixels=_mean(frames["hot_pixels"][seen]),
        hot_pixels_per_k=_hot_pixel_trend(frames["temperature_c"][seen], frames["hot_pixels"][seen]),
        false_objects=_mean(frames["false_objects"][seen]),
        brightness_mag_per_h=_brightness_trend(session),
        centroid_noise=_centroid_noise(session),
        housekeeping=_housekeeping([message for _, message in session.statuses]),
    )


def health_findings(session: SessionData, health: SensorHealth) -> Iterator[Finding]:
    """What is wrong with the sensor, by telemetry and by its stars."""
    yield from _telemetry(session)
    drift = health.brightness_mag_per_h
    if drift is not None and drift.is_certain and abs(drift.slope) > _DRIFT_MAG_PER_H:
        how = "brighter" if drift.slope > 0 else "fainter"
        yield Finding(
            "brightness scale",
            f"the same stars become {how} by {abs(drift.slope):.2f} mag/h under a clear sky",
            equals=("dew", "thin cloud"),
            next_step="look at the lens; compare with the next session: gse compare",
        )
    noise = health.centroid_noise
    if noise is not None and noise.noisy_stars > noise.stars / 2:
        yield Finding(
            "centroid noise", f"{noise.noisy_stars} of {noise.stars} stars scatter more than their light explains"
        )


def _hot_pixel_trend(temperatures_c: NDArray[np.float32], hot_pixels: NDArray[np.uint8]) -> Trend | None:
    """Hot pixels per kelvin: their dark current doubles every 7 K."""
    temperature_c = temperatures_c.astype(np.float64)
    known = np.isfinite(temperature_c)
    if not known.any() or np.ptp(temperature_c[known]) < MIN_RANGE_K:
        return None
    order = np.argsort(temperature_c[known], kind="stable")
    return _trend(temperature_c[known][order], hot_pixels[known][order].astype(np.float64))


def _brightness_trend(session: SessionData) -> Trend | None:
    """Change of the brightness of the same stars under a clear, dark sky: new stars in the field change nothing.

    A common slope within the stars, with an interval clustered by star.
    """
    frames, matches = session.frames.columns, session.frames.matches
    clear = (frames["sky_condition"] == SKY_CONDITIONS.index(SkyCondition.CLEAR)) & np.isfinite(frames["transparency"])
    clear &= ~(frames["sun_altitude_deg"] > DARK_DEG) & ~_near_cloud(frames)
    matches = matches.compress(clear[matches["frame"]] & (matches["brightness"] > 0))
    if not len(matches):
        return None
    utc_ns = frames["utc_ns"][matches["frame"]]
    if np.ptp(utc_ns) < MIN_SPAN_S * NS_PER_S:
        return None
    exposure_s = frames["exposure_s"][matches["frame"]].astype(np.float64)
    light_mag = 2.5 * np.log10(matches["brightness"] / np.where(exposure_s > 0, exposure_s, 1.0))
    found = slope_within((utc_ns - utc_ns.min()) / (3600 * NS_PER_S), light_mag, matches["star"], MIN_STARS)
    return Trend(found[0], found[0] - found[1], found[0] + found[1]) if found else None


def _near_cloud(frames: Columns) -> NDArray[np.bool_]:
    """Which frames (M,) came within THIN_CLOUD_S of a clouded one."""
    utc_ns, near_ns = frames["utc_ns"], round(THIN_CLOUD_S * NS_PER_S)
    clouded_ns = np.sort(utc_ns[frames["sky_condition"] == SKY_CONDITIONS.index(SkyCondition.CLOUDED)])
    first, last = np.searchsorted(clouded_ns, [utc_ns - near_ns, utc_ns + near_ns])
    return np.asarray(first < last)


def _trend(at: NDArray[np.float64], values: NDArray[np.float64]) -> Trend | None:
    """The slope of the means of equal parts of rows (N,), in the order of ``at``."""
    parts = np.array_split(np.arange(len(at)), min(BLOCKS, len(at)))
    places = np.array([at[rows].mean() for rows in parts])
    if len(parts) < MIN_STARS or np.ptp(places) == 0:
        return None
    found = theil_sen(np.array([values[rows].mean() for rows in parts]), places)
    return Trend(found.slope, found.low, found.high)


def _centroid_noise(session: SessionData) -> CentroidNoise | None:
    """Scatter of each star's residual from frame to frame, against its index value."""
    matches = session.frames.matches
    matches = matches.take(np.lexsort((matches["frame"], matches["star"])))
    pixel_arcsec = math.degrees(session.station.sensor.camera().pixel_rad) * 3600
    noise_px, index = [], []
    for part in np.split(matches, np.flatnonzero(np.diff(matches["star"])) + 1):
        if len(part) >= MIN_STAR_FRAMES:
            steps = np.diff([part["residual_x_arcsec"], part["residual_y_arcsec"]], axis=1)
            noise_px.append(math.sqrt(float((steps.astype(np.float64) ** 2).mean()) / 2) / pixel_arcsec)
            index.append(float(np.median(part["brightness"])))
    return _against_light(np.array(noise_px), np.maximum(np.array(index), 1.0)) if len(noise_px) >= MIN_STARS else None


def _against_light(noise_px: NDArray[np.float64], index: NDArray[np.float64]) -> CentroidNoise:
    """Least squares with both parts at least zero, without the stars that are far off."""
    kept = noise_px <= NOISY * np.median(noise_px)
    square = float(np.mean(noise_px[kept] ** 2))
    slope, floor = straight_line(1 / index[kept], noise_px[kept] ** 2) if np.ptp(index[kept]) else (0.0, square)
    if slope < 0:
        slope, floor = 0.0, square
    if floor < 0:
        slope, floor = square / float(np.mean(1 / index[kept])), 0.0
    predicted_px = np.sqrt(floor + slope / index)
    return CentroidNoise(
        len(noise_px),
        float(np.median(noise_px)),
        math.sqrt(floor),
        math.sqrt(slope),
        int((noise_px > NOISY * predicted_px).sum()),
    )


def _housekeeping(messages: list[StatusMessage]) -> StatusSummary | None:
    if not messages:
        return None
    firmware = (firmware_text(message) for message in messages if message.firmware)
    return StatusSummary(
        len(messages),
        _range([message.supply_v for message in messages]),
        _range([message.temperature_c for message in messages]),
        tuple(dict.fromkeys(message.mode for message in messages if message.mode)),
        tuple(dict.fromkeys(firmware)),
        tuple(dict.fromkeys(message.serial for message in messages if message.serial)),
        max(message.commands_bad for message in messages),
    )


def _telemetry(session: SessionData) -> Iterator[Finding]:
    """Telemetry that is zero, not a number, or stands still; a field that the protocol lacks is never a number.

    The temperature in panoramas may stand still, of a coarse thermometer or of a sensor that has none, unless that in
    STATUS frames moves.
    """
    frames = session.frames.columns
    utc_ns = np.array([at for at, _ in session.statuses], dtype=np.int64)
    messages = [message for _, message in session.statuses]
    of_status_c = np.array([message.temperature_c for message in messages], dtype=np.float64)
    known_c = of_status_c[np.isfinite(of_status_c)]
    of_panoramas_c = frames["temperature_c"].astype(np.float64)
    yield from _thermometer(
        "panoramas", frames["utc_ns"], of_panoramas_c, may_stand_still=not len(known_c) or np.ptp(known_c) == 0
    )
    if not messages:
        return
    yield from _thermometer("STATUS frames", utc_ns, of_status_c, may_stand_still=False)
    yield from _supply(np.array([message.supply_v for message in messages]))
    problems = [message.problems[0] for message in messages if message.problems]
    if problems:
        yield _not_to_be_trusted(f"{len(problems)} of {len(messages)} STATUS frames are invalid: {problems[0]}")
    time_us = np.array([message.time_us for message in messages], dtype=np.uint64)
    still = (np.diff(time_us) == 0) & (np.diff(utc_ns) > 0)
    if still.any():
        yield _not_to_be_trusted(f"the STATUS time stands still in {int(still.sum())} of {len(messages)} STATUS frames")
    serials = dict.fromkeys(message.serial for message in messages if message.serial)
    if len(serials) > 1:
        yield _not_to_be_trusted(f"the serial number changes: {', '.join(map(str, list(serials)[:5]))}")


def _not_to_be_trusted(size: str, equals: tuple[str, ...] = ()) -> Finding:
    return Finding("telemetry", size, equals, "look at the frames with gse decode, and at the protocol file")


def _thermometer(
    where: str, utc_ns: NDArray[np.int64], temperature_c: NDArray[np.float64], *, may_stand_still: bool
) -> Iterator[Finding]:
    known = np.isfinite(temperature_c)
    if not known.any():
        return
    if not known.all():
        yield _not_to_be_trusted(f"the temperature is not a number in {int((~known).sum())} of {len(known)} {where}")
    values = temperature_c[known]
    is_still = len(values) >= FROZEN_COUNT and np.ptp(utc_ns[known]) >= FROZEN_S * NS_PER_S and not may_stand_still
    if np.ptp(values) == 0 and (is_still or (values[0] == 0 and len(values) >= MIN_STAR_FRAMES)):
        equals = () if values[0] == 0 else ("a coarse thermometer",)
        yield _not_to_be_trusted(f"the temperature is {values[0]:.2f} degC in all {len(values)} {where}", equals)


def _supply(supply_v: NDArray[np.float64]) -> Iterator[Finding]:
    known = supply_v[np.isfinite(supply_v)]
    if not len(known):
        return
    if len(known) < len(supply_v):
        missing = len(supply_v) - len(known)
        yield _not_to_be_trusted(f"the supply voltage is not a number in {missing} of {len(supply_v)} STATUS frames")
    usual = float(np.median(known))
    before = max(usual, float(np.median(known[:_FIRST])))
    if usual == 0:
        yield _not_to_be_trusted(f"the supply voltage is 0 V in most of {len(known)} STATUS frames")
    elif known.min() < SUPPLY_DROP * before:
        yield Finding(
            "supply voltage",
            f"it fell to {known.min():.2f} V from {before:.2f} V",
            next_step="check cable and power supply",
        )


def _mean(values: NDArray[np.generic]) -> float:
    return float(values.mean()) if len(values) else math.nan


def _range(values: list[float]) -> tuple[float, float]:
    known = [value for value in values if math.isfinite(value)]
    return (min(known), max(known)) if known else (math.nan, math.nan)
