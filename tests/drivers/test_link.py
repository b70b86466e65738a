"""SerialLink on live ports: ptys and loop://, the real driver."""

import os
import signal
import socket
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from devices.patience import PATIENCE_S
from devices.terminal import Terminal

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import PortError
from drivers.link import NOT_RUN_NS, SerialLink, _read
from drivers.ports import LineSettings, PortInfo, explain, holders, line_in_use, line_of_flags, names_by_id
from drivers.session_file.reader import messages
from drivers.session_file.records import EVENTS, RX, TX
from drivers.session_file.writer import CaptureWriter


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path / "ttySENSOR")
    yield terminal
    if terminal.path.exists():
        terminal.unplug()


def fetch(link: SerialLink, enough: Callable[[list[Chunk | LinkEvent]], bool]) -> list[Chunk | LinkEvent]:
    items: list[Chunk | LinkEvent] = []
    until = time.monotonic() + PATIENCE_S
    while not enough(items) and time.monotonic() < until:
        items += link.receive(0.2)
    return items


def data_of(items: list[Chunk | LinkEvent]) -> bytes:
    return b"".join(item.data for item in items if isinstance(item, Chunk))


def kinds_of(items: list[Chunk | LinkEvent]) -> list[str]:
    return [item.kind for item in items if isinstance(item, LinkEvent)]


def test_bytes_arrive_whole_and_stamped_with_both_clocks(terminal: Terminal) -> None:
    before = time.time_ns(), time.monotonic_ns()
    with SerialLink(str(terminal.path)) as link:
        assert link.is_live
        assert not link.at_end
        terminal.write(bytes(range(256)) * 12)
        items = fetch(link, lambda items: len(data_of(items)) >= 256 * 12)
    after = time.time_ns(), time.monotonic_ns()
    assert kinds_of(items) == ["OPENED"]
    assert data_of(items) == bytes(range(256)) * 12
    for item in items:
        assert before[0] <= item.utc_ns <= after[0]
        assert before[1] <= item.mono_ns <= after[1]


def test_bytes_that_came_before_the_port_was_opened_are_kept(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "tty")
    terminal.write(b"early")
    with SerialLink(str(terminal.path)) as link:
        assert data_of(fetch(link, data_of)) == b"early"
    terminal.unplug()


def test_receive_does_not_wait_longer_than_asked(terminal: Terminal) -> None:
    with SerialLink(str(terminal.path)) as link:
        assert kinds_of(link.receive(0)) == ["OPENED"]
        waited_s = []
        for _ in range(5):
            started_s = time.monotonic()
            assert link.receive(0.05) == []
            waited_s.append(time.monotonic() - started_s)
    assert min(waited_s) < 1.0, "a busy machine makes one of them longer, not all"


def test_a_frame_that_comes_after_a_silence_is_one_chunk(terminal: Terminal) -> None:
    frame = bytes(216)
    with SerialLink(str(terminal.path)) as link:
        fetch(link, bool)
        pieces = []
        for _ in range(5):
            assert link.receive(0.05) == []
            terminal.write(frame)
            pieces.append(len(fetch(link, lambda items: len(data_of(items)) >= len(frame))))
    assert min(pieces) == 1, "the system may part one of them, not all"


class PortThatFailsAfterOneByte:
    """As a driver of pyserial that meets an error of its own kind once a byte was read."""

    port = "another://handler"

    def __init__(self) -> None:
        self._in_waiting = iter([0])

    @property
    def in_waiting(self) -> int:
        return next(self._in_waiting)

    def read(self, size: int) -> bytes:
        return b"x"[:size]


def test_a_byte_is_not_lost_where_the_driver_fails_right_after_it() -> None:
    assert _read(PortThatFailsAfterOneByte()) == b"x"


