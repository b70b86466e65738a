"""``gse status``: state of a running session, from another terminal."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import click

from drivers.clock import read_clock
from gse.cli import EXIT_FAIL, folded
from gse.cli.sessions import judged_as
from gse.errors import UsageError
from gse.values.instant import NS_PER_S, from_text

_SILENT_S = 10.0


@click.command("status")
@click.argument("path", metavar="[FOLDER]", type=click.Path(path_type=Path), default=Path("sessions"))
@click.option("--stop", is_flag=True, help="End the session: it is closed, judged and reported.")
@click.option("--json", "as_json", is_flag=True, help="status.json of the session, with 'running', on stdout.")
@click.pass_context
def command(ctx: click.Context, *, path: Path, stop: bool, as_json: bool) -> None:
    """Show the state of a session, detached or not: FOLDER, or the newest one below FOLDER.

    The exit code is 1 if its process ended without a report: make one with 'gse report'.
    """
    from gse.sessions.status_file import is_running, is_unfinished

    folder, status = newest_session(path)
    running = is_running(status)
    if stop:
        _stop(folder, status, running=running)
        return
    if as_json:
        click.echo(json.dumps({**status, "folder": str(folder), "running": running}))
    else:
        lines = _lines(folder, status, running=running, unfinished=is_unfinished(folder))
        click.echo(folded("\n".join(lines), indent=4))
    ctx.exit(EXIT_FAIL if is_unfinished(folder) else 0)


def newest_session(path: Path) -> tuple[Path, dict[str, Any]]:
    """The chosen session and its status: a running one before the others, then the newest."""
    from gse.sessions.status_file import is_running, read_status, session_folders

    known = [(folder, status) for folder in session_folders(path) if (status := read_status(folder)) is not None]
    if not known:
        raise UsageError(f"no session of gse run in {path}; give its folder, or the --out that it was started with")
    return max(known, key=lambda item: (is_running(item[1]), item[0].name))


def _stop(folder: Path, status: dict[str, Any], *, running: bool) -> None:
    from gse.sessions.status_file import NAME, may_be_ended

    if not running:
        raise UsageError(f"{folder} has ended; see: gse status {folder}")
    if os.name == "nt":
        raise UsageError(f"Windows cannot ask a process to end; press Ctrl-C in the window of {folder}")
    if status["state"] not in ("starting", "running"):
        raise UsageError(f"{folder} is {status['state']} already; see: gse status {folder}")
    if not may_be_ended(folder, status):
        raise UsageError(
            f"process {status['pid']}, which {folder / NAME} names, is no session of yours that records there: it was "
            "not ended; end yours with Ctrl-C in its terminal, or as the user who started it"
        )
    os.kill(status["pid"], signal.SIGTERM)
    click.echo(f"{folder} was asked to end: it is closed, judged and reported; see: gse status {folder}")


def _lines(folder: Path, status: dict[str, Any], *, running: bool, unfinished: bool) -> list[str]:
    report = f"; make the report with: gse report {folder}" if unfinished else ""
    if running:
        head = f"{folder}: {status['state']}, process {status['pid']}{_silence(status['utc'])}"
    elif status["state"] == "ended":
        verdict = judged_as(folder, status["verdict"]) if status["verdict"] else "not judged"
        head = f"{folder}: ended {status['utc']}, {verdict}, exit code {status['exit_code']}{report}"
    else:
        head = f"{folder}: died while {status['state']}, last seen {status['utc']}{report}"
    identified = "-" if status["identified"] is None else f"{100 * status['identified']:.1f} %"
    return [
        head,
        f"  link {status['link']} on {status['port']}",
        f"  {status['frames']} frames, {status['frames_lost']} lost, {identified} identified, "
        f"last answer {status['last_answer_utc'] or 'none'}",
        *([f"  {status['so_far']}{_forecast(status)}"] if status["state"] != "ended" else []),
        *([f"  live page {status['page']}"] if running and status.get("page") else []),
        f"  {status['session_bytes'] / 1e6:.1f} MB recorded, disk {status['disk_free_bytes'] / 1e9:.1f} GB free",
    ]


def _forecast(status: dict[str, Any]) -> str:
    return f"; {status['forecast']}" if status.get("forecast") else ""


def _silence(utc: str) -> str:
    silent_s = (read_clock().utc_ns - from_text(utc)) / NS_PER_S
    return f", has not renewed its status for {silent_s:.0f} s" if silent_s > _SILENT_S else ""
