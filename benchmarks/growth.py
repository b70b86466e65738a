"""How time grows: with the panoramas at once, the objects of a panorama, the field and the stars that the sensor sees.

    python benchmarks/growth.py [--frames 128]

Microseconds of CPU per panorama, and seconds to make the tables. Frames as in ``identifiers.py``, condition false3.
"""

import argparse
import math
import os
import tempfile
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, load_catalog, mission_catalog
from gse.evaluation.frames import Conditions, FrameMaker, Optics
from gse.identifier import ObjectColumns
from gse.identifier.neighbour import NeighbourIdentifier
from gse.identifier.robust import RobustIdentifier
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.spiral import spiral_directions

Objects = tuple[NDArray[np.float64], NDArray[np.float64]]
Many = NeighbourIdentifier | RobustIdentifier

FAINTER = 0.9
"""The catalogue reaches so far beyond the sensor's limit."""

PIXELS = 1024
FIELDS = (
    (8.0, 6.0),
    (8.0, 9.0),
    (14.0, 5.0),
    (14.0, 6.0),
    (14.0, 7.0),
    (20.0, 6.0),
    (30.0, 5.0),
    (30.0, 6.0),
)
"""Width of the field in degrees, faintest magnitude."""


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=128)
    frames = parser.parse_args().frames
    source = load_catalog()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # tables are made anew
        by_number_and_objects(source, frames)
        by_field(source, frames)


def by_number_and_objects(source: StarCatalog, frames: int) -> None:
    """The field of the LAPAN paper: more panoramas at once, more objects in each."""
    neighbour, robust, panoramas, _ = ready(source, 14.0, 6.0, frames)
    print("\n14 deg to magnitude 6, us per panorama\n\n| panoramas at once | neighbour | robust |\n|---|---|---|")
    for at_once in (1, 4, 16, 64, 256):
        print(
            f"| {at_once} | {each_us(neighbour, panoramas, at_once):.0f} | {each_us(robust, panoramas, at_once):.0f} |"
        )
    print("\n| objects of a panorama | neighbour | robust |\n|---|---|---|")
    for count in (5, 10, 15, 20, 30):
        some = [(directions[:count], brightness[:count]) for directions, brightness in panoramas]
        print(f"| {count} | {each_us(neighbour, some, 64):.0f} | {each_us(robust, some, 64):.0f} |")


def by_field(source: StarCatalog, frames: int) -> None:
    """Wider fields, fainter stars: panoramas of 30 objects at most."""
    print("\n| field, sensor to magnitude | stars of neighbour, robust | tables, s | neighbour, us | robust, us |")
    print("|---|---|---|---|---|")
    for width_deg, faintest in FIELDS:
        neighbour, robust, panoramas, made_s = ready(source, width_deg, faintest, frames)
        sizes = f"{len(neighbour.catalog)}, {len(robust.catalog)}"
        times = f"{each_us(neighbour, panoramas, 64):.0f} | {each_us(robust, panoramas, 64):.0f}"
        print(f"| {width_deg:.0f} deg, {faintest:.0f} | {sizes} | {made_s:.1f} | {times} |", flush=True)


def ready(
    source: StarCatalog, width_deg: float, faintest: float, frames: int
) -> tuple[NeighbourIdentifier, RobustIdentifier, list[Objects], float]:
    """Both identifiers with their tables, panoramas, and the seconds that the tables took."""
    focal_length_px = PIXELS / 2 / math.tan(math.radians(width_deg) / 2)
    middle = (PIXELS - 1) / 2
    camera = Camera(PIXELS, PIXELS, focal_length_px, (middle, middle))
    catalog = source.rows(np.flatnonzero(source.magnitude < faintest + FAINTER))
    maker = FrameMaker(Optics("growth", camera, faintest), Conditions("false3", false_objects=3), catalog)
    rng = np.random.default_rng(1)
    made = [maker.frame(direction, rng) for direction in spiral_directions(frames)]
    began = time.process_time()
    neighbour = NeighbourIdentifier(mission_catalog(catalog, camera), camera, IdentifierOptions())
    robust = RobustIdentifier(camera, catalog)
    made_s = time.process_time() - began
    return neighbour, robust, [(frame.directions_sensor, frame.brightness) for frame in made], made_s


def each_us(identifier: Many, panoramas: list[Objects], at_once: int) -> float:
    """Microseconds of CPU per panorama, the least of three passes."""
    return min(_pass_us(identifier.identify_many, panoramas, at_once) for _ in range(3))


def _pass_us(identify: Callable[[ObjectColumns], object], panoramas: list[Objects], at_once: int) -> float:
    parts = [
        ObjectColumns.from_panoramas(panoramas[first : first + at_once]) for first in range(0, len(panoramas), at_once)
    ]
    began = time.thread_time()
    for part in parts:
        identify(part)
    return 1e6 * (time.thread_time() - began) / len(panoramas)


if __name__ == "__main__":
    main()
