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
    text = BUILT_IN_TEXT.replace("sim://", url)
    if block.startswith("mount:"):
        text = text.replace("mount:\n  azimuth_deg: 0\n  altitude_deg: 90\n  roll_deg: 0\n", "")
    session.station_text = text + block
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
    assert page.index("Decision rule") < page.index("T-7") < page.index("Accuracy</h2>")


def test_a_requirement_of_no_row_is_told(stated) -> None:
    report, page = stated
    assert [item["id"] for item in report["test"]["requirements_of_no_row"]] == ["SS-102"]
    assert "SS-102: the session has no row mean |dZZ|" in page


def test_missing_fields_are_printed_as_missing(stated) -> None:
    _, page = stated
    assert "<th>procedure</th><td>missing</td>" in page
    assert "A. Tester, missing" in page
    assert "barometer, serial missing, calibrated missing" in page


def test_a_value_that_decides_alone_is_said_to_do_so_with_its_risk() -> None:
    report, page = texts_of(session_of(BLOCK + "limits: {decision: simple, d_de_arcsec: 15}\n", simulated=True))
    assert "with 95 % confidence" not in page
    assert "rows are decided by their values alone" in page
    assert "risk of a false PASS" in page
    risks = {row["name"]: row["false_pass_risk"] for row in report["measurements"] if row["outcome"] == "PASS"}
    assert f'<td class="PASS">PASS</td><td class="n">{100 * next(filter(None, risks.values())):.1f} %</td>' in page
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


SIGNED = BLOCK + "  procedure: P-3\n  approver: C. Chief\n"


def test_those_who_are_named_sign_a_report_but_none_a_simulated_one() -> None:
    _, page = texts_of(session_of(SIGNED))
    assert "signature</th>" in page
    for role, name in (("operator", "A. Tester"), ("approver", "C. Chief")):
        assert f"<tr><td>{role}</td><td>{name}</td>" in page
    assert "<tr><td>witness</td>" not in page
    _, simulated = texts_of(session_of(SIGNED, simulated=True))
    assert "This report cannot be signed" in simulated
    assert "signature</th>" not in simulated


def test_what_is_lacking_stands_in_the_place_of_the_lines_to_sign(stated) -> None:
    _, page = stated
    assert "not ready to be signed. The station file lacks: test.procedure, test.approver." in page
    _, bare = texts_of(session_of(""))
    assert "lacks: test.id, test.procedure, test.operator, test.approver, test.sensor_serial." in bare
    for of_page in (page, bare):
        assert "signature</th>" not in of_page


def test_without_a_test_block_no_table_is_of_what_is_missing(stated) -> None:
    _, bare = texts_of(session_of(""))
    assert "missing" not in bare.split('id="provenance"')[0]
    assert "requirement (method)" not in bare
    assert "requirement (method)" in stated[1]


def test_the_definition_of_a_false_answer_is_the_number_that_is_judged_by() -> None:
    _, page = texts_of(session_of("limits: {d_ra_cosde_arcsec: 60, d_de_arcsec: 90}\n"))
    assert "more than 270 arcsec (limits.false_arcsec) from that of the reference identifier" in page
    _, page = texts_of(session_of("limits: {false_arcsec: 123}\n"))
    assert "more than 123 arcsec (limits.false_arcsec)" in page


def test_the_headline_names_what_was_judged_and_what_was_not(stated) -> None:
    report, page = stated
    told = "identifier neighbour on the panoramas of LAPAN-like; the sensor's own answers: not tested"
    assert report["tested"] == told
    assert f"<h1>Star sensor LAPAN-like: {told.replace(chr(39), '&#39;')}</h1>" in page
    assert report["conclusion"]["subject"] in plain_lines(report, "night.mcap")[0]


def test_the_envelope_says_what_was_met_and_the_fitted_mount_stands_beside_the_stated_one(stated) -> None:
    report, page = stated
    met = report["envelope"]
    assert met["frames_hz"] == pytest.approx(10.0, rel=0.01)
    assert met["exposure_s"]["min"] == pytest.approx(0.1, rel=0.01)
    assert met["matched"]["min"] <= met["matched"]["max"]
    assert "nothing outside is claimed" in page
    assert "<th>frames</th><td>10 Hz</td>" in page
    mounts = report["mount_fit"]
    assert mounts["stated_deg"] == [0.0, 90.0, 0.0]
    assert mounts["fitted_deg"][1] == pytest.approx(90.0, abs=0.02)
    assert mounts["across_arcsec"] < 60


def test_each_term_of_the_budget_says_whose_value_it_is_and_small_ones_share_a_line(stated) -> None:
    report, page = stated
    of = {term["name"]: term["evidence"] for term in report["truth_budget"]["terms"]}
    assert of["site position"] == "B: the default, 10 m, a GPS receiver's (95 %)"
    assert of["mount azimuth"] == "B: the default, 10 arcsec (95 %)"
    own, _ = texts_of(session_of("mount: {azimuth_deg: 0, altitude_deg: 90, uncertainty: {azimuth_arcsec: 4}}\n"))
    of = {term["name"]: term["evidence"] for term in own["truth_budget"]["terms"]}
    assert of["mount azimuth"] == "B: the station file, mount.uncertainty.azimuth_arcsec: 4"
    budget = page[page.index("Truth uncertainty budget</h2>") :]
    assert "below 1 % of the sum each, together: precession" in budget
    assert "<td>precession</td>" not in budget


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
