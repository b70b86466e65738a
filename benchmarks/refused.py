"""What commands do where nobody takes what they write, or a signal comes: rows of ``faults.py``, and a table.

    python benchmarks/refused.py [COMMAND ...]

Each command of ``gse`` runs as a process of its own: with stdout closed, with stderr closed, in a folder on a full
disk, and with SIGINT, SIGTERM and SIGHUP after half of the time that it takes undisturbed, which is the first code. A
signal that ends it stands as its name; ``end`` is its usual end, before the signal came. Goal: no empty cell, no 70, no
traceback. Prints markdown; half an hour. Root is needed to mount the small disk.
"""

import contextlib
import math
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from PIL import Image

from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX, RecordedMessage
from gse.config.station import BUILT_IN_TEXT

GSE = [sys.executable, "-m", "gse"]
SIZES_KIB = (8, 24, 100, 400)  # of 4, a file of one page takes all and is whole
PATIENCE_S = 180.0
"""Of one command: the 30 s for a full disk twice, its work, and a machine that does other things beside it."""
WRITING = (
    "simulate --seconds 60 --file {disk}/new",
    "run --port sim://?frames=100 --out {disk}/new",
    "replay {given}/session.mcap --out {disk}/new",
    "report {given}/session.mcap --out {disk}/new",
    "report {given}/session.mcap {given}/session.mcap --out {disk}/new",
    "why {given}/session.mcap --bundle {disk}/new",
    "view {given}/session.mcap --save {disk}/new",
    "extract {given}/image.png --out {disk}/new",
    "evaluate --frames 20 --figures {disk}/new",
    "calibrate {given}/session.mcap --write {disk}/new",
    "align {given}/session.mcap --write {disk}/new",
    "session recover {given}/session.mcap --out {disk}/new",
    "session trim {given}/session.mcap --to 2026-03-20T15:00:10Z --out {disk}/new",
    "session export {given}/session.mcap --format csv --out {disk}/new",
    "session export {given}/session.mcap --format rrd --out {disk}/new",
    "session export {given}/session.mcap --format parquet --out {disk}/new",
    "session export {given}/session.mcap --format mcap --out {disk}/new",
    "config init {disk}/new",
    "catalog export --list {disk}/new",
    "campaign judge {given}/session.mcap --to {disk}/new --workers 1",
)
"""The recordings of run and campaign stay as far as the disk took them; all else is whole or not there."""
PRINTING = (
    "--help",
    "no-such-command",
    "replay {given}/session.mcap --out {disk}/new --json-frames",
    "report {given}/session.mcap --out {disk}/new --json",
    "identify {given}/image.png",
    "extract {given}/image.png",
    "session info {given}/session.mcap",
    "decode {given}/session.mcap",
    "config show {given}/station.yaml",
    "config init {disk}/new",
    "catalog info",
    "ports",
    "status {given}",
    "completion bash",
)
STREAMS = (">/dev/full", "2>/dev/full", ">/dev/full 2>&1", ">&-", "2>&-", ">&- 2>&- <&-")
Row = tuple[str, str, str]


def disks(folder: Path) -> list[Row]:
    """Each writing command on disks that are full before, while and after it writes; needs root."""
    given, disk = _given(folder), folder / "disk"
    disk.mkdir()
    codes, untold, halves, hung = Counter[int](), 0, 0, 0
    for command in WRITING:
        at_the_end: list[int] = []  # bytes that a disk holds which is full though the command ended well
        whole = math.inf
        for size in SIZES_KIB:
            subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", disk], check=True)
            words = command.format(given=given, disk=disk).split()
            try:
                done = subprocess.run([*GSE, *words], capture_output=True, text=True, cwd=folder, timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                hung += 1
                subprocess.run(["umount", "-l", disk], check=True)
                continue
            codes[done.returncode] += 1
            is_full = shutil.disk_usage(disk).free == 0 or any(word in done.stderr for word in ("No space", "no room"))
            written = sum(path.stat().st_size for path in disk.rglob("*") if path.is_file())
            if done.returncode in (0, 1, 5) and is_full:
                at_the_end.append(written)
            leaves = words[0] in ("run", "campaign", "simulate")
            halves += done.returncode in (2, 3) and not leaves and any(path.is_file() for path in disk.rglob("*"))
            subprocess.run(["umount", disk], check=True)
            if not is_full and done.returncode in (0, 1, 5):
                whole = written
                break  # it has room enough: a larger disk tells nothing more
        untold += sum(size < whole for size in at_the_end)  # a file may fit exactly
    other = sum(count for code, count in codes.items() if code not in (0, 2, 3, 5))
    what = f"{len(WRITING)} commands, {codes.total() + hung} full disks: other codes, untold, half files, hung"
    return [(what, f"{other}, {untold}, {halves}, {hung}", "0, 0, 0, 0")]


def streams(folder: Path) -> list[Row]:
    """Commands whose stdout or stderr is full or closed."""
    given, disk = _given(folder), folder / "disk"
    wrong, tracebacks = 0, 0
    for command in PRINTING:
        codes = []
        for stream in ("", *STREAMS):
            shutil.rmtree(disk, ignore_errors=True)
            disk.mkdir()
            line = f"'{sys.executable}' -m gse {command.format(given=given, disk=disk)} {stream}"
            done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, cwd=folder)
            codes.append(done.returncode)
            tracebacks += "Traceback" in done.stdout + done.stderr
        wrong += sum(code not in (codes[0], 3) for code in codes[1:])
    what = f"{len(PRINTING)} commands, {len(STREAMS)} kinds of full or closed streams: other codes, tracebacks"
    return [(what, f"{wrong}, {tracebacks}", "0, 0")]


