"""Commands to the sensor in the words of its protocol: sent, repeated where no answer comes, recorded.

The formats of command and answer belong to the protocol. Times are those of the link: the host's for a live port, the
data's for a simulated one.
"""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from drivers.chunk import LinkEvent
from drivers.clock import read_clock
from drivers.errors import CommandError, DriverError
from drivers.link import SerialLink
from drivers.mock_ports import Item
from drivers.playback import session_items
from gse.config.station import Station
from gse.errors import UsageError
from gse.recording.recorder import Recorder
from gse.recording.session_format import PROTOCOL, STATION, read_attachments
from gse.sessions.live import new_session_folder
from gse.sessions.replay import station_in_force
from gse.sessions.status_file import OF_A_COMMAND, leave_command
from gse.station.polling import REQUEST, START
from gse.station.setup import addressed, protocol_of
from protocols import (
    ACK,
    NO_ANSWER,
    Answered,
    Command,
    CommandLayout,
    EncodeError,
    Frame,
    FrameDecoder,
    Protocol,
)
from protocols.items import unknown_name

ANSWER_S = 0.5
"""A command not answered within this time may be repeated, ICD of the panorama protocol."""
REPEATS = 3
_POLL_S = 0.05

Answer = TypeVar("Answer")


def send_command(
    link: SerialLink,
    make_frame: Callable[[int], bytes],
    deliver: Callable[[Item], None],
    answer_to: Callable[[Mapping[int, int]], Answer | None],
    *,
    first_sequence: int = 0,
    answer_s: float = ANSWER_S,
    repeats: int = REPEATS,
    instead: Callable[[], str] = lambda: "",
) -> Answer:
    """The sensor's answer to a command.

    ``make_frame`` gives the frame for a sequence number; each repetition takes the next one. ``deliver`` gets
    everything that is received meanwhile. ``answer_to`` returns the answer if it was among it, else None; its argument
    maps each sequence number sent so far to the monotonic time of sending, before which no answer can have come.
    CommandError without an answer, with what came ``instead`` where anything did.
    """
    sent_ns: dict[int, int] = {}
    for attempt in range(1 + repeats):
        sequence = first_sequence + attempt
        sent_ns[sequence] = link.send(make_frame(sequence)).mono_ns
        answer = receive_until(link, partial(answer_to, sent_ns), deliver, answer_s)
        if answer is not None:
            return answer
    asked = (
        f"asked {1 + repeats} times and waited {answer_s:g} s each time" if repeats else f"asked once, {answer_s:g} s"
    )
    came = instead() or "check its power, its transmit line, the baud rate and the protocol"
    raise CommandError(f"the sensor on {link.url} did not answer, {asked}; {came}")


def receive_until(
    link: SerialLink, found: Callable[[], Answer | None], deliver: Callable[[Item], None], timeout_s: float
) -> Answer | None:
    """Receive until ``found`` returns an answer, at most ``timeout_s`` of the link's time; None without one.

    One item at a time: a simulated sensor at full speed that gave all it has would be at its end before it is asked.
    """
    until_ns = link.mono_ns() + round(timeout_s * 1e9)
    answer = found()
    while answer is None and link.mono_ns() < until_ns and not link.at_end:
        for item in link.receive(_POLL_S, most=1):
            deliver(item)
        answer = found()
    return answer


PANORAMA_S = 5.0
"""The longest exposure is 2 s, ICD; one may be running already."""
LISTEN_FIRST_S = 0.1
"""Bytes in the port's buffer are read before the command is sent, so that they cannot be taken for its answer."""
BESIDE_NS = 3_000_000_000
"""A running session takes a command within a second, and its answer is in the file within another."""
_LOOK_S = 0.2


def _layout_of(protocol: Protocol, name: str) -> CommandLayout:
    if name not in protocol.commands:
        raise EncodeError(f"{protocol.name}: {unknown_name(name, protocol.commands, 'command')}")
    return protocol.commands[name]


class _Dialogue:
    """Frames received while a command waits for its answer; EncodeError where the protocol cannot say the command."""

    def __init__(self, protocol: Protocol, command: Command) -> None:
        """``command`` has its arguments as people give them."""
        self.panoramas = 0
        self.layout = _layout_of(protocol, command.name)
        given = dict(command.arguments)
        if command.name == START and not self.layout.arguments:
            given = {}  # a sensor that has one period needs none
        self.command = self.layout.made(**given)
        self._protocol = protocol
        self._awaited = self.layout.awaited(self.command)
        self._decoder = FrameDecoder(protocol, from_sensor=True)
        self._starts: deque[tuple[int, int]] = deque()
        self._bytes = 0
        self._since_ns: int | None = None
        self._answered: Answered | None = None

    def make_frame(self, sequence: int) -> bytes:
        """The frame of the command with a sequence number."""
        return self._awaited.sent(sequence % (self._protocol.sequence_modulus or 1))

    def take(self, item: Item) -> None:
        """Add a chunk or event."""
        if isinstance(item, LinkEvent):
            return
        self._starts.append((self._bytes, item.mono_ns))
        self._bytes += len(item.data)
        for piece in self._decoder.feed(item.data):
            if isinstance(piece, Frame):
                self._take_frame(piece)
        self._forget_before(self._bytes - self._decoder.pending)

    def _take_frame(self, frame: Frame) -> None:
        self.panoramas += frame.type == "PANORAMA"
        self._forget_before(frame.start)
        is_later = self._since_ns is not None and self._starts[0][1] >= self._since_ns
        if is_later and self._answered is None:
            self._answered = self._awaited.take(frame)

    def _forget_before(self, start: int) -> None:
        while len(self._starts) > 1 and self._starts[1][0] <= start:
            self._starts.popleft()

    def answer_to(self, sent_ns: Mapping[int, int]) -> Answered | None:
        """The answer to the command sent at these times, before which none can have come; None while there is none."""
        self._since_ns = min(sent_ns.values())
        if self.layout.answer == NO_ANSWER:
            return Answered(True, f"{self.command.name} was sent; nothing proves that it was obeyed", self.command, {})
        return self._answered

    def late(self) -> str:
        """What came instead of the answer, empty where nothing did."""
        return self._awaited.late if self._bytes else ""


