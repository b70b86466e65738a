"""Help to focus: how many objects the sensor sees, and how bright they are."""

from typing import Any

import numpy as np

from gse.panorama import Panorama

BINS = 12
"""Of equal steps in magnitude: a sharper image moves its stars to the right."""


def focus_of(panorama: Panorama, index_max: int) -> dict[str, Any]:
    """Objects of a panorama by brightness, 1 to ``index_max`` in BINS equal ratios; the wire has no star widths."""
    edges = np.geomspace(1.0, index_max, BINS + 1)
    places = np.clip(np.searchsorted(edges, panorama.brightness, side="right") - 1, 0, BINS - 1)
    return {
        "objects": len(panorama.brightness),
        "histogram": np.bincount(places, minlength=BINS).tolist(),
        "brightest": round(float(panorama.brightness.max(initial=0.0))),
        "index_max": index_max,
        "fwhm_px": None,
    }
