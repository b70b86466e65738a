"""Sidereal truth: direction of a mount fixed on the Earth, and apparent places of stars.

All astrometry is ERFA's (IAU 2006/2000A). What is slow in it (precession, nutation, the Earth's motion) is computed
once for each cell of 300 s at the middle of the cell, so that an answer depends on its instant only, not on what was
asked before; inside a cell the Earth turns about its pole of date. Left out by that: 0.0006 arcsec of aberration,
0.0003 of precession and nutation.
"""

import math
from dataclasses import dataclass

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.errors import UsageError
from gse.truth.frames import horizon_axes, horizon_to_sensor
from gse.truth.orientation import EarthOrientation
from gse.truth.refraction import Refraction
from gse.values.attitude import Attitude, Attitudes
from gse.values.attitude_convention import from_angles
from gse.values.constants import AU_M, DAY_S, EARTH_RATE_RAD_PER_S, LIGHT_M_PER_S
from gse.values.instant import NS_PER_DAY, NS_PER_S, UNIX_EPOCH_MJD
from gse.values.matrices import length, product
from gse.values.mount import InertialDirection, Mount
from gse.values.screen import ShownSky
from gse.values.site import Site

CORRECTIONS = (
    "precession",
    "nutation",
    "UT1",
    "polar motion",
    "geodetic latitude",
    "annual aberration",
    "diurnal aberration",
    "light deflection",
    "refraction",
)
"""What ``omit`` of SiderealTruth may name, to study the size of each."""

_CELL_NS = 300 * NS_PER_S
"""Divides a day, so that no cell holds a leap second."""
_CELLS_KEPT = 1024
_MJD_JD = 2_400_000.5
_TT_MINUS_TAI_S = 32.184
_WGS84 = 1
_NO_COVARIANCE = np.zeros((3, 3))


@dataclass(frozen=True, slots=True, eq=False)
class _Cell:
    """300 s of sky: ICRS to horizon is ``still`` + ``cosine`` cos a + ``sine`` sin a, a the angle from the middle."""

    middle_ns: int
    still: NDArray[np.float64]
    cosine: NDArray[np.float64]
    sine: NDArray[np.float64]
    sun_to_earth_icrs: NDArray[np.float64]
    sun_distance_au: float
    earth_velocity_c: NDArray[np.float64]


