"""Memory that this process holds and does not need: the system may have it back, and pandas is not loaded.

``give_back`` is called once all is compiled or read, where a long session passes from receiving to judging and from
judging to drawing, and after each session of a campaign's worker; ``trim`` after each forecast of a running session.
It takes 0.03 to 0.05 s of CPU.
"""

import ctypes
import functools
import mmap
import re
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from pathlib import Path
from types import ModuleType

_M_MMAP_THRESHOLD = -3
"""As in malloc.h."""
_LARGE_BYTES = 1 << 20
"""An array of this size has pages of its own from then on, which the system has back once it is freed: each array of a
day at 10 Hz has 7 MB. Those of 512 panoramas are smaller."""
_LIBRARY = re.compile(r"^[0-9a-f]+-[0-9a-f]+ r-[-x]p .*\.so[.\d]*$", re.MULTILINE)
_MAPPING = re.compile(r"^([0-9a-f]+)-([0-9a-f]+) r-[-x]p .*\.so[.\d]*\n((?:\w+: .*\n)+)", re.MULTILINE)
_IS_CLEAN = re.compile(r"^Anonymous: +0 kB\n(?:.*\n)*?Swap: +0 kB$", re.MULTILINE)


def give_back() -> None:
    """Give back pages of libraries, once they have done their first work, and what the allocator keeps though free.

    Together 120 MB of a long night's 350: of the compiler, once all is compiled, of Arrow and others, once they are
    loaded. Only pages that are as in their file: what is needed all the same comes back by itself. On other systems
    than Linux nothing happens.
    """
    if not sys.platform.startswith("linux"):
        return
    libc = ctypes.CDLL(None)
    for first, last in _unchanged(tuple(_LIBRARY.findall(Path("/proc/self/maps").read_text()))):
        libc.madvise(ctypes.c_void_p(first), ctypes.c_size_t(last - first), mmap.MADV_DONTNEED)
    if arrow := sys.modules.get("pyarrow"):
        arrow.default_memory_pool().release_unused()
    trim()


@functools.lru_cache(maxsize=1)
def _unchanged(libraries: tuple[str, ...]) -> list[tuple[int, int]]:
    """First and last address of what is mapped of libraries and cannot be written; the loader may have written it.

    The system counts the pages of all mappings for this, which takes 25 ms: anew where other ``libraries`` are mapped.
    """
    mappings = _MAPPING.findall(Path("/proc/self/smaps").read_text())
    return [(int(begin, 16), int(end, 16)) for begin, end, counts in mappings if _IS_CLEAN.search(counts)]


def trim() -> None:
    """Give back what the allocator keeps though free, of all threads; 0.01 to 0.05 s of CPU."""
    if sys.platform.startswith("linux"):
        libc = ctypes.CDLL(None)
        if hasattr(libc, "malloc_trim"):  # glibc's
            # Once an array of 32 MB was freed, all smaller ones come from the heap, whose holes the system never gets.
            libc.mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
            libc.malloc_trim(0)


class _NoPandas(MetaPathFinder):
    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        if fullname == "pandas":
            raise ModuleNotFoundError(fullname)


def spare_pandas() -> None:
    """Let pyarrow find no pandas in its only look for it. A later ``import pandas`` still finds it."""
    import pyarrow as pa

    if "pandas" in sys.modules:
        return
    blind = _NoPandas()
    sys.meta_path.insert(0, blind)
    try:
        pa.array([])
    finally:
        sys.meta_path.remove(blind)
