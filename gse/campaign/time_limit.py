"""The time that a worker may take for one session: Dask knows no such limit.

Nothing stops a loop from outside, so a thread of the worker ends its whole process. Before that it leaves a mark in the
data set, by which whoever is given the session next in this run knows that it is in vain. A loop that lets no other
thread run ends by Dask's ``worker-ttl``.
"""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from gse.campaign.storage import PARTS, put_whole, with_patience


@contextmanager
def time_limit(limit_s: float, dataset_url: str, name: str) -> Iterator[None]:
    """End this process where the block takes longer, and leave the mark ``name``."""
    watch = threading.Timer(limit_s, _end_process, (dataset_url, name))
    watch.daemon = True
    watch.start()
    try:
        yield
    finally:
        watch.cancel()


def was_too_long(dataset_url: str, name: str) -> bool:
    """Whether a worker ended with this mark."""
    return with_patience(dataset_url, lambda fs, root: bool(fs.exists(f"{root}/{PARTS}/{name}")))


def _end_process(dataset_url: str, name: str) -> None:
    with suppress(Exception):
        with_patience(dataset_url, lambda fs, root: put_whole(fs, root, f"{PARTS}/{name}", b""))
    os._exit(1)
