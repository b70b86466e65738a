"""Findings from fine causes: size in the unit that an operator turns, equals, the next step."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.field_patterns import FieldOfErrors
from gse.diagnosis.fine_causes import (
    MOST_HPA,
    MOST_SWING_ARCSEC,
    TANGENTIAL,
    ZERO_C_K,
    FineHypothesis,
    Named,
    fine_causes,
)
from gse.diagnosis.gross_causes import DATE_S, wrong_dates
from gse.diagnosis.late_frames import CRYSTAL_PPM, LateFrames
from gse.diagnosis.session_model import ErrorSeries, SessionModel
from gse.diagnosis.turns import about, all_turns, pole
from gse.station.events import Finding
from gse.station.session_data import SessionData
from gse.statistics.excuses import air_in_field
from gse.truth import horizon_to_sensor, mount_of
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_RAD, EARTH_RATE_ARCSEC_PER_S, EARTH_RATE_RAD_PER_S
from gse.values.instant import NS_PER_S, to_text
from gse.values.matrices import lstsq, product
from gse.values.mount import Mount
from gse.values.site import Site
from gse.values.star_influence import boresight_shifts
from gse.values.text import percent

# Vibration: a boresight that scatters from frame to frame by more than its stars explain.
#
# A mount that shakes moves all stars of a frame alike: the attitudes scatter, the residuals within a frame do not. What
# the residuals make of the boresight is its noise equivalent angle as predicted; both are taken without what lasts
# longer than 20 s.

_CAUSE = "vibration"
LEAST_RATIO = 4.0
"""Least ratio of the variances: the scatter is then twice what stars explain, since seeing makes a part of it too."""
_LEAST_SIGMAS = 5.0
_BLOCK_S, _MIN_BLOCKS = 20.0, 8
_FRAMES_OF_BLOCK = 12
_LAGS = 20
_LINE_SHARE = 0.3
_LINE_OVER_MEDIAN = 20.0
_UNEVEN = 0.2


@dataclass(frozen=True, slots=True)
class Vibration:
    """Root mean square in arcsec along columns and rows together, beyond the predicted one; a frequency, or NaN."""

    excess_arcsec: float
    predicted_arcsec: float
    frequency_hz: float
    frame_hz: float


def without_waves(series: ErrorSeries, periods_s: Sequence[float], *, drifts: bool = False) -> ErrorSeries:
    """The errors without the sinusoids that were found, and without a drift where one was."""
    phases = [2 * math.pi / period_s * series.time_s for period_s in periods_s]
    slow = [wave(phase) for phase in phases for wave in (np.sin, np.cos)]
    slow += [series.time_s - series.time_s.mean()] * drifts
    if not slow:
        return series
    design = np.column_stack([np.ones(len(series.time_s)), *slow])
    fit = lstsq(design, series.errors_arcsec)
    return replace(series, errors_arcsec=series.errors_arcsec - product(design[:, 1:], fit[1:]))


def vibration(series: ErrorSeries, field: FieldOfErrors) -> Vibration | None:
    """None where the scatter is what the stars explain, and where most frames are of one instant with another."""
    frame_s = float(np.median(np.diff(series.time_s)))
    if frame_s <= 0:
        return None
    longest_s = min(_BLOCK_S, series.duration_s / _MIN_BLOCKS)
    blocks = np.floor(series.time_s / max(longest_s, _FRAMES_OF_BLOCK * frame_s, 1e-9)).astype(np.int64)
    if len(np.unique(blocks)) < _MIN_BLOCKS // 2:
        return None
    quick = _without_means(series.errors_arcsec[:, :2], blocks)
    predicted = _predicted(field, series.rows, blocks)
    ratio = np.array([_usual_variance(axis, blocks) for axis in quick.T]) / predicted
    sigma = np.sqrt(2 / np.array([_independent(axis) for axis in quick.T]))
    if not ((ratio > LEAST_RATIO) & (ratio - 1 > _LEAST_SIGMAS * sigma)).any():
        return None
    axis = int(((ratio - 1) * predicted).argmax())
    excess = float(np.maximum((ratio - 1) * predicted, 0).sum())
    line_hz = _line_hz(series.time_s, quick[:, axis], frame_s, excess)
    return Vibration(math.sqrt(excess), math.sqrt(float(predicted.sum())), line_hz, 1 / frame_s)


def _usual_variance(quick: NDArray[np.float64], blocks: NDArray[np.int64]) -> float:
    """The median over blocks, so that a slip inside one of them counts for nothing."""
    _, place, count = np.unique(blocks, return_inverse=True, return_counts=True)
    squares = np.bincount(place, weights=quick**2) / count
    full = count >= min(_FRAMES_OF_BLOCK / 2, int(np.median(count)))
    freedom = max(float(np.median(count[full])) - 1, 1.0)
    return float(np.median(squares[full])) / (1 - 2 / (9 * freedom)) ** 3  # Wilson & Hilferty's median of chi squared


def _without_means(values: NDArray[np.float64], blocks: NDArray[np.int64]) -> NDArray[np.float64]:
    """Values (M, P) about the means of their blocks, scaled up by what these took."""
    _, place, count = np.unique(blocks, return_inverse=True, return_counts=True)
    means = np.column_stack([np.bincount(place, weights=part) for part in values.T]) / count[:, None]
    kept = 1 - 1 / np.maximum(count, 2)
    return np.asarray((values - means[place]) / np.sqrt(kept)[place, None])


def _predicted(field: FieldOfErrors, rows: NDArray[np.int64], block_of_row: NDArray[np.int64]) -> NDArray[np.float64]:
    """Variances (2,) along columns and rows of one frame's boresight, by the residuals of its stars."""
    stars = field.stars
    block_of_frame = np.full(max(int(rows.max()), int(stars.frames.max())) + 1, -1)
    block_of_frame[rows] = block_of_row
    blocks = block_of_frame[stars.frames]
    cells = stars.stars * (int(blocks.max()) + 2) + blocks
    quick = _without_means(stars.errors, cells)
    variance = float((quick**2).mean())
    turns = np.einsum("nij,nkj->ik", stars.operators, stars.operators) / len(np.unique(stars.frames))
    to_shifts = boresight_shifts(np.eye(3)).T
    return np.asarray(np.diag(product(to_shifts, turns, to_shifts.T))[:2] * variance)


