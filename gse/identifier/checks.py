"""Checks around an identification: the panorama before it, the answer after it.

A panorama that breaks the sensor's own rules is refused. An answer is accepted where an attitude fits it, with a bound
on its false match probability.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.identifier.result import Identification, ObjectColumns, Reason, Unidentified, check_shapes
from gse.process.jit import compiled
from gse.values.attitude import davenport
from gse.values.constants import ARCSEC_RAD
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


_GATE = 16.0
"""Area, in squares of the tolerance, where an object fits two distances: a rhombus of (2 d_m)^2 / sin of the angle at
the object, whose inverse sine is 2 in the mean, on either side of the line, for distances alone see no handedness."""


@dataclass(frozen=True, slots=True)
class RandomSky:
    """The statistics of a catalogue that random objects meet."""

    stars: int
    pairs: int
    widest_rad: float
    tolerance_rad: float

    def false_match_probability(self, objects: int, fit: int, alphas: int) -> float:
        """Bound on the probability that random objects reach a fit of ``fit`` with any of ``alphas`` alpha stars.

        The expected number of two-star matches (pairs grow with distance, so at most twice their mean density, each
        either way round), times the probability that fit - 1 of the remaining objects find a star where they need one.
        """
        window = min(1.0, 4 * self.tolerance_rad / self.widest_rad)
        matches = alphas * max(objects - 1, 0) * 2 * self.pairs * window
        third = min(1.0, self.stars / (4 * math.pi) * _GATE * self.tolerance_rad**2)
        return min(1.0, matches * _more_than(fit - 2, max(objects - 2, fit - 1), third))


@functools.lru_cache(maxsize=1024)
def _more_than(successes: int, trials: int, probability: float) -> float:
    """The probability of more successes than these; the same few are needed all session long."""
    each = (
        math.comb(trials, count) * probability**count * (1 - probability) ** (trials - count)
        for count in range(successes + 1, trials + 1)
    )
    return math.fsum(each)


def accepted(
    directions_sensor: NDArray[np.float64],
    catalog: StarCatalog,
    objects: NDArray[np.int64],
    stars: NDArray[np.int64],
    tolerance_rad: float,
    false_match_probability: float,
) -> Identification | Unidentified:
    """The identification, or Unidentified where no attitude puts the stars on their objects within the tolerance."""
    measured, icrs = directions_sensor.take(objects, axis=0), catalog.icrs.take(stars, axis=0)
    rms_rad = wahba_residual_rad(measured, icrs)
    answer = Identification(objects, stars, false_match_probability)
    return (
        answer if rms_rad <= tolerance_rad else misfit(answer, directions_sensor, catalog.icrs, rms_rad, tolerance_rad)
    )


def misfit(
    answer: Identification,
    directions_sensor: NDArray[np.float64],
    stars_icrs: NDArray[np.float64],
    rms_rad: float,
    tolerance_rad: float,
) -> Unidentified:
    """Why an answer is none: its stars lie ``rms_rad`` off their objects, as they are, or also once flipped."""
    measured, icrs = directions_sensor.take(answer.objects, axis=0), stars_icrs.take(answer.stars, axis=0)
    mirrored_rad = wahba_residual_rad(measured * np.array([-1.0, 1.0, 1.0]), icrs)
    residual = f"the stars found lie {rms_rad / ARCSEC_RAD:.0f} arcsec rms off their objects"
    if mirrored_rad <= tolerance_rad:
        return Unidentified(
            Reason.MIRRORED, f"the image is mirrored: {residual}, {mirrored_rad / ARCSEC_RAD:.0f} once flipped"
        )
    return Unidentified(Reason.NO_MATCH, f"{residual}: no attitude fits")


@compiled
def wahba_residual_rad(measured: NDArray[np.float64], stars: NDArray[np.float64]) -> float:
    """Root mean square angle between directions (N, 3) and stars (N, 3) under the attitude that makes it least."""
    rotation = np.empty((3, 3))
    if not davenport(measured, stars, np.ones(len(measured)), rotation):
        return np.inf
    total = 0.0
    for i in range(len(measured)):
        for j in range(3):
            placed = rotation[j, 0] * stars[i, 0] + rotation[j, 1] * stars[i, 1] + rotation[j, 2] * stars[i, 2]
            total += (measured[i, j] - placed) ** 2
    return math.sqrt(total / len(measured))
