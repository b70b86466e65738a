"""Conventions of a sensor's own answers, found from a minute of sky."""

import dataclasses
import itertools
from functools import cache

import numpy as np
import pytest
import scipy.stats
from scipy.spatial.transform import Rotation
from skies.known_nights import START_NS, STATION, TRUTH, session

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.station.own_answers import OwnAnswerTruth
from gse.station.results import Subject, Verdict
from gse.statistics.decision import Outcome
from gse.statistics.sensor_convention import (
    FEWEST,
    SentAnswers,
    _candidates,
    _cosines,
    _mean_and_change,
    _misfit,
    _plainness,
    in_words,
    search_convention,
    session_convention,
    with_aberration,
)
from gse.truth import EarthOrientation, SiderealTruth
from gse.truth.frames import icrs_to_frame
from gse.values.attitude_convention import (
    AttitudeConvention,
    from_quaternions,
    proper_axes,
    read_quaternions,
    state_angles,
    state_quaternions,
    to_quaternions,
)
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount
from gse.verdict.assessment import judge
from protocols import AttitudeMessage

UTC_NS = START_NS + np.arange(60) * NS_PER_S
MOUNT = Mount(azimuth_deg=40.0, altitude_deg=65.0, roll_deg=25.0)


@cache
def expected(aberration):
    """Where the sensor looks (60, 3, 3), with the aberration corrected or not."""
    return OwnAnswerTruth(TRUTH, MOUNT, aberration == "corrected").expected(UTC_NS)


def evidence_of(stated):
    return SentAnswers(UTC_NS, stated, expected("not corrected"), expected("corrected"), 1.0)


def sent(convention, state, *, body_arcsec=(0.0, 0.0, 0.0), noise_arcsec=5.0):
    """A minute of answers in a convention, from a body frame that is turned on its detector."""
    body = Rotation.from_rotvec(np.array(body_arcsec) * ARCSEC_RAD).as_matrix()
    noise = np.random.default_rng(3).normal(0, noise_arcsec, (len(UTC_NS), 3)) * [1, 1, 8] * ARCSEC_RAD
    answered = Rotation.from_rotvec(noise).as_matrix() @ body @ expected(convention.aberration)
    stated = state(answered @ icrs_to_frame(convention.frame, UTC_NS).transpose(0, 2, 1), convention)
    return evidence_of(stated)


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


@pytest.mark.parametrize(("body_arcsec", "fits"), [(350, True), (370, False)])
def test_a_body_frame_that_is_turned_by_a_tenth_of_a_degree_at_most_is_no_other_convention(body_arcsec, fits):
    found = search_convention(
        sent(AttitudeConvention(), state_quaternions, body_arcsec=(body_arcsec, 0, 0), noise_arcsec=0)
    )
    assert bool(found.fits) is fits
    assert found.nearest.size_arcsec == pytest.approx(body_arcsec - 10, abs=2)  # less what aberration makes up for


def some_of(evidence, count):
    return dataclasses.replace(
        evidence,
        utc_ns=evidence.utc_ns[:count],
        sent=evidence.sent[:count],
        true=evidence.true[:count],
        true_corrected=evidence.true_corrected[:count],
    )


@pytest.mark.parametrize("state", [state_quaternions, state_angles])
def test_ten_answers_are_the_fewest_that_name_a_convention(state):
    every = sent(AttitudeConvention(), state)
    assert FEWEST == 10
    assert search_convention(some_of(every, 9)) is None
    found = search_convention(some_of(every, 10))
    assert (found.answers, found.duration_s) == (10, 9.0)
    assert len(found.fits) == 1


def test_how_far_aberration_moves_the_boresight_is_the_angle_between_both():
    found = search_convention(sent(AttitudeConvention(), state_angles))
    cosines = np.einsum("ki,ki->k", expected("not corrected")[:, 2], expected("corrected")[:, 2])
    assert found.aberration_arcsec == pytest.approx(np.median(np.arccos(cosines)) / ARCSEC_RAD, abs=0.01)


