"""The mount: the fixed direction of the sensor in the horizon frame, with how well it is known."""

import re
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from gse.values.instant import from_text

_ALIGN = re.compile(r"first (\d+(?:\.\d+)?) s")


@dataclass(frozen=True, slots=True, kw_only=True)
class MountUncertainty:
    """How well the stated angles are known: half-widths of intervals that hold the truth with 95 %.

    ``fitted`` ones are of a fit to stars (``from: align`` in a station file), which vouches for no angle: a wrong clock
    or site is in it.
    """

    azimuth_arcsec: Annotated[float, Interval(ge=0, le=648_000)] = 10.0
    altitude_arcsec: Annotated[float, Interval(ge=0, le=648_000)] = 10.0
    roll_arcsec: Annotated[float, Interval(ge=0, le=648_000)] = 10.0
    fitted: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialUncertainty:
    """How well a shown direction is known: half-widths of intervals that hold the truth with 95 %."""

    across_arcsec: Annotated[float, Interval(ge=0, le=648_000)] = 10.0
    roll_arcsec: Annotated[float, Interval(ge=0, le=648_000)] = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialDirection:
    """The direction among the catalogue's stars that a star simulator or a screen shows, in ICRS.

    ``roll_deg`` is the position angle of image up, from north through east. Where a rate is stated the angles are those
    of the instant ``at``; ValueError without it.
    """

    ra_deg: Annotated[float, Interval(ge=-360, le=360)]
    de_deg: Annotated[float, Interval(ge=-90, le=90)]
    roll_deg: Annotated[float, Interval(ge=-360, le=360)] = 0.0
    ra_rate_arcsec_per_s: Annotated[float, Interval(ge=-36_000, le=36_000)] = 0.0
    de_rate_arcsec_per_s: Annotated[float, Interval(ge=-36_000, le=36_000)] = 0.0
    roll_rate_arcsec_per_s: Annotated[float, Interval(ge=-36_000, le=36_000)] = 0.0
    at: str | None = None
    uncertainty: InertialUncertainty = InertialUncertainty()

    def __post_init__(self) -> None:
        if self.at is not None:
            from_text(self.at)
        elif any(self.rates_arcsec_per_s):
            raise ValueError("a rate without the instant of the angles; expected for example at: 2026-03-20T18:30:00Z")

    @property
    def rates_arcsec_per_s(self) -> tuple[float, float, float]:
        """Rates of RA, DE and roll."""
        return self.ra_rate_arcsec_per_s, self.de_rate_arcsec_per_s, self.roll_rate_arcsec_per_s

    @property
    def at_utc_ns(self) -> int:
        """The instant of the angles; 0 where they are those of all times."""
        return from_text(self.at) if self.at is not None else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """The fixed direction of the sensor in the horizon frame.

    Azimuth from north through east. ``roll_deg`` is the position angle of image up (towards row 0) from the direction
    of the zenith, counter-clockwise as seen in the sky; at the zenith itself, "towards the zenith" is what it becomes
    when the sensor is tilted up along its azimuth: image up points to azimuth + 180 at roll 0.
    ``align`` fits the three angles from the first seconds of a session instead ("first 60 s"); ValueError otherwise.
    """

    azimuth_deg: Annotated[float, Interval(ge=-360, le=360)] = 0.0
    altitude_deg: Annotated[float, Interval(ge=-90, le=90)] = 90.0
    roll_deg: Annotated[float, Interval(ge=-360, le=360)] = 0.0
    align: str | None = None
    inertial: InertialDirection | None = None
    """Fixed to the stars instead of to the Earth: before a star simulator or a screen."""
    stated: bool = True
    """Whether a station file gave the angles, or they are the defaults beside ``align``."""
    uncertainty: MountUncertainty = MountUncertainty()

    def __post_init__(self) -> None:
        angles = self.azimuth_deg, self.altitude_deg, self.roll_deg
        if self.inertial is not None and (self.align is not None or angles != (0.0, 90.0, 0.0)):
            raise ValueError("inertial stands alone: expected either the direction that is shown, or angles or align")
        if self.align is not None and not _ALIGN.fullmatch(self.align):
            raise ValueError(f"align is {self.align!r:.60}; expected for example: align: first 60 s")

    @property
    def align_s(self) -> float | None:
        """Seconds at the start of a session that the mount is fitted on, or None."""
        found = _ALIGN.fullmatch(self.align) if self.align else None
        return float(found[1]) if found else None
