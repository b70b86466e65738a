"""More or greater errors of the subject never make the word milder, nor any row better."""

import functools

import numpy as np
import pytest
from skies.known_nights import VOUCHED, session
from skies.own_answers import with_answers, without_error

from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status, Subject, Verdict
from gse.station.session_tables import MATCH
from gse.statistics.decision import Outcome
from gse.verdict.assessment import judge

FRAMES = 600
SEVERITY = {Verdict.PASS: 0, Verdict.INCONCLUSIVE: 1, Verdict.FAIL: 2}
"""Of words and of outcomes, which have the same names."""
MOST = (1, 30, 299, 569)
"""Up to what leaves thirty of them."""
IN_ONE = (6, 140, 569)
"""Of frames side by side, which an exclusion could leave out whole."""


def elsewhere(made, rows, turn_deg=104.0):
    """The panoramas are of another sky, by the same turn, and both identifiers name its stars."""
    frames = made.frames.columns
    for name in ("d_ra_cosde_arcsec", "cross_x_arcsec"):
        frames[name][rows] += turn_deg * 3600
    for name in ("ra_deg", "ra_reference_deg"):
        frames[name][rows] += turn_deg


def absent(made, rows):
    frames = made.frames.columns
    frames["status"][rows] = STATUSES.index(Status.NO_MATCH)
    frames["answer_check"][rows] = ANSWER_CHECKS.index(AnswerCheck.ABSENT)
    for name in ("d_ra_cosde_arcsec", "d_de_arcsec", "d_roll_arcsec", "cross_x_arcsec", "cross_y_arcsec"):
        frames[name][rows] = np.nan


def false(made, rows):
    made.frames.columns["answer_check"][rows] = ANSWER_CHECKS.index(AnswerCheck.FALSE)


def never_sent(made, rows):
    left = np.delete(made.frames.columns.rows(), rows)
    table = type(made.frames)()
    table.extend(left, np.zeros(0, MATCH))
    made.frames = table


def frozen(made, rows):
    """Copies of one panorama come instead of new ones."""
    never_sent(made, rows)
    made.frames.columns["frame_no"] = np.arange(len(made.frames))
    made.link.frames_repeated = len(rows)


def faulty(made, rows):
    absent(made, rows)
    made.frames.columns["status"][rows] = STATUSES.index(Status.SENSOR_FAULT)


KINDS = {"elsewhere": elsewhere, "absent": absent, "false": false, "never sent": never_sent, "frozen": frozen,
         "faulty": faulty}  # fmt: skip


def order(scattered):
    return np.random.default_rng(4).permutation(FRAMES) if scattered else np.arange(FRAMES)


@functools.cache
def faultless():
    return judge(session(FRAMES, step_s=1.0))


def never_milder(judged):
    """The words and the rows of sessions that become worse; the first of them passes."""
    assert judged[0].verdict is Verdict.PASS
    words = [SEVERITY[one.verdict] for one in judged]
    assert words == sorted(words), words
    for row in judged[0].rows:
        found = [next(r for r in one.rows if (r.subject, r.name) == (row.subject, row.name)) for one in judged]
        of_row = [SEVERITY[Verdict(one.outcome.value)] for one in found if one.outcome is not Outcome.NOT_TESTED]
        assert of_row == sorted(of_row), (row.subject, row.name, of_row)
    return judged[-1]


@pytest.mark.parametrize("scattered", [True, False], ids=["scattered", "in one"])
@pytest.mark.parametrize("kind", KINDS)
def test_more_frames_that_are_wrong_make_no_word_milder_and_no_row_better(kind, scattered):
    judged = [faultless()]
    counts = MOST if scattered else IN_ONE
    for count in (count for count in counts if kind != "elsewhere" or count < FRAMES / 2):
        made = session(FRAMES, step_s=1.0)
        KINDS[kind](made, np.sort(order(scattered)[:count]))
        judged.append(judge(made))
    last = never_milder(judged)
    assert last.verdict is Verdict.FAIL or not scattered


