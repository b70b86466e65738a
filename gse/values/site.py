"""The site: where the mount stands, its air, with how well each is known."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from drivers.outside_text import is_plain

_NAME_CHARACTERS = 500
_SEA_LEVEL_HPA, _SEA_LEVEL_C, _LAPSE_C_PER_M = 1013.25, 15.0, 0.0065
_PRESSURE_EXPONENT = 5.25588
"""The International Standard Atmosphere below 11 km (ISO 2533): 1013.25 hPa and 15 degC at sea level."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteUncertainty:
    """How well a site is known: each value is the half-width of an interval that holds the truth with 95 %.

    ``position_m`` is in each of north and east; ``vertical_arcsec`` is the deflection of the vertical along each.
    None is 3 hPa where the pressure was entered and 20 where it follows from the height; 3 and 15 K likewise. The
    defaults have their reasons in docs/uncertainty.md.
    """

    position_m: Annotated[float, Interval(ge=0, le=1e6)] = 10.0
    height_m: Annotated[float, Interval(ge=0, le=10_000)] = 20.0
    vertical_arcsec: Annotated[float, Interval(ge=0, le=3600)] = 10.0
    pressure_hpa: Annotated[float, Interval(ge=0, le=1100)] | None = None
    temperature_c: Annotated[float, Interval(ge=0, le=100)] | None = None
    relative_humidity: Annotated[float, Interval(ge=0, le=1)] = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Where the mount stands (geodetic, WGS 84) and its air, for refraction.

    Without ``pressure_hpa`` or ``temperature_c`` those of the standard atmosphere at ``height_m`` are in force.
    """

    name: str = "rooftop"
    latitude_deg: Annotated[float, Interval(ge=-90, le=90)]
    longitude_deg: Annotated[float, Interval(ge=-180, le=360)]
    height_m: Annotated[float, Interval(ge=-500, le=9000)] = 0.0
    pressure_hpa: Annotated[float, Interval(ge=0, le=1100)] | None = None
    temperature_c: Annotated[float, Interval(ge=-80, le=60)] | None = None
    relative_humidity: Annotated[float, Interval(ge=0, le=1)] = 0.5
    uncertainty: SiteUncertainty = SiteUncertainty()

    def __post_init__(self) -> None:
        if len(self.name) > _NAME_CHARACTERS or not is_plain(self.name):
            raise ValueError(f"{self.name!r:.60} is not a name: expected at most {_NAME_CHARACTERS} plain characters")

    @property
    def air_pressure_hpa(self) -> float:
        """The pressure in force: as entered, or the standard atmosphere's at this height."""
        return standard_pressure_hpa(self.height_m) if self.pressure_hpa is None else self.pressure_hpa

    @property
    def air_temperature_c(self) -> float:
        """The temperature in force: as entered, or the standard atmosphere's at this height."""
        return _SEA_LEVEL_C - _LAPSE_C_PER_M * self.height_m if self.temperature_c is None else self.temperature_c

    @property
    def pressure_uncertainty_hpa(self) -> float:
        """95 % half-width of the pressure in force: weather moves it by 10 hPa (1 sigma) about the standard one."""
        stated = self.uncertainty.pressure_hpa
        return stated if stated is not None else 20.0 if self.pressure_hpa is None else 3.0

    @property
    def temperature_uncertainty_c(self) -> float:
        """95 % half-width of the temperature in force."""
        stated = self.uncertainty.temperature_c
        return stated if stated is not None else 15.0 if self.temperature_c is None else 3.0

    def pressure_doubt(self) -> str | None:
        """One line where the entered pressure is not that of the height, else None; 0 is a site without air."""
        if not self.pressure_hpa:
            return None
        expected = standard_pressure_hpa(self.height_m)
        if abs(self.pressure_hpa - expected) <= PRESSURE_DOUBT_HPA:
            return None
        return (
            f"site.pressure_hpa is {self.pressure_hpa:g}, but the standard atmosphere has {expected:.0f} hPa at "
            f"{self.height_m:g} m: enter the pressure at the mount, not that of sea level, or leave it out"
        )


PRESSURE_DOUBT_HPA = 30.0
"""Weather moves the pressure by this much about the standard atmosphere, three times in a thousand days."""


def standard_pressure_hpa(height_m: float) -> float:
    """Pressure of the standard atmosphere (ISO 2533) at a height."""
    return float(_SEA_LEVEL_HPA * (1 - height_m * _LAPSE_C_PER_M / (_SEA_LEVEL_C + 273.15)) ** _PRESSURE_EXPONENT)
