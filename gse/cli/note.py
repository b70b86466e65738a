"""``gse note``: a line into a running session, from another terminal."""

import threading
from pathlib import Path

import click

from drivers.clock import read_clock
from gse.cli.status import newest_session
from gse.errors import UsageError
from gse.sessions.status_file import is_running, leave_note
from gse.station.events import OF_MOUNT, note_text

_TAKEN_WITHIN_S = 5.0
_LOOK_EVERY_S = 0.1


@click.command("note")
@click.argument("text")
@click.option(
    "--mount",
    is_flag=True,
    help="The mount was touched: answers of the minute before and after are left out, with how far off they were.",
)
@click.argument("path", metavar="[FOLDER]", type=click.Path(path_type=Path), default=Path("sessions"))
def command(*, text: str, path: Path, mount: bool) -> None:
    """Record TEXT as a note in the running session, with its time; the report shows it.

    FOLDER is the session's, or the --out that it was started with.
    """
    try:
        line = note_text(f"{OF_MOUNT} {text}" if mount else text)
    except ValueError as error:
        raise UsageError(str(error)) from error
    folder, status = newest_session(path)
    if not is_running(status) or status["state"] not in ("starting", "running"):
        state = "is" if is_running(status) or status["state"] == "ended" else "died while"
        raise UsageError(f"{folder} takes no notes: it {state} {status['state']}; see: gse status {folder}")
    left = leave_note(folder, line, read_clock().utc_ns)
    if not _is_taken(left):
        left.unlink(missing_ok=True)
        raise UsageError(f"{folder} did not take the note within {_TAKEN_WITHIN_S:g} s; see: gse status {folder}")
    click.echo(f"noted in {folder}: {line}")


def _is_taken(left: Path) -> bool:
    pause = threading.Event()
    for _ in range(round(_TAKEN_WITHIN_S / _LOOK_EVERY_S)):
        if not left.exists():
            return True
        pause.wait(_LOOK_EVERY_S)
    return False