@dataclass(frozen=True, slots=True)
class Commanded:
    """Result of a command: the sensor's answer, the path of the recording, and the bytes that were not recorded."""

    answer: Answered
    session: Path
    lost_bytes: int
    damage: str | None


def command_sensor(station: Station, station_text: str, command: Command, out: Path) -> Commanded:
    """Send one command in a session of its own, its arguments as people give them (``CommandLayout.made``).

    CommandError where the sensor refuses or never answers.
    """
    protocol = protocol_of(station)
    dialogue = _Dialogue(protocol, command)  # an impossible command is refused before the port is opened
    folder = new_session_folder(out, f"{station.sensor.name}{OF_A_COMMAND}", read_clock().utc_ns)
    recorder = Recorder(folder / "session.mcap", live=True)
    try:
        link = SerialLink(station.port.url, station.port.baudrate, recorder=recorder, line=station.port.line)
    except DriverError:
        recorder.close()
        recorder.path.unlink()
        folder.rmdir()
        raise
    with recorder, link:
        recorder.attach(STATION, "application/yaml", station_text.encode())
        recorder.attach(PROTOCOL, "application/yaml", protocol.text.encode())
        receive_until(link, lambda: None, dialogue.take, LISTEN_FIRST_S)
        answer = send_command(
            link,
            dialogue.make_frame,
            dialogue.take,
            dialogue.answer_to,
            answer_s=dialogue.layout.timeout_s,
            repeats=dialogue.layout.repeats,
            instead=dialogue.late,
        )
        if not answer.is_done:
            raise CommandError(answer.text)
        if command.name == REQUEST and dialogue.layout.answer == ACK:
            _await_panorama(link, dialogue)
    return Commanded(answer, recorder.path, recorder.lost_bytes, recorder.damage)


def protocol_beside(folder: Path) -> Protocol:
    """The protocol of a session; UsageError where nothing is sent in it."""
    force = station_in_force(read_attachments(folder), lambda recorded: recorded)
    if force.station.port.pass_to or force.station.port.tx_url:
        raise UsageError(f"{folder} sends nothing: the flight computer owns its line (port.pass_to, port.tx_url)")
    return addressed(force.protocol(), force.station)


def command_beside(folder: Path, command: Command) -> Commanded:
    """Send one command through the session that runs in ``folder``, which has the port, and await the answer there."""
    protocol, began = protocol_beside(folder), read_clock()
    first = _Dialogue(protocol, command)
    layout, late = first.layout, ""
    sent_ns: dict[int, int] = {}
    pause = threading.Event()
    for attempt in range(1 + layout.repeats):
        sequence = (began.mono_ns // 1000 + attempt) % (protocol.sequence_modulus or 1)
        now = read_clock()
        sent_ns[sequence] = now.mono_ns
        left = leave_command(folder, first.make_frame(sequence), now.utc_ns)
        while read_clock().mono_ns < now.mono_ns + BESIDE_NS + round(layout.timeout_s * 1e9):
            pause.wait(_LOOK_S)
            dialogue = _Dialogue(protocol, command)
            for number in sent_ns:
                dialogue.make_frame(number)
            dialogue.answer_to(sent_ns)
            for item in session_items(folder, began.utc_ns):
                dialogue.take(item)
            answer, late = dialogue.answer_to(sent_ns), dialogue.late()
            if answer is not None and not answer.is_done:
                raise CommandError(answer.text)
            if answer is not None:
                return Commanded(answer, folder, 0, None)
        left.unlink(missing_ok=True)
    raise CommandError(
        f"no answer came in {folder}, asked {1 + layout.repeats} times; {late or f'see: gse status {folder}'}"
    )


def _await_panorama(link: SerialLink, dialogue: _Dialogue) -> None:
    """Record the requested panorama."""
    if not receive_until(link, lambda: dialogue.panoramas or None, dialogue.take, PANORAMA_S):
        raise CommandError(f"the sensor obeyed REQUEST, but no panorama came within {PANORAMA_S} s")
