"""Images of the simulated sky: electrons on a detector, then index values.

Stars are Gaussians integrated over pixels, smeared along their way during the exposure. Shot noise is drawn as Gaussian
with its own variance, which differs from Poisson's only where there is nothing to see. The Moon is a full disc,
whatever its phase. Light that is scattered inside the optics, and blooming, are neglected.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.config.station import Station
from gse.imaging.extraction import extract, extract_sub_pixel
from gse.process.jit import compiled, compiled_part
from gse.simulator.panorama import OVEREXPOSED, Exposure
from gse.simulator.photometry import BIAS_INDEX, Photometry
from gse.simulator.scenario import Scenario
from gse.simulator.scene import scene_of
from gse.values.matrices import product
from gse.values.screen import Screen

FAINTEST_MAGNITUDE = 9.0
_GRID = 17
"""The sky's own light is computed on 17 x 17 places of the detector, and is bilinear between."""
_STEP_PX = 0.5
"""A smeared star is a sum of stars at this spacing."""
_LONGEST_SMEAR_STEPS = 400
_RESPONSE_SPREAD = 0.01
_DARK_SPREAD = 0.3
_LEAST_ELECTRONS = 0.5
"""Where a star's Gaussian gives less in a pixel, it ends."""
_LARGEST_RADIUS_PX = 40


