"""The limits that a session is judged against."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The limits that a session is judged against; those of the LAPAN paper where a station file gives none."""

    d_ra_cosde_arcsec: Annotated[float, Gt(0)] = 60.0
    d_de_arcsec: Annotated[float, Gt(0)] = 60.0
    identification_ms: Annotated[float, Gt(0)] = 200.0
    availability: Annotated[float, Interval(ge=0, le=1)] = 0.95
