"""Questions to a data set in SQL, by DuckDB."""

import csv
import json
from collections.abc import Iterator
from typing import Any, TextIO

import duckdb

from drivers.outside_text import long_table_cell, plain_line, plain_lines
from gse.campaign.dataset import AGAIN, ATLAS, FRAMES, HOUSEKEEPING, NAMES, REPORT_COLUMN, SESSIONS, STARS, DataSet
from gse.campaign.sensor_atlas import atlas_schema
from gse.campaign.storage import protocol_of
from gse.errors import UsageError
from gse.report.tables import frames_schema, housekeeping_schema, names_schema, stars_schema

REPORTS = "reports"
_SCHEMAS = {
    FRAMES: frames_schema,
    STARS: stars_schema,
    ATLAS: atlas_schema,
    HOUSEKEEPING: housekeeping_schema,
    NAMES: names_schema,
}
_ROWS_AT_ONCE = 10_000
_DAMAGED = ("No magic bytes", "too small to be a Parquet file", "TProtocolException", "corrupt", "ZSTD")


def ask(dataset: DataSet, sql: str, form: str, file: TextIO) -> None:
    """Write the answer to a question to the tables of a data set; UsageError where DuckDB refuses it.

    ``form`` is text (DuckDB's own table of the first rows), csv with a head, or json with one object per line. Instants
    are UTC, to the nanosecond.
    """
    try:
        connection = connect(dataset, sql)
        answer = connection.sql(sql)
        if form == "text":
            file.write(plain_lines(f"{'done' if answer is None else answer}\n"))
        elif answer is not None:
            write = _write_csv if form == "csv" else _write_json
            write(answer.columns, _rows(connection, answer), file)
    except duckdb.Error as error:
        if any(sign in str(error) for sign in _DAMAGED):
            raise UsageError(f"a file is damaged: {AGAIN}\nDuckDB: {plain_line(str(error).splitlines()[0])}") from error
        raise UsageError(plain_lines(f"DuckDB: {error}")) from error


STEPS = "steps"
"""The steps of all runs of procedures, one a row; a view of the column of that name."""


def connect(dataset: DataSet, sql: str) -> duckdb.DuckDBPyConnection:
    """A connection with tables of a data set as views: sessions, and those that a question names, or all.

    To find the files of a table of 10,000 sessions takes half a second.
    """
    named = {table for table in (SESSIONS, REPORTS, *_SCHEMAS) if table in sql.lower()}
    connection = duckdb.connect()
    connection.execute("set autoinstall_known_extensions = false")  # nothing is fetched unasked
    connection.execute("set enable_progress_bar = false")
    connection.execute("set TimeZone = 'UTC'")
    if protocol_of(dataset.url) != "file":
        connection.register_filesystem(dataset.fs)
    index = dataset.index_path()
    if index is None:
        connection.register(SESSIONS, dataset.sessions())
    else:
        connection.execute(f"create view {SESSIONS} as select * from read_parquet('{_quoted(dataset, index)}')")
    if STEPS in sql.lower():
        connection.execute(
            f"create view {STEPS} as select key, sensor, night, procedure, step.* "
            f"from (select key, sensor, night, procedure, unnest(steps) as step from {SESSIONS})"
        )
    if REPORTS in named or not named:
        files = _quoted(dataset, f"{SESSIONS}/*/*/*.parquet")
        connection.execute(f"create view {REPORTS} as select key, {REPORT_COLUMN} from read_parquet('{files}')")
    for table in _SCHEMAS:
        if table in named or not named:
            _add(connection, dataset, table)
    return connection


def _add(connection: duckdb.DuckDBPyConnection, dataset: DataSet, table: str) -> None:
    """A view of the rows whose session is in the data set: those of one that is just being written are left out."""
    if not dataset.has_files(table):
        connection.register(table, _SCHEMAS[table]().empty_table())
        return
    files = _quoted(dataset, f"{table}/*/*/*.parquet")
    rows = f"read_parquet('{files}', hive_partitioning = true, hive_types_autocast = false)"
    connection.execute(f"create view {table} as select * from {rows} where key in (select key from {SESSIONS})")


def _quoted(dataset: DataSet, path: str) -> str:
    root = dataset.root if protocol_of(dataset.url) == "file" else dataset.url.rstrip("/")
    return f"{root}/{path}".replace("'", "''")


def _write_csv(names: list[str], rows: Iterator[tuple[Any, ...]], file: TextIO) -> None:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([long_table_cell(value) if isinstance(value, str) else value for value in row] for row in rows)


def _write_json(names: list[str], rows: Iterator[tuple[Any, ...]], file: TextIO) -> None:
    for row in rows:
        file.write(json.dumps(dict(zip(names, row, strict=True)), default=str) + "\n")


def _rows(connection: duckdb.DuckDBPyConnection, answer: duckdb.DuckDBPyRelation) -> Iterator[tuple[Any, ...]]:
    """The rows of an answer, instants as text: Python's own have no nanoseconds, and DuckDB makes them by pytz."""
    columns = [
        f"#{number}::varchar" if "TIMESTAMP" in str(kind) else f"#{number}"
        for number, kind in enumerate(answer.types, 1)
    ]
    connection.execute(f"select {', '.join(columns)} from ({answer.sql_query()})")
    while rows := connection.fetchmany(_ROWS_AT_ONCE):
        yield from rows
