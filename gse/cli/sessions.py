"""``gse sessions``: the recorded sessions of a folder, with their verdicts."""

import json
from pathlib import Path
from typing import Any

import click

from drivers.outside_text import plain_line, plain_lines
from gse.cli.options import duration_text
from gse.errors import UsageError

_MOST_REPORT_BYTES = 16 << 20
_LONGEST_S = 366 * 86400
_STATE_COLUMNS = 32
"""Columns of the longest verdict; a session without a report has a command there, and goes beyond them."""


@click.command("sessions")
@click.argument("path", metavar="[FOLDER]", type=click.Path(path_type=Path), default=Path("sessions"))
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.session-list/1.")
def command(*, path: Path, as_json: bool) -> None:
    """List the sessions below FOLDER, ./sessions by default, the newest last: when, how long, verdict, folder.

    Commands that take a session use the newest one below ./sessions where none is given.
    """
    from gse.sessions.status_file import session_folders

    rows = [_row(folder) for folder in session_folders(path)]
    if as_json:
        click.echo(json.dumps({"schema": "gse.session-list/1", "sessions": rows}))
        return
    if not rows:
        raise UsageError(f"there is no session below {path}; give another folder, or record one with: gse run")
    widest = min(_STATE_COLUMNS, max(len(row["state"]) for row in rows))
    for row in rows:
        length = "-" if row["duration_s"] is None else duration_text(row["duration_s"])
        click.echo(
            plain_lines(f"{(row['first_utc'] or '-')[:19]:19}  {length:>8}  {row['state']:{widest}}  {row['folder']}")
        )


def _row(folder: Path) -> dict[str, Any]:
    """A session as its files tell it: running, judged, or still without a report."""
    from gse.sessions.status_file import is_running, read_status

    report, status = _report(folder), read_status(folder)
    facts = report.get("session", {})
    running = status is not None and is_running(status)
    state = status["state"] if running and status else _headline(report) or f"no report: gse report {folder}"
    return {
        "folder": str(folder),
        "sensor": facts.get("sensor"),
        "first_utc": facts.get("first_utc"),
        "duration_s": facts.get("duration_s"),
        "verdict": report.get("verdict"),
        "state": state,
    }


def judged_as(folder: Path, verdict: str) -> str:
    """A verdict as the report of the session prints it: whether it is relative, or of a simulated sensor."""
    report = _report(folder)
    return _headline(report) if report.get("verdict") == verdict else verdict


def _headline(report: dict[str, Any]) -> str:
    mark = " (SIMULATED)" if report.get("simulated") else ""
    return f"{report['word']}{mark}" if "word" in report else ""


def _report(folder: Path) -> dict[str, Any]:
    """The newest report of a session as it is read; empty where there is none, or it is none of ours."""
    paths = [folder / "report.json", *folder.glob("report*/report.json")]
    for path in sorted(filter(Path.is_file, paths), key=lambda one: one.stat().st_mtime, reverse=True):
        try:
            with path.open("rb") as file:
                document = json.loads(file.read(_MOST_REPORT_BYTES))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(document, dict) and document.get("schema") == "gse.report/1":
            return _checked(document)
    return {}


def _checked(document: dict[str, Any]) -> dict[str, Any]:
    """Only what is listed, of the kind that it must be: a folder may come from anybody."""
    session = document.get("session")
    facts = session if isinstance(session, dict) else {}
    texts = {key: facts[key] for key in ("sensor", "first_utc") if isinstance(facts.get(key), str)}
    length = facts.get("duration_s")
    seconds: dict[str, float] = {}
    if isinstance(length, int | float) and 0 <= length <= _LONGEST_S:
        seconds = {"duration_s": float(length)}
    words = {key: plain_line(document[key]) for key in ("word", "verdict") if isinstance(document.get(key), str)}
    session_facts = {**{key: plain_line(text) for key, text in texts.items()}, **seconds}
    return {**words, "simulated": document.get("simulated") is True, "session": session_facts}
