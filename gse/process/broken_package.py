"""A package of others that is missing, too old or broken: which, what is installed, what to do.

Asked where something has failed already, so that no start takes longer. Of others it imports ``packaging`` alone, and
does without where that is the broken one.
"""

import importlib.util
import shlex
import sys
import traceback
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.outside_text import plain_line

if TYPE_CHECKING:
    from packaging.requirements import Requirement

_PROGRAM = "gse-star-sensor"
_OURS = ("__main__", "drivers", "gse", "protocols")
_MOST_LENGTH = 200
"""Most characters that are shown of an error's own words; some packages write a page."""


def broken_package(error: BaseException) -> str | None:
    """Two lines for a person on the package that explains an error; None where none does.

    A package that pyproject.toml asks for and that is missing or of another version explains every error; a package
    that is as it must be, an error while it is imported.
    """
    module = _failed_import(error)
    names = list(dict.fromkeys(metadata.packages_distributions().get(module or "", ())))
    words = plain_line(f"{type(error).__name__}: {error}")[:_MOST_LENGTH]
    if unmet := [(name, asked) for name in (_PROGRAM, *names) for asked in _requirements(name) if not _is_met(asked)]:
        wanted = dict.fromkeys(f"{asked.name}{asked.specifier}" for _, asked in unmet)
        return f"{_said(unmet)} ({words})\n{_install(wanted)}"
    if module is None:
        return None
    place = _place(module)
    if place is None:
        return f"the package {module} is not installed\n{_install(names or [module])}"
    if names and not place.is_relative_to(str(metadata.distribution(names[0]).locate_file(""))):
        return f"{place} hides the package {module} ({words})\nRename it, or take its folder out of PYTHONPATH."
    installed = f"{module} {metadata.version(names[0])}" if names else module
    again = _install(["--force-reinstall", *(names or [module])])
    return f"{installed} in {place.parent} cannot be imported ({words})\n{again}"


def _failed_import(error: BaseException) -> str | None:
    """The package of others, by its name in an import, while which was imported an error was raised."""
    named = (error.name or "").partition(".")[0] if isinstance(error, ImportError) else ""
    if isinstance(error, ModuleNotFoundError) and _is_of_others(named) and _place(named) is None:
        return named
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__) if frame.f_code.co_name == "<module>"]
    imported = [str(frame.f_globals.get("__name__")).partition(".")[0] for frame in frames]
    return next((name for name in [*reversed(imported), named] if _is_of_others(name)), None)


def _is_of_others(module: str) -> bool:
    return bool(module) and module not in _OURS and module not in sys.stdlib_module_names


def _place(module: str) -> Path | None:
    """The file that Python would import; None where it finds none."""
    spec = importlib.util.find_spec(module)
    return None if spec is None else Path(spec.origin or ".")


def _requirements(name: str) -> "list[Requirement]":
    """What an installed package needs here; nothing of a program that runs from its source tree."""
    try:
        from packaging.requirements import Requirement

        asked = [Requirement(text) for text in metadata.requires(name) or []]
    except (ImportError, metadata.PackageNotFoundError):
        return []
    return [of for of in asked if of.marker is None or of.marker.evaluate({"extra": ""})]


def _is_met(asked: "Requirement") -> bool:
    there = _version(asked.name)
    return there is not None and asked.specifier.contains(there, prereleases=True)


def _said(unmet: "Iterable[tuple[str, Requirement]]") -> str:
    missing, others = [], []
    for by, asked in unmet:
        if there := _version(asked.name):
            others.append(f"{asked.name} {there} is installed, and {by} needs {asked.name}{asked.specifier}")
        else:
            missing.append(asked.name)
    return "; ".join([*([f"not installed: {', '.join(missing)}"] if missing else []), *others])


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _install(what: Iterable[str]) -> str:
    return f"Install it with: {shlex.join([sys.executable, '-m', 'pip', 'install', *what])}"
