"""The files of a report, written into the folder of a session."""

import json
from collections.abc import Iterable
from pathlib import Path

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


def write_report(
    session: SessionData, assessment: Assessment, folder: Path, made_by: Provenance | None = None
) -> dict[str, Path]:
    """Write report.json, report.html, frames.csv, junit.xml and provenance.json; their paths by name.

    All but provenance.json and the last page of report.html, which say what the report is ``made_by``, follow from the
    session, its station file and the version alone. An earlier report in the folder is replaced, each file whole or
    not at all. report.json comes last: where it stands, the report is whole.
    """
    if not folder.is_dir():
        raise UsageError(f"cannot write the report into {folder}: there is no such folder")
    report = summarise(session, assessment)
    made_by = provenance(session.versions, None) if made_by is None else made_by
    texts: dict[str, Iterable[str]] = {
        "report.html": [report_html(session, assessment, report, made_by)],
        "frames.csv": frames_csv(session.frames.columns, assessment.statistics.own, session.subject),
        "junit.xml": [junit_xml(report)],
        "provenance.json": [json.dumps(made_by | {"report_sha256": report_sha256(report)}, indent=2) + "\n"],
        "report.json": [json.dumps(report, indent=2, allow_nan=False) + "\n"],
    }
    paths = {name: folder / name for name in texts}
    try:
        for name, path in paths.items():
            write_whole(path, texts[name])
    except OSError as error:
        raise UsageError(f"cannot write the report into {folder}: {error.strerror}; is the disk full?") from error
    return paths
