"""Replay: a recorded session, a raw capture or a panorama table through the same loop as a live sensor.

A calibration takes no more of the loop than its reception: ``open_recording`` gives it the panoramas.
"""

import json
import math
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import CaptureError
from drivers.link import SerialLink
from drivers.mock_ports import replay_url
from drivers.playback import check_recording, is_session
from gse.catalog.readers import GAIA
from gse.config.choice import StationText
from gse.config.station import BUILT_IN_TEXT, Port, Station, parse_recorded
from gse.errors import TruthError, UsageError
from gse.external.identifier import RecordedAnswers, read_identity
from gse.recording.session_format import (
    EARTH_ORIENTATION,
    IDENTIFIER,
    PROTOCOL,
    STATED,
    STATION,
    Recorded,
    RecordedTimings,
    read_recorded,
)
from gse.sessions.imported import stated_start_ns
from gse.sessions.status_file import is_being_recorded
from gse.station.events import StationKind
from gse.station.frame_results import FrameResults
from gse.station.loop import RECEIVE_TIMEOUT_S, Listener, StationLoop
from gse.station.reception import Reception
from gse.station.session_data import SessionData
from gse.station.setup import addressed, no_words, set_up
from gse.truth import EarthOrientation
from gse.truth.orientation import GivenTables
from gse.values import instant
from gse.values.panorama import Panorama
from gse.values.screen import Shown
from protocols import Frame, FrameDecoder, Protocol, built_in_names, load_protocol, parse_protocol

FIRST_WITHIN_S = 1.0
MOST_THREADS = 2
"""A third would have nothing to do: identification is half of the work, and all else holds Python's lock."""
_NO_STATION = "the session has no station file, so the built-in station is used; give the right one with --station"

_SEAL = "session://"
"""Marks paths and programs in the station file of a session.

A session may come from anybody, so its own station file must not open files of this host, nor start a program. A path
still marked after the operator's changes is refused; of a program still marked the recorded answers are judged.
"""


def sealed(station: Station) -> Station:
    """The station of a session with its paths and programs marked."""
    changes: dict[str, object] = {}
    if station.catalog != GAIA:
        changes["catalog"] = _SEAL + station.catalog
    if station.protocol not in built_in_names():
        changes["protocol"] = _SEAL + station.protocol
    if station.identifier.algorithm == "external":
        changes["identifier"] = replace(station.identifier, directory=_SEAL)
    if station.power is not None:  # a session switches nothing on this host
        changes["power"] = station.power.model_copy(update={"on": (_SEAL,), "off": (_SEAL,), "read": ()})
    return station.model_copy(update=changes) if changes else station


def names_program(station: Station) -> bool:
    """Whether only the session itself names the external identifier."""
    return station.identifier.algorithm == "external" and station.identifier.directory == _SEAL


def unsealed(station: Station, *, has_protocol: bool, needs_catalog: bool = True) -> Station:
    """The station without marks; UsageError where only the session itself names a file that is needed.

    ``has_protocol``: the session holds the protocol's description itself.
    """
    paths = []
    if needs_catalog and station.catalog.startswith(_SEAL):
        paths.append(f"the catalogue {station.catalog.removeprefix(_SEAL)}")
    if not has_protocol and station.protocol.startswith(_SEAL):
        paths.append(f"the protocol {station.protocol.removeprefix(_SEAL)}")
    if paths:
        raise UsageError(
            f"the session's own station file names {' and '.join(paths)}, and a session opens no file of this host; "
            "give a station file that names it: --station FILE"
        )
    return station.model_copy(update={"protocol": station.protocol.removeprefix(_SEAL)})


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of a replay: the session, and this host's own identification times (not the recorded ones)."""

    session: SessionData
    own_elapsed_us: "array[float]"


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """How a recording is replayed: speed, part, and the start of a raw capture.

    ``given_orientation`` replaces the Earth orientation in the session.
    """

    speed: str = "max"
    from_utc: str | None = None
    to_utc: str | None = None
    chunk_bytes: int | None = None
    start_utc: str | None = None
    given_orientation: GivenTables | None = None

    def url(self, path: Path) -> str:
        """The replay:// URL."""
        return replay_url(
            path,
            speed=self.speed,
            from_=self.from_utc,
            to=self.to_utc,
            cut=self.chunk_bytes,
            start_utc=self.start_utc,
        )

    @property
    def anchor_utc_ns(self) -> int:
        """UTC of the first panorama of a raw capture; UsageError where the text is not an instant."""
        try:
            return instant.from_text(self.start_utc or "")
        except ValueError as error:
            raise UsageError(f"--start-utc: {error}") from error


