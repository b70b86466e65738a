"""Non-stellar objects: hot pixels, planets, the Moon.

According to the LAPAN paper, section 2.2, hot pixels and planets fail the second level. A hot pixel stays on its pixel
while the sky moves; a planet or the Moon is at its place in the ephemeris; any other unidentified object is unknown.
"""

from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude
from gse.camera import Camera
from gse.instant import NS_PER_S
from gse.panorama import Panorama
from gse.site import Site
from gse.truth.solar_system import BODIES, bodies_icrs

HOT_PIXEL = "hot pixel"
UNKNOWN = "unknown"

PLANET_WITHIN_PX = 4.0
MOON_WITHIN_RAD = np.radians(1.0)
"""The disk is half a degree wide; its glow and its saturated rows are wider."""

SAME_PIXEL_PX = 0.6
HOT_FRAMES = 5
HOT_MOTION_PX = 6.0
"""An object on one pixel in so many frames, and in most of the frames in which the sky moved so far, is a hot pixel.

A star stays on a pixel while the sky moves by 1.4 pixels at most: even two that follow each other are there for less
than half of the way.
"""

MAX_REMEMBERED = 5000
MAX_HOT = 1000
LOOKED_AT_EVERY_NS = NS_PER_S
"""The sky needs many seconds to move by HOT_MOTION_PX: not every frame of a fast sensor is looked at."""

_NOWHERE = -1, np.inf, np.inf
_EPHEMERIS_NS = 600 * NS_PER_S
"""The Moon moves 5 arcmin in this time, planets half an arcmin at most: a new place for each cell of it."""


