"""Commands to the sensor in the words of its protocol: sent, answered, recorded."""

from dataclasses import dataclass
from pathlib import Path

from drivers.chunk import LinkEvent
from drivers.clock import read_clock
from drivers.commands import receive_until, send_command
from drivers.errors import CommandError, DriverError
from drivers.link import SerialLink
from drivers.mock.timestamped_port import Item
from gse.config.station import Station
from gse.recording.recorder import Recorder
from gse.recording.session_format import PROTOCOL, STATION
from gse.sessions.live import new_session_folder
from protocols import (
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
)

PANORAMA_S = 5.0
"""The longest exposure is 2 s, ICD; one may be running already."""


Answer = Ack | Nak | StatusMessage


class _Dialogue:
    """What the sensor said while a command was on its way."""

    def __init__(self, protocol: Protocol, command: Message) -> None:
        self.panoramas = 0
        self._protocol, self._command = protocol, command
        self._decoder = FrameDecoder(protocol)
        self._answers: list[Answer] = []

    def make_frame(self, sequence: int) -> bytes:
        """The command under a sequence number."""
        return self._protocol.encode(self._command, sequence % (self._protocol.sequence_modulus or 1))

    def take(self, item: Item) -> None:
        """One more chunk or event."""
        if isinstance(item, LinkEvent):
            return
        for piece in self._decoder.feed(item.data):
            message = self._protocol.decode(piece) if isinstance(piece, Frame) else None
            self.panoramas += isinstance(message, PanoramaMessage)
            if isinstance(message, Ack | Nak | StatusMessage):
                self._answers.append(message)

    def answer_to(self, sequences: range) -> Answer | None:
        """The answer to the command as sent under one of these sequence numbers, None as long as there is none."""
        return next((answer for answer in self._answers if self._answers_to(answer, sequences)), None)

    def _answers_to(self, answer: Answer, sequences: range) -> bool:
        if isinstance(answer, StatusMessage):
            return isinstance(self._command, Ping)
        return answer.sequence in sequences


@dataclass(frozen=True, slots=True)
class Commanded:
    """What came of a command: the sensor's answer, where it is recorded, and what could not be recorded."""

    answer: Ack | StatusMessage
    session: Path
    lost_bytes: int
    damage: str | None


def command_sensor(station: Station, station_text: str, command: Message, out: Path) -> Commanded:
    """Send one command in a session of its own; CommandError where the sensor refuses or never answers."""
    protocol = load_protocol(station.protocol)
    dialogue = _Dialogue(protocol, command)
    dialogue.make_frame(0)  # what the protocol cannot say is told before anything is opened
    folder = new_session_folder(out, f"{station.sensor.name}-command", read_clock().utc_ns)
    recorder = Recorder(folder / "session.mcap", live=True)
    try:
        link = SerialLink(station.port.url, station.port.baudrate, recorder=recorder)
    except DriverError:
        recorder.close()
        recorder.path.unlink()
        folder.rmdir()
        raise
    with recorder, link:
        recorder.attach(STATION, "application/yaml", station_text.encode())
        recorder.attach(PROTOCOL, "application/yaml", protocol.text.encode())
        answer = send_command(link, dialogue.make_frame, dialogue.take, dialogue.answer_to)
        if isinstance(answer, Nak):
            raise CommandError(f"the sensor refuses {answer.command}: {answer.reason or 'it gives no reason'}")
        if isinstance(command, Request):
            _await_panorama(link, dialogue)
    assert isinstance(answer, Ack | StatusMessage)
    return Commanded(answer, recorder.path, recorder.lost_bytes, recorder.damage)


def _await_panorama(link: SerialLink, dialogue: _Dialogue) -> None:
    """The panorama that was asked for belongs to the recording."""
    if not receive_until(link, lambda: dialogue.panoramas or None, dialogue.take, PANORAMA_S):
        raise CommandError(f"the sensor obeyed REQUEST, but no panorama came within {PANORAMA_S} s")
