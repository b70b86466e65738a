"""The structs of gse_identifier.h as bytes."""

import math
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from gse.external.answers import Failure, FailureKind
from gse.external.panoramas import Counts, SensorDescription
from gse.panorama import MAX_OBJECTS, Panorama

ABI = 1
SENSOR = struct.Struct("=4I14d")
PANORAMA = np.dtype(
    [
        *(("version", "u4"), ("frame_no", "u4"), ("utc_ns", "i8"), ("time_us", "u8"), ("exposure_us", "u4")),
        *(("count", "u4"), ("objects", "f8", (MAX_OBJECTS, 3))),
    ]
)
ANSWER = struct.Struct(f"=i4xd4I4d{16 * MAX_OBJECTS}s64s")
"""What the function returned, the time of the call in microseconds, and gse_answer."""
_MATCH = np.dtype([("star", "i8"), ("object", "u4"), ("spare", "u4")])
_LARGEST_U32 = 0xFFFFFFFF
_STATUSES = {1: "IDENTIFIED", 2: "TOO_FEW", 3: "NO_MATCH", 4: "AMBIGUOUS", 5: "SENSOR_FAULT"}


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
        *camera.tangential_distortion,
        sensor.index_max,
        *units,
    )


def panorama_records(panoramas: Sequence[Panorama], counts: Counts) -> list[bytes]:
    """The structs gse_panorama."""
    rows = np.zeros(len(panoramas), PANORAMA)
    rows["version"] = ABI
    rows["frame_no"] = [panorama.frame_no & _LARGEST_U32 for panorama in panoramas]
    rows["utc_ns"] = [panorama.utc_ns for panorama in panoramas]
    rows["time_us"] = [panorama.time_us for panorama in panoramas]
    rows["exposure_us"] = [_exposure_us(panorama.exposure_s) for panorama in panoramas]
    rows["count"] = sizes = np.diff(counts.first)
    rows["objects"][np.arange(MAX_OBJECTS) < sizes[:, None]] = counts.values
    data = rows.tobytes()
    return [data[begin : begin + PANORAMA.itemsize] for begin in range(0, len(data), PANORAMA.itemsize)]


def _exposure_us(exposure_s: float) -> int:
    return min(max(round(1e6 * exposure_s), 0), _LARGEST_U32) if math.isfinite(exposure_s) else 0


def answer_document(data: bytes, frame_no: int) -> dict[str, Any] | Failure:
    """The answer in a struct gse_answer as a document of schema gse.answer/1."""
    returned, call_us, version, answered, status, matched, *numbers, matches, detail = ANSWER.unpack(data)
    if returned:
        text = f"the function returned {returned}"
        return {"frame_no": frame_no, "status": "NO_MATCH", "detail": text, "call_us": call_us}
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
        "call_us": call_us,
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
