"""The table of requirements: what an entry says reaches whoever needs it."""

import json
import math
import sys
import xml.etree.ElementTree as ET
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from skies.known_nights import STATION, session

from drivers.chunk import LinkEvent
from gse.catalog.stars import ListedStars
from gse.recording.session_format import PowerReading
from gse.report.files import junit_xml
from gse.report.summary import summarise
from gse.sessions.forecast import forecast_text
from gse.station.events import StationKind
from gse.station.housekeeping import ITEM, Housekeeping
from gse.station.results import Subject, Verdict
from gse.station.star_names import STAR_NAME, StarNames
from gse.statistics.decision import Outcome
from gse.statistics.subject_statistics import figure_of
from gse.values.instant import NS_PER_S
from gse.values.limits import Limits
from gse.verdict import session_plan
from gse.verdict.assessment import judge
from gse.verdict.requirements import (
    REQUIREMENTS,
    ByBounds,
    Case,
    ExpectedSession,
    not_planned,
    requirement_named,
    requirement_of,
)
from gse.verdict.session_comparison import session_comparison
from gse.verdict.session_plan import plan_like, rows_left
from protocols import Item

DOCS = Path(__file__).parents[3] / "docs"
LIMITS = replace(
    STATION.limits,
    boresight_arcsec=90.0,
    x_arcsec=90.0,
    y_arcsec=91.0,
    about_arcsec=900.0,
    confidence=0.9,
    output_rate_hz=1.0,
    first_fix_s=5.0,
    slew_deg_per_s=0.5,
    mean_current_a=0.5,
    inrush_current_a=1.0,
    rate_bias_arcsec_per_s=20.0,
    rate_noise_arcsec_per_s=5.0,
    wrong_names_share=0.05,
)
"""With a limit for every row."""
LIMITED = STATION.model_copy(update={"limits": LIMITS})


@pytest.fixture(scope="module")
def judged():
    made = session(station=LIMITED)
    begun_ns = int(made.frames.columns["utc_ns"][0])
    made.events.append(LinkEvent(begun_ns, 0, StationKind.POWER_ON, "relay on"))
    made.power += [PowerReading(begun_ns, 0.9), PowerReading(begun_ns + 60 * NS_PER_S, 0.4)]
    made.housekeeping = Housekeeping({"rate_x": Item("rate_x", "RATE", "rate_x", "arcsec/s", {}, False, 1.0)})
    rates = np.zeros(2000, ITEM)
    rates["value"] = np.random.default_rng(1).normal(0, 1, len(rates))
    made.housekeeping.extend(rates)
    names = np.zeros(200, STAR_NAME)
    names["list"], names["number"] = np.arange(200), 7
    made.stars = ListedStars("Gaia DR3", np.array([7]), np.zeros(1))
    made.star_names = StarNames(names)
    return made, judge(made)


def entries():
    return pytest.mark.parametrize("requirement", REQUIREMENTS, ids=lambda requirement: requirement.name)


def test_the_page_of_metrics_has_the_table_of_today():
    sys.path.insert(0, str(DOCS))
    try:
        import make_requirements
    finally:
        sys.path.pop(0)
    assert make_requirements.PAGE.read_text() == make_requirements.page(), "run: python docs/make_requirements.py"


NO_ROW = {"decision", "false_arcsec", "confidence", "items"}
"""The rule, the number by which an answer is false, a share of frames: no figure is compared with them. The rows of
``items`` have the names of a sensor's items (``item_requirements``)."""


def test_every_limit_is_asked_for_by_a_row():
    assert {requirement.limit for requirement in REQUIREMENTS} == {one.name for one in fields(Limits)} - NO_ROW


@entries()
def test_each_entry_has_a_limit_above(requirement):
    assert getattr(LIMITS, requirement.limit) is not None, f"give LIMITS above a {requirement.limit}"


