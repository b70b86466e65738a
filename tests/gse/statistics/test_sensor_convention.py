"""The convention of a session's own answers: which answers are taken, what is said, how well truth is known."""

import copy
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skies.known_nights import START_NS, STATION
from skies.known_nights import session as night
from skies.own_answers import with_answers, without_error

from gse.station.columns import ANSWER_CHECKS, FRAME, STATUSES
from gse.station.results import AnswerCheck, Status, Subject
from gse.station.session_tables import OWN_ANSWER
from gse.statistics.sensor_convention import (
    ConventionFit,
    ConventionSearch,
    _confirmed,
    _first,
    _mount_arcsec,
    _sent,
    convention_finding,
    evidence_of,
    in_words,
    is_wrong,
    session_convention,
    words_of,
)
from gse.truth import Alignment, small_rotations
from gse.truth.orientation import FIRST_NS
from gse.values.attitude_convention import AttitudeConvention, from_angles
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_S
from gse.values.mount import InertialDirection, InertialUncertainty, Mount, MountUncertainty
from gse.values.site import Site, SiteUncertainty

AS_STATED = AttitudeConvention()
OF_DATE = AttitudeConvention(frame="date")


def search(*conventions, aberration="not told", quaternions=False, roll_sent=True):
    fits = tuple(ConventionFit(one, 1.0 + place, 0.5) for place, one in enumerate(conventions))
    nearest = fits[0] if fits else ConventionFit(AS_STATED, 9999.0, 1.0)
    return ConventionSearch(60, 59.0, fits, nearest, aberration, 19.46, quaternions, roll_sent)


# Which answers


@pytest.mark.parametrize(
    ("count", "step"), [(1, 1), (300, 1), (301, 2), (600, 2), (601, 3)], ids=["one", "300", "301", "600", "601"]
)
def test_of_more_than_300_answers_every_second_or_third_is_taken_in_their_order(count, step):
    utc_ns = 10**18 + np.arange(2000) * NS_PER_S
    rows = np.arange(50, 50 + count)
    assert _first(utc_ns, rows, 1e6).tolist() == list(range(50, 50 + count, step))


def test_the_first_seconds_begin_with_the_earliest_answer_and_their_end_belongs_to_them():
    """The clock stepped back after the third."""
    seconds = np.array([10.0, 11.0, 12.0, 4.0, 5.0, 6.499999999, 6.5, 6.500000001])
    utc_ns = 10**18 + np.round(seconds * NS_PER_S).astype(np.int64)
    assert _first(utc_ns, np.arange(8), 2.5).tolist() == [3, 4, 5, 6]
    assert _first(utc_ns, np.array([0, 1, 2]), 1.0).tolist() == [0, 1]


def test_stars_confirm_an_answer_that_was_identified_with_a_roll_and_not_falsely():
    frames = np.zeros(5, dtype=FRAME)
    frames["status"] = STATUSES.index(Status.IDENTIFIED)
    checks = AnswerCheck.CORRECT, AnswerCheck.UNKNOWN, AnswerCheck.FALSE, AnswerCheck.CORRECT, AnswerCheck.CORRECT
    frames["answer_check"] = [ANSWER_CHECKS.index(check) for check in checks]
    frames["status"][3] = STATUSES.index(Status.NO_MATCH)
    frames["roll_deg"][4] = np.nan
    assert _confirmed(frames).tolist() == [True, True, False, False, False]


def test_angles_are_taken_where_all_answers_have_them_and_else_quaternions():
    answers = np.zeros(3, dtype=OWN_ANSWER)
    answers["ra_deg"], answers["de_deg"], answers["roll_deg"] = [1, 2, 3], [4, 5, 6], [7, 8, 9]
    answers["q1"] = 0.5
    assert _sent(answers).tolist() == [[1, 4, 7], [2, 5, 8], [3, 6, 9]]
    answers["ra_deg"][1] = np.nan
    assert _sent(answers).shape == (3, 4)
    assert 0.5 in _sent(answers)[0]


# The answers beside the truth


@pytest.fixture(scope="module")
def answered():
    """A second between 24 panoramas, all of them identified, with answers of the mean of the field."""
    made = night(24, step_s=1.0)
    angles = without_error(made, whole_field=True)
    for name, values in zip(("ra_deg", "de_deg", "roll_deg"), angles.T, strict=True):
        made.frames.columns[name] = values
    return with_answers(made, angles, np.full(24, 9))


