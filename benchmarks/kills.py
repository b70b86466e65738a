"""What ``kill -9`` costs: at random moments of a session, at rates and loads of a bad day.

    python benchmarks/kills.py [--kills 200] [--whole 40] [--seed 1]

Each session listens on a pty of its own, at 10 to 400 frames per second, beside 0 to 8 processes that only compute. The
first ``--whole`` of them are whole ``gse run`` processes, killed in the first ten seconds after their port is open: so
while tables are loaded, and while frames are judged. The others are link and recorder alone, killed within 1.5 s.
Prints markdown.

The age of a lost frame is that from before it was sent until after the kill: the pauses of this program count as the
station's. A computer that is busy with other work does not run the station for a while either: beside each age stands
by how much a process that only sleeps, a millisecond at a time, was late in the same time.
"""

import argparse
import itertools
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from faults import RECORD

from drivers.chunk import Chunk
from drivers.link import SerialLink
from drivers.mock_ports import replay_url
from drivers.session_file.reader import read_capture, verify
from drivers.session_file.records import RX, RecordedMessage

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from devices.hostile_sessions import frames
from devices.terminal import Terminal

RATES_HZ = (10, 25, 100, 400)
MOST_BURNERS = 8
OLD_S = 0.050
WHOLE_WITHIN_S, RECORDER_WITHIN_S = 10.0, 1.5
SLEEP = """
import sys, time
while True:
    time.sleep(0.001)
    print(time.monotonic(), flush=True)
"""
FRAMES = frames(4100, np.random.default_rng(1))


@dataclass(frozen=True)
class Loss:
    """What one kill cost: frames, seconds since the oldest of them was sent, and what is wrong with the file.

    ``late_s`` is how late a process that only sleeps was since then.
    """

    whole: bool
    rate_hz: int
    burners: int
    sent: int
    lost: int
    oldest_s: float
    late_s: float
    corrupt: str


