"""Memory that this process holds and does not need: the system may have it back."""

import ctypes
import mmap
import sys
from pathlib import Path


def give_back() -> None:
    """Give back the compiler's own code, once all is compiled, and what the allocator keeps though it is free.

    Together 80 MB of a long night's 300. The pages of the code are those of a file that is only read: what is needed
    all the same comes back by itself. On other systems than Linux nothing happens.
    """
    if not sys.platform.startswith("linux"):
        return
    libc = ctypes.CDLL(None)
    for mapping in Path("/proc/self/maps").read_text().splitlines():
        span, permissions, *_, name = mapping.split(maxsplit=5)
        if permissions == "r-xp" and name.endswith("libllvmlite.so"):
            first, last = (int(address, 16) for address in span.split("-"))
            libc.madvise(ctypes.c_void_p(first), ctypes.c_size_t(last - first), mmap.MADV_DONTNEED)
    if hasattr(libc, "malloc_trim"):  # glibc's
        libc.malloc_trim(0)
