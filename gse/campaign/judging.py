"""Judgement of one session of a campaign: what a worker does.

A worker reads the session as data: its station file is sealed as in every replay, so that nothing which a session names
is opened or run. Whatever is wrong with a session becomes its row, with the error in it; what is wrong with a storage
is raised, and the session is judged by the next run.
"""

import contextlib
import functools
import json
import os
import socket
import stat
import tempfile
import threading
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from drivers.errors import DriverError
from drivers.outside_text import plain_lines
from gse.campaign.dataset import (
    ATLAS,
    FRAMES,
    HOUSEKEEPING,
    NAMES,
    OWN_STATION,
    REPORT_COLUMN,
    SESSIONS,
    STARS,
    UNKNOWN,
    Committed,
    DataSet,
    packed,
    with_place,
    without_place,
)
from gse.campaign.hot_pixels import COLUMN, HotPixelCounter
from gse.campaign.sensor_atlas import BORESIGHT_COLUMNS, STARS_COLUMNS, atlas_table, session_errors
from gse.campaign.sources import SessionSource
from gse.campaign.storage import PARTS, StorageError, copy_here, explained, protocol_of, put_whole, with_patience
from gse.config.choice import StationText
from gse.errors import GseError
from gse.process.release_memory import give_back, spare_pandas
from gse.report import summarise
from gse.report.parquet import field, write_parquet
from gse.report.provenance import ResultKey, session_sha256, software_sha256
from gse.report.sessions_table import failed_session, sessions_table
from gse.report.tables import frames_parts, housekeeping_parts, names_parts, stars_parts
from gse.sessions.replay import replay_session
from gse.station.setup import keep_one_sky
from gse.values.camera import Camera
from gse.verdict.assessment import judge
from protocols import ProtocolError

# The time that a worker may take for one session: Dask knows no such limit.
#
# Nothing stops a loop from outside, so a thread of the worker ends its whole process. Before that it leaves a mark in
# the data set, by which whoever is given the session next in this run knows that it is in vain. A loop that lets no
# other thread run ends by Dask's ``worker-ttl``.


@contextmanager
def time_limit(limit_s: float, dataset_url: str, name: str) -> Iterator[None]:
    """End this process where the block takes longer, and leave the mark ``name``."""
    watch = threading.Timer(limit_s, _end_process, (dataset_url, name))
    watch.daemon = True
    watch.start()
    try:
        yield
    finally:
        watch.cancel()


def was_too_long(dataset_url: str, name: str) -> bool:
    """Whether a worker ended with this mark."""
    return with_patience(dataset_url, lambda fs, root: bool(fs.exists(f"{root}/{PARTS}/{name}")))


def _end_process(dataset_url: str, name: str) -> None:
    with suppress(Exception):
        with_patience(dataset_url, lambda fs, root: put_whole(fs, root, f"{PARTS}/{name}", b""))
    os._exit(1)


LIMIT_S = 3600.0
"""A night of 8 h at 10 Hz takes 46 s of one core."""
_MOST_ERROR = 1000


@dataclass(frozen=True, slots=True)
class Job:
    """What the sessions of a campaign are judged with; ``name`` is one run's own.

    A worker that takes longer than ``limit_s`` for one session ends.
    """

    name: str
    dataset_url: str
    station: StationText | None
    station_sha256: str = OWN_STATION
    limit_s: float = LIMIT_S


@dataclass(frozen=True, slots=True)
class JudgedSource:
    """Outcome of one source; ``is_new`` where this run wrote its results, ``error`` says why it has no verdict.

    ``key`` is empty where nothing could be kept: its storage failed, or it ended its workers. ``ends_run`` where the
    results of no other session could be kept either: the data set's storage is gone or full. ``row`` is the packed row
    of a new session in the index.
    """

    source: SessionSource
    key: str = ""
    session_sha256: str = ""
    verdict: str | None = None
    sensor: str = ""
    night: str = ""
    error: str = ""
    is_new: bool = False
    ends_run: bool = False
    row: bytes = b""


