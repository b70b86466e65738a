"""What cannot be in a station file, and what is doubtful: field of view, mount, baud rate, and the night to come."""

import math
from collections.abc import Iterator
from dataclasses import replace

from drivers.ports import is_mock
from drivers.uart import USUAL_BAUDS
from gse import instant
from gse.catalog.mission import stars_for_field
from gse.catalog.readers import load_catalog
from gse.config.station import Station
from gse.constants import ARCSEC_PER_RAD
from gse.errors import GseError
from gse.inspection.check import Check, Outcome
from gse.inspection.planned_session import RATE_HZ, planned_session
from gse.inspection.tonight import SUNSET_DEG, Tonight, tonight
from gse.instant import NS_PER_S
from gse.mount import Mount
from gse.truth.solar_system import sun_altitude_deg

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
    yield _mount(station.mount)
    yield _baud(station)
    is_made = is_mock(station.port.url)
    night = _night_of(station, begins_ns)
    for item in _night(station, night, hours) if night is not None else ():
        yield replace(item, outcome=Outcome.OK, advice="") if is_made else item
    fewest = station.identifier.min_fit + 1
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
        return Check("field", Outcome.FAIL, f"{text}: no lens has that", advice)
    if diagonal_deg > WIDE_DEG or diagonal_deg < NARROWEST_DEG:
        return Check("field", Outcome.WARN, f"{text}: few star sensors are so", advice)
    return Check("field", Outcome.OK, text)


def _mount(mount: Mount) -> Check:
    if mount.inertial is not None:
        return Check("mount", Outcome.OK, "fixed to the stars: before a star simulator or a screen")
    if not _is_stated(mount):
        return Check("mount", Outcome.OK, "its angles are fitted to the session; none are stated")
    text = f"azimuth {mount.azimuth_deg:g}, altitude {mount.altitude_deg:g}, roll {mount.roll_deg:g} deg"
    if mount.altitude_deg <= 0:
        advice = "mount.altitude_deg counts from the horizon up: a zenith distance of 30 is an altitude of 60"
        return Check("mount", Outcome.FAIL, f"{text}: the boresight is below the horizon", advice)
    if mount.altitude_deg < LOW_DEG:
        return Check("mount", Outcome.WARN, f"{text}: very low", "refraction is uncertain so low: aim higher")
    return Check("mount", Outcome.OK, text)


def _is_stated(mount: Mount) -> bool:
    return mount.align is None or mount.stated


def _baud(station: Station) -> Check:
    baudrate, url = station.port.baudrate, station.port.url
    if is_mock(url) or baudrate in UART_RATES:
        return Check("baud rate", Outcome.OK, f"{baudrate}")
    near = min(UART_RATES, key=lambda rate: abs(rate - baudrate))
    if abs(near - baudrate) < _MISTYPED * baudrate:
        return Check("baud rate", Outcome.FAIL, f"{baudrate} is not a rate of a UART", f"did you mean {near}?")
    meant = next((rate for rate in USUAL_BAUDS if _lack_a_digit(str(baudrate), str(rate))), near)
    advice = f"few adapters have it; did you mean {meant}?"
    return Check("baud rate", Outcome.WARN, f"{baudrate} is not a usual rate of a UART", advice)


def _lack_a_digit(one: str, other: str) -> bool:
    """Whether one of two numbers is the other without one of its digits."""
    short, long = sorted((one, other), key=len)
    return short in (long[:place] + long[place + 1 :] for place in range(len(long)))


def _night_of(station: Station, begins_ns: int) -> Tonight | None:
    """The night to come; None where the sensor does not look at the sky."""
    mount, camera = station.mount, station.sensor.camera()
    if mount.inertial is not None:
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
            yield _stars(found, station.identifier.min_fit + 1)


def _twilight(found: Tonight, sun_now_deg: float) -> Check:
    sun_is_up = sun_now_deg > SUNSET_DEG
    if found.sunset_ns is not None:
        sunset = f"sunset {_clock(found.sunset_ns)}"
    else:
        sunset = "the Sun does not set" if sun_is_up else "the Sun does not rise"
    if found.dark_from_ns is None or found.dark_until_ns is None:
        advice = "the Sun stays above -12 deg for 24 h: wait for another season, or accept twilight"
        return Check("night", Outcome.WARN, f"{sunset}; no dark sky in the next 24 h", advice)
    text = f"{sunset}; dark from {_clock(found.dark_from_ns)} to {_clock(found.dark_until_ns)}"
    return Check("night", Outcome.OK, text)


def _sun(found: Tonight, reach_deg: float, until_ns: int | None) -> Check:
    if not found.sun_nearest_deg < reach_deg + SUN_NEAR_DEG:
        return Check("Sun", Outcome.OK, "it does not come near the field in the next 24 h")
    text = f"{found.sun_nearest_deg:.0f} deg from the boresight at {_clock(found.sun_nearest_ns)}"
    if found.sun_nearest_deg < reach_deg + MOON_NEAR_DEG:
        is_soon = until_ns is not None and found.sun_nearest_ns <= until_ns
        advice = "cover the lens until sunset, or aim elsewhere: the Sun in the field destroys a detector"
        return Check("Sun", Outcome.FAIL if is_soon else Outcome.WARN, f"it comes into the field: {text}", advice)
    return Check("Sun", Outcome.WARN, f"it comes near the field: {text}", "cover the lens by day")


def _moon(found: Tonight, reach_deg: float) -> Check:
    lit = f"{100 * found.moon_lit:.0f} % lit"
    if not found.moon_up_share > 0:
        return Check("Moon", Outcome.OK, f"{lit}, not up in the dark")
    up = f"{lit}, up for {100 * found.moon_up_share:.0f} % of the dark"
    text = f"{up}, {found.moon_nearest_deg:.0f} deg from the boresight at {_clock(found.moon_nearest_ns)}"
    if found.moon_nearest_deg < reach_deg + MOON_NEAR_DEG:
        advice = "it hides stars in or near the field: choose another night or direction"
        return Check("Moon", Outcome.WARN, text, advice)
    return Check("Moon", Outcome.OK, text)


def _stars(found: Tonight, fewest: int) -> Check:
    counts = [item.stars for item in found.stars]
    least = min(found.stars, key=lambda item: item.stars)
    text = f"{min(counts)} to {max(counts)} expected in the field, fewest at {_clock(least.utc_ns)}"
    poor = [item for item in found.stars if item.stars < fewest]
    if not poor:
        return Check("stars", Outcome.OK, text)
    when = f"from {_clock(poor[0].utc_ns)}" if len(poor) < len(counts) else "all night"
    advice = f"the identifier needs {fewest}: choose another time or direction, or a wider field"
    return Check("stars", Outcome.WARN, f"{text}; fewer than {fewest} {when}", advice)


def _plan(station: Station) -> Check:
    try:
        plan = planned_session(station)
    except GseError as error:
        return Check("length", Outcome.WARN, str(error), "see the limits in the station file")
    minutes = plan.minutes(plan.frames)
    if minutes is None:
        rows = " and ".join(row.name for row in plan.rows if row.frames is None)
        advice = f"{rows} cannot keep the limit: widen it, or state smaller uncertainties"
        return Check("length", Outcome.WARN, "no length of session gives a PASS", advice)
    text = f"{plan.frames} frames, {minutes:.1f} min at {RATE_HZ:g} Hz, for a PASS with 90 % probability"
    return Check("length", Outcome.OK, text)


def _clock(utc_ns: int) -> str:
    """Date and minute of an instant."""
    return f"{instant.to_text(utc_ns, 0)[:16]}Z"