def _independent(values: NDArray[np.float64]) -> float:
    """How many values tell the variance as well as these: by the squares of the first autocorrelations."""
    total = float(product(values, values)) or math.inf  # an axis without any error
    lags = range(1, min(_LAGS, len(values) // 4))
    return len(values) / (1 + 2 * sum((float(product(values[lag:], values[:-lag])) / total) ** 2 for lag in lags))


def _line_hz(time_s: NDArray[np.float64], values: NDArray[np.float64], frame_s: float, excess: float) -> float:
    """The frequency that has a good share of the excess; NaN where frames are irregular or there is none."""
    steps = np.diff(time_s)
    if (np.abs(steps - frame_s) > _UNEVEN * frame_s).mean() > _UNEVEN / 10:
        return math.nan
    power = np.abs(np.fft.rfft(values)) ** 2 * 2 / len(values) ** 2
    power[0] = 0.0
    peak = int(power.argmax())
    line = float(power[max(peak - 1, 0) : peak + 2].sum())
    if line < _LINE_SHARE * excess / 2 or power[peak] < _LINE_OVER_MEDIAN * np.median(power[1:]):
        return math.nan
    return peak / (len(values) * frame_s)


def without_shaking(found: tuple[Finding, ...], session: SessionData) -> tuple[Finding, ...]:
    """Findings without a vibration where air parts the stars.

    An identifier then names those whose errors make up for the air, so that they scatter by less than all do.
    """
    if any(finding.cause == _CAUSE for finding in found) and air_in_field(session):
        return tuple(finding for finding in found if finding.cause != _CAUSE)
    return found


_CALIBRATE = "gse calibrate SESSION --write FILE"
_ALIGN = "gse align SESSION --write FILE"
_SYNC = "see whether the clock is synchronised: gse preflight; then repeat the session"
_LEAVE_OUT = 'fix the mount; judge the rest of the session: gse report SESSION --leave-out "FROM/TO=mount: moved"'
_OPTICS = "a sensor whose optics drift"
_SETTLE = "fix the mount, let it settle, and repeat the session"
TAGS_DRIFT = "sensor clock drift"
_STEP_OF_TAGS = "a step of the sensor's own time tags, or its restart: the time of a raw capture is made of them"
_SIGMAS = 3.0
_LATENCY_S = 2.5
_SURE_S = 0.2
"""An offset that is known worse is near to a whole second by chance."""
CLOCK_SCALES = {"clock set to GPS time": 18.0, "clock set to TAI": 37.0}
"""Error in s of a host's clock that was set to another time scale than UTC, since 2017."""
_SAME_DELAY_S = 0.02
"""The latency that a USB adapter may have."""
_DOUBTFUL = 2.0
"""Times the turn that a delay makes: a slip is known so badly where it is told beside a step of time."""
_MOST_PRESSURE_SHARE = 0.3
_MOST_BEAT_FRAMES = 200
"""One vibration of a hundred beats with the frames as slowly as this, or slower."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What findings are worded with: the stated values, the first instant, the exposure, and frames per second.

    ``late`` is None where host stamps do not tell how late frames are read. Without host times, ``has_host``, as in a
    raw capture, all time is the sensor's own; where its clock ``is_absolute`` it is in any session.
    """

    camera: Camera
    site: Site
    mount: Mount
    first_ns: int
    exposure_s: float
    frame_hz: float
    late: LateFrames | None = None
    has_host: bool = True
    is_absolute: bool = False


def fine_findings(model: SessionModel, series: ErrorSeries, setting: Setting) -> tuple[Finding, ...]:
    """The fine causes of a session as findings; a vibration, which needs all of ``series``, is one of its own."""
    causes = fine_causes(model)
    found = [_WORDS[one.hypothesis.cause](one, setting) for one in causes]
    if model.field is not None:
        periods_s = [one.hypothesis.at_s for one in causes if one.hypothesis.cause == "thermal sinusoid"]
        drifts = any(one.hypothesis.cause in ("clock drift", "mount moves") for one in causes)
        shaking = vibration(without_waves(series, periods_s, drifts=drifts), model.field)
        found += [_vibration(shaking)] if shaking and shaking.excess_arcsec <= MOST_SWING_ARCSEC else []
    return tuple(found)


def _equals(one: Named, *more: str) -> tuple[str, ...]:
    rivals = [_rival(rival) for rival in one.equals if rival.cause != one.hypothesis.cause]
    return tuple(dict.fromkeys([*more, *rivals]))


def _rival(rival: FineHypothesis) -> str:
    if rival.cause == "clock offset":
        return "clock offset or longitude"
    if rival.cause == "clock step":
        return "clock step or link delay"
    return rival.cause if rival.kind in (rival.cause, "k1 and k2") else f"{rival.cause} ({rival.kind})"


def _clock_offset(one: Named, setting: Setting) -> Finding:
    fast_s, error_s = one.coefficients.item(), one.errors.item()
    arcsec = fast_s * EARTH_RATE_ARCSEC_PER_S
    fits_deg = setting.site.longitude_deg - arcsec / 3600
    equals = [f"longitude (the stars fit site.longitude_deg: {fits_deg:.5f})"]
    equals.append(f"a mount turned about the pole by {arcsec:+.1f} arcsec")
    if abs(fast_s) < _LATENCY_S:
        equals.append(f"latency: frames that are stamped {abs(fast_s):.3f} s {'late' if fast_s > 0 else 'early'}")
    for share, end in ((0.5, "one end"), (1.0, "the wrong end")):
        if abs(abs(fast_s) - share * setting.exposure_s) < _SIGMAS * error_s < setting.exposure_s / 4:
            equals.append(f"a time stamp of {end} of the exposure ({setting.exposure_s:g} s)")
    equals += wrong_dates(fast_s)
    is_clock = setting.is_absolute or setting.has_host
    whose = "the host's clock is" if is_clock else "the start that was given (--start-utc) is"
    whose = "the sensor's clock is" if setting.is_absolute else whose
    fast = ("fast" if fast_s > 0 else "slow") if is_clock else ("late" if fast_s > 0 else "early")
    size = f"{whose} {abs(fast_s):.{_digits(error_s)}f} s {fast} (+- {_digits_of(2 * error_s, 2)} s)"
    if _is_whole(abs(fast_s), 1.0, error_s):
        size += ": a leap second"
    scales = (cause for cause, ahead_s in CLOCK_SCALES.items() if _is_whole(fast_s, ahead_s, error_s))
    advice = _SYNC if setting.has_host else "judge the capture again with the right start: --start-utc"
    if setting.is_absolute:
        advice = "see what the sensor's time tags tell: sensor.time in the station file (scale, epoch, tag_of)"
    return Finding(next(scales, "clock offset"), size, _equals(one, *equals), advice)


def _is_whole(fast_s: float, expected_s: float, error_s: float) -> bool:
    return error_s <= _SURE_S and abs(fast_s - expected_s) <= _SIGMAS * error_s


def _digits_of(value: float, digits: int) -> str:
    """A positive figure with so many digits, without an exponent."""
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def _mount(one: Named, setting: Setting) -> Finding:
    dates = _dates_like(one, setting) if len(one.coefficients) > 1 else ()
    advice = f"see whether the host's date is right; where it is: {_ALIGN}" if dates else _ALIGN
    return Finding("mount", f"it is off by {_angles(one, setting)}", _equals(one, *dates), advice)


def _dates_like(one: Named, setting: Setting) -> tuple[str, ...]:
    """Wrong dates that turn the sky as three angles of the mount do, but for precession and aberration."""
    turn = product(horizon_to_sensor(setting.mount).T, _turned(one, setting.mount))
    angle_rad, left_rad = about(pole(setting.site), turn)
    if left_rad > DATE_S * EARTH_RATE_RAD_PER_S:
        return ()
    return tuple(wrong_dates(angle_rad / EARTH_RATE_RAD_PER_S))


def _angles(one: Named, setting: Setting) -> str:
    mount, size = setting.mount, one.coefficients
    if len(size) == 1:
        name = one.hypothesis.kind
        arcsec, error = size.item(), one.errors.item()
        fits = getattr(mount, f"{name}_deg") + arcsec / 3600
        return (
            f"{arcsec:+.1f} arcsec (+- {_digits_of(2 * error, 2)}) in {name}: the stars fit {_fits(mount, name, fits)}"
        )
    fitted = mount_of(_turned(one, mount))
    return (
        f"{_three(one)}: the stars fit azimuth {fitted.azimuth_deg:.5f}, altitude {fitted.altitude_deg:.5f}, roll "
        f"{fitted.roll_deg:.4f} deg"
    )


def _turned(one: Named, mount: Mount) -> NDArray[np.float64]:
    """The rotation (3, 3) from the horizon frame to the sensor of a mount that three angles turn."""
    across, up, roll = (erfa.rv2m(-axis * arcsec * ARCSEC_RAD)  # ERFA's turns the axes
                        for axis, arcsec in zip(all_turns(mount), one.coefficients, strict=True))  # fmt: skip
    return np.asarray(product(horizon_to_sensor(mount), across, up, roll))


def _fits(mount: Mount, name: str, fits_deg: float) -> str:
    """An angle as a station file takes it: an altitude beyond the zenith is one of the other side."""
    if name == "altitude" and fits_deg > 90:
        turned = f"mount.azimuth_deg: {(mount.azimuth_deg + 180) % 360:g}, mount.altitude_deg: {180 - fits_deg:.5f}"
        return f"{turned}, mount.roll_deg: {(mount.roll_deg + 180) % 360:g}"
    return f"mount.{name}_deg: {fits_deg % 360 if abs(fits_deg) > 360 else fits_deg:.5f}"


def _three(one: Named, unit: str = "arcsec") -> str:
    """A turn in words: of one angle, or across, up and about the boresight."""
    names = (one.hypothesis.kind,) if len(one.coefficients) == 1 else ("azimuth (on the sky)", "altitude", "roll")
    return ", ".join(f"{size:+.1f} {unit} in {name}" for name, size in zip(names, one.coefficients, strict=True))


def _site(one: Named, setting: Setting) -> Finding:
    arcsec, error = one.coefficients.item(), one.errors.item()
    fits = setting.site.latitude_deg + arcsec / 3600
    size = f"latitude: the stars fit site.latitude_deg: {fits:.5f}, stated is {setting.site.latitude_deg:g} "
    size += f"({arcsec:+.1f} +- {_digits_of(2 * error, 2)} arcsec, {arcsec * 30.9:+.0f} m on the ground)"
    return Finding(
        "site",
        size,
        _equals(one, "a mount that leans to north or south"),
        "correct the coordinates in the station file",
    )


def _focal_length(one: Named, setting: Setting) -> Finding:
    share, error = one.coefficients.item(), one.errors.item()
    fits = setting.camera.focal_length_px * (1 + share)
    size = (
        f"it is {percent(abs(share), 3)} too {'short' if share > 0 else 'long'} (+- {_digits_of(200 * error, 1)} %): "
    )
    size += "the stars fit "
    return Finding("focal length", f"{size}sensor.focal_length_px: {fits:.2f}", _equals(one), _CALIBRATE)


def _distortion(one: Named, setting: Setting) -> Finding:
    if one.hypothesis.kind == TANGENTIAL:
        return _tangential(one, setting)
    change = np.zeros(2)
    change[: len(one.coefficients)] = one.coefficients
    edge_px = float(change.sum()) * setting.camera.columns / 2
    k1, k2 = np.array(setting.camera.radial_distortion) + change
    size = f"stars at the edge lie {abs(edge_px):.2f} px too far {'in' if edge_px > 0 else 'out'}: the stars fit "
    return Finding("distortion", f"{size}sensor.radial_distortion: [{k1:.6f}, {k2:.6f}]", _equals(one), _CALIBRATE)


def _tangential(one: Named, setting: Setting) -> Finding:
    p1, p2 = np.array(setting.camera.tangential_distortion) + one.coefficients
    edge_px = math.hypot(*one.coefficients) * 3 * setting.camera.columns / 2
    size = f"the lens is not centred: stars at the edge lie up to {edge_px:.2f} px off: the stars fit "
    size += f"sensor.tangential_distortion: [{p1:.6f}, {p2:.6f}]"
    return Finding("distortion", size, _equals(one), "gse calibrate SESSION --tangential --write FILE")


def _pixel_pitch(one: Named, setting: Setting) -> Finding:
    share, error = one.coefficients.item(), one.errors.item()
    kind, other, axis = ("columns", "rows", "x") if one.hypothesis.kind == "columns" else ("rows", "columns", "y")
    size = (
        f"{kind} lie {percent(abs(share), 3)} {'further' if share > 0 else 'closer'} (+- {_digits_of(200 * error, 1)} "
    )
    size += f"%) than {other}: pixels that are not square, or {axis} in another scale"
    return Finding(
        "pixel pitch", size, _equals(one, f"a scale of {axis} that the protocol description has otherwise"),
        f"see the data sheet for the pitch of the pixels; correct scale of {axis} in the protocol description",
    )  # fmt: skip


def _pixel_origin(one: Named, setting: Setting) -> Finding:
    off_px = one.coefficients.item()
    counted = "from 1" if abs(off_px) > 0.75 else "from the corner of the first one"
    size = f"all stars lie {abs(off_px):.2f} px off along both axes: the sensor counts pixels {counted}"
    return Finding(
        "pixel origin", size, _equals(one, "a principal point that is off by as much", "a mount turned by as much"),
        "correct zero of x and y in the protocol description (docs/protocols.md)",
    )  # fmt: skip


def _principal_point(one: Named, setting: Setting) -> Finding:
    dx, dy = one.coefficients.tolist()
    x, y = setting.camera.principal_point_px
    error = _digits_of(2 * float(one.errors.max()), 2)
    size = f"it is off by {dx:+.2f} px in x and {dy:+.2f} px in y (+- {error}): the stars fit "
    arcsec = math.hypot(dx, dy) * math.degrees(setting.camera.pixel_rad) * 3600
    mount = f"a mount turned by {arcsec:.0f} arcsec, were it not for the field's edges"
    return Finding(
        "principal point",
        f"{size}sensor.principal_point_px: [{x + dx:.2f}, {y + dy:.2f}]",
        _equals(one, mount),
        _CALIBRATE,
    )


def _refraction(one: Named, setting: Setting) -> Finding:
    off, error = one.coefficients.item(), one.errors.item()
    stated_hpa, stated_c = setting.site.air_pressure_hpa, setting.site.air_temperature_c
    fits_hpa = stated_hpa + off
    pressure = f"pressure: the stars fit site.pressure_hpa: {fits_hpa:.0f}, in force is {stated_hpa:.0f}"
    size, equals = f"{pressure} (+- {_digits_of(2 * error, 1)})", []
    if abs(off) < _MOST_PRESSURE_SHARE * stated_hpa:
        kelvin = -off / fits_hpa * (stated_c + ZERO_C_K)
        equals.append(f"temperature ({kelvin:+.0f} K)")
        if fits_hpa > MOST_HPA:
            error_k = error / fits_hpa * (stated_c + ZERO_C_K)
            size = f"temperature: the stars fit site.temperature_c: {stated_c + kelvin:.0f}, in force is {stated_c:.0f}"
            size, equals = f"{size} (+- {_digits_of(2 * error_k, 1)})", []
    return Finding(
        "refraction", size, _equals(one, *equals), "enter pressure and temperature at the mount in the station file"
    )


def _clock_drift(one: Named, setting: Setting) -> Finding:
    """The host's clock, where its stamps run as fast against the sensor's tags; else the mount."""
    ppm, error = one.coefficients.item(), one.errors.item()
    off = abs(ppm) / (1 - 1e-6 * ppm)  # of the time that passes, and not of the time that it shows
    runs = f"{off:.0f} ppm {'fast' if ppm > 0 else 'slow'} (+- {_digits_of(2 * error, 2)}), "
    runs += f"{off * 3.6e-3:.3f} s in an hour"
    equals = _equals(one, "a mount that turns about the pole")
    if not setting.has_host:
        return Finding(TAGS_DRIFT, f"the sensor's time tags, by which this capture has its times, run {runs}",
                       equals, "record with gse run: the host's clock then tells")  # fmt: skip
    if setting.late and abs(setting.late.drift * 1e6 - ppm) > abs(ppm) / _DOUBTFUL:
        rivals = [rival for rival in _equals(one, _OPTICS) if rival != "mount moves"]
        if abs(ppm) <= CRYSTAL_PPM:
            rivals.append(f"clocks of host and sensor that both run {abs(ppm):.0f} ppm {'fast' if ppm > 0 else 'slow'}")
        turned = f"by {3600e-6 * ppm * EARTH_RATE_ARCSEC_PER_S:+.1f} arcsec/h about the pole"
        return Finding("mount moves", turned, tuple(rivals), _SETTLE)
    return Finding("clock drift", f"the host's clock runs {runs}", equals, _SYNC)


def _by_the_tags(one: Named, setting: Setting, turned_arcsec: float, over_s: float, by_stars: str) -> Finding | None:
    """A turn of the sky in ``over_s`` that the host's clock makes, where it drifts as much against the time tags."""
    drift = setting.late.drift if setting.late else 0.0
    arcsec = EARTH_RATE_ARCSEC_PER_S * abs(drift) * over_s
    is_as_much = arcsec / _DOUBTFUL < turned_arcsec < _DOUBTFUL * arcsec
    if abs(drift) < CRYSTAL_PPM * 1e-6 or not is_as_much or all(rival.cause != "clock drift" for rival in one.equals):
        return None
    size = f"the host's clock runs {abs(drift) * 1e6:.0f} ppm {'fast' if drift > 0 else 'slow'}, by its stamps against "
    size += f"the sensor's time tags and by the stars ({by_stars})"
    return Finding("clock drift", size, ("a sensor's clock that drifts, beside a mount that moves as much",), _SYNC)


def _mount_moves(one: Named, setting: Setting) -> Finding:
    turned_arcsec = math.hypot(*one.coefficients[:2])
    return _by_the_tags(one, setting, turned_arcsec, 3600.0, _three(one, "arcsec/h")) or Finding(
        "mount moves", f"by {_three(one, 'arcsec/h')}", _equals(one, _OPTICS), _SETTLE,
    )  # fmt: skip


def _clock_step(one: Named, setting: Setting) -> Finding:
    """Time that steps under the stars: of the host's clock, or of frames that come later from then on.

    A step of UTC shows against the host's monotonic clock, a delay against the sensor's tags; without either it is
    the mount, or the sensor's own marks.
    """
    step_s, when = one.coefficients.item(), _when(one.hypothesis, setting)
    arcsec = step_s * EARTH_RATE_ARCSEC_PER_S
    slip = f"a slip of the mount about the pole by {arcsec:+.1f} arcsec"
    later = "later" if step_s > 0 else "earlier"
    if not setting.has_host:
        size = f"the sensor's time tags, by which this capture has its times, stepped by {step_s:+.3f} s at {when}"
        return Finding("sensor time tag", size, _equals(one, slip), "record with gse run: the host's clock then tells")
    if setting.late is None:
        delay = f"a link or a proxy by which frames come {abs(step_s):.3f} s {later} from then on"
        return Finding(
            "clock step",
            f"the host's clock stepped by {step_s:+.3f} s at {when}",
            _equals(one, delay, _STEP_OF_TAGS, slip),
            _SYNC,
        )
    _, delay_s = _delay(one, setting)
    if abs(delay_s - step_s) <= max(_SAME_DELAY_S, _SIGMAS * one.errors.item()) < abs(delay_s):
        return _link_delay(one, setting, f"{step_s:+.3f} s")
    if drift := _by_the_tags(one, setting, abs(arcsec), setting.late.span_s, f"{arcsec:+.1f} arcsec about the pole"):
        return drift
    marks = f"a sensor whose exposures are {abs(step_s):.3f} s {later} than its time tags from then on"
    size = f"at {when} by {arcsec:+.1f} arcsec about the pole"
    return Finding("slip of the mount", size, _equals(one, marks), _LEAVE_OUT)


def _delay(one: Named, setting: Setting) -> tuple[int, float]:
    """From which instant on frames come later, and by how much, near the change that was found."""
    near_ns = setting.first_ns + round(one.hypothesis.at_s * NS_PER_S)
    return setting.late.step(near_ns) if setting.late else (near_ns, 0.0)


def _link_delay(one: Named, setting: Setting, by_stars: str) -> Finding:
    from_ns, delay_s = _delay(one, setting)
    arcsec = delay_s * EARTH_RATE_ARCSEC_PER_S
    size = f"frames come {abs(delay_s):.3f} s {'later' if delay_s > 0 else 'earlier'} from {to_text(from_ns, 0)} on, "
    size += f"by the host's stamps against the sensor's time tags and by the stars ({by_stars})"
    equals = (
        "a host whose clocks were all set by as much",
        f"a slip of the mount about the pole by {arcsec:+.1f} arcsec",
    )
    return Finding(
        "link delay", size, equals, "look what lies between sensor and host (proxy, adapter); then repeat the session"
    )


def _slip(one: Named, setting: Setting) -> Finding:
    delay_s = abs(_delay(one, setting)[1])
    turned_arcsec = math.hypot(*one.coefficients[:2])
    explains = turned_arcsec < _DOUBTFUL * EARTH_RATE_ARCSEC_PER_S * delay_s
    if delay_s > _SAME_DELAY_S and explains and any(rival.cause == "clock step" for rival in one.equals):
        return _link_delay(one, setting, _three(one))
    if setting.late and (drift := _by_the_tags(one, setting, turned_arcsec, setting.late.span_s, _three(one))):
        return drift
    return Finding("slip of the mount", f"at {_when(one.hypothesis, setting)} by {_three(one)}", _equals(one),
                   _LEAVE_OUT)  # fmt: skip


def _thermal(one: Named, setting: Setting) -> Finding:
    amplitude = math.sqrt(float((one.coefficients[:4] ** 2).sum()))
    where = {"columns": "along columns", "rows": "along rows"}.get(one.hypothesis.kind, "across the boresight")
    size = f"the boresight swings by +-{amplitude:.1f} arcsec {where} with a period of {_period(one.hypothesis.at_s)}"
    equals = ["a mount that swings"]
    if one.hypothesis.at_s * setting.frame_hz < _MOST_BEAT_FRAMES:
        equals.append(f"a vibration near a multiple of {setting.frame_hz:.3g} Hz, the frame rate, with which it beats")
    return Finding(
        "thermal sinusoid", size, _equals(one, *equals),
        "look for what heats and cools in that time (heater, fan, air conditioning); let it settle",
    )  # fmt: skip


def _vibration(found: Vibration) -> Finding:
    size = f"the boresight shakes by {found.excess_arcsec:.1f} arcsec (rms) more than the {found.predicted_arcsec:.1f} "
    size += "arcsec that its stars explain"
    if math.isfinite(found.frequency_hz):
        size += f", at {found.frequency_hz:.3g} Hz (or that plus or minus a multiple of {found.frame_hz:.3g} Hz)"
    return Finding("vibration", size, ("seeing or exposures that smear",),
                   "stop what shakes (fan, wind, steps on the roof) and repeat the session")  # fmt: skip


def _when(one: FineHypothesis, setting: Setting) -> str:
    return to_text(setting.first_ns + round(one.at_s * NS_PER_S), 0)


def _period(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 600 else f"{seconds / 60:.0f} min"


def _digits(error: float) -> int:
    return min(max(1 - math.floor(math.log10(max(error, 1e-6))), 0), 4)


_WORDS: dict[str, Callable[[Named, Setting], Finding]] = {
    "clock offset": _clock_offset,
    "mount": _mount,
    "site": _site,
    "focal length": _focal_length,
    "distortion": _distortion,
    "principal point": _principal_point,
    "pixel pitch": _pixel_pitch,
    "pixel origin": _pixel_origin,
    "refraction": _refraction,
    "clock drift": _clock_drift,
    "mount moves": _mount_moves,
    "clock step": _clock_step,
    "slip of the mount": _slip,
    "thermal sinusoid": _thermal,
}
