"""The sensor's computer: exposures, clock, sequence numbers, commands; without a port or a clock of its own.

Time is given by the caller: ``due_ns`` is the instant of the next action, ``step`` takes it, ``command`` takes the
bytes of the wire. A frame is sent as soon as its exposure ends and the wire is free; an exposure whose frame would have
to wait longer than a period is not sent, and its number is missing.
"""

import contextlib
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Protocol as Interface

import numpy as np
from numpy.typing import NDArray

from drivers.uart import BITS_PER_BYTE
from gse.simulator.items import SimulatedItems
from gse.simulator.own_answers import OwnAnswers
from gse.simulator.panorama import OVEREXPOSED, Exposure
from gse.simulator.scenario import Firmware as Traits
from gse.simulator.scenario import profile_at
from gse.values.instant import LAST_NS, NS_PER_S
from gse.values.sensor_time import tag_us_of, to_middle_us
from protocols import (
    AttitudeMessage,
    Command,
    Discard,
    EncodeError,
    Frame,
    FrameDecoder,
    Message,
    Nak,
    PanoramaMessage,
    Protocol,
    StarsMessage,
    StatusMessage,
)
from protocols.description import TimeDescription
from protocols.protocol import name_of
from protocols.vocabulary import quantity

_ANSWER_NS = 1_000_000
"""Time to answer a command."""
_SHORTEST_EXPOSURE_S, _LONGEST_EXPOSURE_S = 0.001, 2.0
_LONGEST_PERIOD_S = 3600.0
_USUAL_PERIOD_S = 0.1
CLOCK_RESET = "clock reset"
"""The status bit, in the words of the protocols."""
_COUNTERS_WRAP_AT = 65536
_SLOWEST_BOOT = 1.005
_VERSION = (1, 2, 0)
_SERIAL = 14014
_TEST_STATUS_EVERY_S = 10.0
"""Whoever opens the port late learns so soon that no sensor is there."""
_NAK_REASONS = {"bad crc": "bad CRC", "unknown type": "unknown", "bad length": "bad length"}


