"""cedar-solve, a plate solver after ESA's tetra3, as an entry point: pip install --no-deps cedar-solve.

With a config, that is a database of cedar-solve; without one its default database, for fields of 10 to 30 deg.
"""

import math
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import tetra3

from gse_solvers.pinhole import brightest_first

version = metadata.version("cedar-solve")
program = tetra3.tetra3.__file__
if not hasattr(np, "math"):
    np.math = math  # type: ignore[attr-defined]  # cedar-solve 0.5.1 calls it, and numpy 2 has it no more

_FIELD_ERROR_DEG = 0.5
_TIMEOUT_MS = 10_000


def make(sensor: dict[str, Any], config: str | None = None) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """The function that answers panoramas of this sensor."""
    solver = tetra3.Tetra3(Path(config)) if config else tetra3.Tetra3()
    rows, columns = sensor["rows"], sensor["columns"]
    field_deg = 2 * math.degrees(math.atan(columns / 2 / sensor["focal_length_px"]))

    def identify(panorama: dict[str, Any]) -> dict[str, Any]:
        _, seen = brightest_first(sensor, panorama["objects"])
        centroids = np.column_stack([seen[:, 1] + rows / 2, seen[:, 0] + columns / 2])
        found = solver.solve_from_centroids(
            centroids,
            (rows, columns),
            fov_estimate=field_deg,
            fov_max_error=_FIELD_ERROR_DEG,
            solve_timeout=_TIMEOUT_MS,
        )
        if found["RA"] is None:
            return {"status": "NO_MATCH"}
        # Its roll is the angle of north from image up, counter-clockwise; gse.answer/1 has that of up from north.
        roll_deg = -found["Roll"] % 360
        return {"ra_deg": found["RA"] % 360, "de_deg": found["Dec"], "roll_deg": roll_deg}

    return identify
