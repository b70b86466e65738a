"""The Python interface: ``gse.load``, ``gse.judge``, ``gse.identify``, ``gse.session``.

Small and stable: names, parameters and columns stay within a schema version. docs/python.md is an example that runs.
Errors are of gse.errors, drivers.errors and protocols.errors, each with one or two lines for a person.
"""

import json
import logging
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.dataset as ds
from numpy.typing import ArrayLike, NDArray

from drivers.session_file.reader import session_file
from gse.config.choice import change_to, station_of, with_identifier
from gse.errors import UsageError
from gse.imaging.panorama_table import read_panorama_table
from gse.report.parquet import MOST_ROWS, SCHEMA_VERSION, check_size
from gse.report.sessions_table import SessionTables, session_tables
from gse.report.tables import frames_schema, stars_schema
from gse.sessions.kept_results import Judged, judged_session, result_key
from gse.sessions.replay import replay_session
from gse.sessions.stepped import SteppedSession
from gse.station.frame_results import FrameResult
from gse.station.loop import StationLoop
from gse.station.setup import set_up
from gse.values import instant
from gse.values.panorama import Panorama
from gse.verdict.assessment import Assessment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DATASET_MARK, _MOST_MARK_BYTES = "dataset.json", 10_000
_DATASET_SCHEMA = f"gse.dataset/{SCHEMA_VERSION}"
_SCHEMAS = {"frames": frames_schema, "stars": stars_schema}
_PARTITIONS = ds.partitioning(pa.schema([("sensor", pa.string()), ("night", pa.string())]), flavor="hive")
_ERRORS = ("onboard_d_ra_cosde_arcsec", "onboard_d_de_arcsec", "onboard_d_roll_arcsec")
_COLUMNS = (("x_px", "x"), ("y_px", "y"), ("brightness", "index_value", "index"))
"""Names that the columns of a data frame may have."""
_log = logging.getLogger("gse")


