"""Which answers of a session show a gross mistake."""

from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, session

from gse.diagnosis.gross_causes import _raw_attitudes, gross_cause_of, gross_finding
from gse.station.columns import ANSWER_CHECKS
from gse.station.results import AnswerCheck
from gse.statistics.counted_frames import counted_frames
from gse.values.instant import NS_PER_DAY, NS_PER_S, from_text
from gse.values.mount import InertialDirection

COUNT = 12
TURNED = replace(STATION.mount, roll_deg=STATION.mount.roll_deg + 90)


def night(**mount):
    """Twelve answers, 10 s apart, without errors of their own."""
    made = session(COUNT, step_s=10.0, noise=0.0)
    made.station = STATION.model_copy(update={"mount": replace(STATION.mount, **mount)})
    return made


def rows_of(made, counted=None):
    """Which of the frames are looked at."""
    raw = _raw_attitudes(made, counted or counted_frames(made))
    return [] if raw is None else ((raw.utc_ns - START_NS) // (10 * NS_PER_S)).tolist()


def test_every_answer_with_a_roll_that_is_not_false_nor_excluded_is_looked_at():
    made = night()
    assert rows_of(made) == list(range(COUNT))
    frames = made.frames.columns
    frames["answer_check"][3] = ANSWER_CHECKS.index(AnswerCheck.FALSE)
    frames["answer_check"][4] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    frames["roll_deg"][7] = np.nan
    counted = counted_frames(made)
    counted.excluded[9], counted.answered[10] = True, False
    assert rows_of(made, counted) == [0, 1, 2, 4, 5, 6, 8, 11]
    counted.answered[:] = False
    assert rows_of(made, counted) == []


@pytest.mark.parametrize(("late_ns", "is_looked_at"), [(-1, False), (0, True)])
def test_no_mistake_turns_the_clock_back_before_the_truth_begins(late_ns, is_looked_at):
    """The truth begins with leap seconds, in 1972; two days are more than any mistake that is tried."""
    made = night()
    made.frames.columns["utc_ns"][5] = from_text("1972-01-01T00:00:00Z") + 2 * NS_PER_DAY + late_ns
    raw = _raw_attitudes(made, counted_frames(made))
    assert len(raw.utc_ns) == COUNT - (not is_looked_at)


@pytest.mark.parametrize("mount", [{"stated": False}, {"inertial": InertialDirection(ra_deg=10.0, de_deg=20.0)}])
def test_a_mount_that_is_not_stated_or_not_on_the_ground_has_no_mistake(mount):
    made = night(**mount)
    assert rows_of(made) == []
    assert gross_finding(made, counted_frames(made)) is None


def test_without_earth_orientation_nothing_is_gross():
    made = night(roll_deg=TURNED.roll_deg)
    assert gross_finding(made, counted_frames(made)).cause.endswith("off by 90 deg")
    assert gross_cause_of(made, counted_frames(made)).finding == gross_finding(made, counted_frames(made))
    made.earth_orientation = None
    assert gross_finding(made, counted_frames(made)) is None
