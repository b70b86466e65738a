"""Made sessions: the frames of a sensor with a known error, as its bytes come over the wire.

The night is one of the past, so that every installation has measured Earth orientation for it; the sky turns by 105 deg
over the fixed mount.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import Chunk
from gse.constants import ARCSEC_RAD
from gse.instant import NS_PER_S, from_text
from gse.selfcheck.astropy_sky import AstropySky
from gse.selfcheck.known_errors import KnownError
from gse.selfcheck.made_sensor import MadeSensor, mounted
from gse.site import Site
from protocols import PanoramaMessage, Protocol

START_NS = from_text("2024-03-20T12:00:00Z")
POINTINGS = 8
POINTING_NS = 3600 * NS_PER_S
FRAME_NS = NS_PER_S // 5
SITE = Site(
    latitude_deg=-6.53,
    longitude_deg=106.70,
    height_m=250.0,
    pressure_hpa=985.0,
    temperature_c=25.0,
    relative_humidity=0.8,
)
AZIMUTH_DEG, ALTITUDE_DEG, ROLL_DEG = 130.0, 60.0, 25.0
FOCAL_LENGTH_PX, SIZE_PX = 4169.905, 1024
STATION_TEXT = f"""\
version: 1
sensor: {{name: self-check, rows: {SIZE_PX}, columns: {SIZE_PX}, focal_length_px: {FOCAL_LENGTH_PX}}}
site: {{latitude_deg: {SITE.latitude_deg}, longitude_deg: {SITE.longitude_deg}, height_m: {SITE.height_m},
       pressure_hpa: {SITE.pressure_hpa}, temperature_c: {SITE.temperature_c},
       relative_humidity: {SITE.relative_humidity}}}
mount: {{azimuth_deg: {AZIMUTH_DEG}, altitude_deg: {ALTITUDE_DEG}, roll_deg: {ROLL_DEG}}}
protocol: panorama-v1-subpixel
identifier: {{catalog_stars: 4000}}
"""
"""What the sensor is said to be."""

_STARS = 25
_EXPOSURE_S = 0.1
_BYTE_NS = 10 * NS_PER_S // 115_200
_POWER_ON_US = 1_000_000
_ELSEWHERE_RAD = np.radians(5.0)
_CLEAR_PX = 20.0
_ZENITH = np.array([0.0, 0.0, 1.0])
_POLE = np.array([0.0, np.cos(np.radians(SITE.latitude_deg)), np.sin(np.radians(SITE.latitude_deg))])


def stated_sensor() -> MadeSensor:
    """The sensor that the station file describes."""
    return MadeSensor(mounted(AZIMUTH_DEG, ALTITUDE_DEG, ROLL_DEG), FOCAL_LENGTH_PX, SIZE_PX)


def true_sensor(error: KnownError, utc_ns: int) -> MadeSensor:
    """The sensor as it is at an instant."""
    hours = (utc_ns - START_NS - (POINTINGS - 1) * POINTING_NS / 2) / (3600 * NS_PER_S)
    stated = stated_sensor()
    boresight = stated.axes[2]
    turns = (
        (-_ZENITH, error.azimuth_arcsec / np.cos(np.radians(ALTITUDE_DEG))),
        (np.cross(boresight, _POLE), error.poleward_arcsec + error.poleward_arcsec_per_h * hours),
        (-boresight, error.roll_arcsec),
    )
    sensor = replace(stated, focal_length_px=FOCAL_LENGTH_PX * (1 + error.focal_share))
    for axis, arcsec in turns:
        if arcsec:
            sensor = sensor.turned(axis, arcsec * ARCSEC_RAD)
    return sensor


class MadeSky:
    """Catalogue stars (N, 3), brightest first, over the site as astropy has them.

    What is seen is the same for every known error and is asked for once, ``frames`` frames of each stretch.
    """

    def __init__(self, stars_icrs: NDArray[np.float64], frames: int) -> None:
        self.sky = AstropySky(SITE)
        self._stars = stars_icrs
        self._instants = begins_ns()[:, None] + np.arange(frames) * FRAME_NS
        fields = self._fields(stated_sensor(), begins_ns())
        self._seen = [
            self.sky.seen(stars_icrs[field], instants) for field, instants in zip(fields, self._instants, strict=True)
        ]

    def first_of_each(self) -> list[NDArray[np.float64]]:
        """The directions (N, 3) that the first frame of each stretch shows."""
        return [seen[0] for seen in self._seen]

    def frames(self, error: KnownError, seed: int) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """The true UTC and the objects (N, 2) of each frame, brightest first."""
        random = np.random.default_rng(seed)
        for instants, seen in zip(self._instants, self._seen, strict=True):
            for number, utc_ns in enumerate(instants[: error.frames].tolist()):
                sensor, directions = true_sensor(error, utc_ns), seen[number]
                if number < error.wrong:
                    sensor = sensor.turned(_ZENITH, _ELSEWHERE_RAD)
                    directions = self._elsewhere(sensor, utc_ns)
                xy_px = sensor.pixels(directions if number >= error.blank else directions[:0])
                xy_px = xy_px + random.normal(0, error.noise_px, xy_px.shape)
                yield utc_ns, np.concatenate([xy_px, _far_from(xy_px, error.false_objects, random)])

    def _fields(self, sensor: MadeSensor, utc_ns: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """The rows of the brightest stars that a sensor sees at each instant (M,)."""
        seen = sensor.sees(self.sky.seen(self._stars, utc_ns))
        return [np.flatnonzero(inside)[:_STARS] for inside in seen]

    def _elsewhere(self, sensor: MadeSensor, utc_ns: int) -> NDArray[np.float64]:
        at = np.array([utc_ns])
        (field,) = self._fields(sensor, at)
        directions: NDArray[np.float64] = self.sky.seen(self._stars[field], at)[0]
        return directions


def begins_ns() -> NDArray[np.int64]:
    """When each stretch of frames begins."""
    return START_NS + np.arange(POINTINGS, dtype=np.int64) * POINTING_NS


def chunks(frames: Iterator[tuple[int, NDArray[np.float64]]], protocol: Protocol, *, clock_s: float) -> Iterator[Chunk]:
    """The frames as a host reads them whose clock is ``clock_s`` fast."""
    for number, (utc_ns, xy_px) in enumerate(frames):
        message = PanoramaMessage(
            time_us=(utc_ns - START_NS) // 1000 + _POWER_ON_US,
            frame_no=number,
            exposure_s=_EXPOSURE_S,
            flags=frozenset(),
            temperature_c=20.0,
            xy_px=xy_px,
            index=np.rint(np.linspace(4000, 200, len(xy_px))),
        )
        arrived_ns = utc_ns + round(_EXPOSURE_S / 2 * NS_PER_S) + _BYTE_NS
        yield Chunk(
            arrived_ns + round(clock_s * NS_PER_S), arrived_ns - START_NS, protocol.encode(message, sequence=number)
        )


def _far_from(stars_px: NDArray[np.float64], count: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Places (count, 2) on the detector that no star is near."""
    places: list[NDArray[np.float64]] = []
    while len(places) < count:
        place = random.uniform(0, SIZE_PX - 1, 2)
        if np.hypot(*(stars_px - place).T).min(initial=np.inf) > _CLEAR_PX:
            places.append(place)
    return np.array(places).reshape(-1, 2)
