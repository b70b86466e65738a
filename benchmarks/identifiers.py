"""Success, false answers and time of ``robust`` beside tetra3rs, on the same frames in one run.

    pip install tetra3rs==0.14.0        # needed for this comparison only
    python benchmarks/identifiers.py [--frames 1000] [--cells A:hard,B:nominal]
    python benchmarks/identifiers.py --solvers robust --cells B:false3 --cells-only --frames 100000
    python benchmarks/identifiers.py --solvers first-fit,best-vote --cells B:nominal,B:false3 --frames 10000

Frames: spiral directions, random roll, stars closer than 2 px merged, false objects uniform over the field and over
4 magnitudes down to the limit. Both solvers know the camera and the limit of the sensor's magnitude, nothing else.
Right: within 0.05 deg, of the frames with at least 4 real stars; coarse: right stars, 0.05 deg to 1 deg off; none: no
answer; false: of all frames. Time: CPU of the thread per call from Python, frames made before.
"""

import argparse
import importlib
import math
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, load_catalog
from gse.evaluation.frames import Conditions, FrameMaker, Optics, SimulatedFrame
from gse.identifier import Identification, Identifier, ObjectColumns, make_identifier
from gse.identifier.robust import KnownSensor, RobustIdentifier
from gse.values.attitude import solve_attitude
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.spiral import spiral_directions


def camera(columns: int, rows: int, width_deg: float) -> Camera:
    """A pinhole of this horizontal field."""
    focal_length_px = columns / 2 / math.tan(math.radians(width_deg) / 2)
    return Camera(rows, columns, focal_length_px, ((columns - 1) / 2, (rows - 1) / 2))


OPTICS = {
    "A": Optics("A", camera(1024, 1024, 8.0), 6.0, field_of_view_deg=8.0),
    "B": Optics("B", camera(1024, 1024, 14.0), 6.0),
    "C": Optics("C", camera(1024, 768, 11.42), 7.0),
}
CONDITIONS = {
    "nominal": Conditions("nominal"),
    "false3": Conditions("false3", false_objects=3),
    "hard": Conditions("hard", 30.0, 0.3, false_objects=3, missing_share=0.2),
    "worst": Conditions("worst", 50.0, 0.5, false_objects=8, missing_share=0.2),
    "focal": Conditions("focal", false_objects=3, focal_length_error=0.005),
}
CELLS = "A:nominal,A:false3,A:hard,B:nominal,B:hard,B:worst,C:nominal,C:hard,C:worst,C:focal"

RIGHT_DEG, FALSE_DEG = 0.05, 1.0
FEWEST_REAL_STARS = 4
FAINTER = 0.9
"""The catalogues reach so far beyond the sensor's limit: 3 sigma of its errors of brightness."""

Solver = tuple[Callable[[SimulatedFrame], Any], Callable[[Any, SimulatedFrame], NDArray[np.float64] | None]]
"""Solve a frame (timed); the boresight of what came out (not timed)."""


@dataclass(frozen=True, slots=True)
class Row:
    """What one solver made of one set of frames."""

    right: float
    false: float
    none: float
    coarse: float
    median_us: float
    p95_us: float
    max_us: float

    def __str__(self) -> str:
        shares = f"{self.right:6.2f} {self.false:6.2f} {self.none:6.2f} {self.coarse:6.2f}"
        return f"{shares}  {self.median_us / 1e3:8.4f} {self.p95_us / 1e3:9.4f} {self.max_us / 1e3:9.4f}"


def robust_for(
    optics: Optics, catalog: StarCatalog, fainter: float = FAINTER, known: KnownSensor | None = None
) -> RobustIdentifier:
    """The robust identifier for optics, with what more is ``known`` of the sensor."""
    stars = int((catalog.magnitude < optics.magnitude_limit + fainter).sum())
    field_deg = optics.field_of_view_deg
    return RobustIdentifier(
        optics.camera, catalog, stars=stars, field_of_view_deg=field_deg, known=known or KnownSensor()
    )


def robust(optics: Optics, catalog: StarCatalog) -> Solver:
    """The robust identifier, knowing camera and limit."""
    return solver_of(robust_for(optics, catalog))


def solver_of(identifier: Identifier) -> Solver:
    """An identifier as a solver."""

    def solve(frame: SimulatedFrame) -> Any:
        return identifier.identify(frame.directions_sensor, frame.brightness)

    def boresight(answer: Any, frame: SimulatedFrame) -> NDArray[np.float64] | None:
        if not isinstance(answer, Identification):
            return None
        return solve_attitude(
            frame.directions_sensor[answer.objects], identifier.catalog.icrs[answer.stars], 1e-4
        ).boresight_icrs

    return solve, boresight


