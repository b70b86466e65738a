"""The files of a report: complete, true to the night, and the same to the byte each time."""

import csv
import io
import json
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import jinja2
import numpy as np
import pytest
from markupsafe import escape
from rich.console import Console
from skies.known_nights import VOUCHED
from skies.one_by_one import NO_STARS, add_frame
from skies.synthetic_night import START_NS, synthetic_frames, synthetic_night

from gse.errors import UsageError
from gse.process.jit import compiled_folder
from gse.report import summarise
from gse.report.files import frames_csv, junit_xml, write_report
from gse.report.page import _TemplateOnDisk, report_html
from gse.report.summary import plain
from gse.report.terminal import facts, plain_lines, print_verdict
from gse.report.why import why_page
from gse.station.events import ClockStep, StationKind
from gse.station.results import Status
from gse.station.session_data import SessionData
from gse.verdict.assessment import judge
from protocols import StatusMessage

FRAMES = 800
MADE_BY = {"schema": "gse.provenance/1", "host": "<b>here</b>", "packages": {"numpy": "2"}, "self_check": None}


@pytest.fixture(scope="module")
def session() -> SessionData:
    return synthetic_night(FRAMES)


@pytest.fixture(scope="module")
def assessment(session):
    return judge(session)


@pytest.fixture(scope="module")
def report(session, assessment):
    return summarise(session, assessment)


@pytest.fixture(scope="module")
def page(session, assessment, report) -> str:
    return report_html(session, assessment, report, MADE_BY)


def failing() -> SessionData:
    """A night with a sensor that is off by 100 arcsec in RA, on a mount that was surveyed."""
    session = synthetic_night(200, bias_arcsec=(100.0, 0.0))
    session.station = VOUCHED
    return session


def test_the_page_is_compiled_once_for_all_runs_and_without_a_place_for_it_each_time(tmp_path, page):
    assert list(compiled_folder().glob("__jinja2_*.cache"))
    without = jinja2.Environment(
        loader=jinja2.DictLoader({"a": "b"}), bytecode_cache=_TemplateOnDisk(str(tmp_path / "no"))
    )
    assert without.get_template("a").render() == "b"


def floats_in(value):
    if isinstance(value, float):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from floats_in(item)


@pytest.mark.parametrize(
    ("value", "rounded"),
    [
        ({"bias_arcsec": 1234.56789}, {"bias_arcsec": 1234.568}),
        ({"drift_arcsec_per_h": -0.00049}, {"drift_arcsec_per_h": 0.0}),
        ({"bounds_arcsec": {"upper": 26.8471225}}, {"bounds_arcsec": {"upper": 26.847}}),
        ({"ra_deg": 359.12345678}, {"ra_deg": 359.123457}),
        ({"unit": "arcsec", "value": 0.0123456}, {"unit": "arcsec", "value": 0.012}),
        ({"unit": "arcsec/h", "value": 0.01234567}, {"unit": "arcsec/h", "value": 0.0123457}),
        ({"share": 0.00123456789}, {"share": 0.00123457}),
        ({"measured_arcsec_per_s": [15.0410672]}, {"measured_arcsec_per_s": [15.0411]}),
    ],
)
def test_an_angle_is_rounded_by_its_unit_and_another_number_to_six_digits(value, rounded) -> None:
    assert plain(value) == rounded


def test_the_summary_has_the_shape_that_is_promised(report) -> None:
    assert report["schema"] == "gse.report/1"
    assert report["verdict"] in ("PASS", "FAIL", "INCONCLUSIVE")
    for key in ("reasons", "measurements", "link", "identification", "truth_budget", "table_4_1", "session"):
        assert key in report
    for measurement in report["measurements"]:
        assert {"subject", "name", "value", "uncertainty", "unit", "limit", "outcome"} <= set(measurement)


def test_every_number_is_finite_and_has_no_more_digits_than_all_processors_agree_on(report) -> None:
    numbers = list(floats_in(report))
    assert len(numbers) > 100
    assert all(math.isfinite(number) for number in numbers)
    assert all(
        number == float(f"{number:.6g}") or number == round(number, 3) for number in floats_in(report["metrics"])
    )
    assert json.loads(json.dumps(report, allow_nan=False)) == report


def test_what_is_unknown_is_null_not_zero() -> None:
    session = synthetic_night(100)
    session.clock = []
    report = summarise(session, judge(session))
    assert report["clock"]["error_bound_s"] is None
    assert report["truth_budget"]["ra_arcsec"] is None
    assert report["verdict"] == "INCONCLUSIVE"


