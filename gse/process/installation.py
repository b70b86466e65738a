"""The installed program: hashes of its own files, and its folder below the user's cache directory."""

import functools
import hashlib
import importlib.metadata
import os
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from platformdirs import user_cache_dir

_GSE = Path(__file__).parents[1]
_PACKAGES = tuple(_GSE.with_name(name) for name in ("drivers", "gse", "protocols"))
_LEFT_OUT = "__pycache__"


@functools.lru_cache(maxsize=1)
def source_sha256() -> str:
    """SHA-256 over names and contents of all files of the program's packages, in the order of their names."""
    return _sha256(_PACKAGES, "")


@functools.lru_cache(maxsize=1)
def code_sha256() -> str:
    """SHA-256 over names and contents of the Python files of ``gse``, in the order of their names."""
    return _sha256([_GSE], ".py")


@functools.cache
def package_version(name: str) -> str:
    """Of an installed package; PackageNotFoundError where there is none. A millisecond the first time."""
    return importlib.metadata.version(name)


def _sha256(packages: Iterable[Path], ending: str) -> str:
    whole = hashlib.sha256()
    for package in packages:
        for name in sorted(_files(package, ending)):
            with open(package.parent / name, "rb") as file:
                content = file.read()
            whole.update(f"{name}\0{len(content)}\0".encode())
            whole.update(content)
    return whole.hexdigest()


def _files(package: Path, ending: str) -> Iterator[str]:
    """Their names from the package on, with slashes."""
    # os.walk: Path.rglob takes several times as long, and every start of the program waits for it.
    for folder, folders, names in os.walk(package):
        folders[:] = [name for name in folders if name != _LEFT_OUT]
        room = Path(folder).relative_to(package.parent).as_posix()
        yield from (f"{room}/{name}" for name in names if name.endswith(ending))


def cache_folder(*names: str) -> Path:
    """Where a folder of this program is, or would be, for what can be made again but takes time."""
    return Path(user_cache_dir("gse"), *names)


def own_cache_folder(*names: str) -> Path | None:
    """The folder, made where it is not there; None where it cannot be written, or is another user's.

    What lies there is believed, and machine code runs: so nobody else may write there.
    """
    folder = cache_folder(*names)
    return folder if takes_files(folder) and _is_ours(folder) else None


def takes_files(folder: Path) -> bool:
    """Whether a file can be made in a folder, which is made where it is not there."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_ours(folder: Path) -> bool:
    """Whether this user owns it; Windows has a cache directory for each user, which others cannot write."""
    return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()