def neighbour(selection: Literal["first-fit", "best-vote"]) -> Callable[[Optics, StarCatalog], Solver]:
    """The neighbour technique with Fn = Fn2 = 6."""

    def solver(optics: Optics, catalog: StarCatalog) -> Solver:
        options = IdentifierOptions(algorithm="neighbour", min_fit=6, selection=selection)
        return solver_of(make_identifier(options, optics.camera, catalog))

    return solver


def tetra3rs(optics: Optics, catalog: StarCatalog) -> Solver:
    """tetra3rs, with a database for this field and limit."""
    tetra3 = importlib.import_module("tetra3rs")
    width_deg = 2 * math.degrees(math.atan(optics.camera.columns / 2 / optics.camera.focal_length_px))
    database = tetra3.SolverDatabase.generate_from_gaia(
        max_fov_deg=width_deg,
        star_max_magnitude=optics.magnitude_limit + FAINTER,
        pattern_max_error=0.003,
        epoch_proper_motion_year=None,
    )
    model = tetra3.CameraModel(optics.camera.focal_length_px, optics.camera.columns, optics.camera.rows)
    centre = np.array(optics.camera.principal_point_px)

    def solve(frame: SimulatedFrame) -> Any:
        return database.solve_from_centroids(
            np.column_stack([frame.xy_px - centre, frame.brightness]),
            camera_model=model,
            match_radius=0.004,
            solve_timeout_ms=1000,
        )

    def boresight(answer: Any, frame: SimulatedFrame) -> NDArray[np.float64] | None:
        return answer.rotation_matrix_icrs_to_camera[2] if answer else None

    return solve, boresight


def measure(solver: Solver, frames: list[SimulatedFrame], fewest: int = FEWEST_REAL_STARS) -> Row:
    """Run a solver over frames; shares are of those with ``fewest`` real stars."""
    solve, boresight = solver
    for frame in frames[:20]:
        solve(frame)
    outcomes, times_us, real = [], [], []
    for frame in frames:
        started_ns = time.thread_time_ns()
        answer = solve(frame)
        elapsed_us = (time.thread_time_ns() - started_ns) / 1000
        found = boresight(answer, frame)
        outcomes.append("none" if found is None else judged(found, frame))
        real.append(frame.real_stars >= fewest)
        times_us.append(elapsed_us)
    named, enough, taken = np.array(outcomes), np.array(real), np.array(times_us)[real]
    shares = [100 * float((named[enough] == name).mean()) for name in ("right", "none", "coarse")]
    return Row(
        shares[0],
        100 * float((named == "false").mean()),
        shares[1],
        shares[2],
        float(np.median(taken)),
        float(np.percentile(taken, 95)),
        float(taken.max()),
    )


def judged(boresight_icrs: NDArray[np.float64], frame: SimulatedFrame) -> str:
    """Right, coarse or false."""
    error_deg = math.degrees(2 * math.asin(min(1.0, math.dist(boresight_icrs, frame.attitude.boresight_icrs) / 2)))
    return "right" if error_deg <= RIGHT_DEG else "coarse" if error_deg <= FALSE_DEG else "false"


def frames_of(
    optics: Optics, conditions: Conditions, catalog: StarCatalog, count: int, seed: int
) -> list[SimulatedFrame]:
    """One frame for each direction of the spiral."""
    maker = FrameMaker(optics, conditions, catalog)
    return [maker.frame(at, np.random.default_rng([seed, k])) for k, at in enumerate(spiral_directions(count))]


def few_stars(catalog: StarCatalog, count: int, seed: int) -> None:
    """Frames of 3 stars and more, sub-pixel; noise, calibrated camera and photometric zero point are known."""
    print("\nrobust, 8 deg, frames of >= 3 stars, sub-pixel, the sensor's noise and zero point known")
    optics = OPTICS["A"]
    for arcsec, magnitude in ((10.0, 0.1), (50.0, 0.1), (10.0, 0.5)):
        frames = frames_of(optics, Conditions("few", arcsec, magnitude, whole_pixels=False), catalog, count, seed)
        sigma_px = math.radians(arcsec / 3600) * optics.camera.focal_length_px
        zero_point = optics.magnitude_limit - 7.5 + 2.5 * math.log10(4096)
        known = KnownSensor(sigma_px, zero_point, magnitude_sigma=math.hypot(magnitude, 0.05))
        identifier = robust_for(optics, catalog, 3 * magnitude + 0.6, known)
        print(f"{arcsec:g} arcsec {magnitude:g} mag".ljust(22), measure(solver_of(identifier), frames, 3), flush=True)