def test_table_4_1_stands_beside_the_papers_figures(report, session) -> None:
    own, *paper = report["table_4_1"]["rows"]
    frames = session.frames.columns
    d_de = frames["d_de_arcsec"][np.isfinite(frames["d_de_arcsec"])]
    assert own["mean_d_de_deg"] == pytest.approx(np.abs(d_de).mean() / 3600, abs=1e-6)
    assert [row["mean_d_ra_deg"] for row in paper] == [0.006676, 0.003552, 0.005, 0.005076]
    assert [row["mean_d_de_deg"] for row in paper] == [0.009221, 0.00866, 0.005, 0.007627]
    assert paper[-1]["mean_d_ra_arcmin"] == pytest.approx(0.3, abs=0.01)


def test_the_same_night_gives_the_same_bytes_and_another_does_not(page, report, tmp_path: Path) -> None:
    again = synthetic_night(FRAMES)
    paths = write_report(again, judge(again), tmp_path, MADE_BY)
    assert set(paths) == {"report.json", "report.html", "frames.csv", "junit.xml", "provenance.json"}
    assert paths["report.html"].read_text(encoding="utf-8") == page
    assert json.loads(paths["report.json"].read_text()) == report
    other = synthetic_night(FRAMES, seed=2)
    assert summarise(other, judge(other)) != report


def test_a_troubled_night_is_told_from_its_verdict_down() -> None:
    session = failing()
    session.station_text = "# <script>alert(1)</script>"
    step = ClockStep(START_NS + 10**10, 0, StationKind.CLOCK_STEP, "stepped by +2.0 s <img src=x>", 2 * 10**9)
    session.events.append(step)
    assessment = judge(session)
    report = summarise(session, assessment)
    text = report_html(session, assessment, report, MADE_BY)
    body = text[text.index("<body>") :]
    assert report["verdict"] == "FAIL"
    assert report["exclusions"][0]["frames"] > 50
    told = report["conclusion"]
    for text_ in map(escape, (told["subject"], told["reason"], *told["not_tested"])):
        assert body.index("<strong>FAIL</strong>") < body.index(str(text_)) < body.index("<table>")
    # the verdict says what the cause cannot be told apart from in words of its own
    assert all(str(escape(reason.partition("; this session")[0])) in body for reason in report["reasons"])
    for words in (session.raw_sha256, "Gaia DR3", "numpy 2", "stepped by +2.0 s", "deflection of the vertical"):
        assert words in body
    assert "<script" not in text
    assert "<img" not in text


def test_a_session_without_an_answer_has_no_table_of_dashes_and_no_empty_plot() -> None:
    session = synthetic_night(0)
    for frame in synthetic_frames(60, trouble=False):
        add_frame(session.frames, replace(frame, status=Status.TOO_FEW, attitude=None, attitude_error=None))
    assessment = judge(session)
    text = report_html(session, assessment, summarise(session, assessment), MADE_BY)
    accuracy = text[text.index('<h2 id="accuracy">') : text.index('<h2 id="sky">')]
    assert "no frame has an answer that counts" in accuracy
    assert "drift per hour" not in accuracy
    assert "Rate of the boresight" not in accuracy
    assert "<svg" not in accuracy


def test_the_page_needs_nothing_from_elsewhere(page) -> None:
    assert not re.findall(r'(?:src|href)="(?!#|data:)[^"]*"', page)
    assert "<script" not in page
    assert "@import" not in page
    assert "default-src 'none'" in page


