"""Regression test of recordings: each must give its expected report, or an identifier its expected answers to it.

On a processor that is not of x86-64 a figure may differ by one unit of its last printed digit: its compiler may round a
product and a sum at once, where x86-64 rounds twice, and its sine has another last bit.
"""

import json
import platform
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

from drivers.errors import DriverError
from drivers.host_files import only_a_file, write_whole
from drivers.outside_text import plain_line, plain_lines
from drivers.session_file.reader import segment_files
from gse.config.choice import change_to
from gse.errors import GseError, UsageError
from gse.report import summarise
from gse.sessions.expected_answers import (
    SUFFIX,
    AnswerComparison,
    GivenAnswers,
    compare_answers,
    read_answers,
    write_answers,
)
from gse.sessions.replay import ReplayOptions, replay_session
from gse.statistics.decision import Outcome
from gse.verdict.assessment import LEFT_OUT, judge
from protocols import ProtocolError

EXPECTED_SUFFIX = ".report.json"
MAX_REPORT_BYTES = 10_000_000
MOST_DIFFERENCES = 20
"""Most differences listed for one recording, and most new places."""

_NOT_COMPARED = ("session.version",)
"""The version of the program may differ, if the statistics are the same."""
_WORDS_ON_ROWS = "not_tested"
"""Lines on rows that are compared themselves: a new row may add one."""
_PASS = Outcome.PASS.value


@dataclass(frozen=True, slots=True)
class Checked:
    """Result of one recording; ``differences`` is empty where the report is as expected.

    ``new`` are the places that the expected report does not have, and ``allowed`` the figures that differ by as much as
    they may on this machine: neither is a difference. ``error`` is the reason why
    it could not be replayed or compared, one or two lines. ``answers`` is a comparison of answers instead of reports;
    ``note`` says what came of it.
    """

    name: str
    verdict: str
    differences: tuple[str, ...] = ()
    new: tuple[str, ...] = ()
    allowed: tuple[str, ...] = ()
    error: str = ""
    note: str = ""
    answers: AnswerComparison | None = None

    @property
    def lines(self) -> list[str]:
        """What a person must know beside the verdict."""
        lines = [*self.error.splitlines(), self.note, *self.differences, *(f"new: {place}" for place in self.new)]
        lines += [f"one unit of the last digit, allowed on {platform.machine()}: {line}" for line in self.allowed]
        return [line for line in lines if line]

    @property
    def passed(self) -> bool:
        """Whether the report has all that the expected one states."""
        return not (self.differences or self.error)


