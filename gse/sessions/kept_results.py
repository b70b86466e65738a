"""Kept results: what was derived from a session, for the next report, view or comparison of this user.

    results/<path>/<key>/   sessions.parquet, frames.parquet, stars.parquet   docs/tables.md
                            answers.parquet                                   the sensor's own answers as they came
                            others.parquet                                    objects that no answer names
                            context.json                                      the rest; SHA-256 of itself and each file

They are in the user's cache directory, in a folder for the path of the session, never beside it: a session may come
from anybody, with results that were never derived. The key is the SHA-256 of session, station file and software
(gse.report.ResultKey): whatever changes, the results are no longer found, and are derived anew. One rename puts a
whole folder in place. A folder whose files do not match the hashes in it, or whose tables have other columns, is not
used.
"""

import contextlib
import hashlib
import itertools
import os
import shutil
from collections.abc import Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, PositiveInt

from drivers.chunk import LinkEvent
from drivers.clock import ClockReading
from gse.catalog.stars import Designation
from gse.config.station import Station
from gse.errors import TruthError
from gse.external.identifier import ExternalCounts
from gse.process.cache_folder import own_cache_folder
from gse.report.frames_table import frames_parts, frames_schema
from gse.report.parquet import ParquetColumns, read_parquet, write_parquet
from gse.report.restored_tables import restored_frames, restored_stars
from gse.report.result_key import ResultKey
from gse.report.sessions_table import sessions_table
from gse.report.stars_table import stars_parts, stars_schema
from gse.station.attitude_table import OWN_ANSWER, AttitudeTable
from gse.station.events import ClockStep
from gse.station.frame_table import OTHER
from gse.station.results import LinkCounters, Subject
from gse.station.session_data import SessionData
from gse.truth import Alignment, EarthOrientation
from gse.values.shown import Shown
from gse.verdict.assessment import Assessment
from protocols import StatusMessage

# Context of kept results: what a session holds besides the tables of frames and stars.


class KeptContext(BaseModel):
    """Fields of SessionData, as JSON keeps them; the station is not among them, since the key names it."""

    model_config = ConfigDict(extra="forbid", ser_json_inf_nan="constants")

    protocol_name: str
    subject: Subject
    link: LinkCounters
    events: list[ClockStep | LinkEvent]
    events_not_kept: int
    others_lost: int
    clock: list[ClockReading]
    statuses: list[tuple[int, StatusMessage]]
    raw_sha256: str
    catalog: dict[str, Any]
    designation: Designation
    versions: dict[str, str]
    truncated: bool
    earth_orientation: str | None
    alignment: Alignment | None
    clock_error_s: float | None
    external: dict[str, Any] | None
    external_counts: ExternalCounts
    shown: list[Shown] = []

    @classmethod
    def from_session(cls, session: SessionData) -> "KeptContext":
        """The context of a session."""
        orientation, stars = session.earth_orientation, session.stars
        own = {"designation", "earth_orientation", "shown"}
        values = {name: getattr(session, name) for name in cls.model_fields if name not in own}
        return cls.model_construct(
            **values,
            designation=stars.designation if stars else "Gaia DR3",
            earth_orientation=orientation.to_json() if orientation else None,
            shown=session.shown.shown,
        )

    def give_to(self, session: SessionData) -> None:
        """Set the fields of a session; TruthError where the Earth orientation is none."""
        text = self.earth_orientation
        for name in type(self).model_fields:
            if name not in ("designation", "earth_orientation", "shown"):
                setattr(session, name, getattr(self, name))
        for shown in self.shown:
            session.shown.add(shown)
        session.earth_orientation = EarthOrientation.from_json(text) if text is not None else None


CONTEXT = "context.json"
MOST_BYTES = 2 << 30
"""Most bytes of all kept results; those that were used longest ago go first."""
MOST_CONTEXT_BYTES = 64 << 20
"""20,000 events, 50,000 readings of the clock and as many STATUS messages take 30 MB."""
_DAMAGED = (OSError, ValueError, KeyError, TypeError, pa.ArrowException, TruthError)
"""What reading a damaged or foreign file raises."""


class KeptResultsError(Exception):
    """Results that cannot be used, and why in one line."""


class _Manifest(BaseModel):
    """context.json: hashes of the other files by name, the stride of the frames with all objects, the context."""

    key: str
    files: dict[str, str]
    picture_stride: PositiveInt
    context: KeptContext


def results_folder(session_file: Path) -> Path | None:
    """The folder for all kept results of a session, where one rename puts them; None where nothing can be kept."""
    path = hashlib.sha256(os.fsencode(session_file.resolve())).hexdigest()[:32]
    results = own_cache_folder("results")
    return results / path if results else None


def keep(session: SessionData, assessment: Assessment, key: ResultKey, folder: Path) -> Path:
    """Put the results of a session into ``folder``, in place by one rename; OSError where they cannot be written.

    ``assessment`` is of the session alone, without statements of the operator. Equal results that somebody else put
    there meanwhile stay.
    """
    whole = folder / key.text
    part = folder / f".{key.text}.{os.getpid()}.part"
    part.mkdir(parents=True)
    try:
        _write(session, assessment, key, part)
        with contextlib.suppress(FileNotFoundError):
            shutil.rmtree(whole)
        part.rename(whole)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    _drop_oldest(folder.parent)
    return whole


