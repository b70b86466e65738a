"""The installed program: a hash of its own files."""

import functools
import hashlib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

_PACKAGES = ("drivers", "gse", "protocols")
_LEFT_OUT = "__pycache__"


@functools.lru_cache(maxsize=1)
def source_sha256() -> str:
    """SHA-256 over names and contents of all files of the program's packages, in the order of their names."""
    whole = hashlib.sha256()
    for package in _PACKAGES:
        root = Path(str(resources.files(package)))
        for path in sorted(_files(root)):
            content = path.read_bytes()
            whole.update(f"{package}/{path.relative_to(root).as_posix()}\0{len(content)}\0".encode())
            whole.update(content)
    return whole.hexdigest()


def _files(root: Path) -> Iterator[Path]:
    return (path for path in root.rglob("*") if path.is_file() and _LEFT_OUT not in path.parts)
