"""Files of the host: which are opened, on POSIX systems and Windows, and new ones that stand whole or not at all."""

import errno
import os
import stat
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

_QUIETLY = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
"""Not passed on to child processes; no translation of line ends."""

READ = os.O_RDONLY | _QUIETLY
CREATE = os.O_RDWR | os.O_CREAT | os.O_EXCL | _QUIETLY
APPEND = os.O_WRONLY | os.O_CREAT | os.O_APPEND | _QUIETLY


_OF_A_SHELL = ("/dev/fd/", "/proc/self/fd/", "/dev/stdin")


def only_a_file(path: str, flags: int) -> int:
    """The ``opener`` of a file that a user names: OSError for a pipe or a device, where a read could wait for ever."""
    mode = os.stat(path).st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # a folder is refused by ``open``, in its own words
        raise OSError(errno.EINVAL, "it is a pipe or a device; expected a file", path)
    return os.open(path, flags | _QUIETLY, 0o666)


def a_file_or_a_shells_pipe(path: str, flags: int) -> int:
    """The same, but for a pipe that a shell hands over, ``<(COMMAND)`` or /dev/stdin: it ends where COMMAND ends.

    It can be read once, so it is for a text that is read as a whole.
    """
    if path.startswith(_OF_A_SHELL) and stat.S_ISFIFO(os.stat(path).st_mode):
        return os.open(path, flags | _QUIETLY)
    return only_a_file(path, flags)


def read_at(fd: int, size: int, offset: int) -> bytes:
    """At most ``size`` bytes from an offset; the place where the descriptor writes next does not change."""
    if hasattr(os, "pread"):
        return os.pread(fd, size, offset)
    place = os.lseek(fd, 0, os.SEEK_CUR)
    try:
        os.lseek(fd, offset, os.SEEK_SET)
        return os.read(fd, size)
    finally:
        os.lseek(fd, place, os.SEEK_SET)


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk; Windows does that by itself, and opens no folder."""
    if os.name == "nt":
        return
    fd = os.open(folder, READ)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


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
