"""The options of the identifier under test."""

from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from annotated_types import Interval, Len

Algorithm = Literal["neighbour", "pivot", "match-group", "robust", "external"]
"""A built-in one is a module of gse.identifier of that name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifierOptions:
    """The identifier under test, with its options (each used by the algorithm that knows it)."""

    algorithm: Algorithm = "neighbour"
    catalog_stars: Annotated[int, Interval(ge=100, le=100_000)] | Literal["auto"] = "auto"
    tolerance_px: Annotated[float, Interval(gt=0, le=20)] = 1.5
    min_fit: Annotated[int, Interval(ge=2, le=29)] = 6
    """Fn of the LAPAN paper, and Fn2 unless ``min_fit_2`` is given."""
    min_fit_2: Annotated[int, Interval(ge=2, le=29)] | None = None
    """Fn2 of the LAPAN paper."""
    fit_rule: Literal["reached", "exceeded"] = "reached"
    """Whether a count equal to Fn or Fn2 is enough; figure 2-7 of the LAPAN paper has "exceeded"."""
    alpha: Literal["brightest", "central"] = "brightest"
    """The alpha star: the brightest object, or the brightest within ``alpha_radius_px`` of the boresight."""
    alpha_radius_px: Annotated[float, Interval(gt=0, le=20_000)] | None = None
    """A quarter of the smaller side of the detector without it."""
    alpha_retries: Annotated[int, Interval(ge=0, le=29)] = 29
    """How many further objects may be the alpha star, after the brightest."""
    selection: Literal["first-fit", "all-fit", "best-vote"] = "first-fit"
    check: Literal["wahba", "none"] = "wahba"
    """Whether the stars must fit an attitude; the flight unit of the LAPAN paper has no such check."""
    pivot_members: Literal[4, 5] = 4
    """K of the pivot paper."""
    a_priori: Literal["none", "cells"] = "none"
    """Whether ``pivot`` and ``match-group`` look first in the cells where the panorama before was."""
    magnitude_limit: Annotated[float, Interval(ge=0, le=12)] | None = None
    """Faintest magnitude of the catalogue of ``pivot`` and ``match-group``; 6.0 in the pivot paper."""
    attitude: Literal["wahba", "paper-mean"] = "wahba"
    command: Annotated[tuple[str, ...], Len(1, 100)] | None = None
    """Of ``external``: a program and its arguments, a child process."""
    library: str | None = None
    """Of ``external``: a shared library with the function ``symbol``."""
    symbol: str = "identify"
    entry_point: str | None = None
    """Of ``external``: a Python entry point of the group gse.identifiers."""
    config: str | None = None
    """Of ``external``: a file for the library or entry point, its catalogue for example."""
    directory: str | None = None
    """Of ``external``: where the child runs; the folder of the station file without it."""
    timeout_ms: Annotated[float, Interval(gt=0, le=600_000)] = 200.0
    """Of ``external``: the time for one panorama."""

    def __post_init__(self) -> None:
        for key, words in _CHOICES.items():
            if getattr(self, key) not in words:
                known = ", ".join(map(str, words))
                raise ValueError(f"identifier.{key} is {getattr(self, key)!r:.60}; expected one of {known}")

    @property
    def label(self) -> str:
        """The algorithm, or the name of an external program."""
        if self.algorithm != "external":
            return self.algorithm
        first, *others = self.command or ("external",)
        if "/" not in first:  # an interpreter: its script says more
            first = next((part for part in others if not part.startswith("-")), first)
        return (self.entry_point or self.library or first).rpartition("/")[2]

    def facts(self) -> dict[str, Any]:
        """The options that the algorithm knows, for the report: nothing of the host's folders."""
        unknown = ("directory",) if self.algorithm == "external" else PLUG_KEYS
        return {key: value for key, value in asdict(self).items() if key not in unknown}


PLUG_KEYS = ("command", "library", "symbol", "entry_point", "config", "directory", "timeout_ms")
"""The options of an external identifier alone."""

_CHOICES = {
    key: get_args(hint) for key, hint in get_type_hints(IdentifierOptions).items() if get_origin(hint) is Literal
}
"""The words that each key may have. A station file is checked before; from Python any word can come."""