def kept(key: ResultKey, folder: Path, station: Station, station_text: str) -> SessionData | None:
    """The session as it was derived, None where no results of this key are kept; KeptResultsError where they are
    damaged."""
    whole = folder / key.text
    if not whole.is_dir():
        return None
    try:
        session = _read(key, whole, station, station_text)
        os.utime(whole)
        return session
    except _DAMAGED as error:
        line = " ".join(str(error).split())[:200]
        raise KeptResultsError(f"{whole} is not used: {line}") from error


def _write(session: SessionData, assessment: Assessment, key: ResultKey, part: Path) -> None:
    write_parquet([sessions_table(session, assessment, key)], part / "sessions.parquet")
    write_parquet(frames_parts(session, assessment.statistics, key.text), part / "frames.parquet")
    write_parquet(stars_parts(session, key.text), part / "stars.parquet")
    write_parquet([_table(session.sensor_attitudes.columns)], part / "answers.parquet")
    write_parquet([_table(session.frames.others)], part / "others.parquet")
    files = {path.name: _sha256(path) for path in sorted(part.iterdir())}
    stride, context = session.frames.picture_stride, KeptContext.from_session(session)
    manifest = _Manifest.model_construct(key=key.text, files=files, picture_stride=stride, context=context)
    text = manifest.model_dump_json()
    (part / CONTEXT).write_text(f"{hashlib.sha256(text.encode()).hexdigest()}\n{text}", encoding="utf-8")


def _read(key: ResultKey, whole: Path, station: Station, station_text: str) -> SessionData:
    manifest = _manifest(whole)
    if manifest.key != key.text:
        raise ValueError(f"its key is {manifest.key[:64]}")
    context = manifest.context
    session = SessionData(station, station_text, context.protocol_name)
    context.give_to(session)
    with contextlib.ExitStack() as files:
        frames, stars, answers, others = (
            files.enter_context(_columns(whole / name, manifest.files, schema)) for name, schema in _schemas().items()
        )
        stride = manifest.picture_stride
        session.frames = restored_frames(frames, stars, context.subject, _rows(others, OTHER), stride)
        session.stars = restored_stars(stars, context.designation)
        session.sensor_attitudes = AttitudeTable.from_rows(_rows(answers, OWN_ANSWER))
    return session


def _schemas() -> dict[str, pa.Schema]:
    plain = {"answers.parquet": OWN_ANSWER, "others.parquet": OTHER}
    own = {file: _table(np.zeros(0, dtype)).schema for file, dtype in plain.items()}
    return {"frames.parquet": frames_schema(), "stars.parquet": stars_schema(), **own}


def _manifest(whole: Path) -> _Manifest:
    with _opened(whole / CONTEXT) as file:
        content = file.read(MOST_CONTEXT_BYTES + 1)
    if len(content) > MOST_CONTEXT_BYTES:
        raise ValueError(f"{CONTEXT} is larger than {MOST_CONTEXT_BYTES} bytes")
    stated, _, text = content.partition(b"\n")
    if hashlib.sha256(text).hexdigest().encode() != stated:
        raise ValueError(f"{CONTEXT} does not have its SHA-256")
    return _Manifest.model_validate_json(text)


def _columns(
    path: Path, hashes: Mapping[str, str], schema: pa.Schema
) -> contextlib.AbstractContextManager[ParquetColumns]:
    if _sha256(path) != hashes[path.name]:
        raise ValueError(f"{path.name} does not have its SHA-256")
    return read_parquet(path, schema)


def _sha256(path: Path) -> str:
    with _opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _opened(path: Path) -> BufferedReader:
    """A file to read; ValueError where a pipe, a link or a device stands in its place, which may never end."""
    if path.is_symlink() or not path.is_file():
        raise ValueError(f"{path.name} is not a file")
    return path.open("rb")


def _table(rows: NDArray[np.void]) -> pa.Table:
    """Rows of a dtype, a column for each of its fields."""
    return pa.table({name: pa.array(np.ascontiguousarray(rows[name])) for name in rows.dtype.names or ()})


def _rows(columns: ParquetColumns, dtype: "np.dtype[np.void]") -> NDArray[np.void]:
    rows = np.zeros(columns.num_rows, dtype=dtype)
    for name in dtype.names or ():
        rows[name] = columns[name].to_numpy()
    return rows


def _drop_oldest(results: Path) -> None:
    """Remove those that were used longest ago, where all of them take too much; the latest stay."""
    with contextlib.suppress(FileNotFoundError):  # another process removes the same
        latest_first = sorted(results.glob("*/*"), key=lambda path: path.stat().st_mtime_ns, reverse=True)
        sizes = [sum(file.stat().st_size for file in path.iterdir()) for path in latest_first]
        for path, up_to_it in list(zip(latest_first, itertools.accumulate(sizes), strict=True))[1:]:
            if up_to_it > MOST_BYTES:
                shutil.rmtree(path, ignore_errors=True)
                with contextlib.suppress(OSError):  # the session has results under other keys
                    path.parent.rmdir()
