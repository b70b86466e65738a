"""The data set of a campaign: Parquet files by table, sensor and night, as pandas, polars and DuckDB read them.

    dataset.json                                         schema and version
    sessions/sensor=NAME/night=2026-03-20/KEY.parquet    one row: verdict, figures, conditions, hashes, report.json
    frames/sensor=NAME/night=2026-03-20/KEY.parquet      one row per panorama
    stars/sensor=NAME/night=2026-03-20/KEY.parquet       one row per matched star and frame
    housekeeping/sensor=NAME/night=2026-03-20/KEY.parquet  one row per value of an item of the sensor's housekeeping
    names/sensor=NAME/night=2026-03-20/KEY.parquet       one row per star that the sensor names; none of a silent one
    atlas/sensor=NAME/night=2026-03-20/KEY.parquet       one row, or none of too few stars: its part of the error atlas
    index/sessions.parquet                               the rows of all sessions but report.json, for fast questions
    index/sources.parquet                                which source has which key, by size and time of change

A result is a file that never changes, named by its key. The other tables of a session come first and its row in
sessions last: a session is in the data set where its row is, and then it is whole. Two campaigns that judge one session
at once write the same file twice. Files in index follow from the others and from the sources: they may be deleted.
"""

import hashlib
import io
import itertools
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import quote, unquote

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from gse.campaign.sources import MOST_SESSIONS
from gse.campaign.storage import (
    StorageError,
    explained,
    find_files,
    open_storage,
    put_file_whole,
    put_whole,
    read_whole,
)
from gse.config.station import Station
from gse.errors import UsageError
from gse.report.parquet import FOOTER_LIMITS, MOST_BYTES_PER_ROW, MOST_ROWS, SCHEMA_VERSION, check_size, write_parquet

# The row of a session on its way from a worker: the index is made of rows that no file has to be read for.

_CODEC = "zstd"
_SIZE_BYTES = 8


def packed(row: pa.Table) -> bytes:
    """A table of few rows in Arrow's IPC format, compressed as a whole: 900 short columns are mostly padding."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, row.schema) as writer:
        writer.write_table(row)
    plain = sink.getvalue()
    small: bytes = pa.compress(plain, _CODEC, asbytes=True)
    return len(plain).to_bytes(_SIZE_BYTES, "little") + small


def unpacked(data: bytes) -> pa.Table:
    """The table again."""
    size = int.from_bytes(data[:_SIZE_BYTES], "little")
    return pa.ipc.open_stream(pa.decompress(data[_SIZE_BYTES:], size, _CODEC)).read_all()


OWN_STATION = "own"
"""In place of a hash: each session is judged with the station file that it holds."""


def station_sha256(station: Station, text: str) -> str:
    """Of a station file given for all sessions, with the catalogue and the protocol description that it names."""
    whole = hashlib.sha256(text.encode())
    for name in (station.catalog, station.protocol):
        path = Path(name)
        whole.update(b"\0" + (hashlib.sha256(path.read_bytes()).digest() if path.is_file() else name.encode()))
    return whole.hexdigest()


SCHEMA = f"gse.dataset/{SCHEMA_VERSION}"
MARK = "dataset.json"
SESSIONS, FRAMES, STARS, ATLAS = "sessions", "frames", "stars", "atlas"
HOUSEKEEPING, NAMES = "housekeeping", "names"
REPORT_COLUMN = "report_json"
UNKNOWN = "unknown"
"""Sensor and night of a session that could not be read: pandas does not read Hive's own name for null."""

AGAIN = "delete the file of the same name below sessions/, and judge into the data set again"
"""What to do with a damaged file: the session is not in the data set then, and the next run puts it there whole."""

INDEX = "index/sessions.parquet"
_SOURCES = "index/sources.parquet"
_MOST_MARK_BYTES = 10_000
_MOST_BYTES_PER_SESSION = 1 << 20
"""Most bytes of a row in sessions, beside what each file may have; a usual row has 0.1 MB."""
_MOST_GONE = 1000
"""Rows of the index whose session was deleted: where there are more, the index is not used."""
_ROWS_TOGETHER = 200
_NONE: Mapping[str, bytes] = MappingProxyType({})
_PLACE = ("sensor", "night")
_ORDER = (*_PLACE, "key")
_NAME = re.compile(r"sensor=([^/]*)/night=([^/]*)/([0-9a-f]{64})\.parquet$")


