"""Panoramas of the simulated sky: stars to objects, without an image between.

What the paper's extraction does to stars is done to their list: of stars within one footprint the brighter counts,
with the light of both; of two objects in one row the brighter; the 30 brightest are kept. Where a scene turns, a star
is a trail: its peak falls as that of a Gaussian that is drawn out, and the noise of its place grows by as much.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.config.station import Station
from gse.simulator.photometry import Photometry
from gse.simulator.scenario import Scenario
from gse.simulator.scene import scene_of
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.panorama import MAX_OBJECTS
from gse.values.screen import Screen

OVEREXPOSED = "overexposed"
"""The status bit, in the words of the protocols."""

_FOOTPRINT_PX = 2.0
_NOISE_SIGMAS = 5
"""Fainter stars than the limit by so much noise are never seen."""
_HOT_NOISE = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """What the detector gives: objects ``xy_px`` (N, 2) and ``index`` (N,), brightest first, and status bits."""

    xy_px: NDArray[np.float64]
    index: NDArray[np.float64]
    flags: frozenset[str]


class PanoramaSource:
    """The detector behind its optics under the simulated sky; ``station`` is what the device really is."""

    def __init__(
        self, station: Station, scenario: Scenario, random: np.random.Generator, *, drawn_for: Screen | None = None
    ) -> None:
        self._scenario, self._random = scenario, random
        self._scene = scene_of(station, scenario, random, _FOOTPRINT_PX, drawn_for=drawn_for)
        self._camera = self._scene.camera
        self._photometry = Photometry.from_scenario(station.sensor, scenario)
        self._noise_px = scenario.optics.position_noise_arcsec / ARCSEC_PER_RAD / self._camera.pixel_rad
        self._last_px = np.array([self._camera.columns - 1, self._camera.rows - 1], dtype=np.float64)
        self._hot_xy_px, self._hot_index = _hot_pixels(station, scenario, random)

    def expose(self, middle_utc_ns: int, exposure_s: float, temperature_c: float) -> Exposure:
        """One exposure, by its middle."""
        sky_magnitude = self._scene.boresight_sky_magnitude(middle_utc_ns)
        background = self._photometry.background_index(sky_magnitude, exposure_s)
        if self._photometry.is_overexposed(background):
            return Exposure(np.empty((0, 2)), np.empty(0), frozenset({OVEREXPOSED}))
        limit = self._photometry.faintest_magnitude(sky_magnitude, exposure_s, temperature_c)
        blur = self._scene.blur(middle_utc_ns)  # the light of a peak is spread over the square of it
        xy_px, magnitude = self._stars(middle_utc_ns, exposure_s, limit - 5 * math.log10(blur), blur)
        index = self._photometry.peak_index(magnitude, exposure_s) / blur**2
        xy_px, index = self._with_hot_pixels(xy_px, index, exposure_s, temperature_c)
        xy_px, index = self._with_false_objects(xy_px, index)
        xy_px, index = self._behind_the_moon(xy_px, index, middle_utc_ns)
        return self._kept(xy_px, index + background)

    def stars_at(self, utc_ns: int, xy_px: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The star of each object of an exposure, as its scene knows it."""
        return self._scene.stars_at(utc_ns, xy_px)

    def _stars(
        self, utc_ns: int, exposure_s: float, limit: float, blur: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        noise = self._scenario.optics.magnitude_noise
        # The cell is asked for to the next half magnitude: the limit wanders a little with the temperature.
        deepest = math.ceil(2 * (limit + _NOISE_SIGMAS * noise)) / 2
        half_ns = round(exposure_s * 5e8)
        offsets_ns = (0, -half_ns, half_ns) if self._scene.turns(utc_ns) else (0,)
        (xy_px, *ends_px), magnitude = self._scene.objects(utc_ns, deepest, offsets_ns)
        near = self._camera.contains(xy_px)
        xy_px, magnitude = xy_px[near], magnitude[near]
        magnitude = magnitude + self._random.normal(0, noise, len(magnitude))
        noise_px = np.full((len(xy_px), 1), self._noise_px * blur)
        if ends_px:
            start_px, end_px = (end[near] for end in ends_px)
            peak = _peak_of_trail(end_px - start_px, self._scenario.optics.psf_sigma_px * blur)
            magnitude, noise_px = magnitude - 2.5 * np.log10(peak), noise_px / peak[:, None]
        xy_px = xy_px + self._random.normal(0, noise_px, xy_px.shape)
        seen = magnitude < limit
        if self._scenario.detector.missing:
            seen &= self._random.random(len(seen)) >= self._scenario.detector.missing
        return xy_px[seen], magnitude[seen]

    def _with_hot_pixels(
        self, xy_px: NDArray[np.float64], index: NDArray[np.float64], exposure_s: float, temperature_c: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        count = len(self._hot_index)
        if not count:
            return xy_px, index
        factor = self._photometry.dark_factor(temperature_c) * exposure_s / self._scenario.exposure_s
        hot = self._hot_index * factor * self._random.normal(1, _HOT_NOISE, count)
        return np.concatenate([xy_px, self._hot_xy_px]), np.concatenate([index, hot])

    def _with_false_objects(
        self, xy_px: NDArray[np.float64], index: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        mean = self._scenario.detector.false_objects
        count = int(self._random.poisson(mean)) if mean else 0
        if not count:
            return xy_px, index
        false_index = self._photometry.index_max * 10 ** self._random.uniform(-2, 0, count)
        xy_px = np.concatenate([xy_px, self._random.random((count, 2)) * self._last_px])
        return xy_px, np.concatenate([index, false_index])

    def _behind_the_moon(
        self, xy_px: NDArray[np.float64], index: NDArray[np.float64], utc_ns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The Moon in the field is the brightest pixel of all its rows: one object, and no other there."""
        moon = self._scene.moon(utc_ns)
        if moon is None or not self._camera.contains(moon.xy_px[None])[0]:
            return xy_px, index
        left = np.abs(xy_px[:, 1] - moon.xy_px[1]) > moon.radius_px
        return np.concatenate([xy_px[left], moon.xy_px[None]]), np.append(index[left], np.inf)

    def _kept(self, xy_px: NDArray[np.float64], index: NDArray[np.float64]) -> Exposure:
        order = np.argsort(-index, kind="stable")
        xy_px = np.minimum(np.maximum(xy_px[order], 0), self._last_px)
        _, first = np.unique(np.rint(xy_px[:, 1]), return_index=True)
        brightest_of_row = np.sort(first)[:MAX_OBJECTS]
        index = np.clip(np.rint(index[order]), 1, self._photometry.index_max)
        return Exposure(xy_px[brightest_of_row], index[brightest_of_row], frozenset())


def _peak_of_trail(trails_px: NDArray[np.float64], sigma_px: float) -> NDArray[np.float64]:
    """The peaks (N,) of Gaussians that are drawn out along trails (N, 2), in those of a star at rest."""
    half = np.maximum(np.hypot(*trails_px.T), 1e-6) / (2 * math.sqrt(2) * sigma_px)
    return np.array([math.sqrt(math.pi) / 2 * math.erf(one) / one for one in half.tolist()])


def _hot_pixels(
    station: Station, scenario: Scenario, random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (N, 2) and index values (N,) at 20 degC."""
    detector, sensor = scenario.detector, station.sensor
    xy_px = random.integers(0, (sensor.columns, sensor.rows), (detector.hot_pixels, 2)).astype(np.float64)
    return xy_px, random.uniform(*detector.hot_pixel_index, detector.hot_pixels)
