"""The sky over a site as astropy's high-level frames show it.

Catalogue stars go from ICRS to AltAz with refraction at four instants of each cell of 300 s; between them each
direction is interpolated by a cubic, which is good to 1e-4 arcsec. Cells begin at fixed instants, so that an answer
depends on its own instant only.
"""

import contextlib
import functools
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import astropy.units as u
import numpy as np
from astropy.coordinates import GCRS, AltAz, CartesianRepresentation, EarthLocation, SkyCoord, get_body
from astropy.time import Time
from astropy.utils import iers
from astropy.utils.exceptions import AstropyWarning
from erfa import ErfaWarning
from numpy.typing import NDArray

from gse.catalog import StarCatalog, merge_doubles
from gse.values.constants import AU_M
from gse.values.instant import NS_PER_S, to_julian_date
from gse.values.matrices import product
from gse.values.site import Site

CELL_NS = 300 * NS_PER_S
NODE_NS = CELL_NS // 3
_EARTH_RATE_RAD_PER_S = 7.2921e-5
_WAVELENGTH_UM = 0.6
"""Where a silicon detector sees stars, for refraction."""
_LOWEST_RAD = math.radians(-1)
"""Refraction has no inverse far below the horizon; what looks there sees nothing anyway."""

_FINALS_LINE = np.dtype(
    {
        "names": ["mjd", "x_a", "y_a", "ut1_a", "x_b", "y_b", "ut1_b"],
        "formats": ["S8", "S9", "S9", "S10", "S10", "S10", "S11"],
        "offsets": [7, 18, 37, 58, 134, 144, 154],
        "itemsize": 188,
    }
)
"""A line of finals2000A.all: columns as in the ReadMe.finals2000A beside it."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """300 s of directions: ``nodes`` (4, N, 3), unit vectors at four instants, x east, y north, z up."""

    start_ns: int
    nodes: NDArray[np.float64]

    def directions(self, utc_ns: int) -> NDArray[np.float64]:
        """The directions (N, 3) at an instant; exact at the nodes, some 100 s outside them still good."""
        t = (utc_ns - self.start_ns) / NODE_NS
        weights = np.array(
            [
                -(t - 1) * (t - 2) * (t - 3) / 6,
                t * (t - 2) * (t - 3) / 2,
                -t * (t - 1) * (t - 3) / 2,
                t * (t - 1) * (t - 2) / 6,
            ]
        )
        seen: NDArray[np.float64] = product(weights, self.nodes.reshape(4, -1))
        return seen.reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class SkyCell:
    """300 s of stars near a direction, with their magnitudes (N,) and numbers ``ids`` (N,), 0 of what is no star."""

    track: Track
    magnitude: NDArray[np.float64]
    ids: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class AstropySite:
    """A site for astropy: its place, and its air."""

    site: Site

    @property
    def location(self) -> EarthLocation:
        """On the ellipsoid."""
        longitude, latitude = self.site.longitude_deg * u.deg, self.site.latitude_deg * u.deg
        return EarthLocation.from_geodetic(longitude, latitude, self.site.height_m * u.m)

    def horizon(self, times: Time) -> AltAz:
        """The frame of what is seen from here at some times."""
        return AltAz(
            obstime=times,
            location=self.location,
            pressure=self.site.air_pressure_hpa * u.hPa,
            temperature=self.site.air_temperature_c * u.deg_C,
            relative_humidity=self.site.relative_humidity,
            obswl=_WAVELENGTH_UM * u.um,
        )


class Sky:
    """Stars of a catalogue over a site, none below the horizon; those within ``merged_within_rad`` are one."""

    def __init__(self, site: AstropySite, catalog: StarCatalog, merged_within_rad: float = 0.0) -> None:
        self._site = site
        self._catalog = catalog
        self._merged_within_rad = merged_within_rad

    def cell(
        self, utc_ns: int, boresight_horizon: NDArray[np.float64], radius_rad: float, faintest_magnitude: float
    ) -> SkyCell:
        """The cell of an instant: all stars that come within ``radius_rad`` of a fixed direction (3,) during it."""
        start_ns = utc_ns // CELL_NS * CELL_NS
        reach_rad = min(radius_rad + _EARTH_RATE_RAD_PER_S * CELL_NS / NS_PER_S / 2 + 1e-3, math.pi)
        with earth_orientation():
            centre_icrs = self._icrs(boresight_horizon, start_ns + CELL_NS // 2)
            bright = int(np.searchsorted(self._catalog.magnitude, faintest_magnitude))
            near = np.flatnonzero(product(self._catalog.icrs[:bright], centre_icrs) > math.cos(reach_rad))
            stars = self._catalog.rows(near)
            if self._merged_within_rad > 0:
                stars = merge_doubles(stars, self._merged_within_rad)
            nodes = self._seen(stars.icrs, times_of(start_ns))
        above = nodes[:, :, 2].min(axis=0) > 0
        return SkyCell(Track(start_ns, np.ascontiguousarray(nodes[:, above])), stars.magnitude[above], stars.ids[above])

    def _seen(self, stars_icrs: NDArray[np.float64], times: Time) -> NDArray[np.float64]:
        """Stars (N, 3) as seen at instants (M,): unit vectors (M, N, 3) in the horizon frame."""
        x, y, z = stars_icrs.T
        stars = SkyCoord(np.arctan2(y, x)[None] * u.rad, np.arctan2(z, np.hypot(x, y))[None] * u.rad, frame="icrs")
        return horizon_vectors(stars.transform_to(self._site.horizon(times[:, None])))

    def _icrs(self, direction_horizon: NDArray[np.float64], utc_ns: int) -> NDArray[np.float64]:
        east, north, up = (float(value) for value in direction_horizon)
        altitude_rad = max(math.atan2(up, math.hypot(east, north)), _LOWEST_RAD)
        frame = self._site.horizon(Time(*to_julian_date(utc_ns), format="jd", scale="utc"))
        seen = SkyCoord(az=math.atan2(east, north) * u.rad, alt=altitude_rad * u.rad, frame=frame)
        return np.asarray(seen.transform_to("icrs").cartesian.xyz.value, dtype=np.float64)


def times_of(start_ns: int) -> Time:
    """The four instants of a cell."""
    days, fractions = zip(*(to_julian_date(start_ns + NODE_NS * node) for node in range(4)), strict=True)
    return Time(np.array(days), np.array(fractions), format="jd", scale="utc")


def horizon_vectors(seen: SkyCoord) -> NDArray[np.float64]:
    """Unit vectors (..., 3), x east, y north, z up, of coordinates in AltAz."""
    azimuth, altitude = seen.az.rad, seen.alt.rad
    level = np.cos(altitude)
    return np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(altitude)], axis=-1)


@functools.lru_cache(maxsize=1)
def orientation_table() -> iers.IERS:
    """UT1 - UTC and the pole by day, as ``iers.IERS_A.open`` takes them from its file: Bulletin B's where it has them.

    astropy's reader takes 50 MB and 0.6 s, for 30 columns of which these are read.
    """
    lines = np.fromfile(iers.IERS_A_FILE, _FINALS_LINE)
    lines = lines[_is_filled(lines["ut1_a"])]
    pole_b, ut1_b = _is_filled(lines["x_b"]) & _is_filled(lines["y_b"]), _is_filled(lines["ut1_b"])
    table = iers.IERS()
    table["MJD"] = lines["mjd"].astype(np.float64) * u.d
    table["UT1_UTC"] = np.where(ut1_b, lines["ut1_b"], lines["ut1_a"]).astype(np.float64) * u.s
    table["PM_x"] = np.where(pole_b, lines["x_b"], lines["x_a"]).astype(np.float64) * u.arcsec
    table["PM_y"] = np.where(pole_b, lines["y_b"], lines["y_a"]).astype(np.float64) * u.arcsec
    return table


def _is_filled(texts: NDArray[np.bytes_]) -> NDArray[np.bool_]:
    return np.asarray(np.char.strip(texts) != b"")


@contextlib.contextmanager
def earth_orientation() -> Iterator[None]:
    """The IERS tables that are installed, never a download; outside them astropy's own approximation."""
    with (
        warnings.catch_warnings(),
        iers.earth_orientation_table.set(orientation_table()),
        iers.conf.set_temp("auto_download", False),
        iers.conf.set_temp("iers_degraded_accuracy", "ignore"),
    ):
        # Past the tables neither leap seconds nor the pole are known: a simulated sky need not be true to the second.
        warnings.simplefilter("ignore", ErfaWarning)
        warnings.simplefilter("ignore", AstropyWarning)
        yield