def main() -> None:
    """Kill as often as asked, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--whole", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    losses = []
    for number in range(options.kills):
        with tempfile.TemporaryDirectory() as folder:
            losses.append(kill(Path(folder), rng, whole=number < options.whole))
            print(number, losses[-1], file=sys.stderr, flush=True)
    print(markdown(losses))


def kill(folder: Path, rng: random.Random, *, whole: bool) -> Loss:
    """One session that is killed at a random moment."""
    rate_hz, burners = rng.choice(RATES_HZ), rng.randint(0, MOST_BURNERS)
    terminal = Terminal(folder / "tty")
    with _station(folder, terminal, whole=whole) as process, _burning(burners), _sleeping(folder / "woke") as woke:
        sent_s = _feed(terminal, rate_hz, rng.uniform(0.02, WHOLE_WITHIN_S if whole else RECORDER_WITHIN_S))
        process.kill()
        killed_s = time.monotonic()
        process.wait()
        while not (woke_s := _times(woke)) or woke_s[-1] < killed_s:
            time.sleep(0.001)
    terminal.unplug()
    (path,) = folder.glob("**/session.mcap")
    received = b"".join(r.data for r in read_capture(path) if isinstance(r, RecordedMessage) and r.topic == RX)
    complete = _complete(received)
    oldest_sent_s = sent_s[complete] if complete < len(sent_s) else killed_s
    return Loss(
        whole=whole,
        rate_hz=rate_hz,
        burners=burners,
        sent=len(sent_s),
        lost=len(sent_s) - complete,
        oldest_s=killed_s - oldest_sent_s,
        late_s=_late_s(woke_s, oldest_sent_s, killed_s),
        corrupt=_corrupt(path, received),
    )


@contextmanager
def _station(folder: Path, terminal: Terminal, *, whole: bool) -> Iterator["subprocess.Popen[str]"]:
    """A process that records the port, from when the port is open."""
    command = [sys.executable, "-c", RECORD, str(terminal.path), str(folder / "session.mcap")]
    if whole:
        command = [sys.executable, "-m", "gse", "run", "--port", str(terminal.path), "--out", str(folder / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        while not process.stdout.readline().startswith(("open", "recording:")):
            assert process.poll() is None
        yield process
        process.kill()


@contextmanager
def _burning(count: int) -> Iterator[None]:
    """Processes that compute while the frames are sent."""
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


@contextmanager
def _sleeping(path: Path) -> Iterator[Path]:
    """A process that sleeps a millisecond at a time, and the file of when it woke."""
    with path.open("wb") as file, subprocess.Popen([sys.executable, "-c", SLEEP], stdout=file) as sleeper:
        try:
            yield path
        finally:
            sleeper.kill()


def _times(path: Path) -> list[float]:
    """The whole lines of a file of times."""
    return [float(line) for line in path.read_text().split("\n")[:-1]]


def _late_s(woke_s: list[float], begin_s: float, end_s: float) -> float:
    """How much longer than its millisecond the longest sleep between two times was."""
    inside = [
        min(later, end_s) - max(sooner, begin_s)
        for sooner, later in itertools.pairwise([0.0, *woke_s])
        if later > begin_s and sooner < end_s
    ]
    return max(0.0, max(inside) - 0.001)


def _feed(terminal: Terminal, rate_hz: int, seconds: float) -> list[float]:
    """Send frames; when each was sent."""
    sent_s: list[float] = []
    began_s = time.monotonic()
    while (now_s := time.monotonic()) - began_s < seconds:
        sent_s.append(now_s)
        terminal.write(FRAMES[len(sent_s) - 1])
        time.sleep(max(0.0, began_s + len(sent_s) / rate_hz - time.monotonic()))
    return sent_s


def _complete(received: bytes) -> int:
    """How many frames came whole."""
    size, number = 0, 0
    while (size := size + len(FRAMES[number])) <= len(received):
        number += 1
    return number


def _corrupt(path: Path, received: bytes) -> str:
    """What is wrong with a file, besides its missing end; empty where nothing is."""
    if b"".join(FRAMES)[: len(received)] != received:
        return "other bytes than were sent"
    if any(damage.reason != "cut off" for file in verify(path).files for damage in file.damages):
        return "damaged"
    with SerialLink(replay_url(path)) as link:
        replayed = b""
        while not link.at_end:
            replayed += b"".join(item.data for item in link.receive(1.0) if isinstance(item, Chunk))
    return "" if replayed == received else "replays otherwise"


def markdown(losses: list[Loss]) -> str:
    """A table by what was killed and the load beside it."""
    lines = [
        "| killed | computing beside it | kills | frames sent | lost, oldest, a sleeper late by | older than 50 ms"
        " | and than 50 ms and the sleeper's lateness | corrupt |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for whole, name in ((True, "`gse run`"), (False, "link and recorder")):
        for least, most in ((0, 2), (3, 5), (6, 8)):
            some = [loss for loss in losses if loss.whole is whole and least <= loss.burners <= most]
            if some:
                lines.append(f"| {name} | {least} to {most} processes | {_cells(some)} |")
    return "\n".join(lines)


def _cells(losses: list[Loss]) -> str:
    old = sum(loss.lost for loss in losses if loss.oldest_s > OLD_S)
    beyond = sum(loss.lost for loss in losses if loss.oldest_s - loss.late_s > OLD_S)
    oldest = max(losses, key=lambda loss: loss.oldest_s)
    lost = sum(loss.lost for loss in losses)
    corrupt = sum(bool(loss.corrupt) for loss in losses)
    cost = f"{lost}, {1e3 * oldest.oldest_s:.1f} ms, {1e3 * oldest.late_s:.1f} ms"
    return f"{len(losses)} | {sum(loss.sent for loss in losses)} | {cost} | {old} | {beyond} | {corrupt}"


if __name__ == "__main__":
    main()