@pytest.mark.parametrize(("truth_arcsec", "is_told"), [(3.0, True), (3.4, False)])
@pytest.mark.parametrize("aberration", ["corrected", "not corrected"])
def test_aberration_is_told_where_it_is_six_times_what_is_not_known(aberration, truth_arcsec, is_told):
    """Here it is 19.1 arcsec."""
    evidence = sent(AttitudeConvention(aberration=aberration), state_angles, noise_arcsec=0)
    found = search_convention(dataclasses.replace(evidence, truth_arcsec=truth_arcsec))
    assert found.aberration == (aberration if is_told else "not told")


@pytest.mark.parametrize(("body_arcsec", "is_told"), [(3.9, True), (4.1, False)])
@pytest.mark.parametrize("aberration", ["corrected", "not corrected"])
def test_aberration_is_told_where_one_of_both_fits_within_four_times_what_is_not_known(
    aberration, body_arcsec, is_told
):
    convention = AttitudeConvention(aberration=aberration)
    found = search_convention(sent(convention, state_angles, body_arcsec=(body_arcsec, 0, 0), noise_arcsec=0))
    assert found.aberration == (aberration if is_told else "not told")


@pytest.mark.parametrize("keys", QUATERNIONS[:4])
def test_of_conventions_that_read_alike_the_plainest_is_named(keys):
    convention = AttitudeConvention(**keys)
    named = with_aberration(search_convention(sent(convention, state_quaternions)))
    assert named == dataclasses.replace(convention, frame="date" if convention.frame == "date" else "ICRS")


@pytest.mark.parametrize(
    ("stated", "roll_sent", "is_among"),
    [
        ({}, True, True),
        ({"frame": "J2000"}, True, True),
        ({"frame": "date"}, True, False),
        ({"ra_unit": "h"}, True, False),
        ({"roll_through": "west"}, True, False),
        ({"roll_zero_deg": 90}, True, False),
        ({"roll_through": "west"}, False, True),
        ({"roll_zero_deg": 90}, False, True),
        ({"ra_unit": "h"}, False, False),
    ],
)
def test_a_stated_convention_is_among_those_that_fit_where_it_reads_what_was_sent_alike(stated, roll_sent, is_among):
    evidence = sent(AttitudeConvention(), state_angles)
    if not roll_sent:
        evidence.sent[:, 2] = np.nan
    found = search_convention(evidence)
    assert found.roll_sent is roll_sent
    assert found.includes(AttitudeConvention(**stated)) is is_among


def in_2001(body_arcsec):
    """Answers without noise of a time when the axes of ICRS and of date are a minute of arc apart."""
    utc_ns = from_text("2001-03-20T18:30:00Z") + np.arange(60) * NS_PER_S
    truth = SiderealTruth(STATION.site, EarthOrientation.from_disk(int(utc_ns[0])))
    left_in, taken_out = (OwnAnswerTruth(truth, MOUNT, corrected).expected(utc_ns) for corrected in (False, True))
    body = Rotation.from_rotvec(np.array([body_arcsec, 0, 0]) * ARCSEC_RAD).as_matrix()
    return SentAnswers(utc_ns, state_angles(body @ left_in, AttitudeConvention()), left_in, taken_out, 1.0)


@pytest.mark.parametrize(
    ("body_arcsec", "truth_arcsec", "frames"),
    [
        (-16.0, 1.0, ["ICRS"]),
        (-20.0, 1.0, ["ICRS", "date"]),
        (1.0, 6.2, ["ICRS"]),
        (1.0, 6.4, ["ICRS", "date"]),
    ],
)
def test_conventions_within_three_times_the_least_misfit_or_six_times_what_is_not_known_are_not_told_apart(
    body_arcsec, truth_arcsec, frames
):
    """That of date leaves 52, 56, 39 and 39 arcsec here."""
    found = search_convention(dataclasses.replace(in_2001(body_arcsec), truth_arcsec=truth_arcsec))
    assert [fit.convention.frame for fit in found.fits] == frames
    assert (with_aberration(found) is None) == (len(frames) > 1)