def test_a_slow_signal_handler_does_not_make_receive_wait_for_ever(terminal: Terminal) -> None:
    before = signal.signal(signal.SIGALRM, lambda number, frame: time.sleep(0.2))
    rescue = threading.Timer(PATIENCE_S / 2, terminal.write, [b"what would end an endless wait"])
    with SerialLink(str(terminal.path)) as link:
        link.receive(0.01)
        rescue.start()
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        try:
            assert link.receive(0.1) == []
        finally:
            rescue.cancel()
            signal.signal(signal.SIGALRM, before)


def test_a_port_that_goes_and_comes_back_loses_no_byte_and_says_so_once(terminal: Terminal) -> None:
    sent = b""
    items: list[Chunk | LinkEvent] = []
    away_ns = []
    with SerialLink(str(terminal.path)) as link:
        for round_no in range(4):
            piece = bytes([round_no]) * 301
            sent += piece
            terminal.write(piece)
            items += fetch(link, lambda got: len(data_of(got)) >= 301)
            terminal.unplug()
            items += fetch(link, lambda got: "LOST" in kinds_of(got))
            early = b"partial"
            sent += early
            back_ns = time.monotonic_ns()
            terminal.plug(early)
            items += fetch(link, lambda got: "REOPENED" in kinds_of(got) and len(data_of(got)) >= 7)
            reopened = next(item for item in reversed(items) if isinstance(item, LinkEvent))
            away_ns.append(reopened.mono_ns - back_ns)
    assert min(away_ns) < 1_000_000_000, "a busy machine makes one of them longer, not all"
    assert data_of(items) == sent
    assert kinds_of(items) == ["OPENED"] + ["LOST", "REOPENED"] * 4


def test_a_usb_adapter_is_found_again_under_another_name(tmp_path: Path) -> None:
    first, second = Terminal(tmp_path / "ttyUSB0"), Terminal(tmp_path / "ttyUSB1")
    present = [PortInfo(str(first.path), "FT232R", 0x403, 0x6001, "A50285BI")]
    with SerialLink(str(first.path), list_ports=lambda: present) as link:
        first.write(b"one")
        items = fetch(link, lambda got: data_of(got) == b"one")
        present[:] = [PortInfo(str(second.path), "FT232R", 0x403, 0x6001, "A50285BI")]
        second.write(b"two")
        first.unplug()
        items += fetch(link, lambda got: data_of(got) == b"two")
    assert data_of(items) == b"onetwo"
    assert f"now named {second.path}" in [i for i in items if isinstance(i, LinkEvent)][-1].text
    second.unplug()


FTDI_A = (0x403, 0x6001, "A50285BI")
OTHERS = {
    "of its kind": (0x403, 0x6001, "B60396CJ"),
    "of its kind without a number": (0x403, 0x6001, None),
    "another port of the same": (*FTDI_A, "1.1"),
    "of another kind": (0x1A86, 0x7523, None),
}


@pytest.mark.parametrize("other", OTHERS)
def test_another_adapter_under_the_name_of_the_lost_one_is_told_once_and_not_read(tmp_path: Path, other: str) -> None:
    name, elsewhere = Terminal(tmp_path / "ttyUSB0"), Terminal(tmp_path / "ttyUSB1")
    ours = PortInfo(str(name.path), "FT232R", *FTDI_A)
    present = [ours]
    with SerialLink(str(name.path), list_ports=lambda: present) as link:
        name.write(b"one")
        items = fetch(link, lambda got: data_of(got) == b"one")
        present[:] = [PortInfo(str(name.path), "other", *OTHERS[other])]
        name.unplug()
        name.plug(b"another sensor's")
        items += fetch(link, lambda got: "OTHER_ADAPTER" in kinds_of(got))
        present.append(replace(ours, device=str(elsewhere.path)))
        elsewhere.write(b"two")
        items += fetch(link, lambda got: data_of(got) == b"two")
    assert data_of(items) == b"onetwo"
    assert kinds_of(items) == ["OPENED", "LOST", "OTHER_ADAPTER", "REOPENED"]
    told = next(item.text for item in items if isinstance(item, LinkEvent) and item.kind == "OTHER_ADAPTER")
    assert "waiting for that of this session (FT232R, serial number A50285BI)" in told


