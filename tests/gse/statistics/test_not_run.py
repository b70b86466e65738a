"""Frames that are lost while this computer does not run the station."""

from collections.abc import Sequence

import numpy as np
import pytest
from devices.injected_clocks import InjectedClocks, Sky
from skies.known_nights import START_NS, session

from drivers.chunk import Chunk, LinkEvent, LinkKind
from gse.station.loop import StationLoop
from gse.station.results import Subject, Verdict
from gse.station.session_data import SessionData
from gse.statistics.decision import Claim, Outcome, Row
from gse.statistics.excuses import STOP, Evidence, lost_while_not_run
from gse.statistics.session_statistics import statistics
from gse.values.instant import NS_PER_S
from gse.verdict.assessment import judge

HELD = 5
"""Frames that the port holds while nobody reads it."""


@pytest.fixture(scope="module")
def sky() -> Sky:
    return Sky()


def session_of(sky: Sky, stopped: range, told: bool, others: Sequence[int] = ()) -> SessionData:
    """A session without the frames of some numbers, and an event where the station runs again."""
    items: list[Chunk | LinkEvent] = []
    resumed: Chunk | None = None
    chunks = list(sky.chunks(InjectedClocks(), (0.0, 0.0), None, False))
    for number, chunk in enumerate(chunks):
        if number in others or number in stopped[HELD:]:
            continue
        if number in stopped[:HELD]:  # read at the end of the stop
            resumed = chunks[stopped.stop]
            chunk = Chunk(resumed.utc_ns - 50_000_000, resumed.mono_ns - 50_000_000, chunk.data)
            if number == stopped.start and told:
                items.append(LinkEvent(chunk.utc_ns, chunk.mono_ns, LinkKind.NOT_RUN, "for 6.0 s"))
        items.append(chunk)
    loop = StationLoop(sky.setup)
    loop.take(items)
    loop.finish()
    return loop.session


def test_what_is_lost_in_a_stop_of_the_station_is_not_held_against_the_sensor(sky: Sky) -> None:
    stopped = range(100, 200)
    session = session_of(sky, stopped, told=True)
    assert lost_while_not_run(session) == len(stopped) - HELD == session.panoramas_lost
    assessment = judge(session)
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("95 were lost while this computer did not run" in reason for reason in assessment.reasons)
    assert any(finding.cause == "station stopped" for finding in assessment.findings)


def test_the_same_loss_without_a_stop_is_an_outage_of_the_sensor(sky: Sky) -> None:
    assessment = judge(session_of(sky, range(100, 200), told=False))
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("1 outage of 95 frames, too few events to tell" in reason for reason in assessment.reasons)


def test_a_stop_excuses_no_frames_that_were_lost_elsewhere(sky: Sky) -> None:
    others = [*range(20, 80), *range(250, 350)]  # before the stop, and long after it
    session = session_of(sky, range(100, 130), told=True, others=others)
    assert lost_while_not_run(session) == 25
    assert judge(session).verdict is Verdict.FAIL


def interrupted(*, before_ns=0, gap_s=5.0, lost=9):
    """Forty frames, one in a second but for a pause before the middle one, so long after the station ran again."""
    made = session(40, noise=1.0)
    frames, seconds = made.frames.columns, np.arange(40) + (gap_s - 1) * (np.arange(40) >= 20)
    frames["host_utc_ns"] = START_NS + np.round(seconds * NS_PER_S).astype(np.int64)
    frames["time_us"] = np.round(seconds * 1e6).astype(np.uint64)
    made.link.frames_lost = lost
    at_ns = int(frames["host_utc_ns"][20]) - before_ns
    made.events.append(LinkEvent(at_ns, 0, LinkKind.NOT_RUN, "the station was stopped"))
    return made


@pytest.mark.parametrize(
    ("values", "lost"),
    [
        ({}, 4),
        ({"gap_s": 5.4}, 4),
        ({"gap_s": 5.6}, 5),
        ({"gap_s": 1.0}, 0),
        ({"lost": 3}, 3),
        ({"lost": 0}, 0),
        ({"before_ns": 5 * NS_PER_S - 1}, 4),
        ({"before_ns": 5 * NS_PER_S}, 0),
        ({"before_ns": -1}, 0),
    ],
)
def test_whole_frames_that_are_missing_within_five_seconds_after_a_stop_are_its_own(values, lost):
    assert lost_while_not_run(interrupted(**values)) == lost


def test_tags_that_stand_still_and_a_single_frame_tell_no_loss():
    made = interrupted()
    made.frames.columns["time_us"] = 7
    assert lost_while_not_run(made) == 0
    one = session(1)
    one.events.append(LinkEvent(START_NS - 1, 0, LinkKind.NOT_RUN, "the station was stopped"))
    one.link.frames_lost = 5
    assert lost_while_not_run(one) == 0


def after_stop(row, made, claim=Claim.ABSENCE):
    available = {subject: of.available for subject, of in statistics(made).subjects.items()}
    return STOP.applied_to(row, claim, Evidence(made, available))


@pytest.mark.parametrize(("limit", "is_excused"), [(1.0, True), (1.001, False)])
def test_an_availability_that_would_keep_its_limit_without_the_stop_is_undecided(limit, is_excused):
    """Forty of forty-four came, four were lost in the stop."""
    made = interrupted(lost=4)
    row = Row(Subject.ONBOARD, "availability", 0.9, "", limit, Outcome.FAIL, "too few")
    judged = after_stop(row, made)
    assert judged.outcome is (Outcome.INCONCLUSIVE if is_excused else Outcome.FAIL)
    assert judged.reason == "too few" + ": 4 were lost while this computer did not run the station" * is_excused
    made.events.clear()
    assert after_stop(row, made) is row


def test_one_frame_that_was_lost_in_a_stop_is_excused_too():
    """Forty of forty-one came."""
    made = interrupted(gap_s=2.0, lost=1)
    row = Row(Subject.ONBOARD, "availability", 40 / 41, "", 1.0, Outcome.FAIL, "too few")
    judged = after_stop(row, made)
    assert judged.outcome is Outcome.INCONCLUSIVE
    assert judged.reason == "too few: 1 were lost while this computer did not run the station"


@pytest.mark.parametrize(
    ("claim", "outcome"),
    [(Claim.FALSEHOOD, Outcome.FAIL), (Claim.ACCURACY, Outcome.FAIL), (Claim.ABSENCE, Outcome.PASS)],
)
def test_a_stop_excuses_no_other_row(claim, outcome):
    made = interrupted(lost=4)
    row = Row(Subject.ONBOARD, "a row", 0.9, "", 1.0, outcome, "so")
    assert after_stop(row, made, claim) is row


def test_a_frame_that_comes_early_makes_up_for_none_that_was_lost_after_a_stop():
    """Six seconds in place of one, then one that comes a tenth of a second after it."""
    made = interrupted(gap_s=6.0)
    made.frames.columns["time_us"][21:] -= 900_000
    assert lost_while_not_run(made) == 5
