"""The limits that a session is judged against."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval
from pydantic import AfterValidator

from gse.values.axis import Axis

Arcsec = Annotated[float, Interval(gt=0, le=648_000)]
"""Up to half a turn: a limit that nothing exceeds tests nothing."""
_HALF_TURN_ARCSEC = 648_000.0
_TIMES_LIMIT = 3.0
"""Noise that keeps a limit leaves it by a factor of three in one answer of some thousands."""


class Decision(StrEnum):
    """The decision rule: whether uncertainty counts."""

    GUARDED = "guarded"
    SIMPLE = "simple"


def _in_order(ends: tuple[float | None, float | None]) -> tuple[float | None, float | None]:
    low, high = ends
    if low is None and high is None:
        raise ValueError("both ends are open: give a number for one")
    if low is not None and high is not None and low > high:
        raise ValueError(f"the low end {low:.15g} is over the high end {high:.15g}: swap them")
    return ends


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The limits that a session is judged against; mean errors and time are those of the LAPAN paper.

    A limit that is None is not asked. ``boresight_arcsec`` is for the half-cone that holds 95 % of the boresights.
    ``x_arcsec`` and ``y_arcsec`` are along the sensor's own columns and rows, ``about_arcsec`` is about its boresight,
    each for the share ``confidence`` of the frames. ``slew_deg_per_s`` is the rate of turn that the sensor must bear;
    frames of a faster scene count for nothing else. ``output_rate_hz`` and ``availability`` are the least that passes.
    ``false_arcsec`` is how far a false answer lies off; where it is None, that is three times the larger limit on the
    sky. ``items`` are low and high end, one of which may be None, of items of the sensor's housekeeping: all values of
    a session must lie between them.
    """

    d_ra_cosde_arcsec: Arcsec = 60.0
    d_de_arcsec: Arcsec = 60.0
    d_roll_arcsec: Arcsec = 600.0
    boresight_arcsec: Arcsec | None = None
    x_arcsec: Arcsec | None = None
    y_arcsec: Arcsec | None = None
    about_arcsec: Arcsec | None = None
    confidence: Annotated[float, Interval(ge=0.5, le=0.9999)] = 0.997
    output_rate_hz: Annotated[float, Interval(gt=0, le=10_000)] | None = None
    first_fix_s: Annotated[float, Interval(gt=0, le=86_400)] | None = None
    slew_deg_per_s: Annotated[float, Interval(gt=0, le=10)] | None = None
    mean_current_a: Annotated[float, Interval(gt=0, le=1000)] | None = None
    inrush_current_a: Annotated[float, Interval(gt=0, le=1000)] | None = None
    wrong_names_share: Annotated[float, Interval(gt=0, lt=1)] | None = None
    rate_bias_arcsec_per_s: Annotated[float, Interval(gt=0, le=36_000)] | None = None
    rate_noise_arcsec_per_s: Annotated[float, Interval(gt=0, le=36_000)] | None = None
    identification_ms: Annotated[float, Interval(gt=0, le=3_600_000)] = 200.0
    availability: Annotated[float, Interval(gt=0, le=1)] = 0.95
    false_arcsec: Arcsec | None = None
    false_share: Annotated[float, Interval(gt=0, lt=1)] = 0.01
    decision: Decision = Decision.GUARDED
    items: Mapping[str, Annotated[tuple[float | None, float | None], AfterValidator(_in_order)]] = field(
        default_factory=dict, hash=False
    )

    def of(self, axis: Axis) -> float:
        """The limit of the errors along an axis on the sky."""
        limit: float = getattr(self, axis.column)
        return limit

    @property
    def false_beyond_arcsec(self) -> float:
        """How far a boresight may lie from the right one before the answer is false."""
        if self.false_arcsec is not None:
            return self.false_arcsec
        return min(_TIMES_LIMIT * max(self.d_ra_cosde_arcsec, self.d_de_arcsec), _HALF_TURN_ARCSEC)
