"""Typed front of numba's compiler."""

import ctypes
import mmap
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numba

_Function = TypeVar("_Function", bound=Callable[..., object])


def compiled(function: _Function) -> _Function:
    """The function as machine code, kept on disk between runs.

    Floats divide by zero as in numpy, without a test for each. Never with fastmath: the same bytes must give the same
    answer on every machine. One function or constant of another module that changes does not renew what was kept of
    its callers: remove ``__pycache__/*.nb?`` then.
    """
    machine_code: _Function = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    return machine_code


def leave_compiler() -> None:
    """Take the compiler's own code out of this process's memory once all is compiled: 50 MB that nobody runs again.

    Its pages are those of a file that is only read: what is needed all the same comes back by itself. On other systems
    than Linux it stays.
    """
    if not sys.platform.startswith("linux"):
        return
    libc = ctypes.CDLL(None)
    for mapping in Path("/proc/self/maps").read_text().splitlines():
        span, permissions, *_, name = mapping.split(maxsplit=5)
        if permissions == "r-xp" and name.endswith("libllvmlite.so"):
            first, last = (int(address, 16) for address in span.split("-"))
            libc.madvise(ctypes.c_void_p(first), ctypes.c_size_t(last - first), mmap.MADV_DONTNEED)
