"""Made sessions: the frames of a sensor with a known error, as its bytes come over the wire.

The night is one of the past, so that every installation has measured Earth orientation for it; the sky turns by 105 deg
over the fixed mount.
"""

import contextlib
import functools
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import astropy.units as u
import numpy as np
from astropy.coordinates import AltAz, EarthLocation, SkyCoord
from astropy.time import Time, TimeDelta
from astropy.utils import iers
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drivers.chunk import Chunk
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_DAY, NS_PER_S, UNIX_EPOCH_MJD, from_text
from gse.values.site import Site
from protocols import AttitudeMessage, Message, PanoramaMessage, Protocol

# The sky over a site by astropy's high-level frames alone: SkyCoord to AltAz and back.
#
# Nothing here comes from gse.truth or gse.simulator, so that either can be tested by it.

_NEAR = 1e-3
_WAVELENGTH_UM = 0.6
"""Where a silicon detector sees stars."""


class AstropySky:
    """The sky over a site; horizon directions are unit vectors, x east, y north, z up."""

    def __init__(self, site: Site) -> None:
        self._location = EarthLocation.from_geodetic(
            site.longitude_deg * u.deg, site.latitude_deg * u.deg, site.height_m * u.m
        )
        self._air = {
            "pressure": site.pressure_hpa * u.hPa,
            "temperature": site.temperature_c * u.deg_C,
            "relative_humidity": site.relative_humidity,
            "obswl": _WAVELENGTH_UM * u.um,
        }

    def seen(self, stars_icrs: NDArray[np.float64], utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Directions (M, N, 3) in which stars (N, 3) are seen at instants (M,): aberrated and refracted."""
        with installed_tables():
            stars = SkyCoord(*np.asarray(stars_icrs).T, representation_type="cartesian", frame="icrs").spherical
            seen = SkyCoord(stars.lon[None], stars.lat[None], frame="icrs").transform_to(
                self._horizon(np.asarray(utc_ns)[:, None], self._air)
            )
            azimuth, altitude = seen.az.rad, seen.alt.rad
        level = np.cos(altitude)
        return np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(altitude)], axis=-1)

    def boresight_and_up(
        self, axes: NDArray[np.float64], utc_ns: NDArray[np.int64], *, air: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """ICRS directions (M, 3) of sensors' axes (M, 3, 3), which are right, up and out.

        Up is taken close to the boresight: aberration keeps angles there, and 90 deg away it does not. It is the mean
        of what up and right show: refraction shears the field, and a shear is not a turn.
        """
        right, up, out = np.moveaxis(axes, 1, 0)
        near = np.stack([out, out + _NEAR * up, out + _NEAR * right], axis=1)
        boresight, above, beside = np.moveaxis(self._icrs(near, utc_ns, self._air if air else {}), 1, 0)
        upwards = _unit(above - boresight * (above * boresight).sum(axis=1)[:, None])
        rightwards = _unit(beside - boresight * (beside * boresight).sum(axis=1)[:, None])
        return boresight, _unit(upwards + np.cross(rightwards, boresight))

    def fitted_boresight_and_up(
        self, axes: NDArray[np.float64], field: NDArray[np.float64], utc_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """As ``boresight_and_up`` through the air, by Wahba's least squares over the stars of a field.

        ``field`` (N, 3) are directions in components along right, up and out. What is low is lifted by more, so that
        the whole field has another mean than its middle.
        """
        stars = self._icrs(field @ axes, utc_ns, self._air)
        u, _, vt = np.linalg.svd(np.einsum("mni,nj->mij", stars, field))
        u[:, :, 2] *= (np.linalg.det(u @ vt) * np.linalg.det(axes))[:, None]  # right, up and out are left-handed
        rotations = u @ vt
        return rotations[:, :, 2], rotations[:, :, 1]

    def _icrs(
        self, directions: NDArray[np.float64], utc_ns: NDArray[np.int64], air: dict[str, Any]
    ) -> NDArray[np.float64]:
        east, north, up = np.moveaxis(np.asarray(directions), -1, 0)
        with installed_tables():
            frame = self._horizon(np.asarray(utc_ns)[:, None], air)
            looked = SkyCoord(
                az=np.arctan2(east, north) * u.rad, alt=np.arctan2(up, np.hypot(east, north)) * u.rad, frame=frame
            )
            return np.moveaxis(looked.icrs.cartesian.xyz.value, 0, -1)

    def _horizon(self, utc_ns: NDArray[np.int64], air: dict[str, Any]) -> AltAz:
        """Midnight plus SI seconds, since a day may have 86,401."""
        days, ns = np.divmod(utc_ns, NS_PER_DAY)
        midnight = Time((days + UNIX_EPOCH_MJD).astype(np.float64), format="mjd", scale="utc")
        return AltAz(
            obstime=(midnight.tai + TimeDelta(ns / NS_PER_S, format="sec")).utc, location=self._location, **air
        )


def east_and_north(directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """East and north (M, 3) at ICRS directions (M, 3), away from the poles."""
    east = _unit(np.cross([0.0, 0.0, 1.0], directions))
    return east, np.cross(directions, east)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    unit: NDArray[np.float64] = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return unit


@contextlib.contextmanager
def installed_tables() -> Iterator[None]:
    """The IERS tables that are installed: never a download, and no question for the host's date."""
    with (
        iers.conf.set_temp("auto_download", False),
        iers.conf.set_temp("auto_max_age", None),
        iers.earth_orientation_table.set(_table()),
    ):
        yield


@functools.lru_cache(maxsize=1)
def _table() -> iers.IERS_A:
    return iers.IERS_A.read(iers.IERS_A_FILE)


# The known errors that a self-check injects, one session for each.


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownError:
    """A made session of a sensor that differs from its station file by what is named here.

    ``azimuth_arcsec`` is how far the boresight lies in azimuth, measured on the sky, ``poleward_arcsec`` how far
    towards the celestial pole, growing by ``poleward_arcsec_per_h`` through the middle of the session; ``roll_arcsec``
    turns image up counter-clockwise as seen in the sky; ``clock_s`` is how fast the host's clock is. ``focal_share`` is
    the error of the focal length, ``noise_px`` the standard deviation of a position on each axis, ``false_objects`` how
    many objects of each frame are not stars. The first ``blank`` of the ``frames`` of each stretch show no object.
    ``own_east_arcsec`` is how far the sensor's own answers lie to the east, None where it sends none, and the first
    ``own_false`` of each stretch are false.
    """

    name: str
    frames: int = 12
    azimuth_arcsec: float = 0.0
    poleward_arcsec: float = 0.0
    poleward_arcsec_per_h: float = 0.0
    roll_arcsec: float = 0.0
    clock_s: float = 0.0
    focal_share: float = 0.0
    noise_px: float = 0.0
    false_objects: int = 0
    blank: int = 0
    own_east_arcsec: float | None = None
    own_false: int = 0


KNOWN_ERRORS = (
    KnownError(name="no error"),
    KnownError(name="mount in azimuth", azimuth_arcsec=30.0),
    KnownError(name="boresight to the pole", poleward_arcsec=20.0),
    KnownError(name="mount drifts to the pole", poleward_arcsec_per_h=10.0),
    KnownError(name="sensor roll", roll_arcsec=600.0),
    KnownError(name="clock is fast", clock_s=0.5),
    KnownError(name="focal length", frames=4, focal_share=0.003),
    KnownError(name="position noise", frames=200, noise_px=0.2),
    KnownError(name="false objects", false_objects=3),
    KnownError(name="frames without objects", blank=1),
    KnownError(name="the sensor's own answers", own_east_arcsec=15.0, own_false=1),
)
"""Every error alone, so that what is found wrong names its cause."""


# A made sensor on a made mount: directions in the horizon frame to pixels.
#
# Written from the words of docs/station-file.md, not from gse.values.camera or gse.truth, so that either can be
# tested by it.

_ROUNDS = 30
_BORDER_PX = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class MadeSensor:
    """A square detector behind a pinhole; ``axes`` (3, 3) are right, up and out of the boresight, in rows.

    ``radial_distortion`` is k1 alone.
    """

    axes: NDArray[np.float64]
    focal_length_px: float
    size_px: int
    radial_distortion: float = 0.0
    mirrored: bool = False

    def turned(self, axis: NDArray[np.float64], angle_rad: float) -> "MadeSensor":
        """The sensor after a right-handed turn about a direction (3,) of the horizon frame."""
        turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle_rad)
        return replace(self, axes=turn.apply(self.axes))

    def pixels(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (..., 2) of directions (..., 3): x to the right, y down."""
        right, up, out = self.axes
        plane = np.stack([directions @ right, -(directions @ up)], axis=-1) / (directions @ out)[..., None]
        plane = plane * self.focal_length_px
        if self.radial_distortion:
            plane = self._distorted(plane)
        if self.mirrored:
            plane = plane * [-1, 1]
        xy_px: NDArray[np.float64] = plane + (self.size_px - 1) / 2
        return xy_px

    def sees(self, directions: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which directions (..., 3) fall well inside the detector."""
        xy_px = self.pixels(directions)
        inside = (xy_px > _BORDER_PX) & (xy_px < self.size_px - 1 - _BORDER_PX)
        return np.asarray(inside.all(axis=-1) & (directions @ self.axes[2] > 0), dtype=bool)

    def _distorted(self, undistorted: NDArray[np.float64]) -> NDArray[np.float64]:
        distorted = undistorted
        for _ in range(_ROUNDS):
            s2 = (distorted**2).sum(axis=-1, keepdims=True) / (self.size_px / 2) ** 2
            distorted = undistorted / (1 + self.radial_distortion * s2)
        return distorted


def mounted(azimuth_deg: float, altitude_deg: float, roll_deg: float) -> NDArray[np.float64]:
    """The axes of a sensor on a mount; the roll turns image up counter-clockwise, as seen in the sky."""
    a, h, roll = np.radians([azimuth_deg, altitude_deg, roll_deg])
    out = np.array([np.cos(h) * np.sin(a), np.cos(h) * np.cos(a), np.sin(h)])
    zenithwards = np.array([-np.sin(h) * np.sin(a), -np.sin(h) * np.cos(a), np.cos(h)])
    rightwards = np.array([np.cos(a), -np.sin(a), 0.0])
    up = np.cos(roll) * zenithwards - np.sin(roll) * rightwards
    right = np.cos(roll) * rightwards + np.sin(roll) * zenithwards
    return np.array([right, up, out])


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
"""The station file of the made sensor."""

_STARS = 25
_EXPOSURE_S = 0.1
_BYTE_NS = 10 * NS_PER_S // 115_200
_POWER_ON_US = 1_000_000
_TEMPERATURE_C = 20.0
_LATENCY_S = 0.02
_INDEX = 4000, 200
_FALSE_BY_DEG = 2.0
_CLEAR_PX = 20.0
_GRID = 9
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


Angles = tuple[float, float, float]
"""RA, DE and roll in degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class MadeFrame:
    """The objects (N, 2) of a frame, brightest first, and the sensor's own answer, with their true UTC."""

    utc_ns: int
    xy_px: NDArray[np.float64]
    own: Angles | None


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

    def frames(self, error: KnownError, seed: int) -> Iterator[MadeFrame]:
        """The frames of a sensor with a known error."""
        random = np.random.default_rng(seed)
        for instants, seen in zip(self._instants[:, : error.frames], self._seen, strict=True):
            answers = own_answers(self.sky, error, instants)
            for number, (utc_ns, answer) in enumerate(zip(instants.tolist(), answers, strict=True)):
                directions = seen[number] if number >= error.blank else seen[number][:0]
                xy_px = true_sensor(error, utc_ns).pixels(directions)
                xy_px = xy_px + random.normal(0, error.noise_px, xy_px.shape)
                objects_px = np.concatenate([xy_px, _far_from(xy_px, error.false_objects, random)])
                yield MadeFrame(utc_ns, objects_px, answer)

    def _fields(self, sensor: MadeSensor, utc_ns: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """The rows of the brightest stars that a sensor sees at each instant (M,)."""
        seen = sensor.sees(self.sky.seen(self._stars, utc_ns))
        return [np.flatnonzero(inside)[:_STARS] for inside in seen]


def own_answers(sky: AstropySky, error: KnownError, utc_ns: NDArray[np.int64]) -> list[Angles | None]:
    """What the sensor answers itself at instants (M,): the attitude that fits the catalogue places over its field."""
    if error.own_east_arcsec is None:
        return [None] * len(utc_ns)
    axes = np.array([true_sensor(error, instant).axes for instant in utc_ns.tolist()])
    boresight, up = sky.fitted_boresight_and_up(axes, _field(), utc_ns)
    boresight = boresight + error.own_east_arcsec * ARCSEC_RAD * east_and_north(boresight)[0]
    east, north = east_and_north(boresight)  # the meridian there has another direction
    roll_deg = np.degrees(np.arctan2((up * east).sum(axis=1), (up * north).sum(axis=1)))
    x, y, z = boresight.T
    de_deg = np.degrees(np.arctan2(z, np.hypot(x, y)))
    de_deg[: error.own_false] += _FALSE_BY_DEG
    angles = zip((np.degrees(np.arctan2(y, x)) % 360).tolist(), de_deg.tolist(), (roll_deg % 360).tolist(), strict=True)
    return list(angles)


def _field() -> NDArray[np.float64]:
    """Directions (N, 3) evenly over the detector, along right, up and out."""
    across = (np.arange(_GRID) + 0.5 - _GRID / 2) * SIZE_PX / _GRID / FOCAL_LENGTH_PX
    right, up = np.meshgrid(across, across)
    directions = np.stack([right, up, np.ones_like(right)], axis=-1).reshape(-1, 3)
    return np.asarray(directions / np.linalg.norm(directions, axis=1)[:, None])


def begins_ns() -> NDArray[np.int64]:
    """When each stretch of frames begins."""
    return START_NS + np.arange(POINTINGS, dtype=np.int64) * POINTING_NS


def chunks(frames: Iterable[MadeFrame], protocol: Protocol, *, clock_s: float) -> Iterator[Chunk]:
    """The frames as a host reads them whose clock is ``clock_s`` fast."""
    sequence = itertools.count()
    for number, frame in enumerate(frames):
        data = b"".join(protocol.encode(message, sequence=next(sequence)) for message in _messages(frame, number))
        arrived_ns = frame.utc_ns + round(_EXPOSURE_S / 2 * NS_PER_S) + _BYTE_NS
        yield Chunk(arrived_ns + round(clock_s * NS_PER_S), arrived_ns - START_NS, data)


def _messages(frame: MadeFrame, number: int) -> Iterator[Message]:
    time_us = (frame.utc_ns - START_NS) // 1000 + _POWER_ON_US
    yield PanoramaMessage(
        time_us=time_us,
        frame_no=number,
        exposure_s=_EXPOSURE_S,
        flags=frozenset(),
        temperature_c=_TEMPERATURE_C,
        xy_px=frame.xy_px,
        index=np.rint(np.linspace(*_INDEX, len(frame.xy_px))),
    )
    if frame.own is not None:
        ra_deg, de_deg, roll_deg = frame.own
        yield AttitudeMessage(
            time_us, ra_deg, de_deg, roll_deg, frame_no=number, matched=_STARS, state="acquired", latency_s=_LATENCY_S
        )


def _far_from(stars_px: NDArray[np.float64], count: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Places (count, 2) on the detector that no star is near."""
    places: list[NDArray[np.float64]] = []
    while len(places) < count:
        place = random.uniform(0, SIZE_PX - 1, 2)
        if np.hypot(*(stars_px - place).T).min(initial=np.inf) > _CLEAR_PX:
            places.append(place)
    return np.array(places).reshape(-1, 2)
