"""Conventions of a sensor's own answers, found from a minute of sky."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skies.known_nights import START_NS, STATION, TRUTH, session

from gse.assessment.convention_search import Evidence, search_convention, with_aberration
from gse.assessment.decision import Outcome
from gse.assessment.sensor_convention import in_words
from gse.assessment.verdict import judge
from gse.attitude_convention import (
    AttitudeConvention,
    from_quaternions,
    state_angles,
    state_quaternions,
    to_quaternions,
)
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.constants import ARCSEC_RAD
from gse.instant import NS_PER_S
from gse.mount import Mount
from gse.station.own_answers import OwnAnswerTruth
from gse.station.results import Subject, Verdict
from gse.truth.frames import icrs_to_frame
from protocols import AttitudeMessage

UTC_NS = START_NS + np.arange(60) * NS_PER_S
MOUNT = Mount(azimuth_deg=40.0, altitude_deg=65.0, roll_deg=25.0)
LEFT_IN, TAKEN_OUT = (OwnAnswerTruth(TRUTH, MOUNT, corrected).expected(UTC_NS) for corrected in (False, True))


def sent(convention, state, *, body_arcsec=(0.0, 0.0, 0.0), noise_arcsec=5.0):
    """A minute of answers in a convention, from a body frame that is turned on its detector."""
    answered = TAKEN_OUT if convention.aberration == "corrected" else LEFT_IN
    body = Rotation.from_rotvec(np.array(body_arcsec) * ARCSEC_RAD).as_matrix()
    noise = np.random.default_rng(3).normal(0, noise_arcsec, (len(UTC_NS), 3)) * [1, 1, 8] * ARCSEC_RAD
    answered = Rotation.from_rotvec(noise).as_matrix() @ body @ answered
    stated = state(answered @ icrs_to_frame(convention.frame, UTC_NS).transpose(0, 2, 1), convention)
    return Evidence(UTC_NS, stated, LEFT_IN, TAKEN_OUT, 1.0)


QUATERNIONS = [
    {},
    {"scalar": "first"},
    {"conjugate": True, "frame": "date"},
    {"body_axes": "-y x z", "frame": "J2000"},
    {"body_axes": "x y -z", "reference_axes": "-x y z", "aberration": "corrected"},
    {"scalar": "first", "conjugate": True, "body_axes": "z -x -y", "reference_axes": "y z x", "frame": "date"},
]
ANGLES = [
    {},
    {"ra_unit": "h", "frame": "date"},
    {"roll_through": "west", "roll_zero_deg": 90, "aberration": "corrected"},
    {"roll_zero_deg": 180, "frame": "J2000"},
]


@pytest.mark.parametrize(
    ("state", "keys"),
    [*((state_quaternions, keys) for keys in QUATERNIONS), *((state_angles, keys) for keys in ANGLES)],
)
def test_a_minute_of_sky_names_the_convention(state, keys):
    convention = AttitudeConvention(**keys)
    found = search_convention(sent(convention, state))
    assert len(found.fits) == 1
    assert found.includes(convention)
    assert found.aberration == convention.aberration
    assert not found.includes(dataclasses.replace(convention, frame="ICRS" if convention.frame == "date" else "date"))


def test_answers_of_no_convention_get_the_nearest_and_how_far_it_is_off():
    found = search_convention(sent(AttitudeConvention(), state_angles, body_arcsec=(3600, 0, 0)))
    assert found.fits == ()
    assert 2000 < found.nearest.size_arcsec < 3700  # a degree, less what precession makes up for


def test_quaternions_of_no_convention_get_the_nearest_too():
    found = search_convention(sent(AttitudeConvention(), state_quaternions, body_arcsec=(5 * 3600, 0, 0)))
    assert found.fits == ()
    assert 4.6 * 3600 < found.nearest.size_arcsec < 5.1 * 3600


def test_a_turn_about_the_boresight_counts_a_tenth():
    found = search_convention(sent(AttitudeConvention(), state_quaternions, body_arcsec=(0, 0, 10 * 3600)))
    assert found.nearest.size_arcsec == pytest.approx(0.1 * 10 * 3600, rel=0.01)


@pytest.mark.parametrize("state", [state_quaternions, state_angles])
def test_answers_without_an_error_leave_nothing(state):
    found = search_convention(sent(AttitudeConvention(), state, noise_arcsec=0.0))
    assert found.nearest.size_arcsec < 0.01


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, "scalar last, in ICRS or J2000"),
        ({"scalar": "first", "conjugate": True, "frame": "date"}, "scalar first, conjugate, of date"),
        (
            {"body_axes": "-y x z", "reference_axes": "y z x"},
            "scalar last, in ICRS or J2000, body axes -y x z, reference axes y z x",
        ),
    ],
)
def test_a_convention_of_quaternions_is_told_by_its_keys(keys, words):
    quaternions = search_convention(sent(AttitudeConvention(), state_quaternions))
    assert in_words(AttitudeConvention(**keys), quaternions) == words


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, "RA in degrees, in ICRS or J2000"),
        ({"ra_unit": "h", "frame": "date"}, "RA in hours, of date"),
        ({"roll_through": "west"}, "RA in degrees, in ICRS or J2000, roll through west from 0 deg"),
        ({"roll_zero_deg": 90}, "RA in degrees, in ICRS or J2000, roll through east from 90 deg"),
    ],
)
def test_a_convention_of_angles_is_told_by_its_keys(keys, words):
    angles = search_convention(sent(AttitudeConvention(), state_angles))
    assert in_words(AttitudeConvention(**keys), angles) == words
    assert (
        in_words(AttitudeConvention(**keys), dataclasses.replace(angles, roll_sent=False)) == words.split(", roll")[0]
    )


def test_answers_that_stand_still_have_no_convention():
    evidence = sent(AttitudeConvention(), state_quaternions)
    frozen = dataclasses.replace(evidence, sent=np.repeat(evidence.sent[:1], len(UTC_NS), axis=0))
    assert search_convention(frozen).fits == ()


def test_aberration_is_not_told_where_a_body_frame_is_turned_by_as_much_aside():
    found = search_convention(sent(AttitudeConvention(), state_angles, body_arcsec=(0, 20, 0)))
    assert len(found.fits) == 1
    assert found.aberration == "not told"
    assert with_aberration(found).aberration == "not corrected"


def test_angles_without_a_roll_are_named_by_ra_and_de():
    evidence = sent(AttitudeConvention(ra_unit="h"), state_angles)
    evidence.sent[:, 2] = np.nan
    found = search_convention(evidence)
    assert [fit.convention.ra_unit for fit in found.fits] == ["h"]


def test_a_quaternion_turns_axes_as_scipy_says():
    rotations = Rotation.random(50, rng=np.random.default_rng(1))
    # scipy's rotation turns vectors: the coordinates of a fixed vector in turned axes are those of the inverse
    ours = from_quaternions(rotations.as_quat())
    assert np.abs(ours - rotations.inv().as_matrix()).max() < 1e-12
    assert np.abs(from_quaternions(to_quaternions(ours)) - ours).max() < 1e-12


def with_answers(convention, count=600, **stated):
    """A session whose sensor answers in one convention, and whose station file states another."""
    text = BUILT_IN_TEXT
    station = parse_station(text)
    sensor = station.sensor.model_copy(update={"attitude": AttitudeConvention(**stated)})
    made = session(count, noise=2.0, station=station.model_copy(update={"sensor": sensor}))
    frames = made.frames.columns
    utc_ns = frames["utc_ns"]
    corrected = convention.aberration == "corrected"
    true = OwnAnswerTruth(TRUTH, STATION.mount, corrected).expected(utc_ns)
    left_in = OwnAnswerTruth(TRUTH, STATION.mount).expected(utc_ns)
    for name, values in zip(
        ("ra_deg", "de_deg", "roll_deg"), state_angles(left_in, AttitudeConvention()).T, strict=True
    ):
        frames[name] = values
    angles = state_angles(true @ icrs_to_frame(convention.frame, utc_ns).transpose(0, 2, 1), convention)
    for row, (ra_deg, de_deg, roll_deg) in zip(frames.rows(), angles.tolist(), strict=True):
        message = AttitudeMessage(
            int(row["time_us"]), ra_deg, de_deg, roll_deg, int(row["frame_no"]), 12, "acquired", 0.08
        )
        made.sensor_attitudes.append(int(row["utc_ns"]), message)
    return made


def test_a_wrong_convention_is_a_finding_and_not_an_error_of_the_sensor():
    assessment = judge(with_answers(AttitudeConvention(frame="date")))
    assert assessment.verdict is Verdict.INCONCLUSIVE
    rows = {row.name: row.outcome for row in assessment.rows if row.subject is Subject.SENSOR}
    assert rows["mean |dRA*|"] is rows["95 % of |dDE|"] is Outcome.NOT_TESTED
    finding = next(finding for finding in assessment.findings if finding.cause == "sensor convention")
    assert "RA in degrees, of date" in finding.size


def test_the_right_convention_passes_and_has_no_finding():
    assessment = judge(with_answers(AttitudeConvention(frame="date", ra_unit="h"), frame="date", ra_unit="h"))
    assert assessment.verdict is Verdict.PASS, assessment.reasons
    assert not [finding for finding in assessment.findings if finding.cause.startswith("sensor")]


def test_a_sensor_that_leaves_aberration_in_is_not_blamed_and_one_that_hides_it_is_named():
    simple = judge(with_answers(AttitudeConvention()))
    assert abs(simple.statistics.subjects[Subject.SENSOR].axes["cross_x"].bias_arcsec) < 0.5
    hiding = judge(with_answers(AttitudeConvention(), aberration="corrected"))
    assert next(finding.cause for finding in hiding.findings if "sensor" in finding.cause) == "sensor aberration"
    biases = [hiding.statistics.subjects[Subject.SENSOR].axes[f"cross_{axis}"].bias_arcsec for axis in "xy"]
    assert np.hypot(*biases) == pytest.approx(19.1, abs=0.5)


@pytest.mark.parametrize(
    ("attitude", "words"),
    [
        ("{scalar: middle}", "sensor.attitude.scalar is 'middle'"),
        ("{body_axes: x y}", "body_axes is 'x y': expected x, y and z in some order"),
        ("{body_axes: x y -z}", "one is mirrored and the other is not"),
        ("{scaler: first}", "unknown key sensor.attitude.scaler; did you mean scalar?"),
        ("{roll_zero_deg: 45}", "roll_zero_deg is 45: expected 0, 90, 180 or 270"),
    ],
)
def test_a_convention_that_is_none_is_named_with_its_line(attitude, words):
    text = BUILT_IN_TEXT.replace("sensor:\n", f"sensor:\n  attitude: {attitude}\n")
    with pytest.raises(Exception, match="line") as refused:
        parse_station(text, "roof.yaml")
    assert words in str(refused.value)
