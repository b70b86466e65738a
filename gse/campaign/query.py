"""Questions to a data set in SQL, by DuckDB."""

import csv
import json
from collections.abc import Iterator
from typing import Any, TextIO

import duckdb

from gse.campaign.dataset import FRAMES, REPORT_COLUMN, SESSIONS, STARS, DataSet
from gse.campaign.storage import protocol_of
from gse.errors import UsageError
from gse.tables import frames_schema, stars_schema

_SCHEMAS = {FRAMES: frames_schema, STARS: stars_schema}
_ROWS_AT_ONCE = 10_000


def ask(dataset: DataSet, sql: str) -> duckdb.DuckDBPyRelation:
    """The answer to a question to the tables sessions, frames, stars and reports; UsageError where DuckDB refuses it."""
    connection = connect(dataset)
    try:
        answer = connection.sql(sql)
    except duckdb.Error as error:
        raise UsageError(f"DuckDB: {error}") from error
    if answer is None:
        raise UsageError("the statement has no answer; expected a question such as: select sensor, verdict from sessions")
    return answer


def connect(dataset: DataSet) -> duckdb.DuckDBPyConnection:
    """A connection with the tables of a data set as views."""
    connection = duckdb.connect()
    connection.execute("set autoinstall_known_extensions = false")  # nothing is fetched unasked
    connection.execute("set enable_progress_bar = false")
    if protocol_of(dataset.url) != "file":
        connection.register_filesystem(dataset.fs)
    index = dataset.index_path()
    if index is None:
        connection.register(SESSIONS, dataset.sessions())
    else:
        connection.execute(f"create view {SESSIONS} as select * from read_parquet('{_quoted(dataset, index)}')")
    files = _quoted(dataset, f"{SESSIONS}/*/*/*.parquet")
    connection.execute(f"create view reports as select key, {REPORT_COLUMN} from read_parquet('{files}')")
    for table in (FRAMES, STARS):
        _add(connection, dataset, table)
    return connection


def _add(connection: duckdb.DuckDBPyConnection, dataset: DataSet, table: str) -> None:
    """A view of the rows whose session is in the data set: those of one that is just being written are left out."""
    if not dataset.has_files(table):
        connection.register(table, _SCHEMAS[table]().empty_table())
        return
    files = _quoted(dataset, f"{table}/*/*/*.parquet")
    rows = f"read_parquet('{files}', hive_partitioning = true)"
    connection.execute(f"create view {table} as select * from {rows} where key in (select key from {SESSIONS})")


def _quoted(dataset: DataSet, path: str) -> str:
    root = dataset.root if protocol_of(dataset.url) == "file" else dataset.url.rstrip("/")
    return f"{root}/{path}".replace("'", "''")


def write_text(answer: duckdb.DuckDBPyRelation, file: TextIO) -> None:
    """For a person: a table of the first rows, as DuckDB shows it."""
    file.write(f"{answer}\n")


def write_csv(answer: duckdb.DuckDBPyRelation, file: TextIO) -> None:
    """All rows, with a head."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(answer.columns)
    for row in _rows(answer):
        writer.writerow(row)


def write_json(answer: duckdb.DuckDBPyRelation, file: TextIO) -> None:
    """One object per row and line."""
    for row in _rows(answer):
        file.write(json.dumps(dict(zip(answer.columns, row, strict=True)), default=str) + "\n")


def _rows(answer: duckdb.DuckDBPyRelation) -> Iterator[tuple[Any, ...]]:
    try:
        while rows := answer.fetchmany(_ROWS_AT_ONCE):
            yield from rows
    except duckdb.Error as error:
        raise UsageError(f"DuckDB: {error}") from error
