"""How far a mount must be turned, from where the sensor looks to where the station file says."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.matrices import length, product
from gse.mount import Mount
from gse.station.frame_results import FrameResult
from gse.truth import horizon_to_sensor

NEAR_ZENITH_DEG = 80.0
"""Higher up a mount is tilted to east and north: there azimuth means little."""

_WINDS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn in one direction; ``positive`` and ``negative`` name the directions of its two signs."""

    angle_deg: float
    positive: str
    negative: str

    def __str__(self) -> str:
        return f"{_degrees(self.angle_deg)} {self.positive if self.angle_deg >= 0 else self.negative}"


@dataclass(frozen=True, slots=True)
class MountTurn:
    """The turn that brings the boresight to the stated direction, seen in the viewing direction of the sensor.

    ``across`` is along the horizon, to the right where positive, and ``up`` at right angles to it; near the zenith they
    are to the east and to the north. ``roll`` is clockwise where positive.
    """

    across: Turn
    up: Turn
    roll: Turn

    def __str__(self) -> str:
        return f"{self.across}, {self.up}; then roll {self.roll}"

    def document(self) -> dict[str, float | str]:
        """Angles, directions of the positive ones and the text, for the glance page."""
        turns = (("across_deg", self.across), ("up_deg", self.up), ("roll_deg", self.roll))
        degrees = {name: round(one.angle_deg, 4) for name, one in turns}
        return {**degrees, "across": self.across.positive, "up": self.up.positive, "text": str(self)}


def mount_turn(result: FrameResult, used: Mount, stated: Mount) -> MountTurn | None:
    """The turn to the ``stated`` mount by a result that was compared with the mount ``used``; None without truth."""
    if result.attitude_geometric is None or result.attitude_true is None:
        return None
    icrs_to_horizon = product(horizon_to_sensor(used).T, result.attitude_true.icrs_to_sensor)
    measured = product(result.attitude_geometric.icrs_to_sensor, icrs_to_horizon.T)
    wanted = horizon_to_sensor(stated)
    here, there = measured[2], wanted[2]
    across, up, across_names, up_names = _axes(here)
    angle_deg = math.degrees(math.atan2(length(np.cross(here, there)), float(product(here, there))))
    x, y = float(product(there, across)), float(product(there, up))
    scale = angle_deg / math.hypot(x, y) if math.hypot(x, y) else 0.0
    roll = Turn(_roll_deg(measured, wanted), "clockwise", "counter-clockwise")
    return MountTurn(Turn(x * scale, *across_names), Turn(y * scale, *up_names), roll)


_Direction = NDArray[np.float64]
_Names = tuple[str, str]


def _axes(boresight: _Direction) -> tuple[_Direction, _Direction, _Names, _Names]:
    """Two directions across a boresight in the horizon frame (x east, y north, z up), and the names of their signs."""
    east, north, up = boresight.tolist()
    level = math.hypot(east, north)
    if math.degrees(math.atan2(up, level)) > NEAR_ZENITH_DEG:
        northwards = np.array([0.0, 1.0, 0.0]) - north * boresight
        northwards /= length(northwards)
        return np.cross(northwards, boresight), northwards, ("east", "west"), ("north", "south")
    right = np.array([north, -east, 0.0]) / (level or 1.0)
    wind = round(math.degrees(math.atan2(right[0], right[1])) / 45)
    names = (f"right (to the {_WINDS[wind % 8]})", f"left (to the {_WINDS[(wind + 4) % 8]})")
    return right, np.cross(right, boresight), names, ("up", "down")


def _roll_deg(measured: NDArray[np.float64], wanted: NDArray[np.float64]) -> float:
    """The turn about the boresight, clockwise for one who looks along it: from columns towards rows."""
    change = product(wanted, measured.T)
    return math.degrees(math.atan2(change[0, 1] - change[1, 0], change[0, 0] + change[1, 1]))


def _degrees(value: float) -> str:
    """Three significant digits; arcseconds would be no help to a hand."""
    size = abs(value)
    return f"{size:.3f} deg" if size < 1 else f"{size:.2f} deg" if size < 10 else f"{size:.1f} deg"
