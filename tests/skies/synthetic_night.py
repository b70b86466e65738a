"""Nights made of numbers, for tests of views and report: a drifting sensor, noise, and some trouble."""

import functools
import math

import numpy as np
from skies.one_by_one import Made, Stars, add_frames

from drivers.chunk import LinkEvent
from drivers.clock import ClockReading
from gse.catalog import StarCatalog, load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.identifier import Identification
from gse.station.results import AnswerCheck, AttitudeError, LinkCounters, Status
from gse.station.session_data import SessionData
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor
from gse.values.attitude import Attitude
from gse.values.instant import NS_PER_S, from_text
from gse.values.panorama import Panorama

START_NS = from_text("2026-03-20T18:30:00Z")
ARCSEC = math.pi / (180 * 3600)
EARTH_RATE_DEG_S = 15.041 / 3600
OBJECTS = 24


@functools.cache
def small_catalog() -> StarCatalog:
    return load_catalog().rows(slice(0, 4000))


def synthetic_frames(count, *, seed=1, noise_arcsec=4.0, bias_arcsec=(6.0, -4.0), rate_hz=10.0, trouble=True):
    """Frames of a zenith sensor near the equator; every 50th unidentified, every 211th outside the limits."""
    generator = np.random.default_rng(seed)
    station = parse_station(BUILT_IN_TEXT)
    camera = station.sensor.camera()
    catalog = small_catalog()
    first = first_attitude(station)
    for number in range(count):
        utc_ns = START_NS + round(number / rate_hz * NS_PER_S)
        true = Attitude.from_angles(
            (first.ra_deg + number / rate_hz * EARTH_RATE_DEG_S) % 360, first.de_deg, first.roll_deg
        )
        yield _frame(number, utc_ns, true, camera, catalog, generator, noise_arcsec, bias_arcsec, trouble)


def first_attitude(station):
    """Where the stated mount looks at the start: elsewhere the set-up would be the mistake."""
    to_horizon = SiderealTruth(station.site, EarthOrientation.from_disk(START_NS)).icrs_to_horizon(START_NS)
    return Attitude(horizon_to_sensor(station.mount) @ to_horizon, np.eye(3))


def _frame(number, utc_ns, true, camera, catalog, generator, noise_arcsec, bias_arcsec, trouble):
    sensor = catalog.icrs @ true.icrs_to_sensor.T
    near = np.flatnonzero(sensor[:, 2] > math.cos(camera.diagonal_rad / 2))
    xy = camera.pixels(sensor[near])
    inside = camera.contains(xy)
    stars, xy = near[inside][:OBJECTS], xy[inside][:OBJECTS]
    xy = xy + generator.normal(0, 0.2, xy.shape)
    brightness = np.round(4000 * 10 ** (-0.3 * (catalog.magnitude[stars] - catalog.magnitude[stars[0]]))) + 40
    xy = np.vstack([xy, [[300.0, 700.0], [811.0, 122.0], [640.0, 500.0]]])
    brightness = np.concatenate([brightness, [900.0, 300.0, 120.0]])
    panorama = Panorama(
        utc_ns,
        xy,
        brightness,
        number,
        0.1,
        number * 100_000,
        utc_ns + 5_000_000,
        number % 65536,
        21.5 + math.sin(number / 500),
    )
    others = ((len(stars), "hot pixel"), (len(stars) + 1, "Jupiter"), (len(stars) + 2, "unknown"))
    if trouble and number % 50 == 49:
        return Made(panorama, Status.NO_MATCH, "no star reached Fn = 6", "neighbour", elapsed_us=900.0)
    d_ra, d_de = generator.normal(0, noise_arcsec, 2) + bias_arcsec
    if trouble and number % 211 == 210:
        d_ra = 75.0
    d_roll = float(generator.normal(0, 8 * noise_arcsec))
    measured = Attitude.from_angles(
        true.ra_deg + d_ra / 3600 / math.cos(math.radians(true.de_deg)), true.de_deg + d_de / 3600, true.roll_deg
    )
    residuals = generator.normal(0, 0.2 * camera.pixel_rad / ARCSEC, (len(stars), 2))
    return Made(
        panorama,
        Status.IDENTIFIED,
        "",
        "neighbour",
        Identification(np.arange(len(stars)), stars, 1e-12),
        measured,
        Stars(np.arange(len(stars)), stars, residuals, catalog.name),
        float(60 + generator.exponential(20)),
        measured,
        AttitudeError(float(d_ra), float(d_de), d_roll, float(-d_ra), float(d_de)),
        true,
        AnswerCheck.CORRECT,
        others,
    )


def synthetic_night(count, *, station=None, **options):
    """A Night of ``count`` frames at 10 Hz with events, clock readings and counters."""
    session = SessionData(station or parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, "panorama-v1")
    frames = list(synthetic_frames(count, **options))
    add_frames(session.frames, frames)
    session.clock += [reading_at(frame.panorama.utc_ns) for frame in frames[::100]]
    end_ns = START_NS + count * NS_PER_S // 10
    half_ns, back_ns = START_NS + (end_ns - START_NS) // 2, START_NS + (end_ns - START_NS) * 6 // 10
    session.events = [
        LinkEvent(START_NS, 0, "OPENED", "sim:// is open"),
        LinkEvent(START_NS, 0, "STREAMING", "valid frames come"),
        LinkEvent(half_ns, 0, "LOST", "device disconnected"),
        LinkEvent(back_ns, 0, "REOPENED", "sim:// is open"),
        LinkEvent(back_ns, 0, "STREAMING", "valid frames come"),
        LinkEvent(end_ns, 0, "CLOSED", "the session was ended"),
    ]
    session.link = LinkCounters(count * 216 + 40, count * 216, 40, count, {"no sync": 40}, 1, 3, 0, 1)
    session.earth_orientation = EarthOrientation.from_disk(START_NS)
    session.raw_sha256 = "0" * 64
    session.stars = small_catalog().listed
    session.catalog = {"source": "Gaia DR3", "stars": 4200, "sha256": "1" * 64}
    session.versions = {"gse-star-sensor": "0.1.0", "numpy": "2"}
    return session


def reading_at(utc_ns):
    return ClockReading(utc_ns, 0, "simulated", True, 2e-5, 1e-3)


def _temperature_c(number):
    return 21.5 + math.sin(number / 500)
