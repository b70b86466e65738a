"""What cannot be in a station file, and what is doubtful: field of view, mount, baud rate, and the night to come."""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from drivers.clock import read_clock
from drivers.ports import is_mock
from drivers.uart import USUAL_BAUDS
from gse.catalog import StarCatalog
from gse.catalog.mission import stars_for_field
from gse.catalog.readers import load_catalog
from gse.config.station import Station
from gse.errors import GseError
from gse.station.frame_processor import CENTROID_SIGMA_PX
from gse.station.sky_condition import SUN_LIMIT_DEG, stars_in_field
from gse.statistics.decision import COVERAGE_FACTOR
from gse.statistics.truth_budget import SessionFacts, truth_budget
from gse.truth import EarthOrientation
from gse.truth.frames import horizon_to_sensor
from gse.truth.solar_system import icrs_to_horizon, sun_altitude_deg, sun_and_moon_horizon
from gse.values import instant
from gse.values.axis import D_ROLL, ON_SKY
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.values.matrices import product
from gse.values.mount import Mount
from gse.values.panorama import MAX_OBJECTS
from gse.values.site import Site
from gse.verdict.planning import Expected
from gse.verdict.requirements import AxisQuestion, ExpectedSession
from gse.verdict.session_plan import SessionPlan, session_plan

# A check before a session: what was looked at, what came out, what to do.


class CheckOutcome(StrEnum):
    """Result of a check."""

    OK = "OK"
    WARN = "WARN"
    FAIL = "FAIL"


@dataclass(frozen=True, slots=True)
class Check:
    """One check: its subject, its result, and advice."""

    name: str
    outcome: CheckOutcome
    text: str
    advice: str = ""


# The night to come over a station: twilight, Sun and Moon, and the stars that its field will hold.

STEP_NS = 300 * NS_PER_S
_DAY_STEPS = 288
SUNSET_DEG = -0.833
"""The Sun's upper limb on the horizon, lifted by refraction."""
_STARS_EVERY = 6
"""Half an hour: a field of 14 deg has moved by half of itself."""


@dataclass(frozen=True, slots=True)
class StarCount:
    """How many catalogue stars are in the field at an instant, at most as many as a panorama holds."""

    utc_ns: int
    stars: int


@dataclass(frozen=True, slots=True)
class Tonight:
    """The next 24 hours; instants are None where there is no such thing, angles NaN.

    ``dark_from_ns`` to ``dark_until_ns`` is the first stretch with the Sun below -12 deg. ``moon_up_share`` is the
    share of it with the Moon above the horizon, ``moon_lit`` the lit share of the Moon. The nearest Sun (above the
    horizon) and Moon (in the dark) to the boresight have their instants. ``stars`` are counted in the dark.
    """

    begins_ns: int
    sunset_ns: int | None
    dark_from_ns: int | None
    dark_until_ns: int | None
    moon_up_share: float
    moon_lit: float
    sun_nearest_deg: float
    sun_nearest_ns: int
    moon_nearest_deg: float
    moon_nearest_ns: int
    stars: tuple[StarCount, ...]


