"""Foreign identifiers as devices under test: a Python script as an executable program."""

import sys
from pathlib import Path

HEAD = """\
import json, os, sys, time
sensor = json.loads(sys.stdin.readline())
def answer(panorama, **values):
    print(json.dumps({"frame_no": panorama["frame_no"], "ra_deg": 10.0, "de_deg": -20.0, **values}), flush=True)
"""
"""Reads the sensor's line; ``answer`` writes a right answer with some values in it."""


def program(folder: Path, body: str, *, head: str = HEAD, name: str = "onboard") -> Path:
    """An executable script; ``body`` follows the head, and usually has a loop over ``sys.stdin``."""
    path = folder / name
    path.write_text(f"#!{sys.executable} -S\n{head}{body}")
    path.chmod(0o755)
    return path
