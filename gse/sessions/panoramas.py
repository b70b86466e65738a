"""Panoramas of a recording before identification, the input of a calibration."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from drivers.chunk import Chunk
from drivers.errors import CaptureError
from drivers.link import SerialLink
from drivers.playback import is_session
from gse.config.choice import StationText
from gse.config.station import BUILT_IN_TEXT, Station, parse_recorded, parse_station
from gse.errors import UsageError
from gse.recording.session_format import EARTH_ORIENTATION, PROTOCOL, STATION, read_recorded
from gse.sessions.imported import stated_start_ns
from gse.sessions.replay import ReplayOptions, sealed, unsealed
from gse.station.reception import Reception
from gse.station.setup import addressed
from gse.truth import EarthOrientation
from gse.values.panorama import Panorama
from gse.values.screen import Shown
from protocols import Protocol, load_protocol, parse_protocol

RECEIVE_TIMEOUT_S = 0.2


@dataclass(frozen=True, slots=True)
class Recording:
    """A session with its station file, wire format and frozen Earth orientation (None where it has none).

    ``damaged``: a part of it is missing. ``shown`` is what a screen showed.
    """

    path: Path
    options: ReplayOptions
    station: Station
    station_text: str
    protocol: Protocol
    earth_orientation: EarthOrientation | None
    damaged: bool = False
    anchor_utc_ns: int | None = None
    shown: tuple[Shown, ...] = ()

    def panoramas(self) -> Iterator[Panorama]:
        """The panoramas, in order, through the same link and reception as a live sensor's."""
        reception = Reception(
            addressed(self.protocol, self.station),
            baudrate=self.station.port.baudrate,
            anchor_utc_ns=self.anchor_utc_ns,
            time=self.station.sensor.time,
        )
        with SerialLink(self.options.url(self.path), self.station.port.baudrate) as link:
            while not link.at_end:
                chunks = (item for item in link.receive(RECEIVE_TIMEOUT_S) if isinstance(item, Chunk))
                yield from reception.receive(reception.stream.feed(*chunks)).panoramas
            yield from reception.receive(reception.stream.finish()).panoramas


def open_recording(
    path: Path,
    options: ReplayOptions,
    change: Callable[[StationText], StationText] = lambda recorded: recorded,
    *,
    needs_catalog: bool = True,
) -> Recording:
    """Open a session with its own station file, or with the one that ``change`` returns.

    For a raw capture ``change`` gets the built-in one. CaptureError where the file is missing, UsageError where it is
    neither a session nor a raw capture whose start is given.
    """
    if not path.exists():
        raise CaptureError(f"there is no recording {path}; expected a session (.mcap or its folder)")
    if not is_session(path):
        return _raw_capture(path, options, change)
    recorded = read_recorded(path)
    attachments = recorded.attachments
    own_text = attachments.get(STATION, BUILT_IN_TEXT)
    frozen = sealed(parse_recorded(own_text))
    station, text = change((frozen, own_text))
    if STATION not in attachments and text == BUILT_IN_TEXT:
        raise UsageError(
            f"{path} has no station file: it is not a session of gse, or its head is damaged; give one by --station, "
            "which 'gse replay', 'gse calibrate' and 'gse align' take"
        )
    has_protocol = PROTOCOL in attachments and station.protocol == frozen.protocol
    station = unsealed(station, has_protocol=has_protocol, needs_catalog=needs_catalog)
    if has_protocol:
        protocol = parse_protocol(attachments[PROTOCOL], "the session's protocol.yaml")
    else:
        protocol = load_protocol(station.protocol)
    orientation = attachments.get(EARTH_ORIENTATION)
    earth_orientation = EarthOrientation.from_json(orientation) if orientation else None
    anchor_utc_ns = stated_start_ns(attachments)
    shown, damaged = tuple(recorded.shown), recorded.damaged
    return Recording(path, options, station, text, protocol, earth_orientation, damaged, anchor_utc_ns, shown)


def _raw_capture(path: Path, options: ReplayOptions, change: Callable[[StationText], StationText]) -> Recording:
    if options.start_utc is None:
        raise UsageError(
            f"{path} is not a session; expected a session.mcap, or a raw serial capture with the UTC of its first "
            "panorama, for example --start-utc 2026-03-20T18:30:00Z"
        )
    station, text = change((parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT))
    return Recording(
        path, options, station, text, load_protocol(station.protocol), None, anchor_utc_ns=options.anchor_utc_ns
    )