def _given(folder: Path) -> Path:
    given = folder / "given"
    given.mkdir()
    (given / "station.yaml").write_text(BUILT_IN_TEXT + "alarms: {command: ['true']}\n")
    (given / "lab.yaml").write_text(LAB)
    (given / "test.yaml").write_text(TEST)
    lights = np.zeros((64, 64), dtype=np.uint8)
    lights[5::6, 5::6] = 200
    Image.fromarray(lights).save(given / "image.png")
    subprocess.run([*GSE, "extract", str(given / "image.png"), "--out", str(given / "table.csv")], capture_output=True)
    session = given / "session.mcap"
    made = [*GSE, "simulate", "--scenario", "own-answers", "--seconds", "20", "--rate-hz", "5", "--file", str(session)]
    subprocess.run(made, check=True, capture_output=True)
    rx = (record.data for record in read_capture(session) if isinstance(record, RecordedMessage) and record.topic == RX)
    (given / "capture.bin").write_bytes(b"".join(rx))
    judged = [*GSE, "campaign", "judge", str(session), "--out", str(given / "dataset"), "--workers", "1"]
    subprocess.run(judged, check=True, capture_output=True)
    return given


LAB = """\
version: 1
sensor: {name: lab, rows: 1080, columns: 1920, focal_length_px: 5000}
site: {name: lab, latitude_deg: 48, longitude_deg: 11, height_m: 500}
mount: {inertial: {ra_deg: 83, de_deg: -2, roll_deg: 20}}
screen: {pixel_pitch_mm: 0.1, columns: 1920, rows: 1080, focal_length_mm: 500, latency_ms: 30}
"""
TEST = "{version: 1, name: test, station: station.yaml, steps: [wait: {for: 2s}, watch: {for: 20s}]}"


# Every command, disturbed.