def test_the_page_has_all_figures_as_vectors_with_ids_of_their_own(page) -> None:
    figures = re.findall(r"<svg .*?</svg>", page, re.DOTALL)
    assert len(figures) == 10
    for figure in figures:
        ET.fromstring(figure)
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    links = set(re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', page))
    assert links <= set(ids)


def test_each_measurement_is_a_test_case(report) -> None:
    suite = ET.fromstring(junit_xml(report).split("\n", 1)[1])
    assert [case.get("name") for case in suite] == [*(item["name"] for item in report["measurements"]), "verdict"]
    assert suite.get("failures") == "0"


def test_a_failure_and_an_unknown_are_told_apart_with_their_reasons() -> None:
    session = failing()
    suite = ET.fromstring(junit_xml(summarise(session, judge(session))).split("\n", 1)[1])
    failed = [case for case in suite if case.find("failure") is not None]
    assert [case.get("name") for case in failed] == ["mean |dRA*|", "95 % of |dRA*|", "verdict"]
    assert "arcsec, the limit is 60" in (failed[0].findtext("failure") or "")
    session.clock = []
    session.station = session.station.model_copy(
        update={"limits": replace(session.station.limits, d_ra_cosde_arcsec=1e4)}
    )
    suite = ET.fromstring(junit_xml(summarise(session, judge(session))).split("\n", 1)[1])
    errors = [case.find("error") for case in suite if case.find("error") is not None]
    assert suite.get("errors") == str(len(errors)) != "0"
    assert {error.get("type") for error in errors} == {"INCONCLUSIVE"}
    assert "clock" in (errors[-1].text or "")
    assert errors[-1].get("message") == suite[-1].findtext("system-out")
    assert (errors[-1].get("message") or "").startswith("INCONCLUSIVE (SIMULATED): ")


def test_lost_frames_that_were_no_panoramas_are_not_missing_among_them() -> None:
    session = synthetic_night(60)
    session.link.frames_lost, session.others_lost = 70, 68
    report = summarise(session, judge(session))
    assert "frames: 54 of 59 expected, 53 identified" in facts(report)  # and 3 copies; 6 came while the port was gone
    report["exclusions"] = [{"from": "2026-03-20T18:30:04.000000Z", "reason": "the port was gone for 0.6 s"}]
    page = why_page(report, (), "session.mcap")
    assert "60 panoramas, 6 left out, 53 of the other 54 identified, 5 lost" in page
    assert "left out from 18:30:04Z on: the port was gone for 0.6 s" in page


def test_the_table_of_frames_has_firmware_and_serial_number_of_the_latest_status(session) -> None:
    host_ns = session.frames.columns["host_utc_ns"]
    first = StatusMessage(temperature_c=20, supply_v=5, mode="streaming", firmware=(1, 2, 0), serial=0)
    second = replace(first, firmware=(1, 3, 0), serial=14014)
    statuses = [(int(host_ns[20]), second), (int(host_ns[10]), first)]
    rows = list(csv.DictReader(io.StringIO("".join(frames_csv(session.frames.columns, statuses=statuses)))))
    told = [(row["firmware"], row["serial"]) for row in rows]
    assert told[:9] == [("", "")] * 9
    assert told[10:19] == [("1.2.0", "")] * 9
    assert told[20:] == [("1.3.0", "14014")] * (FRAMES - 20)


def test_the_table_of_frames_has_a_line_for_each_and_empty_cells_where_nothing_is_known(session) -> None:
    rows = list(csv.DictReader(io.StringIO("".join(frames_csv(session.frames.columns)))))
    assert len(rows) == FRAMES
    assert rows[0]["utc"] == "2026-03-20T18:30:00.000000Z"
    assert rows[0]["onboard_status"] == "IDENTIFIED"
    assert rows[49]["onboard_status"] == "NO_MATCH"
    assert (
        rows[49]["onboard_d_de_arcsec"]
        == rows[49]["onboard_ra_deg"]
        == rows[49]["onboard_false_match_probability"]
        == ""
    )
    assert float(rows[3]["onboard_d_de_arcsec"]) == pytest.approx(session.frames.columns["d_de_arcsec"][3], abs=0.0006)


def test_without_a_terminal_the_verdict_is_plain_text_with_its_reason(report) -> None:
    screen = io.StringIO()
    print_verdict(report, "night.mcap", Console(file=screen, width=80))
    assert screen.getvalue().splitlines() == plain_lines(report, "night.mcap")
    assert screen.getvalue().startswith("PASS (SIMULATED): ")
    assert screen.getvalue().isascii()


def test_on_a_terminal_the_conclusion_stands_above_the_tables_that_were_asked_for() -> None:
    session = failing()
    report = summarise(session, judge(session))
    screen = io.StringIO()
    console = Console(file=screen, width=100, force_terminal=True, color_system=None)
    print_verdict(report, "night.mcap", console, verbose=True, paper=True)
    text = screen.getvalue()
    assert (
        text.index("FAIL")
        < text.index(" ".join(report["reasons"][0].split()[:3]))
        < text.index("mean |dRA*|  ")
        < text.index("Star Sensor 1")
    )


@pytest.mark.parametrize("frames", [0, 3])
def test_a_night_of_few_frames_still_has_a_report(frames: int, tmp_path: Path) -> None:
    session = synthetic_night(frames)
    paths = write_report(session, judge(session), tmp_path)
    assert "INCONCLUSIVE" in paths["report.html"].read_text(encoding="utf-8")
    assert len(paths["frames.csv"].read_text().splitlines()) == frames + 1


def test_a_night_without_one_answer_still_has_a_report(tmp_path: Path) -> None:
    session = synthetic_night(0)
    for frame in synthetic_frames(60):
        empty = replace(
            frame,
            status=Status.TOO_FEW,
            attitude=None,
            matches=NO_STARS,
            attitude_error=None,
            attitude_true=None,
            elapsed_us=None,
        )
        add_frame(session.frames, empty)
    session.clock, session.events = [], []
    paths = write_report(session, judge(session), tmp_path)
    assert "no times were recorded" not in paths["junit.xml"].read_text()
    assert json.loads(paths["report.json"].read_text())["identification"]["statuses"]["TOO_FEW"] == 60


def test_a_disk_that_takes_nothing_is_told(session, assessment, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot write the report into"):
        write_report(session, assessment, tmp_path / "absent")
