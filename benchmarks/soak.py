"""Memory under a flood: noise, frames, events and reconnects, each far more than a session has.

    python benchmarks/soak.py [noise=100000000] [frames=1000000] [events=100000] [reconnects=10000]

Prints resident memory after a tenth of each flood and at its end, with the growth between; a bounded station is flat.
Frames are identified by no one here: the columns of their results grow with a session's length, by design.
"""

import gc
import os
import random
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from drivers.chunk import Chunk, LinkEvent
from drivers.link import SerialLink
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.recording.recorder import Recorder
from gse.station.loop import StationLoop
from gse.station.reception import Reception
from gse.station.setup import set_up
from protocols import StatusMessage, load_protocol

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from devices.terminal import Terminal

PROTOCOL = load_protocol("panorama-v1")
AMOUNTS = {"noise": 10**8, "frames": 10**6, "events": 10**5, "reconnects": 10**4}
GOAL = "growth <= 16 MiB"
NOISE_BYTES = 256
"""Of a chunk: what a port gives at once."""


def main() -> None:
    """Run what was asked for."""
    wanted = dict(argument.split("=") for argument in sys.argv[1:]) or AMOUNTS
    floods: dict[str, Callable[[Path, int], Iterator[None]]] = {
        "noise": noise, "frames": frames, "events": events, "reconnects": reconnects,
    }  # fmt: skip
    for name, amount in wanted.items():
        with tempfile.TemporaryDirectory() as folder:
            count = int(amount)
            early = late = 0.0
            for place, _ in enumerate(floods[name](Path(folder), count)):
                if place == 0:
                    early = resident_mib()
            late = resident_mib()
            print(f"{count:>11} {name:<12} {early:8.1f} MiB  {late:8.1f} MiB  {late - early:+7.1f}  {GOAL}", flush=True)


def resident_mib() -> float:
    """Resident memory of this process."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / (1 << 20)


def noise(folder: Path, count: int) -> Iterator[None]:
    """Random bytes as a bad cable gives them, through recorder and reception; yields after a tenth, and at the end."""
    rng = random.Random(1)
    reception = Reception(PROTOCOL, baudrate=115200)
    with Recorder(folder / "session.mcap", live=True) as recorder:
        for number in range(count // NOISE_BYTES):
            chunk = Chunk(10**18 + number * 22_000_000, number * 22_000_000, rng.randbytes(NOISE_BYTES))
            recorder.rx(chunk)
            reception.receive(reception.stream.feed(chunk))
            if number == count // NOISE_BYTES // 10:
                yield
        yield
    assert reception.counters.bytes_in == count // NOISE_BYTES * NOISE_BYTES


def frames(folder: Path, count: int) -> Iterator[None]:
    """Frames of the sensor's housekeeping through the station's loop, and nothing else."""
    loop = _loop()
    for number in range(count):
        status = StatusMessage(
            time_us=number * 1000, temperature_c=20.0, supply_v=5.0, mode="streaming", firmware=(1, 2, 3)
        )
        stamp_ns = number * 1_000_000
        loop.take([Chunk(10**18 + stamp_ns, stamp_ns, PROTOCOL.encode(status, number % 65536))])
        if number == count // 10:
            yield
    yield


def events(folder: Path, count: int) -> Iterator[None]:
    """Events of many kinds, each in a text of its own."""
    loop = _loop()
    for number in range(count):
        kind = f"KIND_{number % 1000}"
        loop.take([LinkEvent(10**18 + number, number, kind, f"{number} " * 20)])
        if number == count // 10:
            yield
    yield


def reconnects(folder: Path, count: int) -> Iterator[None]:
    """A port that goes and comes back, again and again, with noise before each end."""
    terminal = Terminal(folder / "tty")
    loop = _loop()
    with Recorder(folder / "session.mcap", live=True) as recorder:
        with SerialLink(str(terminal.path), 115200, recorder=recorder) as link:
            for number in range(count):
                terminal.write(b"noise")
                terminal.unplug()
                terminal.plug()
                is_back = False
                while not is_back:
                    items = link.receive(5.0)
                    is_back = any(isinstance(item, LinkEvent) and item.kind == "REOPENED" for item in items)
                    loop.take(items)
                if number == count // 10:
                    yield
        yield
    terminal.unplug()


def _loop() -> StationLoop:
    station = parse_station(BUILT_IN_TEXT)
    return StationLoop(set_up(station, BUILT_IN_TEXT))


if __name__ == "__main__":
    main()
