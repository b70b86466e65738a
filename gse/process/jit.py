"""Typed front of numba's compiler."""

import functools
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.runtime import rtsys
from platformdirs import user_cache_dir

from gse.process.installation import code_sha256

_PACKAGE = Path(__file__).parents[1]
_KEPT_FOLDERS = 4
_Function = TypeVar("_Function", bound=Callable[..., object])


@functools.cache
def compiled_folder() -> Path | None:
    """Where machine code, and else what is compiled, of exactly this program is kept, below the user's cache directory.

    Not beside the source, as numba has it: what an uninstalled program leaves there makes Python take that folder for
    the program. Not by the source of each function alone either: machine code holds the functions and constants of
    other modules. None where no such folder can be written, or where it is another user's.
    """
    folder = Path(user_cache_dir("gse")) / "machine-code" / code_sha256()[:32]
    try:
        is_new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return None
    if hasattr(os, "getuid") and folder.stat().st_uid != os.getuid():
        return None
    if is_new:
        _remove_oldest(folder.parent)
    return folder


def _remove_oldest(parent: Path) -> None:
    """Leave the newest folders: a program that is changed and run again makes one each time."""
    folders = sorted(parent.iterdir(), key=lambda folder: folder.stat().st_mtime_ns)
    for folder in folders[:-_KEPT_FOLDERS]:
        shutil.rmtree(folder, ignore_errors=True)


class _Place(_CacheLocator):  # type: ignore[misc]
    """Where the machine code of one function of this program is: in the folder of its room."""

    def __init__(self, function: Any, source: Path, folder: Path) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._py_file = str(source)
        self._path = folder / "-".join(source.parent.relative_to(_PACKAGE.parent).parts)

    def ensure_cache_path(self) -> None:
        self._path.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return str(self._path)

    def get_source_stamp(self) -> str:
        return code_sha256()

    def get_disambiguator(self) -> str:
        return str(self._lineno)

    @classmethod
    def from_function(cls, function: Any, source: str) -> "_Place | None":
        folder = compiled_folder()
        is_ours = Path(source).is_relative_to(_PACKAGE)
        return cls(function, Path(source), folder) if is_ours and folder is not None else None


class _MachineCode(CompileResultCacheImpl):  # type: ignore[misc]
    """In the folder that NUMBA_CACHE_DIR names, as numba has it, or in this program's own."""

    _locator_classes = (CompileResultCacheImpl._locator_classes[0], _Place)


class _CodeOnDisk(FunctionCache):  # type: ignore[misc]
    """numba's cache on disk, read without its compiler: machine code needs the runtime only.

    numba fills the tables of its compiler (0.2 s) before it reads; it does so again when it has to compile. The key of
    each piece of code holds the processor and its features, so code of another processor is never run.
    """

    _impl_class = _MachineCode

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

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code; a disk that is full is not an error."""
        with suppress(OSError):
            self._save_overload(sig, data)


def compiled(function: _Function) -> _Function:
    """The function as machine code, kept on disk between runs where a folder can be written.

    Floats divide by zero as in numpy, without a test for each. Never with fastmath: the same bytes must give the same
    answer on every machine.
    """
    machine_code: Any = numba.njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True)(function)
    if hasattr(machine_code, "_cache"):  # not where NUMBA_DISABLE_JIT is set
        with suppress(RuntimeError):  # numba's word for a function without a place
            machine_code._cache = _CodeOnDisk(function)
    typed: _Function = machine_code
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
