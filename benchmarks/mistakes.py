"""Ten mistakes of a first night, each made on an emulated sensor: the words that name it, and after how long.

    python benchmarks/mistakes.py [--only latitude]

For each mistake ``gse emulate --pty`` is the sensor as it is, and ``gse run`` gets a station file with one thing wrong,
or a port or disk that is not as it should be. The time is from the start of the program to the line on the terminal
(its stderr). Needs root: for a port without permission it gives up its rights, for a full disk it mounts a small tmpfs.
"""

import argparse
import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import serial

GSE = (sys.executable, "-m", "gse")
WITHIN_S = 30.0
WITHOUT_RIGHTS = ("setpriv", "--bounding-set", "-dac_override,-dac_read_search")
STATION = """version: 1
sensor: {{name: ST-1, rows: 1024, columns: 1024, focal_length_px: {focal}, mirrored: {mirrored}}}
site: {{name: roof, latitude_deg: {latitude}, longitude_deg: {longitude}, height_m: 600}}
mount: {{azimuth_deg: 200, altitude_deg: 60, roll_deg: 10}}
port: {{url: {port}, baudrate: {baudrate}}}
protocol: {protocol}
"""
MIDNIGHT_DEG = (-15 * time.gmtime().tm_hour + 187) % 360 - 180
"""The longitude where it is night (by day a lens cap is not told from the Sun), neither 0 nor 180: its sign matters."""
TRUE = {
    "longitude": MIDNIGHT_DEG,
    "focal": 4169.905,
    "mirrored": "false",
    "latitude": 47.9,
    "baudrate": 115200,
    "protocol": "panorama-v1",
}


@dataclass(frozen=True)
class Mistake:
    """What is done wrong, and the pattern of the words that name it."""

    name: str
    words: str
    wrong: dict[str, object] = field(default_factory=dict)
    emulator: tuple[str, ...] = ()
    around: Callable[[Path], contextlib.AbstractContextManager[object]] = lambda folder: contextlib.nullcontext()
    prefix: tuple[str, ...] = ()


@contextlib.contextmanager
def held(port: Path) -> Iterator[None]:
    """Another program has the port."""
    other = serial.Serial(str(port.resolve()), 115200, exclusive=True)
    yield
    other.close()


@contextlib.contextmanager
def small_disk(port: Path) -> Iterator[None]:
    """The sessions' disk has room for a few hundred panoramas."""
    folder = port.parent / "sessions"
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "gse-full", str(folder)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@contextlib.contextmanager
def closed_to_all(port: Path) -> Iterator[None]:
    """Nobody may read or write the port, but who may everything: the station runs without that right."""
    os.chmod(port.resolve(), 0)
    yield


CAP = ("--scenario", "{folder}/cap.yaml")
MISTAKES = (
    Mistake("port busy", r"busy: held by", around=held),
    Mistake("no permission", r"no permission for", around=closed_to_all, prefix=WITHOUT_RIGHTS),
    Mistake("baud rate twice too high", r"port\.baudrate: 57600", {"baudrate": 115200}, ("57600",)),
    Mistake("baud rate half of the sensor's", r"baud rate is wrong", {"baudrate": 57600}),
    Mistake("wrong protocol", r"protocol: panorama-v1", {"protocol": "panorama-slip"}),
    Mistake("mirrored", r"image is mirrored", {"mirrored": "true"}),
    Mistake("focal length +3 %", r"focal_length_px: 41\d\d\.\d; .* (2\.[89]|3\.[01]) % too long", {"focal": 4295.0}),
    Mistake("latitude sign", r"latitude sign", {"latitude": -47.9}),
    Mistake("local time", r"clock set to local time", prefix=("faketime", "-f", "+1h")),
    Mistake("lens cap", r"NO_STARS|lens cap", emulator=CAP),
    Mistake("full disk", r"No space left|disk is full|disk: ", around=small_disk),
)


@contextlib.contextmanager
def emulator(folder: Path, *options: str) -> Iterator[Path]:
    """The sensor; its port is linked as ``tty``."""
    wanted = dict(TRUE, port="sim://")
    if options and options[0].isdigit():
        wanted["baudrate"], options = int(options[0]), ()
    (folder / "true.yaml").write_text(STATION.format(**wanted))
    (folder / "cap.yaml").write_text("text: The lens cap is on.\nair:\n  capped_s: [[0, 100000]]\n")
    options = tuple(option.format(folder=folder) for option in options)
    command = [*GSE, "emulate", "--pty", "--station", str(folder / "true.yaml"), *options]
    sensor = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert sensor.stdout is not None
    port = folder / "tty"
    port.symlink_to(sensor.stdout.readline().strip())
    try:
        yield port
    finally:
        sensor.terminate()
        sensor.wait()


def named(mistake: Mistake, folder: Path) -> tuple[float, str]:
    """After how many seconds it was named, and the line; infinity where it was not."""
    with emulator(folder, *mistake.emulator) as port, mistake.around(port):
        (folder / "station.yaml").write_text(STATION.format(**{**TRUE, "port": port, **mistake.wrong}))
        command = [*mistake.prefix, *GSE, "run", "--station", str(folder / "station.yaml"), "--clock-error", "0.1s"]
        command += ["--out", str(folder / "sessions")]
        began_s = time.monotonic()
        run = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        assert run.stderr is not None
        timer_s = began_s + WITHIN_S
        lines = []
        try:
            for line in run.stderr:
                lines.append(line)
                if re.search(mistake.words, line):
                    return time.monotonic() - began_s, line.strip()
                if time.monotonic() > timer_s + WITHIN_S:
                    break
        finally:
            os.killpg(run.pid, signal.SIGKILL)  # faketime starts a process of its own
            run.wait()
    return float("inf"), " | ".join(line.strip() for line in lines[-4:])


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--only", default="")
    asked = options.parse_args()
    print("| mistake | named after | words |")
    print("|---|---|---|")
    for mistake in MISTAKES:
        if asked.only in mistake.name:
            with tempfile.TemporaryDirectory() as folder:
                seconds, line = named(mistake, Path(folder))
            print(f"| {mistake.name} | {seconds:.0f} s | {line[:220]} |", flush=True)


if __name__ == "__main__":
    main()