@pytest.fixture
def copied(answered):
    """One that a test may change."""
    return copy.deepcopy(answered)


BY_STARS, BY_MOUNT = 1.0, 5 * math.sqrt(3)
"""How well truth is known, in arcsec."""


@pytest.mark.parametrize(("confirmed", "truth_arcsec", "count"), [(10, BY_STARS, 10), (9, BY_MOUNT, 24)])
def test_ten_confirmed_panoramas_are_the_truth_of_their_answers_and_else_the_mount_is(
    copied, confirmed, truth_arcsec, count
):
    copied.frames.columns["answer_check"][confirmed:] = ANSWER_CHECKS.index(AnswerCheck.FALSE)
    found = evidence_of(copied)
    assert found.truth_arcsec == pytest.approx(truth_arcsec)
    assert found.utc_ns.tolist() == copied.frames.columns["utc_ns"][:count].tolist()


def test_a_sensor_without_panoramas_is_compared_with_the_mount(copied):
    copied.subject = Subject.SENSOR
    assert evidence_of(copied).truth_arcsec == pytest.approx(BY_MOUNT)


@pytest.mark.parametrize("by_mount", [False, True])
def test_answers_of_the_mean_of_the_field_leave_nothing_where_aberration_is_left_in(copied, by_mount):
    """Taken out, it is that of the Earth on its orbit, 20.5 arcsec at most."""
    if by_mount:
        copied.subject = Subject.SENSOR
    found = evidence_of(copied)
    measured = from_angles(*found.sent.T)
    assert np.abs(small_rotations(measured, found.true[0])[0]).max() / ARCSEC_RAD < 0.01
    apart = [Rotation.from_matrix(one @ two.T).magnitude() / ARCSEC_RAD
             for one, two in zip(found.true, found.true_corrected, strict=True)]  # fmt: skip
    assert np.ptp(apart) < 0.1
    assert 15 < apart[0] < 20.6


def test_answers_that_are_not_acquired_and_those_before_all_truth_are_left_out(copied):
    copied.sensor_attitudes.columns["acquired"][3] = False
    copied.frames.columns["utc_ns"][:2] = [FIRST_NS - 1, FIRST_NS]
    found = evidence_of(copied, seconds=2e9)
    at = (copied.frames.columns["utc_ns"] - START_NS) / NS_PER_S
    assert ((found.utc_ns - START_NS) / NS_PER_S).tolist() == [at[1], at[2], *at[4:]]


@pytest.mark.parametrize(("seconds", "count"), [(11.0, 12), (60.0, 24), (5.0, 6)])
def test_the_seconds_that_are_asked_for_are_searched(copied, seconds, count):
    for subject in (Subject.ONBOARD, Subject.SENSOR):
        copied.subject = subject
        assert len(evidence_of(copied, seconds).utc_ns) == count
        assert len(evidence_of(copied).utc_ns) == 24


def test_a_minute_is_searched_where_nothing_is_said(copied):
    """The last answer of it is a second before the end, the next two after it."""
    seconds = np.r_[np.arange(20.0), 59.0, 60.0, 60.001, 61.0]
    copied.frames.columns["utc_ns"] = START_NS + np.round(seconds * NS_PER_S).astype(np.int64)
    assert len(evidence_of(copied).utc_ns) == 22


def test_without_truth_or_answers_nothing_is_compared(copied):
    few = replace(copied, earth_orientation=None)
    few.subject = Subject.SENSOR
    assert evidence_of(few) is None
    assert session_convention(few) is None
    copied.subject = Subject.SENSOR
    copied.sensor_attitudes.columns["acquired"] = False
    assert evidence_of(copied) is None


def test_the_convention_of_a_session_is_that_of_its_answers(answered):
    found = session_convention(answered)
    assert found.answers == 24
    assert found.includes(AS_STATED)
    assert session_convention(answered, seconds=5.0) is None  # six answers are too few


# How well truth is known


def session(*, alignment=None, mount=None, vertical_arcsec=0.0):
    site = Site(latitude_deg=0.0, longitude_deg=0.0, uncertainty=SiteUncertainty(vertical_arcsec=vertical_arcsec))
    return SimpleNamespace(alignment=alignment, station=SimpleNamespace(mount=mount or Mount(), site=site))


