"""The ``test:`` block of a station file on the report's first page."""

import re

import pytest
from skies.synthetic_night import START_NS, synthetic_night

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import ConfigError
from gse.report import summarise
from gse.report.files import junit_xml
from gse.report.page import report_html
from gse.report.terminal import plain_lines
from gse.verdict.assessment import judge
from protocols import StatusMessage

BLOCK = """test:
  id: T-7
  report: 2026-031
  operator: A. Tester
  sensor_serial: 12
  instruments: [{name: GPS clock, serial: G-5, calibrated: 2026-01-31}, {name: barometer}]
  requirements: {mean |dRA*|: {id: SS-100, method: test}, mean |dDE|: SS-101, mean |dZZ|: SS-102}
  deviations: [the Moon was up]
"""


def session_of(block: str = BLOCK, *, simulated: bool = False):
    session = synthetic_night(100)
    url = "sim://" if simulated else "/dev/ttyUSB0"
    session.station_text = BUILT_IN_TEXT.replace("sim://", url) + block
    session.station = parse_station(session.station_text)
    if not simulated:
        session.clock = []
    return session


def texts_of(session):
    assessment = judge(session)
    report = summarise(session, assessment)
    return report, re.sub(r"\s+", " ", report_html(session, assessment, report, plots=False))


@pytest.fixture(scope="module")
def stated():
    return texts_of(session_of())


def test_what_the_station_file_states_is_in_the_report(stated) -> None:
    report, page = stated
    assert report["test"]["id"] == "T-7"
    assert report["test"]["instruments"][0] == {"name": "GPS clock", "serial": "G-5", "calibrated": "2026-01-31"}
    requirements = {row["name"]: row["requirement"] for row in report["measurements"]}
    assert requirements["mean |dRA*|"] == {"id": "SS-100", "method": "test"}
    assert requirements["mean |dDE|"] == {"id": "SS-101", "method": None}
    assert requirements["mean |roll|"] is None
    for words in ("T-7", "2026-031", "SS-100 (test)", "SS-101 (missing)", "G-5, calibrated 2026-01-31", "Moon was up"):
        assert words in page
    assert page.index("Decision rule") < page.index("T-7") < page.index("Errors against time</h2>")


def test_a_requirement_of_no_row_is_told(stated) -> None:
    report, page = stated
    assert [item["id"] for item in report["test"]["requirements_of_no_row"]] == ["SS-102"]
    assert "SS-102: the session has no row mean |dZZ|" in page


def test_missing_fields_are_printed_as_missing(stated) -> None:
    _, page = stated
    assert "<th>procedure</th><td>missing</td>" in page
    assert "A. Tester, missing" in page
    assert "<td>operator</td><td>A. Tester</td>" in page
    assert "<td>approver</td><td>missing</td>" in page
    assert "barometer, serial missing, calibrated missing" in page


def test_a_value_that_decides_alone_is_said_to_do_so_with_its_risk() -> None:
    report, page = texts_of(session_of(BLOCK + "limits: {decision: simple, d_de_arcsec: 15}\n", simulated=True))
    assert "with 95 % confidence" not in page
    assert "rows are decided by their values alone" in page
    assert "uncertainty does not count (decision: simple)" in page
    risks = {row["name"]: row["false_pass_risk"] for row in report["measurements"] if row["outcome"] == "PASS"}
    assert f'<td class="PASS">PASS</td><td class="n">{100 * risks["availability"]:.1f} %</td>' in page
    assert '<td class="PASS">PASS</td><td class="n">not known</td>' in page  # of errors that are too short to tell
    lines = plain_lines(report, "night.mcap", verbose=True)
    assert "decision: simple: the value alone decides, uncertainty does not count" in lines
    assert next(line for line in lines if "mean |dRA*|" in line).endswith("not known")
    assert "decided by the value alone, risk of a false PASS" in junit_xml(report)


def test_a_guarded_report_says_nothing_of_such_a_risk(stated) -> None:
    report, page = stated
    assert "risk of a false PASS" not in page + "".join(plain_lines(report, "night.mcap", verbose=True)) + junit_xml(
        report
    )


def test_each_deviation_has_a_line_of_its_own() -> None:
    _, page = texts_of(session_of("test: {deviations: [A door stood open., The witness left.]}\n"))
    assert "A door stood open.<br>The witness left.</td>" in page


def test_serial_and_firmware_come_from_the_sensor_where_it_sends_them() -> None:
    session = session_of()
    for serial in (77, 77, 78):
        session.statuses.append((START_NS, StatusMessage(0, b"", firmware=(1, 4, 2), serial=serial)))
    report, page = texts_of(session)
    assert report["test"]["sensor"]["serial"] == {"sent": ["77", "78"], "stated": "12"}
    assert report["test"]["sensor"]["firmware"] == {"sent": ["1.4.2"], "stated": None}
    assert "77, 78 (STATUS frames); the station file says 12" in page


def test_several_people_approve_a_report_but_none_a_simulated_one(stated) -> None:
    _, page = stated
    for role in ("operator", "witness", "reviewer", "approver"):
        assert f"<tr><td>{role}</td>" in page
    assert "<tr><td>operator</td><td>A. Tester</td>" in page
    _, simulated = texts_of(session_of(simulated=True))
    assert "This report cannot be signed" in simulated
    assert "signature</th>" not in simulated


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ("test: {idd: 1}", "unknown key test.idd; did you mean id?"),
        ("test: {instruments: [{nam: 3}]}", "unknown key test.instruments.nam; did you mean name?"),
        ("test: {requirements: {a b: {idd: 3}}}", "unknown key test.requirements.a b.idd; did you mean id?"),
        ("test: {instruments: [{name: a, calibrated: soon}]}", "test.instruments.calibrated is 'soon'"),
        ("test: 3", "test is 3"),
    ],
)
def test_a_wrong_block_is_told_by_its_key(block: str, words: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(words)):
        parse_station(BUILT_IN_TEXT + block + "\n")
