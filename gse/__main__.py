"""The program: ``gse``, and ``python -m gse``."""

import atexit
import gc
import os
import signal
import sys

from gse import sign_of_life

_EXIT_INTERRUPTED = 130
"""gse.cli.EXIT_INTERRUPTED, which takes numpy and pydantic to import."""


_NEW_OBJECTS = 50_000
"""Python looks for garbage each time so many objects are new. By default 700, which made a tenth of every start: what
is imported stays."""


def main() -> None:
    """Run the command line; Ctrl-C while its packages are still being imported ends it without a word."""
    gc.set_threshold(_NEW_OBJECTS)
    atexit.register(_leave_garbage)
    _fill_standard_descriptors()
    sign_of_life.start(" ".join(["gse", *sys.argv[1:2]]) + ": working")
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(_EXIT_INTERRUPTED))
    from gse.cli import main as command_line

    signal.signal(signal.SIGINT, before)
    command_line()


def _leave_garbage() -> None:
    """Do without a last search for garbage in all that was imported: a tenth of a second.

    duckdb complains on stderr of each of its objects that is left.
    """
    if "duckdb" not in sys.modules:
        gc.freeze()


def _fill_standard_descriptors() -> None:
    """Open what was closed (``gse run 2>&-``), lest a session file gets its number and is written into as stderr."""
    for fd in range(3):
        try:
            os.fstat(fd)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


if __name__ == "__main__":
    main()
