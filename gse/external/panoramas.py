"""Panoramas as an external identifier gets them: raw y, x and index value in wire units, in the order of the wire."""

import json
import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse import instant
from gse.camera import Camera
from gse.panorama import Panorama

PANORAMA = "gse.panorama/1"
SENSOR = "gse.sensor/1"
_WHOLE_WITHIN = 1e-6
"""Counts of a wire are whole; those of a panorama table need not be."""


@dataclass(frozen=True, slots=True)
class WireUnit:
    """What a count on the wire means: value = factor * count + zero, in px, or in index values."""

    factor: float = 1.0
    zero: float = 0.0


@dataclass(frozen=True, slots=True)
class SensorDescription:
    """What an external identifier is told of the sensor, once, at its start."""

    name: str
    camera: Camera
    index_max: int
    y: WireUnit = WireUnit()
    x: WireUnit = WireUnit()
    index: WireUnit = WireUnit()

    def document(self) -> dict[str, Any]:
        """The JSON of schema gse.sensor/1."""
        camera = asdict(self.camera)
        units = {name: asdict(getattr(self, name)) for name in ("y", "x", "index")}
        return {"schema": SENSOR, "name": self.name, **camera, "index_max": self.index_max, "units": units}

    def counts(self, panorama: Panorama) -> NDArray[np.float64]:
        """Raw y, x and index value (N, 3), in the order of the wire."""
        columns = (panorama.xy_px[:, 1], panorama.xy_px[:, 0], panorama.brightness)
        units = (self.y, self.x, self.index)
        counts = np.empty((len(panorama.brightness), 3))
        for k, (values, unit) in enumerate(zip(columns, units, strict=True)):
            counts[:, k] = (values - unit.zero) / unit.factor
        whole = np.rint(counts)
        counts = np.where(np.abs(counts - whole) < _WHOLE_WITHIN, whole, counts)
        return counts if panorama.wire_rows is None else counts.take(np.argsort(panorama.wire_rows), axis=0)

    def line(self, panorama: Panorama) -> bytes:
        """The line of schema gse.panorama/1."""
        counts = self.counts(panorama)
        is_whole = bool((counts == np.rint(counts)).all())
        document = {
            "schema": PANORAMA,
            "frame_no": panorama.frame_no,
            "utc": instant.to_text(panorama.utc_ns, 9),
            "time_us": panorama.time_us,
            "exposure_us": round(1e6 * panorama.exposure_s) if math.isfinite(panorama.exposure_s) else None,
            "objects": (counts.astype(np.int64) if is_whole else counts).tolist(),
        }
        return json.dumps(document, separators=(",", ":")).encode() + b"\n"


def rows_here(panorama: Panorama, wire_rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows of the panorama, brightest first, of rows (M,) in the order of the wire."""
    return wire_rows if panorama.wire_rows is None else np.argsort(panorama.wire_rows).take(wire_rows)
