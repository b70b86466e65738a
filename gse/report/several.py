"""Report of several sessions side by side: table 4-1 of the LAPAN paper as the paper has it, a row for each sensor."""

import math
from collections.abc import Sequence
from statistics import fmean
from typing import Any

from gse.report.conclusion import headline
from gse.report.page import page_environment, page_style
from gse.report.summary import LIMIT_DEG, PAPER, PaperRow, plain, table_row, this_sensor
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.values import instant
from gse.verdict.assessment import Assessment

SCHEMA = "gse.sessions/1"


def sessions_report(named: Sequence[tuple[str, SessionData, Assessment]]) -> dict[str, Any]:
    """The JSON of schema gse.sessions/1 of named sessions: their verdicts, and table 4-1 with a row for each subject.

    Below the rows of a subject that several sessions have is their mean, as in the paper.
    """
    return {
        "schema": SCHEMA,
        "sessions": [_session(*one) for one in named],
        "table_4_1": {"rows": plain([table_row(row) for row in (*_rows(named), *PAPER)]), "limit_deg": LIMIT_DEG},
    }


def _session(name: str, session: SessionData, assessment: Assessment) -> dict[str, Any]:
    frames = session.frames.columns
    return {
        "name": name,
        "sensor": session.station.sensor.name,
        "first_utc": instant.to_text(int(frames["utc_ns"].min())) if len(frames) else None,
        "frames": len(frames),
        "verdict": assessment.verdict.value,
        "word": headline(assessment.word, simulated=assessment.simulated),
        "reasons": list(assessment.reasons),
        "raw_sha256": session.raw_sha256,
    }


def _rows(named: Sequence[tuple[str, SessionData, Assessment]]) -> list[PaperRow]:
    by_subject: dict[Subject, list[PaperRow]] = {}
    for name, session, assessment in named:
        for subject, figures in assessment.statistics.subjects.items():
            label = f"{session.station.sensor.name}, {name}, {subject}"
            by_subject.setdefault(subject, []).append(this_sensor(label, figures))
    rows = []
    for subject, of_subject in by_subject.items():
        rows += of_subject
        known = [row for row in of_subject if math.isfinite(row.d_ra_deg) and math.isfinite(row.d_de_deg)]
        if len(known) > 1:
            d_ra_deg, d_de_deg = fmean(row.d_ra_deg for row in known), fmean(row.d_de_deg for row in known)
            rows.append(PaperRow(f"mean of {len(known)}, {subject}", d_ra_deg, d_de_deg, ""))
    return rows


def sessions_html(report: dict[str, Any]) -> str:
    """The page of several sessions."""
    return page_environment().get_template("sessions.html.jinja").render(report=report, style=page_style())
