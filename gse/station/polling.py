"""Requests that were sent to a sensor, and which of them it answered: what a recording shows, live or replayed."""

from collections import deque
from collections.abc import Sequence

from drivers.chunk import LinkEvent
from gse.config.station import PollOptions, Port, Sensor, StartOptions
from gse.errors import UsageError
from gse.station.events import StationKind
from gse.station.results import LinkCounters
from protocols import Command, EncodeError, Frame, FrameDecoder, PanoramaMessage, Protocol

START, REQUEST, STOP, SET_EXPOSURE = "START", "REQUEST", "STOP", "SET_EXPOSURE"
"""Commands that the station sends by itself, as a station file has it asked."""

IN_A_ROW = 3
"""Requests without an answer that are an event; one alone is a missing frame."""
_MOST_SENT = 64
"""Commands that an echo is compared with: an echo comes at once."""


class Polling:
    """Follows what is sent and what comes; ``timeout_ns`` after a request its answer is late, None where none is asked.

    A request is unanswered when the next one is sent before an answer came. A panorama that comes without a request is
    the late answer to an unanswered one, if there is any, else it is unasked.
    """

    def __init__(self, protocol: Protocol, counters: LinkCounters, timeout_ns: int | None) -> None:
        self._protocol, self._counters, self._timeout_ns = protocol, counters, timeout_ns
        self._sent: deque[bytes] = deque(maxlen=_MOST_SENT)
        self._pending_ns: int | None = None
        self._in_a_row = 0
        self._owed = 0
        self._foreign_told = False

    def sent(self, event: LinkEvent) -> list[LinkEvent]:
        """Bytes that the station sent, in hexadecimal digits as a LinkEvent has them; the events that they bring."""
        data = bytes.fromhex(event.text)
        self._sent.append(data)
        decoder = FrameDecoder(self._protocol, from_sensor=False)
        found = [*decoder.feed(data), *decoder.finish()]
        asked = sum(isinstance(item, Frame) and item.type == REQUEST for item in found)
        if self._timeout_ns is None or not asked:
            return []
        self._counters.requests += asked
        unanswered = self._pending_ns is not None
        self._pending_ns = event.mono_ns
        if not unanswered:
            self._in_a_row = 0
            return []
        self._counters.unanswered += 1
        self._owed += 1
        self._in_a_row += 1
        if self._in_a_row != IN_A_ROW:
            return []
        text = (
            f"{IN_A_ROW} requests in a row were not answered: check the sensor's power, the cable to it, and "
            "sensor.poll.timeout_ms; one that answers other commands may be in a mode that refuses REQUEST"
        )
        return [LinkEvent(event.utc_ns, event.mono_ns, StationKind.UNANSWERED, text)]

    def answered(self, mono_ns: int) -> None:
        """A panorama came."""
        if self._timeout_ns is None or not self._counters.requests:
            return
        if self._pending_ns is not None:
            self._counters.late_answers += mono_ns - self._pending_ns > self._timeout_ns
            self._pending_ns = None
        elif self._owed:
            self._owed -= 1
            self._counters.unanswered -= 1
            self._counters.late_answers += 1
        else:
            self._counters.unasked += 1

    def echoed(self, data: bytes, utc_ns: int, mono_ns: int) -> list[LinkEvent]:
        """A whole command came; the event, once, where this station did not send it."""
        if self._foreign_told or any(data in sent or sent in data for sent in self._sent):
            return []
        self._foreign_told = True
        text = f"a command came that this station did not send ({data[:24].hex(' ').upper()}): a second master is there"
        return [LinkEvent(utc_ns, mono_ns, StationKind.SECOND_MASTER, text)]


def check_asking(sensor: Sensor, port: Port, protocol: Protocol) -> None:
    """UsageError where the protocol has no such command, or the line is too slow for it."""
    _check_exposures(sensor.exposures_s or (), protocol)
    options = sensor.start or sensor.poll
    if options is None:
        return
    key = "start" if isinstance(options, StartOptions) else "poll"
    try:
        asked = protocol.encode(asking_command(protocol, options), 0)
    except EncodeError as error:
        raise UsageError(f"sensor.{key}: {error}") from error
    if options.period_ms == "asap" or not protocol.panoramas:
        return
    needed_ms = (
        (len(asked) * (key == "poll") + _smallest_answer(protocol)) * 1000 * port.line.bits_per_byte / port.baudrate
    )
    if float(options.period_ms) < needed_ms:
        raise UsageError(
            f"sensor.{key}.period_ms is {options.period_ms:g}: one answer takes {needed_ms:.1f} ms on the line at "
            f"{port.baudrate} baud; give a longer period{', or `asap`' if key == 'poll' else ''}"
        )


def _check_exposures(exposures_s: Sequence[float], protocol: Protocol) -> None:
    if not exposures_s:
        return
    command, panoramas = protocol.commands.get(SET_EXPOSURE), protocol.panoramas
    if command is None:
        raise UsageError(
            f"sensor.exposures_s: the description {protocol.name} has no command {SET_EXPOSURE}; describe it, or leave "
            "exposures_s out"
        )
    if panoramas is None or all(of.name != "exposure" for of in panoramas.layout.fields):
        raise UsageError(
            f"sensor.exposures_s: the panoramas of {protocol.name} have no exposure, so nothing shows when a new one "
            "is in force; leave exposures_s out"
        )
    for exposure_s in exposures_s:
        try:
            protocol.encode(command.made(exposure=f"{exposure_s:g} s"), 0)
        except EncodeError as error:
            raise UsageError(f"sensor.exposures_s: {exposure_s:g} s does not work: {error}") from error


def asking_command(protocol: Protocol, options: StartOptions | PollOptions) -> Command:
    """The command that a sensor is asked with: START, with its period where the protocol has one, or REQUEST."""
    if not isinstance(options, StartOptions) or START not in protocol.commands:
        return Command(REQUEST if not isinstance(options, StartOptions) else START)
    start = protocol.commands[START]
    period = {"period": f"{options.period_ms} ms"} if any(of.name == "period" for of in start.arguments) else {}
    return start.made(**period)


def _smallest_answer(protocol: Protocol) -> int:
    assert protocol.panoramas is not None
    empty = PanoramaMessage.empty()
    return len(protocol.encode(empty, 0))
