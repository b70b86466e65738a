"""What a screen shows over time: an attitude from an instant on, which may turn, until the next one."""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.values.attitude_convention import from_angles
from gse.values.instant import NS_PER_S
from gse.values.matrices import product

_MOST = 1e6
"""Degrees, degrees per second or milliseconds: whatever is larger comes from a damaged file."""


@dataclass(frozen=True, slots=True)
class Shown:
    """One attitude on the screen: ICRS angles of its middle at ``from_ns``, and how it turns from there.

    ``turn_deg_per_s`` is the rate about the sensor's own axes (right, down, out) at which it would turn among the
    stars. ``within_ms`` is how well the instant of the change is known, 95 %.
    """

    from_ns: int
    ra_deg: float
    de_deg: float
    roll_deg: float
    turn_deg_per_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    within_ms: float = 0.0

    def __post_init__(self) -> None:
        numbers = (self.ra_deg, self.de_deg, self.roll_deg, *self.turn_deg_per_s, self.within_ms)
        if not all(abs(number) <= _MOST for number in numbers):
            raise ValueError(f"{numbers} is no attitude on a screen")

    def __str__(self) -> str:
        """Where it looks, and how fast it turns."""
        turns = f" turning at {self.rate_deg_per_s:.3g} deg/s" if self.rate_deg_per_s else ""
        return f"RA {self.ra_deg:.2f} DE {self.de_deg:.2f} deg{turns}"

    @property
    def rate_deg_per_s(self) -> float:
        """How fast it turns; rounded, since a rate about an oblique axis is not exact."""
        return round(math.hypot(*self.turn_deg_per_s), 6)


@dataclass(slots=True)
class ShownSky:
    """All that a screen showed in a session, in the order of time, and how the screen stands before the sensor.

    Before its first instant the first is shown. ``screen_to_sensor`` is the rotation (3, 3) from the axes of the screen
    (right, down, into it) to the sensor's.
    """

    shown: list[Shown] = field(default_factory=list)
    screen_to_sensor: NDArray[np.float64] = field(default_factory=lambda: np.eye(3), compare=False)

    def add(self, shown: Shown) -> None:
        """Take what is shown next; one that begins before the one at hand takes its place in time."""
        self.shown.insert(bisect_right([item.from_ns for item in self.shown], shown.from_ns), shown)

    def only(self, is_wanted: Callable[[Shown], bool]) -> Self:
        """The same sky with some of what was shown."""
        return replace(self, shown=[item for item in self.shown if is_wanted(item)])

    def index_at(self, utc_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Which of ``shown`` stands on the screen at instants (M,)."""
        begins = np.array([item.from_ns for item in self.shown], dtype=np.int64)
        return np.maximum(np.searchsorted(begins, utc_ns, side="right") - 1, 0)

    def is_settled(self, utc_ns: int, exposure_s: float) -> bool:
        """Whether one attitude stood on the screen over an exposure about an instant."""
        half_ns = round(exposure_s * NS_PER_S / 2)
        around = all(abs(utc_ns - item.from_ns) > half_ns + round(item.within_ms * 1e6) for item in self.shown)
        return around and bool(self.shown) and utc_ns > self.shown[0].from_ns

    def icrs_to_sensor_at(
        self, utc_ns: NDArray[np.int64], index: NDArray[np.int64] | None = None
    ) -> NDArray[np.float64]:
        """The rotations (M, 3, 3) from ICRS to the sensor at instants (M,), by the ``index`` of what was shown then."""
        index = self.index_at(utc_ns) if index is None else index
        angles = np.array([(item.ra_deg, item.de_deg, item.roll_deg) for item in self.shown])
        first = from_angles(*angles.T)
        turns_rad = np.radians([item.turn_deg_per_s for item in self.shown])
        begins = np.array([item.from_ns for item in self.shown], dtype=np.int64)
        turned = turned_by(turns_rad[index] * ((utc_ns - begins[index]) / NS_PER_S)[:, None])
        return np.asarray(product(self.screen_to_sensor[None], product(turned, first[index])))


def turned_by(rotvecs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from a frame to the same frame after it turned by vectors (M, 3), in rad: Rodrigues' formula.

    The stars go the other way, so each is the inverse of the rotation of its vector.
    """
    angle = np.sqrt((rotvecs**2).sum(axis=1))
    axis = rotvecs / np.where(angle > 0, angle, 1.0)[:, None]
    x, y, z = axis.T
    zero = np.zeros(len(axis))
    cross = np.stack(
        [np.stack([zero, -z, y], axis=1), np.stack([z, zero, -x], axis=1), np.stack([-y, x, zero], axis=1)], axis=1
    )
    sine, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) - sine * cross + versine * product(cross, cross))
