"""tetra3rs, a star plate solver in Rust, as an entry point: pip install tetra3rs.

With a config, that is a database of tetra3rs; without one it is made for the field from the bundled Gaia catalogue.
"""

import math
import sys
from collections.abc import Callable
from importlib import metadata
from typing import Any

import tetra3rs

from gse_solvers.pinhole import brightest_first

version = metadata.version("tetra3rs")
program = sys.modules["tetra3rs.tetra3rs"].__file__
_EPOCH = 2016.0
"""Gaia's own: no proper motions are known to the station's catalogue either, but for bright stars."""
_MARGIN = 1.05


def make(sensor: dict[str, Any], config: str | None = None) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """The function that answers panoramas of this sensor."""
    focal_px, rows, columns = sensor["focal_length_px"], sensor["rows"], sensor["columns"]
    if config:
        database = tetra3rs.SolverDatabase.load_from_file(config)
    else:
        widest_deg = 2 * math.degrees(math.atan(math.hypot(rows, columns) / 2 / focal_px))
        database = tetra3rs.SolverDatabase.generate_from_gaia(
            max_fov_deg=_MARGIN * widest_deg, epoch_proper_motion_year=_EPOCH
        )
    camera = tetra3rs.CameraModel(focal_px, columns, rows)

    def identify(panorama: dict[str, Any]) -> dict[str, Any]:
        places, seen = brightest_first(sensor, panorama["objects"])
        found = database.solve_from_centroids(seen, camera_model=camera)
        if isinstance(found, tetra3rs.SolveFailure):
            return {"status": "NO_MATCH", "detail": f"tetra3rs: {found.status}"}
        matches = zip(found.matched_centroids, found.matched_catalog_ids, strict=True)
        return {
            "quaternion": [float(number) for number in found.quaternion],
            "order": "scalar-first",
            "maps": "icrs-to-sensor",
            "matches": [{"object": int(places[row]), "star": int(star)} for row, star in matches],
        }

    return identify
