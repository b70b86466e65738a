"""Photometry of the simulated sensor: magnitudes to electrons to index values, and how faint it can see."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.config.station import Sensor
from gse.simulator.scenario import Scenario

OVEREXPOSED_SHARE = 0.6
"""A sky that fills so much of the scale makes the sensor report ``overexposed``."""

BIAS_INDEX = 20.0
"""Index value without light, so that noise is not cut at 0."""

_DARK_DOUBLES_EVERY_C = 7.0
_DARK_GIVEN_AT_C = 20.0


@dataclass(frozen=True, slots=True)
class Photometry:
    """Electrons of light for one sensor in one scenario."""

    scenario: Scenario
    index_max: int
    zero_electrons_per_s: float
    pixel_arcsec2: float

    @classmethod
    def from_scenario(cls, sensor: Sensor, scenario: Scenario) -> Self:
        """What follows from the magnitude that saturates."""
        optics = scenario.optics
        in_brightest_pixel = math.erf(0.5 / optics.psf_sigma_px / math.sqrt(2)) ** 2
        saturating = sensor.index_max * optics.electrons_per_index / in_brightest_pixel / scenario.exposure_s
        zero_electrons_per_s = saturating * 10 ** (0.4 * optics.saturation_magnitude)
        pixel_arcsec = math.degrees(sensor.camera().pixel_rad) * 3600
        return cls(scenario, sensor.index_max, zero_electrons_per_s, pixel_arcsec**2)

    def star_electrons(self, magnitude: NDArray[np.float64], exposure_s: float) -> NDArray[np.float64]:
        """All electrons (N,) of stars (N,)."""
        return np.asarray(self.zero_electrons_per_s * exposure_s * 10 ** (-0.4 * magnitude), dtype=np.float64)

    def peak_index(self, magnitude: NDArray[np.float64], exposure_s: float) -> NDArray[np.float64]:
        """Index values (N,) of the brightest pixels of stars (N,), over the background and not cut."""
        gain = exposure_s / self.scenario.exposure_s * self.index_max
        return np.asarray(gain * 10 ** (-0.4 * (magnitude - self.scenario.optics.saturation_magnitude)))

    def sky_electrons(self, sky_magnitude: float, exposure_s: float) -> float:
        """Electrons of the sky in one pixel; magnitudes per square arcsecond."""
        return self.zero_electrons_per_s * exposure_s * self.pixel_arcsec2 * 10 ** (-0.4 * sky_magnitude)

    def dark_factor(self, temperature_c: float) -> float:
        """Dark current against that at 20 degC."""
        return float(2.0 ** ((temperature_c - _DARK_GIVEN_AT_C) / _DARK_DOUBLES_EVERY_C))

    def background_index(self, sky_magnitude: float, exposure_s: float) -> float:
        """Index value of the empty sky."""
        return BIAS_INDEX + self.sky_electrons(sky_magnitude, exposure_s) / self.scenario.optics.electrons_per_index

    def is_overexposed(self, background_index: float) -> bool:
        """Whether the sky alone fills most of the scale."""
        return background_index > OVEREXPOSED_SHARE * self.index_max

    def faintest_magnitude(self, sky_magnitude: float, exposure_s: float, temperature_c: float) -> float:
        """The limit of detection: signal against noise as good as at the scenario's limit in a dark sky."""
        nominal_s, dark_sky = self.scenario.exposure_s, self.scenario.air.dark_magnitude
        nominal = self._noise_electrons(dark_sky, nominal_s, _DARK_GIVEN_AT_C) / nominal_s
        now = self._noise_electrons(sky_magnitude, exposure_s, temperature_c) / exposure_s
        return self.scenario.optics.faintest_magnitude - 2.5 * math.log10(now / nominal)

    def _noise_electrons(self, sky_magnitude: float, exposure_s: float, temperature_c: float) -> float:
        optics = self.scenario.optics
        dark = optics.dark_electrons_per_s * self.dark_factor(temperature_c) * exposure_s
        return math.sqrt(optics.read_noise_electrons**2 + dark + self.sky_electrons(sky_magnitude, exposure_s) + 1e-9)
