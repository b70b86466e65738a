"""The files of a report, written into the folder of a session."""

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow.csv import WriteOptions, write_csv

from drivers.host_files import whole_files
from gse.errors import UsageError
from gse.report.conclusion import conclusion_lines
from gse.report.page import report_html
from gse.report.provenance import Provenance, provenance, report_sha256
from gse.report.summary import summarise
from gse.report.terminal import further_lines, is_simple, risk_text
from gse.station.columns import COLUMNS, OWN_COLUMNS, Column
from gse.station.frame_columns import Columns
from gse.station.housekeeping import firmware_text, latest_status
from gse.station.own_answers import SensorAnswers
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.verdict.assessment import Assessment
from protocols import StatusMessage

# frames.csv: one line per panorama, for a spreadsheet.

_ROWS_AT_ONCE = 1 << 12
"""More take more memory, and hardly less time."""
_DIGITS = 20
"""A number with more is of a sensor gone wrong: it is written as Python writes it."""
_INSTANT = "utc_ns"
"""It comes first, in words."""
_COMMON = tuple(column for column in COLUMNS if not column.of_answer and column.name != _INSTANT)
_OF_ANSWER = tuple(column for column in COLUMNS if column.of_answer)
_OF_STATUS = ("firmware", "serial")


def frames_csv(
    frames: Columns,
    own: SensorAnswers | None = None,
    subject: Subject = Subject.ONBOARD,
    statuses: Sequence[tuple[int, StatusMessage]] = (),
) -> Iterator[str]:
    """Rows of FRAME as text, UTC first; cells of unknown values are empty. It comes in parts: a session has 60 MB.

    Columns of answers begin with their ``subject``; those that came beside panoramas with ``sensor_``. Firmware and
    serial number are those of the latest of ``statuses``, each with its host UTC.
    """
    beside = OWN_COLUMNS if own is not None else ()
    answers = [column.name_of(subject) for column in _OF_ANSWER]
    answers += [f"{Subject.SENSOR}_{column.name}" for column in beside]
    yield ",".join(["utc", *(column.name for column in _COMMON), *_OF_STATUS, *answers]) + "\n"
    known = [pa.array([word or None for word in words], pa.string()) for words in _words_of(statuses)]
    latest = latest_status(frames["host_utc_ns"], statuses)
    for first in range(0, len(frames), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        columns = [_utc(frames[_INSTANT][rows])]
        columns += [_texts(column, frames[column.name][rows]) for column in _COMMON]
        columns += [words.take(pa.array(latest[rows] % len(words))) for words in known]
        columns += [_texts(column, frames[column.name][rows]) for column in _OF_ANSWER]
        columns += [_texts(column, getattr(own, column.name)[rows]) for column in beside]
        yield _lines(columns)


def _words_of(statuses: Sequence[tuple[int, StatusMessage]]) -> tuple[list[str], list[str]]:
    """Firmware and serial number of each, and empty ones last, for -1."""
    messages = [message for _, message in statuses]
    firmware = [*map(firmware_text, messages), ""]
    return firmware, [*(str(message.serial) if message.serial else "" for message in messages), ""]


def _lines(columns: list[pa.Array]) -> str:
    table = pa.table(columns, names=[str(number) for number in range(len(columns))])
    text = pa.BufferOutputStream()
    write_csv(table, text, WriteOptions(include_header=False, quoting_style="none"))
    return str(text.getvalue().to_pybytes(), "utf-8")


def _utc(utc_ns: NDArray[np.int64]) -> pa.Array:
    """RFC 3339, cut to microseconds."""
    return pa.array(np.datetime_as_string((utc_ns // 1000).astype("datetime64[us]"), timezone="UTC"))


def _texts(column: Column, values: NDArray[Any]) -> pa.Array:
    """A column as Arrow writes it: words, whole numbers, numbers with a fixed count of decimals, null where unknown."""
    values = np.ascontiguousarray(values)
    if column.words:
        words = pa.array([word.value for word in column.words])
        return words.take(pa.array(values))
    if values.dtype.kind != "f":
        return pa.array(values.astype(np.uint8) if values.dtype.kind == "b" else values)
    if column.significant:
        distinct, places = np.unique(values, return_inverse=True)  # it follows from a few counts of stars
        words = pa.array([f"{value:.{column.significant}g}" for value in distinct.tolist()])
        return words.take(pa.array(places, mask=np.isnan(values)))
    decimals = column.shown_decimals
    try:
        return pa.array(values.astype(np.float64), from_pandas=True).cast(pa.decimal128(_DIGITS, decimals))
    except pa.ArrowInvalid:
        return pa.array([f"{value:.{decimals}f}" for value in values.tolist()], mask=np.isnan(values))


# junit.xml: the measurements as test cases, for a CI server.

_SESSION, _STEP = "session", "procedure"


def junit_xml(report: dict[str, Any]) -> str:
    """One test case per row of a report and one for the verdict.

    INCONCLUSIVE is an error of that type, a row that was not tested is skipped.
    """
    verdict = {
        "subject": _SESSION,
        "name": "verdict",
        "relative": report["relative"],
        "outcome": report["verdict"],
        "reason": "\n".join([*conclusion_lines(report["conclusion"], "SESSION"), *further_lines(report)]),
    }
    steps = [_of_step(step) for step in report.get("procedure", {}).get("steps", ())]
    measurements = [*steps, *report["measurements"], verdict]
    outcomes = [measurement["outcome"] for measurement in measurements]
    suite = ET.Element(
        "testsuite",
        name=f"gse {report['session']['sensor']}" + (" SIMULATED" if report["simulated"] else ""),
        tests=str(len(outcomes)),
        failures=str(outcomes.count("FAIL")),
        errors=str(outcomes.count("INCONCLUSIVE")),
        skipped=str(outcomes.count("not tested")),
        timestamp=(report["session"]["first_utc"] or "")[:19],
    )
    for measurement in measurements:
        suite.append(_case(measurement, report))
    ET.indent(suite)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(suite, encoding="unicode") + "\n"


def _of_step(step: dict[str, Any]) -> dict[str, Any]:
    """A step as a test case; one that was not done is an error, as what is not decided is."""
    return {
        "subject": _STEP,
        "name": f"step {step['number']}: {step['planned']}",
        "relative": False,
        "outcome": "INCONCLUSIVE" if step["outcome"] == "not done" else step["outcome"],
        "reason": step["seen"],
        "seen": f"{step['outcome']}: {step['seen']}" + (f" ({step['by']})" if step["by"] else ""),
    }


def _case(measurement: dict[str, Any], report: dict[str, Any]) -> ET.Element:
    case = ET.Element("testcase", classname=f"gse.{measurement['subject']}", name=measurement["name"])
    if measurement["subject"] == _SESSION:
        text = "; ".join(conclusion_lines(report["conclusion"], "SESSION"))
    elif measurement["subject"] == _STEP:
        text = measurement["seen"]
    else:
        text = _figures(measurement)
    if measurement["relative"]:
        text += "; relative to a mount fitted on the same sky: absolute pointing, site and clock not tested"
    if is_simple(report) and "false_pass_risk" in measurement:
        text += f"; decided by the value alone, risk of a false PASS {risk_text(measurement)}"
    if measurement["outcome"] == "FAIL":
        ET.SubElement(case, "failure", message=text).text = measurement["reason"]
    elif measurement["outcome"] == "INCONCLUSIVE":
        ET.SubElement(case, "error", type="INCONCLUSIVE", message=text).text = measurement["reason"]
    elif measurement["outcome"] == "not tested":
        ET.SubElement(case, "skipped", message=f"not tested: {measurement['reason']}")
    ET.SubElement(case, "system-out").text = text
    return case


def _figures(measurement: dict[str, Any]) -> str:
    value, uncertainty, limit = (_number(measurement[key]) for key in ("value", "uncertainty", "limit"))
    text = f"{value} {measurement['unit']}".rstrip() + f", U {uncertainty}, "
    return text + ("no limit stated" if measurement["limit"] is None else f"limit {limit}")


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:g}"


_FILES = ("report.html", "frames.csv", "junit.xml", "provenance.json", "report.json")


def write_report(
    session: SessionData,
    assessment: Assessment,
    folder: Path,
    made_by: Provenance | None = None,
    *,
    plots: bool = True,
    paper: bool = False,
) -> dict[str, Path]:
    """Write report.json, report.html, frames.csv, junit.xml and provenance.json; their paths by name.

    All but provenance.json and the last page of report.html, which say what the report is ``made_by``, follow from the
    session, its station file and the version alone. An earlier report in the folder is replaced once all files are
    written, or not at all. report.json comes last: where it stands, the report is whole. ``plots`` are most of the time
    it takes; ``paper``: with Table 4-1 of the LAPAN paper.
    """
    if not folder.is_dir():
        raise UsageError(f"cannot write the report into {folder}: there is no such folder")
    report = summarise(session, assessment)
    made_by = provenance(session.versions, None) if made_by is None else made_by
    rows = frames_csv(session.frames.columns, assessment.statistics.own, session.subject, session.statuses)
    paths = {name: folder / name for name in _FILES}
    try:
        with whole_files() as write:
            with ThreadPoolExecutor(1) as beside:  # most of frames.csv is Arrow's work, which lets the plots be drawn
                csv = beside.submit(write, paths["frames.csv"], rows)
                page = report_html(session, assessment, report, made_by, plots=plots, paper=paper)
                write(paths["report.html"], [page])
            csv.result()
            write(paths["junit.xml"], [junit_xml(report)])
            write(paths["provenance.json"], [_json(made_by | {"report_sha256": report_sha256(report)})])
            write(paths["report.json"], [_json(report)])
    except OSError as error:
        raise UsageError(f"cannot write the report into {folder}: {error.strerror}; is the disk full?") from error
    return paths


def _json(document: Mapping[str, Any]) -> str:
    return json.dumps(document, indent=2, allow_nan=False) + "\n"
