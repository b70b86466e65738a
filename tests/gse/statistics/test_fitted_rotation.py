"""A free rotation is fitted where no convention fits: answers of a cube that sits on the sensor in any angle."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skies.synthetic_night import synthetic_night

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.statistics.sensor_convention import SentAnswers, fit_rotation, rotation_as_yaml, search_convention
from gse.values.attitude_convention import AnswerRotation, AttitudeConvention, state_angles, state_quaternions
from gse.verdict.assessment import judge

CUBE_TO_SENSOR = Rotation.from_euler("zyx", [35.0, -20.0, 110.0], degrees=True)
AXES = tuple(map(tuple, CUBE_TO_SENSOR.as_matrix().tolist()))
SECONDS = np.arange(0, 60, 0.25)


def evidence(convention: AttitudeConvention, noise_arcsec: float = 5.0, *, wobble_arcsec: float = 0.0) -> SentAnswers:
    """A minute of the sky that turns, as a sensor with this convention sends it; its cube may move."""
    draw = np.random.default_rng(5)
    pole = np.radians(15.041 / 3600 * SECONDS)[:, None] * np.array([0.0, 0.0, 1.0])
    true = (Rotation.from_euler("zyx", [10, 40, 70], degrees=True) * Rotation.from_rotvec(pole)).as_matrix()
    moved = np.radians(wobble_arcsec / 3600 * SECONDS / 60)[:, None] * np.array([1.0, 0.0, 0.0])
    noise = Rotation.from_rotvec(np.radians(noise_arcsec / 3600) * draw.normal(size=(len(true), 3)) + moved).as_matrix()
    state = state_angles if convention.roll_through == "west" else state_quaternions
    sent = state(noise @ true, convention)
    return SentAnswers((SECONDS * 1e9).astype(np.int64) + 1_774_018_800 * 10**9, sent, true, true, 1.0)


@pytest.mark.parametrize(
    "convention",
    [
        AttitudeConvention(),
        AttitudeConvention(scalar="first", conjugate=True),
        AttitudeConvention(conjugate=True),
        AttitudeConvention(roll_through="west"),
    ],
    ids=["plain", "first conjugate", "conjugate", "angles through west"],
)
def test_the_rotation_of_a_cube_is_found_within_its_interval(convention: AttitudeConvention) -> None:
    rotation = AnswerRotation(axes=AXES, uncertainty_arcsec=0.0)
    seen = evidence(AttitudeConvention(**{name: getattr(convention, name) for name in KEYS}, rotation=rotation))
    search = search_convention(seen)
    assert search is not None
    assert search.fits == ()
    found = fit_rotation(seen)
    assert found is not None
    assert found.rotation is not None
    # A conjugate reading with other reference axes may be the same one: what counts is where the answers come to lie.
    apart = Rotation.from_matrix(found.rotation.matrix()) * CUBE_TO_SENSOR.inv()
    if (found.scalar, found.conjugate, found.reference_axes) == (convention.scalar, convention.conjugate, "x y z"):
        assert np.degrees(apart.magnitude()) * 3600 < 2 * found.rotation.uncertainty_arcsec
    assert found.rotation.uncertainty_arcsec < 10.0
    assert found.roll_through == convention.roll_through


KEYS = ("scalar", "conjugate", "roll_through")


def test_a_session_that_is_judged_with_a_fitted_rotation_is_relative() -> None:
    session = synthetic_night(1)
    assert not judge(session).relative
    for fitted in (False, True):
        rotation = AnswerRotation(axes=AXES, uncertainty_arcsec=1.0, fitted=fitted)
        sensor = session.station.sensor.model_copy(update={"attitude": AttitudeConvention(rotation=rotation)})
        session.station = session.station.model_copy(update={"sensor": sensor})
        assert judge(session).relative is fitted
    assert any("fitted frame of the answers" in reason for reason in judge(session).reasons)


def test_a_cube_that_moves_has_no_rotation() -> None:
    rotation = AnswerRotation(axes=AXES, uncertainty_arcsec=0.0)
    assert fit_rotation(evidence(AttitudeConvention(rotation=rotation), wobble_arcsec=300.0)) is None


def test_the_line_that_is_printed_is_one_that_a_station_file_takes() -> None:
    rotation = AnswerRotation(axes=AXES, uncertainty_arcsec=0.0)
    found = fit_rotation(evidence(AttitudeConvention(rotation=rotation)))
    assert found is not None
    keys = rotation_as_yaml(found).removeprefix("sensor: {").removesuffix("}")
    station = parse_station(BUILT_IN_TEXT.replace("sensor:\n", f"sensor:\n  {keys}\n", 1))
    assert station.sensor.attitude.rotation == found.rotation
