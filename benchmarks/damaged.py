"""What commands say of sessions of which a part is missing: a row of ``faults.py``."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

GSE = [sys.executable, "-m", "gse"]
READING = (
    "report {session} --out {new}",
    "report {whole} {session} --out {new}",
    "replay {session} --out {new}",
    "compare {whole} {session}",
    "view {session} --save {new}",
    "calibrate {session}",
    "align {session}",
    "conventions {session}",
    "decode {session}",
    "session verify {session}",
    "session trim {session} --from 2026-03-20T15:00:02Z --out {new}",
    "session export {session} --format csv --out {new}",
    "session export {session} --format ndjson --out {new}",
    "session export {session} --format parquet --out {new}",
)
HARMS = {
    "its end": lambda data: data[: len(data) * 6 // 10],
    "its last 20 bytes": lambda data: data[:-20],
    "all but its first 100 bytes": lambda data: data[:100],
    "a bit": lambda data: data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 4]) + data[len(data) // 2 + 1 :],
    "16 KiB, zeroed": lambda data: data[: len(data) // 2] + bytes(16 << 10) + data[len(data) // 2 + (16 << 10) :],
    "its station file": lambda data: data.replace(b"focal_length_px", b"focal_length_PX", 1),
    "all": lambda data: b"",
    "its magic": lambda data: b"PNG" + data[3:],
}
Row = tuple[str, str, str]


def damaged(folder: Path) -> list[Row]:
    """Each command on each damaged session: 3 or a refusal, never the code of a whole session."""
    whole = folder / "whole.mcap"
    made = [*GSE, "simulate", "--scenario", "own-answers", "--seconds", "70", "--rate-hz", "5", "--file", str(whole)]
    subprocess.run(made, check=True, capture_output=True)
    codes, tracebacks, passed = Counter[int](), 0, 0
    for number, harm in enumerate(HARMS.values()):
        session = folder / f"{number}.mcap"
        session.write_bytes(harm(whole.read_bytes()))
        for place, command in enumerate(READING):
            words = command.format(whole=whole, session=session, new=folder / f"new-{number}-{place}").split()
            done = subprocess.run([*GSE, *words], capture_output=True, text=True)
            codes[done.returncode] += 1
            tracebacks += "Traceback" in done.stdout + done.stderr
            passed += any(line in ("PASS", "PASS (SIMULATED)") for line in done.stdout.splitlines()[:1])
    other = sum(count for code, count in codes.items() if code not in (2, 3))
    what = f"{len(READING)} commands, sessions without {len(HARMS)} parts: not 2 or 3, tracebacks, a bare PASS"
    return [(what, f"{other}, {tracebacks}, {passed}", "0, 0, 0")]
