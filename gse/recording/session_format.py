"""Content of a recorded session besides the bytes: events, clock readings, timings, attachments."""

import json
import math
from array import array
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from drivers.clock import ClockReading
from drivers.outside_text import plain_line
from drivers.session_file.reader import read_capture
from drivers.session_file.records import CLOCK, Attachment, Damage, RecordedMessage
from gse.values.instant import LAST_NS
from gse.values.screen import Shown

# Kinds of events of the recorder.


class RecorderKind(StrEnum):
    """Events of writing the session file."""

    BEHIND = "RECORDER_BEHIND"
    REFUSED = "RECORDER_REFUSED"
    RECOVERED = "RECORDER_RECOVERED"
    LOST = "RECORDER_LOST"
    UNSAFE = "RECORDER_UNSAFE"
    SEGMENT = "RECORDER_SEGMENT"
    UNFINISHED = "RECORDER_UNFINISHED"
    UNCOMPRESSED = "RECORDER_UNCOMPRESSED"
    FILE_RESTORED = "FILE_RESTORED"
    FILE_DAMAGED = "FILE_DAMAGED"


STATION = "station.yaml"
PROTOCOL = "protocol.yaml"
PROCEDURE = "procedure.yaml"
"""The procedure file of a run, for people: the events of the run say what was done."""
EARTH_ORIENTATION = "earth_orientation.json"
STATED = "stated.json"
"""Statements of the operator for the session: {"clock_error_s": 0.1}."""
IDENTIFIER = "identifier.json"
"""What an external identifier is: name, version and hashes, schema gse.identifier/1."""
TIMING_TOPIC = "/gse/timing"
ANSWER_TOPIC = "/gse/answer"
"""What an external identifier gave for each panorama; its stderr is on LOG_TOPIC."""
LOG_TOPIC = "/gse/identifier/stderr"
SCREEN_TOPIC = "/screen"
"""What a screen before the sensor showed from which instant on."""
POWER_TOPIC = "/power"
"""Voltage and current of the sensor's supply, as the operator's switch reads them."""
MOST_READINGS = 100_000
"""Readings of the supply that are kept: one a second for a day."""
MOST_SHOWN = 100_000
"""Attitudes of a screen that are read: one a second for a day."""
MOST_KINDS = 100
"""Most different kinds of events; this station has some forty."""
OTHER = "OTHER"
MOST_CLOCK_READINGS = 50_000
"""One a minute for a month."""
_KNOWN = (STATION, PROTOCOL, PROCEDURE, EARTH_ORIENTATION, STATED, IDENTIFIER)
_RENEWED = (EARTH_ORIENTATION, IDENTIFIER)
"""Attached again where they change: the clock was put right; a program said its version with its first answer."""
_SEARCH_AHEAD = 1000
"""Most missing timings between two frames; further ones end the search."""


class RecordedTimings:
    """Identification times of the live run, in the order of its panoramas."""

    def __init__(self) -> None:
        self._time_us = array("Q")
        self._elapsed_us = array("d")
        self._next = 0

    def add(self, time_us: int, elapsed_us: float) -> None:
        """Append a timing."""
        self._time_us.append(time_us)
        self._elapsed_us.append(elapsed_us)

    def take(self, time_us: int) -> float | None:
        """The identification time of the next panorama with this time tag."""
        for place in range(self._next, min(self._next + _SEARCH_AHEAD, len(self._time_us))):
            if self._time_us[place] == time_us:
                self._next = place + 1
                return self._elapsed_us[place]
        return None


@dataclass(frozen=True, slots=True)
class PowerReading:
    """One reading of the sensor's supply by its switch; ``volts`` is NaN where that reads the current alone."""

    utc_ns: int
    amperes: float
    volts: float = math.nan


@dataclass(slots=True)
class Recorded:
    """Content of a session file besides bytes and events.

    ``damaged``: a part of it is not a valid record, or its end or a segment is missing.
    """

    attachments: dict[str, str] = field(default_factory=dict)
    clock: list[ClockReading] = field(default_factory=list)
    timings: RecordedTimings = field(default_factory=RecordedTimings)
    shown: list[Shown] = field(default_factory=list)
    power: list[PowerReading] = field(default_factory=list)
    damaged: bool = False


