"""Success, false answers and time of ``robust`` beside tetra3rs, on the same frames in one run.

    pip install tetra3rs==0.14.0        # needed for this comparison only; left out where it is not installed
    python benchmarks/identifiers.py [--frames 1000] [--cells A:hard,B:nominal]

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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.attitude import solve_attitude
from gse.camera import Camera
from gse.catalog import StarCatalog, load_catalog
from gse.evaluate_frames import Conditions, FrameMaker, Optics, TestFrame
from gse.identifier import Identification
from gse.identifier.robust import RobustIdentifier
from gse.spiral import spiral_directions


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

Solver = Callable[[TestFrame], NDArray[np.float64] | None]


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


def robust(optics: Optics, catalog: StarCatalog) -> Solver:
    """The boresight by ``robust``."""
    stars = int((catalog.magnitude < optics.magnitude_limit + FAINTER).sum())
    identifier = RobustIdentifier(optics.camera, catalog, stars=stars, field_of_view_deg=optics.field_of_view_deg)

    def solve(frame: TestFrame) -> Any:
        return identifier.identify(frame.directions_sensor, frame.index)

    def boresight(answer: Any, frame: TestFrame) -> NDArray[np.float64] | None:
        if not isinstance(answer, Identification):
            return None
        return solve_attitude(
            frame.directions_sensor[answer.objects], identifier.catalog.icrs[answer.stars], 1e-4
        ).boresight_icrs

    return solve, boresight


def tetra3rs(optics: Optics, catalog: StarCatalog) -> Solver:
    """The boresight by tetra3rs."""
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

    def solve(frame: TestFrame) -> Any:
        return database.solve_from_centroids(
            np.column_stack([frame.xy_px - centre, frame.index]),
            camera_model=model,
            match_radius=0.004,
            solve_timeout_ms=1000,
        )

    def boresight(answer: Any, frame: TestFrame) -> NDArray[np.float64] | None:
        return answer.rotation_matrix_icrs_to_camera[2] if answer else None

    return solve, boresight


def measure(solver: Any, frames: list[TestFrame]) -> Row:
    """Run a solver over frames."""
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
        real.append(frame.real_stars >= FEWEST_REAL_STARS)
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


def judged(boresight_icrs: NDArray[np.float64], frame: TestFrame) -> str:
    """Right, coarse or false."""
    error_deg = math.degrees(2 * math.asin(min(1.0, math.dist(boresight_icrs, frame.attitude.boresight_icrs) / 2)))
    return "right" if error_deg <= RIGHT_DEG else "coarse" if error_deg <= FALSE_DEG else "false"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--cells", default=CELLS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--solvers", default="robust,tetra3rs")
    arguments = parser.parse_args()
    solvers = {"robust": robust, "tetra3rs": tetra3rs}
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(f"load {os.getloadavg()[0]:.1f} at the start; {arguments.frames} frames each, seed {arguments.seed}")
    print(f"{'':22s}  right  false   none coarse   med ms    p95 ms    max ms")
    catalog = load_catalog()
    directions = spiral_directions(arguments.frames)
    ready: dict[tuple[str, str], Any] = {}
    for cell in arguments.cells.split(","):
        name, condition = cell.split(":")
        maker = FrameMaker(OPTICS[name], CONDITIONS[condition], catalog)
        frames = [
            maker.frame(direction, np.random.default_rng([arguments.seed, k])) for k, direction in enumerate(directions)
        ]
        for solver in arguments.solvers.split(","):
            if (name, solver) not in ready:
                ready[name, solver] = solvers[solver](OPTICS[name], catalog)
            print(f"{name} {condition:8s} {solver:10s}  {measure(ready[name, solver], frames)}", flush=True)
    print(f"load {os.getloadavg()[0]:.1f} at the end")


if __name__ == "__main__":
    main()
