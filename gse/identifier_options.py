"""The options of the identifier under test."""

from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from annotated_types import Interval, Len

Algorithm = Literal["neighbour", "pivot", "match-group", "robust", "external"]


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifierOptions:
    """The identifier under test, with its options (each used by the algorithm that knows it)."""

    algorithm: Algorithm = "neighbour"
    catalog_stars: Annotated[int, Interval(ge=100, le=100_000)] | Literal["auto"] = "auto"
    tolerance_px: Annotated[float, Interval(gt=0, le=20)] = 1.5
    min_fit: Annotated[int, Interval(ge=2, le=29)] = 6
    """Fn and Fn2 of the LAPAN paper."""
    alpha_retries: Annotated[int, Interval(ge=0, le=29)] = 29
    """How many further objects may be the alpha star, after the brightest."""
    selection: Literal["first-fit", "best-vote"] = "first-fit"
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

    @property
    def label(self) -> str:
        """The algorithm, or the name of an external program."""
        if self.algorithm != "external":
            return self.algorithm
        program = self.entry_point or self.library or (self.command or ("external",))[0]
        return program.rpartition("/")[2]

    def facts(self) -> dict[str, Any]:
        """The options that the algorithm knows, for the report: nothing of the host's folders."""
        unknown = ("directory",) if self.algorithm == "external" else PLUG_KEYS
        return {key: value for key, value in asdict(self).items() if key not in unknown}


PLUG_KEYS = ("command", "library", "symbol", "entry_point", "config", "directory", "timeout_ms")
"""The options of an external identifier alone."""