MOST_S = 300.0
EVERY = {
    "run": "run --port sim://?frames=100 --out {new} --no-plots",
    "replay": "replay {session} --out {new} --no-plots",
    "report": "report {session} --anew --out {new} --no-plots",
    "view": "view {session} --save {new}.rrd",
    "identify": "identify {given}/table.csv",
    "extract": "extract {given}/image.png --out {new}",
    "evaluate": "evaluate --frames 20 --figures {new}",
    "sessions": "sessions {given}",
    "simulate": "simulate --seconds 20 --file {new}",
    "emulate": "emulate --tcp 127.0.0.1:0",
    "calibrate": "calibrate {session} --write {new}",
    "align": "align {session} --write {new}",
    "compare": "compare {session} {session}",
    "session info": "session info {session}",
    "session verify": "session verify {session}",
    "session recover": "session recover {session} --out {new}",
    "session trim": "session trim {session} --to 2026-03-20T15:00:10Z --out {new}",
    "session import": "session import {given}/capture.bin --start-utc 2026-03-20T15:00:00Z --out {new}.mcap",
    "session export": "session export {session} --format csv --out {new}",
    "decode": "decode {session}",
    "config init": "config init {new}",
    "config check": "config check {given}/station.yaml",
    "config show": "config show {given}/station.yaml",
    "ports": "ports",
    "preflight": "preflight",
    "catalog info": "catalog info",
    "catalog export": "catalog export --list {new}",
    "plan": "plan {session}",
    "why": "why {session} --bundle {new}",
    "selfcheck": "selfcheck",
    "conventions": "conventions {session}",
    "campaign judge": "campaign judge {session} --to {new} --workers 1",
    "campaign report": "campaign report {given}/dataset --out {new}",
    "campaign query": "campaign query {given}/dataset select/**/verdict/**/from/**/sessions",
    "note": "note text {given}",
    "status": "status {given}",
    "completion": "completion bash",
    "protocol check": "protocol check panorama-v1",
    "procedure init": "procedure init {new}",
    "procedure check": "procedure check {given}/test.yaml",
    "procedure run": "procedure run {given}/test.yaml --out {new} --no-plots",
    "screen": "screen --station {given}/lab.yaml",
    "sensor start": "sensor start --station {given}/station.yaml",
    "sensor stop": "sensor stop --station {given}/station.yaml",
    "sensor status": "sensor status --station {given}/station.yaml",
    "sensor request": "sensor request --station {given}/station.yaml",
    "sensor send": "sensor send PING --station {given}/station.yaml",
    "sensor exposure": "sensor exposure 0.2 --station {given}/station.yaml",
    "alarms test": "alarms test --station {given}/station.yaml",
    "ci": "ci {given} --update",
}
RUN_ON = ("emulate", "screen")
"""Commands that a signal ends and nothing else."""
CLOSED = {"stdout closed": ">&-", "stderr closed": "2>&-"}
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def main() -> None:
    """Print the table, and what is wrong in it."""
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        signal.signal(number, handler)  # this script may run under nohup, or in the background
    wrong: list[str] = []
    columns = ["undisturbed", *CLOSED, "disk full", *(number.name for number in SIGNALS)]
    print(f"| command | {' | '.join(columns)} |\n|{'---|' * (len(columns) + 1)}", flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        given = _given(folder)
        for command in sys.argv[1:] or EVERY:
            cells = _row(EVERY[command], folder, given)
            wrong += [
                f"{command}, {column}: {cell}" for column, cell in zip(columns, cells, strict=True) if _is_bad(cell)
            ]
            print(f"| {command} | {' | '.join(cells)} |", flush=True)
    print(f"\n{len(wrong)} cells are wrong: {'; '.join(wrong) or 'none'}")


def _is_bad(cell: str) -> bool:
    return cell.split()[0] in ("70", "hung") or "traceback" in cell


def _row(command: str, folder: Path, given: Path) -> list[str]:
    """The cells of a command."""
    began_s = time.monotonic()
    cells = [_ended(_words(command, _fresh(folder), given), "", folder)]
    half_s = (time.monotonic() - began_s) / 2
    for redirection in CLOSED.values():
        cells.append(_ended(_words(command, _fresh(folder), given), redirection, folder))
    disk = folder / "disk"
    disk.mkdir(exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", disk], check=True)
    try:
        cells.append(_ended(_words(command, disk, given), "", disk))
    finally:
        subprocess.run(["umount", "-l", disk], check=True)
    return [*cells, *(_signalled(_words(command, _fresh(folder), given), number, folder, half_s) for number in SIGNALS)]


def _fresh(folder: Path) -> Path:
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    return out


def _words(command: str, out: Path, given: Path) -> list[str]:
    places = {"given": given, "session": given / "session.mcap", "new": out / "new"}
    return [word.format(**places) for word in command.split()]


def _ended(words: list[str], redirection: str, folder: Path) -> str:
    line = "exec " + " ".join(f"'{word}'" for word in [*GSE, *words]) + f" {redirection}"
    try:
        done = subprocess.run(
            ["bash", "-c", line],
            capture_output=True,
            text=True,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            timeout=_patience(words),
        )
    except subprocess.TimeoutExpired:
        return "runs on" if words[0] in RUN_ON else "hung"
    return _cell(done.returncode, done.stdout + done.stderr)


def _patience(words: list[str]) -> float:
    return 20.0 if words[0] in RUN_ON else MOST_S


def _signalled(words: list[str], number: signal.Signals, folder: Path, after_s: float) -> str:
    process = subprocess.Popen(
        [*GSE, *words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=folder
    )
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(after_s)
    is_over = process.poll() is not None
    process.send_signal(number)
    try:
        said, _ = process.communicate(timeout=MOST_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return "hung"
    return "end" if is_over else _cell(process.returncode, said.decode(errors="replace"))


def _cell(code: int, said: str) -> str:
    shown = signal.Signals(-code).name if code < 0 else str(code)
    if "Traceback" not in said:
        return shown
    print(said[-2000:], file=sys.stderr, flush=True)
    return f"{shown} traceback"


if __name__ == "__main__":
    main()