def test_adapters_of_a_kind_without_serial_numbers_look_the_same_and_the_operator_is_told(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "ttyUSB0")
    present = [PortInfo(str(terminal.path), "CH340", 0x1A86, 0x7523)]
    with SerialLink(str(terminal.path), list_ports=lambda: present) as link:
        items = fetch(link, lambda got: "OPENED" in kinds_of(got))
        terminal.unplug()
        terminal.plug(b"two")
        items += fetch(link, lambda got: data_of(got) == b"two")
    *_, reopened = [item for item in items if isinstance(item, LinkEvent)]
    assert reopened.text.endswith("its adapter has no serial number: make sure that it is the same sensor")
    terminal.unplug()


def test_an_adapter_has_a_url_that_stays(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "ttyUSB0")
    (tmp_path / "by-id").mkdir()
    link = tmp_path / "by-id" / "usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0"
    link.symlink_to(terminal.path)
    assert names_by_id(tmp_path / "by-id") == {os.path.realpath(terminal.path): str(link)}
    assert names_by_id(tmp_path / "none") == {}
    plain = PortInfo(str(terminal.path), "FT232R", *FTDI_A)
    assert replace(plain, by_id=str(link)).url_that_stays == str(link)
    assert plain.url_that_stays == "hwgrep://A50285BI"
    assert replace(plain, serial_number=None).url_that_stays is None
    terminal.unplug()


def test_a_port_that_is_not_there_yet_can_be_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "late"
    with SerialLink(str(path), wait_port=True) as link:
        assert kinds_of(link.receive(1)) == ["NO_PORT"]
        with pytest.raises(PortError, match="is not connected"):
            link.send(b"x")
        terminal = Terminal(path)
        terminal.write(b"here")
        items = fetch(link, lambda got: data_of(got) == b"here")
        assert kinds_of(items) == ["OPENED"]
    terminal.unplug()


def test_commands_go_out_and_are_recorded(terminal: Terminal, tmp_path: Path) -> None:
    with CaptureWriter(tmp_path / "s.mcap") as writer, SerialLink(str(terminal.path), recorder=writer) as link:
        chunk = link.send(b"start")
        assert terminal.read(100) == b"start"
        terminal.write(b"ack")
        fetch(link, lambda got: len(data_of(got)) >= 1)
    assert [message.chunk() for message in messages(tmp_path / "s.mcap", TX)] == [chunk]
    assert b"".join(message.data for message in messages(tmp_path / "s.mcap", RX)) == b"ack"
    assert [message.event().kind for message in messages(tmp_path / "s.mcap", EVENTS)] == ["OPENED"]


def test_the_recorder_has_the_bytes_although_nobody_fetches_them(terminal: Terminal, tmp_path: Path) -> None:
    with CaptureWriter(tmp_path / "s.mcap") as writer, SerialLink(str(terminal.path), recorder=writer) as link:
        terminal.write(b"unread")
        until = time.monotonic() + PATIENCE_S
        while link.backlog_bytes < 6 and time.monotonic() < until:
            pass
    assert b"".join(message.data for message in messages(tmp_path / "s.mcap", RX)) == b"unread"


def test_waiting_is_only_for_ports_that_may_come() -> None:
    with pytest.raises(PortError, match="not known"):
        SerialLink("nonsense://x", wait_port=True)


def test_a_tcp_port_is_read_in_large_pieces_to_its_last_byte_and_found_again() -> None:
    data = bytes(range(256)) * 400
    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor(1) as pool:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(data)

        serving = pool.submit(serve)
        with SerialLink(f"socket://127.0.0.1:{server.getsockname()[1]}") as link:
            serving.result()
            items = fetch(link, lambda got: "LOST" in kinds_of(got))
            assert data_of(items) == data
            assert len(items) < 1000
            pool.submit(serve).result()
            items += fetch(link, lambda got: len(data_of(got)) >= len(data))
    assert kinds_of(items)[:3] == ["OPENED", "LOST", "REOPENED"]
    assert data_of(items) == data + data


