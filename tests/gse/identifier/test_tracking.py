"""Tracking: verified near the previous attitude first, lost in space by itself where that fails."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.attitude import Attitude, solve_attitude
from gse.camera import Camera
from gse.catalog import StarCatalog, load_catalog
from gse.evaluation.frames import Conditions, FrameMaker, Optics, SimulatedFrame
from gse.identifier import Identification, Unidentified
from gse.identifier.robust import RobustIdentifier
from gse.spiral import spiral_directions

OPTICS = Optics("14 deg", Camera(1024, 1024, 512 / math.tan(math.radians(7)), (511.5, 511.5)), 6.0)
HARD = Conditions("hard", 30.0, 0.3, 3, 0.2)


@pytest.fixture(scope="module")
def catalog() -> StarCatalog:
    return load_catalog()


@pytest.fixture(scope="module")
def identifier(catalog: StarCatalog) -> RobustIdentifier:
    return RobustIdentifier(OPTICS.camera, catalog)


@pytest.fixture(scope="module")
def frames(catalog: StarCatalog) -> list[SimulatedFrame]:
    maker = FrameMaker(OPTICS, HARD, catalog)
    return [maker.frame(at, np.random.default_rng([4, k])) for k, at in enumerate(spiral_directions(40))]


def turned(attitude: Attitude, arcsec: tuple[float, float, float]) -> Attitude:
    turn = Rotation.from_rotvec(np.radians(np.array(arcsec) / 3600)).as_matrix()
    return Attitude(turn @ attitude.icrs_to_sensor, np.zeros((3, 3)))


def error_deg(identifier: RobustIdentifier, answer: Identification | Unidentified, frame: SimulatedFrame) -> float:
    assert isinstance(answer, Identification)
    found = solve_attitude(frame.directions_sensor[answer.objects], identifier.catalog.icrs[answer.stars], 1e-4)
    return math.degrees(math.dist(found.boresight_icrs, frame.attitude.boresight_icrs))


@pytest.mark.parametrize("moved_arcsec", [(0, 0, 0), (400, -300, 200), (-500, 0, 0), (0, 500, -300)])
def test_a_sky_that_moved_a_little_is_followed(
    identifier: RobustIdentifier, frames: list[SimulatedFrame], moved_arcsec: tuple[float, float, float]
) -> None:
    for frame in frames:
        answer = identifier.track(frame.directions_sensor, frame.brightness, turned(frame.attitude, moved_arcsec))
        assert error_deg(identifier, answer, frame) < 0.05


def test_the_answer_is_that_of_the_lost_sensor(identifier: RobustIdentifier, frames: list[SimulatedFrame]) -> None:
    """But for a star at the edge of its gate now and then."""
    for frame in frames:
        lost = identifier.identify(frame.directions_sensor, frame.brightness)
        tracked = identifier.track(frame.directions_sensor, frame.brightness, frame.attitude)
        assert isinstance(lost, Identification)
        assert isinstance(tracked, Identification)
        named, again = (set(zip(a.objects.tolist(), a.stars.tolist(), strict=True)) for a in (lost, tracked))
        assert len(named ^ again) <= 3


def test_a_wrong_previous_attitude_falls_back_to_the_whole_sky(
    identifier: RobustIdentifier, frames: list[SimulatedFrame]
) -> None:
    elsewhere = Attitude.from_angles(10.0, -80.0, 0.0)
    for frame in frames:
        answer = identifier.track(frame.directions_sensor, frame.brightness, elsewhere)
        assert error_deg(identifier, answer, frame) < 0.05


def test_the_previous_attitude_decides_between_two_skies_that_look_alike() -> None:
    """A search finds both and refuses to choose: it is not by searching that the answer is found."""
    rng = np.random.default_rng(11)
    cap = rng.normal(size=(1500, 3))
    cap /= np.linalg.norm(cap, axis=1)[:, None]
    cap = cap[cap[:, 2] > 0.6]
    magnitude = np.tile(rng.uniform(2, 6, len(cap)), 2)
    order = np.argsort(magnitude, kind="stable")
    icrs = np.concatenate([cap, cap * [1.0, -1.0, -1.0]])[order]
    sky = StarCatalog("twins", 2016.0, np.arange(1, len(icrs) + 1), icrs, magnitude[order])
    identifier = RobustIdentifier(OPTICS.camera, sky)
    maker = FrameMaker(OPTICS, Conditions(position_arcsec=5.0), sky)
    for z in (1.0, -1.0):
        frame = maker.frame(np.array([0.0, 0.0, z]), np.random.default_rng(1))
        assert isinstance(identifier.identify(frame.directions_sensor, frame.brightness), Unidentified)
        near = turned(frame.attitude, (200, 100, 100))
        assert error_deg(identifier, identifier.track(frame.directions_sensor, frame.brightness, near), frame) < 0.05


def test_random_objects_are_not_taken_for_the_stars_expected(identifier: RobustIdentifier) -> None:
    rng = np.random.default_rng(8)
    for at in spiral_directions(40):
        right_ascension, declination = math.degrees(math.atan2(at[1], at[0])), math.degrees(math.asin(at[2]))
        xy = np.floor(rng.uniform(0, 1024, (30, 2)))
        brightness = np.sort(rng.uniform(100, 4096, 30))[::-1]
        previous = Attitude.from_angles(right_ascension, declination, 0.0)
        assert isinstance(identifier.track(OPTICS.camera.directions(xy), brightness, previous), Unidentified)
