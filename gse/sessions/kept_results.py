"""Kept results: what was derived from a session, for the next report, view or comparison of this user.

``judged_session`` takes them where session, station file and software are the same; else it derives and keeps them.

    results/<path>/<key>/   sessions.parquet, frames.parquet, stars.parquet   docs/tables.md
                            answers.parquet                                   the sensor's own answers as they came
                            items.parquet                                     the sensor's housekeeping
                            names.parquet, catalog.parquet                    its names of stars; all stars, with names
                            others.parquet                                    objects that no answer names
                            context.json                                      the rest; SHA-256 of itself and each file

They are in the user's cache directory, in a folder for the path of the session, never beside it: a session may come
from anybody, with results that were never derived. The key is the SHA-256 of session, station file and software
(gse.report.provenance): whatever changes, the results are no longer found, and are derived anew. One rename puts a
whole folder in place. A folder whose files do not match the hashes in it, or whose tables have other columns, is not
used.
"""

import contextlib
import hashlib
import itertools
import os
import shutil
from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, PositiveInt

from drivers.chunk import LinkEvent
from drivers.clock import ClockReading
from drivers.playback import is_session
from drivers.session_file.reader import segment_files, session_file
from gse.catalog.readers import GAIA
from gse.catalog.stars import Designation, ListedStars
from gse.config.choice import StationText
from gse.config.station import Station
from gse.errors import TruthError, UsageError
from gse.external.identifier import ExternalCounts
from gse.process.installation import own_cache_folder
from gse.process.release_memory import give_back
from gse.recording.session_format import PowerReading, read_attachments
from gse.report.parquet import ROWS_AT_ONCE, ParquetColumns, read_parquet, write_parquet
from gse.report.provenance import ResultKey, session_sha256, software_sha256
from gse.report.sessions_table import sessions_table
from gse.report.tables import frames_parts, frames_schema, stars_parts, stars_schema
from gse.sessions.replay import Replay, StationInForce, names_program, station_in_force
from gse.sessions.status_file import is_running, read_status
from gse.station.columns import COLUMNS, Column
from gse.station.events import ClockStep
from gse.station.frame_columns import FrameColumns
from gse.station.housekeeping import ITEM, Housekeeping, ItemSummary
from gse.station.results import LinkCounters, Subject
from gse.station.session_data import SessionData
from gse.station.session_tables import MATCH, MOST_IN_MEMORY, OTHER, OWN_ANSWER, AttitudeTable, FrameTable
from gse.station.star_names import STAR_NAME, StarNames
from gse.truth import Alignment, EarthOrientation
from gse.values.matrices import solve
from gse.values.screen import Shown
from gse.verdict.assessment import Assessment, judge
from protocols import Item, StatusMessage, built_in_names
from protocols.description import TimeDescription

# Context of kept results: what a session holds besides the tables of frames and stars.


_MADE_OTHERWISE = frozenset(
    {"designation", "earth_orientation", "shown", "items", "item_summaries", "item_stride", "parameters"}
)
"""Fields of the context that no field of SessionData is."""


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
    time: TimeDescription
    power: list[PowerReading]
    shown: list[Shown] = []
    items: dict[str, Item] = {}
    item_summaries: dict[str, ItemSummary] = {}
    item_stride: int = 1
    parameters: tuple[str, ...] = ()

    @classmethod
    def from_session(cls, session: SessionData) -> "KeptContext":
        """The context of a session."""
        orientation, stars = session.earth_orientation, session.stars
        values = {name: getattr(session, name) for name in cls.model_fields if name not in _MADE_OTHERWISE}
        return cls.model_construct(
            **values,
            designation=stars.designation if stars else "Gaia DR3",
            earth_orientation=orientation.to_json() if orientation else None,
            shown=session.shown.shown,
            items={item.name: item for item in session.housekeeping.items},
            item_summaries=session.housekeeping.summaries,
            item_stride=session.housekeeping.stride,
            parameters=session.housekeeping.parameters,
        )

    def give_to(self, session: SessionData) -> None:
        """Set the fields of a session; TruthError where the Earth orientation is none."""
        text = self.earth_orientation
        for name in type(self).model_fields.keys() - _MADE_OTHERWISE:
            setattr(session, name, getattr(self, name))
        for shown in self.shown:
            session.shown.add(shown)
        session.earth_orientation = EarthOrientation.from_json(text) if text is not None else None


