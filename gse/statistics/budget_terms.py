"""What site, air, Earth orientation, mount and times of frames leave open in the truth, each by its own slope."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.station.results import attitude_error
from gse.statistics.clock_health import CLOCK_REMEDY
from gse.statistics.uncertainty import TO_STANDARD, Distribution, Term
from gse.truth import Alignment, EarthOrientation, SiderealTruth, horizon_to_sensor
from gse.values.attitude import Attitude
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD, EARTH_RADIUS_M, EARTH_RATE_ARCSEC_PER_S
from gse.values.matrices import eigh, length, product
from gse.values.mount import InertialDirection, InertialUncertainty, Mount
from gse.values.screen import Screen, ShownSky
from gse.values.site import Site, SiteUncertainty
from protocols.description import TimeDescription

# The truth of one instant, and by how much a reported error changes when an input of it is another.
#
# Sensitivities of the truth uncertainty budget are finite differences of these.

Vector = tuple[float, float, float]
"""dRA*, dDE and roll in arcsec."""


LARGEST_STEP_ARCSEC = 60.0
"""Largest step of a finite difference; the sky is flat enough within it."""


class ChangedTruth:
    """The truth of a site and mount at an instant, and what changed inputs make of it."""

    def __init__(self, site: Site, mount: Mount, orientation: EarthOrientation, utc_ns: int) -> None:
        self._site, self._mount, self._utc_ns, self._orientation = site, mount, utc_ns, orientation
        self._truth = SiderealTruth(site, orientation)
        self._attitude = self._truth.attitude_true(utc_ns, mount)
        self._zenith_rad = math.radians(90 - mount.altitude_deg)
        self.de_rad = math.radians(self._attitude.de_deg)
        self.refraction_arcsec = self._bend_arcsec(self._truth)

    def _bend_arcsec(self, truth: SiderealTruth) -> float:
        return truth.refraction.bend_rad(self._zenith_rad) * ARCSEC_PER_RAD

    def changed(
        self, *, site: Site | None = None, mount: Mount | None = None, orientation: EarthOrientation | None = None
    ) -> Vector:
        """By how much the reported error changes with another site, mount or Earth orientation.

        Other air moves the measured stars along the vertical; all else moves the truth.
        """
        truth = SiderealTruth(site or self._site, orientation or self._orientation)
        lower_deg = (self._bend_arcsec(truth) - self.refraction_arcsec) / 3600
        seen = replace(self._mount, altitude_deg=self._mount.altitude_deg - lower_deg)
        measured = self._truth.attitude_true(self._utc_ns, seen)
        return _error(measured, truth.attitude_true(self._utc_ns, mount or self._mount))

    def tilted(self, azimuth_deg: float, arcsec: float) -> Vector:
        """By how much the error changes where mount or vertical is tilted about a level direction."""
        azimuth = math.radians(azimuth_deg)
        about = np.array([math.sin(azimuth), math.cos(azimuth), 0.0])
        turn = erfa.rv2m(-about * arcsec * ARCSEC_RAD)  # ERFA's turns the axes, not what they see
        rotation = product(horizon_to_sensor(self._mount), turn, self._truth.icrs_to_horizon(self._utc_ns))
        return _error(self._attitude, Attitude(rotation, np.zeros((3, 3))))

    def turned(self, rotation_arcsec: NDArray[np.float64]) -> Vector:
        """By how much the error changes where the mount is turned by a small rotation vector in the sensor frame."""
        turn = erfa.rv2m(-rotation_arcsec * ARCSEC_RAD)
        return _error(self._attitude, Attitude(product(turn, self._attitude.icrs_to_sensor), np.zeros((3, 3))))

    def without(self, correction: str) -> float:
        """The size of a correction of the frame, in arcsec, found by leaving it out."""
        bare = SiderealTruth(self._site, self._orientation, {correction})
        return math.hypot(*_error(bare.attitude_true(self._utc_ns, self._mount), self._attitude)[:2])

    def star_without(self, correction: str) -> float:
        """The size of a correction of the stars, in arcsec, at the boresight."""
        star = self._attitude.boresight_icrs[None]
        bare = SiderealTruth(self._site, self._orientation, {correction}).apparent(star, self._utc_ns)
        return length(bare - self._truth.apparent(star, self._utc_ns)) * ARCSEC_PER_RAD

    def about_the_pole(self, seconds: float) -> Vector:
        """By how much the error changes with time: the sky turns about the pole."""
        turn = EARTH_RATE_ARCSEC_PER_S * seconds
        cos_de, sin_de = max(math.cos(self.de_rad), 0.0), abs(math.sin(self.de_rad))
        return (turn * cos_de if cos_de else 0.0), 0.0, (turn * sin_de if sin_de else 0.0)


def _error(measured: Attitude, true: Attitude) -> Vector:
    error = attitude_error(measured, true)
    return error.d_ra_cosde_arcsec, error.d_de_arcsec, error.d_roll_arcsec


def together(vectors: list[Vector]) -> Vector:
    """Independent contributions on each axis."""
    ra, de, roll = (math.hypot(*(vector[axis] for vector in vectors)) for axis in range(3))
    return ra, de, roll


def scaled(change: Callable[[float], Vector], standard: float, largest_step: float) -> Vector:
    """The contribution of a standard uncertainty: the finite difference of a step that is not larger than that."""
    step = min(standard, largest_step)
    if step == 0:
        return 0.0, 0.0, 0.0
    ra, de, roll = (abs(value) * standard / step for value in change(step))
    return ra, de, roll


def absolute(vector: Vector) -> Vector:
    """Without signs."""
    return abs(vector[0]), abs(vector[1]), abs(vector[2])


# What the mount and the times of frames leave open in the truth.
#
# docs/uncertainty.md has the reason of each number.

_TIME_STAMP_S = 0.001
"""An operating system wakes a reader within this much (Linux, an idle machine)."""
_BITS_PER_BYTE = 10
_BLOCK_S = 20.0
"""The fit's scatter is that of means over this much."""


