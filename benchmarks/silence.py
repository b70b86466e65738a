"""The longest silence of each command on a terminal of 80 columns, and its widest table.

    python benchmarks/silence.py [--only report]

Each command gets a pseudo-terminal as stdin, stdout and stderr. The silence is the time between two pieces of output,
from the start of the process to its end. `run, first` has no compiled code and no tables on disk.
"""

import argparse
import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import tempfile
import termios
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GSE = str(Path(sys.executable).with_name("gse"))
NIGHT = ROOT / "replays" / "night-sky"
COLUMNS = 80
COMMANDS = (
    "run",
    "replay session.mcap",
    "report session.mcap --anew",
    "report session.mcap --anew --pdf",
    "view session.mcap --save view.rrd",
    "calibrate session.mcap",
    "align session.mcap",
    "why session.mcap",
    "plan session.mcap",
    "compare session.mcap --identifier pivot",
    "evaluate --frames 200",
    "catalog info",
    "campaign judge session.mcap --to dataset",
    "campaign report dataset",
    "selfcheck",
    "preflight",
    "config check roof.yaml",
    "decode session.mcap",
    "session verify session.mcap",
    "simulate --seconds 60",
    f"identify {ROOT}/benchmarks/real-sky/tables/rooftop-alt60-azi45.csv --station {NIGHT}/rooftop-alt60-azi45.yaml",
)
_STEERING = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")


def watched(command: list[str], folder: Path, **environment: str) -> tuple[float, float, bytes]:
    """All seconds, the longest silence, and all that was shown."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 30, COLUMNS, 0, 0))
    began_s = last_s = time.monotonic()
    longest_s, shown = 0.0, b""
    with subprocess.Popen(
        [GSE, *command], cwd=folder, stdin=theirs, stdout=theirs, stderr=theirs, env=os.environ | environment
    ) as process:
        os.close(theirs)
        while True:
            try:
                piece = os.read(ours, 65536)
            except OSError:  # how a pseudo-terminal tells its end
                piece = b""
            now_s = time.monotonic()
            longest_s, last_s = max(longest_s, now_s - last_s), now_s
            shown += piece
            if not piece:
                break
        process.wait()
        longest_s = max(longest_s, time.monotonic() - last_s)
    os.close(ours)
    return time.monotonic() - began_s, longest_s, shown


def widest_row(shown: bytes) -> int:
    """The widest line of a table: of more than two columns, with two blanks between them."""
    lines = re.split(r"[\r\n]+", _STEERING.sub("", shown.decode("utf-8", "replace")))
    return max((len(line.rstrip()) for line in lines if len(re.findall(r"\S {2,}\S", line)) > 2), default=0)


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--only", default="")
    asked = options.parse_args()
    print("| command | takes | longest silence | widest row of a table |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for made in ("simulate --seconds 60 --file session.mcap", "config init roof.yaml --yes"):
            subprocess.run([GSE, *made.split()], cwd=folder, check=True, capture_output=True)
        fresh = {"NUMBA_CACHE_DIR": f"{name}/numba", "XDG_CACHE_HOME": f"{name}/cache"}
        for title, command, environment in (("run, first", "run", fresh), *((one, one, {}) for one in COMMANDS)):
            if asked.only in title:
                all_s, longest_s, shown = watched(command.split(), folder, **environment)
                short = re.sub(r"\S*/|session\.mcap ?", "", title).strip()
                print(f"| {short} | {all_s:.1f} s | {longest_s:.2f} s | {widest_row(shown)} |", flush=True)


if __name__ == "__main__":
    main()
