"""End of a helping process with the one that started it, be it by ``kill -9``.

The parent holds the other end of standard input and never writes: its end is the end of the file.
"""

import os
import sys
import threading


def end_with_parent() -> None:
    """End this process as soon as its standard input ends."""
    threading.Thread(target=_wait_and_end, name="parent", daemon=True).start()


def _wait_and_end() -> None:
    sys.stdin.buffer.read()
    os._exit(1)