def _whose(key: str, known: object, name: str, unit: str) -> str:
    """Whose value an uncertainty is: the station file's, by its key, or the default, in its unit."""
    stated, default = getattr(known, name), getattr(type(known)(), name)
    if getattr(known, "fitted", False):
        return f"A: the fit of an earlier session by gse align, {key}: {stated:g}"
    if stated != default:
        return f"B: the station file, {key}: {stated:g}"
    return f"B: the default, {default:g} {unit} (95 %)"


_OF_AIR = {"pressure": "pressure_hpa", "temperature": "temperature_c", "humidity": "relative_humidity"}


def _whose_air(site: Site, name: str) -> str:
    """The same of one quantity of the air, whose default depends on whether it was entered."""
    key = _OF_AIR[name]
    stated = getattr(site.uncertainty, key)
    in_force = {"pressure": site.pressure_uncertainty_hpa, "temperature": site.temperature_uncertainty_c}
    if stated == getattr(SiteUncertainty(), key):
        return f"known to the default, {in_force.get(name, stated):g} (95 %)"
    return f"known as in the station file, site.uncertainty.{key}: {stated:g}"


def stated_mount(mount: Mount, at: ChangedTruth) -> list[Term]:
    """The altitude's uncertainty is that of the level, so that it holds across the boresight's azimuth too."""

    def changed(angle: str, by: float) -> Vector:
        return at.changed(mount=replace(mount, **{f"{angle}_deg": getattr(mount, f"{angle}_deg") + by / 3600}))

    terms = []
    for angle in ("azimuth", "altitude", "roll"):
        standard = getattr(mount.uncertainty, f"{angle}_arcsec") * TO_STANDARD
        vectors = [scaled(partial(changed, angle), standard, LARGEST_STEP_ARCSEC)]
        if angle == "altitude":
            vectors.append(scaled(partial(at.tilted, mount.azimuth_deg), standard, LARGEST_STEP_ARCSEC))
        terms.append(
            Term(
                f"mount {angle}",
                standard,
                "arcsec",
                *together(vectors),
                evidence=_whose(f"mount.uncertainty.{angle}_arcsec", mount.uncertainty, f"{angle}_arcsec", "arcsec"),
                explanation="the level of the mount, along and across" if angle == "altitude" else "as surveyed",
                remedy=f"survey it better and state mount.uncertainty.{angle}_arcsec, or fit the mount",
                corrected=False,
            )
        )
    return terms


