"""Commands: sent, answered, repeated, given up; on a pty with a sensor of three lines."""

import threading
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path

import pytest
from devices.terminal import Terminal

from drivers.chunk import Chunk
from drivers.errors import CommandError
from drivers.link import SerialLink
from drivers.mock_ports import Item
from drivers.session_file.reader import messages
from drivers.session_file.records import TX
from drivers.session_file.writer import CaptureWriter
from drivers.urlhandlers.protocol_sim import register
from gse.sessions.commanding import ANSWER_S, receive_until, send_command


class Listener:
    """The station's side: finds ``A`` + sequence among the bytes."""

    def __init__(self) -> None:
        self.heard = b""

    def take(self, item: Item) -> None:
        if isinstance(item, Chunk):
            self.heard += item.data

    def answer_to(self, sent_ns: Mapping[int, int]) -> int | None:
        return next((n for n in sent_ns if b"A%d;" % n in self.heard), None)


def frame(sequence: int) -> bytes:
    return b"C%d;" % sequence


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path / "tty")
    yield terminal
    terminal.unplug()


def sensor_behind(terminal: Terminal, answer: Callable[[int], bytes], commands: int) -> threading.Thread:
    def serve() -> None:
        for _ in range(commands):
            received = terminal.read(100)
            terminal.write(answer(int(received[1:-1])))

    thread = threading.Thread(target=serve)
    thread.start()
    return thread


def test_an_answer_ends_the_waiting_and_what_came_beside_it_is_delivered(terminal: Terminal) -> None:
    thread = sensor_behind(terminal, lambda n: b"noise A%d; more" % n, 1)
    listener = Listener()
    with SerialLink(str(terminal.path)) as link:
        assert send_command(link, frame, listener.take, listener.answer_to, first_sequence=7) == 7
        receive_until(link, lambda: listener.heard.endswith(b"more") or None, listener.take, 2.0)
    assert listener.heard == b"noise A7; more"
    thread.join()


def test_a_lost_answer_is_asked_for_again_under_the_next_sequence_number(terminal: Terminal, tmp_path: Path) -> None:
    thread = sensor_behind(terminal, lambda n: b"A%d;" % n if n == 2 else b"", 3)
    listener = Listener()
    with CaptureWriter(tmp_path / "s.mcap") as writer, SerialLink(str(terminal.path), recorder=writer) as link:
        assert send_command(link, frame, listener.take, listener.answer_to) == 2
    sent = list(messages(tmp_path / "s.mcap", TX))
    assert [message.data for message in sent] == [b"C0;", b"C1;", b"C2;"]
    pauses_s = [(b.mono_ns - a.mono_ns) * 1e-9 for a, b in pairwise(sent)]
    assert all(ANSWER_S <= pause_s < ANSWER_S + 1 for pause_s in pauses_s)
    thread.join()


def test_an_answer_to_an_earlier_try_counts(terminal: Terminal) -> None:
    thread = sensor_behind(terminal, lambda n: b"A0;" if n == 1 else b"", 2)
    listener = Listener()
    with SerialLink(str(terminal.path)) as link:
        assert send_command(link, frame, listener.take, listener.answer_to) == 0
    thread.join()


class SilentSensor:
    """Lets its time pass, and answers nothing."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []
        self._now_ns = 0

    def next_chunk(self) -> Chunk | None:
        self._now_ns += 100_000_000
        return Chunk(self._now_ns, self._now_ns, b"")

    def command(self, data: bytes, utc_ns: int) -> None:
        self.heard.append(data)


def test_a_silent_sensor_is_asked_four_times_in_its_own_time_and_then_given_up() -> None:
    sensor = SilentSensor()
    register(lambda options: sensor)
    listener = Listener()
    with SerialLink("sim://") as link, pytest.raises(CommandError, match="did not answer, asked 4 times"):
        send_command(link, frame, listener.take, listener.answer_to)
    assert sensor.heard == [b"C0;", b"C1;", b"C2;", b"C3;"]


class StreamingSensor:
    """Sends a frame each millisecond for two seconds, and answers a command between them."""

    def __init__(self) -> None:
        self._now_ns = 0
        self._answers: list[bytes] = []

    def next_chunk(self) -> Chunk | None:
        self._now_ns += 1_000_000
        if self._now_ns > 2_000_000_000:
            return None
        return Chunk(self._now_ns, self._now_ns, self._answers.pop() if self._answers else b"P;")

    def command(self, data: bytes, utc_ns: int) -> None:
        self._answers.append(data.replace(b"C", b"A"))


def test_a_simulated_sensor_that_streams_at_full_speed_answers_before_its_end() -> None:
    register(lambda options: StreamingSensor())
    listener = Listener()
    with SerialLink("sim://") as link:
        receive_until(link, lambda: None, listener.take, 0.1)
        assert send_command(link, frame, listener.take, listener.answer_to) == 0
        assert not link.at_end
