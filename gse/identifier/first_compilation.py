"""Compilation of the robust identifier by a process of its own, for the first run on a computer.

With that of the attitudes, its code takes as long to compile as all other code of a session: two processes halve the
wait. The second one leaves machine code in numba's cache on disk, where this one and all later ones find it. If it
comes to nothing, each compiles at its first call, as always. It ends with the one that started it, be it by
``kill -9``: the parent holds the other end of its standard input and never writes, so the end of the parent is the end
of the file.
"""

import gc
import os
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np

from gse.identifier.checks import wahba_residual_rad
from gse.identifier.hypotheses import search_many
from gse.identifier.robust_tables import sky_tables
from gse.identifier.search_plan import search_plan
from gse.process.jit import is_on_disk, machine_code_folder
from gse.values.attitude import solve_attitude, solve_attitudes

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


def is_compiled() -> bool:
    """Whether an earlier run on this computer compiled the robust identifier."""
    return is_on_disk(search_many)


def first_compilation() -> FirstCompilation:
    """The other process, if there has to be one: without a folder to keep code in, it would compile for nothing."""
    needed = machine_code_folder() is not None and not is_compiled()
    return FirstCompilation("gse.identifier.first_compilation" if needed else None)


def compile_attitudes() -> None:
    """Compile what follows each identification: the session's own process comes to it last, and finds it on disk."""
    stars = np.eye(3)
    solve_attitude(stars, stars, 1e-4)
    solve_attitudes(stars, stars, np.array([len(stars)]), 1e-4)
    wahba_residual_rad(stars, stars)


def compile_robust() -> None:
    """Compile the search by calling it with few stars, for the types are those of all."""
    rng = np.random.default_rng(0)
    stars = rng.normal(size=(100, 3))
    stars /= np.linalg.norm(stars, axis=1)[:, None]
    magnitude, field = np.linspace(1.0, 6.0, len(stars)), np.array([-0.1, 0.1, -0.1, 0.1, np.inf, 0.04])
    with tempfile.TemporaryDirectory() as folder:
        sky = tuple(sky_tables(stars, magnitude, field, Path(folder)))
    plan = search_plan(1e-3, 300.0, widest_px=np.inf, sigma_px=None)
    known = np.array([1e-4, 6, 2.5e-3, np.nan, 0.5])
    search_many(sky, stars[:3].copy(), magnitude[:3].copy(), np.cumsum([0, 3]), plan, known)


if __name__ == "__main__":
    gc.disable()  # a twentieth of the time; the process ends before its garbage matters
    end_with_parent()
    compile_attitudes()
    compile_robust()
    os._exit(0)  # all is on disk: to take the compiler apart in memory takes 1.5 s, and the session waits for the end