class ImageSource:
    """The same detector as PanoramaSource, pixel by pixel; ``sub_pixel`` extracts centres of light."""

    def __init__(
        self,
        station: Station,
        scenario: Scenario,
        random: np.random.Generator,
        *,
        sub_pixel: bool = False,
        drawn_for: Screen | None = None,
    ) -> None:
        self._scenario, self._random, self._sub_pixel = scenario, random, sub_pixel
        self._scene = scene_of(station, scenario, random, drawn_for=drawn_for)
        self._camera = self._scene.camera
        self._photometry = Photometry.from_scenario(station.sensor, scenario)
        self._response, self._dark = _detector(station, scenario, random)

    def expose(self, middle_utc_ns: int, exposure_s: float, temperature_c: float) -> Exposure:
        """One exposure, by its middle, extracted as the sensor does."""
        image = self.image(middle_utc_ns, exposure_s, temperature_c)
        if self._photometry.is_overexposed(float(np.median(image[::16, ::16]))):
            return Exposure(np.empty((0, 2)), np.empty(0), frozenset({OVEREXPOSED}))
        index_max = self._photometry.index_max
        xy_px, index = extract_sub_pixel(image, index_max=index_max) if self._sub_pixel else extract(image)
        return Exposure(xy_px, index, frozenset())

    def stars_at(self, utc_ns: int, xy_px: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The star of each object of an exposure, as its scene knows it."""
        return self._scene.stars_at(utc_ns, xy_px)

    def image(self, middle_utc_ns: int, exposure_s: float, temperature_c: float = 20.0) -> NDArray[np.uint16]:
        """Index values (rows, columns) of one exposure, by its middle."""
        optics = self._scenario.optics
        light = np.zeros((self._camera.rows, self._camera.columns), dtype=np.float32)
        self._add_stars(light, middle_utc_ns, exposure_s)
        self._add_moon(light, middle_utc_ns, exposure_s)
        noise = self._random.standard_normal(light.shape, dtype=np.float32)
        return _developed(
            light,
            self._sky_electrons(middle_utc_ns, exposure_s).astype(np.float32),
            self._response,
            self._dark * np.float32(exposure_s * self._photometry.dark_factor(temperature_c)),
            noise,
            np.array(
                [
                    optics.read_noise_electrons**2,
                    1 / optics.electrons_per_index,
                    BIAS_INDEX,
                    self._photometry.index_max,
                ],
                dtype=np.float32,
            ),
        )

    def _add_stars(self, light: NDArray[np.float32], middle_ns: int, exposure_s: float) -> None:
        half_ns = round(exposure_s * 5e8)
        (start_px, end_px), magnitude = self._scene.objects(middle_ns, FAINTEST_MAGNITUDE, (-half_ns, half_ns))
        margin_px = _LARGEST_RADIUS_PX + np.abs(end_px - start_px).max(axis=1)
        size = np.array([self._camera.columns, self._camera.rows])
        near = ((start_px > -margin_px[:, None]) & (start_px < size + margin_px[:, None])).all(axis=1)
        electrons = self._photometry.star_electrons(magnitude[near], exposure_s)
        sigma_px = self._scenario.optics.psf_sigma_px * self._scene.blur(middle_ns)
        _add_smeared(light, start_px[near], end_px[near], electrons, sigma_px)

    def _add_moon(self, light: NDArray[np.float32], utc_ns: int, exposure_s: float) -> None:
        """The lit part of the Moon, evenly bright up to its limb; saturated without blooming."""
        moon = self._scene.moon(utc_ns)
        if moon is None:
            return
        rows, columns = np.ogrid[: light.shape[0], : light.shape[1]]
        x, y = (columns - moon.xy_px[0]) / moon.radius_px, (rows - moon.xy_px[1]) / moon.radius_px
        # In units of the radius: along to the Sun's side, up to the observer; lit is what faces the Sun.
        along = x * moon.sunwards[0] + y * moon.sunwards[1]
        up2 = 1 - x**2 - y**2
        lit = (up2 >= 0) & (
            along * math.sin(moon.phase_rad) + np.sqrt(np.maximum(up2, 0)) * math.cos(moon.phase_rad) > 0
        )
        lit_px = math.pi * moon.radius_px**2 * (1 + math.cos(moon.phase_rad)) / 2
        electrons = self._photometry.star_electrons(np.array([moon.magnitude]), exposure_s)[0]
        light[lit] += electrons / max(lit_px, 1.0)

    def _sky_electrons(self, utc_ns: int, exposure_s: float) -> NDArray[np.float64]:
        """Electrons of the sky in a pixel, on the grid (17, 17)."""
        x = np.linspace(0, self._camera.columns - 1, _GRID)
        y = np.linspace(0, self._camera.rows - 1, _GRID)
        xy_px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        directions_horizon = product(self._camera.directions(xy_px), self._scene.horizon_to_sensor)
        magnitudes = self._scene.sky_magnitudes(directions_horizon, utc_ns)
        electrons = [self._photometry.sky_electrons(float(magnitude), exposure_s) for magnitude in magnitudes]
        return np.array(electrons).reshape(_GRID, _GRID)


def _detector(
    station: Station, scenario: Scenario, random: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Response and dark electrons per second at 20 degC of each pixel (rows, columns)."""
    shape = station.sensor.rows, station.sensor.columns
    optics, detector = scenario.optics, scenario.detector
    response = 1 + _RESPONSE_SPREAD * random.standard_normal(shape, dtype=np.float32)
    dark = optics.dark_electrons_per_s * np.exp(_DARK_SPREAD * random.standard_normal(shape, dtype=np.float32))
    dead = random.choice(response.size, min(detector.dead_pixels, response.size), replace=False)
    response.flat[dead] = 0.0
    hot = random.choice(dark.size, min(detector.hot_pixels, dark.size), replace=False)
    hot_index = random.uniform(*detector.hot_pixel_index, len(hot))
    dark.flat[hot] = hot_index * optics.electrons_per_index / scenario.exposure_s
    return response, dark.astype(np.float32)


@compiled
def _add_smeared(
    light: NDArray[np.float32],
    start_px: NDArray[np.float64],
    end_px: NDArray[np.float64],
    electrons: NDArray[np.float64],
    sigma_px: float,
) -> None:
    """Add stars that move from ``start_px`` to ``end_px`` (N, 2) with so many electrons each."""
    for star in range(len(electrons)):
        if not electrons[star] > 0.0:
            continue
        length_px = math.hypot(end_px[star, 0] - start_px[star, 0], end_px[star, 1] - start_px[star, 1])
        steps = min(int(length_px / _STEP_PX) + 1, _LONGEST_SMEAR_STEPS)
        share = electrons[star] / steps
        for step in range(steps):
            way = (step + 0.5) / steps
            x = start_px[star, 0] + way * (end_px[star, 0] - start_px[star, 0])
            y = start_px[star, 1] + way * (end_px[star, 1] - start_px[star, 1])
            _add_star(light, x, y, share, sigma_px)


@compiled_part
def _add_star(light: NDArray[np.float32], x: float, y: float, electrons: float, sigma_px: float) -> None:
    rows, columns = light.shape
    brightest = electrons / (2 * math.pi * sigma_px**2)
    if brightest <= _LEAST_ELECTRONS:
        return
    radius = min(int(sigma_px * math.sqrt(2 * math.log(brightest / _LEAST_ELECTRONS))) + 2, _LARGEST_RADIUS_PX)
    left, right = max(math.floor(x) - radius, 0), min(math.floor(x) + radius + 1, columns - 1)
    top, bottom = max(math.floor(y) - radius, 0), min(math.floor(y) + radius + 1, rows - 1)
    scale = 1 / (sigma_px * math.sqrt(2.0))
    along = np.empty(2 * _LARGEST_RADIUS_PX + 2)
    for column in range(left, right + 1):
        along[column - left] = math.erf((column + 0.5 - x) * scale) - math.erf((column - 0.5 - x) * scale)
    for row in range(top, bottom + 1):
        in_row = (math.erf((row + 0.5 - y) * scale) - math.erf((row - 0.5 - y) * scale)) * electrons / 4
        for column in range(left, right + 1):
            light[row, column] += in_row * along[column - left]


@compiled
def _developed(
    light: NDArray[np.float32],
    sky: NDArray[np.float32],
    response: NDArray[np.float32],
    dark: NDArray[np.float32],
    noise: NDArray[np.float32],
    electronics: NDArray[np.float32],
) -> NDArray[np.uint16]:
    """Index values; ``electronics`` is read noise squared, index per electron, bias and the highest index value."""
    read_noise2, index_per_electron, bias, index_max = electronics
    rows, columns = light.shape
    image = np.empty((rows, columns), dtype=np.uint16)
    across = np.empty(sky.shape[1], dtype=np.float32)
    for row in range(rows):
        down = np.float32(row * (sky.shape[0] - 1) / max(rows - 1, 1))
        above = min(int(down), sky.shape[0] - 2)
        down -= above
        for node in range(sky.shape[1]):
            across[node] = sky[above, node] * (1 - down) + sky[above + 1, node] * down
        per_column = np.float32((sky.shape[1] - 1) / max(columns - 1, 1))
        for column in range(columns):
            place = np.float32(column) * per_column
            left = min(int(place), sky.shape[1] - 2)
            place -= left
            background = across[left] + (across[left + 1] - across[left]) * place
            electrons = (light[row, column] + background) * response[row, column] + dark[row, column]
            electrons += noise[row, column] * math.sqrt(electrons + read_noise2)
            index = electrons * index_per_electron + bias
            image[row, column] = np.uint16(min(max(index, np.float32(0.0)), index_max))
    return image
