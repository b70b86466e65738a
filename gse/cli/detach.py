"""Detached start: the session runs in a process without a terminal.

Until its port is open, that process writes to the terminal, so that errors at the start are visible; afterwards to
run.log in the session folder. A log of 16 MiB becomes run.1.log, in the place of the one before, and a new one begins:
a week of --json-frames must not take the disk of the session.
"""

import contextlib
import json
import os
import signal
from pathlib import Path

import click

from drivers.host_files import APPEND, READ
from gse.errors import UsageError
from gse.process import sign_of_life

LOG_NAME, OLDER_LOG_NAME = "run.log", "run.1.log"
MOST_LOG_BYTES = 16 << 20
"""Without --json-frames, two weeks."""


class Detachment:
    """The detached process: it has no controlling terminal and gets no hang-up."""

    def __init__(self, report_fd: int) -> None:
        self._report_fd = report_fd
        self._folder: Path | None = None

    def into(self, folder: Path) -> None:
        """Write stdout and stderr to the log of this session, and let the starting process exit."""
        self._folder = folder
        nothing = os.open(os.devnull, READ)
        os.dup2(nothing, 0)
        os.close(nothing)
        _write_to(folder / LOG_NAME)
        os.write(self._report_fd, json.dumps({"folder": str(folder), "pid": os.getpid()}).encode())
        os.close(self._report_fd)

    def keep_small(self) -> None:
        """Begin a new log where this one is long; where that fails, the old one goes on."""
        if self._folder is None or os.fstat(1).st_size < MOST_LOG_BYTES:
            return
        with contextlib.suppress(OSError):
            os.replace(self._folder / LOG_NAME, self._folder / OLDER_LOG_NAME)
            _write_to(self._folder / LOG_NAME)


def _write_to(path: Path) -> None:
    """Have stdout and stderr written to a file."""
    log = os.open(path, APPEND, 0o644)
    for fd in (1, 2):
        os.dup2(log, fd)
    os.close(log)


def detach() -> Detachment:
    """Continue in a detached process. The starting one never returns: it exits with 0 once the session runs.

    To be called before threads are started: a fork copies only the calling thread. Ports are opened with O_NOCTTY, so
    that none of them becomes the terminal of the new process.
    """
    if not hasattr(os, "fork"):
        raise UsageError("--detach needs a POSIX system; leave it out and keep the window of the session open")
    sign_of_life.stop()
    read_fd, write_fd = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read_fd)
        os.setsid()
        return Detachment(write_fd)
    os.close(write_fd)
    try:
        with open(read_fd, "rb") as pipe:
            started = pipe.read()
    except KeyboardInterrupt:
        os.kill(pid, signal.SIGTERM)
        raise
    if not started:
        raise click.exceptions.Exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
    _say_where(json.loads(started))
    raise click.exceptions.Exit(0)


def _say_where(started: dict[str, str]) -> None:
    folder = started["folder"]
    click.echo(f"session: {folder}")
    click.echo(f"process: {started['pid']}")
    click.echo(f"status: gse status {folder}")
    click.echo(f"messages: tail -F {folder}/{LOG_NAME}")
    click.echo(f"end: gse status --stop {folder}")