def fitted_mount(alignment: Alignment, at: ChangedTruth) -> Term:
    """Each principal direction of the fit's covariance is an error of its own."""
    covariance = np.array(alignment.covariance_arcsec2)
    known = bool(np.isfinite(covariance).all())
    vectors: list[Vector] = [(math.inf, math.inf, math.inf)]
    if known:
        values, directions = eigh(covariance)
        turns = np.sqrt(np.maximum(values, 0.0))[:, None] * directions.T
        vectors = [at.turned(turn) for turn in turns]
    blocks = int((alignment.until_ns - alignment.from_ns) / 1e9 / _BLOCK_S) + 1
    x, y, _ = alignment.sigma_arcsec
    return Term(
        "fitted mount",
        math.hypot(x, y),
        "arcsec",
        *together(vectors),
        evidence=f"A: scatter of means over 20 s of {alignment.n} frames",
        explanation="the mount was fitted on this sky: absolute pointing, site and clock are not tested",
        remedy="fit the mount on more frames",
        distribution=Distribution.STUDENT,
        degrees_of_freedom=float(max((blocks if blocks >= 8 else alignment.n) - 1, 1)),
    )


OWN_FRAME = "frame of the answers"


def answers_frame(uncertainty_arcsec: float) -> Term:
    """How well the frame of the sensor's own answers is known on the sensor; it is of no panorama."""
    standard = uncertainty_arcsec / 2
    return Term(
        OWN_FRAME,
        standard,
        "arcsec",
        standard,
        standard,
        standard,
        evidence="B: the maker's alignment sheet, sensor.attitude.rotation.uncertainty_arcsec",
        explanation="the answers are of another body, which sits on the sensor as stated",
        remedy="measure how that body sits on the sensor more closely",
        distribution=Distribution.NORMAL,
        corrected=False,
    )


def clock(error_s: float, at: ChangedTruth) -> Term:
    """A constant error is absorbed by a fitted mount, but nothing says that it is constant: the term stays whole."""
    standard = error_s / math.sqrt(3)
    ra, de, roll = at.about_the_pole(standard)
    return Term(
        "clock",
        standard,
        "s",
        ra,
        de,
        roll,
        evidence="B: the bound of the kernel's clock discipline, or as stated by --clock-error",
        explanation="the sky turns by 15 arcsec in a second",
        remedy=CLOCK_REMEDY,
        distribution=Distribution.RECTANGULAR,
        corrected=False,
    )


UNKNOWN_DELAY_S = 0.2
"""From the end of an exposure to the first byte: sensors read out and think for 20 to 200 ms."""


def time_terms(
    time: TimeDescription, baudrate: int, poll_period_s: float, passing_s: float, at: ChangedTruth
) -> list[Term]:
    """When the exposure was: by the sensor's own absolute clock, or by the bytes that came after it."""
    if time.is_absolute:
        return [_sensor_clock(time.uncertainty_ms / 1000 * TO_STANDARD, time.scale, at)]
    terms = [_time_stamp(baudrate, at)]
    if passing_s:
        terms.append(_passing(passing_s, at))
    delay = time.delay_ms
    if delay is None or delay.most is not None:
        most_s = UNKNOWN_DELAY_S if delay is None or delay.most is None else delay.most / 1000
        evidence = f"B: not stated: 0 to {1000 * most_s:.0f} ms; truth is not moved"
        terms.append(_delay(most_s / math.sqrt(3), evidence, Distribution.RECTANGULAR, at))
    elif delay.uncertainty:
        evidence = f"B: {delay.value:g} ms as stated in sensor.time.delay_ms, with its uncertainty (95 %)"
        terms.append(_delay(delay.uncertainty / 1000 * TO_STANDARD, evidence, Distribution.NORMAL, at))
    if poll_period_s:
        evidence = f"B: the exposure may be older than its request by the poll's period, {poll_period_s:g} s"
        terms.append(_delay(poll_period_s / math.sqrt(3), evidence, Distribution.RECTANGULAR, at, name="poll"))
    return terms


