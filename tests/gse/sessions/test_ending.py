"""What the signals of a person, a terminal and the system mean for a session."""

import signal
import subprocess
import sys
import time

import pytest

from gse.sessions.live import Ending


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_asks_for_the_end_and_says_what_follows(number: signal.Signals) -> None:
    said: list[str] = []
    before = signal.getsignal(number)
    with Ending(said.append) as ending:
        assert not ending.asked()
        signal.raise_signal(number)
        assert ending.asked()
    assert number.name in ending.reason
    assert "closed, judged and reported" in said[0]
    assert signal.getsignal(number) is before


def test_two_presses_at_once_are_one_and_other_signals_never_take_the_verdict() -> None:
    with Ending() as ending, ending.interruptible():
        for number in (signal.SIGINT, signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGQUIT):
            signal.raise_signal(number)
    assert not ending.leaves


TWICE = """
import signal, time
from gse.cli import unexpected
from gse.sessions.live import SAME_PRESS_S, Ending

said = []
with Ending(said.append) as ending:
    signal.raise_signal(signal.SIGINT)
    time.sleep(1.05 * SAME_PRESS_S)
    try:
        with ending.interruptible():
            {code}
            time.sleep(1)
    except BaseException as error:
        print(type(error).__name__, unexpected(error))
    try:
        with ending.interruptible():
            print("it was to be left")
    except KeyboardInterrupt:
        print(said[-1])
"""
AGAIN = "signal.raise_signal(signal.SIGINT)"
LEFT = "Ctrl-C again: the session is closed, but not judged"


@pytest.mark.parametrize(
    ("code", "came"),
    [
        (AGAIN, "KeyboardInterrupt 130"),
        (f"exec('try: {AGAIN}\\nexcept BaseException: raise ValueError')", "ValueError 130"),
        (f"exec('{AGAIN}', {{'__name__': 'llvmlite.binding', 'signal': signal}})", "KeyboardInterrupt 130"),
    ],
    ids=["of Python", "that takes it for an error of its own", "that makes an object of LLVM"],
)
def test_a_second_ctrl_c_breaks_off_what_can_be_broken_off_in_code(code: str, came: str) -> None:
    done = subprocess.run([sys.executable, "-c", TWICE.format(code=code)], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"{came}\n{LEFT}\n", "")


def test_what_waits_is_left_some_time_after_the_signal() -> None:
    for rest_s, is_left in ((0.0, True), (3600.0, False)):
        with Ending(rest_s=rest_s) as ending:
            assert not ending.leaves_the_rest()
            signal.raise_signal(signal.SIGTERM)
            began_s = time.monotonic()
            while time.monotonic() == began_s:
                pass
            assert ending.leaves_the_rest() is is_left


def test_a_hang_up_that_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Ending() as ending:
            signal.raise_signal(signal.SIGHUP)
        assert not ending.asked()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_ctrl_z_stops_no_session_and_says_what_to_press_instead() -> None:
    said: list[str] = []
    before = signal.getsignal(signal.SIGTSTP)
    with Ending(said.append) as ending:
        signal.raise_signal(signal.SIGTSTP)
        assert not ending.asked()
    assert "Ctrl-C ends it" in said[0]
    assert signal.getsignal(signal.SIGTSTP) is before
