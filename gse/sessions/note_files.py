"""Notes on their way to a running session, as files in its folder.

``gse note`` leaves a file, and the thread of the status file takes it away within a second: no server is needed.
Anybody who may write into the folder may leave a note.
"""

import contextlib
import itertools
import os
from pathlib import Path

from drivers.host_files import READ
from gse.errors import UsageError
from gse.station.notes import MOST_CHARACTERS, MOST_WAITING, Notes, note_text

_PATTERN = "note-*.txt"
_READ = READ | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
"""No pipe is waited for, and no link takes another file of this host into the session."""


def leave_note(folder: Path, text: str, number: int) -> Path:
    """Leave a note for the session that records into ``folder``; the file goes when it is taken.

    ``number`` tells notes apart. UsageError where it cannot be written.
    """
    path = folder / f"note-{number:020d}.txt"
    unfinished = path.with_name(f".{path.name}.part")
    try:
        unfinished.write_text(text + "\n", encoding="utf-8")
        unfinished.replace(path)
    except OSError as error:
        raise UsageError(f"cannot leave a note in {folder}: {error.strerror}") from error
    return path


def collect_notes(folder: Path, notes: Notes) -> None:
    """Take the notes that were left in a folder, oldest first; what is not one line of text is thrown away."""
    left = (path for path in sorted(folder.glob(_PATTERN)) if not path.is_dir())
    for path in itertools.islice(left, MOST_WAITING):
        with contextlib.suppress(OSError, ValueError):
            text = _content(path)
            path.unlink()
            notes.put(note_text(text))


def _content(path: Path) -> str:
    """The beginning of a file; empty where it is none."""
    try:
        with os.fdopen(os.open(path, _READ), "rb") as file:
            return file.read(4 * MOST_CHARACTERS + 1).decode(errors="replace")
    except OSError:
        return ""
