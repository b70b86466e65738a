"""The files of a report, written into the folder of a session."""

import json
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from drivers.whole_file import write_whole
from gse.assessment.verdict import Assessment
from gse.errors import UsageError
from gse.report.fingerprint import report_sha256
from gse.report.frames_csv import frames_csv
from gse.report.junit import junit_xml
from gse.report.page import report_html
from gse.report.provenance import Provenance, provenance
from gse.report.summary import summarise
from gse.station.session_data import SessionData

_FILES = ("report.html", "frames.csv", "junit.xml", "provenance.json", "report.json")


def write_report(
    session: SessionData,
    assessment: Assessment,
    folder: Path,
    made_by: Provenance | None = None,
    *,
    plots: bool = True,
) -> dict[str, Path]:
    """Write report.json, report.html, frames.csv, junit.xml and provenance.json; their paths by name.

    All but provenance.json and the last page of report.html, which say what the report is ``made_by``, follow from the
    session, its station file and the version alone. An earlier report in the folder is replaced, each file whole or
    not at all. report.json comes last: where it stands, the report is whole. ``plots`` are most of the time it takes.
    """
    if not folder.is_dir():
        raise UsageError(f"cannot write the report into {folder}: there is no such folder")
    report = summarise(session, assessment)
    made_by = provenance(session.versions, None) if made_by is None else made_by
    rows = frames_csv(session.frames.columns, assessment.statistics.own, session.subject, session.statuses)
    paths = {name: folder / name for name in _FILES}
    try:
        with ThreadPoolExecutor(1) as beside:  # most of frames.csv is Arrow's work, which lets the plots be drawn
            csv = beside.submit(write_whole, paths["frames.csv"], rows)
            write_whole(paths["report.html"], [report_html(session, assessment, report, made_by, plots=plots)])
        csv.result()
        write_whole(paths["junit.xml"], [junit_xml(report)])
        write_whole(paths["provenance.json"], [_json(made_by | {"report_sha256": report_sha256(report)})])
        write_whole(paths["report.json"], [_json(report)])
    except OSError as error:
        raise UsageError(f"cannot write the report into {folder}: {error.strerror}; is the disk full?") from error
    return paths


def _json(document: Mapping[str, Any]) -> str:
    return json.dumps(document, indent=2, allow_nan=False) + "\n"