@pytest.mark.parametrize("turn_deg", [0.4, 2.0])
def test_a_mount_that_was_moved_in_the_session_is_a_mistake_of_the_set_up(turn_deg):
    """For more than half of the session or less: nobody vouches that no one pushed it."""
    for count in (30, 299, 400):
        made = session(FRAMES, step_s=1.0)
        elsewhere(made, np.arange(FRAMES - count, FRAMES), turn_deg)
        judged = judge(made)
        assert judged.verdict is Verdict.INCONCLUSIVE, (count, judged.reasons)
        assert judged.findings[0].cause == "slip of the mount", (count, judged.findings)


def test_a_moved_mount_is_no_excuse_where_it_is_vouched_for():
    made = session(FRAMES, step_s=1.0, station=VOUCHED)
    elsewhere(made, np.arange(400, FRAMES), 2.0)
    assert judge(made).verdict is Verdict.FAIL


@pytest.mark.parametrize("turn_deg", [0.4, 2.0])
def test_a_mount_that_was_kicked_and_put_back_is_a_mistake_of_the_set_up(turn_deg):
    """For few frames or many; how many they are makes no word milder."""
    judged = [faultless()]
    for count in (2, 30, 299):
        made = session(FRAMES, step_s=1.0)
        elsewhere(made, np.arange(200, 200 + count), turn_deg)
        judged.append(judge(made))
    never_milder(judged)
    assert judged[-1].verdict is Verdict.INCONCLUSIVE
    for one in judged[1:]:
        assert one.findings[0].cause == "slip of the mount"
        assert "and then came back" in one.findings[0].size


def test_a_kicked_mount_is_no_excuse_where_it_is_vouched_for():
    made = session(FRAMES, step_s=1.0, station=VOUCHED)
    elsewhere(made, np.arange(200, 300), 2.0)
    assert judge(made).verdict is Verdict.FAIL


THIRDS = (slice(200, 400), slice(400, 600))


def turned_to(made, *turns_deg, parts=THIRDS):
    for part, turn_deg in zip(parts, turns_deg, strict=True):
        elsewhere(made, np.arange(FRAMES)[part], turn_deg)
    return made


@pytest.mark.parametrize("turns_deg", [(0.1, 0.3), (2.0, -3.0), (5.0, 40.0)])
def test_a_mount_that_was_turned_to_several_pointings_is_a_mistake_of_the_set_up(turns_deg):
    judged = judge(turned_to(session(FRAMES, step_s=1.0), *turns_deg))
    assert judged.verdict is Verdict.INCONCLUSIVE, judged.reasons
    (finding,) = judged.findings
    assert finding.cause == "mount moved"
    assert finding.size.startswith("it was turned 2 times and held still in between: at 20")
    assert "nobody vouches for mount and site" in finding.size


def test_a_vouched_mount_is_turned_to_no_several_pointings():
    assert judge(turned_to(session(FRAMES, step_s=1.0, station=VOUCHED), 2.0, -3.0)).verdict is Verdict.FAIL


@pytest.mark.parametrize(("turn_deg", "word"), [(1.0, Verdict.INCONCLUSIVE), (15.0, Verdict.FAIL)])
def test_a_mount_is_turned_to_and_fro_by_no_more_than_a_push(turn_deg, word):
    """What shows two directions in turns that lie further apart may be two sensors, or a sensor with an old picture."""
    parts = (slice(150, 300), slice(450, 600))
    judged = judge(turned_to(session(FRAMES, step_s=1.0), turn_deg, turn_deg, parts=parts))
    assert judged.verdict is word
    assert (judged.findings[0].cause == "mount moved") == (word is Verdict.INCONCLUSIVE)


def test_frames_on_the_way_to_another_pointing_have_no_truth():
    made = turned_to(session(FRAMES, step_s=1.0), 2.0, -3.0)
    for row in range(200, 215):
        elsewhere(made, [row], -2.0 * (215 - row) / 15)
    assert judge(made).verdict is Verdict.INCONCLUSIVE


