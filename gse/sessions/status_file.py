"""Status file of a live session, renewed each second, for other terminals.

status.json in the session folder, schema gse.status/1. A separate thread writes the complete file each time, so that a
slow disk does not delay the session. The start time of its process tells it apart from a later process with the same
number.
"""

import contextlib
import itertools
import json
import math
import os
import shutil
import threading
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from drivers.clock import read_clock
from drivers.host_files import READ, only_a_file, write_whole
from drivers.outside_text import is_plain, plain_line
from drivers.session_file.record_scanner import MAGIC
from gse.errors import UsageError
from gse.station.events import MOST_CHARACTERS, MOST_WAITING, OF_SENSOR, Notes, note_text
from gse.values import instant
from gse.view.live_state import LiveState
from gse.view.verdict_text import headline

# Notes on their way to a running session, as files in its folder.
#
# ``gse note`` leaves a file, and the thread of the status file takes it away within a second: no server is needed.
# Anybody who may write into the folder may leave a note.

_READ = READ | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
"""No pipe is waited for, and no link takes another file of this host into the session."""


def leave_note(folder: Path, text: str, number: int) -> Path:
    """Leave a note for the session that records into ``folder``; the file goes when it is taken.

    ``number`` tells notes apart. UsageError where it cannot be written.
    """
    return _leave(folder, "note", text, number)


def leave_command(folder: Path, data: bytes, number: int) -> Path:
    """Leave a command to the sensor in the same way."""
    return _leave(folder, "command", data.hex(), number)


def _leave(folder: Path, kind: str, text: str, number: int) -> Path:
    path = folder / f"{kind}-{number:020d}.txt"
    try:
        write_whole(path, [text + "\n"])
    except OSError as error:
        raise UsageError(f"cannot leave a {kind} in {folder}: {error.strerror}") from error
    return path


def collect_notes(folder: Path, notes: Notes) -> None:
    """Take the notes and the commands that were left in a folder, oldest first; what is none is thrown away."""
    for kind, read in (("note", note_text), ("command", _command_text)):
        left = (path for path in sorted(folder.glob(f"{kind}-*.txt")) if not path.is_dir())
        for path in itertools.islice(left, MOST_WAITING):
            with contextlib.suppress(OSError, ValueError):
                text = _content(path)
                path.unlink()
                notes.put(read(text))


def _command_text(text: str) -> str:
    return OF_SENSOR + bytes.fromhex(text).hex()


def _content(path: Path) -> str:
    """The beginning of a file; empty where it is none."""
    try:
        with os.fdopen(os.open(path, _READ), "rb") as file:
            return file.read(4 * MOST_CHARACTERS + 1).decode(errors="replace")
    except OSError:
        return ""


# The document of status.json as others read it: checked, since a session folder may come from anybody.

SCHEMA = "gse.status/1"
NAME = "status.json"
OF_A_COMMAND = "-command"
"""End of the name of a folder that holds what ``gse sensor`` sent and received: a session without panoramas."""
_MOST_BYTES = 64 << 10
_LARGEST = 1 << 62


def _instant(text: str) -> str:
    return instant.to_text(instant.from_text(text), 1)


_Line = Annotated[str, AfterValidator(plain_line)]
_Instant = Annotated[str, AfterValidator(_instant)]
_Count = Annotated[int, Field(ge=0, le=_LARGEST)]
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Process = Annotated[int, Field(gt=1, lt=1 << 31)]
"""A signal to 1 or less goes to init, or to many processes at once."""


class _Status(BaseModel):
    """The keys that are read; others are left out. Earlier versions of gse wrote fewer."""

    model_config = ConfigDict(strict=True)

    schema_name: Literal["gse.status/1"] = Field(alias="schema")
    state: Literal["starting", "running", "closing", "reporting", "ended"]
    utc: _Instant = instant.to_text(0, 1)
    pid: _Process
    process: _Line | None
    port: _Line = ""
    link: _Line = ""
    frames: _Count = 0
    frames_lost: _Count = 0
    frames_per_s: _Number | None = None
    identified: _Number | None = None
    last_answer_utc: _Instant | None = None
    sky: _Line | None = None
    so_far: _Line = ""
    forecast: _Line | None = None
    page: _Line | None = None
    session_bytes: _Count = 0
    disk_free_bytes: _Count = 0
    verdict: _Line | None = None
    exit_code: int | None = None


def read_status(folder: Path) -> dict[str, Any] | None:
    """The status of a session folder; None where it is missing, unreadable, or not of gse."""
    path = folder / NAME
    if not path.is_file():  # nobody writes into a pipe in its place
        return None
    try:
        with path.open("rb") as file:
            document = json.loads(file.read(_MOST_BYTES))
        return _Status.model_validate(document).model_dump(by_alias=True)
    except (OSError, ValueError, RecursionError, ValidationError):
        return None


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
            self._write(mark, last=last)
            if self._state == "running":
                collect_notes(self._folder, self._notes)
            if not last:
                self._changed.wait(EVERY_S)

    def _write(self, mark: str | None, *, last: bool) -> None:
        path, text = self._folder / NAME, json.dumps(self._document(mark), indent=2) + "\n"
        try:
            write_whole(path, [text])
        except OSError:
            if last:  # a full disk: the end needs no room in the place of what stands there
                _write_over(path, text.encode())

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


def _write_over(path: Path, data: bytes) -> None:
    with contextlib.suppress(OSError):
        fd = os.open(path, os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0))
        with os.fdopen(fd, "wb") as file:
            file.write(data)
            file.truncate()


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


def is_being_recorded(path: Path) -> bool:
    """Whether a process records the session at a path, a file or its folder."""
    status = read_status(path if path.is_dir() else path.parent)
    return status is not None and is_running(status)


def may_be_ended(folder: Path, status: dict[str, Any]) -> bool:
    """Whether a process is a ``gse run`` of this user that records into a folder of this user.

    A status.json may come from anybody, and name any process. So the process has to have the session file open, where
    the system tells (/proc).
    """
    own = os.getuid()
    if any(os.lstat(path).st_uid != own for path in (folder, folder / NAME)):
        return False
    if process_mark(os.getpid()) is None:
        return True
    try:
        session = os.stat(folder / "session.mcap")
        process = Path(f"/proc/{status['pid']}")
        is_own = process.stat().st_uid == own
        return is_own and any(_is_same(file, session) for file in (process / "fd").iterdir())
    except OSError:
        return False


def _is_same(file: Path, other: os.stat_result) -> bool:
    try:
        return os.path.samestat(file.stat(), other)
    except OSError:
        return False


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
