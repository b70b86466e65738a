"""Progress of a long command where stderr is not a terminal."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.session_file.reader import messages
from drivers.session_file.records import RX
from gse.cli.progress import ProgressBar, ReplayedShare, time_left


@pytest.mark.parametrize(
    ("seconds", "text"), [(1, "about 1 s"), (89, "about 89 s"), (90, "about 2 min"), (7200, "about 120 min")]
)
def test_a_few_seconds_are_not_called_a_minute(seconds: float, text: str) -> None:
    assert time_left(seconds) == text


def test_there_is_a_line_at_each_tenth_and_errors_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar("judging", 20) as bar:
        for number in range(20):
            bar.advance(is_error=number == 7)
    lines = [line.split(", ")[0] for line in capsys.readouterr().err.splitlines()]
    assert lines[:3] == ["judging: 2 of 20", "judging: 4 of 20", "judging: 6 of 20"]
    assert lines[3:] == [f"judging (1 with errors): {done} of 20" for done in range(8, 21, 2)]


SESSION = Path(__file__).parents[3] / "replays" / "golden" / "clear.mcap"
BYTES = sum(len(message.data) for message in messages(SESSION, RX))


def test_a_replay_on_a_terminal_says_how_far_it_is() -> None:
    """In a process of its own: whether stderr is a terminal is what decides."""
    ours, theirs = os.openpty()
    show = f"""from pathlib import Path; from gse.cli.progress import ReplayedShare
progress = ReplayedShare(Path({str(SESSION)!r}))
print(repr(progress.text(0)), repr(progress.text({BYTES // 4})))"""
    shown = subprocess.run([sys.executable, "-c", show], stdout=subprocess.PIPE, stderr=theirs, text=True, check=True)
    assert shown.stdout.split("\n")[0] == "'' '25 % done'"
    os.close(theirs)
    os.close(ours)


@pytest.mark.usefixtures("capsys")  # which is no terminal
def test_a_replay_without_a_terminal_does_not() -> None:
    progress = ReplayedShare(SESSION)
    assert (progress.text(0), progress.text(BYTES // 4)) == ("", "")
