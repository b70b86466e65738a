"""What the station costs: identification, replay, a live run with its view, and the wait for the first frame.

    python benchmarks/station.py

Prints a table with the goal beside each figure. Run it on an idle machine; the load is printed with it.
"""

import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

REPLAY_FRAMES = 20_000
LIVE_S = 30
GSE = [str(Path(sys.executable).parent / "gse")]


def main() -> None:
    """Measure all and print the table."""
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.2f}")
    print(f"20 million additions in a Python loop: {_additions_s():.2f} s of CPU")
    with tempfile.TemporaryDirectory() as folder:
        rows = [*first_frame(Path(folder)), *replay(Path(folder)), *live(Path(folder))]
    width = max(len(row[0]) for row in rows)
    for name, value, goal in rows:
        print(f"{name:{width}}  {value:>14}  {goal}")


def first_frame(folder: Path) -> list[tuple[str, str, str]]:
    """Seconds from the command to the first identified frame, tables cached and code compiled."""
    command = [*GSE, "run", "--port", "sim://?frames=20&speed=1", "--json-frames", "--out", str(folder / "first")]
    seconds = []
    for _ in range(4):
        started = time.perf_counter()
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if b'"IDENTIFIED"' in line:
                    seconds.append(time.perf_counter() - started)
                    break
            process.kill()
    return [("command to first identified frame, warm", f"{statistics.median(seconds[1:]):.2f} s", "<= 5 s")]


def replay(folder: Path) -> list[tuple[str, str, str]]:
    """Frames per second of a replay at speed max, from bytes to report, and identification times in it."""
    few_s, _ = _replayed(folder / "few", 100)
    cpu_s, times = _replayed(folder / "many", REPLAY_FRAMES)
    each = (REPLAY_FRAMES - 100) / (cpu_s - few_s)
    return [
        ("identification of a 30-object panorama, median", f"{times['p50']:.0f} us", "< 200 ms [S]"),
        ("identification of a 30-object panorama, p95", f"{times['p95']:.0f} us", "< 200 ms [S]"),
        (
            f"replay of {REPLAY_FRAMES} frames, bytes to report",
            f"{REPLAY_FRAMES / cpu_s:.0f} frames/s",
            ">= 1500 frames/s",
        ),
        ("   of which start, tables and report", f"{few_s:.2f} s", ""),
        ("   and each further frame", f"{each:.0f} frames/s", ">= 1500 frames/s"),
    ]


def _replayed(folder: Path, frames: int) -> tuple[float, dict[str, float]]:
    """Seconds of CPU of the replay of a session of so many frames, and the identification times in it."""
    subprocess.run(
        [*GSE, "run", "--port", f"sim://?frames={frames}", "--out", str(folder)], check=False, capture_output=True
    )
    (session,) = folder.glob("*/session.mcap")
    before = _children_cpu_s()
    subprocess.run([*GSE, "replay", str(session), "--out", str(folder / "again")], check=False, capture_output=True)
    cpu_s = _children_cpu_s() - before
    (timing,) = (folder / "again").glob("*/timing.json")
    return cpu_s, json.loads(timing.read_text())["identification_us"]


def live(folder: Path) -> list[tuple[str, str, str]]:
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
