"""The packages ``drivers`` and ``protocols`` that belong to this gse, and no others of these names.

They lie at the top level, beside ``gse``, under names that others use too. In a folder with a ``drivers/`` of its own
Python finds that one first, and pip lets another distribution write its ``drivers/__init__.py`` over ours. Where the
process is the program ``gse``, ours are loaded from their place, whatever lies in the folder of its user. In the
process of somebody else, who may need his own, gse is not imported: the error names the intruder.

This module is imported before all others, so it imports little.
"""

from __future__ import annotations  # an older Python comes here before gse.__main__ says that it is too old

import importlib.util
import os
import sys
from importlib.machinery import ModuleSpec

NAMES = ("drivers", "protocols")
_MARK = b"gse-star-sensor"
"""The name of our distribution, in the docstring of each of our packages."""

_HERE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def claim() -> None:
    """Make sure that ours are imported; ImportError where another one is, or would be, and this is not our program."""
    for name in NAMES:
        own = os.path.join(_HERE, name, "__init__.py")
        try:
            if not _is_ours(own):
                raise ImportError(_replaced(name, own))
            found = _found(name)
            if found and os.path.samefile(found, own):
                continue
            if not _is_our_program():
                raise ImportError(_shadowed(name, own, found))
            _load(name, own)
        except ImportError as error:
            if not _is_our_program():
                raise
            print(f"gse: {error}", file=sys.stderr)
            raise SystemExit(2) from None


def _is_ours(path: str) -> bool:
    try:
        with open(path, "rb") as file:
            return _MARK in file.read(4096)
    except FileNotFoundError:
        return False


def _found(name: str) -> str | None:
    """The file of the package that an import gives; None of a folder without ``__init__.py``, and where none is."""
    loaded = sys.modules.get(name)
    spec = getattr(loaded, "__spec__", None) if loaded else importlib.util.find_spec(name)
    origin = spec.origin if isinstance(spec, ModuleSpec) else getattr(loaded, "__file__", None)
    return origin if origin and os.path.exists(origin) else None


def _is_our_program() -> bool:
    """Whether Python runs ``gse``, or ``-m gse`` with or without a module; ``sys.argv[0]`` is ``-m`` while it looks."""
    program, *rest = sys.argv or [""]
    if program == "-m":
        return sys.orig_argv[-1 - len(rest)].removeprefix("-m").partition(".")[0] == "gse"
    return os.path.basename(program) in ("gse", "gse.exe")


def _load(name: str, own: str) -> None:
    """Import our package from its place."""
    spec = importlib.util.spec_from_file_location(name, own)
    assert spec is not None
    assert spec.loader is not None
    sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])


def _shadowed(name: str, own: str, found: str | None) -> str:
    return (
        f"gse needs its own package '{name}' ({own}), but here Python finds {found or 'none'}. "
        f"Start Python in another folder or as 'python -P', or rename that '{name}'."
    )


def _replaced(name: str, own: str) -> str:
    from importlib.metadata import packages_distributions

    owners = sorted(set(packages_distributions().get(name, [])) - {_MARK.decode()})
    other = f" by {', '.join(owners)}" if owners else ""
    return (
        f"{own} is not that of gse: it is missing, or was replaced{other}. "
        "Install gse into an environment of its own: python3 -m venv gse-env"
    )
