"""gse ci: recordings against the reports that they gave before."""

import json
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from drivers.outside_text import is_plain
from gse.cli.ci import command
from gse.cli.simulate import command as simulate
from gse.errors import UsageError
from gse.sessions.golden import _Aside, _differences, check
from gse.sessions.replay import ReplayOptions

REPLAYS = Path(__file__).parents[3] / "replays"
LEFT_OUT = "half-cone of 95 % of the boresights"


def ci(*arguments: str | Path) -> Result:
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one session and its report."""
    folder = tmp_path_factory.mktemp("made")
    arguments = ["--rate-hz", "1", "--seconds", "800", "--file", str(folder / "night.mcap")]
    assert CliRunner().invoke(simulate, arguments, catch_exceptions=False).exit_code == 0
    assert ci(folder, "--update").exit_code == 0
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return shutil.copytree(made, tmp_path / "replays")


def change(path: Path, verdict: str) -> None:
    report = json.loads(path.read_text())
    report["verdict"] = verdict
    report["session"]["version"] = "0.0.1"
    path.write_text(json.dumps(report))


def test_the_same_bytes_give_the_same_report(folder: Path) -> None:
    result = ci(folder)
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-1] == "1 of 1 sessions give the expected report"


def test_an_expected_report_of_a_stranger_steers_neither_the_terminal_nor_the_junit_file(
    folder: Path, tmp_path: Path
) -> None:
    keys = ("\x1b]0;pwned\x07\x1b[31m", "x\x00y", "\ud800", "\uffff", "</testcase><script>")
    (folder / "night.report.json").write_text(json.dumps({"verdict": "PASS", **dict.fromkeys(keys, 1)}))
    junit = tmp_path / "junit.xml"
    result = ci(folder, "--junit", junit)
    assert result.exit_code == 1
    assert is_plain(result.output.replace("\n", ""))
    (suite,) = ET.parse(junit).iter("testsuite")
    text = "".join(suite.itertext())
    assert all(word in text for word in ("pwned", "x\\x00y", "\\ud800", "\\uffff", "</testcase><script>"))


@pytest.mark.parametrize("value", [[1], [["a"]], [None], "x", {"a": 1}, 1])
def test_an_expected_report_with_values_of_another_kind_differs_and_ends_nothing(value: object) -> None:
    report = {"not_tested": ["a line"], "measurements": [{"name": "x", "value": 1.0}], "reasons": ["b"]}
    for key in report:
        found = list(_differences({**report, key: value}, report, "", _Aside(takes_digits=True)))
        assert any(line.startswith(key) for line in found)


def test_a_processor_that_is_not_of_x86_64_may_change_the_last_printed_digit_and_no_more(folder: Path) -> None:
    path = folder / "night.report.json"
    report = json.loads(path.read_text())
    figures = report["accuracy"]["onboard"]["d_de"]
    std_arcsec = figures["std_arcsec"]
    for digits, is_allowed in ((1, True), (2, False)):
        figures["std_arcsec"] = round(std_arcsec + digits * 0.001, 3)
        path.write_text(json.dumps(report))
        arm, x86_64 = (check(folder / "night.mcap", "night", ReplayOptions(), machine=of) for of in ("arm64", "AMD64"))
        assert (arm.passed, x86_64.passed) == (is_allowed, False)
        assert arm.allowed + arm.differences == x86_64.differences
        assert x86_64.differences[0].startswith("accuracy.onboard.d_de.std_arcsec: expected ")


def test_a_difference_is_told_by_its_place_and_fails(folder: Path, tmp_path: Path) -> None:
    change(folder / "night.report.json", "FAIL")
    junit = tmp_path / "junit.xml"
    result = ci(folder, "--junit", junit)
    assert result.exit_code == 1
    assert 'verdict: expected "FAIL", got "PASS"' in result.stdout
    assert "numpy" not in result.stdout
    suite = ET.parse(junit).getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("1", "1", "0")
    failure = suite.find("testcase/failure")
    assert failure is not None
    assert failure.get("message") == 'verdict: expected "FAIL", got "PASS"'


def test_a_newer_program_is_no_difference(folder: Path) -> None:
    change(folder / "night.report.json", "PASS")
    assert ci(folder).exit_code == 0


def test_update_makes_the_report_the_expected_one(folder: Path) -> None:
    change(folder / "night.report.json", "FAIL")
    assert ci(folder, "--update").exit_code == 0
    assert json.loads((folder / "night.report.json").read_text())["verdict"] == "PASS"


@pytest.mark.parametrize("text", [None, "", "[]", "{", "[" * 100_000])
def test_a_missing_or_broken_report_is_an_error_with_what_to_do(text: str | None, folder: Path) -> None:
    report = folder / "night.report.json"
    report.unlink()
    if text is not None:
        report.write_text(text)
    result = ci(folder, "--json")
    assert result.exit_code == 1
    document = json.loads(result.stdout)
    assert document["schema"] == "gse.ci/1"
    assert "gse ci --update" in document["recordings"][0]["error"]


def test_a_file_that_is_no_session_is_an_error_of_its_own(folder: Path, tmp_path: Path) -> None:
    (folder / "old").mkdir()
    (folder / "old" / "foreign.mcap").write_bytes(b"no session" * 100)
    junit = tmp_path / "junit.xml"
    result = ci(folder, "--junit", junit)
    assert result.exit_code == 1
    assert "same     PASS          night" in result.stdout
    assert "old/foreign" in result.stdout
    assert ET.parse(junit).getroot().get("errors") == "1"


def test_a_folder_without_sessions_is_told_so(tmp_path: Path) -> None:
    for folder, words in ((tmp_path, "no session"), (tmp_path / "nowhere", "is not a folder")):
        result = ci(folder)
        assert isinstance(result.exception, UsageError)
        assert words in str(result.exception)


def edit(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    report = json.loads(path.read_text())
    change(report)
    path.write_text(json.dumps(report))


def test_what_the_expected_report_does_not_have_is_new_and_no_difference(folder: Path, tmp_path: Path) -> None:
    def older(report: dict[str, Any]) -> None:
        del report["clock"]["source"], report["measurements"][0]["n_eff"], report["metrics"][3]
        report["measurements"].pop(1)  # it is PASS in the report of today
        report["not_tested"].pop()

    junit = tmp_path / "junit.xml"
    edit(folder / "night.report.json", older)
    result = ci(folder, "--junit", junit)
    assert result.exit_code == 0, result.stdout
    for place in ("clock.source", "measurements[onboard mean |dRA*|].n_eff", "measurements[onboard 95 % of |dRA*|]"):
        assert f"new: {place}\n" in result.stdout
        assert f"new: {place}" in (ET.parse(junit).getroot().findtext("testcase/system-out") or "")
    assert "new: not_tested: " in result.stdout
    assert len(json.loads(ci(folder, "--json").stdout)["recordings"][0]["new"]) == 5


def test_a_row_without_a_limit_that_the_expected_report_does_not_have_is_new(folder: Path) -> None:
    def older(report: dict[str, Any]) -> None:
        report["measurements"] = [row for row in report["measurements"] if row["limit"] is not None]

    edit(folder / "night.report.json", older)
    result = ci(folder)
    assert "new: measurements[onboard half-cone of 95 % of the boresights]\n" in result.stdout
    assert result.exit_code == 0


def test_a_new_row_that_is_not_pass_is_a_difference(folder: Path) -> None:
    time = "onboard identification time on this host, 99 %"
    edit(folder / "night.report.json", lambda report: report["measurements"].pop())
    result = ci(folder)
    assert f"measurements[{time}] is new, and not tested: {time}: no frame has it\n" in result.stdout
    assert result.exit_code == 1


@pytest.mark.parametrize(
    "changes",
    [
        [
            (lambda report: report["clock"].update(colour=3), "clock.colour is missing: expected 3"),
            (lambda report: report["measurements"][0].update(colour=None), "].colour is missing: expected null"),
            (lambda report: report["measurements"].append({"name": "warmth"}), "measurements[warmth] is missing"),
            (lambda report: report["not_tested"].append("sensor: x"), 'not_tested lacks "sensor: x"'),
            (lambda report: report["reasons"].append("x"), "reasons: expected 1 items, got 0"),
            (lambda report: report["sky"]["stretches"].pop(), "sky.stretches: expected 0 items, got 1"),
        ],
        [(lambda report: report["measurements"].reverse(), "measurements: the rows are in another order")],
    ],
    ids=["content", "order"],
)
def test_what_only_the_expected_report_has_is_a_difference(
    changes: list[tuple[Callable[[dict[str, Any]], None], str]], folder: Path
) -> None:
    for change, _ in changes:
        edit(folder / "night.report.json", change)
    result = ci(folder)
    assert [words for _, words in changes if words not in result.stdout] == []
    assert result.exit_code == 1


@pytest.fixture
def unanswered(tmp_path: Path) -> Path:
    """A folder with a session without an answer, so without a figure of accuracy."""
    for name in ("000.mcap", "000.report.json"):
        shutil.copy(REPLAYS / "lowell" / name, tmp_path)
    return tmp_path


def test_a_row_without_limit_and_value_is_named_in_one_line_instead(unanswered: Path) -> None:
    assert ci(unanswered).exit_code == 0
    report = json.loads((unanswered / "000.report.json").read_text())
    assert LEFT_OUT not in {row["name"] for row in report["measurements"]}
    assert [line for line in report["not_tested"] if LEFT_OUT in line] == [
        f"onboard: neither limit nor data: {LEFT_OUT}"
    ]


def test_a_new_row_without_limit_and_value_is_new_and_a_missing_one_a_difference(unanswered: Path) -> None:
    path = unanswered / "000.report.json"
    line = f"onboard: neither limit nor data: {LEFT_OUT}"
    edit(path, lambda report: report["not_tested"].remove(line))
    newer = ci(unanswered)
    assert f"new: not_tested: {line}\n" in newer.stdout
    assert newer.exit_code == 0
    edit(path, lambda report: report["not_tested"].append(f"{line}; warmth"))
    older = ci(unanswered)
    assert 'not_tested lacks "onboard: neither limit nor data: warmth"' in older.stdout
    assert older.exit_code == 1
