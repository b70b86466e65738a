"""Kinds of events of the station."""

from dataclasses import dataclass
from enum import StrEnum

from drivers.chunk import LinkEvent
from gse.finding import Finding


class StationKind(StrEnum):
    """Events of the processing, of truth, of the host and of the sky."""

    SENSOR_RESET = "SENSOR_RESET"
    SEQUENCE_CHAOS = "SEQUENCE_CHAOS"
    CLOCK_STEP = "CLOCK_STEP"
    MIRRORED = "MIRRORED"
    WRONG_CAMERA = "WRONG_CAMERA"
    IDENTIFIER_FAULT = "IDENTIFIER_FAULT"
    IDENTIFIER_GIVEN_UP = "IDENTIFIER_GIVEN_UP"
    ALIGNED = "ALIGNED"
    NO_TRUTH = "NO_TRUTH"
    EARTH_ORIENTATION = "EARTH_ORIENTATION"
    NO_STATION = "NO_STATION"
    FROZEN = "FROZEN"
    CLEAR = "CLEAR"
    CLOUDED = "CLOUDED"
    NO_STARS = "NO_STARS"
    DAYLIGHT = "DAYLIGHT"
    DARK_NIGHT = "DARK_NIGHT"
    FINDING = "FINDING"
    CLOSED = "CLOSED"
    TERMINAL_LOST = "TERMINAL_LOST"
    TERMINAL_STUCK = "TERMINAL_STUCK"
    NOTE = "NOTE"


@dataclass(frozen=True, slots=True)
class ClockStep(LinkEvent):
    """A step of the host's UTC clock against its monotonic one; ``step_ns`` is positive where UTC went forward.

    ``utc_kept`` where the sensor's clock went along with UTC: the monotonic clock stood still, or leapt.
    """

    step_ns: int
    utc_kept: bool = False


@dataclass(frozen=True, slots=True)
class FindingEvent(LinkEvent):
    """A finding of a running session, for its listeners; it is not recorded, since a replay finds it again."""

    finding: Finding
