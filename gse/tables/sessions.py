"""The table of sessions: one row per session, with verdict, every figure and its interval, conditions, hashes.

Both subjects have their columns in every row; figures that a session does not have are null. A session that could not
be judged is a row too, with its error and nulls.
"""

from collections.abc import Iterable, Iterator
from datetime import date

import numpy as np
import pyarrow as pa

from gse import instant
from gse.assessment.verdict import Assessment
from gse.station.session_data import SessionData
from gse.statistics.decision import Row
from gse.tables.conditions import conditions
from gse.tables.figures import figures, truth_figures
from gse.tables.key import ResultKey
from gse.tables.records import TEXT, UTC, WORDS, Column, column, columns_of, records
from gse.tables.units import schema

_NS_PER_DEG = instant.NS_PER_DAY // 360
"""The mean Sun goes by 15 deg in an hour."""


def sessions_schema() -> pa.Schema:
    """The schema of the table of sessions."""
    return schema("sessions", [of_one.field for of_one in _row(None, None, None)])


def sessions_table(
    session: SessionData, assessment: Assessment, key: ResultKey, *, source: str | None = None
) -> pa.Table:
    """The one row of a judged session; ``source`` says where it came from."""
    return _table(_row(key, session, assessment, source=source))


def failed_session(source: str, error: str, key: ResultKey | None = None) -> pa.Table:
    """The row of a session that could not be judged, and why."""
    return _table(_row(key, None, None, source=source, error=error))


def night_of(utc_ns: int, longitude_deg: float) -> date:
    """The date of the evening on which the night of an instant began, in the local mean time of a longitude."""
    since_noon_ns = utc_ns + round(longitude_deg * _NS_PER_DEG) - instant.NS_PER_DAY // 2
    return date.fromisoformat(instant.to_text(max(since_noon_ns, 0))[:10])


def _table(row: Iterable[Column]) -> pa.Table:
    columns = list(row)
    arrays = [pa.array([of_one.value], of_one.field.type) for of_one in columns]
    return pa.table(arrays, schema=schema("sessions", [of_one.field for of_one in columns]))


def _row(
    key: ResultKey | None,
    session: SessionData | None,
    assessment: Assessment | None,
    *,
    source: str | None = None,
    error: str | None = None,
) -> Iterator[Column]:
    yield column("key", TEXT, key.text if key else None)
    yield from columns_of(ResultKey, key)
    yield column("source", TEXT, source)
    yield column("error", TEXT, error)
    yield from _identity(session)
    yield from _verdict(assessment)
    yield from figures(assessment.statistics if assessment else None)
    yield from truth_figures(assessment.budget if assessment else None)
    yield from conditions(session, assessment.statistics if assessment else None)


def _identity(session: SessionData | None) -> Iterator[Column]:
    """Which sensor, when, and from which bytes."""
    utc_ns = session.frames.columns["utc_ns"] if session else np.zeros(0, np.int64)
    first, last = (int(utc_ns.min()), int(utc_ns.max())) if len(utc_ns) else (None, None)
    night = night_of(first, session.station.site.longitude_deg) if session and first is not None else None
    yield column("sensor", TEXT, session.station.sensor.name if session else None)
    yield column("sensor_serial", TEXT, _serial(session) if session else None)
    yield column("night", pa.date32(), night)
    yield column("first_utc", UTC, first)
    yield column("last_utc", UTC, last)
    yield column("raw_sha256", TEXT, session.raw_sha256 if session else None)
    yield column("protocol", TEXT, session.protocol_name if session else None)
    yield column("version", TEXT, session.versions.get("gse-star-sensor") if session else None)
    packages = [f"{name} {version}" for name, version in session.versions.items()] if session else None
    yield column("packages", WORDS, packages)
    yield column("test_id", TEXT, session.station.test.id if session else None)


def _serial(session: SessionData) -> str | None:
    """As the sensor sends it, else as the station file states it."""
    sent = next((str(message.serial) for _, message in session.statuses if message.serial), None)
    return sent or session.station.test.sensor_serial


def _verdict(assessment: Assessment | None) -> Iterator[Column]:
    """``damaged`` is the column ``truncated`` of the conditions."""
    yield from columns_of(Assessment, assessment, without=("rows", "statistics", "budget", "damaged"))
    yield records(Row, assessment.rows if assessment else None, "measurements")