class Detector(Interface):
    """Source of exposures."""

    def expose(self, middle_utc_ns: int, exposure_s: float, temperature_c: float) -> Exposure:
        """One exposure, by its middle."""
        ...

    def stars_at(self, utc_ns: int, xy_px: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The numbers (N,) of the stars of its objects (N, 2), 0 of what is none, and their residuals in arcsec."""
        ...


@dataclass(frozen=True, slots=True)
class Transmission:
    """Bytes on the wire, and when their first bit leaves the sensor."""

    start_ns: int
    data: bytes


class SensorFirmware:
    """A star sensor from power-on; ``start_ns`` is when the scenario begins, UTC."""

    def __init__(
        self,
        protocol: Protocol,
        detector: Detector,
        traits: Traits,
        random: np.random.Generator,
        *,
        start_ns: int,
        exposure_s: float,
        period_s: float | None,
        baudrate: int,
        own_answers: OwnAnswers | None = None,
        is_test: bool = False,
        time: TimeDescription | None = None,
    ) -> None:
        """``period_s`` is that of the panoramas that come from power-on, None for a sensor that waits for START.

        With ``own_answers`` each exposure is answered by the sensor itself too, or only so where the protocol has no
        panoramas. A stream that ``is_test`` says in each frame that it comes from no detector; in a format without a
        flag for it, STATUS says so, by the serial number 0, as soon as the sensor is ready.
        """
        self._items = SimulatedItems(protocol, traits)
        self._header_flags = protocol.test_flag if is_test else 0
        self._says_by_status = is_test and not protocol.test_flag
        self._protocol, self._detector, self._traits, self._random = protocol, detector, traits, random
        self._flags = _sayable_flags(protocol)
        self._own_answers = own_answers
        self._time = time or protocol.time
        self._first_exposure_s, self._first_period_s = exposure_s, period_s
        self._byte_ns = BITS_PER_BYTE * NS_PER_S // baudrate
        self._resets_ns = [start_ns + round(second * NS_PER_S) for second in sorted(traits.resets_s)]
        self._line_free_ns = start_ns
        power_on_ns = start_ns - round(traits.powered_before_start_s * NS_PER_S)
        self._power_on(power_on_ns, max(start_ns, power_on_ns + round(traits.boot_s * NS_PER_S)))
        self._clock_was_reset = False

    def _power_on(self, power_on_ns: int, ready_ns: int) -> None:
        self._power_on_ns = power_on_ns
        self._exposure_s, self._period_s = self._first_exposure_s, self._first_period_s
        self._next_start_ns = ready_ns if self._period_s is not None else None
        self._frame_no = self._frames_sent = self._commands_ok = self._commands_bad = 0
        self._sequence: dict[str, int] = {}
        self._clock_was_reset = True
        self._ready_ns = ready_ns
        first_s = 0.0 if self._says_by_status else self._traits.status_every_s or 0.0
        self._status_due_ns = ready_ns + round(first_s * NS_PER_S)
        self._decoder = FrameDecoder(self._protocol, from_sensor=False, echoes=True)
        self._refused_at = -1
        self._processed: deque[tuple[int, AttitudeMessage]] = deque()
        self._items.power_on(power_on_ns)
        self._items_due_ns = dict.fromkeys(self._items.every_s, ready_ns)
        self._late: list[tuple[int, Command, int]] = []

    def switch(self, utc_ns: int, *, on: bool) -> None:
        """Switch its supply: off it says nothing, on it starts anew."""
        self._resets_ns = [reset_ns for reset_ns in self._resets_ns if reset_ns > utc_ns]
        boot_ns = self._boot_ns()
        self._power_on(utc_ns, utc_ns + boot_ns if on else LAST_NS)
        if not on:
            self._next_start_ns = None

    def _boot_ns(self) -> int:
        """How long this start takes: no two take the same time to the microsecond."""
        return round(self._traits.boot_s * float(self._random.uniform(1, _SLOWEST_BOOT)) * NS_PER_S)

    @property
    def due_ns(self) -> int | None:
        """Instant of the next action; None while the sensor only waits for commands."""
        dues = [*self._resets_ns[:1], *(ready_ns for ready_ns, _ in list(self._processed)[:1])]
        dues += [due_ns for due_ns, _, _ in self._late]
        dues += self._items_due_ns.values()
        if self._next_start_ns is not None:
            dues.append(self._next_start_ns + self._exposure_ns)
        return min(dues, default=None)

    def bytes_per_s(self, seen: Exposure) -> float:
        """What it has to send in a second, beside STATUS, where each panorama has the objects of this exposure."""
        if self._period_s is None:
            return 0.0
        protocol, slots = self._protocol, self._protocol.slots
        names = [] if self._own_answers is None else ["ATTITUDE"]
        each = sum(len(protocol.encode_payload(name, protocol.blank(name), 0)) for name in names)
        if slots:
            panorama = replace(PanoramaMessage.empty(), xy_px=seen.xy_px[:slots], index=seen.index[:slots])
            each += len(protocol.encode(panorama, 0))
        items_per_s = sum(
            len(protocol.encode_payload(name, protocol.blank(name), 0)) / every_s
            for name, every_s in self._items.every_s.items()
        )
        return each / max(self._period_s, self._exposure_s) + items_per_s

    def miss(self, until_ns: int) -> None:
        """Leave out the exposures that end before an instant, which nobody was there to make; their numbers miss."""
        if self._next_start_ns is None or self._period_s is None:
            return
        period_ns = max(round(self._period_s * NS_PER_S), self._exposure_ns)
        missed = max(-(-(until_ns - self._next_start_ns - self._exposure_ns) // period_ns), 0)
        self._next_start_ns += missed * period_ns
        self._frame_no += missed

    def step(self) -> list[Transmission]:
        """Take the next action."""
        due_ns = self.due_ns
        if due_ns is None:
            return []
        if self._resets_ns and due_ns == self._resets_ns[0]:
            del self._resets_ns[0]
            self._power_on(due_ns, due_ns + self._boot_ns())
            return []
        if self._late and due_ns == min(self._late, key=itemgetter(0))[0]:
            late = min(self._late, key=itemgetter(0))
            self._late.remove(late)
            return self._said(self._done(late[1], late[2], due_ns), due_ns)
        if names := [name for name, item_ns in self._items_due_ns.items() if item_ns == due_ns]:
            self._items_due_ns |= {name: due_ns + round(self._items.every_s[name] * NS_PER_S) for name in names}
            return [self._send(self._items.message(name), due_ns) for name in names]
        if self._processed and due_ns == self._processed[0][0]:
            ready_ns, message = self._processed.popleft()
            return [self._send(message, ready_ns)]
        return self._expose()

    def command(self, data: bytes, utc_ns: int) -> list[Transmission]:
        """Bytes that came from the station."""
        if utc_ns < self._ready_ns:
            return []
        sent = [Transmission(utc_ns, data)] if self._traits.answers.echoes else []
        pieces = self._decoder.feed(data)
        for piece in (*pieces, self._decoder.refused):
            answers = self._obey(piece, utc_ns) if isinstance(piece, Frame) else self._refuse_bytes(piece)
            sent += self._said(answers, utc_ns + _ANSWER_NS)
        return sent

    def _said(self, answers: Iterator[Message], ready_ns: int) -> list[Transmission]:
        """Answers on the wire; a protocol without ACK or STATUS makes a sensor that does not answer."""
        sent = []
        for answer in answers:
            with contextlib.suppress(EncodeError):
                sent.append(self._send(answer, ready_ns))
        return sent

    @property
    def _exposure_ns(self) -> int:
        return round(self._exposure_s * NS_PER_S)

    def _expose(self) -> list[Transmission]:
        assert self._next_start_ns is not None
        start_ns, exposure_ns = self._next_start_ns, self._exposure_ns
        end_ns, middle_ns = start_ns + exposure_ns, start_ns + exposure_ns // 2
        number = self._frame_no
        self._frame_no += 1
        if self._period_s is None:
            self._next_start_ns = None
        else:
            self._next_start_ns = start_ns + max(round(self._period_s * NS_PER_S), exposure_ns)
            if self._line_free_ns > end_ns + round(self._period_s * NS_PER_S):
                return []
        if self._own_answers is not None:
            answer = self._own_answers.message(middle_ns, self._clock_us(middle_ns), number)
            self._processed.append((end_ns + self._own_answers.processing_ns, answer))
        if not self._protocol.slots:
            self._frames_sent += 1
            return []
        temperature_c = self._temperature_c(middle_ns)
        seen = self._detector.expose(middle_ns, self._exposure_s, temperature_c)
        flags = seen.flags | ({CLOCK_RESET} if self._clock_was_reset else set())
        self._clock_was_reset = False
        slots, delay_s = self._protocol.slots, self._traits.delay_ms / 1000
        message = PanoramaMessage(
            time_us=self._clock_us(middle_ns) - to_middle_us(self._time, self._exposure_s, delay_s),
            frame_no=number,
            exposure_s=self._exposure_s,
            flags=flags & self._flags,
            temperature_c=temperature_c,
            xy_px=seen.xy_px[:slots],
            index=seen.index[:slots],
            processing_s=delay_s,
        )
        self._frames_sent += 1
        ready_ns = end_ns + round(self._traits.delay_ms * 1e6)
        is_asked = self._period_s is None
        sent = self._answers(message, ready_ns) if is_asked else [self._send(message, ready_ns)]
        if sent and self._protocol.stars is not None:
            sent += self._said(self._names(message, middle_ns), ready_ns)
        return [*sent, *self._due_status(ready_ns, temperature_c)]

    def _names(self, panorama: PanoramaMessage, middle_ns: int) -> Iterator[StarsMessage]:
        """The list of the stars of a panorama."""
        assert self._protocol.stars is not None
        ids, residuals_arcsec = self._detector.stars_at(middle_ns, panorama.xy_px)
        objects = np.flatnonzero(ids)[: self._protocol.stars.most]
        names = [self._protocol.stars.number_of(star) for star in ids[objects].tolist()]
        share = self._traits.swapped_names
        if share and self._random.random() < share:
            names[:2] = names[1::-1]
        yield StarsMessage(
            panorama.time_us,
            panorama.frame_no,
            tuple(objects.tolist()),
            tuple(names),
            tuple(residuals_arcsec[objects].tolist()),
        )

    def _answers(self, message: Message, ready_ns: int) -> list[Transmission]:
        """The answers to a request, as the scenario spoils them."""
        traits = self._traits.answers
        chances = (traits.never, traits.twice, traits.late, traits.foreign)
        if not any(chances):
            return [self._send(message, ready_ns)]
        never, twice, late, foreign = (self._random.random() < chance for chance in chances)
        ready_ns += round(traits.late_ms * 1e6) if late else 0
        sent = []
        if foreign and self._protocol.frame_layout.addresses is not None:
            other = self._protocol.with_addresses(self._protocol.frame_layout.addresses.sensor + 1, None)
            data = other.encode(message, 0)
            sent.append(Transmission(ready_ns, data))
            self._line_free_ns = max(self._line_free_ns, ready_ns + len(data) * self._byte_ns)
        sent += [] if never else [self._send(message, ready_ns)]
        return sent + ([Transmission(self._line_free_ns, sent[-1].data)] if twice and sent else [])

    def _due_status(self, utc_ns: int, temperature_c: float) -> list[Transmission]:
        """The STATUS frame that follows a panorama, where one is due and the protocol has it."""
        every_s = _TEST_STATUS_EVERY_S if self._says_by_status else self._traits.status_every_s
        if every_s is None or utc_ns < self._status_due_ns:
            return []
        self._status_due_ns = utc_ns + round(every_s * NS_PER_S)
        with contextlib.suppress(EncodeError):
            return [self._send(self._status(utc_ns, temperature_c), utc_ns)]
        return []

    def _obey(self, frame: Frame, utc_ns: int) -> Iterator[Message]:
        command = self._protocol.decode(frame)
        if not isinstance(command, Command):
            yield self._refuse(frame.type, "unknown", frame.sequence)
            return
        sequence = max(frame.sequence, 0)
        fault = self._items.fault_of(command)
        if not self._is_in_range(command, self._asked_s(command)):
            yield self._refuse(frame.type, "out of range", frame.sequence)
        elif fault is None:
            yield from self._done(command, sequence, utc_ns)
        elif fault.fault == "nak":
            yield self._refuse(frame.type, "", sequence)
        elif fault.fault == "late":
            self._late.append((utc_ns + round(fault.late_s * NS_PER_S), command, sequence))
        elif fault.fault == "wrong":
            self._items.obey(command, wrongly=True)
            yield from self._items.wrong_answers(command, sequence)

    def _done(self, command: Command, sequence: int, utc_ns: int) -> Iterator[Message]:
        """Do what a command says; what proves it."""
        asked_s = self._asked_s(command)
        self._commands_ok = (self._commands_ok + 1) % _COUNTERS_WRAP_AT
        self._items.obey(command)
        match command.name:
            case "START":
                self._period_s = asked_s
                self._next_start_ns = max(utc_ns, self._next_start_ns or 0)
            case "STOP":
                self._period_s = self._next_start_ns = None
            case "REQUEST":
                self._next_start_ns = self._next_start_ns or utc_ns
            case "SET_EXPOSURE":
                self._exposure_s = asked_s
        if "STATUS" in self._items.proofs(command):
            yield self._status(utc_ns, self._temperature_c(utc_ns))
        yield from self._items.answers(command, sequence)

    def _asked_s(self, command: Command) -> float:
        """The period in START, the exposure in SET_EXPOSURE; the sensor's own where the protocol does not say it."""
        for argument in self._protocol.commands[command.name].arguments:
            if argument.name in ("period", "exposure") and argument.unit:
                return quantity(f"{command.arguments[argument.name]} {argument.unit}", "s")
        own_s = self._first_period_s or max(_USUAL_PERIOD_S, self._exposure_s)
        return own_s if command.name == "START" else self._exposure_s

    def _is_in_range(self, command: Command, asked_s: float) -> bool:
        """Whether the description's range has its arguments, and this sensor can do it."""
        try:
            self._protocol.commands[command.name].made(**command.arguments)
        except EncodeError:
            return False
        if command.name == "START":
            return self._exposure_s <= asked_s <= _LONGEST_PERIOD_S
        return command.name != "SET_EXPOSURE" or _SHORTEST_EXPOSURE_S <= asked_s <= _LONGEST_EXPOSURE_S

    def _refuse_bytes(self, discard: Discard | None) -> Iterator[Message]:
        """NAK, once, for what began as a frame; garbage between frames is not answered."""
        if discard is None or discard.start <= self._refused_at:
            return
        self._refused_at = discard.start
        if discard.reason == "echo":
            # Of its own frames: an answer would be echoed too, for ever.
            self._commands_bad = (self._commands_bad + 1) % _COUNTERS_WRAP_AT
        layout = self._protocol.frame_layout
        reason, offset = _NAK_REASONS.get(discard.reason), len(layout.sync_word)
        if reason and offset and len(discard.data) >= offset + layout.header.size:
            code, _, _, sequence = layout.header.read(discard.data, offset)
            yield self._refuse(f"value {code}", reason, sequence)

    def _refuse(self, command: str, reason: str, sequence: int) -> Nak:
        self._commands_bad = (self._commands_bad + 1) % _COUNTERS_WRAP_AT
        return self._items.refusal(command, sequence, reason)

    def _send(self, message: Message, ready_ns: int) -> Transmission:
        protocol = self._protocol
        counter = name_of(message) if protocol.counts_each_message else ""
        sequence = self._sequence.get(counter, 0)
        items = self._items.values(ready_ns) if name_of(message) in self._items.carriers else {}
        data = protocol.encode(message, sequence, self._header_flags, items)
        steps = protocol.frames_of(message) * protocol.sequence_step
        self._sequence[counter] = (sequence + steps) % (protocol.sequence_modulus or 1)
        start_ns = max(ready_ns, self._line_free_ns)
        self._line_free_ns = start_ns + len(data) * self._byte_ns
        return Transmission(start_ns, data)

    def _status(self, utc_ns: int, temperature_c: float) -> StatusMessage:
        return StatusMessage(
            time_us=self._clock_us(utc_ns),
            frames_taken=self._frame_no,
            frames_sent=self._frames_sent,
            commands_ok=self._commands_ok,
            commands_bad=self._commands_bad,
            temperature_c=temperature_c,
            supply_v=profile_at(self._traits.supply_v, (utc_ns - self._power_on_ns) / NS_PER_S),
            mode="standby" if self._period_s is None else "streaming",
            firmware=_VERSION,
            serial=0 if self._says_by_status else _SERIAL,
        )

    def _clock_us(self, utc_ns: int) -> int:
        if self._time.is_absolute:
            return tag_us_of(utc_ns, self._time)
        since_ns = utc_ns - self._power_on_ns
        return (since_ns + round(since_ns * self._traits.clock_drift_ppm * 1e-6)) // 1000

    def _temperature_c(self, utc_ns: int) -> float:
        cold, warm = self._traits.temperature_c
        powered_s = (utc_ns - self._power_on_ns) / NS_PER_S
        return (
            warm + (cold - warm) * math.exp(-powered_s / self._traits.warm_up_s) + float(self._random.normal(0, 0.02))
        )


def _sayable_flags(protocol: Protocol) -> frozenset[str]:
    """The status bits that the protocol has; other sensors have others, or none."""
    sayable = set()
    for flag in (OVEREXPOSED, CLOCK_RESET):
        message = PanoramaMessage(
            time_us=0,
            frame_no=0,
            exposure_s=0.05,
            flags=frozenset({flag}),
            temperature_c=20.0,
            xy_px=np.empty((0, 2)),
            index=np.empty(0),
        )
        with contextlib.suppress(EncodeError):
            protocol.encode(message, 0)
            sayable.add(flag)
    return frozenset(sayable)
