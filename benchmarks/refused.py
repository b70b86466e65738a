"""What commands do where nobody takes what they write: rows of ``faults.py``."""

import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from PIL import Image

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
            untold += is_full and done.returncode in (0, 1, 5)
            leaves = words[0] in ("run", "campaign", "simulate")
            halves += done.returncode in (2, 3) and not leaves and any(path.is_file() for path in disk.rglob("*"))
            subprocess.run(["umount", disk], check=True)
            if not is_full and done.returncode in (0, 1, 5):
                break  # it has room enough: a larger disk tells nothing more
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
    (given / "station.yaml").write_text(BUILT_IN_TEXT)
    lights = np.zeros((64, 64), dtype=np.uint8)
    lights[5::6, 5::6] = 200
    Image.fromarray(lights).save(given / "image.png")
    made = [*GSE, "simulate", "--seconds", "20", "--rate-hz", "5", "--file", str(given / "session.mcap")]
    subprocess.run(made, check=True, capture_output=True)
    return given