@dataclass(frozen=True, slots=True, order=True)
class Committed:
    """The results of one session in the data set."""

    sensor: str
    night: str
    key: str

    def path(self, table: str) -> str:
        """The file of a table, below the data set's folder."""
        return f"{table}/sensor={quote(self.sensor, safe=' ')}/night={self.night}/{self.key}.parquet"


@dataclass(slots=True)
class DataSet:
    """A data set that exists."""

    url: str
    fs: Any = field(repr=False)
    root: str = field(repr=False)

    @classmethod
    def at(cls, url: str, *, create: bool = False) -> "DataSet":
        """The data set of a URL; UsageError where there is none, or one of another version."""
        fs, root = open_storage(url)
        try:
            mark = read_whole(fs, f"{root}/{MARK}", _MOST_MARK_BYTES)
            if mark is None:
                if not create:
                    raise UsageError(
                        f"there is no data set in {url}; 'gse campaign judge SOURCES --out {url}' makes one"
                    )
                if fs.exists(root) and fs.ls(root, detail=False):
                    raise UsageError(f"{url} holds other files; name a new or empty folder for the data set")
                mark = json.dumps({"schema": SCHEMA}).encode() + b"\n"
                put_whole(fs, root, MARK, mark)
        except UsageError:
            raise
        except FileNotFoundError as error:
            raise UsageError(f"no data set can be made in {url}: there is no such bucket or folder") from error
        except Exception as error:
            raise explained(error, url) from error
        _check_version(mark, url)
        return cls(url, fs, root)

    def committed(self) -> list[Committed]:
        """What is in the data set, in the order of sensor, night and key."""
        try:
            names = list(find_files(self.fs, f"{self.root}/{SESSIONS}"))
        except FileNotFoundError:
            names = []
        except Exception as error:
            raise explained(error, self.url) from error
        found = (_NAME.search(name) for name in names)
        return sorted(Committed(unquote(match[1]), match[2], match[3]) for match in found if match)

    def has_files(self, table: str) -> bool:
        """Whether a table has any file."""
        try:
            return bool(self.fs.ls(f"{self.root}/{table}", detail=False))
        except FileNotFoundError:
            return False
        except Exception as error:
            raise explained(error, self.url) from error

    def put(self, place: Committed, table: str, parquet: Path) -> None:
        """Write the file of one table of a session, from one of this host."""
        put_file_whole(self.fs, self.root, place.path(table), parquet)

    def read(self, path: str, columns: Sequence[str] | None = None, *, most_rows: int = MOST_ROWS) -> pa.Table | None:
        """A Parquet file below the data set's folder, None where there is none.

        StorageError where it is damaged, or somebody made it: without a column that is wanted, or with too many rows.
        """
        try:
            with self.fs.open(f"{self.root}/{path}", "rb") as file:
                # A thread of Arrow's that still holds a file of Python's when the program ends aborts it (arrow#33975).
                parquet = pq.ParquetFile(file, pre_buffer=False, **FOOTER_LIMITS)
                most_bytes = _MOST_BYTES_PER_SESSION if path.startswith((SESSIONS, "index")) else MOST_BYTES_PER_ROW
                check_size("the file", parquet.metadata, most_rows=most_rows, most_bytes_per_row=most_bytes)
                lacking = set(columns or ()).difference(parquet.schema_arrow.names)
                if lacking:
                    raise ValueError(f"it has no column {min(lacking)}")
                return parquet.read(columns=columns, use_threads=False)
        except FileNotFoundError:
            return None
        except Exception as error:
            if not isinstance(error, pa.ArrowException) and getattr(error, "errno", None) is not None:
                raise explained(error, f"{self.url}/{path}") from error
            raise StorageError(f"{self.url}/{path} is damaged ({str(error).strip():.100}); {AGAIN}") from error

    def sources(self) -> list[dict[str, Any]]:
        """What is known of sources: url, state, session_sha256, the hashes it was judged with, key."""
        known = self._index_of(_SOURCES, most_rows=MOST_SESSIONS)
        return [] if known is None else known.to_pylist()

    def index_path(self) -> str | None:
        """The index of sessions below the data set's folder, None where it lacks some or has others."""
        places = self.committed()
        keys = self._index_of(INDEX, ["key"], most_rows=len(places))
        complete = keys is not None and set(keys["key"].to_pylist()) == {place.key for place in places}
        return INDEX if complete else None

    def sessions(self, columns: Sequence[str] | None = None, packed_rows: Mapping[str, bytes] = _NONE) -> pa.Table:
        """The rows of all sessions, with sensor and night, without report.json; from the index where that has them.

        ``packed_rows`` by key are not read from files either; they have all columns.
        """
        wanted = None if columns is None else list(dict.fromkeys((*columns, "sensor", "night", "key")))
        places = self.committed()
        index = self._index_of(INDEX, wanted, most_rows=2 * len(places) + _MOST_GONE)
        keys = {place.key for place in places}
        have = set() if index is None else set(index["key"].to_pylist())
        if index is not None and have - keys:
            index = index.filter(pc.is_in(index["key"], pa.array(sorted(keys))))
        rows = (
            unpacked(packed_rows[place.key]) if place.key in packed_rows else self._row(place, columns)
            for place in places
            if place.key not in have
        )
        parts = [part for part in (index, *_gathered(row for row in rows if row is not None)) if part is not None]
        if not parts:
            raise UsageError(f"there is no session in {self.url} yet")
        return pa.concat_tables(parts, promote_options="default").sort_by([(name, "ascending") for name in _ORDER])

    def renew_index(self, sources: Iterable[dict[str, Any]], packed_rows: Mapping[str, bytes] = _NONE) -> None:
        """Write the index anew, with what is known of ``sources`` beside what was known before."""
        known = {(row["url"], row["key"]): row for row in (*self.sources(), *sources)}
        if known:
            self._put_index(_SOURCES, pa.Table.from_pylist([known[each] for each in sorted(known)]))
        if self.committed():
            self._put_index(INDEX, self.sessions(packed_rows=packed_rows))

    def _put_index(self, path: str, rows: pa.Table) -> None:
        try:
            put_whole(self.fs, self.root, path, parquet_of([rows]))
        except Exception as error:
            raise explained(error, self.url) from error

    def _row(self, place: Committed, columns: Sequence[str] | None) -> pa.Table | None:
        in_file = None if columns is None else [name for name in columns if name not in _PLACE]
        rows = self.read(place.path(SESSIONS), in_file, most_rows=1)
        if rows is not None and len(rows) != 1:
            raise StorageError(
                f"{self.url}/{place.path(SESSIONS)} is damaged ({len(rows)} rows, expected one); {AGAIN}"
            )
        return None if rows is None else with_place(rows, place)

    def _index_of(self, path: str, columns: Sequence[str] | None = None, *, most_rows: int) -> pa.Table | None:
        try:
            index = self.read(path, columns, most_rows=most_rows)
        except Exception:  # an index follows from the rest: one that cannot be read is as good as none
            return None
        if index is None or path != INDEX:
            return index
        ids = sorted((field.name, pa.types.is_string(field.type)) for field in index.schema if field.name in _ORDER)
        expected = sorted((name, True) for name in _ORDER if columns is None or name in columns)
        return index if ids == expected and len(set(index["key"].to_pylist())) == len(index) else None