def replay_session(
    path: Path,
    *,
    options: ReplayOptions = ReplayOptions(),
    station: Callable[[StationText], StationText] = lambda recorded: recorded,
    make_listeners: Callable[[StationLoop], Sequence[Listener]] = lambda loop: (),
    stop: Callable[[], bool] = lambda: False,
    each: Callable[[list[FrameResults]], None] = lambda results: None,
    tell: Callable[[str], None] = no_words,
    threads: int = MOST_THREADS,
) -> Replay:
    """Replay a recording into a SessionData.

    The station file is that of the session, or the built-in one where there is none; ``station`` may change or replace
    it. ``tell`` gets lines on what takes long, the first time on a computer. With two ``threads`` one identifies while
    the other decodes and compares; the results are those of one. CaptureError where the file is missing or foreign.
    """
    recorded = _recorded(path, options, station)
    with SerialLink(options.url(path)) as link, ThreadPoolExecutor(1, "identify") as ahead:
        first = link.receive(FIRST_WITHIN_S)
        loop = _loop(path, recorded, options, station, first[0].utc_ns if first else None, tell)
        if threads > 1 and options.speed == "max" and loop.setup.external is None:
            loop.ahead = ahead
        loop.session.frames.use_disk()
        loop.session.housekeeping.use_disk()
        loop.listeners = make_listeners(loop)
        session = loop.run(link, first, stop=stop, each=each)
    if recorded is None and session.link.bytes_in == session.link.bytes_discarded:
        raise _no_frame(path, session.protocol_name)
    if recorded is not None and recorded.damaged:
        session.growing = is_being_recorded(path)
        session.truncated = not session.growing
    return Replay(session, loop.own_elapsed_us)


def _recorded(path: Path, options: ReplayOptions, change: Callable[[StationText], StationText]) -> Recorded | None:
    """What a session holds beside its bytes, None of a raw capture whose start is given."""
    check_recording(path)
    if is_session(path):
        return read_recorded(path)
    if options.start_utc is None:
        _check_has_frame(path, change)
        raise UsageError(
            f"{path} is not a session; expected a session.mcap, or a raw serial capture with the UTC of its first "
            "panorama, for example --start-utc 2026-03-20T18:30:00Z"
        )
    return None


_LOOKED_AT_BYTES = 1 << 20
"""A frame within the first MiB, or none: somebody's photograph need not be decoded to its end."""


def _check_has_frame(path: Path, change: Callable[[StationText], StationText]) -> None:
    """UsageError where the beginning of a capture holds no frame: then its UTC is not what is missing."""
    protocol = station_in_force({}, change).protocol()
    decoder = FrameDecoder(protocol, from_sensor=True)
    with path.open("rb") as file:
        pieces = [*decoder.feed(file.read(_LOOKED_AT_BYTES)), *decoder.finish()]
    if not any(isinstance(piece, Frame) for piece in pieces):
        raise _no_frame(path, protocol.name)


def _no_frame(path: Path, protocol: str) -> UsageError:
    size = path.stat().st_size
    return UsageError(
        f"{path}: {size:,} bytes, no valid frame of {protocol}; find the protocol: gse decode --try {path}"
    )


_CAPTURED = Port(url="replay://")
"""Port of what this program did not record: a raw capture, a session without its head or, as no Earth orientation is
frozen in it, one that somebody made of images. The simulated port of a station file that names none is not its port."""


@dataclass(frozen=True, slots=True)
class StationInForce:
    """The station of a replay with its text, and the protocol's description where that is the session's own.

    ``keeps_identifier`` where the identifier under test is that of the session.
    """

    station: Station
    text: str
    protocol_text: str | None
    keeps_identifier: bool

    def protocol(self) -> Protocol:
        """The wire format: by the session's own description, or as the station file names it."""
        if self.protocol_text is None:
            return load_protocol(self.station.protocol)
        return parse_protocol(self.protocol_text, "the session's protocol.yaml")


