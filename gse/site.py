"""The site: where the mount stands, with its air."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Where the mount stands (geodetic, WGS 84) and its air, for refraction."""

    name: str = "rooftop"
    latitude_deg: Annotated[float, Interval(ge=-90, le=90)]
    longitude_deg: Annotated[float, Interval(ge=-180, le=360)]
    height_m: Annotated[float, Interval(ge=-500, le=9000)] = 0.0
    pressure_hpa: Annotated[float, Interval(ge=0, le=1100)] = 1010.0
    temperature_c: Annotated[float, Interval(ge=-80, le=60)] = 15.0
    relative_humidity: Annotated[float, Interval(ge=0, le=1)] = 0.5
