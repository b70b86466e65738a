"""Every command that the help texts, README and docs show, run in a folder of its own: its exit code, and how long.

    python benchmarks/examples.py [--only plan]

Files that the commands name are made first; a simulated sensor stands behind `/dev/ttyUSB0` and `roof.yaml`. Long ones
are made short, ones that go on until they are ended get Ctrl-C after some seconds; those that need what is not here are
listed with the reason. The exit code is 1 where a command ends with one that says that it was used wrongly (2), that
it has no device (4), or that it broke (70).
"""

import argparse
import contextlib
import os
import re
import shlex
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from astropy.io import fits
from PIL import Image

from gse.cli.commands import EXAMPLES

ROOT = Path(__file__).resolve().parents[1]
GSE = str(Path(sys.executable).with_name("gse"))
SESSION = "sessions/20260320T183000Z-ST-1"
NIGHT = ROOT / "replays" / "night-sky"
REAL_SKY = ROOT / "benchmarks" / "real-sky"
TEXTS = sorted(
    path
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"))
    if path.name not in ("command-line.md", "tutorial.md")  # made from the help texts; run by a test
)
_SHOWN = re.compile(r"^    (?:\$ )?(gse [^#\n]*)", re.MULTILINE)
ELSEWHERE = {
    r"s3://": "needs a server of S3 (tests/gse/campaign has one)",
    r"tcp://": "needs a Dask scheduler (tests/gse/campaign has one)",
    r"\./onboard": "the reader's own program",
    r"^gse (note \"dew|status --stop \S)": "needs a running session of this name",
}
_GOES_ON = re.compile(r"^gse (emulate|view( \S+)? --view web)")
ENDED_AFTER_S = 12
_WRONG = (2, 4, 70)
SHORTER = (
    ("frames=36000", "frames=300"),
    ("30m", "2s"),
    ("--seconds 600", "--seconds 30"),
    ("--frames 1000", "--frames 100"),
    ("--preset lapan", "--preset lapan --frames 20"),
    ("--panoramas benchmarks/real-sky", "--panoramas benchmarks/real-sky --frames 50"),
    ("gse ci replays", "gse ci replays/golden"),
    ("gse config init roof.yaml", "rm -f another.yaml; gse config init another.yaml"),
    ("campaign report dataset --out campaign", "campaign report dataset --out page"),
    ("--out panorama.csv", "--out extracted.csv"),
    ("gse catalog export --list stars.csv", "gse catalog export --list more-stars.csv"),
    ("clear.mcap -o ", "clear.mcap -o clear-"),
    ("sensor exposure 0.2", "sensor exposure 0.05"),  # longer than the period of `sensor start`, which is refused then
)
"""What makes an example long, or meets a file of another one, and its stand-in."""


def commands() -> list[str]:
    """All that are shown, each once."""
    helped = [example for pair in EXAMPLES.values() for example in pair]
    read = [line.strip() for path in TEXTS for line in _SHOWN.findall(path.read_text(encoding="utf-8"))]
    return list(dict.fromkeys([*helped, *read]))


def reason_to_leave_out(line: str) -> str:
    """Why a command is not run; empty for one that is."""
    return next((why for pattern, why in ELSEWHERE.items() if re.search(pattern, line)), "")


def printed(name: str, begin: str, end: str) -> str:
    """A program that a page of docs shows."""
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    start = text.index(begin)
    return textwrap.dedent("    " + text[start : text.index(end, start) + len(end)]) + "\n"


def shell(text: str, folder: Path, **options: object) -> "subprocess.CompletedProcess[str]":
    """Run a command line in the folder."""
    text = re.sub(r"(^|[|;&] |INT \d+ )gse ", rf"\1{shlex.quote(GSE)} ", text)
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    home = os.environ | {"HOME": str(folder), "XDG_CACHE_HOME": cache}
    command = ["bash", "-c", text]
    return subprocess.run(command, cwd=folder, env=home, text=True, capture_output=True, timeout=600, **options)