def tonight(site: Site, mount: Mount | None, camera: Camera, catalog: StarCatalog, begins_ns: int) -> Tonight:
    """From an instant on; without a ``mount`` nothing is said of the field."""
    utc_ns = begins_ns + STEP_NS * np.arange(_DAY_STEPS + 1)
    sun, moon = sun_and_moon_horizon(site, utc_ns)
    sun_deg, moon_deg = np.degrees(np.arcsin(sun[:, 2])), np.degrees(np.arcsin(moon[:, 2]))
    dark = _first_stretch(sun_deg < SUN_LIMIT_DEG)
    middle = (dark.start + dark.stop) // 2 if dark is not None else 0
    boresight = None if mount is None else horizon_to_sensor(mount)[2]
    sun_off = _separations_deg(sun, boresight, sun_deg > SUNSET_DEG)
    moon_off = _separations_deg(moon, boresight, (moon_deg > 0) & (sun_deg < SUN_LIMIT_DEG))
    set_at = np.flatnonzero((sun_deg[:-1] > SUNSET_DEG) & (sun_deg[1:] <= SUNSET_DEG))
    return Tonight(
        begins_ns=begins_ns,
        sunset_ns=int(utc_ns[set_at[0] + 1]) if len(set_at) else None,
        dark_from_ns=int(utc_ns[dark.start]) if dark is not None else None,
        dark_until_ns=int(utc_ns[dark.stop - 1]) if dark is not None else None,
        moon_up_share=float((moon_deg[dark] > 0).mean()) if dark is not None else math.nan,
        moon_lit=float(1 - product(sun[middle], moon[middle])) / 2,
        sun_nearest_deg=_least(sun_off),
        sun_nearest_ns=int(utc_ns[np.argmin(sun_off)]),
        moon_nearest_deg=_least(moon_off),
        moon_nearest_ns=int(utc_ns[np.argmin(moon_off)]),
        stars=() if mount is None or dark is None else _stars(site, mount, camera, catalog, utc_ns[dark]),
    )


def _stars(
    site: Site, mount: Mount, camera: Camera, catalog: StarCatalog, utc_ns: NDArray[np.int64]
) -> tuple[StarCount, ...]:
    shown = utc_ns[::_STARS_EVERY]
    rotations = product(horizon_to_sensor(mount), icrs_to_horizon(site, shown))
    counts = [min(stars_in_field(catalog, camera, rotation), MAX_OBJECTS) for rotation in rotations]
    return tuple(StarCount(at, count) for at, count in zip(shown.tolist(), counts, strict=True))


def _first_stretch(mask: NDArray[np.bool_]) -> slice | None:
    """The first run of true values (N,)."""
    rows = np.flatnonzero(mask)
    if not len(rows):
        return None
    ends = np.flatnonzero(np.diff(rows) > 1)
    return slice(int(rows[0]), int(rows[ends[0]] if len(ends) else rows[-1]) + 1)


