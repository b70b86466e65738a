"""A session beside other programs: half an hour of a sensor, while two others take processor and disk.

    python benchmarks/burners.py [--minutes 30] [--rate-hz 20] [--folder /tmp]

A simulated sensor under a night sky that is there now sends its frames to a pty, each at its time; ``gse run`` records
and judges them on the disk of ``--folder``. One process beside it computes without end, one writes, flushes and
deletes 64 MB files on the same disk; both give way to others (nice). Prints markdown: bytes that are missing or others,
how long the sensor had to wait at most (a real one cannot), events of recorder and link, memory, and the verdict.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from datetime import UTC, datetime, timedelta
from pathlib import Path

from endings import night_station

from drivers.chunk import Chunk
from drivers.link import SerialLink
from drivers.session_file.reader import read_capture, verify
from drivers.session_file.records import EVENTS, RX, RecordedMessage
from drivers.urlhandlers.protocol_sim import register
from gse.config.station import Station, parse_station
from gse.simulator import device_factory

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from devices.terminal import Terminal

NICE = 10
STARTS_WITHIN_S = 40
"""Time for the session to open its port and load its tables before the first frame is due."""
COMPUTES = "while True: pass"
WRITES = """
import os, sys
block = os.urandom(1 << 20)
while True:
    with open(sys.argv[1], "wb") as file:
        for _ in range(64):
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
    os.unlink(sys.argv[1])
"""


def main() -> None:
    """Run the session and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate-hz", type=int, default=20)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        print("| what | measured | goal |\n|---|---|---|")
        for what, value, goal in session(Path(folder), round(60 * options.minutes), options.rate_hz):
            print(f"| {what} | {value} | {goal} |", flush=True)


def session(folder: Path, seconds: int, rate_hz: int) -> list[tuple[str, str, str]]:
    """One session beside the burners."""
    path = night_station(folder)
    first_utc = datetime.now(UTC) + timedelta(seconds=STARTS_WITHIN_S)
    chunks = sky_chunks(parse_station(path.read_text()), first_utc, rate_hz, seconds * rate_hz)
    terminal = Terminal(folder / "tty")
    burners = [
        subprocess.Popen(["nice", "-n", str(NICE), sys.executable, "-c", COMPUTES]),
        subprocess.Popen(["nice", "-n", str(NICE), sys.executable, "-c", WRITES, str(folder / "burnt")]),
    ]
    try:
        command = [sys.executable, "-m", "gse", "run", "--station", str(path), "--port", str(terminal.path)]
        command += ["--out", str(folder / "out"), "--clock-error", "1ms", "--view", "web", "--http-port", "0"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        loads: list[float] = []
        sampling = threading.Event()
        threading.Thread(target=_sample, args=(loads, sampling), daemon=True).start()
        late_s = _feed(terminal, chunks)
        time.sleep(1.0)
        sampling.set()
        process.terminate()
        _, status, usage = os.wait4(process.pid, 0)
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
    terminal.unplug()
    (found,) = (folder / "out").iterdir()
    load = f"{min(loads):.0f} to {max(loads):.0f}"
    memory = f"{usage.ru_maxrss / 1024:.0f} MiB, {usage.ru_utime + usage.ru_stime:.0f} s"
    return [
        *_rows(found, chunks, late_s, load),
        ("memory, processor time", memory, ""),
        ("exit code", str(os.waitstatus_to_exitcode(status)), "0"),
    ]


def sky_chunks(station: Station, first_utc: datetime, rate_hz: int, count: int) -> list[Chunk]:
    """What the simulated sensor sends from this instant on, with the times at which it does."""
    register(device_factory(station))
    start = first_utc.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    with SerialLink(f"sim://?start={start}&rate_hz={rate_hz}&frames={count}") as link:
        items = []
        while not link.at_end:
            items += link.receive(1.0)
    return [item for item in items if isinstance(item, Chunk)]


def _feed(terminal: Terminal, chunks: list[Chunk]) -> float:
    """Send each chunk at its time; how many seconds the longest of them took."""
    worst_s = 0.0
    for chunk in chunks:
        time.sleep(max(0.0, chunk.utc_ns * 1e-9 - time.time()))
        sent_s = time.monotonic()
        terminal.write(chunk.data)
        worst_s = max(worst_s, time.monotonic() - sent_s)
    return worst_s


def _sample(loads: list[float], end: threading.Event) -> None:
    """The load of the machine, each ten seconds."""
    loads.append(os.getloadavg()[0])
    while not end.wait(10.0):
        loads.append(os.getloadavg()[0])


def _rows(found: Path, chunks: list[Chunk], late_s: float, load: str) -> list[tuple[str, str, str]]:
    records = [record for record in read_capture(found / "session.mcap") if isinstance(record, RecordedMessage)]
    received = b"".join(record.data for record in records if record.topic == RX)
    sent = b"".join(chunk.data for chunk in chunks)
    kinds = Counter(record.event().kind for record in records if record.topic == EVENTS)
    same = "identical" if received == sent else "NOT identical"
    report = json.loads((found / "report.json").read_text())
    return [
        (f"{len(sent)} bytes sent, load {load}: lost", f"{len(sent) - len(received)}, {same}", "0"),
        ("the sensor had to wait at most (a real one cannot)", f"{late_s * 1e3:.0f} ms", "< 600 ms: 64 KiB"),
        ("file", "whole" if verify(found / "session.mcap").is_whole else "NOT whole", "whole"),
        ("recorded events", ", ".join(f"{kind} {count}" for kind, count in sorted(kinds.items())), ""),
        ("frames received; verdict", f"{report['link']['frames']}; {report['verdict']}", "PASS"),
    ]


if __name__ == "__main__":
    main()
