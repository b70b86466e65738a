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

REPLAY_FRAMES = 10_000
LIVE_S = 30
GSE = [str(Path(sys.executable).parent / "gse")]


def main() -> None:
    """Measure all and print the table."""
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.2f}")
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
    run = [*GSE, "run", "--port", f"sim://?frames={REPLAY_FRAMES}", "--out", str(folder / "night")]
    subprocess.run(run, check=True, capture_output=True)
    (session,) = (folder / "night").glob("*/session.mcap")
    started, before = time.perf_counter(), _children_cpu_s()
    subprocess.run([*GSE, "replay", str(session), "--out", str(folder / "again")], check=True, capture_output=True)
    wall_s, cpu_s = time.perf_counter() - started, _children_cpu_s() - before
    (timing,) = (folder / "again").glob("*/timing.json")
    times = json.loads(timing.read_text())["identification_us"]
    return [
        ("identification of a 30-object panorama, median", f"{times['p50']:.0f} us", "< 200 ms [S]"),
        ("identification of a 30-object panorama, p95", f"{times['p95']:.0f} us", "< 200 ms [S]"),
        ("replay at speed max, bytes to report, wall", f"{REPLAY_FRAMES / wall_s:.0f} frames/s", ">= 1500 frames/s"),
        ("replay at speed max, bytes to report, CPU", f"{REPLAY_FRAMES / cpu_s:.0f} frames/s", ">= 1500 frames/s"),
    ]


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


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
