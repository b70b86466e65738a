"""Non-stellar objects: hot pixels, planets, the Moon.

According to the LAPAN paper, section 2.2, hot pixels and planets fail the second level. A hot pixel stays on its pixel
while the sky moves; a planet or the Moon is at its place in the ephemeris; any other unidentified object is unknown.
"""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.identifier import Answers
from gse.station.shown_stars import rows_of
from gse.truth.solar_system import BODIES, bodies_icrs
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S
from gse.values.matrices import product
from gse.values.panorama import Panoramas, Parts
from gse.values.site import Site

HOT_PIXEL = "hot pixel"
UNKNOWN = "unknown"
KINDS = (UNKNOWN, HOT_PIXEL, *BODIES)

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


@dataclass(frozen=True, slots=True, eq=False)
class Others:
    """Objects without a star as columns: rows (M,) within their panoramas, in parts; kinds (M,) are places in KINDS."""

    parts: Parts
    objects: NDArray[np.int64]
    kinds: NDArray[np.uint8]

    @classmethod
    def none(cls, count: int) -> Self:
        """So many panoramas in which nothing was looked for."""
        return cls(Parts(np.zeros(count + 1, dtype=np.int64)), np.zeros(0, np.int64), np.zeros(0, np.uint8))

    def part(self, begin: int, end: int) -> Self:
        """The objects of the panoramas from ``begin`` to before ``end``."""
        parts, rows = self.parts.part(begin, end)
        return type(self)(parts, self.objects[rows], self.kinds[rows])

    def __getitem__(self, k: int) -> tuple[tuple[int, str], ...]:
        rows = self.parts.rows(k)
        kinds = [KINDS[kind] for kind in self.kinds[rows].tolist()]
        return tuple(zip(self.objects[rows].tolist(), kinds, strict=True))

    def count(self, kind: str, among: NDArray[np.bool_] | bool = True) -> NDArray[np.int64]:
        """How many objects of a kind, ``among`` those (M,), each panorama (K,) has."""
        wanted = (self.kinds == KINDS.index(kind)) & among
        return np.bincount(self.parts.of_row[wanted], minlength=len(self.parts))


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
        panoramas: Panoramas,
        directions_sensor: NDArray[np.float64],
        answers: Answers,
        icrs_to_sensor: NDArray[np.float64],
        *,
        truth_known: bool,
    ) -> Others:
        """The objects that the answers leave, given the geometric attitudes (K, 3, 3); none where there is no answer.

        Panoramas must come in their order.
        """
        left = np.repeat(answers.named, panoramas.parts.counts)
        left[rows_of(panoramas.parts, answers)] = False
        rows = np.flatnonzero(left)
        frame_of = panoramas.parts.of_row.take(rows)
        xy_px, kinds = panoramas.xy_px.take(rows, axis=0), np.zeros(len(rows), dtype=np.uint8)
        parts = Parts.of_counts(np.bincount(frame_of, minlength=len(panoramas)))
        named = np.flatnonzero(answers.named)
        utc_ns, begin = panoramas.utc_ns.take(named), 0
        for k in named[self._looks(utc_ns.tolist())].tolist():
            here = parts.rows(k)
            kinds[begin : here.start] = self._are_hot(xy_px[begin : here.start])
            self._look(xy_px[here], product(directions_sensor.take(rows[here], axis=0), icrs_to_sensor[k]))
            begin = here.start
        kinds[begin:] = self._are_hot(xy_px[begin:])
        if truth_known:
            for k, body, place_px, within_px in self._bodies_px(named, utc_ns, icrs_to_sensor):
                here = parts.rows(k)
                kinds[here][np.hypot(*(xy_px[here] - place_px).T) <= within_px] = KINDS.index(body)
        return Others(parts, rows - panoramas.parts.first.take(frame_of), kinds)

    def _looks(self, utc_ns: Sequence[int]) -> list[int]:
        """The places of the panoramas, of those at these instants, at which hot pixels are looked for."""
        looks = []
        for place, at_ns in enumerate(utc_ns):
            if abs(at_ns - self._looked_ns) >= LOOKED_AT_EVERY_NS:
                self._looked_ns = at_ns
                looks.append(place)
        return looks

    def _look(self, xy_px: NDArray[np.float64], icrs: NDArray[np.float64]) -> None:
        """Find more hot pixels among objects (N, 2), with the sky ``icrs`` (N, 3) behind them."""
        stay = self._sightings.stay(xy_px, icrs)
        if stay.any():
            self._hot_px = np.concatenate([self._hot_px, xy_px[stay & ~self._are_hot(xy_px)]])[:MAX_HOT]

    def _are_hot(self, xy_px: NDArray[np.float64]) -> NDArray[np.bool_]:
        if not len(self._hot_px):
            return np.zeros(len(xy_px), dtype=np.bool_)
        apart_px = np.abs(xy_px[:, None] - self._hot_px).max(axis=2).min(axis=1)
        return np.asarray(apart_px <= SAME_PIXEL_PX, dtype=np.bool_)

    def _bodies_px(
        self, frames: NDArray[np.int64], utc_ns: NDArray[np.int64], icrs_to_sensor: NDArray[np.float64]
    ) -> Iterator[tuple[int, str, NDArray[np.float64], float]]:
        """Planets and Moon in the fields: panorama, name, place, and the largest distance of an object."""
        cells = utc_ns // _EPHEMERIS_NS
        moon_px = float(MOON_WITHIN_RAD / self._camera.pixel_rad)
        for cell in dict.fromkeys(cells.tolist()):
            of_cell, bodies_icrs = frames[cells == cell], self._bodies_of(cell)
            from_boresight = (bodies_icrs * icrs_to_sensor[of_cell, None, 2]).sum(axis=2)
            for k, body in zip(*(from_boresight > self._cos_reach).nonzero(), strict=True):
                rotation, name = icrs_to_sensor[of_cell[k]], BODIES[body]
                (place_px,) = self._camera.pixels(product(bodies_icrs[body, None], rotation.T))
                yield int(of_cell[k]), name, place_px, moon_px if name == "Moon" else PLANET_WITHIN_PX

    def _bodies_of(self, cell: int) -> NDArray[np.float64]:
        """Unit vectors (7, 3) to BODIES in the middle of a cell."""
        if self._cell != cell:
            self._cell = cell
            self._bodies_icrs = bodies_icrs(self._site, cell * _EPHEMERIS_NS + _EPHEMERIS_NS // 2)
        return self._bodies_icrs


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
        key, held = place_px, self._rows.get(place_px)  # a whole pixel is its own key
        if held is None:
            x_px, y_px = place_px
            column, line = round(x_px), round(y_px)
            self._whole_pixels &= column == x_px and line == y_px
            found = None if self._whole_pixels else self._found(column, line, x_px, y_px)
            key = found or self._begun(column, line, x_px, y_px)
            held = self._rows[key]
        self._rows.move_to_end(key)
        return held[0]

    def _found(self, column: int, line: int, x_px: float, y_px: float) -> tuple[int, int] | None:
        """The key of a pixel that an object at a sub-pixel position is on; None where it is new."""
        near = ((column + i, line + j) for i in (0, -1, 1) for j in (0, -1, 1))
        return next((key for key in near if self._is_at(key, x_px, y_px)), None)

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
