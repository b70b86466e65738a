"""stdout and stderr of the process, against real pipes, terminals and devices."""

import os
import pty
import re
import subprocess
import sys
import termios
import threading
from io import StringIO
from pathlib import Path
from typing import TextIO

import pytest

from gse.process.terminal import LIMIT_CHARS, SILENT_S, Output, SignOfLife

LINE_OFTEN = 3
SAYS_NOTHING = """
import sys, threading
from gse.process import terminal
terminal.start("gse test: working")
print("begins")
threading.Event().wait(2.0)
print("ends", file=sys.stderr)
"""


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def sign_at(clock: Clock) -> tuple[SignOfLife, StringIO]:
    screen = StringIO()
    return SignOfLife(screen, "gse test: working", clock), screen


def test_the_line_comes_after_a_silence_counts_seconds_and_makes_room_for_the_next_text() -> None:
    clock = Clock()
    sign, screen = sign_at(clock)
    sign.look()
    assert screen.getvalue() == ""
    clock.now_s = SILENT_S
    sign.look()
    clock.now_s = 3.0
    sign.look()
    assert screen.getvalue().split("\r")[1:] == ["gse test: working, 1 s", "gse test: working, 3 s"]
    sign.before("a result\n")
    assert screen.getvalue().endswith("\r" + " " * len("gse test: working, 3 s") + "\r")


@pytest.mark.parametrize("text", ["Name of the sensor [ST-1]: ", "15:00:05Z link streaming  600 frames"])
def test_there_is_no_line_where_a_prompt_or_a_status_line_stands(text: str) -> None:
    clock = Clock()
    sign, screen = sign_at(clock)
    sign.before(text)
    clock.now_s = 60.0
    sign.look()
    assert screen.getvalue() == ""


def test_there_is_a_line_again_after_a_progress_bar_was_removed() -> None:
    clock = Clock()
    sign, screen = sign_at(clock)
    sign.before("replaying 100% 0:00:00")
    sign.before("\r\n\x1b[?25h\r\x1b[1A\x1b[2K")
    clock.now_s = 2.0
    sign.look()
    assert "working, 2 s" in screen.getvalue()


def test_a_stopped_sign_shows_nothing_more() -> None:
    clock = Clock()
    sign, screen = sign_at(clock)
    sign.start()
    sign.stop()
    clock.now_s = 60.0
    sign.look()
    assert screen.getvalue() == ""
    assert not [one for one in threading.enumerate() if one.name == "sign of life"]


def said_on_a_terminal(environment: dict[str, str], code: str = SAYS_NOTHING) -> str:
    master, slave = pty.openpty()
    with subprocess.Popen([sys.executable, "-c", code], stdout=slave, stderr=slave, env=environment):
        os.close(slave)
        said = b""
        try:
            while piece := os.read(master, 4096):
                said += piece
        except OSError:  # how a pty tells its end
            pass
    os.close(master)
    return said.decode()


def test_a_process_that_prints_nothing_counts_on_its_terminal_and_leaves_it_clean() -> None:
    said = said_on_a_terminal({**os.environ, "TERM": "xterm"})
    assert len(re.findall(r"gse test: working, \d s", said)) >= LINE_OFTEN
    assert re.search(r"begins\r\n\r.*\r {20,}\rends\r\n$", said, re.DOTALL)


def test_a_dumb_terminal_and_a_pipe_get_no_line() -> None:
    assert said_on_a_terminal({**os.environ, "TERM": "dumb"}).split() == ["begins", "ends"]
    piped = subprocess.run([sys.executable, "-c", SAYS_NOTHING], capture_output=True, text=True, check=True)
    assert (piped.stdout, piped.stderr) == ("begins\n", "ends\n")


def test_the_line_is_gone_when_the_process_ends() -> None:
    code = f"{SAYS_NOTHING.partition('print')[0]}threading.Event().wait(1.2)\nterminal.end_sign()\n"
    said = said_on_a_terminal({**os.environ, "TERM": "xterm"}, code)
    assert re.search(r"working, \d s\r {20,}\r$", said)


def test_a_terminal_that_was_stopped_by_ctrl_s_keeps_nobody_waiting() -> None:
    reader, writer = pty.openpty()
    with os.fdopen(writer, "w") as terminal:
        clock = Clock()
        sign = SignOfLife(terminal, "gse test: working", clock)
        clock.now_s = 1.0
        sign.look()
        termios.tcflow(writer, termios.TCOOFF)
        worker = threading.Thread(target=use, args=(sign, clock), daemon=True)
        worker.start()
        worker.join(5.0)
        was_kept = worker.is_alive()
        termios.tcflow(writer, termios.TCOON)
        worker.join(5.0)
    os.close(reader)
    assert not was_kept


def use(sign: SignOfLife, clock: Clock) -> None:
    clock.now_s = 2.0
    sign.look()
    sign.before("a result\n")
    clock.now_s = 4.0
    sign.look()
    sign.stop()


