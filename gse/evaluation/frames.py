"""Panoramas of a simulated sky: what a camera sees in a given direction, with given faults."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog
from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_RAD
from gse.values.matrices import product
from gse.values.panorama import MAX_OBJECTS

_FALSE_MAGNITUDES = 4.0
"""False objects lie between the limit and this much brighter."""

_INDEX_MAX_MAGNITUDES = 7.5
"""The index value 4096 belongs to a star this much brighter than the limit; brighter ones go beyond."""

_NOISE_REACH = 5.0
"""Stars fainter than the limit by more than this many sigma never scatter into view."""


@dataclass(frozen=True, slots=True)
class Optics:
    """What the simulated sensor can see: a camera, down to a magnitude, perhaps behind a round stop."""

    name: str
    camera: Camera
    magnitude_limit: float
    field_of_view_deg: float | None = None
    """Diameter of a circular field, or None for the whole detector."""

    def radius_rad(self) -> float:
        """Greatest angle from the boresight."""
        if self.field_of_view_deg is not None:
            return math.radians(self.field_of_view_deg) / 2
        return self.camera.diagonal_rad / 2

    def sees(self, xy_px: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which pixels (N, 2) lie on the detector and inside the field."""
        inside = self.camera.contains(xy_px)
        if self.field_of_view_deg is not None:
            inside &= self.camera.directions(xy_px)[:, 2] >= math.cos(self.radius_rad())
        return inside


@dataclass(frozen=True, slots=True)
class Conditions:
    """How well the simulated sensor sees: noise per axis and star, false objects, stars that are missing."""

    name: str = "nominal"
    position_arcsec: float = 10.0
    magnitude: float = 0.3
    false_objects: int = 0
    missing_share: float = 0.0
    whole_pixels: bool = True
    merge_px: float = 2.0
    focal_length_error: float = 0.0
    """The true focal length is longer than the camera's by this share."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedFrame:
    """A panorama with its truth; objects brightest first, ``star_ids`` (N,) 0 for a false object."""

    __test__ = False

    directions_sensor: NDArray[np.float64]
    xy_px: NDArray[np.float64]
    brightness: NDArray[np.float64]
    star_ids: NDArray[np.int64]
    attitude: Attitude

    @property
    def real_stars(self) -> int:
        """How many objects are stars."""
        return int((self.star_ids != 0).sum())


class FrameMaker:
    """Makes frames of one optics under one set of conditions; the same generator state gives the same frame."""

    def __init__(self, optics: Optics, conditions: Conditions, catalog: StarCatalog) -> None:
        self.optics, self.conditions = optics, conditions
        limit = optics.magnitude_limit + _NOISE_REACH * conditions.magnitude
        self._catalog = catalog.rows(np.flatnonzero(catalog.magnitude < limit))
        self._true_camera = _longer(optics.camera, conditions.focal_length_error)
        self._cos_radius = math.cos(optics.radius_rad() * 1.02 + 10 * conditions.position_arcsec * ARCSEC_RAD)

    def frame(self, boresight_icrs: NDArray[np.float64], rng: np.random.Generator) -> SimulatedFrame:
        """What is seen along ``boresight_icrs`` (3,) with a random roll."""
        attitude = _attitude(boresight_icrs, rng.uniform(0, 360))
        xy, magnitude, ids = self._stars(attitude, rng)
        false_xy, false_magnitude = self._false_objects(rng)
        xy = np.concatenate([xy, false_xy])
        magnitude = np.concatenate([magnitude, false_magnitude])
        ids = np.concatenate([ids, np.zeros(len(false_xy), dtype=np.int64)])
        if self.conditions.whole_pixels:
            xy = np.round(xy)
        order = np.argsort(magnitude, kind="stable")[:MAX_OBJECTS]
        xy = xy[order]
        brightness = 4096.0 * 10 ** (-0.4 * (magnitude[order] - self.optics.magnitude_limit + _INDEX_MAX_MAGNITUDES))
        return SimulatedFrame(self.optics.camera.directions(xy), xy, brightness, ids[order], attitude)

    def _stars(
        self, attitude: Attitude, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        conditions, catalog = self.conditions, self._catalog
        near = np.flatnonzero(product(catalog.icrs, attitude.boresight_icrs) > self._cos_radius)
        magnitude = catalog.magnitude[near] + rng.normal(0, conditions.magnitude, len(near))
        xy = self._true_camera.pixels(product(catalog.icrs[near], attitude.icrs_to_sensor.T))
        xy += rng.normal(0, conditions.position_arcsec * ARCSEC_RAD * self.optics.camera.focal_length_px, xy.shape)
        lost = rng.random(len(near)) < conditions.missing_share
        keep = (magnitude < self.optics.magnitude_limit) & ~lost & self.optics.sees(xy)
        xy, magnitude, ids = xy[keep], magnitude[keep], catalog.ids[near][keep]
        return _merged(xy, magnitude, ids, conditions.merge_px)

    def _false_objects(self, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        camera, limit = self.optics.camera, self.optics.magnitude_limit
        count = self.conditions.false_objects
        xy = np.empty((0, 2))
        while len(xy) < count:
            more = rng.uniform(-0.5, [camera.columns - 0.5, camera.rows - 0.5], (count, 2))
            xy = np.concatenate([xy, more[self.optics.sees(more)]])[:count]
        return xy, rng.uniform(limit - _FALSE_MAGNITUDES, limit, count)


def _attitude(boresight_icrs: NDArray[np.float64], roll_deg: float) -> Attitude:
    x, y, z = boresight_icrs
    return Attitude.from_angles(math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y))), roll_deg)


def _longer(camera: Camera, share: float) -> Camera:
    return replace(camera, focal_length_px=camera.focal_length_px * (1 + share))


def _merged(
    xy: NDArray[np.float64], magnitude: NDArray[np.float64], ids: NDArray[np.int64], merge_px: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Stars closer than ``merge_px`` to a brighter one become one object with it: light added, centre of light."""
    order = np.argsort(magnitude, kind="stable")
    xy, magnitude, ids = xy[order], magnitude[order], ids[order]
    distance = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    close = np.triu(distance < merge_px, 1)
    if not close.any():
        return xy, magnitude, ids
    alive = np.ones(len(xy), dtype=bool)
    flux = 10 ** (-0.4 * magnitude)
    for i in range(len(xy)):
        others = np.flatnonzero(close[i] & alive) if alive[i] else np.empty(0, dtype=np.int64)
        if len(others):
            group = np.append(others, i)
            xy[i] = (xy[group] * flux[group, None]).sum(axis=0) / flux[group].sum()
            magnitude[i] = -2.5 * math.log10(flux[group].sum())
            alive[others] = False
    return xy[alive], magnitude[alive], ids[alive]
