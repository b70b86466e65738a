"""The limits that a session is judged against."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval

from gse.values.axis import Axis

Arcsec = Annotated[float, Interval(gt=0, le=648_000)]
"""Up to half a turn: a limit that nothing exceeds tests nothing."""


class Decision(StrEnum):
    """The decision rule: whether uncertainty counts."""

    GUARDED = "guarded"
    SIMPLE = "simple"


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The limits that a session is judged against; mean errors and time are those of the LAPAN paper.

    ``boresight_arcsec`` is for the half-cone that holds 95 % of the boresights, and None where nothing is asked of it.
    """

    d_ra_cosde_arcsec: Arcsec = 60.0
    d_de_arcsec: Arcsec = 60.0
    d_roll_arcsec: Arcsec = 600.0
    boresight_arcsec: Arcsec | None = None
    identification_ms: Annotated[float, Interval(gt=0, le=3_600_000)] = 200.0
    availability: Annotated[float, Interval(gt=0, le=1)] = 0.95
    false_share: Annotated[float, Interval(gt=0, lt=1)] = 0.01
    decision: Decision = Decision.GUARDED

    def of(self, axis: Axis) -> float:
        """The limit of the errors along an axis on the sky."""
        limit: float = getattr(self, axis.column)
        return limit