def _sensor_clock(standard: float, scale: str, at: ChangedTruth) -> Term:
    return Term(
        "sensor clock",
        standard,
        "s",
        *at.about_the_pole(standard),
        evidence=f"B: the sensor's own clock ({scale}), as sensor.time.uncertainty_ms or the protocol states it",
        explanation="truth is taken at the instant that the sensor states; the host's clock is only a witness",
        remedy="discipline the sensor's clock better, and state sensor.time.uncertainty_ms",
        corrected=False,
    )


def _delay(standard: float, evidence: str, kind: Distribution, at: ChangedTruth, *, name: str = "sensor delay") -> Term:
    return Term(
        name,
        standard,
        "s",
        *at.about_the_pole(standard),
        evidence=evidence,
        explanation="a sensor reads out and thinks before its first byte; a constant delay looks like a turned mount",
        remedy="measure it (a pulse of light, the maker's figure): sensor.time.delay_ms: {value: 85, uncertainty: 10}",
        distribution=kind,
        corrected=False,
    )


def _passing(bound_s: float, at: ChangedTruth) -> Term:
    """How much later a byte may be read because those before it were being passed on."""
    standard = bound_s / math.sqrt(3)
    return Term(
        "passing on",
        standard,
        "s",
        *at.about_the_pole(standard),
        evidence=f"A: passing bytes on took up to {1000 * bound_s:g} ms in this session",
        explanation="while bytes are passed to the flight computer the next ones wait to be read",
        remedy="an idle machine; a tap on each wire (port.tx_url) passes nothing on",
        distribution=Distribution.RECTANGULAR,
    )


def _time_stamp(baudrate: int, at: ChangedTruth) -> Term:
    """How late the first byte of a frame may be read."""
    half_byte_s = _BITS_PER_BYTE / 2 / baudrate
    standard = (_TIME_STAMP_S + half_byte_s) / math.sqrt(3)
    return Term(
        "time stamp",
        standard,
        "s",
        *at.about_the_pole(standard),
        evidence=f"B: the first byte is read within 1 ms; half a byte at {baudrate} baud",
        explanation="mid-exposure is counted back from the first byte that is read",
        remedy="a faster baud rate; an idle machine",
        distribution=Distribution.RECTANGULAR,
    )


# What Earth orientation, site and air leave open in the truth.
#
# docs/uncertainty.md has the reason of each number.

_MODEL_ARCSEC = 0.0005
"""What a rigorous correction leaves: the celestial pole offsets (0.0005) and the cells of 300 s (0.0006)."""
AIR_MODEL = 0.005
"""Half-width, as a share of the refraction: stars from 0.5 to 0.7 um differ by 0.5 of 57 arcsec at 45 deg."""
_LEAST_COS_LATITUDE = 0.01
"""Within 64 km of a pole azimuth is counted from a meridian that is chosen, not found."""


_NEWER = "pip install -U astropy-iers-data, or --earth-orientation with {} of the IERS"


