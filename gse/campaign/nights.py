"""Nights of a campaign: which sessions count, which are left out, and why.

A session is left out where it could not be judged, where no answer of it was compared with truth, where more than half
of its panoramas had no sky, or where it is INCONCLUSIVE though its rows are decided: steps of the clock, a mount that
was fitted far from the stated one. So is the damaged copy of another session, whose frames would count twice. None is
ever left out for what it found.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa

from gse.campaign.dataset import OWN_STATION, DataSet
from gse.campaign.hot_pixels import COLUMN
from gse.errors import UsageError
from gse.station.exclusions import Cause
from gse.station.results import Subject, Verdict
from gse.statistics.decision import Outcome
from gse.statistics.sampling import MIN_FRAMES
from gse.values.axis import AXES
from gse.verdict.requirements import REQUIREMENTS

MOST_WITHOUT_SKY = 0.5
_INSTANTS = ("first_utc", "last_utc")
_OF_AXIS = ("bias_arcsec", "bias_error_arcsec", "nea_arcsec", "std_arcsec", "thermal_arcsec_per_k")
_SHARES = [requirement.share_column for requirement in REQUIREMENTS if requirement.share_column]
_OF_SUBJECT = (
    *(f"{share}_{part}" for share in _SHARES for part in ("count", "of", "n_eff")),
    *("mean_abs_d_ra_deg", "mean_abs_d_de_deg", "time_p99_ms"),
    *(f"{axis.key}_{name}" for axis in AXES for name in _OF_AXIS),
    "d_de_n",
)
COLUMNS = (
    *(
        "key",
        "sensor",
        "night",
        "session_sha256",
        "station_sha256",
        "software_sha256",
        "source",
        "error",
        "sensor_serial",
    ),
    *_INSTANTS,
    *("verdict", "relative", "simulated", "truncated", "reasons", "measurements", "frames", "duration_s"),
    *("exclusions", "site_name", "temperature_median_c", "zero_point_median_mag", "camera_focal_length_px"),
    *("camera_rows", "camera_columns", "mount_azimuth_deg", "mount_altitude_deg", "mount_roll_deg", "mount_fit_frames"),
    *("limit_decision", COLUMN.name),
    *(f"{subject.value}_{name}" for subject in Subject for name in _OF_SUBJECT),
)
"""The columns of the table of sessions that the report reads."""


@dataclass(frozen=True, slots=True)
class Session:
    """The row of a session, instants in UTC nanoseconds.

    ``left_out`` says why it does not count, or is empty. One that is only ``too_short`` still shows trends, and one
    that is not a damaged ``copy`` conditions, where any of its answers was compared with truth.
    """

    row: dict[str, Any]
    left_out: str
    too_short: bool = False
    copy: bool = False

    @property
    def night(self) -> str:
        """The date of its evening."""
        return str(self.row["night"])


def sessions_of(dataset: DataSet, station_sha256: str = OWN_STATION, software: str | None = None) -> list[Session]:
    """The sessions of one judgement, in the order of sensor, night and start.

    ``software`` is that of the judgement that counts; without it, or where it judged nothing, the only one there is.
    UsageError where that is not clear.
    """
    rows = _rows(dataset.sessions(COLUMNS))
    rows = [row for row in rows if row["station_sha256"] == station_sha256]
    if not rows:
        given = "their own station files" if station_sha256 == OWN_STATION else "this station file"
        raise UsageError(f"{dataset.url} has no session that was judged with {given}; give --station as for judge")
    versions = sorted({row["software_sha256"] for row in rows})
    if software not in versions:
        if len(versions) > 1:
            raise UsageError(
                f"{dataset.url} was judged by {len(versions)} versions of gse, none of them this one: judge it again"
            )
        software = versions[0]
    rows = [row for row in rows if row["software_sha256"] == software]
    rows.sort(key=lambda row: (row["sensor"], row["night"], row["first_utc"] or 0, row["key"]))
    return without_copies([_session(row) for row in rows])


def without_copies(sessions: Sequence[Session]) -> list[Session]:
    """The sessions, those left out that are damaged and lie within the times of another one of their sensor.

    A copy that was cut off or hit has other bytes than the whole file, so its key does not show that it is one.
    """
    found = list(sessions)
    for number, session in enumerate(found):
        if session.left_out or not session.row["truncated"]:
            continue
        others = (other for other in found if other is not session and not other.left_out)
        whole = next((other for other in others if _covers(other.row, session.row)), None)
        if whole is not None:
            found[number] = replace(
                session, left_out=f"damaged, and {whole.row['source']} has the same times", copy=True
            )
    return found


def by_night(sessions: Iterable[Session], *, too_short: bool = False) -> dict[str, list[Session]]:
    """The sessions that count, by night, in order; with ``too_short`` also those that are only that."""
    nights: dict[str, list[Session]] = {}
    for session in sessions:
        if not session.left_out or (too_short and session.too_short):
            nights.setdefault(session.night, []).append(session)
    return dict(sorted(nights.items()))


def with_answers(sessions: Iterable[Session]) -> list[Session]:
    """The sessions of which any answer was compared with truth, whether they count or not, copies left out."""
    return [one for one in sessions if not one.row["error"] and not one.copy and _compared(one.row)]


def nightly(nights: dict[str, list[Session]], column: str) -> dict[str, float]:
    """The mean of a column over the sessions of each night, by their frames; nights without it are left out."""
    found = {}
    for night, sessions in nights.items():
        known = [(one.row[column], one.row["frames"]) for one in sessions if one.row.get(column) is not None]
        if known:
            found[night] = weighted(known)
    return found


def weighted(values: Sequence[tuple[float, float]]) -> float:
    """The mean of values with their weights."""
    total = sum(weight for _, weight in values)
    return sum(value * weight for value, weight in values) / total if total else float("nan")


def _rows(sessions: pa.Table) -> list[dict[str, Any]]:
    """Rows as dictionaries; instants as numbers, for Python's own have no nanoseconds."""
    for name in _INSTANTS:
        place = sessions.schema.get_field_index(name)
        sessions = sessions.set_column(place, name, sessions[name].cast(pa.int64()))
    rows: list[dict[str, Any]] = sessions.to_pylist()
    return rows


