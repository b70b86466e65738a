"""The conclusion of a session: short on a terminal, and the same words wherever a person or a program reads them."""

import copy
import html
import json
import re
from pathlib import Path
from typing import Any

import pytest

from gse.report.conclusion import conclusion, conclusion_lines, explained, next_steps
from gse.report.files import junit_xml
from gse.report.page import report_html
from gse.report.summary import summarise
from gse.report.terminal import plain_lines
from gse.report.why import why_page
from gse.sessions.replay import replay_session
from gse.statistics.clock_health import CLOCK_REMEDY
from gse.verdict.assessment import judge
from gse.view.glance_word import Facts, Phase, word_of

REPLAYS = Path(__file__).parents[3] / "replays"
REPORTS = sorted(REPLAYS.glob("*/*.report.json"))
"""What the recorded sessions give, to the byte (tests/gse/sessions/test_golden_replays.py)."""
MOST_LINES = 10
"""Of a conclusion on 80 columns; the paths of the report and the exit code make them twelve."""


def words(text: str) -> str:
    """A text without what folding and markup add."""
    return " ".join(html.unescape(re.sub("<[^>]*>", "", text)).split())


def said(report: dict[str, Any]) -> list[str]:
    """What each screen must say of a session."""
    told = report["conclusion"]
    parts = [text for key in ("headline", "subject", "reason", "cause", "note") if (text := told[key])]
    assert len(parts) >= 3
    return [" ".join(part.split()) for part in parts]


@pytest.fixture(params=REPORTS, ids=lambda path: path.name.removesuffix(".report.json"))
def report(request: pytest.FixtureRequest) -> dict[str, Any]:
    return json.loads(request.param.read_text(encoding="utf-8"))


def test_there_are_twenty_sessions() -> None:
    assert len(REPORTS) >= 20


def test_every_screen_says_the_same(report) -> None:
    told = report["conclusion"]
    screens = {
        "terminal": "\n".join(plain_lines(report, "SESSION")),
        "why": why_page(report, (), "SESSION"),
        "junit": junit_xml(report),
    }
    for name, text in screens.items():
        for part in said(report):
            assert part in words(text), (name, part)
    live = word_of(Facts(phase=Phase.ENDED, verdict=told["headline"], reasons=tuple(explained(told))))
    assert live.text == f"DONE: {report['verdict']}"
    assert live.detail.endswith("; ".join(explained(told)))


def test_a_terminal_of_eighty_columns_gets_ten_lines_at_most_with_the_commands_in_one_piece(report) -> None:
    told = report["conclusion"]
    lines = conclusion_lines(told, "sessions/20260320T150000Z-LAPAN-like", 80)
    assert len(lines) <= MOST_LINES
    assert sum(line.startswith(("why: ", "cause: ", "note: ", "next: ", "not tested: ")) for line in lines) >= 2
    if "gse plan SESSION" in told["next"]:
        assert any("gse plan sessions/20260320T150000Z-LAPAN-like" in line for line in lines)


@pytest.mark.parametrize("name", ["golden/clear", "golden/faults", "golden/own-answers", "golden/cloudy"])
def test_the_page_of_a_session_says_it_above_its_first_table(name) -> None:
    session = replay_session(REPLAYS / f"{name}.mcap").session
    assessment = judge(session)
    report = summarise(session, assessment)
    page = report_html(session, assessment, report, plots=False)
    above = words(page[page.index("<body>") : page.index("<table>")])
    assert all(part in above for part in said(report))


def test_why_says_a_cause_once_and_names_the_session_in_every_command(report) -> None:
    page = words(why_page(report, (), "night-1"))
    assert "SESSION" not in page
    if cause := " ".join(report["conclusion"]["cause"].partition(" - or, which")[0].split()):
        assert page.count(cause) == 1


def test_a_session_that_is_left_out_as_a_whole_has_no_share_of_nothing(cloudy) -> None:
    day = copy.deepcopy(cloudy)
    day["identification"]["statuses"] = {}
    assert f"{day['identification']['frames']} panoramas, all left out, " in why_page(day, (), "night-1")


def test_what_is_too_long_for_a_terminal_ends_with_dots() -> None:
    told = {
        "headline": "FAIL",
        "subject": "x",
        "reason": "far too much " * 40,
        "cause": "y " * 400,
        "note": "",
        "next": "go on: gse plan SESSION",
        "not_tested": [],
    }
    lines = conclusion_lines(told, "s", 80)
    assert [line for line in lines if line.endswith(" ...")] == [lines[2], lines[5]]
    assert lines[-1] == "next: go on: gse plan s"
    assert all(len(line) <= 80 for line in lines)


@pytest.fixture(scope="module")
def cloudy() -> dict[str, Any]:
    session = replay_session(REPLAYS / "golden" / "cloudy.mcap").session
    return summarise(session, judge(session))


def test_rows_without_data_are_not_listed_and_a_required_one_is(cloudy) -> None:
    assert not any("no frame has it" in line for line in cloudy["conclusion"]["not_tested"])
    required = copy.deepcopy(cloudy)
    (row,) = (row for row in required["measurements"] if "identification time" in row["name"])
    row["requirement"] = {"id": "R-1", "method": "test"}
    assert conclusion(required)["not_tested"][0] == row["reason"]


