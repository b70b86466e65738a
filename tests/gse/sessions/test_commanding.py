"""Which answer counts for a command: one of its type and sequence number that came after it."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from devices.terminal import Terminal

from drivers.errors import CommandError
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.sessions.commanding import command_sensor
from protocols import Ack, Command, Frame, FrameDecoder, Message, load_protocol

PROTOCOL = load_protocol("panorama-v1")


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path / "tty")
    yield terminal
    terminal.unplug()


def ack(command: str, sequence: int) -> bytes:
    return PROTOCOL.encode(Ack(command=command, sequence=sequence), 7)


def sensor_behind(terminal: Terminal, answer: Callable[[Frame], bytes], commands: int) -> threading.Thread:
    def serve() -> None:
        decoder = FrameDecoder(PROTOCOL)
        for _ in range(commands):
            frames: list[Frame] = []
            while not frames:
                frames = [item for item in decoder.feed(terminal.read(100)) if isinstance(item, Frame)]
            terminal.write(answer(frames[0]))

    thread = threading.Thread(target=serve)
    thread.start()
    return thread


def command(terminal: Terminal, message: Command, tmp_path: Path) -> Message:
    text = BUILT_IN_TEXT.replace("sim://", str(terminal.path))
    return command_sensor(parse_station(text), text, message, tmp_path / "out").answer.message


@pytest.mark.parametrize(
    ("name", "shift"), [("STOP", 0), ("START", 1000)], ids=["of another type", "of another sequence number"]
)
def test_an_answer_to_another_command_does_not_count(terminal: Terminal, tmp_path: Path, name: str, shift: int) -> None:
    thread = sensor_behind(terminal, lambda frame: ack(name, frame.sequence + shift), 4)
    with pytest.raises(CommandError, match="did not answer"):
        command(terminal, Command("START", {"period": 100}), tmp_path)
    thread.join()


def test_an_answer_that_came_before_the_command_does_not_count(terminal: Terminal, tmp_path: Path) -> None:
    terminal.write(ack("START", 0) + ack("STOP", 0))
    with pytest.raises(CommandError, match="did not answer"):
        command(terminal, Command("STOP"), tmp_path)


def test_the_right_answer_counts_among_wrong_ones(terminal: Terminal, tmp_path: Path) -> None:
    terminal.write(ack("STOP", 0))
    thread = sensor_behind(terminal, lambda frame: ack("START", frame.sequence) + ack("STOP", frame.sequence), 1)
    answer = command(terminal, Command("STOP"), tmp_path)
    thread.join()
    assert isinstance(answer, Ack)
    assert (answer.command, answer.sequence) == ("STOP", 0)