CONTEXT, _ITEMS, _NAMES, _CATALOG = "context.json", "items.parquet", "names.parquet", "catalog.parquet"
_LISTED = np.dtype([("id", "i8"), ("magnitude", "f8")])
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
    write_parquet(_parts(session.sensor_attitudes.columns), part / "answers.parquet")
    write_parquet(_parts(session.frames.others), part / "others.parquet")
    write_parquet(_parts(session.housekeeping.rows), part / _ITEMS)
    names = session.star_names.rows
    write_parquet(_parts(names), part / _NAMES)
    write_parquet(_parts(_listed(session.stars if len(names) else None)), part / _CATALOG)
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
        frames, stars, answers, others, items, names, catalog = (
            files.enter_context(_columns(whole / name, manifest.files, schema)) for name, schema in _schemas().items()
        )
        stride = manifest.picture_stride
        session.frames = restored_frames(frames, stars, context.subject, _rows(others, OTHER), stride)
        session.stars = restored_stars(stars, context.designation)
        session.star_names = StarNames(_rows(names, STAR_NAME))
        if catalog.num_rows:
            listed = _rows(catalog, _LISTED)
            session.stars = ListedStars(context.designation, listed["id"].copy(), listed["magnitude"].copy())
        session.housekeeping = Housekeeping.restored(
            context.items, context.parameters, context.item_summaries, context.item_stride, _rows(items, ITEM)
        )
        session.sensor_attitudes = AttitudeTable.from_rows(_rows(answers, OWN_ANSWER))
    if len(session.frames) > MOST_IN_MEMORY:
        solve(np.eye(2), np.ones(2))  # loads the compiler, as judging would, whose pages then go back with the rest
        give_back()
    return session


def _schemas() -> dict[str, pa.Schema]:
    plain = {"answers.parquet": OWN_ANSWER, "others.parquet": OTHER, _ITEMS: ITEM, _NAMES: STAR_NAME, _CATALOG: _LISTED}
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


def _parts(rows: NDArray[np.void] | FrameColumns) -> Iterator[pa.Table]:
    """Many rows of a dtype in parts, at least one."""
    for first in range(0, max(len(rows), 1), ROWS_AT_ONCE):
        yield _table(rows[first : first + ROWS_AT_ONCE])


def _table(rows: NDArray[np.void] | FrameColumns) -> pa.Table:
    """Rows of a dtype, a column for each of its fields."""
    return pa.table({name: pa.array(np.ascontiguousarray(rows[name])) for name in rows.dtype.names or ()})


def _listed(stars: ListedStars | None) -> NDArray[np.void]:
    rows = np.zeros(len(stars.ids) if stars else 0, dtype=_LISTED)
    if stars:
        rows["id"], rows["magnitude"] = stars.ids, stars.magnitude
    return rows


def _rows(columns: ParquetColumns, dtype: "np.dtype[np.void]") -> NDArray[np.void]:
    rows = np.zeros(columns.num_rows, dtype=dtype)
    for name in dtype.names or ():
        rows[name] = columns[name].to_numpy()
    return rows


def _drop_oldest(results: Path) -> None:
    """Remove those that were used longest ago, where all of them take too much; the latest stay."""
    with contextlib.suppress(FileNotFoundError):  # another process removes the same
        kept = (path for path in results.glob("*/*") if path.is_dir())
        latest_first = sorted(kept, key=lambda path: path.stat().st_mtime_ns, reverse=True)
        sizes = [sum(file.stat().st_size for file in path.iterdir()) for path in latest_first]
        for path, up_to_it in list(zip(latest_first, itertools.accumulate(sizes), strict=True))[1:]:
            if up_to_it > MOST_BYTES:
                shutil.rmtree(path, ignore_errors=True)
                with contextlib.suppress(OSError):  # the session has results under other keys
                    path.parent.rmdir()


Change = Callable[[StationText], StationText]


@dataclass(slots=True)
class Judged:
    """A session and its assessment; ``own_elapsed_us`` are this host's identification times, none of kept results.

    Kept results hold no assessment: it is made when it is first asked for.
    """

    session: SessionData
    own_elapsed_us: "array[float]"
    _assessment: Assessment | None = None

    @property
    def assessment(self) -> Assessment:
        """The verdict on the session, with its statistics."""
        if self._assessment is None:
            self._assessment = judge(self.session)
        return self._assessment


@dataclass(frozen=True, slots=True)
class _Place:
    """Where results of a session are kept, and what they follow from."""

    folder: Path
    key: ResultKey
    force: StationInForce


