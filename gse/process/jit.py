"""numba's compiler, with types, and with a place for machine code.

numba's own cache on disk (``cache=True``) keeps machine code beside the source or wherever NUMBA_CACHE_DIR says, and
knows a function by the content of its file. Neither is enough here. What an uninstalled program leaves beside the
source makes Python take that folder for the program; and machine code holds the functions and constants of other
modules. So numba is told a folder for exactly this program while it takes our functions, and has its own setting back
after that: we are guests in a notebook's process.

What it buys, in CPU: a minute of compilation at each start but the first.
"""

import functools
import logging
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numba

from gse.process.installation import cache_folder, code_sha256, own_cache_folder, takes_files

_KEPT_FOLDERS = 4
_ROOM_BYTES = 32 << 20
"""Free on the disk before numba keeps anything: all code takes 11 MB, and numba ends with an error where it finds no
room."""
WITHOUT_A_PLACE = (
    "set XDG_CACHE_HOME, or NUMBA_CACHE_DIR for machine code alone, to a folder that this user can write; "
    "in a container, to a folder on a volume"
)
"""What to do where machine code cannot be kept."""

_LOG = logging.getLogger("gse")
_Function = TypeVar("_Function", bound=Callable[..., object])


@functools.cache
def compiled_folder() -> Path | None:
    """Where machine code, and else what is compiled, of exactly this program is kept, below the user's cache directory.

    None where no such folder can be written, or where it is another user's: who writes there has his code run here.
    """
    place = "machine-code", code_sha256()[:32]
    is_new = not cache_folder(*place).exists()
    folder = own_cache_folder(*place)
    if folder is None or not _has_room(folder):
        return None
    if is_new:
        _remove_oldest(folder.parent)
    return folder


@functools.cache
def machine_code_folder() -> Path | None:
    """Where numba keeps machine code: where its user asks for it, or in ``compiled_folder``; None where nowhere.

    In that case the log gets one line, which the command line shows on stderr.
    """
    asked = numba.config.CACHE_DIR
    folder = Path(asked) if asked and takes_files(Path(asked)) and _has_room(Path(asked)) else compiled_folder()
    if folder is None:
        _LOG.warning("%s: each start compiles anew, 10 to 60 s; %s", why_without_a_place(), WITHOUT_A_PLACE)
    return folder


def why_without_a_place() -> str:
    """What is wrong with the folders in which machine code would be kept."""
    tried = " and ".join(
        str(folder) for folder in (numba.config.CACHE_DIR, cache_folder("machine-code")) if str(folder)
    )
    return f"machine code cannot be kept in {tried} (not writable, of another user, or less than 32 MiB free)"


def _has_room(folder: Path) -> bool:
    return shutil.disk_usage(folder).free > _ROOM_BYTES


def _remove_oldest(parent: Path) -> None:
    """Leave the newest folders: a program that is changed and run again makes one each time."""
    folders = sorted(parent.iterdir(), key=lambda folder: folder.stat().st_mtime_ns)
    for folder in folders[:-_KEPT_FOLDERS]:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _numba_keeps_here() -> Iterator[bool]:
    """numba with our folder in the place of its own; whether there is one."""
    folder, own = machine_code_folder(), numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(folder or "")
    try:
        yield folder is not None
    finally:
        numba.config.CACHE_DIR = own


def compiled(function: _Function) -> _Function:
    """The function as machine code, kept on disk between runs where a folder can be written.

    Floats divide by zero as in numpy, without a test for each. Never with fastmath: the same bytes must give the same
    answer on every machine.
    """
    with _numba_keeps_here() as keeps:
        typed: _Function = numba.njit(cache=keeps, nogil=True, error_model="numpy", no_cfunc_wrapper=True)(function)
    return typed


class _Part:
    """A compiled function without a way in from Python: machine code calls it as such, Python as it is written.

    ``_numba_type_`` is what numba asks each object for that compiled code names.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        functools.update_wrapper(self, function)
        self._function = function
        self._machine_code: Any = numba.njit(
            nogil=True, error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True
        )(function)

    def __call__(self, *args: object) -> object:
        return self._function(*args)

    @property
    def _numba_type_(self) -> Any:
        return self._machine_code._numba_type_


def compiled_part(function: _Function) -> _Function:
    """A function that only ``compiled`` functions call, as machine code within theirs.

    The way in from Python, which numba makes of each function, is a sixth of what there is to compile.
    """
    part: Any = function if numba.config.DISABLE_JIT else _Part(function)
    typed: _Function = part
    return typed


def is_on_disk(function: Any) -> bool:
    """Whether the machine code of a compiled function is on disk: then it loads at once.

    True where numba's compiler is switched off.
    """
    if not hasattr(function, "stats"):
        return True
    if function.stats.cache_path is None:
        return False
    name = f"{Path(function.py_func.__code__.co_filename).stem}.{function.py_func.__qualname__}"
    return any(Path(function.stats.cache_path).glob(f"{name}-*.nbi"))
