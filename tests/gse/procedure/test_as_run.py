"""The as-run log: from steps to events, and from events to the log."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom
from skies.known_nights import session

from drivers.chunk import LinkEvent
from gse.procedure.as_run import StepOutcome, as_run, event_text, part_of, spread_of, starts, stretch
from gse.procedure.file import Watch
from gse.station.events import StationKind
from gse.station.housekeeping import ITEM, Housekeeping, parameter_differences
from gse.station.results import Verdict
from gse.values.instant import NS_PER_S
from gse.verdict.assessment import judge
from protocols import Item, load_protocol

BEGIN = LinkEvent(0, 0, StationKind.PROCEDURE, event_text("SS-TP-07", "A. Tester", "2"))
END = LinkEvent(90, 0, StationKind.PROCEDURE_ENDED, "the supply was left off")


def step(number, outcome, planned="power: on", seen="seen", by="", utc_ns=10):
    return [
        LinkEvent(utc_ns, 0, StationKind.STEP_BEGUN, event_text(number, planned)),
        LinkEvent(utc_ns + 5, 0, StationKind.STEP_DONE, event_text(number, outcome, planned, seen, by)),
    ]


FIELD = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]) | st.just(" "), min_size=1, max_size=40)


@given(FIELD, FIELD, FIELD)
def test_whatever_a_field_holds_the_log_has_it_in_its_place(planned, seen, by):
    log = as_run([BEGIN, *step("1", "PASS", planned, seen, by), END])
    (only,) = log.steps
    assert (only.number, only.outcome, only.from_ns, only.until_ns) == ("1", StepOutcome.PASS, 10, 15)
    for was, written in ((planned, only.planned), (seen, only.seen), (by, only.by)):
        assert written.replace("/", "|").split() == was.replace("/", "|").split()


def test_a_session_without_a_procedure_has_no_log():
    assert as_run([LinkEvent(0, 0, StationKind.NOTE, "clouds")]) is None


def test_rounds_stand_below_their_repeat_in_their_order():
    events = [e for n in ("2.10.1", "2.9.1", "2.1.1", "2", "1", "cleanup 1") for e in step(n, "PASS")]
    assert [one.number for one in as_run([BEGIN, *events]).steps] == ["1", "2", "2.1.1", "2.9.1", "2.10.1", "cleanup 1"]


@pytest.mark.parametrize(
    ("outcomes", "is_over", "verdict"),
    [
        (["PASS", "PASS"], True, Verdict.PASS),
        (["PASS", "FAIL", "not done"], True, Verdict.FAIL),
        (["PASS", "not done"], True, Verdict.INCONCLUSIVE),
        (["PASS", "INCONCLUSIVE"], True, Verdict.INCONCLUSIVE),
        (["PASS"], False, Verdict.INCONCLUSIVE),
        ([], True, Verdict.INCONCLUSIVE),
    ],
)
def test_the_verdict_is_that_of_the_steps(outcomes, is_over, verdict):
    events = [event for n, outcome in enumerate(outcomes) for event in step(str(n), outcome)]
    assert as_run([BEGIN, *events, *([END] if is_over else [])]).verdict is verdict


def test_a_session_that_ended_in_a_step_says_in_which():
    log = as_run([BEGIN, *step("1", "PASS"), step("2", "PASS")[0]])
    assert log.steps[1].outcome is StepOutcome.NOT_DONE
    assert log.steps[1].seen == "the session ended in this step"
    assert "the run did not come to its end" in log.reasons()[-1]
    assert log.power == "not known"


def test_deviations_are_notes_of_the_operator_and_steps_that_were_not_done():
    note = LinkEvent(50, 0, StationKind.NOTE, "Deviation: the dome was at 40 deg")
    log = as_run([BEGIN, note, *step("1", "not done"), END])
    assert log.deviations == ("the dome was at 40 deg", "step 1 was not done")


def test_a_watch_is_judged_by_its_own_stretch_and_limits():
    made = session()
    utc_ns = made.frames.columns["utc_ns"]
    middle_ns = int(utc_ns[len(utc_ns) // 2])
    planned = "watch: {for: 60s, limits: {output_rate_hz: 50}, requirements: {output rate: SS-1}}"
    begun, done = step("1", "PASS", planned, "frames")
    whole = [
        LinkEvent(int(utc_ns[0]) - 1, 0, begun.kind, begun.text),
        LinkEvent(middle_ns, 0, done.kind, done.text),
    ]
    made.events += [BEGIN, *whole, END]
    assert as_run(made.events).steps[0].watch == Watch(60.0, {"output_rate_hz": 50}, {"output rate": "SS-1"})
    assessment = judge(made)
    watched = assessment.procedure.watched["1"]
    assert watched.statistics.frames == len(utc_ns) // 2
    assert [row.name for row in watched.rows if row.outcome == "FAIL"] == ["output rate"]
    assert assessment.verdict is Verdict.FAIL
    assert assessment.procedure.log.steps[0].outcome is StepOutcome.FAIL
    words = f"{watched.reasons[0]}; PASS when it ended, FAIL by the whole session"
    assert assessment.procedure.log.steps[0].seen == f"frames: {words}"
    assert int(assessment.statistics.counted.used.sum()) <= len(utc_ns) // 2  # the rest is left out of the plots, too


def test_parameters_that_were_read_before_a_watch_are_none_of_its_business():
    made = session()
    test = made.station.test.model_copy(update={"parameters": {"threshold_counts": 120.0}})
    made.station = made.station.model_copy(update={"test": test})
    begin_ns, end_ns = (int(made.frames.columns["utc_ns"][at]) for at in (100, -1))
    item = Item("threshold_counts", "PARAMETERS", "threshold_counts", "", {}, False, 1.0)
    made.housekeeping = Housekeeping({item.name: item}, (item.name,))
    read = np.zeros(1, ITEM)
    read["utc_ns"], read["value"] = begin_ns - 1, 120.0
    made.housekeeping.extend(read)
    assert list(parameter_differences(made.housekeeping, made.station.test)) == []
    part = stretch(
        made,
        replace(as_run([BEGIN, *step("1", "PASS")]).steps[0], from_ns=begin_ns, until_ns=end_ns),
        Watch(60.0, {}, {}),
    )
    assert list(parameter_differences(part.housekeeping, part.station.test)) == []


def test_starts_have_their_first_panorama_and_their_first_answer():
    made = session()
    came_ns = made.frames.columns["host_utc_ns"]
    on_ns = int(came_ns[100]) - 3 * NS_PER_S // 2
    made.events += [
        LinkEvent(on_ns, 0, StationKind.POWER_ON, "on"),
        LinkEvent(on_ns + NS_PER_S, 0, StationKind.POWER_ON, "on again, which starts nothing"),
        LinkEvent(int(came_ns[200]), 0, StationKind.POWER_OFF, "off"),
        LinkEvent(int(came_ns[-1]) + 1, 0, StationKind.POWER_ON, "on"),
    ]
    first, last = starts(made)
    behind_ns = came_ns[(came_ns >= on_ns)]
    assert first.boot_s == (behind_ns.min() - on_ns) / NS_PER_S
    assert first.first_fix_s >= first.boot_s
    assert math.isnan(last.boot_s)
    assert math.isnan(last.first_fix_s)


@pytest.mark.parametrize("n", [1, 30, 58, 59, 93, 400])
def test_the_bound_of_the_starts_holds_with_95_percent(n):
    """By its definition: the chance that the bound lies below the 95 % quantile is at most 5 %, and no smaller
    value of the sample has that."""
    spread = spread_of([float(value) for value in range(1, n + 1)])
    if spread["p95_bound_s"] is None:
        assert n < 59
        return
    rank = int(spread["p95_bound_s"])
    assert binom.sf(rank - 1, n, 0.95) <= 0.05 < binom.sf(rank - 2, n, 0.95)


def test_a_start_without_an_answer_is_longer_than_all_others():
    assert spread_of([1.0, 2.0, math.nan])["median_s"] == 2.0
    assert spread_of([math.nan] * 3)["median_s"] is None
    assert spread_of([])["n"] == 0


def test_a_stretch_has_the_items_that_came_in_it():
    made = session()
    protocol = load_protocol("panorama-v1")
    made.housekeeping = Housekeeping(protocol.items)
    number = list(protocol.items).index("supply_v")
    came = np.zeros(3, ITEM)
    came["utc_ns"], came["value"], came["item"] = [10, 20, 30], [4.0, 5.0, 6.0], number
    made.housekeeping.extend(came)
    part = part_of(made, 15, 30, made.station)
    assert list(part.housekeeping.rows["value"]) == [5.0]
    assert part.housekeeping.summaries["supply_v"].count == 1
