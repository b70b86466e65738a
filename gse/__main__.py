"""The program: ``gse``, and ``python -m gse``."""

import atexit
import gc
import os
import signal
import sys
import warnings
from typing import Any

_EXIT_USAGE, _EXIT_INTERRUPTED = 2, 130
"""Exit codes of gse.cli; importing them from there would take numpy and pydantic."""

_OLDEST_PYTHON = (3, 11)

_TURN_S = 1e-4
"""Longest that a thread works in Python while another one waits: by default 5 ms, which is more than a panorama takes,
so that its answer went out only after all that follows on it."""


def main() -> None:
    """Run the command line; Ctrl-C before it begins and after it has ended ends the program without a word."""
    if sys.version_info < _OLDEST_PYTHON:  # before anything of ours is imported that such a Python cannot read
        sys.stderr.write(f"gse: Python 3.11 or newer is needed; this is {sys.version.split()[0]}\n")
        sys.exit(_EXIT_USAGE)
    from gse.process import interrupts, terminal

    gc.set_threshold(300_000)  # new objects between searches for garbage; with 700, a replay takes 6 to 20 % longer
    sys.setswitchinterval(_TURN_S)
    _share_one_allocator()
    _leave_warnings_to_developers()
    atexit.register(_leave_garbage)
    terminal.start(" ".join(["gse", *sys.argv[1:2]]) + ": working")
    before = _let_ctrl_c_end_at_once()
    try:
        from gse.cli import main as command_line
    except Exception as error:
        sys.exit(_said_of_package(error))

    signal.signal(signal.SIGINT, before)
    interrupts.start()
    try:
        command_line()
    finally:
        _let_ctrl_c_end_at_once()
        terminal.end_sign()


def _let_ctrl_c_end_at_once() -> Any:
    """While packages are imported, and while Python ends, Ctrl-C would show a traceback; what it did before."""
    before = signal.getsignal(signal.SIGINT)
    if callable(before):  # not where it is ignored
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(_EXIT_INTERRUPTED))
    return before


def _share_one_allocator() -> None:
    """Let Arrow take memory as all else does: its own allocator keeps what was used once."""
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")


def _leave_warnings_to_developers() -> None:
    """Show none of a package to a user, who can do nothing about it; ``python -W`` and PYTHONWARNINGS do."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")


def _said_of_package(error: Exception) -> int:
    """Say which package of others is missing or broken; returns the exit code. Raises an error that is our own."""
    from gse.process.broken_package import broken_package

    text = broken_package(error)
    if text is None:
        raise error
    sys.stderr.write(f"gse: {text}\n")
    return _EXIT_USAGE


def _leave_garbage() -> None:
    """Do without a last search for garbage in all that was imported: 0.03 to 0.5 s of CPU.

    duckdb complains on stderr of each of its objects that is left.
    """
    if "duckdb" not in sys.modules:
        gc.freeze()


if __name__ == "__main__":
    main()
