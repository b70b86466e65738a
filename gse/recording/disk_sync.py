"""Syncing of a session file, beside its writing.

A busy disk takes up to seconds to sync a file. A thread that waits for it does not write, and what comes meanwhile is
in this process alone: lost if it is killed.
"""

import queue
import threading
from collections.abc import Callable


class DiskSync:
    """A thread that syncs when it is asked to, one file at a time.

    ``error`` is that of the last sync, None where the disk took everything.
    """

    def __init__(self) -> None:
        self.error: OSError | None = None
        self._is_busy = False
        self._asked: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="sync", daemon=True).start()

    def ask(self, syncing: Callable[[], Callable[[], None]]) -> None:
        """Call what ``syncing`` gives in the other thread, or nothing while that is busy with the one before."""
        if not self._is_busy:
            sync = syncing()
            self._is_busy = True
            self._asked.put(sync)

    def end(self) -> None:
        """Let the thread end, when the disk has answered."""
        self._asked.put(None)

    def _run(self) -> None:
        while (sync := self._asked.get()) is not None:
            try:
                sync()
                self.error = None
            except OSError as error:
                self.error = error
            self._is_busy = False
