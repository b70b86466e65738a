"""Runs ``gse`` as on a system without POSIX: what only such systems have is refused to our own packages.

    python tests/devices/without_posix.py < lines

Each line is a JSON list of arguments, in which patterns of files are resolved; each answer a line with the exit code.
Python's own modules and other packages keep what they need: only imports and attributes asked for by gse, drivers and
protocols are refused.
"""

import builtins
import glob
import json
import sys
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

OURS = ("gse", "drivers", "protocols")
REFUSED = {"termios", "fcntl", "pty", "tty", "resource", "pwd", "grp"}
MISSING = {
    "os": {
        "O_CLOEXEC",
        "pread",
        "fork",
        "setsid",
        "statvfs",
        "posix_fadvise",
        "geteuid",
        "getuid",
        "openpty",
        "ttyname",
    },
    "signal": {"SIGHUP", "SIGQUIT", "SIGTTOU", "SIGTSTP", "SIGPIPE", "SIGALRM", "SIGKILL", "pthread_sigmask"},
}


def _no_library(name: object, *_: object, **__: object) -> None:
    raise TypeError(f"no library is called {name}")


CHANGED: dict[str, dict[str, object]] = {
    "os": {"name": "nt"},
    "sys": {"platform": "win32"},
    "ctypes": {"CDLL": _no_library},
}


class Lesser(ModuleType):
    """A module of Python as another system has it; what is set in it is set in Python's own."""

    def __init__(self, whole: ModuleType) -> None:
        super().__init__(whole.__name__)
        vars(self).update(_whole=whole, **CHANGED.get(whole.__name__, {}))

    def __getattr__(self, name: str) -> Any:
        if name in MISSING.get(self.__name__, ()):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(vars(self)["_whole"], name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(vars(self)["_whole"], name, value)


def _importing(name: str, asking: Mapping[str, Any] | None = None, *rest: Any, **named: Any) -> ModuleType:
    asked_by = str((asking or {}).get("__name__", "")).partition(".")[0]
    if asked_by in OURS and name in REFUSED:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    module = _import(name, asking, *rest, **named)
    lesser = asked_by in OURS and name in {*MISSING, *CHANGED}
    return LESSER.setdefault(name, Lesser(module)) if lesser else module


_import = builtins.__import__
LESSER: dict[str, ModuleType] = {}


def exit_code(arguments: Sequence[str]) -> int:
    """Of one command."""
    from gse.cli import main

    try:
        main([found for word in arguments for found in (glob.glob(word) or [word])])
    except SystemExit as done:
        return int(done.code or 0)
    return 0


if __name__ == "__main__":
    builtins.__import__ = _importing
    for line in sys.stdin:
        print(json.dumps({"exit_code": exit_code(json.loads(line))}), flush=True)
