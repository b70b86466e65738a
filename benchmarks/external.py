"""External identifiers: what a child costs, whether the C library equals ours, and tetra3rs beside robust.

    python benchmarks/external.py [--panoramas 10000] [--frames 300] [--only same|costs|solvers]

Needs a C compiler and, for the last table, tetra3rs. Costs are CPU time of the station per panorama; that of the child,
which answers at once, is not in it.
"""

import argparse
import statistics
import subprocess
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from gse.catalog import load_catalog, mission_catalog
from gse.catalog.flight import write_table
from gse.evaluation.frames import Conditions, FrameMaker, Optics
from gse.evaluation.panoramas import BenchmarkFrame, PanoramaSet, benchmark, table
from gse.external.answers import ExternalAnswer
from gse.external.identifier import RunningIdentifier
from gse.external.panoramas import SensorDescription
from gse.external.plugs import plug_of
from gse.identifier import Identification, make_identifier
from gse.identifier.tables import field_diameter_rad, listed_neighbours, pair_table
from gse.values.attitude import solve_attitude
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama
from gse.values.spiral import spiral_directions

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "tests" / "devices" / "onboard_neighbour.c"
FIELD_14_DEG = Camera(1024, 1024, 512 / np.tan(np.radians(7)), (511.5, 511.5))
CAMERAS = {
    "A": Optics("A", Camera(1024, 1024, 512 / np.tan(np.radians(4)), (511.5, 511.5)), 6.0, field_of_view_deg=8.0),
    "B": Optics("B", FIELD_14_DEG, 6.0),
    "C": Optics("C", Camera(768, 1024, 512 / np.tan(np.radians(5.7)), (511.5, 383.5)), 7.0),
}
ECHO = """
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
int main(void) {
    static char line[65536];
    while (fgets(line, sizeof line, stdin)) {
        char *number = strstr(line, "\\"frame_no\\":");
        if (!number) continue;
        long frame_no = strtol(number + 11, 0, 10);
        printf("{\\"frame_no\\":%ld,\\"ra_deg\\":1.5,\\"de_deg\\":2.5,\\"roll_deg\\":3.5}\\n", frame_no);
        fflush(stdout);
    }
    return 0;
}
"""
ECHO_LIBRARY = """
#include "gse_identifier.h"
int identify(const gse_panorama *p, gse_answer *a, void *config) {
    (void)config;
    a->version = GSE_IDENTIFIER_ABI, a->frame_no = p->frame_no, a->status = GSE_IDENTIFIED;
    a->ra_deg = 1.5, a->de_deg = 2.5, a->roll_deg = 3.5;
    return 0;
}
"""


def compiled(text: str | Path, target: Path, *options: str) -> Path:
    """A program or library of C text or a C file."""
    source = target.with_suffix(".c")
    source.write_text(text.read_text() if isinstance(text, Path) else text)
    header = f"-I{ROOT / 'gse' / 'external'}"
    subprocess.run(["cc", "-O2", header, str(source), "-o", str(target), *options, "-lm"], check=True)
    return target


def panoramas(optics: Optics, conditions: Conditions, count: int) -> list[tuple[Panorama, np.ndarray]]:
    """Panoramas over the whole sky with at least 4 real stars, and their boresights."""
    maker, rng = FrameMaker(optics, conditions, load_catalog()), np.random.default_rng(1)
    frames = [maker.frame(direction, rng) for direction in spiral_directions(count)]
    return [
        (Panorama(0, frame.xy_px, frame.brightness, number), frame.attitude.boresight_icrs)
        for number, frame in enumerate(frames)
        if frame.real_stars >= 4
    ]


def running(sensor: SensorDescription, **options: object) -> RunningIdentifier:
    """An external identifier with a long time-out."""
    return RunningIdentifier(plug_of(IdentifierOptions(algorithm="external", **options), sensor), 60.0)  # type: ignore[arg-type]


