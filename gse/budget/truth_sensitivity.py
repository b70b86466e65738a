"""The truth of one instant, and by how much a reported error changes when an input of it is another.

Sensitivities of the truth uncertainty budget are finite differences of these.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude
from gse.constants import ARCSEC_PER_RAD, ARCSEC_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.matrices import length, product
from gse.mount import Mount
from gse.site import Site
from gse.station.attitude_error import attitude_error
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor

Vector = tuple[float, float, float]
"""dRA*, dDE and roll in arcsec."""


LARGEST_STEP_ARCSEC = 60.0
"""Of a finite difference: the sky is flat enough within it."""


class ChangedTruth:
    """The truth of a site and mount at an instant, and what changed inputs make of it."""

    def __init__(self, site: Site, mount: Mount, orientation: EarthOrientation, utc_ns: int) -> None:
        self._site, self._mount, self._utc_ns, self._orientation = site, mount, utc_ns, orientation
        self._truth = SiderealTruth(site, orientation)
        self._attitude = self._truth.attitude_true(utc_ns, mount)
        self._zenith_rad = math.radians(90 - mount.altitude_deg)
        self.de_rad = math.radians(self._attitude.de_deg)
        self.refraction_arcsec = self._bend_arcsec(self._truth)

    def _bend_arcsec(self, truth: SiderealTruth) -> float:
        return truth.refraction.bend_rad(self._zenith_rad) * ARCSEC_PER_RAD

    def changed(
        self, *, site: Site | None = None, mount: Mount | None = None, orientation: EarthOrientation | None = None
    ) -> Vector:
        """By how much the reported error changes with another site, mount or Earth orientation.

        Other air moves the measured stars along the vertical; all else moves the truth.
        """
        truth = SiderealTruth(site or self._site, orientation or self._orientation)
        lower_deg = (self._bend_arcsec(truth) - self.refraction_arcsec) / 3600
        seen = replace(self._mount, altitude_deg=self._mount.altitude_deg - lower_deg)
        measured = self._truth.attitude_true(self._utc_ns, seen)
        return _error(measured, truth.attitude_true(self._utc_ns, mount or self._mount))

    def tilted(self, azimuth_deg: float, arcsec: float) -> Vector:
        """By how much the error changes where mount or vertical is tilted about a level direction."""
        azimuth = math.radians(azimuth_deg)
        about = np.array([math.sin(azimuth), math.cos(azimuth), 0.0])
        turn = erfa.rv2m(-about * arcsec * ARCSEC_RAD)  # ERFA's turns the axes, not what they see
        rotation = product(horizon_to_sensor(self._mount), turn, self._truth.icrs_to_horizon(self._utc_ns))
        return _error(self._attitude, Attitude(rotation, np.zeros((3, 3))))

    def turned(self, rotation_arcsec: NDArray[np.float64]) -> Vector:
        """By how much the error changes where the mount is turned by a small rotation vector in the sensor frame."""
        turn = erfa.rv2m(-rotation_arcsec * ARCSEC_RAD)
        return _error(self._attitude, Attitude(product(turn, self._attitude.icrs_to_sensor), np.zeros((3, 3))))

    def without(self, correction: str) -> float:
        """The size of a correction of the frame, in arcsec, found by leaving it out."""
        bare = SiderealTruth(self._site, self._orientation, {correction})
        return math.hypot(*_error(bare.attitude_true(self._utc_ns, self._mount), self._attitude)[:2])

    def star_without(self, correction: str) -> float:
        """The size of a correction of the stars, in arcsec, at the boresight."""
        star = self._attitude.boresight_icrs[None]
        bare = SiderealTruth(self._site, self._orientation, {correction}).apparent(star, self._utc_ns)
        return length(bare - self._truth.apparent(star, self._utc_ns)) * ARCSEC_PER_RAD

    def about_the_pole(self, seconds: float) -> Vector:
        """By how much the error changes with time: the sky turns about the pole."""
        turn = EARTH_RATE_ARCSEC_PER_S * seconds
        cos_de, sin_de = max(math.cos(self.de_rad), 0.0), abs(math.sin(self.de_rad))
        return (turn * cos_de if cos_de else 0.0), 0.0, (turn * sin_de if sin_de else 0.0)


def _error(measured: Attitude, true: Attitude) -> Vector:
    error = attitude_error(measured, true)
    return error.d_ra_cosde_arcsec, error.d_de_arcsec, error.d_roll_arcsec


def together(vectors: list[Vector]) -> Vector:
    """Independent contributions on each axis."""
    ra, de, roll = (math.hypot(*(vector[axis] for vector in vectors)) for axis in range(3))
    return ra, de, roll


def scaled(change: Callable[[float], Vector], standard: float, largest_step: float) -> Vector:
    """The contribution of a standard uncertainty: the finite difference of a step that is not larger than that."""
    step = min(standard, largest_step)
    if step == 0:
        return 0.0, 0.0, 0.0
    ra, de, roll = (abs(value) * standard / step for value in change(step))
    return ra, de, roll


def absolute(vector: Vector) -> Vector:
    """Without signs."""
    return abs(vector[0]), abs(vector[1]), abs(vector[2])
