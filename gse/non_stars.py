"""Objects that are no stars: hot pixels, planets, the Moon.

[S] section 2.2 names hot pixels and planets as what fails the second level. A hot pixel stays on its pixel while the
sky moves; a planet or the Moon stands where the ephemeris has it; any other unidentified object is unknown.
"""

from dataclasses import dataclass

import numpy as np
from astropy import units
from astropy.coordinates import EarthLocation, get_body
from astropy.time import Time
from astropy.utils import iers
from numpy.typing import NDArray

from gse.attitude import Attitude
from gse.camera import Camera
from gse.config import Site
from gse.instant import NS_PER_S, to_julian_date
from gse.panorama import Panorama

HOT_PIXEL = "hot pixel"
UNKNOWN = "unknown"

PLANETS = ("Mercury", "Venus", "Mars", "Jupiter", "Saturn", "Uranus")
"""Those that a star sensor sees."""

PLANET_WITHIN_PX = 4.0
MOON_WITHIN_RAD = np.radians(1.0)
"""The disk is half a degree wide; its glow and its saturated rows are wider."""

SAME_PIXEL_PX = 0.6
HOT_FRAMES = 5
HOT_MOTION_PX = 4.0
"""An object that stayed on its pixel in so many frames, while a star there moved so far, is a hot pixel."""

FORGET_NS = 60 * NS_PER_S
MAX_REMEMBERED = 5000
_EPHEMERIS_NS = 600 * NS_PER_S
"""The Moon moves 5 arcmin in this time, planets half an arcmin at most: a new place for each cell of it."""


@dataclass(slots=True)
class _Sighting:
    """An unidentified object that may turn out to stay on its pixel."""

    x_px: float
    y_px: float
    attitude: Attitude
    frames: int
    last_ns: int
    hot: bool = False


class NonStars:
    """Names the objects that no star stands for; it remembers the frames before."""

    def __init__(self, camera: Camera, site: Site, known_hot_pixels: tuple[tuple[int, int], ...] = ()) -> None:
        self._camera = camera
        self._known = np.array(known_hot_pixels, dtype=np.float64).reshape(-1, 2)
        self._site = EarthLocation.from_geodetic(
            site.longitude_deg * units.deg, site.latitude_deg * units.deg, site.height_m * units.m
        )
        self._sightings: dict[tuple[int, int], _Sighting] = {}
        self._forgotten_ns = 0
        self._cell = -1
        self._bodies: NDArray[np.float64] = np.zeros((0, 3))

    def name(
        self, panorama: Panorama, identified: NDArray[np.int64], attitude: Attitude, *, truth_known: bool
    ) -> tuple[tuple[int, str], ...]:
        """(row, kind) of each object that is not among ``identified``, given the geometric attitude of the frame."""
        rest = np.setdiff1d(np.arange(len(panorama.index)), identified)
        if not len(rest):
            return ()
        self._forget(panorama.utc_ns)
        bodies = self._bodies_px(panorama.utc_ns, attitude) if truth_known else {}
        return tuple((int(row), self._kind(panorama, int(row), attitude, bodies)) for row in rest)

    def _kind(
        self, panorama: Panorama, row: int, attitude: Attitude, bodies: dict[str, tuple[NDArray[np.float64], float]]
    ) -> str:
        xy_px = panorama.xy_px[row]
        if len(self._known) and np.abs(self._known - xy_px).max(axis=1).min() <= SAME_PIXEL_PX:
            return HOT_PIXEL
        for body, (place_px, within_px) in bodies.items():
            if np.hypot(*(place_px - xy_px)) <= within_px:
                return body
        return HOT_PIXEL if self._stays(panorama, xy_px, attitude) else UNKNOWN

    def _stays(self, panorama: Panorama, xy_px: NDArray[np.float64], attitude: Attitude) -> bool:
        seen = self._sighting(float(xy_px[0]), float(xy_px[1]))
        if seen is None:
            if len(self._sightings) < MAX_REMEMBERED:
                x, y = float(xy_px[0]), float(xy_px[1])
                self._sightings[round(x), round(y)] = _Sighting(x, y, attitude, 1, panorama.utc_ns)
            return False
        seen.frames += 1
        seen.last_ns = panorama.utc_ns
        # Every tenth frame is soon enough, and ten times cheaper.
        seen.hot = seen.hot or (seen.frames % 10 == HOT_FRAMES and self._moved(seen, attitude))
        return seen.hot

    def _sighting(self, x_px: float, y_px: float) -> _Sighting | None:
        """What was seen on this pixel, which a sub-pixel position may round to a neighbour of."""
        column, row = round(x_px), round(y_px)
        for key in ((column + i, row + j) for i in (0, -1, 1) for j in (0, -1, 1)):
            seen = self._sightings.get(key)
            if seen and abs(seen.x_px - x_px) <= SAME_PIXEL_PX and abs(seen.y_px - y_px) <= SAME_PIXEL_PX:
                return seen
        return None

    def _moved(self, seen: _Sighting, attitude: Attitude) -> bool:
        """Whether the star that stood on the pixel at its first sighting would have left it by now."""
        direction = self._camera.directions(np.array([[seen.x_px, seen.y_px]]))[0]
        before, now = direction @ seen.attitude.icrs_to_sensor, direction @ attitude.icrs_to_sensor
        return float(np.linalg.norm(now - before)) > HOT_MOTION_PX * self._camera.pixel_rad

    def _forget(self, utc_ns: int) -> None:
        if abs(utc_ns - self._forgotten_ns) < FORGET_NS / 4:
            return
        self._forgotten_ns = utc_ns
        self._sightings = {
            pixel: seen
            for pixel, seen in self._sightings.items()
            if seen.hot or abs(utc_ns - seen.last_ns) < FORGET_NS / 2
        }

    def _bodies_px(self, utc_ns: int, attitude: Attitude) -> dict[str, tuple[NDArray[np.float64], float]]:
        """Planets and Moon on the detector: place and how near an object must stand to be one."""
        if self._cell != utc_ns // _EPHEMERIS_NS:
            self._cell = utc_ns // _EPHEMERIS_NS
            self._bodies = self._directions(self._cell * _EPHEMERIS_NS + _EPHEMERIS_NS // 2)
        places_px = self._camera.pixels(self._bodies @ attitude.icrs_to_sensor.T)
        moon_px = MOON_WITHIN_RAD / self._camera.pixel_rad
        reach = {**dict.fromkeys(PLANETS, PLANET_WITHIN_PX), "Moon": moon_px}
        return {
            body: (place, within)
            for (body, within), place in zip(reach.items(), places_px, strict=True)
            if np.isfinite(place).all()
        }

    def _directions(self, utc_ns: int) -> NDArray[np.float64]:
        """Apparent topocentric unit vectors (7, 3) of PLANETS and Moon, in GCRS axes, by astropy's own ephemeris."""
        with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("iers_degraded_accuracy", "ignore"):
            time = Time(*to_julian_date(utc_ns), format="jd", scale="utc")
            places = [
                get_body(body.lower(), time, self._site, ephemeris="builtin").cartesian.xyz.value
                for body in (*PLANETS, "Moon")
            ]
        vectors = np.array(places, dtype=np.float64)
        unit: NDArray[np.float64] = vectors / np.linalg.norm(vectors, axis=1)[:, None]
        return unit
