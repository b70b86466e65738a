"""A night as astropy alone has it: stars seen by a camera on a rooftop, without any astrometry of gse."""

import math

import astropy.units as u
import numpy as np
from astropy.coordinates import AltAz, EarthLocation, SkyCoord
from astropy.time import Time, TimeDelta

from gse.instant import NS_PER_S, from_text
from gse.panorama import Panorama

START_NS = from_text("2026-03-20T11:00:00Z")
LATITUDE_DEG, LONGITUDE_DEG, HEIGHT_M = -6.53, 106.70, 250.0
PRESSURE_HPA, TEMPERATURE_C, HUMIDITY = 985.0, 25.0, 0.8
AZIMUTH_DEG, ALTITUDE_DEG, ROLL_DEG = 130.0, 60.0, 25.0
FOCAL_LENGTH_PX, SIZE_PX = 4169.905, 1024
STARS = 25

STATION_TEXT = f"""\
version: 1
sensor: {{name: astropy, rows: {SIZE_PX}, columns: {SIZE_PX}, focal_length_px: {FOCAL_LENGTH_PX}}}
site: {{latitude_deg: {LATITUDE_DEG}, longitude_deg: {LONGITUDE_DEG}, height_m: {HEIGHT_M},
       pressure_hpa: {PRESSURE_HPA}, temperature_c: {TEMPERATURE_C}, relative_humidity: {HUMIDITY}}}
mount: {{azimuth_deg: {AZIMUTH_DEG}, altitude_deg: {ALTITUDE_DEG}, roll_deg: {ROLL_DEG}}}
identifier: {{catalog_stars: 4000}}
"""


class AstropyNight:
    """Panoramas of named pointings in time, sub-pixel, with Gaussian noise of ``noise_px`` on each axis."""

    def __init__(self, stars_icrs, *, azimuth_deg=AZIMUTH_DEG, altitude_deg=ALTITUDE_DEG, roll_deg=ROLL_DEG):
        self._stars = stars_icrs
        self._azimuth, self._altitude, self._roll = np.radians([azimuth_deg, altitude_deg, roll_deg])

    def panoramas(self, utc_ns, *, noise_px=0.0, seed=0, focal_length_px=FOCAL_LENGTH_PX, k1=0.0, mirrored=False):
        """Panoramas at instants (M,) that lie within a minute, so that the same stars are in all."""
        utc_ns = np.asarray(utc_ns)
        rows = self._brightest_in_field(utc_ns)
        seen = self._horizon(self._stars[rows][None], utc_ns[:, None])
        rng = np.random.default_rng(seed)
        for ns, directions in zip(utc_ns.tolist(), seen, strict=True):
            xy = self._pixels(directions, focal_length_px, k1, mirrored) + rng.normal(
                0, noise_px or 1e-12, (len(rows), 2)
            )
            brightness = np.linspace(4000.0, 200.0, len(rows))
            time_us = (ns - START_NS) // 1000
            yield Panorama(ns, xy, brightness, time_us // 100_000, 0.1, time_us, ns)

    def _brightest_in_field(self, utc_ns):
        """Rows of the brightest stars that stay inside the detector; the catalogue is brightest first."""
        inside = np.ones(len(self._stars), dtype=bool)
        for ns in (utc_ns[0], utc_ns[-1]):
            boresight = SkyCoord(
                az=self._azimuth * u.rad, alt=self._altitude * u.rad, frame=altaz(np.array([ns]), air=False)
            ).icrs.cartesian.xyz.value.ravel()
            near = np.flatnonzero(self._stars @ boresight > math.cos(math.radians(10)))
            xy = self._pixels(self._horizon(self._stars[near][None], np.array([[ns]]))[0], FOCAL_LENGTH_PX, 0.0, False)
            good = near[((xy > 12) & (xy < SIZE_PX - 13)).all(axis=1)]
            inside &= np.isin(np.arange(len(self._stars)), good)
        return np.flatnonzero(inside)[:STARS]

    def _horizon(self, stars_icrs, utc_ns):
        """Directions east, north, up in which astropy sees the stars, with refraction."""
        frame = altaz(utc_ns, air=True)
        seen = SkyCoord(*np.moveaxis(stars_icrs, -1, 0), representation_type="cartesian", frame="icrs")
        seen = SkyCoord(seen.spherical.lon, seen.spherical.lat, frame="icrs").transform_to(frame)
        az, alt = seen.az.rad, seen.alt.rad
        return np.stack([np.cos(alt) * np.sin(az), np.cos(alt) * np.cos(az), np.sin(alt)], axis=-1)

    def _pixels(self, directions, focal_length_px, k1, mirrored):
        """A pinhole: x to the right, y down; up is turned counter-clockwise from the zenith by the roll."""
        a, h = self._azimuth, self._altitude
        boresight = np.array([np.cos(h) * np.sin(a), np.cos(h) * np.cos(a), np.sin(h)])
        zenithwards = np.array([-np.sin(h) * np.sin(a), -np.sin(h) * np.cos(a), np.cos(h)])
        rightwards = np.array([np.cos(a), -np.sin(a), 0.0])
        up = np.cos(self._roll) * zenithwards - np.sin(self._roll) * rightwards
        right = np.cos(self._roll) * rightwards + np.sin(self._roll) * zenithwards
        depth = directions @ boresight
        plane = np.stack([directions @ right, -(directions @ up)], axis=-1) / depth[..., None] * focal_length_px
        if k1:
            undistorted = np.linalg.norm(plane, axis=-1, keepdims=True)
            distorted = undistorted.copy()
            for _ in range(30):
                distorted = undistorted / (1 + k1 * (distorted / (SIZE_PX / 2)) ** 2)
            plane = plane * distorted / undistorted
        if mirrored:
            plane = plane * [-1, 1]
        return plane + (SIZE_PX - 1) / 2


def altaz(utc_ns, *, air):
    """astropy's horizon at instants of any shape; midnight plus SI seconds, since a day may have 86,401."""
    days, ns = np.divmod(np.asarray(utc_ns), 86_400 * NS_PER_S)
    time = (Time(days + 40587.0, format="mjd", scale="utc").tai + TimeDelta(ns / NS_PER_S, format="sec")).utc
    location = EarthLocation.from_geodetic(LONGITUDE_DEG * u.deg, LATITUDE_DEG * u.deg, HEIGHT_M * u.m)
    weather = {
        "pressure": PRESSURE_HPA * u.hPa,
        "temperature": TEMPERATURE_C * u.deg_C,
        "relative_humidity": HUMIDITY,
        "obswl": 0.6 * u.micron,
    }
    return AltAz(obstime=time, location=location, **(weather if air else {}))
