"""Files that stand whole or not at all, whatever the disk does."""

import os
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """A new file, removed again where writing it fails; FileExistsError where there is one."""
    file = path.open("xb")
    try:
        with file:
            yield file
    except BaseException:
        path.unlink(missing_ok=True)
        raise


@contextmanager
def whole_files() -> Iterator[Callable[[Path, Iterable[str]], None]]:
    """A function that writes text files; none takes its place, or that of an older one, before all are written.

    They take their places in the order in which they were begun. Where the disk refuses one (OSError), all older files
    stay and no new one is left.
    """
    unfinished: list[tuple[Path, Path]] = []

    def write(path: Path, parts: Iterable[str]) -> None:
        beside = _beside(path)
        beside.unlink(missing_ok=True)
        with beside.open("x", encoding="utf-8", newline="\n") as file:
            unfinished.append((beside, path))
            file.writelines(parts)

    try:
        yield write
        for beside, path in unfinished:
            beside.replace(path)
    except BaseException:
        for beside, _ in unfinished:
            beside.unlink(missing_ok=True)
        raise


def write_whole(path: Path, parts: Iterable[str]) -> None:
    """Write a text file in the place of an older one, which stays where the disk refuses the new one (OSError)."""
    with whole_files() as write:
        write(path, parts)


def _beside(path: Path) -> Path:
    """The unfinished file of a path: short, of this process alone. A link that was planted there is never followed."""
    return path.with_name(f".{os.getpid()}-{zlib.crc32(os.fsencode(path.name)):08x}.part")
