"""Tables of judged sessions for other programs: Arrow and Parquet, with units in names and in metadata.

    sessions  one row per session: verdict, every figure with its interval, conditions, hashes
    frames    one row per panorama: time, the subjects' answers, their errors, the sky
    stars     one row per matched star and frame: residual, pixel phase, place in the field, temperature

docs/tables.md lists the columns. Reads ``SessionData`` and ``Assessment``; writes no file. May not import report.
"""

from gse.tables.frames import frames_parts, frames_schema, frames_table
from gse.tables.key import ResultKey
from gse.tables.session_tables import SessionTables, session_tables
from gse.tables.sessions import failed_session, sessions_schema, sessions_table
from gse.tables.stars import stars_parts, stars_schema, stars_table
from gse.tables.units import SCHEMA_VERSION

__all__ = [
    "SCHEMA_VERSION",
    "ResultKey",
    "SessionTables",
    "failed_session",
    "frames_parts",
    "frames_schema",
    "frames_table",
    "session_tables",
    "sessions_schema",
    "sessions_table",
    "stars_parts",
    "stars_schema",
    "stars_table",
]