def _separations_deg(
    bodies: NDArray[np.float64], boresight: NDArray[np.float64] | None, counts: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Of unit vectors (N, 3) from the boresight, infinite where they do not count."""
    if boresight is None:
        return np.full(len(bodies), np.inf)
    apart = np.degrees(np.arctan2(np.linalg.norm(np.cross(bodies, boresight), axis=1), product(bodies, boresight)))
    return np.where(counts, apart, np.inf)


def _least(separations_deg: NDArray[np.float64]) -> float:
    least = float(separations_deg.min())
    return least if math.isfinite(least) else math.nan


# What a session of a station must be to pass, before there is one.

RATE_HZ = 10.0
_STARS = 20
"""Stars that are named in an ordinary panorama."""


def planned_session(station: Station) -> SessionPlan:
    """The plan of a session now, of a sensor that performs as expected; availability half-way between limit and 1."""
    return _planned(_questions(station), station.limits, (1 + station.limits.availability) / 2)


@functools.lru_cache(maxsize=8)
def _planned(axes: tuple[AxisQuestion, ...], limits: Limits, availability: float) -> SessionPlan:
    """Cached: it takes some seconds of simulation."""
    return session_plan(ExpectedSession(axes, limits, availability, RATE_HZ))


def _questions(station: Station) -> tuple[AxisQuestion, ...]:
    """What is expected of each axis: whole-pixel positions of 20 stars, each for the time a star takes over a pixel."""
    camera, limits = station.sensor.camera(), station.limits
    pixel_arcsec = camera.pixel_rad * ARCSEC_PER_RAD
    noise = CENTROID_SIGMA_PX * pixel_arcsec / math.sqrt(_STARS)
    # The roll error acts at the stars' distance from the boresight: root mean square over the detector.
    reach_rad = math.hypot(camera.rows, camera.columns) / math.sqrt(12) / camera.focal_length_px
    tau_s, truth_arcsec = pixel_arcsec / EARTH_RATE_ARCSEC_PER_S, _truth_arcsec(station)
    on_sky, about = Expected(0.0, noise, tau_s, RATE_HZ), Expected(0.0, noise / reach_rad, tau_s, RATE_HZ)
    return (
        *(AxisQuestion(axis, on_sky, limits.of(axis), truth_arcsec) for axis in ON_SKY),
        AxisQuestion(D_ROLL, about, limits.of(D_ROLL), 0.0),
    )


def _truth_arcsec(station: Station) -> float:
    """The standard uncertainty of truth for a session now, with a perfect clock; the greater of both axes."""
    utc_ns = read_clock().utc_ns
    budget = truth_budget(SessionFacts(station.site, station.mount, EarthOrientation.from_disk(utc_ns), utc_ns, 0.0))
    return round(max(budget.axes[axis.key].one_sided_arcsec for axis in ON_SKY) / COVERAGE_FACTOR, 3)


WIDEST_DEG = 120.0
"""Across the diagonal: no lens that keeps straight lines straight has more; an all-sky camera is cut to less."""
WIDE_DEG = 90.0
NARROWEST_DEG = 1.0
LOW_DEG = 10.0
"""Below this altitude refraction is uncertain by more than an arcsecond."""
SUN_NEAR_DEG, MOON_NEAR_DEG = 20.0, 10.0
"""Beyond the edge of the field: nearer, stray light or worse reaches the detector."""

_RATES = """
    50 75 110 134 150 200 300 600 1200 1800 2400 4800 7200 9600 10400 14400 19200 28800 31250 38400 56000 57600 62500
    74880 76800 115200 125000 128000 153600 230400 250000 256000 307200 312500 460800 500000 576000 614400 625000 750000
    921600 1000000 1152000 1228800 1250000 1500000 1843200 2000000 2250000 2500000 3000000 3125000 3500000 3686400
    4000000 5000000 6000000 8000000
"""
UART_RATES = frozenset(map(int, _RATES.split()))
"""What UARTs and USB adapters have; others are a mistype, or a special crystal."""
_MISTYPED = 0.05


def plausibility(station: Station, begins_ns: int, hours: float | None = None) -> Iterator[Check]:
    """The checks of a station for a session that begins at an instant and lasts some hours, where that is known.

    A simulated or recorded session has no night to come: what would be a doubt is only said.
    """
    yield _field(station)
    if station.subject is None:
        yield _mount(station)
    yield _baud(station)
    is_made = is_mock(station.port.url)
    night = _night_of(station, begins_ns)
    for item in _night(station, night, hours) if night is not None else ():
        yield replace(item, outcome=CheckOutcome.OK, advice="") if is_made else item
    fewest = station.identifier.min_fit + 1
    if station.subject is not None:
        return
    if is_made or night is None or not night.stars or any(item.stars >= fewest for item in night.stars):
        yield _plan(station)


def _field(station: Station) -> Check:
    camera = station.sensor.camera()
    width, height = (
        2 * math.degrees(math.atan2(side / 2, camera.focal_length_px)) for side in (camera.columns, camera.rows)
    )
    diagonal_deg = math.degrees(camera.diagonal_rad)
    text = f"{width:.4g} x {height:.4g} deg, {camera.pixel_rad * ARCSEC_PER_RAD:.4g} arcsec per pixel"
    advice = (
        "sensor.focal_length_px is the focal length in pixels: focal length in mm / size of a pixel in mm, for example "
        "50 / 0.012 = 4167"
    )
    if diagonal_deg > WIDEST_DEG:
        return Check("field", CheckOutcome.FAIL, f"{text}: no lens has that", advice)
    if diagonal_deg > WIDE_DEG or diagonal_deg < NARROWEST_DEG:
        return Check("field", CheckOutcome.WARN, f"{text}: few star sensors are so", advice)
    return Check("field", CheckOutcome.OK, text)


def _mount(station: Station) -> Check:
    mount, screen = station.mount, station.screen
    if screen is not None and (gap := screen.gap_beside(station.sensor.camera())):
        words, _, advice = gap.partition(": ")
        return Check("mount", CheckOutcome.WARN, words, advice)
    if mount.inertial is not None:
        return Check("mount", CheckOutcome.OK, "fixed to the stars: before a star simulator or a screen")
    if not _is_stated(mount):
        return Check("mount", CheckOutcome.OK, "its angles are fitted to the session; none are stated")
    text = f"azimuth {mount.azimuth_deg:g}, altitude {mount.altitude_deg:g}, roll {mount.roll_deg:g} deg"
    if mount.altitude_deg <= 0:
        advice = "mount.altitude_deg counts from the horizon up: a zenith distance of 30 is an altitude of 60"
        return Check("mount", CheckOutcome.FAIL, f"{text}: the boresight is below the horizon", advice)
    if mount.altitude_deg < LOW_DEG:
        return Check("mount", CheckOutcome.WARN, f"{text}: very low", "refraction is uncertain so low: aim higher")
    return Check("mount", CheckOutcome.OK, text)


def _is_stated(mount: Mount) -> bool:
    return mount.align is None or mount.stated


def _baud(station: Station) -> Check:
    baudrate, url = station.port.baudrate, station.port.url
    if is_mock(url) or baudrate in UART_RATES:
        return Check("baud rate", CheckOutcome.OK, f"{baudrate}")
    near = min(UART_RATES, key=lambda rate: abs(rate - baudrate))
    if abs(near - baudrate) < _MISTYPED * baudrate:
        return Check("baud rate", CheckOutcome.FAIL, f"{baudrate} is not a rate of a UART", f"did you mean {near}?")
    meant = next((rate for rate in USUAL_BAUDS if _lack_a_digit(str(baudrate), str(rate))), near)
    advice = f"few adapters have it; did you mean {meant}?"
    return Check("baud rate", CheckOutcome.WARN, f"{baudrate} is not a usual rate of a UART", advice)


def _lack_a_digit(one: str, other: str) -> bool:
    """Whether one of two numbers is the other without one of its digits."""
    short, long = sorted((one, other), key=len)
    return short in (long[:place] + long[place + 1 :] for place in range(len(long)))


def _night_of(station: Station, begins_ns: int) -> Tonight | None:
    """The night to come; None where the sensor does not look at the sky."""
    mount, camera = station.mount, station.sensor.camera()
    if not station.is_under_sky:
        return None
    wanted = station.identifier.catalog_stars
    try:
        catalog = load_catalog(station.catalog, stars=stars_for_field(camera) if wanted == "auto" else wanted)
    except GseError:
        return None  # the check of the catalogue says so
    return tonight(station.site, mount if _is_above(mount) else None, camera, catalog, begins_ns)


def _is_above(mount: Mount) -> bool:
    return _is_stated(mount) and mount.altitude_deg > 0


def _night(station: Station, found: Tonight, hours: float | None) -> Iterator[Check]:
    """Twilight, Sun, Moon and stars."""
    begins_ns = found.begins_ns
    yield _twilight(found, sun_altitude_deg(station.site, begins_ns))
    if _is_above(station.mount):
        reach_deg = math.degrees(station.sensor.camera().diagonal_rad) / 2
        until_ns = None if hours is None else begins_ns + round(hours * 3600 * NS_PER_S)
        yield _sun(found, reach_deg, until_ns)
        yield _moon(found, reach_deg)
        if found.stars:
            yield _stars_tonight(found, station.identifier.min_fit + 1)


def _twilight(found: Tonight, sun_now_deg: float) -> Check:
    sun_is_up = sun_now_deg > SUNSET_DEG
    if found.sunset_ns is not None:
        sunset = f"sunset {_clock(found.sunset_ns)}"
    else:
        sunset = "the Sun does not set" if sun_is_up else "the Sun does not rise"
    if found.dark_from_ns is None or found.dark_until_ns is None:
        advice = "the Sun stays above -12 deg for 24 h: wait for another season, or accept twilight"
        return Check("night", CheckOutcome.WARN, f"{sunset}; no dark sky in the next 24 h", advice)
    text = f"{sunset}; dark from {_clock(found.dark_from_ns)} to {_clock(found.dark_until_ns)}"
    return Check("night", CheckOutcome.OK, text)


def _sun(found: Tonight, reach_deg: float, until_ns: int | None) -> Check:
    if not found.sun_nearest_deg < reach_deg + SUN_NEAR_DEG:
        return Check("Sun", CheckOutcome.OK, "it does not come near the field in the next 24 h")
    text = f"{found.sun_nearest_deg:.0f} deg from the boresight at {_clock(found.sun_nearest_ns)}"
    if found.sun_nearest_deg < reach_deg + MOON_NEAR_DEG:
        is_soon = until_ns is not None and found.sun_nearest_ns <= until_ns
        advice = "cover the lens until sunset, or aim elsewhere: the Sun in the field destroys a detector"
        return Check(
            "Sun", CheckOutcome.FAIL if is_soon else CheckOutcome.WARN, f"it comes into the field: {text}", advice
        )
    return Check("Sun", CheckOutcome.WARN, f"it comes near the field: {text}", "cover the lens by day")


def _moon(found: Tonight, reach_deg: float) -> Check:
    lit = f"{100 * found.moon_lit:.0f} % lit"
    if not found.moon_up_share > 0:
        return Check("Moon", CheckOutcome.OK, f"{lit}, not up in the dark")
    up = f"{lit}, up for {100 * found.moon_up_share:.0f} % of the dark"
    text = f"{up}, {found.moon_nearest_deg:.0f} deg from the boresight at {_clock(found.moon_nearest_ns)}"
    if found.moon_nearest_deg < reach_deg + MOON_NEAR_DEG:
        advice = "it hides stars in or near the field: choose another night or direction"
        return Check("Moon", CheckOutcome.WARN, text, advice)
    return Check("Moon", CheckOutcome.OK, text)


def _stars_tonight(found: Tonight, fewest: int) -> Check:
    counts = [item.stars for item in found.stars]
    least = min(found.stars, key=lambda item: item.stars)
    text = f"{min(counts)} to {max(counts)} expected in the field, fewest at {_clock(least.utc_ns)}"
    poor = [item for item in found.stars if item.stars < fewest]
    if not poor:
        return Check("stars", CheckOutcome.OK, text)
    when = f"from {_clock(poor[0].utc_ns)}" if len(poor) < len(counts) else "all night"
    advice = f"the identifier needs {fewest}: choose another time or direction, or a wider field"
    return Check("stars", CheckOutcome.WARN, f"{text}; fewer than {fewest} {when}", advice)


def _plan(station: Station) -> Check:
    try:
        plan = planned_session(station)
    except GseError as error:
        return Check("length", CheckOutcome.WARN, str(error), "see the limits in the station file")
    minutes = plan.minutes(plan.frames)
    if minutes is None:
        rows = " and ".join(row.name for row in plan.rows if row.frames is None)
        advice = f"{rows} cannot keep the limit: widen it, or state smaller uncertainties"
        return Check("length", CheckOutcome.WARN, "no length of session gives a PASS", advice)
    text = f"{plan.frames} frames, {minutes:.1f} min at {RATE_HZ:g} Hz, for a PASS with 90 % probability"
    return Check("length", CheckOutcome.OK, text)


def _clock(utc_ns: int) -> str:
    """Date and minute of an instant."""
    return f"{instant.to_text(utc_ns, 0)[:16]}Z"