def test_a_stated_mount_is_known_to_half_of_what_its_angles_and_the_vertical_leave():
    """Two, three and six arcsec are seven; half of a half-width of 95 % is a standard uncertainty."""
    mount = Mount(uncertainty=MountUncertainty(azimuth_arcsec=2.0, altitude_arcsec=3.0, roll_arcsec=500.0))
    assert _mount_arcsec(session(mount=mount, vertical_arcsec=6.0)) == pytest.approx(3.5)


def test_a_fitted_mount_is_known_as_its_fit_is_across_the_boresight():
    covariance = ((9.0, 0.0, 0.0), (0.0, 16.0, 0.0), (0.0, 0.0, 900.0))
    fit = Alignment(Mount(), covariance, (1.0, 1.0, 1.0), 9, 0, 0, 1)
    assert _mount_arcsec(session(alignment=fit)) == pytest.approx(5.0)


def test_a_star_simulator_is_known_as_its_direction_is():
    shown = InertialDirection(
        ra_deg=10.0, de_deg=20.0, uncertainty=InertialUncertainty(across_arcsec=8.0, roll_arcsec=99.0)
    )
    assert _mount_arcsec(session(mount=Mount(inertial=shown))) == pytest.approx(4.0)


# What is said


@pytest.mark.parametrize(
    ("found", "wrong"),
    [(None, False), (search(), False), (search(AS_STATED), False), (search(OF_DATE, AS_STATED), False),
     (search(OF_DATE), True), (replace(search(OF_DATE), explained=0.95), True),
     (replace(search(OF_DATE), explained=0.94), False)],
)  # fmt: skip
def test_a_stated_convention_is_wrong_where_others_fit_and_it_does_not(found, wrong):
    assert is_wrong(found, AS_STATED) is wrong


@pytest.mark.parametrize(
    ("found", "cause"),
    [
        (None, None),
        (search(), None),
        (search(OF_DATE), "sensor convention"),
        (search(OF_DATE, aberration="corrected"), "sensor convention"),
        (replace(search(OF_DATE, aberration="corrected"), explained=0.9), None),
        (search(AS_STATED), None),
        (search(AS_STATED, aberration="not corrected"), None),
        (search(AS_STATED, aberration="corrected"), "sensor aberration"),
    ],
)
def test_a_convention_that_is_not_as_stated_has_a_finding(found, cause):
    findings = list(convention_finding(found, AS_STATED))
    assert [finding.cause for finding in findings] == ([] if cause is None else [cause])
    assert not any(finding.is_gross for finding in findings)
    if cause == "sensor convention":
        assert findings[0].size.endswith("another one than the station file states: RA in degrees, of date")
    if cause == "sensor aberration":
        assert findings[0].size == (
            "it is corrected in its answers, the station file states not corrected: 19.5 arcsec here"
        )


def test_four_conventions_that_fit_are_told():
    zeros = [replace(AS_STATED, roll_zero_deg=zero) for zero in (0, 90, 180, 270)]
    west = replace(AS_STATED, roll_through="west")
    words = words_of(search(*zeros, west))
    assert words.count("RA in degrees") == 4
    assert words.endswith(", or RA in degrees, in ICRS or J2000, roll through east from 270 deg")


@pytest.mark.parametrize(
    ("convention", "words"),
    [
        (replace(AS_STATED, frame="B1950"), "RA in degrees, of B1950 (FK4)"),
        (replace(AS_STATED, roll_through="west", roll_zero_deg=180),
         "RA in degrees, in ICRS or J2000, roll through west from 180 deg"),
        (replace(AS_STATED, ra_unit="h"), "RA in hours, in ICRS or J2000"),
    ],
)  # fmt: skip
def test_angles_are_told_with_the_roll_where_it_is_not_the_usual_one(convention, words):
    assert in_words(convention, search(convention)) == words
    assert in_words(convention, search(convention, roll_sent=False)) == words.split(", roll")[0]


def test_truth_of_the_built_in_station_is_known_to_nine_arcsec():
    """Three half-widths of ten arcsec."""
    assert _mount_arcsec(SimpleNamespace(alignment=None, station=STATION)) == pytest.approx(5 * math.sqrt(3))