# Sun, Moon and planets over a site, by astropy's built-in ephemeris.
#
# Places are good to some arcseconds for the planets and some 20 for the Moon: right for what shall not be taken for a
# star. Magnitudes follow Meeus, Astronomical Algorithms, chapter 41 (Saturn without its ring), and for the Moon
# Krisciunas & Schaefer 1991, equation 9.

MAGNITUDE_TERMS = {
    "mercury": (-0.42, 0.0380, -0.000273, 2e-6),
    "venus": (-4.40, 0.0009, 0.000239, -6.5e-7),
    "mars": (-1.52, 0.016, 0.0, 0.0),
    "jupiter": (-9.40, 0.005, 0.0, 0.0),
    "saturn": (-8.88, 0.0, 0.0, 0.0),
    "uranus": (-7.19, 0.0, 0.0, 0.0),
    "neptune": (-6.87, 0.0, 0.0, 0.0),
}
"""At 1 au from Sun and Earth, and its change with the phase angle in degrees."""

NAMES = ("sun", "moon", *MAGNITUDE_TERMS)
SUN, MOON, FIRST_PLANET = 0, 1, 2
_KEPT_CELLS = 32
"""Each takes 0.05 s to make and 1 kB to keep."""
_MOON_RADIUS_AU = 1_737_400.0 / AU_M


