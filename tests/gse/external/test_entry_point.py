import sys

import numpy as np
import pytest
from skies.made_frames import FIELD_14_DEG

from gse.errors import UsageError
from gse.external.answers import ExternalAnswer, Failure, FailureKind
from gse.external.identifier import RunningIdentifier
from gse.external.panoramas import SensorDescription
from gse.external.plugs import plug_of
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama

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
    with pytest.raises(UsageError, match=r"none is not installed; known in gse\.identifiers: absent, broken, .*"):
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
