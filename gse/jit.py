"""Typed front of numba's compiler."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache
from numba.core.runtime import rtsys

_Function = TypeVar("_Function", bound=Callable[..., object])


class _CodeOnDisk(FunctionCache):  # type: ignore[misc]
    """numba's cache on disk, read without its compiler: machine code needs the runtime only.

    numba fills the tables of its compiler (0.2 s) before it reads; it does so again when it has to compile. The key of
    each piece of code holds the processor and its features, so code of another processor is never run.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature, None where it is not on disk.

        What an older version kept may name types that are no more: it is removed.
        """
        rtsys.initialize(target_context)
        try:
            return self._load_overload(sig, target_context)
        except AttributeError:
            self.flush()
            return None


def compiled(function: _Function) -> _Function:
    """The function as machine code, kept on disk between runs.

    Floats divide by zero as in numpy, without a test for each. Never with fastmath: the same bytes must give the same
    answer on every machine. One function or constant of another module that changes does not renew what was kept of
    its callers: remove ``__pycache__/*.nb?`` then.
    """
    machine_code: Any = numba.njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True)(function)
    if hasattr(machine_code, "_cache"):  # not where NUMBA_DISABLE_JIT is set
        machine_code._cache = _CodeOnDisk(function)
    typed: _Function = machine_code
    return typed


def is_on_disk(function: Any) -> bool:
    """Whether the machine code of a compiled function is on disk and newer than its source: then it loads at once.

    True where numba's compiler is switched off.
    """
    if not hasattr(function, "stats"):
        return True
    source = Path(function.py_func.__code__.co_filename)
    indexes = Path(function.stats.cache_path).glob(f"{source.stem}.{function.py_func.__qualname__}-*.nbi")
    return any(index.stat().st_mtime_ns >= source.stat().st_mtime_ns for index in indexes)
