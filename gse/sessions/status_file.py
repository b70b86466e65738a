"""Status file of a live session, renewed each second, for other terminals.

status.json in the session folder, schema gse.status/1. A separate thread writes the complete file each time, so that a
slow disk does not delay the session. The start time of its process tells it apart from a later process with the same
number.
"""

import contextlib
import json
import math
import os
import shutil
import threading
from pathlib import Path
from typing import Any

from drivers.clock import read_clock
from drivers.host_files import only_a_file
from drivers.outside_text import is_plain
from drivers.session_file.record_scanner import MAGIC
from drivers.whole_file import write_whole
from gse import instant
from gse.sessions.note_files import collect_notes
from gse.sessions.status_document import NAME, SCHEMA, read_status
from gse.station.notes import Notes
from gse.view.live_state import LiveState
from gse.view.verdict_text import headline

EVERY_S = 1.0
_CLOSE_WITHIN_S = 2.0
_RENEWED_WITHIN_S = 10.0


class StatusFile:
    """Keeps status.json as the ``live`` state is; tries again after a disk error.

    While the session runs it puts the notes that are left in its folder into ``notes``.
    """

    def __init__(self, folder: Path, live: LiveState, notes: Notes) -> None:
        self._folder, self._live = folder, live
        self._notes = notes
        self._state = "starting"
        self._outcome: dict[str, Any] = {"verdict": None, "exit_code": None}
        self._changed = threading.Event()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="status file", daemon=True)
        self._thread.start()

    def enter(self, state: str) -> None:
        """Enter the next state: running, closing, reporting."""
        self._state = state
        self._changed.set()

    def close(self, exit_code: int, verdict: str | None = None) -> None:
        """Write the end of the session; further calls do nothing."""
        if not self._closed:
            self._outcome = {"verdict": verdict, "exit_code": exit_code}
            self._state, self._closed = "ended", True
            self._changed.set()
            self._thread.join(_CLOSE_WITHIN_S)

    def _run(self) -> None:
        mark = process_mark(os.getpid())
        last = False
        while not last:
            self._changed.clear()
            last = self._closed
            self._write(mark)
            if self._state == "running":
                collect_notes(self._folder, self._notes)
            if not last:
                self._changed.wait(EVERY_S)

    def _write(self, mark: str | None) -> None:
        with contextlib.suppress(OSError):
            write_whole(self._folder / NAME, [json.dumps(self._document(mark), indent=2) + "\n"])

    def _document(self, mark: str | None) -> dict[str, Any]:
        so_far = self._live.so_far
        answered_ns = so_far.answered_host_utc_ns
        session = self._folder / "session.mcap"
        return {
            "schema": SCHEMA,
            "state": self._state,
            "utc": instant.to_text(read_clock().utc_ns, 1),
            "pid": os.getpid(),
            "process": mark,
            "port": self._live.station.port.url,
            "link": so_far.link_word,
            "frames": so_far.frames,
            "frames_lost": so_far.link.frames_lost,
            "frames_per_s": _number(so_far.frames_per_s),
            "identified": _number(so_far.identified),
            "last_answer_utc": instant.to_text(answered_ns, 1) if answered_ns else None,
            "sky": so_far.sky or None,
            "so_far": headline(so_far),
            "forecast": self._live.forecast or None,
            "page": self._live.page,
            "session_bytes": session.stat().st_size if session.exists() else 0,
            "disk_free_bytes": disk_free_bytes(self._folder),
            **self._outcome,
        }


def is_running(status: dict[str, Any], *, has_marks: bool | None = None) -> bool:
    """Whether the process that wrote a status still runs; another process with its number does not count.

    Where the system does not say when a process started (``has_marks`` is False; the default asks it), a status that is
    renewed counts as running; elsewhere one without such a mark is of another computer.
    """
    if status["state"] == "ended":
        return False
    if status["process"] is None:
        has_marks = process_mark(os.getpid()) is not None if has_marks is None else has_marks
        return not has_marks and _age_s(status) < _RENEWED_WITHIN_S
    return bool(process_mark(status["pid"]) == status["process"])


def _age_s(status: dict[str, Any]) -> float:
    try:
        return (read_clock().utc_ns - instant.from_text(str(status["utc"]))) / instant.NS_PER_S
    except (KeyError, ValueError):
        return math.inf


def process_mark(pid: int) -> str | None:
    """Boot and start time of a process, which a later process with its number does not share.

    None if it has ended, and on systems without /proc.
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return None
    is_zombie = fields[0] == "Z"
    return None if is_zombie else f"{boot}:{fields[19]}"


def session_folders(out: Path) -> list[Path]:
    """Folders of recorded sessions directly below ``out``, or ``out`` itself where it is one; oldest first.

    A folder whose name would steer a terminal is none of ours.
    """
    if _holds_a_session(out):
        return [out]
    try:
        return sorted(folder for folder in out.iterdir() if is_plain(folder.name) and _holds_a_session(folder))
    except OSError:
        return []


def _holds_a_session(folder: Path) -> bool:
    """Whether it does; not where it is closed to this user, which must not hide the folders beside it."""
    try:
        return (folder / "session.mcap").is_file()
    except OSError:
        return False


def is_unfinished(folder: Path) -> bool:
    """Whether a session of ``gse run`` has no report and no running process.

    Simulated sessions and those of ``gse sensor`` are closed and have no status: they need no report.
    """
    status = read_status(folder)
    if status is None and _is_closed(folder / "session.mcap"):
        return False
    if status is not None and is_running(status):
        return False
    return not (folder / "report.json").exists() and not any(folder.glob("report*/report.json"))


def _is_closed(session: Path) -> bool:
    """Whether a session file ends as MCAP files do."""
    try:
        with open(session, "rb", opener=only_a_file) as file:
            file.seek(-len(MAGIC), os.SEEK_END)
            return file.read() == MAGIC
    except OSError:
        return False


def disk_free_bytes(path: Path) -> int:
    """Free bytes of the disk of a path."""
    return shutil.disk_usage(path).free


def _number(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 4)
