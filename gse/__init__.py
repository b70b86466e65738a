"""The ground test station for a star sensor: panoramas in, RA and DE against sidereal truth out.

Each package is a room, named after its part in the way of a panorama. ARCHITECTURE.md is the plan. For notebooks:
``gse.load``, ``gse.judge``, ``gse.identify`` and ``gse.session`` (gse.api), imported when they are first used.
"""

from __future__ import annotations  # for the Pythons that gse.__main__ answers and does not run on

from typing import TYPE_CHECKING, Any

from gse.process import own_packages
from gse.version import __version__ as __version__

own_packages.claim()

if TYPE_CHECKING:
    from gse.api import identify as identify
    from gse.api import judge as judge
    from gse.api import load as load
    from gse.api import session as session

__all__ = ["identify", "judge", "load", "session"]


def __dir__() -> list[str]:
    """What a notebook offers when somebody types ``gse.`` and the tabulator."""
    return __all__


def __getattr__(name: str) -> Any:
    """The functions of gse.api: the command line does without them, and without the time that they take to import."""
    if name not in __all__:
        raise AttributeError(f"module 'gse' has no attribute {name!r}")
    from gse import api

    return getattr(api, name)