class Results:
    """The tables of a session, or of a data set of many: each is read when it is first asked for.

    docs/tables.md lists the columns; ``.to_pandas()`` of a table gives a data frame.
    """

    def __init__(self, read: Callable[[str], pa.Table]) -> None:
        self._read = read

    def __repr__(self) -> str:
        return "<gse results: .sessions, .frames and .stars are pyarrow tables>"

    @cached_property
    def sessions(self) -> pa.Table:
        """One row per session: verdict, every figure with its interval, conditions, hashes."""
        return self._read("sessions")

    @cached_property
    def frames(self) -> pa.Table:
        """One row per panorama: time, answers of each subject, errors, sky."""
        return self._read("frames")

    @property
    def errors(self) -> pa.Table:
        """Time and errors of each panorama: the first columns that one plots."""
        names = self.frames.column_names
        return self.frames.select(["utc", *(name for name in names if name in _ERRORS)])

    def plot(self) -> "Figure":
        """A figure of the errors in right ascension and declination against time."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9, 4), layout="constrained")
        for axes, name in zip(figure.subplots(2, 1, sharex=True), _ERRORS, strict=False):
            axes.plot(self.errors["utc"].to_numpy(), self.errors[name].to_numpy(), ".", markersize=2)
            axes.axhline(0, color="grey", linewidth=0.8)
            axes.set_ylabel(f"{name.split('_', 1)[1].removesuffix('_arcsec')} (arcsec)")
        return figure

    @cached_property
    def stars(self) -> pa.Table:
        """One row per matched star and frame: residual, pixel phase, place in the field, temperature; thinned."""
        return self._read("stars")


def load(path: str | Path) -> Results:
    """The tables of a session (its folder or .mcap file), or of the data set of a campaign.

    A session that was judged before gives its kept results; else it is derived and judged now. CaptureError or
    UsageError where there is neither.
    """
    if "://" in str(path):
        raise UsageError(f"{path} is not on this host; copy it here, or ask a data set with 'gse campaign query'")
    path = Path(path)
    if (path / _DATASET_MARK).is_file():
        _check_version(path)
        return Results(lambda table: _of_data_set(path, table))
    tables = _of_session(path)
    return Results(lambda table: getattr(tables, table))


def session(station: str | Path | None = None, *, out: str | Path = "sessions") -> SteppedSession:
    """A session whose steps the program gives, for a ``with`` block; docs/python-tests.md shows it at work.

    ``station`` is a station file, the simulated sensor without one; ``out`` gets the folder of the session.
    """
    return SteppedSession(station, out=out)


def judge(
    session: str | Path, *, station: str | Path | None = None, identifier: str | None = None, anew: bool = False
) -> Assessment:
    """The verdict on a recorded session, with its reasons, judged rows and statistics.

    ``station`` is a station file instead of the session's own, ``identifier`` puts another one under test. ``anew``
    derives everything from the bytes, without kept results.
    """
    return _judged(Path(session), station, identifier, anew=anew).assessment


def identify(
    panorama: "str | Path | tuple[ArrayLike, ArrayLike] | ArrayLike | pa.Table",
    *,
    station: str | Path | None = None,
    identifier: str | None = None,
    utc: str | None = None,
) -> FrameResult:
    """The stars of one panorama with RA, DE and roll: ``.status``, ``.attitude``, ``.matches``.

    ``panorama`` is the file of a panorama table; a data frame or Arrow table with columns x_px, y_px, brightness; an
    array (N, 3) of the same; or pixels (N, 2) as x, y with brightness (N,), brightest first. With
    ``utc`` ("2026-03-20T18:30:00Z") the answer is compared with the mount of the ``station``: ``.attitude_error``.
    UsageError where the arrays are not of these shapes.
    """
    if isinstance(panorama, str | Path):
        xy_px, brightness = read_panorama_table(Path(panorama))
    else:
        xy_px, brightness = _pixels(_pair(panorama))
    try:
        utc_ns = instant.from_text(utc) if utc else 0
    except ValueError as error:
        raise UsageError(f"utc: {error}") from error
    setup = set_up(*with_identifier(*station_of(Path(station) if station else None), identifier))
    return StationLoop(setup).observe(Panorama(utc_ns, xy_px, brightness))


def _pair(panorama: Any) -> Any:
    """Pixels and brightness of a data frame, an Arrow table or an array (N, 3), brightest first; a pair as it is."""
    names = getattr(panorama, "column_names", None) or getattr(panorama, "columns", None)
    if names is not None:
        return _sorted(np.column_stack([_numbers(panorama[_column(names, known)]) for known in _COLUMNS]))
    if isinstance(panorama, np.ndarray) and panorama.ndim == 2 and panorama.shape[1] == 3:
        return _sorted(_numbers(panorama))
    return panorama


def _column(names: Any, known: tuple[str, ...]) -> str:
    found = next((name for name in known if name in list(names)), None)
    if found is None:
        raise UsageError(f"the table has no column {' or '.join(known)}; it has {', '.join(map(str, names)):.200}")
    return found


_EXPECTED = "expected pixels (N, 2) as x, y and brightness (N,), or the file of a panorama table"


def _numbers(values: Any) -> NDArray[np.float64]:
    """As numbers; UsageError where they are none. A masked value is not there, and numpy would take what lies below."""
    try:
        if np.iscomplexobj(values) or np.ma.is_masked(values):
            raise ValueError("it has complex or masked values")
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise UsageError(f"this is not a panorama ({error}); {_EXPECTED}") from error


def _sorted(rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    rows = rows[np.argsort(-rows[:, 2], kind="stable")]
    return rows[:, :2], rows[:, 2]


def _pixels(panorama: tuple[ArrayLike, ArrayLike]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels (N, 2) and brightness (N,) as given; a transposed array would be other pixels, so none is reshaped."""
    try:
        xy_px, brightness = map(_numbers, panorama)
    except (TypeError, ValueError) as error:
        raise UsageError(f"this is not a panorama ({error}); {_EXPECTED}") from error
    if not xy_px.size and not brightness.size:
        return np.empty((0, 2)), np.empty(0)
    if xy_px.ndim != 2 or xy_px.shape[1] != 2 or brightness.shape != xy_px.shape[:1]:
        raise UsageError(f"pixels {xy_px.shape} and brightness {brightness.shape} came; {_EXPECTED}")
    if not (np.isfinite(xy_px).all() and np.isfinite(brightness).all()):
        raise UsageError("pixels or brightness are not finite; leave out what was not measured")
    if np.any(brightness < 0):
        raise UsageError("the brightness is negative; expected that of light, not magnitudes")
    if np.any(np.diff(brightness) > 0):
        raise UsageError("the brightness increases; expected the brightest object first, and brightness, not magnitude")
    return xy_px, brightness


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
    if not (path / "sessions").is_dir():
        raise UsageError(f"there is no session in {path} yet")
    if not (path / table).is_dir():  # no session of it could be judged
        return _SCHEMAS[table]().empty_table()
    try:
        files = _files(path, table)
        if table == "sessions":
            return files.to_table()
        keys = _files(path, "sessions").to_table(columns=["key"])["key"].combine_chunks()
        return files.to_table(filter=ds.field("key").cast(pa.string()).isin(keys))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UsageError(
            f"{str(error).splitlines()[0]:.400}\nif a file is damaged: delete the file of the same name below "
            "sessions/, and judge into the data set again"
        ) from error


def _check_version(path: Path) -> None:
    try:
        schema = json.loads((path / _DATASET_MARK).read_bytes()[:_MOST_MARK_BYTES])["schema"]
    except (ValueError, TypeError, KeyError, RecursionError):
        schema = "unreadable"
    if schema != _DATASET_SCHEMA:
        raise UsageError(f"{path} is a data set of another version ({schema!s:.40}; expected {_DATASET_SCHEMA})")


def _files(path: Path, table: str) -> ds.Dataset:
    files = ds.dataset(path / table, format="parquet", partitioning=_PARTITIONS)
    for file in files.get_fragments():
        check_size(file.path, file.metadata, most_rows=1 if table == "sessions" else MOST_ROWS)
    return files