def test_a_recording_is_at_its_end_after_the_time_that_was_asked_for_and_nothing_later_is_recorded(
    tmp_path: Path,
) -> None:
    with CaptureWriter(tmp_path / "source.mcap") as writer:
        for number in range(100):
            writer.rx(Chunk(number * 10**8, 5 + number * 10**8, b"%d," % number))
    with (
        CaptureWriter(tmp_path / "part.mcap") as recorder,
        SerialLink(f"replay://{tmp_path / 'source.mcap'}?speed=max", recorder=recorder, stamped_s=1.0) as link,
    ):
        items = []
        while not link.at_end:
            items += link.receive(1.0)
    assert data_of(items) == b"0,1,2,3,4,5,6,7,8,9,"
    assert b"".join(message.data for message in messages(tmp_path / "part.mcap", RX)) == data_of(items)


def test_any_pyserial_url_will_do() -> None:
    with SerialLink("loop://") as link:
        link.send(b"round trip")
        assert data_of(fetch(link, lambda got: len(data_of(got)) >= 10)) == b"round trip"


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("/dev/ttyNOWHERE", "there is no port /dev/ttyNOWHERE; .*ports? here"),
        ("/etc/hostname", "is not a serial port"),
        ("nonsense://x", "not known"),
        ("hwgrep://no such adapter", "no port matches"),
        ("tcp://127.0.0.1:9", r"TCP is written socket://127\.0\.0\.1:9"),
        ("socket://127.0.0.1:9", "cannot open"),
        ("socket://127.0.0.1", "has no port number"),
        ("rfc2217://127.0.0.1:x", "has no port number"),
        ("", "the port has no name"),
    ],
)
def test_a_port_that_does_not_open_says_why(url: str, words: str) -> None:
    with pytest.raises(PortError, match=words):
        SerialLink(url)


def test_a_simulated_port_without_a_simulator_says_so() -> None:
    script = "from drivers.link import SerialLink; SerialLink('sim://')"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert "PortError: sim:// needs a simulator" in done.stderr


def test_a_busy_port_is_refused_and_its_holder_named(terminal: Terminal) -> None:
    with SerialLink(str(terminal.path)), pytest.raises(PortError, match="is busy"):
        SerialLink(str(terminal.path))


def test_no_permission_says_which_group_to_join() -> None:
    text = explain("/dev/null", PermissionError(13, "Permission denied"))
    assert "usermod -aG" in text


def test_whoever_holds_a_device_is_named(tmp_path: Path) -> None:
    path = tmp_path / "held"
    path.write_text("x")
    hold = "import sys; held = open(sys.argv[1]); print('open', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", hold, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        found = holders(str(path))
        child.communicate()
    assert [holder for holder in found if f"(pid {child.pid})" in holder]
    assert holders(str(path)) == []


