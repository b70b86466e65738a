"""Data of a session: the input of statistics, verdict, report and views."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from drivers.clock import ClockReading
from gse.catalog.stars import ListedStars
from gse.config.station import Station
from gse.external.identifier import ExternalCounts
from gse.recording.session_format import PowerReading
from gse.station.events import StationKind
from gse.station.exclusions import Exclusion
from gse.station.host_clock import instants_ns
from gse.station.housekeeping import Housekeeping
from gse.station.results import LinkCounters, Subject
from gse.station.session_tables import AttitudeTable, FrameTable
from gse.station.star_names import StarNames
from gse.truth import Alignment, EarthOrientation
from gse.truth.orientation import FIRST_NS
from gse.values.screen import ShownSky
from protocols import StatusMessage
from protocols.description import TimeDescription


@dataclass(slots=True)
class SessionData:
    """One complete session, in the order of time.

    ``frames`` are the panoramas with the answers of the identifier under test; a sensor that sends no panoramas is its
    own ``subject``, and the frames are its answers. ``sensor_attitudes`` are the sensor's own answers (ATTITUDE
    frames), ``star_names`` those of its lists of stars, ``housekeeping`` the items that it sends; ``raw_sha256`` is the
    hash of all received bytes; ``catalog`` describes the mission catalogue in use; ``versions`` the packages that
    numbers depend on. ``events_not_kept`` are those of a flood, which are only counted. ``others_lost`` of the lost
    frames of the link were certainly no panoramas. A ``truncated`` session lost its end; a ``growing`` one is still
    being recorded. ``stars`` are those of the mission catalogue: matches name its rows. ``alignment`` is the mount that
    was fitted on the session itself; from there ``mount_turns`` (M, 3, 3), in the sensor frame, turned it in each frame
    (None: it stood still). ``clock_error_s`` is a bound of the host clock's error that the operator states,
    ``excluded`` the times that the operator excludes from the statistics. ``shown`` is what a screen showed, by its
    events SHOWN. ``time`` says what the sensor's time tags tell. ``power`` are the readings of its supply. ``external``
    is the identity of an external identifier (gse.identifier/1), ``external_counts`` counts what it gave.
    """

    station: Station
    station_text: str
    protocol_name: str
    subject: Subject = field(default=Subject.ONBOARD, kw_only=True)
    frames: FrameTable = field(default_factory=FrameTable)
    link: LinkCounters = field(default_factory=LinkCounters)
    events: list[LinkEvent] = field(default_factory=list)
    events_not_kept: int = 0
    others_lost: int = 0
    clock: list[ClockReading] = field(default_factory=list)
    statuses: list[tuple[int, StatusMessage]] = field(default_factory=list)
    housekeeping: Housekeeping = field(default_factory=lambda: Housekeeping({}))
    sensor_attitudes: AttitudeTable = field(default_factory=AttitudeTable)
    star_names: StarNames = field(default_factory=StarNames)
    raw_sha256: str = ""
    catalog: dict[str, object] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    stars: ListedStars | None = None
    truncated: bool = False
    growing: bool = False
    earth_orientation: EarthOrientation | None = None
    alignment: Alignment | None = None
    mount_turns: NDArray[np.float64] | None = None
    clock_error_s: float | None = None
    excluded: tuple[Exclusion, ...] = ()
    shown: ShownSky = field(default_factory=ShownSky)
    time: TimeDescription = field(default_factory=TimeDescription)
    power: list[PowerReading] = field(default_factory=list)
    external: dict[str, Any] | None = None
    external_counts: ExternalCounts = field(default_factory=ExternalCounts)

    def __post_init__(self) -> None:
        if self.station.screen is not None:
            self.shown.screen_to_sensor = self.station.screen.to_sensor.rotation()

    @property
    def is_simulated(self) -> bool:
        """Whether no sensor took part: by the port, the clock, or what the stream says of itself."""
        if self.station.port.url.startswith("sim://") or any(reading.source == "simulated" for reading in self.clock):
            return True
        return any(event.kind == StationKind.TEST_STREAM for event in self.events)

    @property
    def panoramas_lost(self) -> int:
        """Lost frames that may have been panoramas, and the copies that a frozen sensor sent instead of them.

        An answer that is lost on its way leaves a gap in the sequence numbers, and its request unanswered.
        """
        lost = max(self.link.frames_lost - self.others_lost, self.link.unanswered)
        return lost + self.link.frames_repeated


# The instant that stands for a session wherever truth is asked for one.


def middle_instant_ns(session: SessionData) -> int | None:
    """UTC of the middle one of the frames that no wrong clock stamped; None without frames, or where none has truth.

    A clock that is set to 1970 in the session, and stays there, is the last one and so counts as right.
    """
    utc_ns = instants_ns(session.frames.columns, session.events)
    utc_ns = utc_ns[utc_ns >= FIRST_NS]
    return int(utc_ns[len(utc_ns) // 2]) if len(utc_ns) else None