@contextlib.contextmanager
def prepared(folder: Path) -> Iterator[None]:
    """The files that the examples name, and a sensor."""
    with subprocess.Popen([GSE, "emulate", "--pty", "--dark"], stdout=subprocess.PIPE, text=True) as sensor:
        try:
            assert sensor.stdout is not None
            port = sensor.stdout.readline().strip()
            for line in (
                f"gse config init roof.yaml --yes --port {port}",
                "cp roof.yaml station.yaml; mkdir -p .config/fish/completions",
                f"mkdir -p nights {SESSION} sessions/20260320T183000Z-sensor",
                "gse simulate --seconds 120 --start-utc 2026-03-20T18:29:00Z --file nights/one.mcap",
                f"cp nights/one.mcap {SESSION}/session.mcap",
                f"cp {ROOT}/replays/golden/own-answers.mcap sessions/20260320T183000Z-sensor/session.mcap",
                "cp nights/one.mcap session.mcap; cp nights/one.mcap before.mcap; cp nights/one.mcap after.mcap",
                "gse session export session.mcap --format raw --out capture.bin",
                f"cp {REAL_SKY}/tables/rooftop-alt60-azi45.csv panorama.csv",
                f"cp {ROOT}/replays/golden/clear.mcap .",
                "printf 'extends: panorama-v1\\nname: mine\\n' > sensor.yaml",
                f"ln -s {ROOT}/protocols .; mkdir -p replays/golden benchmarks",
                f"cp -r {NIGHT} replays; cp -r {REAL_SKY} benchmarks",
                f"cp $(ls -S {ROOT}/replays/golden/*.mcap | tail -1) replays/golden; gse ci replays/golden --update",
            ):
                shell(line, folder)
            page = "external-identifiers.md"
            (folder / "solver.py").write_text(printed(page, "#!/usr/bin/env python3", "flush=True)"))
            (folder / "example.c").write_text(printed(page, '#include "gse_identifier.h"', "\n    }\n"))
            shell(f"cc -O2 -shared -fPIC -I {ROOT}/gse/external example.c -o example.so", folder)
            shell("gse run --port 'sim://?speed=1&frames=36000' --detach", folder)  # for status and note
            stars = np.random.default_rng(1).integers(20, 1000, (40, 2))
            image = np.zeros((1024, 1024), np.uint8)
            for y, x in stars:
                image[y - 1 : y + 2, x - 1 : x + 2] = 200
            Image.fromarray(image).save(folder / "image.png")
            fits.PrimaryHDU(image).writeto(folder / "image.fits")
            yield
        finally:
            shell("gse status --stop", folder)
            sensor.terminate()


def main() -> int:
    """Run them; 1 where one fails."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--only", default="")
    asked = options.parse_args()
    failed = 0
    with tempfile.TemporaryDirectory() as name, prepared(folder := Path(name)):
        port = re.search(r'url: "(.*)"', (folder / "roof.yaml").read_text(encoding="utf-8"))
        assert port is not None
        for line in commands():
            if not re.search(asked.only, line):
                continue
            text = line.replace("/dev/ttyUSB0", port[1])
            for long, short in SHORTER:
                text = text.replace(long, short)
            if why := reason_to_leave_out(line):
                print(f"  -          {line}\n     not run: {why}", flush=True)
                continue
            if _GOES_ON.search(text):
                text = f"timeout --signal=INT {ENDED_AFTER_S} {text}"
            began_s = time.monotonic()
            done = shell(text, folder, stdin=subprocess.DEVNULL)
            is_wrong = done.returncode in _WRONG or "Traceback" in done.stderr
            failed += is_wrong
            last = done.stderr.strip().splitlines()[-1:] if is_wrong else []
            print(f"{done.returncode:3} {time.monotonic() - began_s:6.1f} s  {line}", *last, sep="\n     ", flush=True)
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