@entries()
def test_an_entry_is_a_row_of_the_verdict_of_each_subject_that_it_applies_to(judged, requirement):
    _, assessment = judged
    rows = [row for row in assessment.rows if row.name == requirement.name]
    subjects = [of for of in assessment.statistics.subjects.values() if requirement.applies(of)]
    assert [row.subject for row in rows] == [of.subject for of in subjects]
    for row in rows:
        assert requirement_of(row) is requirement_named(row.name) is requirement
        assert (row.unit, row.limit) == (requirement.unit, getattr(LIMITS, requirement.limit))
        assert row.outcome is (Outcome.NOT_TESTED if requirement.name == "slew rate" else Outcome.PASS)


@entries()
def test_an_entry_is_in_the_report_and_a_test_case_of_junit(judged, requirement):
    made, assessment = judged
    report = summarise(made, assessment)
    asked = any(requirement.applies(of) for of in assessment.statistics.subjects.values())
    assert (requirement.name in {item["name"] for item in report["measurements"]}) is asked
    cases = {case.get("name") for case in ET.fromstring(junit_xml(json.loads(json.dumps(report)))).iter("testcase")}
    assert (requirement.name in cases) is asked


@entries()
def test_the_forecast_waits_for_the_row_of_each_entry(judged, requirement):
    """A row that is left says how long; the forecast of the session says the same."""
    _, assessment = judged
    row = next((row for row in assessment.rows if row.name == requirement.name), None)
    if row is None:
        return
    open_row = replace(row, outcome=Outcome.INCONCLUSIVE, value=row.limit, uncertainty=math.nan, n_eff=4.0)
    left = rows_left(replace(assessment, verdict=Verdict.INCONCLUSIVE, rows=(open_row,)))
    assert [item.requirement for item in left] == [requirement]
    others = [row for row in assessment.rows if row.name != requirement.name]
    text = forecast_text(replace(assessment, verdict=Verdict.INCONCLUSIVE, rows=(*others, open_row)))
    assert ("too early" in text) is math.isnan(left[0].minutes)


def test_a_session_like_another_is_planned_for_every_row_that_is_judged(judged):
    _, assessment = judged
    plan = plan_like(assessment, Subject.ONBOARD, LIMITS)
    likewise = [one.name for one in REQUIREMENTS if one.plan is None]
    names = ["dRA*", "dDE", "roll", *likewise, "availability", "false answers"]
    assert [row.name for row in plan.rows] == names
    cone = plan.rows[3]
    assert (cone.limit, cone.unit, cone.frames) == (90.0, "arcsec", assessment.statistics.frames)


@pytest.mark.parametrize(
    ("value", "outcome", "frames"),
    [(80.0, Outcome.INCONCLUSIVE, "more"), (99.0, Outcome.INCONCLUSIVE, None), (99.0, Outcome.FAIL, None)],
)
def test_a_row_without_a_plan_of_its_own_needs_what_a_session_like_it_needs(judged, value, outcome, frames):
    _, assessment = judged
    changed = tuple(
        replace(row, value=value, outcome=outcome, uncertainty=20.0, truth_uncertainty=0.0)
        if row.name.startswith("half-cone")
        else row
        for row in assessment.rows
    )
    plan = plan_like(replace(assessment, rows=changed), Subject.ONBOARD, LIMITS)
    (cone,) = (row for row in plan.rows if row.name.startswith("half-cone"))
    assert cone.frames is None if frames is None else cone.frames > 3 * assessment.statistics.frames


def test_a_row_of_bounds_that_is_not_planned_leaves_the_plan_of_the_others_as_it_is(judged, monkeypatch):
    _, assessment = judged
    before = plan_like(assessment, Subject.ONBOARD, LIMITS)

    def not_planned_cone(row):
        found = requirement_of(row)
        cone = ByBounds(lambda subject, s: figure_of(subject.half_cone_95, "p95_abs", s))
        return replace(found, decided=cone, plan=not_planned) if row.name.startswith("half-cone") else found

    monkeypatch.setattr(session_plan, "requirement_of", not_planned_cone)
    after = plan_like(assessment, Subject.ONBOARD, LIMITS)
    assert after.rows == tuple(row for row in before.rows if not row.name.startswith("half-cone"))


