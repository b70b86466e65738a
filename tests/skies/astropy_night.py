"""A night as astropy alone has it: the self-check's made sky, as panoramas without bytes."""

import numpy as np

from gse.inspection.made_session import (
    ALTITUDE_DEG,
    AZIMUTH_DEG,
    FOCAL_LENGTH_PX,
    ROLL_DEG,
    SITE,
    SIZE_PX,
    AstropySky,
    MadeSensor,
    mounted,
)
from gse.inspection.made_session import STATION_TEXT as SUB_PIXEL_TEXT
from gse.values.instant import from_text
from gse.values.panorama import Panorama

START_NS = from_text("2026-03-20T11:00:00Z")
STATION_TEXT = SUB_PIXEL_TEXT.replace("protocol: panorama-v1-subpixel\n", "")
STARS = 25


class AstropyNight:
    """Panoramas of named pointings in time, sub-pixel, with Gaussian noise of ``noise_px`` on each axis."""

    def __init__(self, stars_icrs):
        self._stars = stars_icrs
        self._sky = AstropySky(SITE)

    def panoramas(self, utc_ns, *, noise_px=0.0, seed=0, focal_length_px=FOCAL_LENGTH_PX, k1=0.0, mirrored=False):
        """Panoramas at instants (M,) that lie within a minute, so that the same stars are in all."""
        utc_ns = np.asarray(utc_ns)
        axes = mounted(AZIMUTH_DEG, ALTITUDE_DEG, ROLL_DEG)
        sensor = MadeSensor(axes, focal_length_px, SIZE_PX, radial_distortion=k1, mirrored=mirrored)
        stars = self._stars[self._brightest_in_field(MadeSensor(axes, FOCAL_LENGTH_PX, SIZE_PX), utc_ns[[0, -1]])]
        rng = np.random.default_rng(seed)
        for ns, directions in zip(utc_ns.tolist(), self._sky.seen(stars, utc_ns), strict=True):
            xy = sensor.pixels(directions) + rng.normal(0, noise_px or 1e-12, (len(stars), 2))
            brightness = np.linspace(4000.0, 200.0, len(stars))
            time_us = (ns - START_NS) // 1000
            yield Panorama(ns, xy, brightness, time_us // 100_000, 0.1, time_us, ns)

    def _brightest_in_field(self, sensor, utc_ns):
        """Rows of the brightest stars that stay inside the detector; the catalogue is brightest first."""
        return np.flatnonzero(sensor.sees(self._sky.seen(self._stars, utc_ns)).all(axis=0))[:STARS]