def _covers(whole: dict[str, Any], part: dict[str, Any]) -> bool:
    same = whole["sensor"] == part["sensor"] and part["sensor_serial"] in (None, whole["sensor_serial"])
    return bool(same and whole["first_utc"] <= part["first_utc"] and part["last_utc"] <= whole["last_utc"])


def _session(row: dict[str, Any]) -> Session:
    reasons = list(_reasons(row))
    compared = _compared(row)
    return Session(row, reasons[0] if reasons else "", len(reasons) == 1 and 0 < compared < MIN_FRAMES)


def _compared(row: dict[str, Any]) -> int:
    return max((row[f"{subject.value}_d_de_n"] or 0 for subject in Subject), default=0)


def _reasons(row: dict[str, Any]) -> Iterator[str]:
    if row["error"]:
        yield f"could not be judged: {row['error']}"
        return
    frames = row["frames"] or 0
    stretches = [item for item in row["exclusions"] or () if item["cause"] in (Cause.NO_SKY, Cause.NO_OBJECTS)]
    without_sky = sum(item["frames"] for item in stretches)
    if frames and without_sky > MOST_WITHOUT_SKY * frames:
        yield f"no sky in {without_sky} of {frames} panoramas: {stretches[0]['reason']}"
    compared = _compared(row)
    if compared < MIN_FRAMES:
        why = f": {row['reasons'][0]}" if row["reasons"] and not compared else ""
        were = "answer was" if compared == 1 else "answers were"
        yield f"{compared} {were} compared with truth, {MIN_FRAMES} are needed{why}"
    outcomes = {item["outcome"] for item in row["measurements"] or ()}
    if row["verdict"] == Verdict.INCONCLUSIVE and not outcomes & {Outcome.INCONCLUSIVE, Outcome.FAIL}:
        yield f"{Verdict.INCONCLUSIVE} though every row is decided: {'; '.join(row['reasons'] or ())}"
