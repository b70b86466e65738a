"""The robust identifier: the ground's judge of every answer."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gse.camera import Camera
from gse.catalog import StarCatalog
from gse.identifier.hypotheses import search
from gse.identifier.intake import refusal
from gse.identifier.result import Identification, Reason, Unidentified
from gse.identifier.robust_tables import build_tables, merge_doubles

ACCEPTED_CHANCE = 1e-3
"""No answer is given that chance would give more often."""

ACCEPTED_RATIO = 100.0
"""The best attitude must explain the panorama so many times better than any other."""

_MIRROR_CHANCE = 1e-5

_FEWEST_OBJECTS = 3

_MERGE_PX = 2.0
"""Stars closer than this are one object to the sensor."""

_FIELD_STARS = 90.0
"""Mean number of stars per field in the catalogue that is projected: thrice what a panorama holds."""

_SMALLEST_SIGMA_PX = 0.12

_MAX_HYPOTHESES = 6_000

_SCALE_SIGMA = 2.5e-3
"""How far the focal length may be off: 0.5 % is two sigma."""

# window px, its growth, partners, hypotheses kept, alpha stars, noise px, stars per object, objects, ranks of the alpha
_PLAN = (
    (1.77, 0.0, 3, 8, 5, 0.5, 1.5, 12, 5),
    (3.5, 0.0, 4, 16, 10, 1.0, 2.0, 16, 8),
    (6.5, 0.006, 5, 32, 30, 1.9, 3.0, 30, 30),
    (6.5, 0.0, 10, 64, 30, 1.9, 3.0, 30, 30),
)


class RobustIdentifier:
    """Finds the stars of a panorama from the full catalogue, or says why not; never guesses.

    ``catalog`` is what the sensor can see of the source: cut to three times the stars that a panorama of this camera
    holds (or to ``stars``), doubles closer than 2 px merged. ``field_of_view_deg`` is the diameter of a round stop in
    front of the detector, None where there is none.
    """

    name = "robust"

    def __init__(
        self,
        camera: Camera,
        catalog: StarCatalog,
        *,
        stars: int | Literal["auto"] = "auto",
        field_of_view_deg: float | None = None,
    ) -> None:
        pixel = 1.0 / camera.focal_length_px
        self._field, radius_rad = _field(camera, field_of_view_deg)
        solid_angle_sr = float(self._field[5])
        count = round(_FIELD_STARS * 4 * math.pi / solid_angle_sr) if stars == "auto" else stars
        icrs, magnitude, rows = merge_doubles(catalog, count, _MERGE_PX * pixel)
        self.catalog = replace(catalog.rows(rows), icrs=icrs, magnitude=magnitude)
        self._tables = build_tables(icrs, magnitude, radius_rad, solid_angle_sr)
        per_object = 4 * math.pi / solid_angle_sr
        self._plan = np.array(
            [
                (w * pixel, g, p, h, a, s * pixel, _SMALLEST_SIGMA_PX * pixel, _SCALE_SIGMA, f * per_object, n, r)
                for w, g, p, h, a, s, f, n, r in _PLAN
            ]
        )

    def identify(
        self, directions_sensor: NDArray[np.float64], index: NDArray[np.float64]
    ) -> Identification | Unidentified:
        """Name the stars among objects given as unit vectors (N, 3) and brightness (N,), brightest first."""
        refused = refusal(directions_sensor, index, _FEWEST_OBJECTS)
        if refused:
            return refused
        answer = self._search(directions_sensor, index)
        if isinstance(answer, Unidentified) and answer.reason is Reason.NO_MATCH:
            mirrored = self._search(directions_sensor * np.array([-1.0, 1.0, 1.0]), index)
            if isinstance(mirrored, Identification) and mirrored.chance < _MIRROR_CHANCE:
                return Unidentified(
                    Reason.NO_MATCH,
                    f"the image is mirrored: flipped, {len(mirrored.stars)} of {len(index)} objects are stars; "
                    "set sensor.mirrored",
                )
        return answer

    def _search(self, directions: NDArray[np.float64], index: NDArray[np.float64]) -> Identification | Unidentified:
        magnitude = -2.5 * np.log10(np.maximum(index, 1e-3))
        star_of = np.empty(len(index), dtype=np.int64)
        rotation = np.zeros((3, 3))
        best, second, _ = search(
            self._tables,
            directions,
            magnitude,
            self._field,
            self._plan,
            _MAX_HYPOTHESES,
            star_of,
            rotation,
        )
        if best < -math.log(ACCEPTED_CHANCE):
            return Unidentified(Reason.NO_MATCH, "no attitude explains the objects better than chance")
        if best - second < math.log(ACCEPTED_RATIO):
            return Unidentified(
                Reason.AMBIGUOUS, f"two attitudes explain the objects, one {math.exp(best - second):.1f} times better"
            )
        objects = np.flatnonzero(star_of >= 0)
        return Identification(objects, star_of[objects], math.exp(-best))


def _field(camera: Camera, field_of_view_deg: float | None) -> tuple[NDArray[np.float64], float]:
    """The field as ``verify`` describes it, and its radius in radians."""
    corners = np.array([(x, y) for x in (-0.5, camera.columns - 0.5) for y in (-0.5, camera.rows - 0.5)])
    directions = camera.directions(corners)
    uv = directions[:, :2] / directions[:, 2:]
    (left, top), (right, bottom) = uv.min(axis=0), uv.max(axis=0)
    radius_rad = math.acos(directions[:, 2].min())
    area = (right - left) * (bottom - top)
    radius2 = math.inf
    if field_of_view_deg is not None:
        radius_rad = min(radius_rad, math.radians(field_of_view_deg) / 2)
        radius2 = math.tan(radius_rad) ** 2
        area = min(area, math.pi * radius2)
    return np.array([left, right, top, bottom, radius2, area]), radius_rad