class SiderealTruth:
    """The sky over a site.

    ``omit`` names corrections (of CORRECTIONS) to leave out: for study, never for a verdict. Instants are UTC in
    nanoseconds since 1970; directions are rows of unit vectors; the horizon frame is x east, y north, z up along the
    ellipsoid's normal.
    """

    def __init__(
        self, site: Site, earth_orientation: EarthOrientation, omit: frozenset[str] | set[str] = frozenset()
    ) -> None:
        if unknown := sorted(set(omit) - set(CORRECTIONS)):
            raise UsageError(f"no correction is called {unknown[0]!r}; known are: {', '.join(CORRECTIONS)}")
        self.site = site
        self.earth_orientation = earth_orientation
        self.omit = frozenset(omit)
        self.refraction = Refraction(0.0, 0.0) if "refraction" in omit else Refraction.at(site)
        self._itrs_to_horizon, self._site_speed_c = _place(site, geodetic="geodetic latitude" not in omit)
        if "diurnal aberration" in omit:
            self._site_speed_c = 0.0
        self._cells: dict[int, _Cell] = {}

    def icrs_to_horizon(self, utc_ns: int) -> NDArray[np.float64]:
        """The rotation (3, 3) from ICRS (GCRS) axes to the horizon frame: no aberration, no refraction."""
        rotation: NDArray[np.float64] = self.icrs_to_horizon_at(np.array([utc_ns]))[0]
        return rotation

    def icrs_to_horizon_at(self, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """The rotations (M, 3, 3) at many instants (M,), each as of ``icrs_to_horizon``."""
        numbers = utc_ns // _CELL_NS
        rotations = np.empty((len(utc_ns), 3, 3))
        for number in np.unique(numbers):
            cell = self._cell(int(number))
            rows = numbers == number
            angles = ((utc_ns[rows] - cell.middle_ns) * (EARTH_RATE_RAD_PER_S / NS_PER_S)).tolist()
            # Those of math: numpy's own of an array are others in the last digit on some processors.
            cosine, sine = (np.array([f(angle) for angle in angles])[:, None, None] for f in (math.cos, math.sin))
            rotations[rows] = cell.still + cell.cosine * cosine + cell.sine * sine
        return rotations

    def apparent(self, stars_icrs: NDArray[np.float64], utc_ns: int) -> NDArray[np.float64]:
        """Stars (N, 3) as they are seen from the site, still in ICRS axes.

        Light deflection by the Sun, annual and diurnal aberration; no parallax (0.75 arcsec for the nearest star).
        """
        first_one = np.zeros(len(stars_icrs), dtype=np.int64)
        return self.apparent_at(stars_icrs, np.array([utc_ns]), self.icrs_to_horizon(utc_ns)[None], first_one)

    def apparent_at(
        self,
        stars_icrs: NDArray[np.float64],
        utc_ns: NDArray[np.int64],
        icrs_to_horizon: NDArray[np.float64],
        instant_of: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        """``apparent`` at many instants (K,), given their rotations (K, 3, 3); ``instant_of`` (N,) is each star's."""
        cells = [self._cell(number) for number in (utc_ns // _CELL_NS).tolist()]
        velocity_c = np.array([cell.earth_velocity_c for cell in cells]) + self._site_speed_c * icrs_to_horizon[:, 0]
        lorentz = np.sqrt(1 - np.einsum("ki,ki->k", velocity_c, velocity_c))
        distance_au = np.array([cell.sun_distance_au for cell in cells]).take(instant_of)
        seen = np.asarray(stars_icrs, dtype=np.float64)
        if "light deflection" not in self.omit:
            sun_to_earth_icrs = np.array([cell.sun_to_earth_icrs for cell in cells]).take(instant_of, axis=0)
            seen = erfa.ufunc.ldsun(seen, sun_to_earth_icrs, distance_au)
        seen = erfa.ufunc.ab(seen, velocity_c.take(instant_of, axis=0), distance_au, lorentz.take(instant_of))
        return np.asarray(seen, dtype=np.float64)

    def unrefracted(
        self, directions_sensor: NDArray[np.float64], zenith_sensor: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Measured directions (N, 3) without the refraction of the site's air, about the zenith, (3,) or (N, 3)."""
        return self.refraction.removed(directions_sensor, zenith_sensor)

    def attitude_true(self, utc_ns: int, mount: Mount) -> Attitude:
        """Where the mount looks: the geometric direction, in ICRS axes, with zero covariance."""
        return Attitude(
            self.attitudes_true(self.icrs_to_horizon(utc_ns)[None], mount).icrs_to_sensor[0], _NO_COVARIANCE
        )

    @staticmethod
    def attitudes_true(icrs_to_horizon: NDArray[np.float64], mount: Mount) -> Attitudes:
        """``attitude_true`` at many instants, given their rotations (K, 3, 3)."""
        rotations = product(horizon_to_sensor(mount), icrs_to_horizon)
        return Attitudes(rotations, np.zeros(rotations.shape))

    def _cell(self, number: int) -> _Cell:
        cell = self._cells.get(number)
        if cell is None:
            if len(self._cells) >= _CELLS_KEPT:
                self._cells.clear()
            cell = self._cells[number] = self._computed(number * _CELL_NS + _CELL_NS // 2)
        return cell

    def _computed(self, middle_ns: int) -> _Cell:
        days, ns = divmod(middle_ns, NS_PER_DAY)
        mjd, second = UNIX_EPOCH_MJD + days, ns / NS_PER_S
        earth = self.earth_orientation.at(middle_ns)
        tt = _MJD_JD + mjd, (second + earth.tai_minus_utc_s + _TT_MINUS_TAI_S) / DAY_S
        ut1 = _MJD_JD + mjd, (second + (0.0 if "UT1" in self.omit else earth.ut1_minus_utc_s)) / DAY_S
        icrs_to_date = self._icrs_to_date(tt)
        sidereal_rad = float(
            erfa.ufunc.gmst06(*ut1, *tt) if "nutation" in self.omit else erfa.ufunc.gst06(*ut1, *tt, _bpn(tt))
        )
        x_pole, y_pole = (0.0, 0.0) if "polar motion" in self.omit else (earth.x_pole_rad, earth.y_pole_rad)
        polar = erfa.ufunc.pom00(x_pole, y_pole, erfa.ufunc.sp00(*tt))
        to_horizon = product(self._itrs_to_horizon, polar)
        heliocentric, barycentric = erfa.ufunc.epv00(*tt)[:2]  # TT for TDB: 2 ms
        distance_au = length(heliocentric["p"])
        moving = 0.0 if "annual aberration" in self.omit else AU_M / DAY_S / LIGHT_M_PER_S
        sin_0, cos_0 = math.sin(sidereal_rad), math.cos(sidereal_rad)
        # The Earth's turn R3(angle + a), a the angle from the middle of the cell, split into what stays, what goes with
        # cos a and what goes with sin a: three products a cell, and then a sum of three matrices for each instant.
        turned = np.array([[cos_0, sin_0, 0.0], [-sin_0, cos_0, 0.0], [0.0, 0.0, 0.0]])
        quarter_on = np.array([[-sin_0, cos_0, 0.0], [-cos_0, -sin_0, 0.0], [0.0, 0.0, 0.0]])
        return _Cell(
            middle_ns,
            product(to_horizon, np.diag([0.0, 0.0, 1.0]), icrs_to_date),
            product(to_horizon, turned, icrs_to_date),
            product(to_horizon, quarter_on, icrs_to_date),
            heliocentric["p"] / distance_au,
            distance_au,
            barycentric["v"] * moving,
        )

    def _icrs_to_date(self, tt: tuple[float, float]) -> NDArray[np.float64]:
        """ICRS to the true equator and equinox of date, or what is left of it."""
        if not {"precession", "nutation"} & self.omit:
            return _bpn(tt)
        _, _, _, bias, precession, _, nutation, _ = erfa.ufunc.pn06a(*tt)
        rotation = bias
        if "precession" not in self.omit:
            rotation = product(precession, rotation)
        if "nutation" not in self.omit:
            rotation = product(nutation, rotation)
        return np.asarray(rotation, dtype=np.float64)


def _bpn(tt: tuple[float, float]) -> NDArray[np.float64]:
    return np.asarray(erfa.ufunc.pnm06a(*tt), dtype=np.float64)


def _place(site: Site, *, geodetic: bool) -> tuple[NDArray[np.float64], float]:
    """The rotation (3, 3) from Earth-fixed axes to the horizon frame, and the site's speed by the Earth's turning."""
    longitude, latitude = math.radians(site.longitude_deg), math.radians(site.latitude_deg)
    position_m, _ = erfa.ufunc.gd2gc(_WGS84, longitude, latitude, site.height_m)
    speed_c = math.hypot(position_m[0], position_m[1]) * EARTH_RATE_RAD_PER_S / LIGHT_M_PER_S
    if not geodetic:
        latitude = math.atan2(position_m[2], math.hypot(position_m[0], position_m[1]))
    return horizon_axes(longitude, latitude), speed_c


class InertialTruth(SiderealTruth):
    """Truth without a turning Earth: the stars before a star simulator, or on a screen (``sky``).

    They stand where the catalogue has them: no aberration, no refraction, and no site. The sensor's frame is the only
    frame of the stand, so the rotation that is the horizon's elsewhere is that of the stated direction here, and such a
    mount is the identity.
    """

    def __init__(self, shown: InertialDirection, sky: ShownSky | None = None) -> None:
        self.refraction = Refraction(0.0, 0.0)
        self._shown, self._sky = shown, sky

    def icrs_to_horizon(self, utc_ns: int) -> NDArray[np.float64]:
        """The rotation (3, 3) from ICRS axes to the stand."""
        rotation: NDArray[np.float64] = self.icrs_to_horizon_at(np.array([utc_ns]))[0]
        return rotation

    def icrs_to_horizon_at(self, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """The rotations (M, 3, 3) at many instants (M,)."""
        if self._sky is not None and self._sky.shown:
            return self._sky.icrs_to_sensor_at(utc_ns)
        shown = self._shown
        since_h = (utc_ns - shown.at_utc_ns) / NS_PER_S / 3600  # arcsec/s are deg/h
        angles = (shown.ra_deg, shown.de_deg, shown.roll_deg)
        moved = (start + rate * since_h for start, rate in zip(angles, shown.rates_arcsec_per_s, strict=True))
        return from_angles(*moved)

    def apparent_at(
        self,
        stars_icrs: NDArray[np.float64],
        utc_ns: NDArray[np.int64],
        icrs_to_horizon: NDArray[np.float64],
        instant_of: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        """The stars as they are: nothing moves them."""
        return np.asarray(stars_icrs, dtype=np.float64)

    def apparent(self, stars_icrs: NDArray[np.float64], utc_ns: int) -> NDArray[np.float64]:
        """The stars as they are: nothing moves them."""
        return np.asarray(stars_icrs, dtype=np.float64)

    def unrefracted(
        self, directions_sensor: NDArray[np.float64], zenith_sensor: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The directions as they are measured."""
        return np.asarray(directions_sensor, dtype=np.float64)


def truth_of(
    site: Site, mount: Mount, earth_orientation: EarthOrientation | None, sky: ShownSky | None = None
) -> SiderealTruth | None:
    """The truth of a mount: of the stars that are shown to it, or of the sky; None without Earth orientation."""
    if mount.inertial is not None:
        return InertialTruth(mount.inertial, sky)
    return None if earth_orientation is None else SiderealTruth(site, earth_orientation)
