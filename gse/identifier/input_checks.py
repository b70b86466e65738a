"""Checks of a panorama before any identification."""

import numpy as np
from numpy.typing import NDArray

from gse.identifier.result import ObjectColumns, Reason, Unidentified, check_shapes
from gse.process.jit import compiled
from gse.values.panorama import MAX_OBJECTS

_SOUND, _NOT_FINITE, _NOT_UNIT, _DARK, _NEGATIVE, _ALL_EQUAL = range(6)
_UNIT_WITHIN = 1e-6
_SAME_PLACE_RAD2 = 1e-6**2
"""Square of 0.2 arcsec: objects closer than this are one object listed twice."""

_COMPLAINTS = {
    _NOT_FINITE: "a position or index value is not a finite number",
    _NOT_UNIT: "a direction is not a unit vector",
    _DARK: "all index values are zero: the panorama holds no light",
    _NEGATIVE: "an index value is negative; 0 is the darkest",
    _ALL_EQUAL: "all index values are equal: no object is the brightest",
}


def refusals(objects: ObjectColumns, fewest: int) -> dict[int, Unidentified]:
    """Why panoramas cannot be identified at all, by their place: the sensor's faults are answers."""
    counts = objects.parts.counts
    refused: dict[int, Unidentified] = {}
    for k in ((counts > MAX_OBJECTS) | (counts < fewest)).nonzero()[0].tolist():
        refused[k] = _wrong_number(int(counts[k]), fewest)
    complaints = np.empty(len(objects), dtype=np.int64)
    _put_complaints(objects.directions_sensor, objects.brightness, objects.parts.first, complaints)
    for k in complaints.nonzero()[0].tolist():
        refused.setdefault(k, Unidentified(Reason.SENSOR_FAULT, _COMPLAINTS[int(complaints[k])]))
    return refused


def refusal(
    directions_sensor: NDArray[np.float64], brightness: NDArray[np.float64], fewest: int
) -> Unidentified | None:
    """Why one panorama cannot be identified, or None; ValueError where shapes do not belong together."""
    check_shapes(directions_sensor, brightness)
    if not fewest <= len(brightness) <= MAX_OBJECTS:
        return _wrong_number(len(brightness), fewest)
    complaint = _COMPLAINTS.get(_soundness(directions_sensor, brightness))
    return Unidentified(Reason.SENSOR_FAULT, complaint) if complaint else None


def _wrong_number(objects: int, fewest: int) -> Unidentified:
    if objects > MAX_OBJECTS:
        return Unidentified(Reason.SENSOR_FAULT, f"{objects} objects: a panorama holds at most {MAX_OBJECTS}")
    return Unidentified(Reason.TOO_FEW, f"{objects} object(s): at least {fewest} are needed")


@compiled
def _put_complaints(
    directions: NDArray[np.float64],
    brightness: NDArray[np.float64],
    first: NDArray[np.int64],
    complaints: NDArray[np.int64],
) -> None:
    """Put what is wrong with each panorama into ``complaints`` (K,)."""
    for k in range(len(complaints)):
        rows = slice(first[k], first[k + 1])
        complaints[k] = _soundness(directions[rows], brightness[rows])


@compiled
def _soundness(directions: NDArray[np.float64], brightness: NDArray[np.float64]) -> int:
    highest, lowest = -np.inf, np.inf
    for i in range(len(brightness)):
        x, y, z = directions[i]
        norm2 = x * x + y * y + z * z
        if not (np.isfinite(norm2) and np.isfinite(brightness[i])):
            return _NOT_FINITE
        if abs(norm2 - 1.0) > _UNIT_WITHIN:
            return _NOT_UNIT
        highest, lowest = max(highest, brightness[i]), min(lowest, brightness[i])
    if lowest < 0.0:
        return _NEGATIVE
    if highest == 0.0:
        return _DARK
    return _ALL_EQUAL if highest == lowest else _SOUND


@compiled
def distinct_objects(directions: NDArray[np.float64]) -> NDArray[np.int64]:
    """The rows of directions (N, 3) without those at the place of an earlier, brighter one."""
    kept = np.empty(len(directions), np.int64)
    count = 0
    for i in range(len(directions)):
        new = True
        for k in range(count):
            x = directions[i, 0] - directions[kept[k], 0]
            y = directions[i, 1] - directions[kept[k], 1]
            z = directions[i, 2] - directions[kept[k], 2]
            new = new and x * x + y * y + z * z > _SAME_PLACE_RAD2
        if new:
            kept[count] = i
            count += 1
    return kept[:count]