def judged_session(
    path: Path, *, station: Change, derive: Callable[[], Replay], tell: Callable[[str], None], anew: bool = False
) -> Judged:
    """The session of a recording with its assessment, from kept results, or from ``derive`` and then kept.

    ``station`` changes the recorded station, as ``derive`` does. ``tell`` gets a line about the results that are used,
    or why they are not. ``anew`` uses none. Results of a recording that has no station of its own, of one that is
    still written, or of a station file that names files besides itself are not kept: such a file may change. Nor are
    any where this user has no cache directory.
    """
    place = _place(path, station)
    session = _kept(place, tell) if place and not anew else None
    if session is not None:
        return Judged(session, array("d"))
    replay = derive()
    judged = Judged(replay.session, replay.own_elapsed_us)
    if place:
        _keep(judged.session, judged.assessment, place, tell)
    return judged


def _kept(place: _Place, tell: Callable[[str], None]) -> SessionData | None:
    try:
        session = kept(place.key, place.folder, place.force.station, place.force.text)
    except KeptResultsError as error:
        tell(f"{error}; derived anew")
        return None
    if session is not None:
        tell(f"results kept in {place.folder} are used")
    elif place.folder.is_dir():
        tell("derived anew: the session, its station file or gse changed since results were kept")
    return session


def _keep(session: SessionData, assessment: Assessment, place: _Place, tell: Callable[[str], None]) -> None:
    try:
        keep(session, assessment, place.key, place.folder)
    except OSError as error:
        tell(f"results cannot be kept in {place.folder}: {error.strerror or error}")


def keep_live(session: SessionData, assessment: Assessment, path: Path, tell: Callable[[str], None]) -> None:
    """Keep the results of the session file at ``path``, which was closed just now."""
    place = None
    with contextlib.suppress(UsageError):  # a session alone names no file of this host, and nothing is kept of such
        place = _place_of(path, lambda recorded: recorded)
    if place:
        _keep(session, assessment, place, tell)


def _place(path: Path, station: Change) -> _Place | None:
    if not path.exists() or not is_session(path) or (path.is_file() and path.stat().st_size == 0):
        return None
    status = read_status(session_file(path).parent)
    return None if status is not None and is_running(status) else _place_of(path, station)


def _place_of(path: Path, station: Change) -> _Place | None:
    first = session_file(path)
    force = station_in_force(read_attachments(path), station)
    folder = results_folder(first) if _follows_from_text(force) else None
    return _Place(folder, result_key(first, force.text), force) if folder else None


def _follows_from_text(force: StationInForce) -> bool:
    """Whether the station file says all: no catalogue, protocol or program in a file of its own."""
    station = force.station
    has_protocol = force.protocol_text is not None or station.protocol in built_in_names()
    runs_program = station.identifier.algorithm == "external" and not names_program(station)
    return has_protocol and station.catalog == GAIA and not runs_program


def result_key(first: Path, station_text: str) -> ResultKey:
    """The key of the results of a session file, with its segments, under a station file and this software."""
    station = hashlib.sha256(station_text.encode()).hexdigest()
    return ResultKey(session_sha256(segment_files(first)), station, software_sha256())


def restored_frames(
    frames: ParquetColumns, stars: ParquetColumns, subject: Subject, others: NDArray[np.void], stride: int
) -> FrameTable:
    """The frame table that the tables were made of; ``subject`` is whose answers it holds.

    ``others`` and ``stride`` are the table's own rows of OTHER and its ``picture_stride``.
    """
    matches = np.zeros(stars.num_rows, dtype=MATCH)
    for name in MATCH.names or ():
        matches[name] = _numbers(stars["star_row" if name == "star" else name])
    table = FrameTable.with_rows(frames.num_rows, matches, others, stride=stride, most_in_memory=MOST_IN_MEMORY)
    for column in COLUMNS:
        values = frames[column.name_of(subject)]
        table.columns[column.name] = _places(column, values) if column.words else _numbers(values)
    return table


def restored_stars(stars: ParquetColumns, designation: Designation) -> ListedStars:
    """The stars of the catalogue as far as the matches name them; the others have the number 0."""
    rows = _numbers(stars["star_row"])
    count = int(rows.max()) + 1 if len(rows) else 0
    ids, magnitude = np.zeros(count, dtype=np.int64), np.full(count, np.nan)
    ids[rows], magnitude[rows] = _numbers(stars["star_id"]), _numbers(stars["magnitude_mag"])
    return ListedStars(designation, ids, magnitude)


def _places(column: Column, values: pa.ChunkedArray) -> NDArray[Any]:
    words = pa.array([word.value for word in column.words])
    return np.asarray(pc.index_in(values.cast(pa.string()), words).to_numpy(zero_copy_only=False))


def _numbers(column: pa.ChunkedArray) -> NDArray[Any]:
    """Numbers, with NaN for null; instants as nanoseconds."""
    if pa.types.is_timestamp(column.type):
        column = column.cast(pa.int64())
    if pa.types.is_floating(column.type):
        column = column.fill_null(float("nan"))
    return np.asarray(column.to_numpy())
