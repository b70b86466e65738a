"""Regression test of recordings: each must give exactly its expected report."""

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import DriverError
from drivers.host_files import only_a_file
from drivers.session_file.reader import find_segments
from drivers.whole_file import write_whole
from gse.assessment.verdict import judge
from gse.errors import GseError, UsageError
from gse.report import summarise
from gse.sessions.replay import ReplayOptions, replay_session
from protocols import ProtocolError

EXPECTED_SUFFIX = ".report.json"
MAX_REPORT_BYTES = 10_000_000
MOST_DIFFERENCES = 20
"""Most differences listed for one recording."""

_NOT_COMPARED = ("session.version",)
"""The version of the program may differ, if the statistics are the same."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one recording; ``differences`` is empty where the report is as expected.

    ``error`` is the reason why it could not be replayed or compared, one or two lines.
    """

    name: str
    verdict: str
    differences: tuple[str, ...] = ()
    error: str = ""

    @property
    def passed(self) -> bool:
        """Whether the report is exactly the expected one."""
        return not (self.differences or self.error)


def recordings_in(folder: Path) -> list[Path]:
    """The session files of a folder and its subfolders, in the order of their names; UsageError where there are none.

    The further segments of a session are read with its first.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder} is not a folder; expected one that holds sessions (.mcap)")
    found = [path for path in folder.rglob("*.mcap") if path.is_file()]
    further = {segment for path in found for segment in find_segments(path)[0][1:]}
    if not found:
        raise UsageError(f"there is no session (.mcap) in {folder}")
    return sorted(set(found) - further)


def expected_path(recording: Path) -> Path:
    """Path of the expected report, beside the recording."""
    return recording.with_name(recording.name.removesuffix(".mcap") + EXPECTED_SUFFIX)


def check(recording: Path, name: str, options: ReplayOptions, *, update: bool = False) -> Outcome:
    """Replay a recording and compare its report with the expected one; ``update`` writes it as the expected one."""
    try:
        expected = {} if update else _read_report(expected_path(recording))
        report = report_of(recording, options)
        if update:
            return _keep(report, recording, name)
    except (GseError, DriverError, ProtocolError) as error:
        return Outcome(name, "", error=str(error))
    differences = list(_differences(expected, report, ""))
    return Outcome(name, report["verdict"], tuple(differences[:MOST_DIFFERENCES]))


def report_of(recording: Path, options: ReplayOptions) -> dict[str, Any]:
    """The report of a recording."""
    session = replay_session(recording, options=options).session
    return summarise(session, judge(session))


def junit_of(outcomes: list[Outcome], folder: Path) -> str:
    """One test case per recording, for a CI server."""
    suite = ET.Element(
        "testsuite",
        name=f"gse ci {folder.name}",
        tests=str(len(outcomes)),
        failures=str(sum(bool(outcome.differences) for outcome in outcomes)),
        errors=str(sum(bool(outcome.error) for outcome in outcomes)),
        skipped="0",
    )
    for outcome in outcomes:
        case = ET.SubElement(suite, "testcase", classname="gse.ci", name=outcome.name)
        if outcome.error:
            ET.SubElement(case, "error", message=outcome.error.splitlines()[0]).text = outcome.error
        elif outcome.differences:
            text = "\n".join(outcome.differences)
            ET.SubElement(case, "failure", message=outcome.differences[0]).text = text
        ET.SubElement(case, "system-out").text = outcome.verdict
    ET.indent(suite)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(suite, encoding="unicode") + "\n"


def _keep(report: dict[str, Any], recording: Path, name: str) -> Outcome:
    path = expected_path(recording)
    try:
        write_whole(path, [json.dumps(report, indent=1, allow_nan=False) + "\n"])
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
    return Outcome(name, report["verdict"])


def _read_report(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MAX_REPORT_BYTES:
            raise UsageError(f"{path} is larger than {MAX_REPORT_BYTES} bytes; expected a report of gse")
        with open(path, encoding="utf-8", opener=only_a_file) as file:
            report = json.loads(file.read(MAX_REPORT_BYTES))
    except FileNotFoundError:
        raise UsageError(f"there is no expected report {path.name}; 'gse ci --update' writes it") from None
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not a report: {error}; 'gse ci --update' writes it anew") from error
    if not isinstance(report, dict):
        raise UsageError(f"{path} is not a report: expected a JSON object; 'gse ci --update' writes it anew")
    return report


def _differences(expected: Any, found: Any, where: str) -> Iterator[str]:
    """Each place where two reports differ, by its path."""
    if where in _NOT_COMPARED:
        return
    if isinstance(expected, dict) and isinstance(found, dict):
        for key in dict.fromkeys((*expected, *found)):
            yield from _differences(expected.get(key, "-"), found.get(key, "-"), f"{where}.{key}".lstrip("."))
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        for place, pair in enumerate(zip(expected, found, strict=True)):
            yield from _differences(*pair, f"{where}[{place}]")
    elif expected != found:
        yield f"{where}: expected {_brief(expected)}, got {_brief(found)}"


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 100 else text[:97] + "..."