def judge_source(source: SessionSource, job: Job) -> JudgedSource:
    """Judge a session and put its results into the data set; what is there already is not judged again."""
    spare_pandas()
    try:
        with tempfile.TemporaryDirectory(prefix="session-", dir=_scratch()) as name:
            folder = Path(name)
            first, segments, read_before = _here(source, folder)
            found = session_sha256(segments)
            key = ResultKey(found, job.station_sha256, software_sha256())
            known = _committed(job).get(key.text)
            if known is not None:
                return JudgedSource(source, key.text, found, sensor=known.sensor, night=known.night)
            mark = f"too-long-{job.name}-{key.text}"
            if was_too_long(job.dataset_url, mark):
                limit = f"{source.url} takes more than {job.limit_s / 60:g} minutes"
                return JudgedSource(source, error=f"{limit}; --session-limit gives it more")
            with time_limit(job.limit_s, job.dataset_url, mark):
                result = _judged(first, key, job, source, folder)
            if session_sha256(segments) != found or read_before != _state_here(source):
                return JudgedSource(
                    source, error=f"{source.url} changed while it was read; is its session still running?"
                )
            with_patience(job.dataset_url, lambda fs, root: _put(DataSet(job.dataset_url, fs, root), result))
    except StorageError as error:
        return JudgedSource(source, error=str(error), ends_run=error.is_full or error.url == job.dataset_url)
    except OSError as error:
        return JudgedSource(source, error=str(explained(error, error.filename or source.url)))
    finally:
        keep_one_sky()
        give_back()
    place = result.place
    return JudgedSource(
        source, key.text, found, result.verdict, place.sensor, place.night, result.error, is_new=True, row=result.row
    )


@dataclass(frozen=True, slots=True)
class _Result:
    """What is to go into the data set: a Parquet file of this host for each table, and the packed row of the index."""

    place: Committed
    files: dict[str, Path]
    verdict: str | None
    error: str
    row: bytes


def _here(source: SessionSource, folder: Path) -> tuple[Path, list[Path], str]:
    """First and all segments of a session on this host, copied into a folder from others; its state before."""
    state = _state_here(source)
    if protocol_of(source.url) == "file":
        return Path(source.url), [Path(url) for url in source.segments], state
    here = [folder / url.rsplit("/", 1)[1] for url in source.segments]
    for url, path in zip(source.segments, here, strict=True):
        with_patience(url, functools.partial(copy_here, here=path))
    return here[0], here, state


def _state_here(source: SessionSource) -> str:
    """Size and time of change of the segments of a local session; empty for others. A pipe would never end."""
    if protocol_of(source.url) != "file":
        return ""
    try:
        found = [os.stat(url) for url in source.segments]
    except OSError as error:
        raise StorageError(f"{source.url} cannot be read: {error.strerror}") from error
    if not all(stat.S_ISREG(one.st_mode) for one in found):
        raise StorageError(f"{source.url} is not a file of bytes, but a pipe or a device")
    return ";".join(f"{one.st_size} {one.st_mtime_ns}" for one in found)


def _scratch() -> str | None:
    """The worker's own folder, which Dask empties after a worker that was killed."""
    from distributed import get_worker

    with contextlib.suppress(ValueError):
        return str(get_worker().local_directory)
    return None


def _judged(path: Path, key: ResultKey, job: Job, source: SessionSource, folder: Path) -> _Result:
    try:
        result, camera = _results(path, key, job, source, folder)
        return replace(result, files=_with_atlas(result.files, camera, key, folder))
    except StorageError:
        raise
    except (GseError, DriverError, ProtocolError) as error:
        return _failed(key, source, str(error), folder)
    except (MemoryError, OSError):
        raise
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        return _failed(
            key, source, f"internal error: {type(error).__name__}: {error} at {where}; please report it", folder
        )