def writing_to(fd: int) -> TextIO:
    return open(fd, "w", encoding="utf-8", closefd=False)


def queue_to(fd: int) -> Output:
    output = Output(writing_to(fd), "stderr")
    output.begin_queue()
    return output


def test_everything_comes_in_its_order_to_a_slow_reader() -> None:
    reader, writer = os.pipe()
    output = queue_to(writer)
    lines = [f"line {number} of °ß\n" for number in range(20_000)]
    for line in lines:
        output.write(line)
    received: list[str] = []
    with open(reader, encoding="utf-8") as file:
        reading = threading.Thread(target=lambda: received.extend(file))
        reading.start()
        assert output.settle()
        os.close(writer)
        reading.join()
    assert received == lines
    assert output.news() == []


@pytest.mark.parametrize("device", ["pipe", "terminal", "/dev/full"])
def test_a_reader_that_is_gone_is_news_once_and_nothing_is_raised(device: str) -> None:
    if device == "/dev/full":
        fd = os.open(device, os.O_WRONLY)
    else:
        reader, fd = os.pipe() if device == "pipe" else os.openpty()
        os.close(reader)
    output = queue_to(fd)
    for number in range(3):
        output.write(f"{number}\n")
    assert output.settle()
    ((kind, text),) = output.news()
    assert kind == "TERMINAL_LOST"
    assert text.startswith("stderr: ")
    assert output.news() == []
    os.close(fd)


def test_a_stopped_terminal_takes_what_it_got_when_it_goes_on_and_is_not_waited_for() -> None:
    master, slave = os.openpty()
    termios.tcflow(slave, termios.TCOOFF)
    output = queue_to(slave)
    assert output.isatty()
    output.write("first\n")
    assert not output.settle()
    termios.tcflow(slave, termios.TCOON)
    assert os.read(master, 100) == b"first\r\n"
    while not output.settle():
        pass
    assert output.settle()
    os.close(master)
    os.close(slave)


def test_what_nobody_takes_is_dropped_beyond_a_limit() -> None:
    reader, writer = os.pipe()
    output = queue_to(writer)
    for character in "abc":
        output.write(character * LIMIT_CHARS)
    received: list[str] = []
    with open(reader, encoding="utf-8") as file:
        reading = threading.Thread(target=lambda: received.append(file.read()))
        reading.start()
        assert output.settle()
        os.close(writer)
        reading.join()
    assert received == ["a" * LIMIT_CHARS + "b" * LIMIT_CHARS]


def test_words_are_written_at_once_without_a_queue_before_it_and_after_it() -> None:
    reader, writer = os.pipe()
    output = Output(writing_to(writer), "stderr")
    output.write("before, ")
    assert os.read(reader, 100) == b"before, "
    output.begin_queue()
    output.write("in it, ")
    assert output.settle()
    output.end_queue()
    output.writelines(["after ", "it"])
    assert os.read(reader, 100) == b"in it, after it"
    with pytest.raises(TypeError, match="expected text"):
        output.write(b"bytes")  # type: ignore[arg-type]
    os.close(reader)
    os.close(writer)


def test_an_error_of_stdout_is_raised_without_a_queue_and_one_of_stderr_never() -> None:
    with open("/dev/full", "w") as full:
        full.write("a sign of life")
        messages, result = Output(full, "stderr"), Output(full, "stdout", fails=True)
        messages.write("words\n")
        messages.flush()
        result.write("a result\n")
        with pytest.raises(OSError, match="No space left"):
            result.flush()
        assert hasattr(result, "buffer")
        result.begin_queue()
        result.flush()
        assert not hasattr(result, "buffer")
        assert not hasattr(messages, "buffer")
        os.dup2(os.open(os.devnull, os.O_WRONLY), full.fileno())


PRINTS = "print('a\\udcffb\\x1b]0;title\\x07'); print('c\\x9b', file=sys.stderr); print('\\x1b[1mbold\\x1b[0m')"


def test_a_text_of_a_stranger_that_a_command_prints_as_it_came_does_not_steer_the_terminal() -> None:
    program = f"import sys; from gse.process import terminal; terminal.start('gse'); {PRINTS}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert done.stdout == b"a\\udcffb\\x1b]0;title\\x07\n\x1b[1mbold\x1b[0m\n"
    assert done.stderr == b"c\\x9b\n"


def test_closed_standard_streams_are_not_taken_by_a_session_file(tmp_path: Path) -> None:
    script = "import os; from gse.process.terminal import _open_closed_streams as f; f(); print(os.open('x', 65))"
    command = f'"{sys.executable}" -c "{script}" 2>&- <&-'
    done = subprocess.run(command, shell=True, cwd=tmp_path, stdout=subprocess.PIPE, text=True, check=True)
    assert int(done.stdout) > 2
