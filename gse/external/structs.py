"""The structs of gse_identifier.h as bytes."""

import math
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gse.external.answers import Failure, FailureKind
from gse.external.panoramas import SensorDescription
from gse.panorama import MAX_OBJECTS, Panorama

ABI = 1
SENSOR = struct.Struct("=4I14d")
PANORAMA = struct.Struct(f"=2IqQ2I{3 * MAX_OBJECTS}d")
ANSWER = struct.Struct(f"=4I4d{16 * MAX_OBJECTS}s64s")
_MATCH = np.dtype([("star", "i8"), ("object", "u4"), ("spare", "u4")])
_LARGEST_U32 = 0xFFFFFFFF
_STATUSES = {1: "IDENTIFIED", 2: "TOO_FEW", 3: "NO_MATCH", 4: "AMBIGUOUS", 5: "SENSOR_FAULT"}
_RETURNED = 0x80000000
"""Set by the host in ``version`` where the function returned something else than 0; the rest is that number."""


def sensor_record(sensor: SensorDescription) -> bytes:
    """The struct gse_sensor."""
    camera = sensor.camera
    units = (number for unit in (sensor.y, sensor.x, sensor.index) for number in (unit.factor, unit.zero))
    return SENSOR.pack(
        ABI,
        camera.rows,
        camera.columns,
        camera.mirrored,
        camera.focal_length_px,
        *camera.principal_point_px,
        *camera.radial_distortion,
        *getattr(camera, "tangential_distortion", (0.0, 0.0)),
        sensor.index_max,
        *units,
    )


def panorama_record(panorama: Panorama, counts: NDArray[np.float64]) -> bytes:
    """The struct gse_panorama of ``counts`` (N, 3)."""
    used = len(counts)
    exposure_us = round(1e6 * panorama.exposure_s) if math.isfinite(panorama.exposure_s) else 0
    return PANORAMA.pack(
        ABI,
        panorama.frame_no & _LARGEST_U32,
        panorama.utc_ns,
        panorama.time_us,
        min(max(exposure_us, 0), _LARGEST_U32),
        used,
        *counts.ravel().tolist(),
        *((0.0,) * (3 * (MAX_OBJECTS - used))),
    )


def answer_document(data: bytes, frame_no: int) -> dict[str, Any] | Failure:
    """The answer in a struct gse_answer as a document of schema gse.answer/1."""
    version, answered, status, matched, *numbers, matches, detail = ANSWER.unpack(data)
    if version & _RETURNED:
        text = f"the function returned {_signed(version)}"
        return {"frame_no": frame_no, "status": "NO_MATCH", "detail": text}
    if version != ABI:
        text = f"answer.version is {version}: expected GSE_IDENTIFIER_ABI, {ABI}"
        return Failure(FailureKind.NONSENSE, text, in_step=True)
    if status not in _STATUSES or matched > MAX_OBJECTS:
        text = f"answer.status is {status}, answer.matched {matched}: expected 1 to 5, and 0 to {MAX_OBJECTS}"
        return Failure(FailureKind.NONSENSE, text, in_step=True)
    document = {
        "frame_no": frame_no if answered == frame_no & _LARGEST_U32 else answered,
        "status": _STATUSES[status],
        "detail": detail.partition(b"\0")[0].decode("utf-8", "replace"),
    }
    ra_deg, de_deg, roll_deg, elapsed_us = numbers
    if status == 1:
        document |= {"ra_deg": ra_deg, "de_deg": de_deg}
        document |= {} if math.isnan(roll_deg) else {"roll_deg": roll_deg}
        rows = np.frombuffer(matches, _MATCH, matched)
        document["matches"] = [
            {"object": row, "star": star}
            for row, star in zip(rows["object"].tolist(), rows["star"].tolist(), strict=True)
        ]
    return document | ({} if math.isnan(elapsed_us) else {"elapsed_us": elapsed_us})


def _signed(version: int) -> int:
    number = version & (_RETURNED - 1)
    return number - _RETURNED if number >= _RETURNED // 2 else number
