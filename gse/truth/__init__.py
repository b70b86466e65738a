"""Sidereal truth: where the sensor on its mount really looked, by ERFA and the IERS tables on disk.

May not import identifier, station or the simulator: truth knows the time and the site, never an answer.
"""

from gse.truth.alignment import Alignment, fit_mount, small_rotations, time_blocks
from gse.truth.frames import horizon_to_sensor, mount_of
from gse.truth.orientation import EarthOrientation, Orientation
from gse.truth.refraction import Refraction
from gse.truth.sidereal import CORRECTIONS, InertialTruth, SiderealTruth, truth_of

__all__ = [
    "CORRECTIONS",
    "Alignment",
    "EarthOrientation",
    "InertialTruth",
    "Orientation",
    "Refraction",
    "SiderealTruth",
    "fit_mount",
    "horizon_to_sensor",
    "mount_of",
    "small_rotations",
    "time_blocks",
    "truth_of",
]
