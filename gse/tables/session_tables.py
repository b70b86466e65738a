"""The three tables of one session."""

from dataclasses import dataclass

import pyarrow as pa

from gse.assessment.verdict import Assessment
from gse.station.session_data import SessionData
from gse.tables.frames import frames_table
from gse.tables.key import ResultKey
from gse.tables.sessions import sessions_table
from gse.tables.stars import stars_table


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
