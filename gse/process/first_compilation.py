"""Compilation by a second process, beside this one, at the first start on a computer.

It leaves machine code in numba's cache on disk, where this one and all later ones find it. If it comes to nothing, each
compiles at its first call, as always. It ends with the one that started it, be it by ``kill -9``: the parent holds the
other end of its standard input and never writes, so the end of the parent is the end of the file.
"""

import os
import subprocess
import sys
import threading
from contextlib import suppress

_LONGEST_S = 300.0
"""A slow computer takes a minute; a process that hangs must not hold a session for ever."""


class FirstCompilation:
    """``python -m module``, None for no process; it ends with the ``with`` block or this process at the latest."""

    def __init__(self, module: str | None) -> None:
        self.process = _started(module) if module else None

    def __enter__(self) -> "FirstCompilation":
        return self

    def finish(self) -> None:
        """Wait until the code is on disk."""
        if self.process is not None:
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(_LONGEST_S)

    def __exit__(self, *_: object) -> None:
        if self.process is not None:
            with self.process:
                self.process.kill()


def _started(module: str) -> "subprocess.Popen[bytes] | None":
    # -P: a folder named gse where the user stands is not this package.
    command = [sys.executable, "-P", "-m", module]
    nowhere = subprocess.DEVNULL
    try:
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=nowhere, stderr=nowhere)
    except OSError:
        return None


def end_with_parent() -> None:
    """In the second process: end it as soon as its standard input ends."""
    threading.Thread(target=_wait_and_end, name="parent", daemon=True).start()


def _wait_and_end() -> None:
    sys.stdin.buffer.read()
    os._exit(1)
