"""Objects of gse.panorama/1 as an ideal pinhole sees them, for solvers that know no other camera.

Imports nothing of the station: it runs in the process of an entry point.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def brightest_first(
    sensor: dict[str, Any], objects: list[list[float]]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Places in ``objects`` (N,), brightest first, and there x, y from the boresight in px and index value (N, 3).

    Distortion is taken out, a mirrored image is turned round.
    """
    counts = np.array(objects, dtype=np.float64).reshape(-1, 3)
    units = sensor["units"]
    y, x, index = (
        units[name]["factor"] * counts[:, k] + units[name]["zero"] for k, name in enumerate(("y", "x", "index"))
    )
    (k1, k2), (p1, p2) = sensor["radial_distortion"], sensor["tangential_distortion"]
    half = sensor["columns"] / 2
    u, v = ((np.column_stack([x, y]) - sensor["principal_point_px"]) / half).T
    s2 = u**2 + v**2
    radial = 1 + s2 * (k1 + s2 * k2)
    aside_u = 2 * p1 * u * v + p2 * (s2 + 2 * u**2)
    aside_v = p1 * (s2 + 2 * v**2) + 2 * p2 * u * v
    offset = half * np.column_stack([u * radial + aside_u, v * radial + aside_v])
    if sensor["mirrored"]:
        offset[:, 0] = -offset[:, 0]
    order = np.argsort(-index, kind="stable")
    return order, np.column_stack([offset, index])[order]
