"""Commands to the sensor in the words of its protocol: sent, answered, recorded."""

import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.chunk import LinkEvent
from drivers.clock import read_clock
from drivers.commands import REPEATS, receive_until, send_command
from drivers.errors import CommandError, DriverError
from drivers.link import SerialLink
from drivers.mock.playback import session_items
from drivers.mock.timestamped_port import Item
from gse.config.station import Station
from gse.errors import UsageError
from gse.recording.recorder import Recorder
from gse.recording.session_format import PROTOCOL, STATION, read_attachments
from gse.sessions.live import new_session_folder
from gse.sessions.replay import station_in_force
from gse.sessions.status_file import OF_A_COMMAND, leave_command
from gse.station.setup import addressed
from protocols import (
    NAME_OF,
    Ack,
    Frame,
    FrameDecoder,
    Message,
    Nak,
    PanoramaMessage,
    Ping,
    Protocol,
    Request,
    StatusMessage,
    load_protocol,
    parse_protocol,
)

PANORAMA_S = 5.0
"""The longest exposure is 2 s, ICD; one may be running already."""
LISTEN_FIRST_S = 0.1
"""Bytes in the port's buffer are read before the command is sent, so that they cannot be taken for its answer."""
BESIDE_NS = 3_000_000_000
"""A running session takes a command within a second, and its answer is in the file within another."""
_LOOK_S = 0.2
MOST_ANSWERS = 1000
"""Most received frames in which the answer is searched; the latest are used."""


Answer = Ack | Nak | StatusMessage


class _Dialogue:
    """Frames received while a command waits for its answer."""

    def __init__(self, protocol: Protocol, command: Message) -> None:
        self.panoramas = 0
        self._protocol, self._command = protocol, command
        self._decoder = FrameDecoder(protocol, from_sensor=True)
        self._name = NAME_OF[type(command)]
        self._starts: deque[tuple[int, int]] = deque()
        self._bytes = 0
        self._answers: deque[tuple[int, Answer]] = deque(maxlen=MOST_ANSWERS)

    def make_frame(self, sequence: int) -> bytes:
        """The frame of the command with a sequence number."""
        return self._protocol.encode(self._command, sequence % (self._protocol.sequence_modulus or 1))

    def take(self, item: Item) -> None:
        """Add a chunk or event."""
        if isinstance(item, LinkEvent):
            return
        self._starts.append((self._bytes, item.mono_ns))
        self._bytes += len(item.data)
        for piece in self._decoder.feed(item.data):
            if isinstance(piece, Frame):
                self._take_message(self._protocol.decode(piece), self._came_ns(piece))
        self._forget_before(self._bytes - self._decoder.pending)

    def _take_message(self, message: Message, came_ns: int) -> None:
        self.panoramas += isinstance(message, PanoramaMessage)
        if isinstance(message, Ack | Nak | StatusMessage):
            self._answers.append((came_ns, message))

    def _came_ns(self, frame: Frame) -> int:
        """When the first byte of a frame was read."""
        self._forget_before(frame.start)
        return self._starts[0][1]

    def _forget_before(self, start: int) -> None:
        while len(self._starts) > 1 and self._starts[1][0] <= start:
            self._starts.popleft()

    def answer_to(self, sent_ns: Mapping[int, int]) -> Answer | None:
        """The answer to the command sent with these sequence numbers at these times; None as long as there is none."""
        return next((answer for came_ns, answer in self._answers if self._answers_to(answer, came_ns, sent_ns)), None)

    def _answers_to(self, answer: Answer, came_ns: int, sent_ns: Mapping[int, int]) -> bool:
        """Whether it has the type and the sequence number of the command, and came after the command."""
        if isinstance(answer, StatusMessage):
            return isinstance(self._command, Ping) and came_ns >= min(sent_ns.values())
        is_later = answer.sequence in sent_ns and came_ns >= sent_ns[answer.sequence]
        return is_later and answer.command == self._name


@dataclass(frozen=True, slots=True)
class Commanded:
    """Result of a command: the sensor's answer, the path of the recording, and the bytes that were not recorded."""

    answer: Ack | StatusMessage
    session: Path
    lost_bytes: int
    damage: str | None


def command_sensor(station: Station, station_text: str, command: Message, out: Path) -> Commanded:
    """Send one command in a session of its own; CommandError where the sensor refuses or never answers."""
    protocol = addressed(load_protocol(station.protocol), station)
    dialogue = _Dialogue(protocol, command)
    dialogue.make_frame(0)  # an impossible command is refused before the port is opened
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
        answer = send_command(link, dialogue.make_frame, dialogue.take, dialogue.answer_to)
        if isinstance(answer, Nak):
            raise CommandError(f"the sensor refuses {answer.command}: {answer.reason or 'it gives no reason'}")
        if isinstance(command, Request):
            _await_panorama(link, dialogue)
    assert isinstance(answer, Ack | StatusMessage)
    return Commanded(answer, recorder.path, recorder.lost_bytes, recorder.damage)


def command_beside(folder: Path, command: Message) -> Commanded:
    """Send one command through the session that runs in ``folder``, which has the port, and await the answer there."""
    force = station_in_force(read_attachments(folder), lambda recorded: recorded)
    if force.station.port.pass_to or force.station.port.tx_url:
        raise UsageError(f"{folder} sends nothing: the flight computer owns its line (port.pass_to, port.tx_url)")
    text = force.protocol_text
    found = load_protocol(force.station.protocol) if text is None else parse_protocol(text, "its protocol.yaml")
    protocol, began = addressed(found, force.station), read_clock()
    sent_ns: dict[int, int] = {}
    pause = threading.Event()
    for attempt in range(1 + REPEATS):
        sequence = (began.mono_ns // 1000 + attempt) % (protocol.sequence_modulus or 1)
        now = read_clock()
        sent_ns[sequence] = now.mono_ns
        left = leave_command(folder, _Dialogue(protocol, command).make_frame(sequence), now.utc_ns)
        while read_clock().mono_ns < now.mono_ns + BESIDE_NS:
            pause.wait(_LOOK_S)
            dialogue = _Dialogue(protocol, command)
            for item in session_items(folder, began.utc_ns):
                dialogue.take(item)
            answer = dialogue.answer_to(sent_ns)
            if isinstance(answer, Nak):
                raise CommandError(f"the sensor refuses {answer.command}: {answer.reason or 'it gives no reason'}")
            if answer is not None:
                return Commanded(answer, folder, 0, None)
        left.unlink(missing_ok=True)
    raise CommandError(f"no answer came in {folder}, asked {1 + REPEATS} times; see: gse status {folder}")


def _await_panorama(link: SerialLink, dialogue: _Dialogue) -> None:
    """Record the requested panorama."""
    if not receive_until(link, lambda: dialogue.panoramas or None, dialogue.take, PANORAMA_S):
        raise CommandError(f"the sensor obeyed REQUEST, but no panorama came within {PANORAMA_S} s")
