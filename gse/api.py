"""The Python interface: ``gse.load``, ``gse.judge``, ``gse.identify``.

Small and stable: names, parameters and columns stay within a schema version. docs/python.md is an example that runs.
Errors are of gse.errors, drivers.errors and protocols.errors, each with one or two lines for a person.
"""

import logging
from collections.abc import Callable
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.dataset as ds
from numpy.typing import ArrayLike

from drivers.session_file.reader import session_file
from gse import instant
from gse.assessment.verdict import Assessment
from gse.cli.options import change_to, station_of, with_identifier
from gse.errors import UsageError
from gse.imaging.panorama_table import read_panorama_table
from gse.panorama import Panorama
from gse.sessions.judged import Judged, judged_session, result_key
from gse.sessions.replay import replay_session
from gse.station.loop import StationLoop
from gse.station.results import FrameResult
from gse.station.setup import set_up
from gse.tables import SessionTables, session_tables

_DATASET_MARK = "dataset.json"
_PARTITIONS = ds.partitioning(pa.schema([("sensor", pa.string()), ("night", pa.string())]), flavor="hive")
_log = logging.getLogger("gse")


class Results:
    """The tables of a session, or of a data set of many: each is read when it is first asked for.

    docs/tables.md lists the columns; ``.to_pandas()`` of a table gives a data frame.
    """

    def __init__(self, read: Callable[[str], pa.Table]) -> None:
        self._read = read

    @cached_property
    def sessions(self) -> pa.Table:
        """One row per session: verdict, every figure with its interval, conditions, hashes."""
        return self._read("sessions")

    @cached_property
    def frames(self) -> pa.Table:
        """One row per panorama: time, answers of each subject, errors, sky."""
        return self._read("frames")

    @cached_property
    def stars(self) -> pa.Table:
        """One row per matched star and frame: residual, pixel phase, place in the field, temperature; thinned."""
        return self._read("stars")


def load(path: str | Path) -> Results:
    """The tables of a session (its folder or .mcap file), or of the data set of a campaign.

    A session that was judged before gives its kept results; else it is derived and judged now. CaptureError or
    UsageError where there is neither.
    """
    path = Path(path)
    if (path / _DATASET_MARK).is_file():
        return Results(lambda table: _of_data_set(path, table))
    tables = _of_session(path)
    return Results(lambda table: getattr(tables, table))


def judge(
    session: str | Path, *, station: str | Path | None = None, identifier: str | None = None, anew: bool = False
) -> Assessment:
    """The verdict on a recorded session, with its reasons, judged rows and statistics.

    ``station`` is a station file instead of the session's own, ``identifier`` puts another one under test. ``anew``
    derives everything from the bytes, without kept results.
    """
    return _judged(Path(session), station, identifier, anew=anew).assessment


def identify(
    panorama: str | Path | tuple[ArrayLike, ArrayLike],
    *,
    station: str | Path | None = None,
    identifier: str | None = None,
    utc: str | None = None,
) -> FrameResult:
    """The stars of one panorama with RA, DE and roll: ``.status``, ``.attitude``, ``.matches``.

    ``panorama`` is the file of a panorama table, or pixels (N, 2) as x, y with brightness (N,), brightest first. With
    ``utc`` ("2026-03-20T18:30:00Z") the answer is compared with the mount of the ``station``: ``.attitude_error``.
    """
    xy_px, brightness = panorama if isinstance(panorama, tuple) else read_panorama_table(Path(panorama))
    pixels = np.asarray(xy_px, dtype=np.float64).reshape(-1, 2)
    values = np.asarray(brightness, dtype=np.float64).reshape(-1)
    if len(pixels) != len(values):
        raise UsageError(f"{len(pixels)} pixels and {len(values)} brightness values came; expected as many of both")
    setup = set_up(*with_identifier(*station_of(Path(station) if station else None), identifier))
    return StationLoop(setup).observe(Panorama(instant.from_text(utc) if utc else 0, pixels, values))


def _judged(path: Path, station: str | Path | None, identifier: str | None, *, anew: bool = False) -> Judged:
    change = change_to(Path(station) if station else None, identifier)
    return judged_session(
        path, station=change, derive=lambda: replay_session(path, station=change), tell=_log.info, anew=anew
    )


def _of_session(path: Path) -> SessionTables:
    judged = _judged(path, None, None)
    key = result_key(session_file(path), judged.session.station_text)
    return session_tables(judged.session, judged.assessment, key, source=str(path))


def _of_data_set(path: Path, table: str) -> pa.Table:
    """All files of a table, of the sessions that are in the data set: those whose row is there."""
    files = _files(path, table)
    if table == "sessions":
        return files.to_table()
    keys = _files(path, "sessions").to_table(columns=["key"])["key"].combine_chunks()
    return files.to_table(filter=ds.field("key").cast(pa.string()).isin(keys))


def _files(path: Path, table: str) -> ds.Dataset:
    return ds.dataset(path / table, format="parquet", partitioning=_PARTITIONS)