class NonStellarObjects:
    """Classifies unidentified objects, from this frame and the frames before."""

    def __init__(self, camera: Camera, site: Site, known_hot_pixels: tuple[tuple[int, int], ...] = ()) -> None:
        self._camera = camera
        self._cos_reach = np.cos(camera.diagonal_rad)
        self._hot_px = np.array(known_hot_pixels, dtype=np.float64).reshape(-1, 2)
        self._site = site
        self._sightings = _Sightings(HOT_MOTION_PX * camera.pixel_rad)
        self._looked_ns = -LOOKED_AT_EVERY_NS
        self._cell = -1
        self._bodies_icrs: NDArray[np.float64] = np.zeros((0, 3))

    def name(
        self,
        panorama: Panorama,
        directions_sensor: NDArray[np.float64],
        identified: NDArray[np.int64],
        attitude: Attitude,
        *,
        truth_known: bool,
    ) -> tuple[tuple[int, str], ...]:
        """(row, kind) of each object that is not among ``identified``, given the geometric attitude of the frame."""
        left = np.ones(len(panorama.brightness), dtype=np.bool_)
        left[identified] = False
        rest = left.nonzero()[0]
        xy_px = panorama.xy_px.take(rest, axis=0)
        if abs(panorama.utc_ns - self._looked_ns) >= LOOKED_AT_EVERY_NS:
            self._looked_ns = panorama.utc_ns
            self._look(xy_px, directions_sensor.take(rest, axis=0) @ attitude.icrs_to_sensor)
        kinds = [UNKNOWN] * len(rest)
        if len(self._hot_px):
            kinds = [HOT_PIXEL if is_hot else UNKNOWN for is_hot in self._are_hot(xy_px).tolist()]
        if truth_known:
            for body, place_px, within_px in self._bodies_px(panorama.utc_ns, attitude):
                for row in (np.hypot(*(xy_px - place_px).T) <= within_px).nonzero()[0].tolist():
                    kinds[row] = body
        return tuple(zip(rest.tolist(), kinds, strict=True))

    def _look(self, xy_px: NDArray[np.float64], icrs: NDArray[np.float64]) -> None:
        """Find more hot pixels among objects (N, 2), with the sky ``icrs`` (N, 3) behind them."""
        new = self._sightings.stay(xy_px, icrs) & ~self._are_hot(xy_px)
        self._hot_px = np.concatenate([self._hot_px, xy_px[new]])[:MAX_HOT]

    def _are_hot(self, xy_px: NDArray[np.float64]) -> NDArray[np.bool_]:
        if not len(self._hot_px):
            return np.zeros(len(xy_px), dtype=np.bool_)
        apart_px = np.abs(xy_px[:, None] - self._hot_px).max(axis=2).min(axis=1)
        return np.asarray(apart_px <= SAME_PIXEL_PX, dtype=np.bool_)

    def _bodies_px(self, utc_ns: int, attitude: Attitude) -> list[tuple[str, NDArray[np.float64], float]]:
        """Planets and Moon in the field: name, place, and the largest distance of an object."""
        if self._cell != utc_ns // _EPHEMERIS_NS:
            self._cell = utc_ns // _EPHEMERIS_NS
            self._bodies_icrs = bodies_icrs(self._site, self._cell * _EPHEMERIS_NS + _EPHEMERIS_NS // 2)
        from_boresight = self._bodies_icrs @ attitude.boresight_icrs
        near = (from_boresight > self._cos_reach).nonzero()[0]
        if not len(near):
            return []
        moon_px = float(MOON_WITHIN_RAD / self._camera.pixel_rad)
        places_px = self._camera.pixels(self._bodies_icrs[near] @ attitude.icrs_to_sensor.T)
        names = [BODIES[row] for row in near]
        return [
            (name, place, moon_px if name == "Moon" else PLANET_WITHIN_PX)
            for name, place in zip(names, places_px, strict=True)
        ]


class _Sightings:
    """Pixels on which unidentified objects were, the latest MAX_REMEMBERED of them.

    Columns, one row per pixel: ``first`` and ``count`` are the number of the first frame and how many frames had an
    object there since, ``icrs`` is what stood behind it then.
    """

    def __init__(self, motion_rad: float) -> None:
        self._motion2 = motion_rad**2
        self._frame = 0
        self._whole_pixels = True
        self._rows: OrderedDict[tuple[float, float], tuple[int, float, float]] = OrderedDict()
        self._first = np.zeros(MAX_REMEMBERED, dtype=np.int64)
        self._count = np.zeros(MAX_REMEMBERED, dtype=np.int64)
        self._icrs = np.zeros((MAX_REMEMBERED, 3))

    def stay(self, xy_px: NDArray[np.float64], icrs: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Add a frame: which objects (N, 2), with the sky ``icrs`` (N, 3) behind them, have stayed on their pixel."""
        self._frame += 1
        rows = np.array([self._row(place) for place in map(tuple, xy_px.tolist())], dtype=np.int64)
        self._count[rows] += 1
        frames = self._frame - self._first[rows] + 1
        moved = ((icrs - self._icrs[rows]) ** 2).sum(axis=1) > self._motion2
        steady = 2 * self._count[rows] > frames
        anew = rows[~steady]
        self._first[anew], self._count[anew], self._icrs[anew] = self._frame, 1, icrs[~steady]
        stayed: NDArray[np.bool_] = moved & steady & (self._count[rows] >= HOT_FRAMES)
        return stayed

    def _row(self, place_px: tuple[float, float]) -> int:
        """The row of a pixel, which a sub-pixel position may round to a neighbour of."""
        key = place_px  # a whole pixel is its own key
        if key not in self._rows:
            x_px, y_px = place_px
            column, line = round(x_px), round(y_px)
            self._whole_pixels &= column == x_px and line == y_px
            steps = () if self._whole_pixels else (0, -1, 1)
            near = ((column + i, line + j) for i in steps for j in steps)
            found = next((key for key in near if self._is_at(key, x_px, y_px)), None)
            key = found or self._begun(column, line, x_px, y_px)
        self._rows.move_to_end(key)
        return self._rows[key][0]

    def _is_at(self, key: tuple[int, int], x_px: float, y_px: float) -> bool:
        _, x, y = self._rows.get(key, _NOWHERE)
        return abs(x - x_px) <= SAME_PIXEL_PX and abs(y - y_px) <= SAME_PIXEL_PX

    def _begun(self, column: int, line: int, x_px: float, y_px: float) -> tuple[int, int]:
        """The key of a new pixel, which replaces the one seen longest ago."""
        if (column, line) in self._rows:
            row = self._rows[column, line][0]
        elif len(self._rows) < MAX_REMEMBERED:
            row = len(self._rows)
        else:
            row = self._rows.popitem(last=False)[1][0]
        self._rows[column, line] = row, x_px, y_px
        self._count[row], self._first[row] = 0, -self._frame
        return column, line
