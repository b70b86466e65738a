"""The program: ``gse``, and ``python -m gse``."""

import os
import signal

_EXIT_INTERRUPTED = 130
"""gse.cli.EXIT_INTERRUPTED, which takes numpy and pydantic to import."""


def main() -> None:
    """Run the command line; Ctrl-C while its packages are still being imported ends it without a word."""
    _fill_standard_descriptors()
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(_EXIT_INTERRUPTED))
    from gse.cli import main as command_line

    signal.signal(signal.SIGINT, before)
    command_line()


def _fill_standard_descriptors() -> None:
    """Open what was closed (``gse run 2>&-``), lest a session file gets its number and is written into as stderr."""
    for fd in range(3):
        try:
            os.fstat(fd)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


if __name__ == "__main__":
    main()
