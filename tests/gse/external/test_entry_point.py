import json
import sys

import numpy as np
import pytest
from skies.made_frames import FIELD_14_DEG, Noise, made_frame, sky_of

from gse.camera import Camera
from gse.catalog import load_catalog
from gse.errors import UsageError
from gse.external.answers import ExternalAnswer, Failure, FailureKind
from gse.external.identifier import RunningIdentifier
from gse.external.panoramas import SensorDescription
from gse.external.plugs import plug_of
from gse.identifier_options import IdentifierOptions
from gse.panorama import Panorama
from gse.spiral import spiral_directions

SENSOR = SensorDescription("made", FIELD_14_DEG, 4096)

MODULE = """\
__version__ = "3.2"
print("loading")

def make(sensor, config=None):
    def identify(panorama):
        if panorama["frame_no"] == 2:
            raise ValueError("no idea")
        return {"ra_deg": sensor["rows"] / 10, "de_deg": float(open(config).read()) if config else 0.0}
    return identify

def broken(sensor):
    raise OSError("no database")

def forgets(sensor):
    return lambda panorama: None

constant = 5
"""


def running(name, **options):
    plug = plug_of(IdentifierOptions(algorithm="external", entry_point=name, **options), SENSOR)
    return RunningIdentifier(plug, 20.0)


def empty(count):
    return [Panorama(n, np.zeros((2, 2)), np.array([2.0, 1.0]), n) for n in range(count)]


@pytest.fixture
def installed(tmp_path):
    """A package in the group gse.identifiers, installed beside the station's own."""
    (tmp_path / "made_solver.py").write_text(MODULE)
    info = tmp_path / "made_solver-3.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: made-solver\nVersion: 3.2\n")
    points = "mine = made_solver:make\nbroken = made_solver:broken\ngone = made_solver:gone\n"
    points += "forgets = made_solver:forgets\nconstant = made_solver:constant\nabsent = absent_solver:make\n"
    (info / "entry_points.txt").write_text(f"[gse.identifiers]\n{points}")
    sys.path.insert(0, str(tmp_path))
    yield tmp_path
    sys.path.remove(str(tmp_path))


def test_an_installed_entry_point_answers_with_its_config(installed):
    (installed / "config.txt").write_text("-45.5")
    identifier = running("mine", config=str(installed / "config.txt"))
    given = identifier.answers(empty(4))
    identifier.close()
    assert [isinstance(one.answer, ExternalAnswer) for one in given] == [True, True, False, True]
    assert given[2].answer.kind is FailureKind.CRASH
    assert given[3].answer.document["ra_deg"] == 102.4
    assert given[3].answer.document["de_deg"] == -45.5
    assert not given[3].has_own_time
    assert identifier.identity["version"] == "3.2"
    log = identifier.take_log().decode()
    assert "loading" in log
    assert "ValueError: no idea" in log


def test_an_entry_point_that_cannot_be_loaded_is_refused_before_a_session(installed):
    with pytest.raises(UsageError, match="AttributeError: module 'made_solver' has no attribute 'gone'"):
        running("gone")
    with pytest.raises(UsageError, match="absent: the package absent_solver is not installed; install it beside gse"):
        running("absent")
    with pytest.raises(UsageError, match="made_solver:constant is int; expected a function of the sensor"):
        running("constant")
    with pytest.raises(
        UsageError, match=r"none is not installed; known in gse\.identifiers: absent, broken, cedar-solve, constant"
    ):
        running("none")


def test_what_is_no_answer_is_named_by_its_type(installed):
    identifier = running("forgets")
    (given,) = identifier.answers(empty(1))
    identifier.close()
    assert isinstance(given.answer, Failure)
    assert "TypeError: the answer is NoneType; expected a dict" in given.answer.detail


def test_one_that_fails_to_start_costs_its_panoramas(installed):
    identifier = running("broken")
    given = identifier.answers(empty(2))
    identifier.close()
    assert all(isinstance(one.answer, Failure) and one.answer.kind is FailureKind.CRASH for one in given)
    assert b"OSError: no database" in identifier.take_log()


def _panoramas(camera, limit, count):
    sky = sky_of(load_catalog(stars=40_000), camera, limit)
    rng = np.random.default_rng(5)
    noise = Noise(limit=limit, whole_pixels=False)
    frames = [made_frame(sky, camera, direction, noise, rng) for direction in spiral_directions(count)]
    return frames, [Panorama(n, frame.xy_px, frame.brightness, n) for n, frame in enumerate(frames)]


@pytest.mark.parametrize("name", ["tetra3rs", "cedar-solve"])
def test_a_solver_from_pypi_finds_boresight_and_roll(name):
    pytest.importorskip(name.partition("-")[0] if name == "tetra3rs" else "tetra3")
    mirrored = Camera(1024, 1024, FIELD_14_DEG.focal_length_px, (500.0, 520.0), mirrored=name == "tetra3rs")
    frames, panoramas = _panoramas(mirrored, 6.0, 12)
    plug = plug_of(IdentifierOptions(algorithm="external", entry_point=name), SensorDescription("made", mirrored, 4096))
    identifier = RunningIdentifier(plug, 20.0)
    given = identifier.answers(panoramas)
    identifier.close()
    attitudes = [one.answer.attitude if isinstance(one.answer, ExternalAnswer) else None for one in given]
    found = [(frame, attitude) for frame, attitude in zip(frames, attitudes, strict=True) if attitude]
    assert len(found) >= 9
    for frame, attitude in found:
        error = attitude.icrs_to_sensor @ frame.icrs_to_sensor.T
        across, roll = np.hypot(*error[:2, 2]), np.arctan2(error[1, 0], error[0, 0])
        assert np.degrees(across) < 0.02
        assert abs(np.degrees(roll)) < 0.2


def test_the_stars_that_tetra3rs_names_are_those_of_the_station_s_catalogue():
    pytest.importorskip("tetra3rs")
    frames, panoramas = _panoramas(FIELD_14_DEG, 6.0, 6)
    identifier = running("tetra3rs")
    given = identifier.answers(panoramas)
    identifier.close()
    named = right = 0
    for frame, one in zip(frames, given, strict=True):
        if isinstance(one.answer, ExternalAnswer) and one.answer.attitude:
            named += len(one.answer.objects)
            right += int((frame.ids[one.answer.objects] == one.answer.star_ids).sum())
    assert named > 40
    assert right > 0.9 * named
    assert json.dumps(identifier.identity)
