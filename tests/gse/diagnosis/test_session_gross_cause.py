"""Which answers of a session show a gross mistake, and what is left of the errors under another set-up."""

from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, session

from gse.diagnosis.gross_causes import _raw_attitudes, gross_cause_of, gross_finding, left_under
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
    assert left_under(made, counted_frames(made)).shape == (0, 3)


def test_without_earth_orientation_nothing_is_gross():
    made = night(roll_deg=TURNED.roll_deg)
    assert gross_finding(made, counted_frames(made)).cause.endswith("off by 90 deg")
    assert gross_cause_of(made, counted_frames(made)).finding == gross_finding(made, counted_frames(made))
    made.earth_orientation = None
    assert gross_finding(made, counted_frames(made)) is None
    assert left_under(made, counted_frames(made)).shape == (0, 3)


def test_a_clock_is_taken_back_by_as_much_as_it_is_fast_and_a_site_is_the_other_one():
    """In 100 s the sky moves by 1504 arcsec, times the cosine of the declination; a degree of latitude by itself."""
    made, counted = night(), counted_frames(night())
    right = left_under(made, counted)
    assert right.shape == (COUNT, 3)
    assert np.abs(right[:, :2]).max() < 25  # aberration, which these answers lack
    made.frames.columns["utc_ns"] += 100 * NS_PER_S
    assert left_under(made, counted, fast_s=100.0) == pytest.approx(right, abs=0.5)
    de_deg = float(np.median(made.frames.columns["de_true_deg"]))
    off = np.hypot(*(left_under(made, counted) - right)[:, :2].T)
    assert off == pytest.approx(100 * 15.041 * np.cos(np.radians(de_deg)), rel=0.01)
    elsewhere = replace(STATION.site, latitude_deg=STATION.site.latitude_deg + 1)
    moved = left_under(night(), counted, site=elsewhere) - right
    about_east = np.linalg.norm(moved, axis=1)
    assert about_east == pytest.approx(3600.0, rel=0.01)
