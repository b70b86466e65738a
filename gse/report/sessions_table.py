"""The table of sessions: one row per session, with verdict, every figure and its interval, conditions, hashes.

Both subjects have their columns in every row; figures that a session does not have are null. A session that could not
be judged is a row too, with its error and nulls. ``session_tables`` are this row and the other tables.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import date

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gse.procedure.as_run import StepRun
from gse.report.parquet import (
    COUNT,
    FLAG,
    NUMBER,
    TEXT,
    UTC,
    WORDS,
    TableCell,
    column,
    columns_of,
    joined,
    records,
    schema,
)
from gse.report.provenance import ResultKey
from gse.report.tables import frames_parts, housekeeping_parts, names_parts, stars_parts
from gse.station.columns import ANSWER_CHECKS, COLUMNS, STATUSES
from gse.station.results import LinkCounters, Subject
from gse.station.session_data import SessionData
from gse.statistics.axis_statistics import AxisStatistics
from gse.statistics.decision import Row
from gse.statistics.sampling import Bounds
from gse.statistics.session_statistics import Statistics
from gse.statistics.sky_summary import sky_summary
from gse.statistics.spatial_errors import SpatialErrors
from gse.statistics.subject_statistics import SubjectStatistics, ThermalError
from gse.statistics.truth_budget import TruthUncertaintyBudget
from gse.statistics.uncertainty import AxisUncertainty, Term
from gse.values import instant
from gse.values.axis import ALL_AXES, AXES, CROSS_X, CROSS_Y, OF_SENSOR
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.limits import Limits
from gse.values.mount import Mount
from gse.values.site import Site
from gse.verdict.assessment import Assessment

# Conditions of a session as columns: sky, air, link, mount, camera, and what was excluded.

_RANGE = (("min", 0), ("median", 50), ("max", 100))
"""Names of percentiles."""


@dataclass(frozen=True, slots=True)
class NamedCount:
    """How many of what."""

    name: str
    count: int


@dataclass(frozen=True, slots=True)
class ExcludedStretch:
    """A stretch that the statistics leave out, with its frames; instants in RFC 3339."""

    from_utc: str
    until_utc: str
    cause: str
    reason: str
    frames: int


def conditions(session: SessionData | None, stats: Statistics | None) -> Iterator[TableCell]:
    """The columns of the conditions; null without a session."""
    station = session.station if session else None
    for ranged in COLUMNS:
        if ranged.ranged:
            yield from _range(ranged.name, session.frames.columns[ranged.name] if session else np.zeros(0))
    yield column("sky_condition", TEXT, _sky_condition(session) if session else None)
    yield records(ExcludedStretch, _stretches(stats) if stats else None, "exclusions")
    yield from _link(session)
    yield from columns_of(Site, station.site if station and not station.subject else None, "site")
    yield from _mount(session)
    yield from columns_of(Camera, station.sensor.camera() if station else None, "camera")
    yield from columns_of(IdentifierOptions, station.identifier if station else None, "identifier")
    yield from columns_of(Limits, station.limits if station else None, "limit", without=("items",))
    for name, kind in (("source", TEXT), ("stars", COUNT), ("sha256_of_ids", TEXT), ("epoch_jyear", NUMBER)):
        yield column(f"catalog_{name}", kind, session.catalog.get(name) if session else None)


def _sky_condition(session: SessionData) -> str | None:
    """The condition of the sky in most frames."""
    summary = sky_summary(session.frames.columns)
    return summary.condition.value if summary else None


def _range(name: str, values: NDArray[np.generic]) -> Iterator[TableCell]:
    """Least, median and greatest of the known values of a column."""
    numbers = values.astype(np.float64)
    known = numbers[np.isfinite(numbers)]
    for word, percent in _RANGE:
        yield column(joined(name, word), NUMBER, float(np.percentile(known, percent)) if len(known) else None)


def _stretches(stats: Statistics) -> list[ExcludedStretch]:
    return [
        ExcludedStretch(
            instant.to_text(item.from_ns), instant.to_text(item.until_ns), item.cause.value, item.reason, frames
        )
        for item, frames in stats.exclusions
    ]


def _link(session: SessionData | None) -> Iterator[TableCell]:
    by_reason = "discarded_bytes_by_reason"
    yield from columns_of(LinkCounters, session.link if session else None, "link", without=(by_reason,))
    yield records(NamedCount, _counts(session.link.discarded_bytes_by_reason) if session else None, f"link_{by_reason}")
    yield column("truncated", FLAG, session.truncated if session else None)
    kinds = Counter(str(event.kind) for event in session.events) if session else {}
    yield records(NamedCount, _counts(kinds) if session else None, "events")
    yield column("clock_stated_error_s", NUMBER, session.clock_error_s if session else None)


def _counts(counts: Mapping[str, int]) -> Iterable[NamedCount]:
    return [NamedCount(name, count) for name, count in sorted(counts.items())]


def _mount(session: SessionData | None) -> Iterator[TableCell]:
    """The mount in force; where it was fitted on the session itself also its standard deviations."""
    fit = session.alignment if session else None
    mount = fit.mount if fit else session.station.mount if session else None
    yield from columns_of(Mount, mount, "mount")
    yield column("mount_fit_frames", pa.int64(), fit.n if fit else None)
    is_known = fit is not None and bool(np.isfinite(fit.covariance_arcsec2).all())
    sigmas_arcsec = fit.sigma_azimuth_altitude_roll_arcsec if fit and is_known else (None, None, None)
    for angle, sigma_arcsec in zip(("azimuth", "altitude", "roll"), sigmas_arcsec, strict=True):
        yield column(f"mount_fit_sigma_{angle}_arcsec", NUMBER, sigma_arcsec)


# Figures of a session as columns: statistics of each subject, and the truth uncertainty.

_BY_KEY = (
    "statuses",
    "answer_checks",
    "subjects",
    "spatial",
    "exclusions",
    "counted",
    "own",
    "own_counted",
    "answers_excluded",
    "incidents",
    "arrival_ms",
)
"""Fields of Statistics that are not plain values: they have columns of their own."""


def figures(stats: Statistics | None) -> Iterator[TableCell]:
    """The columns of all statistics; null without any."""
    yield from columns_of(Statistics, stats, without=_BY_KEY)
    for stem, words, counts in (
        ("status", STATUSES, stats.statuses if stats else {}),
        ("answer_check", ANSWER_CHECKS, stats.answer_checks if stats else {}),
    ):
        for word in words:
            yield column(f"{stem}_{word.value.lower()}", COUNT, counts.get(word.value))
    for subject in Subject:
        yield from _of_subject(subject, stats.subjects.get(subject) if stats else None)
    for place, axis in enumerate((CROSS_X, CROSS_Y)):
        of_axis = stats.spatial[place] if stats and stats.spatial else None
        yield from columns_of(SpatialErrors, of_axis, f"onboard_{axis.key}_star")


def _of_subject(subject: Subject, stats: SubjectStatistics | None) -> Iterator[TableCell]:
    others = ("subject", "axes", "thermal", "time_is_stated", "at_confidence")
    yield from columns_of(SubjectStatistics, stats, subject.value, without=others)
    for axis in ALL_AXES:
        stem = f"{subject.value}_{axis.key}"
        yield from columns_of(AxisStatistics, stats.axes[axis.key] if stats else None, stem)
        yield from columns_of(ThermalError, stats.thermal.get(axis.key) if stats else None, f"{stem}_thermal")
    for axis in OF_SENSOR:
        stem, figure = f"{subject.value}_{axis.key}_at_confidence", stats.at_confidence.get(axis.key) if stats else None
        yield column(f"{stem}_arcsec", NUMBER, figure.value if figure else None)
        yield from columns_of(Bounds, figure.bounds if figure else None, f"{stem}_bounds_arcsec")


def truth_figures(budget: TruthUncertaintyBudget | None) -> Iterator[TableCell]:
    """The columns of the truth uncertainty budget."""
    for axis in AXES:
        of_axis = budget.axes[axis.key] if budget else None
        # k is expanded / standard; a column that ends in _k is in kelvin.
        yield from columns_of(AxisUncertainty, of_axis, f"truth_{axis.key}", without=("k",))
    yield records(Term, budget.terms if budget else None, "truth_terms")


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


def _table(row: Iterable[TableCell]) -> pa.Table:
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
) -> Iterator[TableCell]:
    yield column("key", TEXT, key.text if key else None)
    yield from columns_of(ResultKey, key)
    yield column("source", TEXT, source)
    yield column("error", TEXT, error)
    yield from _identity(session)
    yield from _verdict(assessment)
    yield from figures(assessment.statistics if assessment else None)
    yield from truth_figures(assessment.budget if assessment else None)
    yield from conditions(session, assessment.statistics if assessment else None)


def _identity(session: SessionData | None) -> Iterator[TableCell]:
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


def _verdict(assessment: Assessment | None) -> Iterator[TableCell]:
    """``damaged`` is the column ``truncated`` of the conditions."""
    without = ("rows", "statistics", "budget", "damaged", "growing", "slew", "procedure")
    yield from columns_of(Assessment, assessment, without=without)
    log = assessment.procedure.log if assessment and assessment.procedure else None
    yield column("procedure", TEXT, log.name if log else None)
    yield records(StepRun, log.steps if log else None, "steps")
    yield records(Row, assessment.rows if assessment else None, "measurements")


@dataclass(frozen=True, slots=True, eq=False)
class SessionTables:
    """Tables of sessions, frames, stars, housekeeping and names; their rows are joined by ``key``.

    Those of frames and stars are joined by ``frame``, too.
    """

    sessions: pa.Table
    frames: pa.Table
    stars: pa.Table
    housekeeping: pa.Table
    names: pa.Table


def session_tables(
    session: SessionData, assessment: Assessment, key: ResultKey, *, source: str | None = None
) -> SessionTables:
    """The tables of a judged session; ``source`` says where it came from, ``key`` what its results follow from."""
    return SessionTables(
        sessions_table(session, assessment, key, source=source),
        _whole(frames_parts(session, assessment.statistics, key.text)),
        _whole(stars_parts(session, key.text)),
        _whole(housekeeping_parts(session, key.text)),
        _whole(names_parts(session, key.text)),
    )


def _whole(parts: Iterator[pa.Table]) -> pa.Table:
    """A table of its parts."""
    return pa.concat_tables(parts, promote_options="none").unify_dictionaries()
