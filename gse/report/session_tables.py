"""The three tables of one session."""

from dataclasses import dataclass

import pyarrow as pa

from gse.report.frames_table import frames_table
from gse.report.result_key import ResultKey
from gse.report.sessions_table import sessions_table
from gse.report.stars_table import stars_table
from gse.station.session_data import SessionData
from gse.verdict.assessment import Assessment


@dataclass(frozen=True, slots=True, eq=False)
class SessionTables:
    """Tables of sessions, frames and stars; their rows are joined by ``key``, frames and stars also by ``frame``."""

    sessions: pa.Table
    frames: pa.Table
    stars: pa.Table


def session_tables(
    session: SessionData, assessment: Assessment, key: ResultKey, *, source: str | None = None
) -> SessionTables:
    """The tables of a judged session; ``source`` says where it came from, ``key`` what its results follow from."""
    return SessionTables(
        sessions_table(session, assessment, key, source=source),
        frames_table(session, assessment.statistics, key.text),
        stars_table(session, key.text),
    )
