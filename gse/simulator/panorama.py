"""Panoramas of the simulated sky: stars to objects, without an image between.

What the paper's extraction does to stars is done to their list: of stars within one footprint the brighter counts,
with the light of both; of two objects in one row the brighter; the 30 brightest are kept.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.camera import Camera
from gse.catalog import load_catalog
from gse.config import Station
from gse.panorama import MAX_OBJECTS
from gse.simulator.pointing import horizon_to_sensor
from gse.simulator.scenario import Detector, Scenario, profile_at
from gse.simulator.sky import CELL_NS, Sky, SkyCell

ARCSEC_PER_RAD = 180 * 3600 / math.pi
_FOOTPRINT_PX = 2.0
_NOISE_SIGMAS = 5
"""Fainter stars than the limit by so much noise are never seen."""
_CLOUD_PX = 300.0
"""Size of a cloud's structure, in pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """What the detector gives: objects ``xy_px`` (N, 2) and ``index`` (N,), brightest first, and status bits."""

    xy_px: NDArray[np.float64]
    index: NDArray[np.float64]
    flags: frozenset[str]


class PanoramaSource:
    """The detector behind its optics under the simulated sky; ``station`` is what the device really is."""

    def __init__(self, station: Station, scenario: Scenario, random: np.random.Generator) -> None:
        self._camera = station.sensor.camera()
        self._index_max = station.sensor.index_max
        self._horizon_to_sensor = horizon_to_sensor(station.mount)
        self._scenario = scenario
        self._random = random
        self._noise_px = scenario.optics.position_noise_arcsec / ARCSEC_PER_RAD / self._camera.pixel_rad
        self._sky = Sky(station.site, load_catalog(), _FOOTPRINT_PX * self._camera.pixel_rad)
        self._hot_xy_px, self._hot_index = _hot_pixels(self._camera, scenario.detector, random)
        self._cell: SkyCell | None = None
        self._cell_faintest = -math.inf

    def expose(self, middle_utc_ns: int, exposure_s: float) -> Exposure:
        """One exposure, by its middle."""
        optics, air = self._scenario.optics, self._scenario.air
        since_start_s = (middle_utc_ns - self._scenario.start_utc_ns) * 1e-9
        gain_mag = 2.5 * math.log10(exposure_s / self._scenario.exposure_s)
        sky_mag = max(profile_at(air.sky_magnitudes, since_start_s) + gain_mag / 2, 0.0)
        if sky_mag >= air.overexposed_from_magnitudes:
            return Exposure(np.empty((0, 2)), np.empty(0), frozenset({"overexposed"}))
        xy_px, magnitude = self._stars(middle_utc_ns, gain_mag)
        magnitude = magnitude - gain_mag + self._cloud_mag(xy_px, since_start_s)
        magnitude = magnitude + self._random.normal(0, optics.magnitude_noise, len(magnitude))
        xy_px = xy_px + self._random.normal(0, self._noise_px, xy_px.shape)
        seen = self._camera.contains(xy_px) & (magnitude < optics.faintest_magnitude - sky_mag)
        if self._scenario.detector.missing:
            seen &= self._random.random(len(seen)) >= self._scenario.detector.missing
        index = self._index_max * 10 ** (-0.4 * (magnitude[seen] - optics.saturation_magnitude))
        xy_px, index = self._with_others(xy_px[seen], index)
        return self._kept(xy_px, index)

    def _stars(self, utc_ns: int, gain_mag: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        optics, cell = self._scenario.optics, self._cell
        faintest = optics.faintest_magnitude + _NOISE_SIGMAS * optics.magnitude_noise + max(gain_mag, 0.0)
        if cell is None or not 0 <= utc_ns - cell.start_ns < CELL_NS or faintest > self._cell_faintest:
            radius_rad = 0.55 * self._camera.diagonal_rad
            cell = self._sky.cell(utc_ns, self._horizon_to_sensor[2], radius_rad, faintest)
            self._cell, self._cell_faintest = cell, faintest
        xy_px = self._camera.pixels(cell.directions(utc_ns) @ self._horizon_to_sensor.T)
        near = self._camera.contains(xy_px)
        return xy_px[near], cell.magnitude[near]

    def _cloud_mag(self, xy_px: NDArray[np.float64], since_start_s: float) -> NDArray[np.float64] | float:
        """Extinction of moving clouds: a sum of waves, cut so that it covers the share of the sky that is asked."""
        air = self._scenario.air
        deepest_mag = profile_at(air.cloud_magnitudes, since_start_s)
        if deepest_mag <= 0:
            return 0.0
        x, y = ((xy_px - np.multiply(air.cloud_drift_px_per_s, since_start_s)) / _CLOUD_PX).T
        wave = (np.sin(x + 0.7 * np.sin(y)) + np.sin(0.6 * x - 1.1 * y + 2.0)) / 4 + 0.5
        depth = np.clip((wave - (1 - air.cloud_cover)) * 4 + air.cloud_cover, 0, 1)
        cloud_mag: NDArray[np.float64] = deepest_mag * depth
        return cloud_mag

    def _with_others(
        self, xy_px: NDArray[np.float64], index: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        detector = self._scenario.detector
        if len(self._hot_index):
            xy_px = np.concatenate([xy_px, self._hot_xy_px])
            index = np.concatenate([index, self._hot_index * self._random.normal(1, 0.02, len(self._hot_index))])
        if detector.false_objects:
            count = self._random.poisson(detector.false_objects)
            size = (self._camera.columns - 1, self._camera.rows - 1)
            xy_px = np.concatenate([xy_px, self._random.random((count, 2)) * size])
            index = np.concatenate([index, self._index_max * 10 ** self._random.uniform(-2, 0, count)])
        return xy_px, index

    def _kept(self, xy_px: NDArray[np.float64], index: NDArray[np.float64]) -> Exposure:
        order = np.argsort(-index, kind="stable")
        xy_px = np.clip(xy_px[order], 0, (self._camera.columns - 1, self._camera.rows - 1))
        _, first = np.unique(np.rint(xy_px[:, 1]), return_index=True)
        brightest_of_row = np.sort(first)[:MAX_OBJECTS]
        index = np.clip(np.rint(index[order]), 1, self._index_max)
        return Exposure(xy_px[brightest_of_row], index[brightest_of_row], frozenset())


def _hot_pixels(
    camera: Camera, detector: Detector, random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    xy_px = random.integers(0, (camera.columns, camera.rows), (detector.hot_pixels, 2)).astype(np.float64)
    return xy_px, random.uniform(*detector.hot_pixel_index, detector.hot_pixels)