@pytest.mark.parametrize(
    ("reason", "next_step"),
    [
        ("sensor: 9 of its answers belong to no panorama, or another one followed", "gse decode SESSION"),
        ("the sensor's clock (unix) is -3600.040 s from the host's: 1 hour", "correct sensor.time in the station file"),
        ("330 of 600 frames are left out for frames read late", "between sensor and computer, and repeat the session"),
        ("the temperature in 3 of 9 STATUS frames is not a number", "gse why SESSION"),
    ],
)
def test_where_each_row_is_decided_no_longer_session_is_asked_for(cloudy, reason, next_step) -> None:
    kept = {"verdict": "INCONCLUSIVE", "diagnosis": [], "findings": [], "reasons": [reason], "exclusions": []}
    report = copy.deepcopy(cloudy) | kept
    for row in report["measurements"]:
        row["outcome"] = "PASS"
    told = conclusion(report)
    assert (told["cause"], told["reason"]) == (reason, "")
    assert told["next"].endswith(next_step)
    report["measurements"][0]["outcome"] = "INCONCLUSIVE"
    is_named = "STATUS" not in reason
    assert conclusion(report)["next"].endswith(next_step if is_named else "gse plan SESSION")


def test_bytes_without_a_frame_are_named_as_what_they_are(cloudy) -> None:
    untrue = "dRA*: it cannot be judged, because the error of the sidereal truth is not known"
    junk = copy.deepcopy(cloudy) | {"diagnosis": [], "findings": [], "reasons": [untrue]}
    junk["identification"]["frames"] = 0
    junk["session"]["first_utc"] = None
    junk["link"] |= {"bytes_in": 3000, "bytes_discarded": 3000}
    told = conclusion(junk)
    assert told["reason"] == "3,000 bytes, and no valid frame in them"
    assert told["cause"] == ""
    assert told["next"].endswith("gse decode --try SESSION")
    assert told["subject"] == "LAPAN-like (onboard), no frame came"
    junk["link"] |= {"bytes_in": 0, "bytes_discarded": 0}
    silent = conclusion(junk)
    assert silent["reason"] == "nothing came: not one byte was received"
    assert silent["next"].startswith("look at power, cable and port")
    junk["link"]["truncated"] = True
    cut = conclusion(junk)
    assert cut["reason"].startswith("nothing is left in the session file, which lost its end")
    assert cut["next"].startswith("take a copy of the session file that is longer")


def test_a_clock_of_unknown_error_is_the_cause_where_nothing_gross_is_and_its_remedy_is_the_first_step(cloudy) -> None:
    unknown = copy.deepcopy(cloudy)
    unknown["reasons"].append(f"dRA*: it cannot be judged, because the error of the clock is not known; {CLOCK_REMEDY}")
    hot = {"cause": "hot pixels", "size": "12", "equals": [], "next_step": "list them", "is_gross": False}
    unknown["diagnosis"] = [hot]
    told = conclusion(unknown)
    assert told["cause"] == "dRA*: it cannot be judged, because the error of the clock is not known"
    assert told["next"].startswith(CLOCK_REMEDY)
    unknown["diagnosis"] = [hot | {"is_gross": True}]
    assert conclusion(unknown)["cause"] == "hot pixels: 12"


@pytest.mark.parametrize(
    ("outcome", "verdict", "step"),
    [
        ("INCONCLUSIVE", "INCONCLUSIVE", CLOCK_REMEDY),
        ("FAIL", "FAIL", "see to what the step says"),
        ("not done", "INCONCLUSIVE", "see to what the step says"),
    ],
)
def test_the_clock_is_the_first_step_of_a_procedure_that_it_alone_left_open(cloudy, outcome, verdict, step) -> None:
    run = copy.deepcopy(cloudy) | {"verdict": verdict, "diagnosis": []}
    run["procedure"] = {"name": "test", "steps": [{"outcome": "PASS"}, {"outcome": outcome}]}
    run["reasons"] = [f"step 2 {outcome}", "dRA*: the error of the clock is not known"]
    assert conclusion(run)["next"].startswith(step)


def test_frames_that_a_line_lost_are_the_cause_of_a_fail_without_another(cloudy) -> None:
    failed = copy.deepcopy(cloudy) | {"verdict": "FAIL", "diagnosis": [], "reasons": []}
    failed["exclusions"] = []
    failed["link"] |= {"frames_lost": 8, "bytes_discarded": 900}
    told = conclusion(failed)
    assert told["cause"] == "the line: 8 frames lost, 900 bytes discarded"
    assert told["next"].endswith("gse decode SESSION --discards")


def test_a_session_under_a_lens_cap_is_to_be_repeated_and_one_that_is_too_short_to_go_on():
    report = {
        "verdict": "INCONCLUSIVE",
        "identification": {"frames": 1200},
        "link": {"bytes_in": 1},
        "exclusions": [{"cause": "no objects", "frames": 200}],
        "measurements": [{"outcome": "PASS"}],
    }
    assert next_steps(report, [])[0].startswith("repeat it with nothing before the lens")
    report["measurements"].append({"outcome": "INCONCLUSIVE"})
    assert "gse plan" in next_steps(report, [])[0]


def test_only_a_value_of_a_row_of_errors_shows_that_frames_were_compared(cloudy) -> None:
    """An item of the sensor may be in arcsec too, and says nothing of the sky."""
    item = {"name": "jitter, highest", "unit": "arcsec", "value": 3.0, "outcome": "PASS", "reason": ""}
    error = item | {"name": "95 % of |dDE|"}
    for row, is_compared in ((item, False), (error, True), (error | {"value": None}, False)):
        told = conclusion(copy.deepcopy(cloudy) | {"reasons": [], "measurements": [row]})
        assert (told["reason"] != "no frame could be compared with the sky") is is_compared