def turned(turns_arcsec, state):
    """A minute of answers without noise, each turned (60, 3) in the sensor frame."""
    answered = Rotation.from_rotvec(np.asarray(turns_arcsec) * ARCSEC_RAD).as_matrix() @ expected("not corrected")
    return evidence_of(state(answered, AttitudeConvention()))


@pytest.mark.parametrize("state", [state_quaternions, state_angles])
def test_a_roll_that_is_off_by_half_a_turn_fits_nothing_on_whichever_side_of_it_noise_puts_each_answer(state):
    sides = np.where(np.arange(60) // 3 % 2, 20.0, -20.0)
    found = search_convention(turned(np.outer(sides, [0, 0, 1]), state))
    assert len(found.fits) == 1


@pytest.mark.parametrize(
    ("over_a_minute_arcsec", "axis", "size_arcsec"),
    [(0.8, 1, 0.0), (5.0, 1, 5.0), (-200.0, 0, 200.0), (3000.0, 2, 300.0)],
)
def test_a_turn_that_changes_by_more_than_an_arcsec_counts_with_its_change(over_a_minute_arcsec, axis, size_arcsec):
    course = np.linspace(-0.5, 0.5, 60) * over_a_minute_arcsec
    found = search_convention(turned(np.outer(course, np.eye(3)[axis]), state_angles))
    assert found.nearest.size_arcsec == pytest.approx(size_arcsec, rel=0.05, abs=0.05)


def test_false_answers_do_not_count_among_right_ones():
    wild = np.zeros((60, 3))
    wild[4::9] = 3000.0
    found = search_convention(turned(wild, state_angles))
    assert found.nearest.size_arcsec < 0.01
    assert found.nearest.uncertainty_arcsec == pytest.approx(1.0, abs=1e-6)


def test_noise_of_a_minute_is_an_uncertainty_and_no_change():
    """Twenty blocks of three: the error of a mean of medians is at most that of the noise over the root of 20."""
    noise = np.random.default_rng(5).normal(0, 100.0, (60, 3)) * [1, 1, 0]
    found = search_convention(turned(noise, state_angles))
    assert 10 < found.nearest.uncertainty_arcsec < 100 / np.sqrt(20)
    assert found.nearest.size_arcsec < 3 * found.nearest.uncertainty_arcsec


@pytest.mark.parametrize(("over_a_minute_arcsec", "counts"), [(60.0, False), (100.0, True)])
def test_a_change_counts_beyond_five_times_its_own_error(over_a_minute_arcsec, counts):
    """Twenty blocks that lie 20 arcsec to either side: a slope over all is known to 20 * 1.054 / 1.357 arcsec."""
    course = np.linspace(-0.5, 0.5, 60) * over_a_minute_arcsec + np.where(np.arange(60) // 3 % 2, 20.0, -20.0)
    found = search_convention(turned(np.outer(course, [1, 0, 0]), state_angles))
    assert (found.nearest.size_arcsec > 50) is counts


def test_a_stated_convention_of_quaternions_is_among_those_that_fit_where_it_reads_them_alike():
    """Each reading has a twin with the scalar at the other end."""
    found = search_convention(sent(AttitudeConvention(), state_quaternions))
    quaternions = Rotation.random(4, rng=np.random.default_rng(2)).as_quat()
    right = read_quaternions(quaternions, AttitudeConvention())
    alike = 0
    for body_axes, reference_axes, conjugate in itertools.product(proper_axes(), proper_axes(), (False, True)):
        stated = AttitudeConvention(
            scalar="first", conjugate=conjugate, body_axes=body_axes, reference_axes=reference_axes
        )
        is_alike = np.abs(read_quaternions(quaternions, stated) - right).max() < 1e-6
        assert found.includes(stated) is bool(is_alike)
        assert not found.includes(dataclasses.replace(stated, frame="date"))
        alike += is_alike
    assert alike > 0


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


# Parts, by hand


@pytest.mark.parametrize(
    ("keys", "plainness"),
    [
        ({}, (0, 0, False)),
        ({"conjugate": True}, (0, 0, True)),
        ({"body_axes": "-x -y z"}, (1, 2, False)),  # two signs, in their order
        ({"body_axes": "-y x z"}, (1, 2, False)),  # one sign, and moved
        ({"reference_axes": "y z x"}, (1, 1, False)),
        ({"reference_axes": "-x -y z", "body_axes": "-z -y -x"}, (2, 6, False)),
        ({"reference_axes": "y z x", "body_axes": "z x y", "conjugate": True}, (2, 2, True)),
    ],
)
def test_the_plainest_convention_has_the_fewest_axes_that_are_not_x_y_z_then_the_fewest_signs_and_moves(
    keys, plainness
):
    assert _plainness(AttitudeConvention(**keys)) == plainness


def test_each_pair_of_axes_has_the_cosine_of_its_greatest_turn_in_a_few_answers():
    """Three of five answers count, each against the truth, by scipy's size of a rotation."""
    rng, words = np.random.default_rng(7), list(proper_axes())
    quaternions = Rotation.random(5, rng=rng).as_quat()
    true = Rotation.random(5, rng=rng).as_matrix()
    evidence, some = SentAnswers(UTC_NS[:5], quaternions, true, true, 1.0), np.array([0, 2, 4])
    found = _cosines(evidence, some, AttitudeConvention(frame="date", scalar="first"))
    assert found.shape == (24, 24)
    to_date = icrs_to_frame("date", UTC_NS[some])
    for body, reference in rng.integers(0, 24, (20, 2)).tolist():
        stated = AttitudeConvention(
            frame="date", scalar="first", body_axes=words[body], reference_axes=words[reference]
        )
        read = read_quaternions(quaternions[some], stated) @ to_date
        turns = Rotation.from_matrix(read @ true[some].transpose(0, 2, 1)).magnitude()
        assert found[body, reference] == pytest.approx(np.cos(turns.max()), abs=1e-12)


@pytest.mark.parametrize(("turned_deg", "is_near"), [(1.95, True), (2.05, False)])
def test_a_convention_is_tried_where_it_leaves_less_than_two_degrees(turned_deg, is_near):
    """Beyond that the axes of B1950 still leave less, which lie two thirds of a degree from those of ICRS."""
    evidence = sent(AttitudeConvention(), state_quaternions, body_arcsec=(0, 0, turned_deg * 3600), noise_arcsec=0)
    tried = list(_candidates(evidence))
    assert (AttitudeConvention() in tried) is is_near
    assert AttitudeConvention(frame="B1950") in tried


def test_where_none_leaves_so_little_the_best_of_each_frame_and_order_is_tried():
    evidence = sent(AttitudeConvention(), state_quaternions, body_arcsec=(10 * 3600, 0, 0), noise_arcsec=0)
    tried, words, some = list(_candidates(evidence)), list(proper_axes()), np.array([0, 14, 29, 44, 59])
    assert len({(one.frame, one.scalar, one.conjugate) for one in tried}) == len(tried) == 3 * 2 * 2
    for one in tried:
        cosines = _cosines(evidence, some, one)
        assert cosines[words.index(one.body_axes), words.index(one.reference_axes)] == cosines.max()


def test_five_answers_from_first_to_last_tell_which_conventions_are_searched():
    good = sent(AttitudeConvention(), state_quaternions)
    wild = good.sent.copy()
    others = np.setdiff1d(np.arange(60), [0, 14, 29, 44, 59])
    wild[others] = Rotation.random(len(others), rng=np.random.default_rng(4)).as_quat()
    assert list(_candidates(dataclasses.replace(good, sent=wild))) == list(_candidates(good))
    for row in (0, 14, 29, 44, 59):
        one = good.sent.copy()
        one[row] = wild[1]
        assert list(_candidates(dataclasses.replace(good, sent=one))) != list(_candidates(good))


def test_angles_have_each_frame_unit_sense_and_zero_and_without_a_roll_the_usual_one_alone():
    evidence = sent(AttitudeConvention(), state_angles)
    every = list(_candidates(evidence))
    assert len(set(every)) == len(every) == 3 * 2 * 2 * 4
    evidence.sent[7, 2] = np.nan
    without = list(_candidates(evidence))
    assert len(set(without)) == 3 * 2
    assert {(one.roll_through, one.roll_zero_deg) for one in without} == {("east", 0)}


@pytest.mark.parametrize(("count", "blocks"), [(10, 5), (11, 5), (38, 19), (40, 20), (100, 20)])
def test_a_turn_and_its_change_are_those_of_medians_of_up_to_twenty_blocks(count, blocks):
    """In whatever order answers came; a line through the medians by scipy."""
    rng = np.random.default_rng(count)
    course = np.linspace(-0.5, 0.5, count)
    turns = rng.normal(0, 2.0, (count, 3)) + np.outer(course, [60.0, 0.0, -45.0]) + [5.0, -7.0, 1.0]
    shuffled = rng.permutation(count)
    mean, change, error = _mean_and_change(UTC_NS[0] + shuffled, turns[shuffled])
    medians = np.array([np.median(part, axis=0) for part in np.array_split(turns, blocks)])
    place = np.linspace(-0.5, 0.5, blocks)
    lines = [scipy.stats.linregress(place, medians[:, axis]) for axis in range(3)]
    counts = [line.slope if abs(line.slope) > 5 * line.stderr + 1 else 0.0 for line in lines]
    scatter = max(line.stderr for line in lines) * np.sqrt((place**2).sum())
    assert mean == pytest.approx(medians.mean(axis=0))
    assert change == pytest.approx(np.linalg.norm(counts))
    assert error == pytest.approx(scatter / np.sqrt(blocks))
    assert counts[0] != 0.0 == counts[1]


def test_a_misfit_is_the_turn_with_a_tenth_of_that_about_the_boresight_and_its_change():
    steady = turned(np.tile([3.0, -4.0, 120.0], (60, 1)), state_angles)
    size, uncertainty = _misfit(steady, AttitudeConvention(), steady.true)
    assert size == pytest.approx(13.0, rel=1e-3)
    assert uncertainty == 1.0
    course = np.linspace(-0.5, 0.5, 60)
    moving = turned(np.tile([3.0, -4.0, 0.0], (60, 1)) + np.outer(course, [0, 0, 600.0]), state_angles)
    whole = 600 * 57 / 59 * 0.1  # from the middle of the first of twenty blocks to that of the last
    assert _misfit(moving, AttitudeConvention(), moving.true)[0] == pytest.approx(np.hypot(5.0, whole), rel=1e-3)
    assert _misfit(dataclasses.replace(steady, truth_arcsec=7.0), AttitudeConvention(), steady.true)[1] == 7.0


def test_without_a_roll_only_the_boresight_counts():
    evidence = turned(np.tile([3.0, -4.0, 120.0], (60, 1)), state_angles)
    evidence.sent[3, 2] = np.nan
    assert _misfit(evidence, AttitudeConvention(), evidence.true)[0] == pytest.approx(5.0, rel=1e-3)


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


@pytest.mark.parametrize(("count", "duration_s"), [(900, 60.0), (450, 44.9)])
def test_the_first_minute_of_a_session_tells_its_convention(count, duration_s):
    found = session_convention(with_answers(AttitudeConvention(), count))
    assert found.duration_s == pytest.approx(duration_s, abs=0.31)  # of three hundred answers, evenly
    assert found.answers <= 301


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