@pytest.mark.parametrize("kind", ["false", "elsewhere"])
def test_several_pointings_excuse_no_answers_that_are_false_at_one_of_them(kind):
    made = turned_to(session(FRAMES, step_s=1.0), 2.0, -3.0)
    KINDS[kind](made, np.arange(0, FRAMES, 20))
    assert judge(made).verdict is Verdict.FAIL


def test_a_mount_that_drifts_was_not_turned_to_several_pointings():
    made = session(FRAMES, step_s=1.0)
    for name in ("d_ra_cosde_arcsec", "cross_x_arcsec"):
        made.frames.columns[name] += 2.0 * np.arange(FRAMES)
    judged = judge(made)
    assert judged.verdict is Verdict.FAIL
    assert "mount moved" not in {finding.cause for finding in judged.findings}


def test_own_answers_that_jump_while_panoramas_do_not_are_the_sensors():
    made = session(FRAMES, step_s=1.0)
    angles = without_error(made, whole_field=True)
    for part, off_arcsec in zip(THIRDS, (150.0, -300.0), strict=True):
        angles[part, 1] += off_arcsec / 3600
    judged = judge(with_answers(made, angles, np.full(FRAMES, 12)))
    assert judged.verdict is Verdict.FAIL
    assert "mount moved" not in {finding.cause for finding in judged.findings}


def test_what_comes_and_goes_is_no_moved_mount():
    made = session(FRAMES, step_s=1.0)
    elsewhere(made, np.arange(0, FRAMES, 4), 2.0)
    assert judge(made).verdict is Verdict.FAIL


def test_few_panoramas_that_look_elsewhere_are_named():
    made = session(FRAMES, step_s=1.0)
    elsewhere(made, np.arange(7, FRAMES, 75), 0.3)
    (finding,) = judge(made).findings
    assert finding.cause == "panoramas elsewhere"
    assert finding.size.startswith("8 of 600 panoramas show the sky ")


def test_a_moved_mount_excuses_no_stars_that_are_wrong():
    made = session(FRAMES, step_s=1.0)
    elsewhere(made, np.arange(400, FRAMES), 2.0)
    false(made, np.arange(0, FRAMES, 25))
    judged = judge(made)
    assert judged.verdict is Verdict.FAIL
    assert [row.name for row in judged.rows if row.outcome is Outcome.FAIL] == ["false answers"]


def with_own(rows=(), off_arcsec=0.0):
    """A sensor's own answers beside panoramas, some of them off in declination."""
    made = session(FRAMES, step_s=1.0)
    angles = without_error(made, whole_field=True)
    angles[:, :2] += np.random.default_rng(9).normal(0, 4 / 3600, (FRAMES, 2))
    angles[list(rows), 1] += off_arcsec / 3600
    return with_answers(made, angles, np.full(FRAMES, 12))


@pytest.mark.parametrize(("off_arcsec", "scattered"), [(250.0, True), (3600.0, False)], ids=["scattered", "in one"])
def test_more_own_answers_that_are_off_make_no_word_milder(off_arcsec, scattered):
    counts = (0, *(MOST if scattered else IN_ONE), FRAMES)
    judged = [judge(with_own(order(scattered)[:count], off_arcsec)) for count in counts]
    last = never_milder(judged)
    assert last.verdict is Verdict.FAIL
    assert last.statistics.subjects[Subject.SENSOR].false_answers.value == 1.0


def test_own_answers_that_are_further_off_make_no_word_milder():
    """From false_arcsec on they are false and not averaged in: the rows of accuracy are those of the others."""
    judged = [judge(with_own(order(True)[:60], off)) for off in (0, 50, 150, 300, 90_000)]
    words = [SEVERITY[one.verdict] for one in judged]
    assert words == sorted(words)
    assert (words[0], words[-1]) == (0, 2)
    shares = [one.statistics.subjects[Subject.SENSOR].false_answers.count for one in judged]
    assert shares == [0] * 3 + [60] * 2
