"""What the station costs: start, replay, memory, a live run with its view, and latency on a pseudo-terminal.

    python benchmarks/station.py [--night] [--first-run]

Prints a table with the goal beside each figure. Run it on an idle machine; the load is printed with it. On a loaded one
the seconds of CPU, and their ratio to the loop in Python, say more than the clock. ``--night`` also replays 8 hours,
``--first-run`` also compiles everything anew.
"""

import argparse
import json
import os
import platform
import pty
import queue
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from drivers.chunk import Chunk
from drivers.playback import session_items
from protocols import Frame, FrameDecoder, load_protocol

REPLAY_FRAMES = 20_000
NIGHT_FRAMES = 8 * 3600 * 10
LIVE_S = 30
LATENCY_FRAMES = 200
FAST_HZ, FAST_S = 400, 5
GSE = [str(Path(sys.executable).parent / "gse")]
ROOT = Path(__file__).parent.parent
TABLE = ROOT / "benchmarks/real-sky/tables/rooftop-alt60-azi45.csv"
STATION = ROOT / "replays/night-sky/rooftop-alt60-azi45.yaml"

Row = tuple[str, str, str]
"""Name, figure, goal."""


def main() -> None:
    """Measure all and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--night", action="store_true", help="also replay 8 hours")
    parser.add_argument("--first-run", action="store_true", help="also the first run on a computer")
    options = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # what pip installs has its bytecode: a seventh of a start
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.2f}")
    yardstick_s = _additions_s()
    print(f"20 million additions in a Python loop: {yardstick_s:.2f} s of CPU")
    measures: list[Callable[[Path], Sequence[Row]]] = [start, lambda folder: replay(folder, yardstick_s)]
    measures += [lambda folder: night(folder, yardstick_s)] * options.night
    measures += [first_run] * options.first_run + [live, latency, fast]
    for measure in measures:
        with tempfile.TemporaryDirectory() as folder:
            for name, value, goal in measure(Path(folder)):
                print(f"{name:56}  {value:>22}  {goal}", flush=True)


def start(folder: Path) -> list[Row]:
    """Seconds of the clock and of CPU to an answer, tables cached and code compiled."""
    identify = [_run_s([*GSE, "identify", str(TABLE), "--station", str(STATION)]) for _ in range(5)][1:]
    first = [_first_frame_s(folder) for _ in range(5)][1:]
    return [
        ("gse identify, warm", _seconds(identify), "<= 0.6 s"),
        ("gse run, command to first identified frame, warm", _seconds(first), "<= 1.2 s"),
    ]


def first_run(folder: Path) -> list[Row]:
    """The first run on a computer: everything is compiled, all tables are made."""
    anew = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "numba"), "XDG_CACHE_HOME": str(folder / "cache")}
    return [("gse run, first run on a computer", _seconds([_first_frame_s(folder, anew)]), "<= 12 s")]


def _first_frame_s(folder: Path, environment: dict[str, str] | None = None) -> tuple[float, float]:
    """Seconds of the clock and of CPU to the first identified frame."""
    command = [*GSE, "run", "--port", "sim://?frames=20&speed=1", "--json-frames", "--out", str(folder / "first")]
    started = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if b'"IDENTIFIED"' in line:
                break
        taken = time.perf_counter() - started, _cpu_s(process.pid)
        process.kill()
    return taken


def _run_s(command: list[str]) -> tuple[float, float]:
    """Seconds of the clock and of CPU of a command."""
    before, started = _children_cpu_s(), time.perf_counter()
    subprocess.run(command, check=False, capture_output=True)
    return time.perf_counter() - started, _children_cpu_s() - before


def _seconds(taken: list[tuple[float, float]]) -> str:
    clock, cpu = (statistics.median(column) for column in zip(*taken, strict=True))
    return f"{clock:.2f} s, {cpu:.2f} s CPU"


def replay(folder: Path, yardstick_s: float) -> list[Row]:
    """Frames per second of a replay at speed max, from bytes to report, and identification times in it."""
    few, many = (_recorded(folder, frames) for frames in (100, REPLAY_FRAMES))
    first, all_of_it = _replayed(few, folder / "few"), _replayed(many, folder / "many")
    each_us = 1e6 * (all_of_it.cpu_s - first.cpu_s) / (REPLAY_FRAMES - 100)
    both_us = 1e6 * (all_of_it.clock_s - first.clock_s) / (REPLAY_FRAMES - 100)
    return [
        (
            "identification of a 30-object panorama in a replay",
            f"{all_of_it.identification_us['p50']:.0f} us",
            "< 200 ms (LAPAN paper)",
        ),
        ("start, tables and report of 100 frames", f"{first.cpu_s:.2f} s CPU", ""),
        ("each further frame", f"{each_us:.0f} us CPU", "<= 100 us"),
        ("   against 1000 additions in a Python loop", f"{each_us / (yardstick_s / 20_000 * 1e6):.2f}", ""),
        ("   on one core, by its CPU", f"{1e6 / each_us:.0f} frames/s", ">= 10000 frames/s"),
        ("   on two cores, by the clock", f"{1e6 / both_us:.0f} frames/s", ">= 16000 frames/s"),
        (f"{REPLAY_FRAMES} frames, clock and CPU", f"{all_of_it.clock_s:.2f} s, {all_of_it.cpu_s:.2f} s", ""),
        (f"memory of a replay of {REPLAY_FRAMES} frames", f"{all_of_it.peak_mib:.0f} MiB", "<= 350 MiB"),
    ]


def night(folder: Path, yardstick_s: float) -> list[Row]:
    """8 hours at 10 Hz, from bytes to report; and a frame of them, without what a report of few frames does without."""
    begin, whole = (_recorded(folder, frames) for frames in (REPLAY_FRAMES, NIGHT_FRAMES))
    first, all_of_it = _replayed(begin, folder / "begin"), _replayed(whole, folder / "night")
    each_us = 1e6 * (all_of_it.cpu_s - first.cpu_s) / (NIGHT_FRAMES - REPLAY_FRAMES)
    both_us = 1e6 * (all_of_it.clock_s - first.clock_s) / (NIGHT_FRAMES - REPLAY_FRAMES)
    return [
        ("8 hours at 10 Hz, bytes to report", f"{all_of_it.clock_s:.1f} s, {all_of_it.cpu_s:.1f} s CPU", "<= 30 s"),
        ("   memory", f"{all_of_it.peak_mib:.0f} MiB", "<= 350 MiB"),
        (f"   each frame after the first {REPLAY_FRAMES}", f"{each_us:.0f} us CPU", "<= 100 us"),
        ("      against 1000 additions in a Python loop", f"{each_us / (yardstick_s / 20_000 * 1e6):.2f}", ""),
        ("      on one core", f"{1e6 / each_us:.0f} frames/s", ">= 10000 frames/s"),
        ("      on two cores, by the clock", f"{1e6 / both_us:.0f} frames/s", ">= 16000 frames/s"),
    ]


def _recorded(folder: Path, frames: int) -> Path:
    """A simulated session of so many frames."""
    recording = folder / f"{frames}.mcap"
    command = [*GSE, "simulate", "--seconds", str(frames / 10), "--rate-hz", "10", "--file", str(recording)]
    subprocess.run(command, check=True, capture_output=True)
    return recording


class _Used(NamedTuple):
    """What a replay took, and the identification times in it."""

    clock_s: float
    cpu_s: float
    peak_mib: float
    identification_us: dict[str, float]


def _replayed(session: Path, out: Path) -> _Used:
    """What ``gse replay`` takes."""
    started = time.perf_counter()
    command = [*GSE, "replay", str(session), "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    taken_s = time.perf_counter() - started
    (timing,) = out.glob("*/timing.json")
    times: dict[str, float] = json.loads(timing.read_text())["identification_us"]
    return _Used(taken_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, times)


def latency(folder: Path) -> list[Row]:
    """Milliseconds from the last byte of a frame on a pty to its line of JSON, at 10 Hz with the view on."""
    frames = _frames(folder, LATENCY_FRAMES + 20)
    with _PtySensor(folder, "--view", "web") as station:
        waited_ms = [station.answered_ms(frame, 0.1) for frame in frames][20:]
    ordered = sorted(waited_ms)
    p99_ms = ordered[round(0.99 * (len(ordered) - 1))]
    return [
        ("pty at 10 Hz with the view: last byte to JSON line, p50", f"{statistics.median(ordered):.2f} ms", "<= 2 ms"),
        ("   p99", f"{p99_ms:.2f} ms", "<= 10 ms"),
    ]


def fast(folder: Path) -> list[Row]:
    """Whether a station on a pty keeps up with 400 frames a second."""
    frames = _frames(folder, FAST_HZ * FAST_S)
    with _PtySensor(folder) as station:
        began = time.perf_counter()
        for count, frame in enumerate(frames):
            time.sleep(max(0.0, began + count / FAST_HZ - time.perf_counter()))
            station.send(frame)
        answered = sum(1 for _ in iter(station.next_answer, None))
    return [(f"pty at {FAST_HZ} frames/s: answers", f"{answered} of {len(frames)}", "all")]


def _frames(folder: Path, count: int) -> list[bytes]:
    """The bytes of the first panoramas of a simulated sensor."""
    recording = _recorded(folder, count + count // 10 + 10)
    data = b"".join(item.data for item in session_items(recording) if isinstance(item, Chunk))
    found = FrameDecoder(load_protocol("panorama-v1")).feed(data)
    frames = [
        data[piece.start : piece.start + piece.size]
        for piece in found
        if isinstance(piece, Frame) and piece.type == "PANORAMA"
    ]
    return frames[:count]


class _PtySensor:
    """A sensor on a pseudo-terminal with a station that listens to it."""

    def __init__(self, folder: Path, *options: str) -> None:
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        command = [*GSE, "run", "--port", os.ttyname(slave), "--json-frames", "--out", str(folder / "pty"), *options]
        self._station = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert self._station.stderr is not None
        for line in self._station.stderr:
            if b"OPENED" in line:
                break
        self._answers: queue.Queue[float] = queue.Queue()
        for reading in (self._station.stderr.read, self._read):
            threading.Thread(target=reading, daemon=True).start()

    def _read(self) -> None:
        for _ in self._station.stdout or ():
            self._answers.put(time.perf_counter())

    def __enter__(self) -> "_PtySensor":
        return self

    def __exit__(self, *_: object) -> None:
        self._station.kill()
        self._station.wait()

    def send(self, frame: bytes) -> None:
        """Write a frame."""
        os.write(self._master, frame)

    def answered_ms(self, frame: bytes, pause_s: float) -> float:
        """Milliseconds from the last byte of a frame to its answer; then a pause."""
        self.send(frame)
        sent = time.perf_counter()
        waited = (self.next_answer(60.0) or sent) - sent
        time.sleep(max(0.0, pause_s - waited))
        return 1000 * waited

    def next_answer(self, within_s: float = 3.0) -> float | None:
        """When the next answer came, None where none comes."""
        try:
            return self._answers.get(timeout=within_s)
        except queue.Empty:
            return None


def live(folder: Path) -> list[Row]:
    """CPU share of a run at 10 Hz with the live view on, start and report left out."""
    port = f"sim://?speed=1&frames={LIVE_S * 10 + 300}"
    command = [*GSE, "run", "--view", "web", "--port", port, "--json-frames", "--out", str(folder / "live")]
    frames = folder / "live.ndjson"
    with frames.open("wb") as out, subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL) as process:
        while not frames.stat().st_size:
            time.sleep(0.1)
        time.sleep(5)
        used, started = _cpu_s(process.pid), time.perf_counter()
        time.sleep(LIVE_S)
        share = (_cpu_s(process.pid) - used) / (time.perf_counter() - started)
        process.kill()
    return [("gse run at 10 Hz with the live view, of one core", f"{share:.0%}", "<= 25 %")]


def _additions_s() -> float:
    """How fast this machine is just now: shared ones change by a factor of two within minutes."""
    started, total = time.process_time(), 0
    for number in range(20_000_000):
        total += number
    return time.process_time() - started


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