def station_in_force(
    attachments: Mapping[str, str], change: Callable[[StationText], StationText], *, needs_catalog: bool = True
) -> StationInForce:
    """The session's own station, or the built-in one, after ``change``; UsageError where only the session names a file
    that is needed."""
    text = attachments.get(STATION, BUILT_IN_TEXT)
    frozen = sealed(parse_recorded(text))
    station, text = change((frozen, text))
    protocol_text = attachments.get(PROTOCOL) if station.protocol == frozen.protocol else None
    keeps_identifier = station.identifier.facts() == frozen.identifier.facts()
    is_own = STATION in attachments and EARTH_ORIENTATION in attachments and stated_start_ns(attachments) is None
    if not is_own and (text == BUILT_IN_TEXT or "port" not in station.model_fields_set):
        station = station.model_copy(update={"port": _CAPTURED})
    station = unsealed(station, has_protocol=protocol_text is not None, needs_catalog=needs_catalog)
    return StationInForce(station, text, protocol_text, keeps_identifier)


def _loop(
    path: Path,
    recorded: Recorded | None,
    options: ReplayOptions,
    change: Callable[[StationText], StationText],
    utc_ns: int | None,
    tell: Callable[[str], None],
) -> StationLoop:
    attachments, given = recorded.attachments if recorded else {}, options.given_orientation
    force = station_in_force(attachments, change)
    program = read_identity(attachments.get(IDENTIFIER))
    answers = RecordedAnswers(path, program) if names_program(force.station) else None
    setup = set_up(
        force.station,
        force.text,
        utc_ns=utc_ns,
        protocol=force.protocol(),
        recorded_answers=answers,
        tell=tell,
    )
    loop = StationLoop(
        setup,
        earth_orientation=None if given else _frozen_orientation(attachments.get(EARTH_ORIENTATION)),
        given_orientation=given,
        anchor_utc_ns=stated_start_ns(attachments) if recorded else options.anchor_utc_ns,
        # A raw capture has no recorded times, another identifier none of its own; those of this host would make reports
        # differ.
        recorded=recorded.timings if recorded and force.keeps_identifier else RecordedTimings(),
    )
    loop.session.clock_error_s = _stated_clock_error_s(attachments.get(STATED))
    if recorded and STATION not in attachments and force.text == BUILT_IN_TEXT:
        loop.on_event(LinkEvent(utc_ns or 0, 0, StationKind.NO_STATION, _NO_STATION))
    if force.station.refusal:
        note = f"read as it was when it was recorded; a new station file is refused: {force.station.refusal}"
        loop.on_event(LinkEvent(utc_ns or 0, 0, StationKind.OLD_STATION, note))
    for shown in recorded.shown if recorded else ():
        loop.session.shown.add(shown)
    loop.session.power += recorded.power if recorded else []
    for reading in recorded.clock if recorded else ():
        loop.read_clock(reading)
    return loop


def _stated_clock_error_s(text: str | None) -> float | None:
    """Statements of the operator from the recording; empty where they cannot be read."""
    try:
        seconds = float(json.loads(text or "null")["clock_error_s"])
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None
    return seconds if 0 <= seconds < math.inf else None


def _frozen_orientation(text: str | None) -> EarthOrientation | None:
    if text is None:
        return None
    try:
        return EarthOrientation.from_json(text)
    except TruthError as error:
        raise CaptureError(f"the session's {EARTH_ORIENTATION} cannot be read: {error}") from error


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
    recorded = _recorded(path, options, change)
    attachments = recorded.attachments if recorded else {}
    force = station_in_force(attachments, change, needs_catalog=needs_catalog)
    if recorded and STATION not in attachments and force.text == BUILT_IN_TEXT:
        raise UsageError(
            f"{path} has no station file: it is not a session of gse, or its head is damaged; give one by --station, "
            "which 'gse replay', 'gse calibrate' and 'gse align' take"
        )
    return Recording(
        path,
        options,
        force.station,
        force.text,
        force.protocol(),
        _frozen_orientation(attachments.get(EARTH_ORIENTATION)),
        damaged=recorded is not None and recorded.damaged,
        anchor_utc_ns=stated_start_ns(attachments) if recorded else options.anchor_utc_ns,
        shown=tuple(recorded.shown) if recorded else (),
    )
