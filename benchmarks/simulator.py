"""How fast the simulated sensor and the extraction are, on one core.

    python benchmarks/simulator.py

Prints a table with the goal beside each figure. All times are processor time, so that a busy machine gives nearly the
same.
"""

import time
from collections.abc import Callable

import numpy as np

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.imaging.extraction import extract, extract_sub_pixel
from gse.simulator import device_factory
from gse.simulator.image import ImageSource
from gse.simulator.scenario import load_scenario

FRAMES = 6000
IMAGES = 60
EXTRACTIONS = 200
FRAME_NS = 100_000_000


def per_second(work: Callable[[], int]) -> float:
    """Things done per second of processor time; once before, for what is compiled and loaded."""
    work()
    began_s = time.process_time()
    return work() / (time.process_time() - began_s)


def p95_ms(work: Callable[[], object]) -> float:
    """95th percentile of the processor time of many runs."""
    work()
    times_s = []
    for _ in range(EXTRACTIONS):
        began_s = time.process_time()
        work()
        times_s.append(time.process_time() - began_s)
    return float(np.percentile(times_s, 95)) * 1e3


def main() -> None:
    """Measure all and print the table."""
    station = parse_station(BUILT_IN_TEXT)
    session = load_scenario("clear-zenith")
    source = ImageSource(station, session, np.random.default_rng(1))
    image = source.image(session.start_utc_ns, session.exposure_s)

    def frames() -> int:
        device = device_factory(station)({"frames": str(FRAMES)})
        while device.next_chunk() is not None:
            pass
        return FRAMES

    def images() -> int:
        for number in range(IMAGES):
            source.expose(session.start_utc_ns + number * FRAME_NS, session.exposure_s, 20.0)
        return IMAGES

    rows = [
        ("panoramas, stars to bytes", f"{per_second(frames):.0f} /s", ">= 2000 /s"),
        ("images 1024 x 1024, extracted", f"{per_second(images):.0f} /s", ">= 20 /s"),
        ("extraction, p95", f"{p95_ms(lambda: extract(image)):.2f} ms", "<= 10 ms"),
        ("extraction by centres of light, p95", f"{p95_ms(lambda: extract_sub_pixel(image)):.2f} ms", "<= 80 ms"),
    ]
    for name, value, goal in rows:
        print(f"{name:38}{value:>12}    {goal}")


if __name__ == "__main__":
    main()
