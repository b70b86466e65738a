"""The table of excuses: each entry does what it says, and no more."""

from types import SimpleNamespace

import numpy as np
import pytest
from skies.known_nights import START_NS, session

from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.exclusions import Cause, Exclusion
from gse.station.results import AnswerCheck, Status, Subject
from gse.statistics.counted_frames import counted_frames
from gse.statistics.decision import Claim, Outcome, Row
from gse.statistics.excuses import EXCUSES, LEFT_OUT, Evidence, Excuse, excused, excusing
from gse.values.instant import NS_PER_S

ABSENT, FALSE, WRONG = range(3)
"""Frames without an answer, with an answer of other stars, and far off by the clock alone."""


def entries(table):
    return pytest.mark.parametrize("entry", table, ids=lambda entry: getattr(entry, "cause", None) or entry.name)


def test_every_cause_of_a_stretch_has_its_entry():
    assert [entry.cause for entry in LEFT_OUT] == list(Cause)


@entries(LEFT_OUT)
def test_a_stretch_excuses_what_its_entry_says(entry):
    made = session(100)
    frames = made.frames.columns
    frames["status"][ABSENT] = STATUSES.index(Status.NO_MATCH)
    frames["answer_check"][FALSE] = ANSWER_CHECKS.index(AnswerCheck.FALSE)
    made.excluded = (Exclusion(START_NS, START_NS + NS_PER_S, "so it is", entry.cause, 10.0),)
    counted = counted_frames(made)
    assert counted.used[WRONG] == (Claim.ACCURACY not in entry.excuses)
    assert counted.expected[ABSENT] == (Claim.ABSENCE not in entry.excuses)
    assert counted.false[FALSE]
    assert counted.used[10:].all()


def test_no_stretch_excuses_an_answer_of_other_stars():
    stretches = [Exclusion(0, 1, "", cause) for cause in Cause]
    assert excusing(Claim.FALSEHOOD, stretches) == []


def row_of(subject=Subject.ONBOARD, outcome=Outcome.FAIL):
    return Row(subject, "a row", 1.0, "", 0.5, outcome, "too much")


@pytest.mark.parametrize("outcome", list(Outcome))
@pytest.mark.parametrize("subject", list(Subject))
@pytest.mark.parametrize("claim", list(Claim))
@entries(EXCUSES)
def test_an_entry_touches_only_what_it_says(entry, claim, subject, outcome):
    """Its reason is there; of all rows only one that fails, of its subjects and claims, is undecided.

    Where answers are absent, one that is not decided has the reason too.
    """
    there = Excuse(entry.name, lambda *_: "it was so", entry.excuses, entry.says, entry.subjects)
    row = row_of(subject, outcome)
    found = there.applied_to(row, claim, Evidence(SimpleNamespace(), {}))
    open_to = {Outcome.FAIL, *([Outcome.INCONCLUSIVE] if claim is Claim.ABSENCE else [])}
    if outcome in open_to and claim in entry.excuses and subject in entry.subjects:
        assert (found.outcome, found.reason) == (Outcome.INCONCLUSIVE, "too much: it was so")
    else:
        assert found is row


def test_slowness_has_no_excuse_but_a_lost_station_file_and_falsehood_none_of_the_sky():
    assert [entry.name for entry in EXCUSES if Claim.SLOWNESS in entry.excuses] == ["station file"]
    assert [entry.name for entry in EXCUSES if Claim.FALSEHOOD in entry.excuses] == ["station file", "camera", "set-up"]


@pytest.mark.parametrize("claim", list(Claim))
def test_nothing_is_excused_in_a_clear_session(claim):
    made, row = session(50), row_of()
    available = SimpleNamespace(count=40, of=50)
    assert excused(row, claim, Evidence(made, dict.fromkeys(Subject, available))) is row


def test_the_frames_of_a_stretch_are_those_within_it():
    made = session(100)
    made.excluded = (Exclusion(START_NS + NS_PER_S, START_NS + 2 * NS_PER_S, "wind", Cause.OPERATOR),)
    assert np.flatnonzero(~counted_frames(made).expected).tolist() == list(range(10, 20))
