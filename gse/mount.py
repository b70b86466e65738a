"""The mount: the fixed direction of the sensor in the horizon frame."""

import re
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

_ALIGN = re.compile(r"first (\d+(?:\.\d+)?) s")


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
    stated: bool = True
    """Whether a station file gave the angles, or they are the defaults beside ``align``."""

    def __post_init__(self) -> None:
        if self.align is not None and not _ALIGN.fullmatch(self.align):
            raise ValueError(f"align is {self.align!r:.60}; expected for example: align: first 60 s")

    @property
    def align_s(self) -> float | None:
        """Seconds at the start of a session that the mount is fitted on, or None."""
        found = _ALIGN.fullmatch(self.align) if self.align else None
        return float(found[1]) if found else None
