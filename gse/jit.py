"""Typed front of numba's compiler."""

from collections.abc import Callable
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
