"""``gse session``: show, verify, recover, trim, export and import sessions."""

import json
import sys
from contextlib import ExitStack
from io import TextIOWrapper
from pathlib import Path
from typing import Any, BinaryIO

import click

from drivers.host_files import new_file
from drivers.outside_text import plain_lines
from drivers.session_file.records import RX
from gse.cli import EXIT_DATA_LOST, damage_code
from gse.cli.options import station_option
from gse.config.choice import station_of
from gse.errors import UsageError
from gse.values import instant

_session = click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
_json = click.option("--json", "as_json", is_flag=True, help="One JSON object on stdout.")
_out = click.option("-o", "--out", type=click.Path(path_type=Path, dir_okay=False), help="The new file.")


class _WithSynonym(click.Group):
    """``gse session show`` is ``gse session info``."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return super().get_command(ctx, "info" if cmd_name == "show" else cmd_name)


@click.group("session", cls=_WithSynonym)
def command() -> None:
    """Work with recorded sessions. FILE is a .mcap file, or the folder that gse run made."""


@command.command()
@_session
@_json
def info(path: Path, as_json: bool) -> None:
    """Show the content of a session."""
    from gse.recording.session_tools import session_info

    document = session_info(path)
    _offer_report(path)
    if as_json:
        click.echo(json.dumps(document))
        return
    for name, value in document.items():
        if name != "schema":
            click.echo(f"{name:<12} {plain_lines(_text(value))}")


def _offer_report(path: Path) -> None:
    """Print the command for the report of a session without one."""
    from gse.sessions.status_file import is_unfinished

    folder = path if path.is_dir() else path.parent
    if (path.is_dir() or path.name == "session.mcap") and is_unfinished(folder):
        click.echo(f"gse: the session has no report; make one with: gse report {folder}", err=True)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {count}" for name, count in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "unknown" if value is None else str(value)


@command.command()
@_session
@_json
@click.pass_context
def verify(ctx: click.Context, path: Path, as_json: bool) -> None:
    """Read every byte of a session and check it. The exit code is 3 if the session is damaged or incomplete."""
    from drivers.session_file.reader import verify as verify_session
    from gse.recording.session_tools import describe, verify_json

    check = verify_session(path)
    _offer_report(path)
    click.echo(json.dumps(verify_json(check)) if as_json else plain_lines("\n".join(describe(check))))
    if not check.is_whole:
        click.echo(
            "gse: the session is damaged or incomplete; 'gse session recover' saves all intact records", err=True
        )
        ctx.exit(EXIT_DATA_LOST)


@command.command()
@_session
@_out
@_json
@click.pass_context
def recover(ctx: click.Context, path: Path, out: Path | None, as_json: bool) -> None:
    """Write every intact record to a new session. The exit code is 3 if something was lost."""
    from gse.recording.session_tools import recover as recover_session

    _report(ctx, recover_session(path, out or _beside(path, "recovered")), as_json)


@command.command()
@_session
@click.option("--from", "from_utc", help="From this UTC on, e.g. 2026-03-20T18:30:00Z.")
@click.option("--to", "to_utc", help="Up to this UTC.")
@_out
@_json
@click.pass_context
def trim(
    ctx: click.Context, path: Path, from_utc: str | None, to_utc: str | None, out: Path | None, as_json: bool
) -> None:
    """Write a part of a session to a new one."""
    from gse.recording.session_tools import trim as trim_session

    if from_utc is None and to_utc is None:
        raise UsageError("the part is missing; give --from, --to or both, e.g. --from 2026-03-20T18:30:00Z")
    copied = trim_session(path, out or _beside(path, "trimmed"), _utc(from_utc), _utc(to_utc))
    if not copied.messages:
        copied.path.unlink()
        raise UsageError(
            f"{path} holds nothing from {from_utc or 'its start'} to {to_utc or 'its end'}; see 'gse session info'"
        )
    _report(ctx, copied, as_json)


@command.command("import")
@click.argument("capture", metavar="CAPTURE", type=click.Path(path_type=Path))
@station_option
@click.option("--start-utc", help="UTC of the first panorama of a capture, e.g. 2026-03-20T18:30:00Z.")
@click.option("--clock-error", "clock_error", help="A bound of the error of --start-utc: 0.1s, 20ms.")
@_out
def import_(
    capture: Path, station_path: Path | None, start_utc: str | None, clock_error: str | None, out: Path | None
) -> None:
    """Make a session of a raw capture, or of a table, that another program wrote.

    gse report, view, why and compare take the session; it has the station file, and the same report as a replay of the
    capture. A table is CSV with a UTC on each line: of panoramas (utc, y, x, index), or of attitudes as a spacecraft
    sends them (utc, valid, and q1 to q4 or ra_deg, de_deg, roll_deg).
    """
    from gse.sessions.imported import import_capture
    from gse.statistics.clock_health import stated_error_s

    station, text = station_of(station_path)
    path = out or capture.with_suffix(".mcap")
    error_s = None if clock_error is None else stated_error_s(clock_error)
    size = import_capture(capture, path, station, text, start_utc, error_s)
    click.echo(path)
    click.echo(f"{size} bytes of {capture}; its report: gse report {path}", err=True)


@command.command()
@_session
@click.option(
    "--format",
    "form",
    type=click.Choice(("csv", "ndjson", "raw", "stderr", "rrd", "parquet", "mcap")),
    required=True,
    help="Panoramas as CSV, all records as NDJSON, the received bytes, what an external identifier wrote to stderr, a "
    "rerun recording; results as a new folder of Parquet files, or as topics beside the bytes in a new MCAP file.",
)
@_out
@click.pass_context
def export(ctx: click.Context, path: Path, form: str, out: Path | None) -> None:
    """Export a session for other programs; to stdout without -o (rrd, parquet and mcap need -o)."""
    if form == "rrd":
        _export_rrd(ctx, path, out)
        return
    if form in ("parquet", "mcap"):
        ctx.exit(_export_results(path, form, out))
    from gse.recording.session_format import LOG_TOPIC
    from gse.sessions.export import export_bytes, export_csv, export_ndjson

    topics = {"raw": RX, "stderr": LOG_TOPIC}
    with ExitStack() as stack:
        if form in topics:
            done = export_bytes(path, _new(out, stack) if out else sys.stdout.buffer, topics[form])
        else:
            text = stack.enter_context(TextIOWrapper(_new(out, stack), "utf-8", newline="\n")) if out else sys.stdout
            done = export_csv(path, text) if form == "csv" else export_ndjson(path, text)
    what = {"csv": "panoramas", "ndjson": "records"}.get(form, "bytes")
    click.echo(f"{done.written} {what} exported", err=True)
    ctx.exit(damage_code(path, damaged=done.damaged))


def _export_results(path: Path, form: str, out: Path | None) -> int:
    """Write the results of a session; the exit code."""
    from drivers.session_file.reader import session_file
    from gse.cli.progress import judged_with_progress
    from gse.report.sessions_table import session_tables
    from gse.sessions.export import export_mcap, export_parquet
    from gse.sessions.kept_results import result_key

    if out is None:
        raise UsageError(f"results need a name: -o {'tables' if form == 'parquet' else 'results.mcap'}")
    first = session_file(path)
    if out.exists():
        raise UsageError(f"{out} exists already; choose another name")
    judged = judged_with_progress(path)
    tables = session_tables(judged.session, judged.assessment, result_key(first, judged.session.station_text))
    try:
        count = export_parquet(tables, out) if form == "parquet" else export_mcap(path, tables, out)
    except OSError as error:
        raise UsageError(f"cannot write {out}: {error.strerror}") from error
    click.echo(f"{count} {'rows' if form == 'parquet' else 'results'} exported to {out}", err=True)
    return damage_code(path, damaged=judged.session.truncated)


def _export_rrd(ctx: click.Context, path: Path, out: Path | None) -> None:
    from gse.cli.view import command as view

    if out is None:
        raise UsageError("a rerun recording needs a name: -o session.rrd")
    if out.exists():
        raise UsageError(f"{out} exists already; choose another name")
    ctx.invoke(view, path=path, view=None, bind="127.0.0.1", http_port=0, out=out, clock_error_s=None)


def _new(out: Path, stack: ExitStack) -> BinaryIO:
    try:
        return stack.enter_context(new_file(out))
    except FileExistsError:
        raise UsageError(f"{out} exists already; choose another name") from None
    except OSError as error:
        raise UsageError(f"cannot write {out}: {error.strerror}") from error


def _beside(path: Path, what: str) -> Path:
    from drivers.session_file.reader import session_file

    first = session_file(path)
    return first.with_name(f"{first.stem}.{what}.mcap")


def _utc(text: str | None) -> int | None:
    try:
        return None if text is None else instant.from_text(text)
    except ValueError as error:
        raise UsageError(str(error)) from error


def _report(ctx: click.Context, copied: Any, as_json: bool) -> None:
    if as_json:
        counts = ("messages", "attachments", "rx_bytes", "damaged_bytes", "damaged_places")
        document = {name: getattr(copied, name) for name in (*counts, "missing", "foreign", "truncated")}
        click.echo(json.dumps({"schema": "gse.session.copy/1", "path": str(copied.path), **document}))
    else:
        click.echo(f"{copied.path}: {copied.messages} messages with {copied.rx_bytes} received bytes")
        if copied.damaged_places:
            click.echo(f"left out: {copied.damaged_bytes} damaged bytes in {copied.damaged_places} places")
        if copied.missing:
            click.echo(f"missing: {', '.join(copied.missing)}")
        for text in copied.foreign:
            click.echo(plain_lines(text))
        if copied.truncated and not copied.foreign:
            click.echo("the session was not closed: data after its last intact record may be missing")
    if not copied.is_all:
        ctx.exit(EXIT_DATA_LOST)