def _results(path: Path, key: ResultKey, job: Job, source: SessionSource, folder: Path) -> tuple[_Result, Camera]:
    given, hot_pixels = job.station, HotPixelCounter()
    replay = replay_session(
        path,
        station=lambda recorded: given or recorded,
        make_listeners=lambda loop: [hot_pixels],
        threads=1,
    )
    session = replay.session
    assessment = judge(session)
    row = sessions_table(session, assessment, key, source=source.url)
    report = json.dumps(summarise(session, assessment), indent=2, allow_nan=False) + "\n"
    rows = _completed(row, hot_pixels.column(), report)
    tables = {
        STARS: stars_parts(session, key.text),
        FRAMES: frames_parts(session, assessment.statistics, key.text),
        HOUSEKEEPING: housekeeping_parts(session, key.text),
        **({NAMES: names_parts(session, key.text)} if len(session.star_names.rows) else {}),
        SESSIONS: [rows],
    }
    place, camera = Committed(session.station.sensor.name, _night(row), key.text), session.station.sensor.camera()
    packed_row = packed(with_place(rows, place))
    return _Result(place, _written(tables, folder), assessment.verdict.value, "", packed_row), camera


def _with_atlas(files: dict[str, Path], camera: Camera, key: ResultKey, folder: Path) -> dict[str, Path]:
    """The atlas before the other files: the row in sessions stays the last."""
    with pq.ParquetFile(files[STARS]) as file:
        stars = file.read(list(STARS_COLUMNS), use_threads=False)
    frames = _with_stars(files[FRAMES], stars["frame"].unique())
    return _written({ATLAS: [atlas_table(session_errors(stars, frames, camera), key.text)]}, folder) | files


def _with_stars(path: Path, wanted: pa.Array) -> pa.Table:
    """The boresights of the frames with such numbers: of a long session stars stand for every eighth frame or so."""
    columns = ["frame", *BORESIGHT_COLUMNS]
    with pq.ParquetFile(path) as file:
        parts = (file.read_row_group(number, columns, use_threads=False) for number in range(file.num_row_groups))
        return pa.concat_tables([part.filter(pc.is_in(part["frame"], wanted)) for part in parts])


def _failed(key: ResultKey, source: SessionSource, text: str, folder: Path) -> _Result:
    error = plain_lines(text)[:_MOST_ERROR]
    rows = _completed(failed_session(source.url, error, key), pa.nulls(1, COLUMN.type), None)
    place = Committed(UNKNOWN, UNKNOWN, key.text)
    return _Result(place, _written({SESSIONS: [rows]}, folder), None, error, packed(with_place(rows, place)))


def _written(tables: dict[str, Iterable[pa.Table]], folder: Path) -> dict[str, Path]:
    """The parts of each table as a file: those of a long night would take 100 MB in memory."""
    paths = {table: folder / f"{table}.parquet" for table in tables}
    try:
        for table, parts in tables.items():
            write_parquet(parts, paths[table])
    except OSError as error:
        raise explained(error, f"{folder} of {socket.gethostname()}") from error
    return paths


def _completed(rows: pa.Table, hot_pixels: pa.Array, report: str | None) -> pa.Table:
    return (
        without_place(rows)
        .append_column(COLUMN, hot_pixels)
        .append_column(field(REPORT_COLUMN, pa.string()), pa.array([report], pa.string()))
    )


def _night(rows: pa.Table) -> str:
    return str(rows["night"][0].as_py() or UNKNOWN)


def _put(dataset: DataSet, result: _Result) -> None:
    """The row in sessions last: with it the results count."""
    for table, parquet in result.files.items():
        dataset.put(result.place, table, parquet)


@functools.lru_cache(maxsize=4)
def _committed(job: Job) -> dict[str, Committed]:
    """What was in the data set when this worker first looked in this run."""
    return with_patience(
        job.dataset_url,
        lambda fs, root: {place.key: place for place in DataSet(job.dataset_url, fs, root).committed()},
    )