def test_a_row_without_a_limit_is_neither_tested_nor_planned_nor_compared():
    made = session()
    assessment = judge(made)
    cone = next(row for row in assessment.rows if row.name.startswith("half-cone"))
    assert cone.outcome is Outcome.NOT_TESTED
    assert not any(row.name == cone.name for row in plan_like(assessment, Subject.ONBOARD, STATION.limits).rows)
    assert not any(row.name == cone.name for row in session_comparison(made, made).rows)


def test_a_row_without_a_comparison_of_its_own_is_compared_by_its_bounds():
    """Of other panoramas; of the same ones nothing follows from bounds that hold for each alone."""
    first, second = session(station=LIMITED), session(station=LIMITED, bias=(40.0, 0.0, 0.0), seed=2)
    second.frames.columns["time_us"][:] += 10**12
    (found,) = (row for row in session_comparison(first, second).rows if row.name.startswith("half-cone"))
    assert found.second > found.first + 30
    assert found.worse
    second.frames.columns["time_us"][:] -= 10**12
    (same,) = (row for row in session_comparison(first, second).rows if row.name.startswith("half-cone"))
    assert math.isnan(same.sigmas)
    assert not same.worse


def test_each_limit_that_is_planned_moves_its_plan():
    """A plan reads its own limit: a wider one never needs more frames."""
    for key, wide in (("availability", 0.5), ("false_share", 0.2)):
        plans = [
            [row.frames for requirement in REQUIREMENTS if (row := requirement.planned(asked))]
            for asked in (
                ExpectedSession((), Limits(), 0.97, 10.0),
                ExpectedSession((), replace(Limits(), **{key: wide}), 0.97, 10.0),
            )
        ]
        assert sum(one != other for one, other in zip(*plans, strict=True)) == 1


OPTIONAL = [one for one in REQUIREMENTS if one.only_asked]


def test_rows_that_only_some_sensors_are_specified_by_leave_no_trace_without_a_limit():
    made = session()
    report = summarise(made, judge(made))
    text = json.dumps([report["measurements"], report["not_tested"]])
    assert [one.name for one in OPTIONAL if one.name in text] == []
    assert OPTIONAL


def test_a_limit_along_one_axis_of_the_sensor_asks_for_that_row_alone():
    made = session(station=STATION.model_copy(update={"limits": replace(STATION.limits, y_arcsec=60.0)}))
    assert [row.name for row in judge(made).rows if requirement_of(row).only_asked] == ["|y| at its confidence"]


def test_a_share_of_997_in_1000_frames_needs_998_of_them():
    tight = STATION.model_copy(update={"limits": replace(STATION.limits, x_arcsec=60.0)})
    few, enough = (judge(session(count, station=tight)) for count in (900, 1100))
    outcomes = [row.outcome for one in (few, enough) for row in one.rows if row.name == "|x| at its confidence"]
    assert outcomes == [Outcome.INCONCLUSIVE, Outcome.PASS]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("output rate", {"output_rate_hz": (0.99, 0.9995, 2.0, math.nan)}),
        ("first fix", {"first_fixes_s": ((1.0, 5.5), (1.0, 5.0), (0.0,), ())}),
    ],
)
def test_a_counted_value_keeps_its_limit_or_does_not(judged, name, values):
    _, assessment = judged
    budget, stats = assessment.budget, assessment.statistics
    ((field, given),) = values.items()
    subjects = (replace(stats.onboard, **{field: value}) for value in given)
    rows = [requirement_named(name).row(Case(one, stats, budget, LIMITS, False)) for one in subjects]
    assert [row.outcome for row in rows] == [Outcome.FAIL, Outcome.PASS, Outcome.PASS, Outcome.NOT_TESTED]
    assert f"the limit is {rows[0].limit:g}" in rows[0].reason


def test_a_start_without_any_fix_never_came(judged):
    _, assessment = judged
    subject = replace(assessment.statistics.onboard, first_fixes_s=(0.5, math.nan))
    row = requirement_named("first fix").row(Case(subject, assessment.statistics, assessment.budget, LIMITS, False))
    assert (row.outcome, row.reason) == (Outcome.FAIL, "onboard first fix never came, the limit is 5 s")