def model_terms(at: ChangedTruth) -> list[Term]:
    """Corrections that are rigorous, with their size in this direction."""
    frame = [(name, at.without(name)) for name in ("precession", "nutation")]
    stars = [(name, at.star_without(name)) for name in ("annual aberration", "diurnal aberration")]
    stars.append(("light deflection", at.star_without("light deflection")))
    return [
        Term(
            name,
            _MODEL_ARCSEC,
            "arcsec",
            _MODEL_ARCSEC,
            _MODEL_ARCSEC,
            _MODEL_ARCSEC,
            evidence="B: IAU 2006/2000A by ERFA; compared with astropy and skyfield",
            explanation="corrected rigorously: what is left is the model's own error",
            remedy="nothing needs to",
            size_arcsec=size,
        )
        for name, size in (*frame, *stars)
    ]


def earth_terms(orientation: EarthOrientation, utc_ns: int, at: ChangedTruth) -> list[Term]:
    """UT1, the pole, and leap seconds where they are not announced."""
    here = orientation.at(utc_ns)
    past = here.kind == "past the end"
    ut1_s = here.ut1_error_s / math.sqrt(3) if past else here.ut1_error_s
    pole = here.pole_error_arcsec / math.sqrt(3) if past else here.pole_error_arcsec
    x, y = orientation.x_pole_arcsec, orientation.y_pole_arcsec
    moved = [
        at.changed(orientation=replace(orientation, x_pole_arcsec=tuple(value + pole for value in x))),
        at.changed(orientation=replace(orientation, y_pole_arcsec=tuple(value + pole for value in y))),
    ]
    kind = Distribution.RECTANGULAR if past else Distribution.NORMAL
    terms = [
        Term(
            "UT1",
            ut1_s,
            "s",
            *at.about_the_pole(ut1_s),
            evidence=f"B: {orientation.source}: {here.kind}",
            explanation="how far the Earth has turned; past the end of the predictions it goes wrong by 1 ms a day",
            remedy=_NEWER.format("newer files"),
            distribution=kind,
            size_arcsec=at.without("UT1"),
        ),
        Term(
            "polar motion",
            pole,
            "arcsec",
            *together(moved),
            evidence=f"B: {orientation.source}: {here.kind}",
            explanation="where the Earth's axis goes through its crust; held past the end of the predictions",
            remedy=_NEWER.format("newer files"),
            distribution=kind,
            size_arcsec=at.without("polar motion"),
        ),
    ]
    if here.leap_error_s:
        leap_s = here.leap_error_s / math.sqrt(3)
        terms.append(
            Term(
                "leap seconds",
                leap_s,
                "s",
                *at.about_the_pole(leap_s),
                evidence="B: the session is later than the list of leap seconds announces",
                explanation="UTC may have been given a leap second that is not in the list",
                remedy=_NEWER.format("a newer Leap_Second.dat"),
                distribution=Distribution.RECTANGULAR,
            )
        )
    return terms