LISTEN = """
import sys
from drivers.link import SerialLink
with SerialLink(sys.argv[1]) as link:
    while True:
        for item in link.receive(1.0):
            print(getattr(item, "kind", "bytes"), flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_link_that_was_stopped_says_so_before_the_bytes_that_waited(terminal: Terminal) -> None:
    command = [sys.executable, "-c", LISTEN, str(terminal.path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "OPENED\n"
        process.send_signal(signal.SIGSTOP)
        os.waitpid(process.pid, os.WUNTRACED)
        terminal.write(b"waits")
        until_s = time.monotonic() + 1.1e-9 * NOT_RUN_NS
        while time.monotonic() < until_s:
            time.sleep(0.05)
        process.send_signal(signal.SIGCONT)
        came = [process.stdout.readline() for _ in range(2)]
        process.kill()
    assert came == ["NOT_RUN\n", "bytes\n"]


class StuckRecorder:
    """Takes as long for a chunk as a disk that stands still."""

    def rx(self, chunk: Chunk) -> None:
        time.sleep(1.1e-9 * NOT_RUN_NS)

    def tx(self, chunk: Chunk) -> None:
        raise AssertionError("nothing is sent here")

    def event(self, event: LinkEvent) -> None:
        """Take it at once."""


def test_a_link_that_was_held_up_between_two_reads_says_so(terminal: Terminal) -> None:
    with SerialLink(str(terminal.path), recorder=StuckRecorder()) as link:
        terminal.write(b"waits")
        items = fetch(link, lambda got: "NOT_RUN" in kinds_of(got))
        assert kinds_of(items) == ["OPENED", "NOT_RUN"]
        assert data_of(items) == b"waits"


def test_a_link_that_reads_all_the_time_has_no_pause_to_tell(terminal: Terminal) -> None:
    with SerialLink(str(terminal.path)) as link:
        time.sleep(1.1e-9 * NOT_RUN_NS)
        terminal.write(b"came")
        items = fetch(link, lambda got: data_of(got) == b"came")
    assert "NOT_RUN" not in kinds_of(items)


def test_the_settings_of_a_line_are_those_that_the_far_end_reads_back(terminal: Terminal) -> None:
    """A pty carries no parity, and keeps no more than stop bits and flow control of what is set."""
    line = LineSettings(parity="even", stop_bits=2, rtscts=True, xonxoff=True)
    with SerialLink(str(terminal.path), line=line):
        iflag, _, cflag, *_ = termios.tcgetattr(terminal.master)
    assert cflag & termios.CSTOPB
    assert cflag & termios.CRTSCTS
    assert iflag & termios.IXON
    with SerialLink(str(terminal.path)):
        iflag, _, cflag, *_ = termios.tcgetattr(terminal.master)
    assert not cflag & (termios.CSTOPB | termios.CRTSCTS)
    assert not iflag & termios.IXON


def test_settings_that_a_driver_refuses_are_a_port_that_cannot_be_opened(terminal: Terminal) -> None:
    with SerialLink(str(terminal.path)):
        pass
    # A pty has 8 data bits: the system refuses where it can set nothing of what is new.
    with pytest.raises(PortError, match=r"refuses 115200 baud with 7 data bits, parity none and 1 stop bits: Invalid"):
        SerialLink(str(terminal.path), line=LineSettings(data_bits=7))


def test_the_settings_of_a_line_in_use_are_read_from_its_terminal(terminal: Terminal, tmp_path: Path) -> None:
    with SerialLink(str(terminal.path), 57_600, line=LineSettings(stop_bits=2, xonxoff=True)):
        assert line_in_use(str(terminal.path)) == "57600 8N2, xonxoff"
    with SerialLink(str(terminal.path)):
        assert line_in_use(str(terminal.path)) == "115200 8N1"
    (tmp_path / "file").touch()
    assert line_in_use(str(tmp_path / "file")) is None
    assert line_in_use(str(tmp_path / "none")) is None


@pytest.mark.parametrize(
    ("cflag", "said"),
    [
        (termios.PARENB | termios.PARODD | termios.CS7, "9600 7O1"),
        (termios.PARENB | termios.CS8 | termios.CSTOPB | termios.CRTSCTS, "9600 8E2, rtscts"),
        (termios.PARENB | termios.PARODD | 0o10000000000 | termios.CS8, "9600 8M1"),
        (termios.CS5, "9600 5N1"),
    ],
)
def test_parity_and_bits_are_named_as_termios_has_them(cflag: int, said: str) -> None:
    assert line_of_flags(0, cflag, termios.B9600) == said


def test_a_line_is_named_by_its_settings_and_counts_its_bits() -> None:
    assert [str(line) for line in (LineSettings(), LineSettings("odd", 7, 1.5, rtscts=True))] == [
        "8N1",
        "7O1.5, rtscts",
    ]
    assert [line.bits_per_byte for line in (LineSettings(), LineSettings("even", 8, 2))] == [10, 12]
