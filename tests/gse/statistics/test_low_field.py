"""What is said where air parts the stars of a low field by more than an identifier allows."""

import re
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import session

from gse.config.choice import with_values
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.diagnosis.fine_findings import without_shaking
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import Finding
from gse.station.own_answers import by_other_stars_arcsec
from gse.station.results import AnswerCheck, Status, Subject
from gse.statistics.decision import Claim, Outcome, Row
from gse.statistics.excuses import AIR, Evidence, air_in_field
from gse.statistics.truth_budget import session_facts, truth_budget
from gse.values.axis import D_DE
from protocols import AttitudeMessage

FAILED = Row(Subject.ONBOARD, "availability", 0.1, "", 0.95, Outcome.FAIL, "availability: 4 of 40 frames")


def night(altitude_deg, answered=4):
    """Forty panoramas, most of them answered by the reference identifier alone."""
    mount = {"azimuth_deg": 140.0, "altitude_deg": altitude_deg, "roll_deg": 20.0}
    made = session(40, station=parse_station(with_values(BUILT_IN_TEXT, "mount", mount)))
    frames = made.frames.columns
    frames["status"][answered:] = STATUSES.index(Status.NO_MATCH)
    frames["answer_check"][answered:] = ANSWER_CHECKS.index(AnswerCheck.ABSENT)
    frames["matched"] = 16
    return made


def test_an_identifier_without_air_does_not_fail_for_it():
    row = AIR.applied_to(FAILED, Claim.ABSENCE, Evidence(night(16.0), {}))
    assert row.outcome is Outcome.INCONCLUSIVE
    assert "4 of 40 frames: air parts the stars of this low field by 5" in row.reason


@pytest.mark.parametrize(
    ("altitude_deg", "answered", "row", "claim"),
    [
        (50.0, 4, FAILED, Claim.ABSENCE),
        (16.0, 24, FAILED, Claim.ABSENCE),
        (16.0, 4, FAILED, Claim.FALSEHOOD),
        (16.0, 4, replace(FAILED, subject=Subject.SENSOR), Claim.ABSENCE),
    ],
)
def test_nothing_else_is_excused(altitude_deg, answered, row, claim):
    assert AIR.applied_to(row, claim, Evidence(night(altitude_deg, answered), {})) is row


def test_no_vibration_is_told_where_air_chooses_the_stars():
    found = (Finding("mount", "it is off"), Finding("vibration", "the boresight shakes"))
    assert without_shaking(found, night(16.0)) == found[:1]
    assert without_shaking(found, night(50.0)) == found


def test_a_vibration_alone_is_not_told_either_and_others_stay():
    shaking, mount = Finding("vibration", "the boresight shakes"), Finding("mount", "it is off")
    assert without_shaking((shaking,), night(16.0)) == ()
    assert without_shaking((mount,), night(16.0)) == (mount,)
    assert without_shaking((), night(16.0)) == ()


@pytest.mark.parametrize(("share", "is_told"), [(0.47, False), (0.53, True)])
def test_half_of_what_an_identifier_tolerates_is_too_much_air(share, is_told):
    """Whatever it tolerates: the pixels, two and more, are told to a tenth."""
    made = night(12.0)
    told = re.fullmatch(
        r"air parts the stars of this low field by (\d+) arcsec \(([\d.]+) px, rms\)", air_in_field(made)
    )
    arcsec, pixels = map(float, told.groups())
    assert pixels == pytest.approx(arcsec * 4169.905 / 206_264.8, abs=0.06)
    assert pixels >= 2
    identifier = replace(made.station.identifier, tolerance_px=pixels / share)
    made.station = made.station.model_copy(update={"identifier": identifier})
    assert air_in_field(made) == (told[0] if is_told else "")


def test_without_a_truth_nothing_is_known_of_the_air():
    made = night(16.0)
    made.earth_orientation = None
    assert air_in_field(made) == ""
    assert air_in_field(session(0)) == ""


def test_the_stars_that_a_sensor_takes_in_a_low_field_are_a_term_of_its_own_rows_alone():
    made = night(16.0)
    bare = truth_budget(session_facts(made, clock_error_s=0.01))
    assert bare.own_axes == bare.axes
    for row in made.frames.columns.rows()[:9]:
        made.sensor_attitudes.append(0, AttitudeMessage(int(row["time_us"]), 1.0, 2.0, 3.0, 0, 9, "acquired", 0.05))
    each_arcsec = by_other_stars_arcsec(made)
    budget = truth_budget(session_facts(made, clock_error_s=0.01))
    assert 10 < each_arcsec < 30
    assert budget.axes == bare.axes
    for axis in ("d_ra_cosde", "d_de"):
        both = np.hypot(budget.axes[axis].standard_arcsec, each_arcsec)
        assert budget.own_axes[axis].standard_arcsec == pytest.approx(both)
    assert budget.own_axes["d_roll"].standard_arcsec > 5 * each_arcsec
    assert budget.complaint(D_DE, 60.0, 3.0) is None
    line = budget.complaint(D_DE, 60.0, 3.0, own=True)
    assert line.startswith("the sensor's dDE: truth is known to ")
    assert "only, because of own choice of stars (" in line
    assert line.endswith("; point the sensor higher")