def site_terms(site: Site, at: ChangedTruth) -> list[Term]:
    """Coordinates, height and vertical."""
    position_m, height_m = site.uncertainty.position_m * TO_STANDARD, site.uncertainty.height_m * TO_STANDARD
    step_m = LARGEST_STEP_ARCSEC * ARCSEC_RAD * EARTH_RADIUS_M
    cos_latitude = max(math.cos(math.radians(site.latitude_deg)), _LEAST_COS_LATITUDE)

    def moved(north: float, east: float) -> Callable[[float], Vector]:
        def change(by_m: float) -> Vector:
            angle_deg = math.degrees(by_m / EARTH_RADIUS_M)
            latitude = site.latitude_deg + north * angle_deg
            longitude = site.longitude_deg + east * angle_deg / cos_latitude
            return at.changed(site=replace(site, latitude_deg=latitude, longitude_deg=longitude))

        return change

    position = [scaled(moved(1, 0), position_m, step_m), scaled(moved(0, 1), position_m, step_m)]
    raised = scaled(lambda by_m: at.changed(site=replace(site, height_m=site.height_m + by_m)), height_m, 100.0)
    vertical = site.uncertainty.vertical_arcsec * TO_STANDARD
    tilts = [scaled(partial(at.tilted, about_deg), vertical, LARGEST_STEP_ARCSEC) for about_deg in (0.0, 90.0)]
    return [
        Term(
            "site position",
            position_m,
            "m",
            *together(position),
            evidence=_whose("site.uncertainty.position_m", site.uncertainty, "position_m", "m, a GPS receiver's"),
            explanation="31 m of the ground are 1 arcsec of the sky",
            remedy="survey the site, and state site.uncertainty.position_m",
            size_arcsec=at.without("geodetic latitude"),
        ),
        Term(
            "site height",
            height_m,
            "m",
            *raised,
            evidence=_whose("site.uncertainty.height_m", site.uncertainty, "height_m", "m"),
            explanation="only by the pressure that follows from it, where none is entered",
            remedy="enter the pressure at the mount",
        ),
        Term(
            "deflection of the vertical",
            vertical,
            "arcsec",
            *together(tilts),
            evidence=_whose(
                "site.uncertainty.vertical_arcsec",
                site.uncertainty,
                "vertical_arcsec",
                "arcsec, more than in EGM2008 but in high mountains",
            ),
            explanation="a level stands on the plumb line, not on the ellipsoid",
            remedy="fit the mount (mount: {align: first 60 s}), or correct by a geoid model and state vertical_arcsec",
            corrected=False,
        ),
    ]


def air_terms(site: Site, mount: Mount, at: ChangedTruth) -> list[Term]:
    """Refraction: what its air and its formula leave; nothing where there is no air."""
    pressure, temperature = site.pressure_uncertainty_hpa * TO_STANDARD, site.temperature_uncertainty_c * TO_STANDARD
    humidity = site.uncertainty.relative_humidity * TO_STANDARD
    entered_p = "as entered" if site.pressure_hpa is not None else "not entered: the standard atmosphere's"
    entered_t = "as entered" if site.temperature_c is not None else "not entered: the standard atmosphere's"
    air = {
        "pressure": (pressure, "hPa", replace(site, pressure_hpa=site.air_pressure_hpa + pressure), entered_p),
        "temperature": (temperature, "K", replace(site, temperature_c=site.air_temperature_c + temperature), entered_t),
        "humidity": (humidity, "", replace(site, relative_humidity=_other_humidity(site, humidity)), "as entered"),
    }
    if site.air_pressure_hpa == 0:
        return []
    terms = [
        Term(
            f"refraction: {name}",
            standard,
            unit,
            *absolute(at.changed(site=changed)),
            evidence=f"B: {how}; {_whose_air(site, name)}",
            explanation=f"the air bends light by {at.refraction_arcsec:.1f} arcsec at this altitude",
            remedy=f"measure the {name} at the mount and state its uncertainty",
        )
        for name, (standard, unit, changed, how) in air.items()
    ]
    left = AIR_MODEL / math.sqrt(3) * at.refraction_arcsec
    lowered = at.changed(mount=replace(mount, altitude_deg=mount.altitude_deg - left / 3600))
    shift = absolute(lowered) if left else (0.0, 0.0, 0.0)
    terms.append(
        Term(
            "refraction: model",
            AIR_MODEL / math.sqrt(3),
            "of it",
            *shift,
            evidence="B: ERFA's A tan z + B tan^3 z at 0.6 um; stars of 0.5 to 0.7 um",
            explanation="refraction depends on the colour of the stars",
            remedy="look closer to the zenith",
            distribution=Distribution.RECTANGULAR,
            size_arcsec=at.refraction_arcsec,
        )
    )
    return terms


def _other_humidity(site: Site, by: float) -> float:
    return site.relative_humidity + (by if site.relative_humidity + by <= 1 else -by)


def inertial_terms(shown: InertialDirection, clock_error_s: float) -> Iterator[Term]:
    """The stated direction, and the time where it moves."""
    yield from _standing("shown", "mount.inertial.uncertainty", shown.uncertainty)
    if any(shown.rates_arcsec_per_s):
        yield _time(shown, clock_error_s)