def recordings_in(folder: Path) -> list[Path]:
    """The session files of a folder and its subfolders, in the order of their names; UsageError where there are none.

    The further segments of a session are read with its first.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder} is not a folder; expected one that holds sessions (.mcap)")
    found = [path for path in folder.rglob("*.mcap") if path.is_file()]
    further = {segment for path in found for segment in segment_files(path)[1:]}
    if not found:
        raise UsageError(f"there is no session (.mcap) in {folder}")
    return sorted(set(found) - further)


def expected_path(recording: Path) -> Path:
    """Path of the expected report, beside the recording."""
    return recording.with_name(recording.name.removesuffix(".mcap") + EXPECTED_SUFFIX)


def may_differ_by_a_digit(machine: str) -> bool:
    """Whether a machine (``platform.machine()``) is another one than those on which all digits are the same."""
    return machine not in ("x86_64", "AMD64")


def check(
    recording: Path, name: str, options: ReplayOptions, *, update: bool = False, machine: str = platform.machine()
) -> Checked:
    """Replay a recording and compare its report with the expected one; ``update`` writes it as the expected one."""
    try:
        expected = {} if update else _read_report(expected_path(recording))
        report = report_of(recording, options)
        if update:
            return _keep(report, recording, name)
    except (GseError, DriverError, ProtocolError) as error:
        return Checked(name, "", error=plain_lines(str(error)))
    aside = _Aside(takes_digits=may_differ_by_a_digit(machine))
    found = list(_differences(expected, report, "", aside))
    differences, new, allowed = (
        tuple(map(plain_line, lines[:MOST_DIFFERENCES])) for lines in (found, aside.new, aside.digits)
    )
    return Checked(name, report["verdict"], differences, new, allowed)


def check_answers(
    recording: Path, name: str, options: ReplayOptions, identifier: str, *, within_arcsec: float | None, update: bool
) -> Checked:
    """Replay a recording under an identifier and compare its answers with the expected ones; ``update`` writes them."""
    path, given = recording.with_name(recording.name.removesuffix(".mcap") + SUFFIX), GivenAnswers()
    try:
        expected = None if update else read_answers(path)
        session = replay_session(
            recording, options=options, station=change_to(None, identifier), make_listeners=lambda loop: [given]
        ).session
        verdict, rows = judge(session).verdict.value, given.rows()
        if expected is None:
            write_answers(path, given.lines, session)
            kept = compare_answers(rows, rows)
            return Checked(name, verdict, note=kept.text_kept, answers=kept)
        expected.check_session(session)
    except (GseError, DriverError, ProtocolError) as error:
        return Checked(name, "", error=plain_lines(str(error)))
    answers = compare_answers(expected.rows, rows, within_arcsec=within_arcsec)
    differences = () if answers.is_same else answers.listed or (answers.text,)
    note = "; ".join(text for text in (answers.text, expected.other_program(session)) if text)
    return Checked(name, verdict, differences, note=note, answers=answers)


def report_of(recording: Path, options: ReplayOptions) -> dict[str, Any]:
    """The report of a recording."""
    session = replay_session(recording, options=options).session
    return summarise(session, judge(session))


def junit_of(outcomes: list[Checked], folder: Path) -> str:
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
        ET.SubElement(case, "system-out").text = "\n".join([outcome.verdict, *outcome.lines])
    ET.indent(suite)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(suite, encoding="unicode") + "\n"


def _keep(report: dict[str, Any], recording: Path, name: str) -> Checked:
    path = expected_path(recording)
    try:
        write_whole(path, [json.dumps(report, indent=1, allow_nan=False) + "\n"])
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
    return Checked(name, report["verdict"])


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


@dataclass(slots=True)
class _Aside:
    """What is listed beside the differences: places that only the new report has, and last digits that may differ."""

    takes_digits: bool
    new: list[str] = field(default_factory=list)
    digits: list[str] = field(default_factory=list)


def _differences(expected: Any, found: Any, where: str, aside: _Aside) -> Iterator[str]:
    """Each place of the expected report where the found one differs, by its path.

    What only the found one has is put ``aside`` as new: a later version may state more. A row of the verdict that the
    station asks for must pass, though.
    """
    if where in _NOT_COMPARED:
        return
    if isinstance(expected, dict) and isinstance(found, dict):
        yield from _different_keys(expected, found, where, aside)
    elif isinstance(expected, list) and isinstance(found, list):
        yield from _different_items(expected, found, where, aside)
    elif expected != found:
        line = f"{where}: expected {_brief(expected)}, got {_brief(found)}"
        if aside.takes_digits and _by_last_digit(expected, found):
            aside.digits.append(line)
        else:
            yield line


def _by_last_digit(one: Any, other: Any) -> bool:
    """Whether two printed numbers differ by one unit of the last digit that either has."""
    if not (isinstance(one, float) and isinstance(other, float)):
        return False
    numbers = [Decimal(repr(value)) for value in (one, other)]
    return abs(numbers[0] - numbers[1]) <= min(Decimal(1).scaleb(int(number.as_tuple().exponent)) for number in numbers)


def _different_keys(expected: dict[str, Any], found: dict[str, Any], where: str, aside: _Aside) -> Iterator[str]:
    for key, value in expected.items():
        place = f"{where}.{key}".lstrip(".")
        if key in found:
            yield from _differences(value, found[key], place, aside)
        else:
            yield f"{place} is missing: expected {_brief(value)}"
    aside.new += [f"{where}.{key}".lstrip(".") for key in found if key not in expected]


def _different_items(expected: list[Any], found: list[Any], where: str, aside: _Aside) -> Iterator[str]:
    if where == _WORDS_ON_ROWS and all(isinstance(line, str) for line in (*expected, *found)):
        yield from (f"{where} lacks {_brief(line)}" for line in sorted(_untested(expected) - _untested(found)))
        aside.new += [f"{where}: {line}" for line in sorted(_untested(found) - _untested(expected))]
        return
    rows, found_rows = _by_name(expected), _by_name(found)
    if rows is None or found_rows is None:
        if len(expected) != len(found):
            yield f"{where}: expected {len(expected)} items, got {len(found)}"
        for place, pair in enumerate(zip(expected, found, strict=False)):
            yield from _differences(*pair, f"{where}[{place}]", aside)
        return
    for name, row in rows.items():
        if name in found_rows:
            yield from _differences(row, found_rows[name], f"{where}[{name}]", aside)
        else:
            yield f"{where}[{name}] is missing"
    if [name for name in found_rows if name in rows] != [name for name in rows if name in found_rows]:
        yield f"{where}: the rows are in another order"
    for name in found_rows.keys() - rows.keys():
        yield from _new_row(found_rows[name], f"{where}[{name}]", aside)


def _untested(lines: list[str]) -> set[str]:
    """The lines on what was not tested, one that names several rows taken apart."""
    apart = set()
    for line in lines:
        head, mark, names = line.partition(LEFT_OUT)
        apart |= {f"{head}{mark}{name}" for name in names.split("; ")} if mark else {line}
    return apart


def _new_row(row: dict[str, Any], where: str, aside: _Aside) -> Iterator[str]:
    """A row that is only in the found report; one of the verdict without a limit is asked for by nobody."""
    outcome = row.get("outcome", _PASS)
    if outcome != _PASS and row.get("limit") is not None:
        yield f"{where} is new, and {outcome}: {row.get('reason')}"
    else:
        aside.new.append(where)


def _by_name(items: list[Any]) -> dict[str, dict[str, Any]] | None:
    """The rows of a table by subject, name and axis; None where these do not tell the items apart."""
    if not all(isinstance(item, dict) and "name" in item for item in items):
        return None
    rows = {" ".join(str(item[key]) for key in ("subject", "name", "axis") if item.get(key)): item for item in items}
    return rows if len(rows) == len(items) else None


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 100 else text[:97] + "..."
