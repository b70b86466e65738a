"""Sensors whose answers astropy and scipy make alone: their conventions are named, and read back as they were made."""

import erfa
import numpy as np
import pytest
from astropy.coordinates import FK5, FK4NoETerms, SkyCoord
from scipy.spatial.transform import Rotation
from skies.one_by_one import Made, add_frame

from gse.config.station import parse_station
from gse.inspection.made_session import ALTITUDE_DEG, AZIMUTH_DEG, ROLL_DEG, SITE, STATION_TEXT, AstropySky, mounted
from gse.station.own_answers import measured_rotations
from gse.station.results import Status, Subject
from gse.station.session_data import SessionData
from gse.statistics.sensor_convention import evidence_of, search_convention
from gse.truth import EarthOrientation
from gse.values.instant import NS_PER_S, from_text
from gse.values.panorama import Panorama
from protocols import AttitudeMessage

UTC_NS = from_text("2026-03-20T11:00:00Z") + np.arange(61) * NS_PER_S
NOISE_ARCSEC = np.array([4.0, 4.0, 20.0])


@pytest.fixture(scope="module")
def icrs_to_sensor():
    """What the sensor sees, by astropy: rows are x to the right, y down, z out of the boresight."""
    axes = np.broadcast_to(mounted(AZIMUTH_DEG, ALTITUDE_DEG, ROLL_DEG), (len(UTC_NS), 3, 3))
    boresight, up = AstropySky(SITE).boresight_and_up(axes, UTC_NS, air=True)
    rotations = Rotation.from_matrix(np.stack([np.cross(-up, boresight), -up, boresight], axis=1))
    noise = np.random.default_rng(4).normal(0, np.radians(NOISE_ARCSEC / 3600), (len(UTC_NS), 3))
    return Rotation.from_rotvec(noise) * rotations


def quaternions(rotations, **options):
    numbers = rotations.as_quat(**options)
    return [dict(zip(("q1", "q2", "q3", "q4"), row, strict=True)) for row in numbers.tolist()]


def angles(rotations, *, hours=False, west=False):
    """RA, DE and position angle of image up, from SkyCoord alone."""
    boresight, up = rotations.as_matrix()[:, 2], -rotations.as_matrix()[:, 1]
    at, above = (SkyCoord(*v.T, representation_type="cartesian").spherical for v in (boresight, boresight + 1e-6 * up))
    at, above = (SkyCoord(place.lon, place.lat) for place in (at, above))
    roll_deg = at.position_angle(above).deg * (-1 if west else 1) % 360
    ra = at.ra.hour if hours else at.ra.deg
    return [
        dict(zip(("ra_deg", "de_deg", "roll_deg"), row, strict=True))
        for row in zip(ra, at.dec.deg, roll_deg, strict=True)
    ]


def of_date(rotations):
    """From the true equator and equinox of date."""
    jd = 2_440_587.5 + UTC_NS / 86_400e9 + 69.2 / 86_400
    return rotations * Rotation.from_matrix(erfa.pnm06a(jd, 0.0)).inv()


def of_mean_equinox(rotations, frame):
    """From the mean equator and equinox of an astropy frame."""
    basis = SkyCoord(*np.eye(3), representation_type="cartesian", frame="icrs").transform_to(frame)
    return rotations * Rotation.from_matrix(basis.cartesian.xyz.value).inv()


def body(rotations, matrix):
    return Rotation.from_matrix(matrix) * rotations


TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # body x is against sensor y
SENSORS = {
    "scipy's own": lambda r: quaternions(r),
    "scalar first, inverse": lambda r: quaternions(r.inv(), scalar_first=True),
    "body turned by 90 deg": lambda r: quaternions(body(r, TURNED), scalar_first=True),
    "boresight along body x": lambda r: quaternions(body(r, np.roll(np.eye(3), 1, axis=1).T)),
    "canonical sign, of date": lambda r: quaternions(of_date(r), canonical=True),
    "J2000": lambda r: quaternions(of_mean_equinox(r, FK5(equinox="J2000"))),
    "angles": angles,
    "angles in hours, roll through west": lambda r: angles(r, hours=True, west=True),
    "angles of date": lambda r: angles(of_date(r)),
    "angles of B1950": lambda r: angles(of_mean_equinox(r, FK4NoETerms(equinox="B1950"))),
    "B1950": lambda r: quaternions(of_mean_equinox(r, FK4NoETerms(equinox="B1950"))),
}


def framed(utc_ns, frame_no, time_us):
    """The exposure behind an answer, without objects."""
    nothing = np.empty(0)
    panorama = Panorama(utc_ns, nothing.reshape(0, 2), nothing, frame_no, time_us=time_us)
    return Made(panorama, Status.IDENTIFIED, "", "sensor")


@pytest.mark.parametrize("name", SENSORS)
def test_a_sensor_made_by_others_is_read_as_it_was_made(icrs_to_sensor, name):
    session = SessionData(
        parse_station(STATION_TEXT),
        STATION_TEXT,
        "made",
        subject=Subject.SENSOR,
        earth_orientation=EarthOrientation.from_disk(int(UTC_NS[0])),
    )
    for place, numbers in enumerate(SENSORS[name](icrs_to_sensor)):
        time_us = place * 1_000_000
        session.sensor_attitudes.append(int(UTC_NS[place]), AttitudeMessage(time_us, frame_no=place, **numbers))
        add_frame(session.frames, framed(int(UTC_NS[place]), place, time_us))
    found = search_convention(evidence_of(session))
    assert found is not None
    assert found.fits, found.nearest
    for fit in found.fits:
        read = measured_rotations(session.sensor_attitudes.columns, UTC_NS, fit.convention)
        apart = (Rotation.from_matrix(read) * icrs_to_sensor.inv()).magnitude()
        assert np.degrees(apart).max() * 3600 < 0.1, fit.convention
    assert found.aberration != "corrected"