def _standing(what: str, key: str, known: InertialUncertainty) -> Iterator[Term]:
    """How well it is known where star simulator or screen and sensor stand to each other."""
    across, roll = TO_STANDARD * known.across_arcsec, TO_STANDARD * known.roll_arcsec
    for name, of, standard, vector in (
        (f"{what} direction", "across_arcsec", across, (across, across, 0.0)),
        (f"{what} roll", "roll_arcsec", roll, (0.0, 0.0, roll)),
    ):
        yield Term(
            name,
            standard,
            "arcsec",
            *vector,
            evidence=_whose(f"{key}.{of}", known, of, "arcsec"),
            explanation="where star simulator and sensor stand to each other",
            remedy=f"measure it better and state {key}",
            corrected=False,
        )


_SPOT_PX = 0.005
"""Standard uncertainty of a spot's centre on the panel: 256 levels, measured in a browser (docs/screen.md)."""


_STARS = 10
"""Of an answer, at least, for the effect of the scale."""


def screen_terms(screen: Screen, sky: ShownSky) -> Iterator[Term]:
    """How screen and sensor stand to each other, the grid of the panel, and the time of a scene that turns."""
    yield from _standing("screen", "screen.to_sensor.uncertainty", screen.to_sensor.uncertainty)
    grid = _SPOT_PX * ARCSEC_PER_RAD / screen.camera().focal_length_px
    yield Term(
        "pixel grid",
        grid,
        "arcsec",
        grid,
        grid,
        0.0,
        evidence=f"B: {_SPOT_PX} px of the panel",
        explanation="a spot stands between pixels by their brightness",
        remedy="use a panel with smaller pixels, or a longer lens",
        corrected=False,
    )
    away_mm = screen.focal_length_mm or screen.distance_mm or math.nan
    scale = TO_STANDARD * screen.uncertainty.away_mm / away_mm
    if scale:
        # Stars about one side of the field take the attitude along by a share of how far they stand out.
        half_width = math.atan2(screen.columns / 2, screen.camera().focal_length_px) * ARCSEC_PER_RAD
        moved = scale * half_width / math.sqrt(3 * _STARS)
        yield Term(
            "screen scale",
            scale,
            "",
            moved,
            moved,
            0.0,
            evidence="the fit of gse align: screen.uncertainty.away_mm",
            explanation="a picture of another size moves the mean of the stars of a field",
            remedy="fit the screen on a longer session",
            corrected=False,
        )
    if any(item.rate_deg_per_s for item in sky.shown):
        worst = max(sky.shown, key=lambda item: item.rate_deg_per_s * item.within_ms)
        standard_s = TO_STANDARD * worst.within_ms / 1000
        turned = worst.rate_deg_per_s * 3600 * standard_s
        yield Term(
            "screen time",
            standard_s,
            "s",
            turned,
            turned,
            turned,
            evidence="measured here: the page's clock, half a picture; and screen.latency_uncertainty_ms",
            explanation="a scene that turns is somewhere else when it is drawn later",
            remedy="measure the panel's latency and state screen.latency_ms with its uncertainty",
            corrected=False,
        )


def _time(shown: InertialDirection, clock_error_s: float) -> Term:
    """A scene that moves is somewhere else where the clock is off."""
    standard = clock_error_s / math.sqrt(3)
    ra, de, roll = (abs(rate) * standard if rate else 0.0 for rate in shown.rates_arcsec_per_s)
    ra *= math.cos(math.radians(shown.de_deg)) if ra else 1.0
    return Term(
        "clock",
        standard,
        "s",
        ra,
        de,
        roll,
        evidence="B: the bound of the kernel's clock discipline, or as stated by --clock-error",
        explanation="the shown scene moves at the stated rate",
        remedy="synchronise the clock with that of the scene, or state its error: --clock-error 0.1s",
        distribution=Distribution.RECTANGULAR,
        corrected=False,
    )