def _gathered(rows: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """The rows in tables of many: one by one each of their 900 columns would take memory for its padding."""
    source = iter(rows)
    while some := list(itertools.islice(source, _ROWS_TOGETHER)):
        yield pa.concat_tables(some, promote_options="default").combine_chunks()


def with_place(rows: pa.Table, place: Committed) -> pa.Table:
    """The row of a session with its sensor and night, and without report.json."""
    rows = rows.drop_columns([name for name in (REPORT_COLUMN,) if name in rows.column_names])
    for name, value in (("night", place.night), ("sensor", place.sensor)):
        rows = rows.add_column(0, pa.field(name, pa.string()), pa.array([value] * len(rows), pa.string()))
    if "key" not in rows.column_names:
        rows = rows.append_column("key", pa.array([place.key] * len(rows), pa.string()))
    return rows


def without_place(rows: pa.Table) -> pa.Table:
    """A table without the columns that the names of its folders tell."""
    return rows.drop_columns([name for name in _PLACE if name in rows.column_names])


def parquet_of(parts: Iterable[pa.Table]) -> bytes:
    """The parts of one table as a Parquet file: the same rows give the same bytes."""
    buffer = io.BytesIO()
    write_parquet(parts, buffer)
    return buffer.getvalue()


def _check_version(mark: bytes, url: str) -> None:
    try:
        schema = json.loads(mark)["schema"]
    except (ValueError, TypeError, KeyError, RecursionError):
        schema = "unreadable"
    if schema != SCHEMA:
        raise UsageError(
            f"{url} is a data set of another version ({schema!s:.40}, this program writes {SCHEMA}); "
            "judge into a new folder: the sessions are unchanged"
        )