def read_recorded(path: Path) -> Recorded:
    """Read the content besides bytes and events; CaptureError where the file is missing or is not a session."""
    recorded = Recorded()
    capture = read_capture(path, only=(CLOCK, TIMING_TOPIC, SCREEN_TOPIC, POWER_TOPIC))
    for record in capture:
        if isinstance(record, Damage):
            recorded.damaged = True
        elif isinstance(record, Attachment):
            _attach(recorded.attachments, record)
        elif (
            isinstance(record, RecordedMessage) and record.topic == CLOCK and len(recorded.clock) < MOST_CLOCK_READINGS
        ):
            recorded.clock += _clock_reading(record)
        elif isinstance(record, RecordedMessage) and record.topic == TIMING_TOPIC:
            _add_timing(recorded.timings, record)
        elif isinstance(record, RecordedMessage) and record.topic == SCREEN_TOPIC and len(recorded.shown) < MOST_SHOWN:
            recorded.shown += _shown(record)
        elif (
            isinstance(record, RecordedMessage) and record.topic == POWER_TOPIC and len(recorded.power) < MOST_READINGS
        ):
            recorded.power += _power(record)
    recorded.damaged |= capture.truncated
    return recorded


def read_attachments(path: Path) -> dict[str, str]:
    """The attachments alone, without unpacking the data of a closed session; CaptureError as ``read_recorded``."""
    attachments: dict[str, str] = {}
    for record in read_capture(path, from_utc_ns=LAST_NS, only=()):
        if isinstance(record, Attachment):
            _attach(attachments, record)
    return attachments


def _attach(attachments: dict[str, str], record: Attachment) -> None:
    if record.name not in _KNOWN:
        return
    if record.name in _RENEWED:
        attachments[record.name] = record.data.decode("utf-8", "replace")
    attachments.setdefault(record.name, record.data.decode("utf-8", "replace"))


def timing_json(time_us: int, elapsed_us: float) -> bytes:
    """The message of /gse/timing for one panorama."""
    return json.dumps({"time_us": time_us, "elapsed_us": elapsed_us}).encode()


def clock_json(reading: ClockReading) -> bytes:
    """The message of /clock for one reading."""
    return json.dumps({name: getattr(reading, name) for name in ClockReading.__slots__}).encode()


def shown_json(shown: Shown) -> bytes:
    """The message of /screen for what is shown from an instant on."""
    return json.dumps(asdict(shown)).encode()


def power_json(reading: PowerReading) -> bytes:
    """The message of /power for one reading."""
    volts = None if math.isnan(reading.volts) else reading.volts
    return json.dumps({"utc_ns": reading.utc_ns, "amperes": reading.amperes, "volts": volts}).encode()


def _power(message: RecordedMessage) -> list[PowerReading]:
    try:
        document = json.loads(message.data)
        volts = math.nan if document["volts"] is None else _finite(document["volts"])
        return [PowerReading(_instant_ns(document["utc_ns"]), _finite(document["amperes"]), volts)]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return []


def _shown(message: RecordedMessage) -> list[Shown]:
    try:
        document = json.loads(message.data)
        x, y, z = (_finite(rate) for rate in document["turn_deg_per_s"])
        ra, de, roll = (_finite(document[name]) for name in ("ra_deg", "de_deg", "roll_deg"))
        return [Shown(_instant_ns(document["from_ns"]), ra, de, roll, (x, y, z), _finite(document["within_ms"]))]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return []


def _add_timing(timings: RecordedTimings, message: RecordedMessage) -> None:
    try:
        document = json.loads(message.data)
        timings.add(int(document["time_us"]), _finite(document["elapsed_us"]))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return


def _instant_ns(value: Any) -> int:
    if not 0 <= int(value) <= LAST_NS:
        raise ValueError
    return int(value)


def _finite(value: Any) -> float:
    if not math.isfinite(float(value)):
        raise ValueError
    return float(value)


def _clock_reading(message: RecordedMessage) -> list[ClockReading]:
    try:
        document = json.loads(message.data)
        return [
            ClockReading(
                utc_ns=_instant_ns(document["utc_ns"]),
                mono_ns=_instant_ns(document["mono_ns"]),
                source=plain_line(str(document["source"])),
                synchronised=bool(document["synchronised"]),
                offset_s=_finite(document["offset_s"]),
                error_bound_s=_finite(document["error_bound_s"]),
            )
        ]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return []
