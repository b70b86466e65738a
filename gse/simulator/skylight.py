"""Brightness of the sky: night, Moon and twilight, in magnitudes per square arcsecond.

The Moon's glow follows Krisciunas & Schaefer 1991, PASP 103, 1033, equations 2, 3, 15, 20, 21 (some 20 % accurate).
Twilight at the zenith is a parabola through Patat, Ugolnikov & Postylyakov 2006, A&A 455, 385 (V band, Sun 5 to 16 deg
down), drawn out in a straight line to sunset; its gradient towards the Sun is a rough guess.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.matrices import product
from gse.simulator.bodies import MOON, SUN, BodyCell

DARK_MAGNITUDE = 21.3
"""Zenith of a moonless night at a good site, V per square arcsecond."""
EXTINCTION_PER_AIRMASS = 0.2
_BRIGHTEST_MAGNITUDE = 3.0
"""Clear daylight."""
_NANOLAMBERT_ZERO, _NANOLAMBERT_SLOPE, _NANOLAMBERT_UNIT = 20.7233, 0.92104, 34.08


def sky_magnitude(
    directions_horizon: NDArray[np.float64],
    bodies: BodyCell,
    utc_ns: int,
    dark_magnitude: float = DARK_MAGNITUDE,
    *,
    sunlight: bool = True,
) -> NDArray[np.float64]:
    """Surface brightness (N,) of the sky in directions (N, 3), x east, y north, z up; as at night without sunlight."""
    places = bodies.track.directions(utc_ns)
    light = _light(dark_magnitude * np.ones(len(directions_horizon)))
    if sunlight:
        light = light + _light(_twilight_magnitude(directions_horizon, places[SUN]))
    if places[MOON][2] > 0:
        light = light + _moonlight(directions_horizon, places[MOON], bodies.magnitude[MOON])
    magnitude = (_NANOLAMBERT_ZERO - np.log(light / _NANOLAMBERT_UNIT)) / _NANOLAMBERT_SLOPE
    return np.asarray(np.maximum(magnitude, _BRIGHTEST_MAGNITUDE), dtype=np.float64)


def airmass(directions_horizon: NDArray[np.float64]) -> NDArray[np.float64]:
    """Air masses (N,) in directions (N, 3): Krisciunas & Schaefer 1991, equation 3; 5 at the horizon."""
    sin2_zenith_distance = 1 - np.clip(directions_horizon[:, 2], 0, 1) ** 2
    return np.asarray((1 - 0.96 * sin2_zenith_distance) ** -0.5, dtype=np.float64)


def _light(magnitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nanolamberts of magnitudes per square arcsecond."""
    return np.asarray(_NANOLAMBERT_UNIT * np.exp(_NANOLAMBERT_ZERO - _NANOLAMBERT_SLOPE * magnitude))


def _moonlight(
    directions: NDArray[np.float64], moon: NDArray[np.float64], moon_magnitude: float
) -> NDArray[np.float64]:
    """Nanolamberts that the air scatters from the Moon."""
    cosine = np.clip(product(directions, moon), -1, 1)
    separation_deg = np.degrees(np.arccos(cosine))
    illuminance = 10 ** (-0.4 * (moon_magnitude + 16.57))
    scattering = 10**5.36 * (1.06 + cosine**2) + 10 ** (6.15 - separation_deg / 40)
    to_the_moon = 10 ** (-0.4 * EXTINCTION_PER_AIRMASS * airmass(moon[None])[0])
    not_let_through = 1 - 10 ** (-0.4 * EXTINCTION_PER_AIRMASS * airmass(directions))
    return np.asarray(scattering * illuminance * to_the_moon * not_let_through)


def _twilight_magnitude(directions: NDArray[np.float64], sun: NDArray[np.float64]) -> NDArray[np.float64]:
    down_deg = -math.degrees(math.asin(float(sun[2])))
    from_five = max(min(down_deg - 5, 12.0), -10.0)
    zenith = 11.84 + 1.518 * from_five - 0.057 * max(from_five, 0.0) ** 2 + 4 * max(down_deg - 17, 0.0)
    # Twice as bright some 40 deg off the zenith on the Sun's side, half as bright on the other.
    sunwards = product(directions[:, :2], sun[:2]) / max(float(np.hypot(sun[0], sun[1])), 1e-9)
    return np.asarray(zenith - 1.2 * sunwards, dtype=np.float64)