def random_panorama(
    optics: Optics, count: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Random objects over the field and four magnitudes: directions (N, 3) and index (N,), brightest first."""
    xy = np.empty((0, 2))
    while len(xy) < count:
        more = np.floor(rng.uniform(0, [optics.camera.columns, optics.camera.rows], (count, 2)))
        xy = np.concatenate([xy, more[optics.sees(more)]])[:count]
    return optics.camera.directions(xy), np.sort(4096 * 10 ** (-0.4 * rng.uniform(0, 4, count)))[::-1]


def random_only(catalog: StarCatalog, count: int, seed: int) -> None:
    """Panoramas of 30 random objects, cameras B and C."""
    for name in ("B", "C"):
        optics, rng = OPTICS[name], np.random.default_rng(seed)
        identifier = robust_for(optics, catalog)
        answers, times_ms = 0, []
        for _ in range(count):
            directions, brightness = random_panorama(optics, 30, rng)
            started_ns = time.thread_time_ns()
            answers += isinstance(identifier.identify(directions, brightness), Identification)
            times_ms.append((time.thread_time_ns() - started_ns) / 1e6)
        print(f"\nrandom objects only, {name}: {answers} answers in {count},", end=" ")
        print(f"refused in {np.median(times_ms):.1f} ms,", end=" ")
        print(f"p95 {np.percentile(times_ms, 95):.1f}, max {max(times_ms):.1f}", flush=True)


def calibration(catalog: StarCatalog, count: int, seed: int) -> None:
    """How many random panoramas reach a chance of p: not more than a share of p may."""
    print(f"\nrandom panoramas that reach a chance of p, of {count}")
    for name, objects in (("A", 3), ("A", 4), ("B", 4)):
        identifier, rng = robust_for(OPTICS[name], catalog), np.random.default_rng(seed)
        chances = np.array(
            [
                identifier.best_false_match_probability(*random_panorama(OPTICS[name], objects, rng))
                for _ in range(count)
            ]
        )
        reached = ", ".join(f"{p:g}: {int((chances <= p).sum())}" for p in (0.3, 0.1, 0.03, 0.01, 0.003, 0.001))
        print(f"{name}, {objects} objects: {reached}", flush=True)


def many(catalog: StarCatalog, seed: int) -> None:
    """Panoramas per second in one call, camera B nominal."""
    identifier = robust_for(OPTICS["B"], catalog)
    frames = frames_of(OPTICS["B"], CONDITIONS["nominal"], catalog, 1000, seed)
    panoramas = ObjectColumns.from_panoramas([(frame.directions_sensor, frame.brightness) for frame in frames])
    identifier.identify_many(
        ObjectColumns.from_panoramas([(frame.directions_sensor, frame.brightness) for frame in frames[:20]])
    )
    started = time.thread_time()
    identifier.identify_many(panoramas)
    print(f"many panoramas in one call, B nominal: {len(panoramas) / (time.thread_time() - started):.0f} per second")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--cells", default=CELLS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--random", type=int, default=1000, help="panoramas of random objects only")
    parser.add_argument("--solvers", default="robust,tetra3rs", help="also first-fit and best-vote")
    parser.add_argument("--cells-only", action="store_true", help="robust's other tables are left out")
    arguments = parser.parse_args()
    solvers = {
        "robust": robust,
        "tetra3rs": tetra3rs,
        "first-fit": neighbour("first-fit"),
        "best-vote": neighbour("best-vote"),
    }
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(f"load {os.getloadavg()[0]:.1f} at the start; {arguments.frames} frames each, seed {arguments.seed}")
    print(f"{'':22s}  right  false   none coarse   med ms    p95 ms    max ms")
    catalog = load_catalog()
    ready: dict[tuple[str, str], Any] = {}
    for cell in arguments.cells.split(","):
        name, condition = cell.split(":")
        frames = frames_of(OPTICS[name], CONDITIONS[condition], catalog, arguments.frames, arguments.seed)
        for solver in arguments.solvers.split(","):
            if (name, solver) not in ready:
                ready[name, solver] = solvers[solver](OPTICS[name], catalog)
            print(f"{name} {condition:8s} {solver:10s}  {measure(ready[name, solver], frames)}", flush=True)
    if "robust" in arguments.solvers and not arguments.cells_only:
        few_stars(catalog, arguments.frames, arguments.seed)
        random_only(catalog, arguments.random, arguments.seed)
        calibration(catalog, arguments.random, arguments.seed)
        many(catalog, arguments.seed)
    print(f"load {os.getloadavg()[0]:.1f} at the end")


if __name__ == "__main__":
    main()
