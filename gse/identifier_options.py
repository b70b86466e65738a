"""The options of the identifier under test."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Interval

Algorithm = Literal["neighbour", "pivot", "match-group", "robust"]


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
