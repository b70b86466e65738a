"""Answers in the frame of another body, which an alignment sheet leads to the sensor."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import GseError
from gse.statistics.budget_terms import OWN_FRAME, answers_frame
from gse.values.attitude_convention import (
    AnswerRotation,
    AttitudeConvention,
    read_angles,
    read_quaternions,
    state_angles,
    state_quaternions,
)

CUBE_TO_SENSOR = Rotation.from_euler("zyx", [35.0, -20.0, 110.0], degrees=True)
"""Of coordinates: what scipy applies to vectors."""
# scipy's quaternions turn vectors; those of AttitudeConvention turn axes, so one is the inverse of the other.
QUATERNION = tuple(CUBE_TO_SENSOR.inv().as_quat().tolist())
AXES = tuple(map(tuple, CUBE_TO_SENSOR.as_matrix().tolist()))


@pytest.fixture
def icrs_to_sensor() -> np.ndarray:
    return Rotation.random(20, random_state=3).as_matrix()


@pytest.mark.parametrize("stated", [{"quaternion": QUATERNION}, {"axes": AXES}], ids=["quaternion", "axes"])
def test_answers_of_a_cube_are_read_as_those_of_the_sensor(icrs_to_sensor, stated) -> None:
    convention = AttitudeConvention(rotation=AnswerRotation(**stated, uncertainty_arcsec=30.0))
    of_cube = [CUBE_TO_SENSOR.inv().as_matrix() @ one for one in icrs_to_sensor]
    sent = Rotation.from_matrix(of_cube).inv().as_quat()
    np.testing.assert_allclose(read_quaternions(sent, convention), icrs_to_sensor, atol=1e-12)


@pytest.mark.parametrize(("read", "state"), [(read_quaternions, state_quaternions), (read_angles, state_angles)])
def test_what_a_sensor_states_of_a_cube_is_read_back(icrs_to_sensor, read, state) -> None:
    convention = AttitudeConvention(rotation=AnswerRotation(axes=AXES, uncertainty_arcsec=30.0))
    np.testing.assert_allclose(read(state(icrs_to_sensor, convention), convention), icrs_to_sensor, atol=1e-9)


def test_a_direction_alone_cannot_be_brought_to_another_body() -> None:
    convention = AttitudeConvention(rotation=AnswerRotation(axes=AXES, uncertainty_arcsec=30.0))
    assert np.isnan(read_angles(np.array([[10.0, 20.0, np.nan]]), convention)).any()
    assert np.isfinite(read_angles(np.array([[10.0, 20.0, np.nan]]), AttitudeConvention())).all()


def test_its_uncertainty_is_a_term_of_a_standard_uncertainty() -> None:
    term = answers_frame(30.0)
    assert (term.name, term.ra_arcsec, term.de_arcsec) == (OWN_FRAME, 15.0, 15.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{quaternion: [0, 0, 0, 2], uncertainty_arcsec: 1}", "has the length 2: expected 1"),
        ("{axes: [[1, 0, 0], [0, 1, 0], [0, 0, -1]], uncertainty_arcsec: 1}", "three right-handed unit vectors"),
        ("{uncertainty_arcsec: 1}", "expected quaternion"),
        ("{quaternion: [0, 0, 0, 1]}", "uncertainty_arcsec"),
    ],
)
def test_a_rotation_that_is_none_is_refused(text: str, said: str) -> None:
    station = BUILT_IN_TEXT.replace("sensor:\n", f"sensor:\n  attitude: {{rotation: {text}}}\n", 1)
    assert station != BUILT_IN_TEXT
    with pytest.raises(GseError, match=said):
        parse_station(station)
