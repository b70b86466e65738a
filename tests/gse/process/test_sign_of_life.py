import os
import pty
import re
import subprocess
import sys
import threading
from io import StringIO

import pytest

from gse.process.sign_of_life import SILENT_S, SignOfLife

LINE_OFTEN = 3
SAYS_NOTHING = """
import sys, threading
from gse.process import sign_of_life
sign_of_life.start("gse test: working")
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
    code = f"{SAYS_NOTHING.partition('print')[0]}threading.Event().wait(1.2)\nsign_of_life.stop()\n"
    said = said_on_a_terminal({**os.environ, "TERM": "xterm"}, code)
    assert re.search(r"working, \d s\r {20,}\r$", said)


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-S is of a POSIX terminal")
def test_a_terminal_that_was_stopped_by_ctrl_s_keeps_nobody_waiting() -> None:
    import termios

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
