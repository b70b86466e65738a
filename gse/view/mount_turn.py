"""How far a mount must be turned, from where the sensor looks to where the station file says."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.mount import Mount
from gse.station.results import FrameResult
from gse.truth import horizon_to_sensor

NEAR_ZENITH_DEG = 80.0
"""Higher up a mount is tilted to east and north: there azimuth means little."""

_WINDS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


@dataclass(frozen=True, slots=True)
class MountTurn:
    """The turn that brings the boresight to the stated direction, as seen by one who looks along the sensor.

    ``across_deg`` is along the horizon and ``up_deg`` at right angles to it; ``across`` and ``up`` name the directions
    of positive values: right (towards a wind) and up, or east and north near the zenith. ``roll_deg`` is clockwise.
    """

    across_deg: float
    up_deg: float
    roll_deg: float
    across: str
    up: str

    def __str__(self) -> str:
        opposite = {"up": "down", "north": "south", "east": "west"}
        up = self.up if self.up_deg >= 0 else opposite[self.up]
        across = self.across
        if self.across_deg < 0:
            across = opposite.get(across) or f"left (to the {_opposite_wind(across)})"
        roll = "clockwise" if self.roll_deg >= 0 else "counter-clockwise"
        return (
            f"{_degrees(self.across_deg)} {across}, {_degrees(self.up_deg)} {up}; "
            f"then roll {_degrees(self.roll_deg)} {roll}"
        )


def mount_turn(result: FrameResult, used: Mount, stated: Mount) -> MountTurn | None:
    """The turn to the ``stated`` mount by a result that was compared with the mount ``used``; None without truth."""
    if result.attitude_geometric is None or result.attitude_true is None:
        return None
    icrs_to_horizon = horizon_to_sensor(used).T @ result.attitude_true.icrs_to_sensor
    measured = result.attitude_geometric.icrs_to_sensor @ icrs_to_horizon.T
    wanted = horizon_to_sensor(stated)
    here, there = measured[2], wanted[2]
    across, up, across_name, up_name = _axes(here)
    angle_deg = math.degrees(math.atan2(float(np.linalg.norm(np.cross(here, there))), float(here @ there)))
    x, y = float(there @ across), float(there @ up)
    scale = angle_deg / math.hypot(x, y) if math.hypot(x, y) else 0.0
    return MountTurn(x * scale, y * scale, _roll_deg(measured, wanted), across_name, up_name)


def _axes(boresight: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], str, str]:
    """Two directions across a boresight in the horizon frame (x east, y north, z up), and their names."""
    east, north, up = boresight.tolist()
    level = math.hypot(east, north)
    if math.degrees(math.atan2(up, level)) > NEAR_ZENITH_DEG:
        northwards = np.array([0.0, 1.0, 0.0]) - north * boresight
        northwards /= np.linalg.norm(northwards)
        return np.cross(northwards, boresight), northwards, "east", "north"
    right = np.array([north, -east, 0.0]) / (level or 1.0)
    azimuth_right_deg = math.degrees(math.atan2(right[0], right[1]))
    wind = _WINDS[round(azimuth_right_deg / 45) % 8]
    return right, np.cross(right, boresight), f"right (to the {wind})", "up"


def _roll_deg(measured: NDArray[np.float64], wanted: NDArray[np.float64]) -> float:
    """The turn about the boresight, clockwise for one who looks along it: from columns towards rows."""
    change = wanted @ measured.T
    return math.degrees(math.atan2(change[0, 1] - change[1, 0], change[0, 0] + change[1, 1]))


def _opposite_wind(across: str) -> str:
    wind = across.partition("to the ")[2].rstrip(")")
    return _WINDS[(_WINDS.index(wind) + 4) % 8]


def _degrees(value: float) -> str:
    """Three significant digits; arcseconds would be no help to a hand."""
    size = abs(value)
    return f"{size:.3f} deg" if size < 1 else f"{size:.2f} deg" if size < 10 else f"{size:.1f} deg"