def same(folder: Path, count: int) -> None:
    """The neighbour technique in C against ours, star by star and angle by angle."""
    stars = mission_catalog(load_catalog(), FIELD_14_DEG)
    with (folder / "flight.csv").open("w") as out:
        write_table(stars, listed_neighbours(pair_table(stars, field_diameter_rad(FIELD_14_DEG))), out)
    library = compiled(SOURCE, folder / "onboard.so", "-shared", "-fPIC")
    sensor = SensorDescription("made", FIELD_14_DEG, 4096)
    ours = make_identifier(IdentifierOptions(), FIELD_14_DEG, stars)
    theirs = running(sensor, library=str(library), config=str(folder / "flight.csv"))
    differ = identified = total = 0
    for false_objects in (0, 3, 8):
        made = panoramas(CAMERAS["B"], Conditions("made", false_objects=false_objects), count // 3 + 1)
        given = theirs.answers([panorama for panorama, _ in made])
        for (panorama, _), one in zip(made, given, strict=True):
            seen = FIELD_14_DEG.directions(panorama.xy_px)
            answer = ours.identify(seen, panorama.brightness)
            total += 1
            if not isinstance(answer, Identification):
                differ += not isinstance(one.answer, ExternalAnswer) or one.answer.attitude is not None
                continue
            identified += 1
            differ += not _alike(answer, one.answer, stars, seen)
    theirs.close()
    print(f"neighbour in C: {total} panoramas, {identified} identified, {differ} differ from ours")


def _alike(answer: Identification, theirs: object, stars: object, seen: np.ndarray) -> bool:
    if not isinstance(theirs, ExternalAnswer) or theirs.attitude is None:
        return False
    ids, icrs = stars.ids[answer.stars], stars.icrs[answer.stars]  # type: ignore[attr-defined]
    named = dict(zip(theirs.objects.tolist(), theirs.star_ids.tolist(), strict=True))
    attitude = solve_attitude(seen[answer.objects], icrs, 1e-4)
    angle = np.abs(theirs.attitude.icrs_to_sensor - attitude.icrs_to_sensor).max()
    return named == dict(zip(answer.objects.tolist(), ids.tolist(), strict=True)) and bool(angle < 1e-10)


def costs(folder: Path) -> None:
    """CPU time of the station per panorama, with a child that answers at once."""
    sensor = SensorDescription("made", FIELD_14_DEG, 4096)
    made = [
        replace(panorama, brightness=np.rint(panorama.brightness))  # a wire carries whole counts
        for panorama, _ in panoramas(CAMERAS["B"], Conditions("made"), 1000)
    ]
    library = compiled(ECHO_LIBRARY, folder / "echo.so", "-shared", "-fPIC")
    plugs = {"command": {"command": (str(compiled(ECHO, folder / "echo")),)}, "library": {"library": str(library)}}
    print(f"{'plug':10}{'one by one':>14}{'batch of 64':>14}   us of CPU per panorama, median of 5 runs of 960")
    for name, options in plugs.items():
        identifier = running(sensor, **options)
        identifier.answers(made[:64])
        line = f"{name:10}"
        for batch in (1, 64):
            line += f"{statistics.median(_cost_us(identifier, made[:960], batch) for _ in range(5)):14.1f}"
        identifier.close()
        print(line)


def _cost_us(identifier: RunningIdentifier, made: list[Panorama], batch: int) -> float:
    began_s = time.process_time()
    for begin in range(0, len(made), batch):
        identifier.answers(made[begin : begin + batch])
    return 1e6 * (time.process_time() - began_s) / len(made)


def solvers(count: int) -> None:
    """Robust and tetra3rs on cameras A, B and C; pip install tetra3rs ./benchmarks/solvers."""
    sets = []
    for name, optics in CAMERAS.items():
        sensor = SensorDescription(name, optics.camera, 4096)
        made = panoramas(optics, Conditions("made", whole_pixels=False), count)
        cases = (BenchmarkFrame(str(panorama.frame_no), sensor, panorama, boresight) for panorama, boresight in made)
        sets.append(PanoramaSet(f"camera {name}", tuple(cases)))
    entry_point = IdentifierOptions(algorithm="external", entry_point="tetra3rs", timeout_ms=60_000)
    rows = benchmark((IdentifierOptions(algorithm="robust"), entry_point), sets, "gaia")
    print("\n".join(table(list(rows))))


def main() -> None:
    """Print the three results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--panoramas", type=int, default=10_000, help="compared with the C library")
    parser.add_argument("--frames", type=int, default=300, help="for each camera")
    parser.add_argument("--only", choices=("same", "costs", "solvers"), help="one of the three")
    arguments = parser.parse_args()
    wanted = (arguments.only,) if arguments.only else ("same", "costs", "solvers")
    with tempfile.TemporaryDirectory() as folder:
        if "same" in wanted:
            same(Path(folder), arguments.panoramas)
        if "costs" in wanted:
            costs(Path(folder))
    if "solvers" in wanted:
        solvers(arguments.frames)


if __name__ == "__main__":
    main()
