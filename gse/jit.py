"""Typed front of numba's compiler."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

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


def is_on_disk(function: Any) -> bool:
    """Whether the machine code of a compiled function is on disk and newer than its source: then it loads at once.

    True where numba's compiler is switched off.
    """
    if not hasattr(function, "stats"):
        return True
    source = Path(function.py_func.__code__.co_filename)
    indexes = Path(function.stats.cache_path).glob(f"{source.stem}.{function.py_func.__qualname__}-*.nbi")
    return any(index.stat().st_mtime_ns >= source.stat().st_mtime_ns for index in indexes)