@dataclass(frozen=True, slots=True, eq=False)
class BodyCell:
    """300 s of the bodies of NAMES, with their magnitudes in the middle of it.

    ``moon_phase_rad`` is 0 when full, ``moon_radius_rad`` half its width.
    """

    track: Track
    magnitude: NDArray[np.float64]
    moon_phase_rad: float
    moon_radius_rad: float


def bodies_over(site: AstropySite, utc_ns: int) -> BodyCell:
    """The cell of an instant."""
    return _cell(site, utc_ns // CELL_NS * CELL_NS)


@functools.lru_cache(maxsize=_KEPT_CELLS)
def _cell(site: AstropySite, start_ns: int) -> BodyCell:
    times, location = times_of(start_ns), site.location
    with earth_orientation():
        seen = _together([get_body(name, times, location) for name in NAMES], times)
        seen = seen.transform_to(site.horizon(times[:, None]))
    nodes, to_earth_au = horizon_vectors(seen), seen.distance.au[0]
    from_earth = nodes[0] * to_earth_au[:, None]
    to_sun_au = np.linalg.norm(from_earth - from_earth[SUN], axis=1)
    phase_rad = [
        _angle_of(float(sun_side), float(earth_side), float(to_earth_au[SUN]))
        for sun_side, earth_side in zip(to_sun_au, to_earth_au, strict=True)
    ]
    magnitude = np.array([-26.7, _moon_magnitude(phase_rad[MOON]), *np.zeros(len(MAGNITUDE_TERMS))])
    for number, terms in enumerate(MAGNITUDE_TERMS.values(), start=FIRST_PLANET):
        phase_deg = math.degrees(phase_rad[number])
        by_phase = sum(term * phase_deg**power for power, term in enumerate(terms))
        magnitude[number] = by_phase + 5 * math.log10(to_sun_au[number] * to_earth_au[number])
    return BodyCell(Track(start_ns, nodes), magnitude, phase_rad[MOON], _MOON_RADIUS_AU / float(to_earth_au[MOON]))


def _together(bodies: list[SkyCoord], times: Time) -> SkyCoord:
    """Bodies as seen at M instants, as one (M, N): to turn them one by one takes four times as long."""
    places_au = np.stack([body.cartesian.xyz.to_value("AU") for body in bodies], axis=-1)
    site = {name: getattr(bodies[0], name)[:, None] for name in ("obsgeoloc", "obsgeovel")}
    frame = GCRS(CartesianRepresentation(places_au, unit="AU", copy=False), obstime=times[:, None], **site)
    return SkyCoord(frame)


def _angle_of(side_a: float, side_b: float, opposite: float) -> float:
    """Angle between two sides of a triangle, from the law of cosines."""
    if side_a == 0:
        return 0.0
    cosine = (side_a**2 + side_b**2 - opposite**2) / (2 * side_a * side_b)
    return math.acos(min(max(cosine, -1.0), 1.0))


def _moon_magnitude(phase_rad: float) -> float:
    phase_deg = math.degrees(phase_rad)
    return -12.73 + 0.026 * phase_deg + 4e-9 * phase_deg**4
