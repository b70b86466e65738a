"""The screen before a sensor: a monitor that shows stars, mostly behind a collimating lens, and what it shows when.

What is shown is an attitude from an instant on, which may turn, until the next one.
"""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated, Self

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from gse.values.attitude_convention import from_angles
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S
from gse.values.matrices import length, product
from gse.values.mount import InertialUncertainty
from gse.values.text import percent

_PLACES = 64
"""Along each side of a sensor, at which the screen is looked for."""
_ABOUT_TEN_ARCSEC = InertialUncertainty()
_Distortion = Annotated[float, Interval(ge=-1, le=1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreenToSensor:
    """Where the sensor looks on the screen: so far right of its middle and below it, rolled to the left by so much.

    ``uncertainty`` are half-widths of 95 %. Where ``fitted`` the three angles come from the sensor's own answers, and a
    verdict is relative to them.
    """

    x_deg: Annotated[float, Interval(ge=-80, le=80)] = 0.0
    y_deg: Annotated[float, Interval(ge=-80, le=80)] = 0.0
    roll_deg: Annotated[float, Interval(ge=-360, le=360)] = 0.0
    uncertainty: InertialUncertainty = _ABOUT_TEN_ARCSEC
    fitted: bool = False

    def rotation(self) -> NDArray[np.float64]:
        """The rotation (3, 3) from the axes of the screen (right, down, into it) to the sensor's."""
        out = np.array([math.tan(math.radians(self.x_deg)), math.tan(math.radians(self.y_deg)), 1.0])
        out /= length(out)
        right = np.array([math.cos(math.radians(self.x_deg)), 0.0, -math.sin(math.radians(self.x_deg))])
        down = np.cross(out, right)
        cosine, sine = math.cos(math.radians(self.roll_deg)), math.sin(math.radians(self.roll_deg))
        return np.array([cosine * right - sine * down, sine * right + cosine * down, out])

    @classmethod
    def from_rotation(cls, screen_to_sensor: NDArray[np.float64], uncertainty: InertialUncertainty) -> Self:
        """The angles of a fitted rotation (3, 3)."""
        right_sensor, _, (x, y, z) = np.asarray(screen_to_sensor).tolist()
        upright = cls(x_deg=math.degrees(math.atan2(x, z)), y_deg=math.degrees(math.atan2(y, z)))
        right, down, _ = upright.rotation()
        roll = math.atan2(-product(down, right_sensor), product(right, right_sensor))
        return cls(
            x_deg=round(upright.x_deg, 7),
            y_deg=round(upright.y_deg, 7),
            roll_deg=round(math.degrees(roll), 7),
            uncertainty=uncertainty,
            fitted=True,
        )


_STRAIGHT_AHEAD = ScreenToSensor()


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreenUncertainty:
    """How well a screen is known: half-widths of 95 %, 0 of what was not fitted.

    ``away_mm`` is of the focal length of its lens, or of its distance.
    """

    away_mm: Annotated[float, Interval(ge=0, le=1000)] = 0.0
    radial_distortion: tuple[Annotated[float, Interval(ge=0, le=1)], Annotated[float, Interval(ge=0, le=1)]] = (0, 0)
    gamma: Annotated[float, Interval(ge=0, le=5)] = 0.0


_NOT_FITTED = ScreenUncertainty()


@dataclass(frozen=True, slots=True, kw_only=True)
class Screen:
    """Geometry and light of a screen, in its own pixels; ValueError where it is none.

    One of ``focal_length_mm`` (of the collimator) and ``distance_mm`` (without one) says how far away its picture
    stands. ``gamma`` is the exponent of its brightness law, ``spot_px`` the standard deviation of a star's spot, and
    ``magnitude_limit`` the faintest star that is drawn; ``brightest_magnitude`` fills the panel's range.
    """

    pixel_pitch_mm: Annotated[float, Interval(ge=0.001, le=10)]
    columns: Annotated[int, Interval(ge=64, le=16384)]
    rows: Annotated[int, Interval(ge=64, le=16384)]
    focal_length_mm: Annotated[float, Interval(ge=1, le=100_000)] | None = None
    distance_mm: Annotated[float, Interval(ge=1, le=100_000)] | None = None
    radial_distortion: tuple[_Distortion, _Distortion] = (0.0, 0.0)
    tangential_distortion: tuple[_Distortion, _Distortion] = (0.0, 0.0)
    gamma: Annotated[float, Interval(ge=0.5, le=5)] = 2.2
    spot_px: Annotated[float, Interval(ge=0.4, le=10)] = 1.2
    magnitude_limit: Annotated[float, Interval(ge=-2, le=10)] = 6.0
    brightest_magnitude: Annotated[float, Interval(ge=-5, le=9)] = 1.5
    refresh_hz: Annotated[float, Interval(ge=10, le=500)] = 60.0
    latency_ms: Annotated[float, Interval(ge=0, le=1000)] = 0.0
    """From the instant at which the browser draws to the light of the panel; what ``gse align`` measures."""
    latency_uncertainty_ms: Annotated[float, Interval(ge=0, le=1000)] = 20.0
    to_sensor: ScreenToSensor = _STRAIGHT_AHEAD
    uncertainty: ScreenUncertainty = _NOT_FITTED

    def __post_init__(self) -> None:
        if (self.focal_length_mm is None) == (self.distance_mm is None):
            raise ValueError(
                "expected one of focal_length_mm (of the lens before the screen) and distance_mm (without a lens)"
            )
        if self.brightest_magnitude >= self.magnitude_limit:
            raise ValueError(
                f"brightest_magnitude is {self.brightest_magnitude:g} and magnitude_limit {self.magnitude_limit:g}; "
                "expected the brightest star to have the smaller magnitude"
            )

    def camera(self) -> Camera:
        """The screen as a camera sees it from the sensor's place: directions to its pixels and back."""
        away_mm = self.focal_length_mm if self.focal_length_mm is not None else self.distance_mm
        assert away_mm is not None
        centre = ((self.columns - 1) / 2, (self.rows - 1) / 2)
        return Camera(
            self.rows,
            self.columns,
            away_mm / self.pixel_pitch_mm,
            centre,
            self.radial_distortion,
            False,
            self.tangential_distortion,
        )

    def covers(self, sensor: Camera) -> float:
        """The share of a sensor's field behind which the screen stands."""
        middles = (np.arange(_PLACES) + 0.5) / _PLACES
        x, y = np.meshgrid(middles * sensor.columns - 0.5, middles * sensor.rows - 0.5)
        directions = sensor.directions(np.column_stack([x.ravel(), y.ravel()]))
        camera = self.camera()
        return float(camera.contains(camera.pixels(product(directions, self.to_sensor.rotation()))).mean())

    def gap_beside(self, sensor: Camera) -> str:
        """That it does not cover the field of a sensor, and what to do; empty where it does."""
        share = self.covers(sensor)
        if share == 1:
            return ""
        missing = "stars are missing at its edge" if share else "the sensor sees no star"
        return (
            f"the screen covers {percent(share, 0)} of the sensor's field, so that {missing}: take a larger panel, a "
            "shorter lens or distance, or check screen.to_sensor"
        )

    def of_size(self, factor: float) -> str:
        """That the picture is larger by a factor than stated, in words of what may have been stated wrongly."""
        away = "focal_length_mm" if self.focal_length_mm is not None else "distance_mm"
        away_mm = self.focal_length_mm or self.distance_mm or math.nan
        larger = f"about {percent(abs(factor - 1), 2)} {'larger' if factor > 1 else 'smaller'}"
        return (
            f"the picture on the screen is {larger} than stated: screen.pixel_pitch_mm is "
            f"{self.pixel_pitch_mm * factor:.4g} instead of {self.pixel_pitch_mm:g}, or screen.{away} is "
            f"{away_mm / factor:.4g} instead of {away_mm:g}"
        )


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
