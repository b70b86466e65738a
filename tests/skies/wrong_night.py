"""A night by astropy alone over a station with something wrong, received by the station from the first byte on.

The sky is astropy's, the camera a pinhole (gse.inspection.made_session, which knows nothing of gse.truth). ``World``
is what is true; the station file is written from another one, the stated.
"""

import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drivers.chunk import Chunk
from drivers.clock import ClockReading
from gse.catalog import load_catalog
from gse.config.station import parse_station
from gse.inspection.made_session import AstropySky, MadeSensor, mounted
from gse.station.loop import StationLoop
from gse.station.session_data import SessionData
from gse.station.setup import Setup, set_up
from gse.values.constants import ARCSEC_RAD, EARTH_RATE_RAD_PER_S
from gse.values.instant import NS_PER_S, from_text
from gse.values.site import Site
from protocols import PanoramaMessage

_NODE_S = 100
"""Directions between are interpolated by cubics: within 1e-5 arcsec."""
_EXPOSURE_S, _LATENCY_S = 0.1, 0.05
_BYTE_S = 10 / 115_200
_MOST_OBJECTS = 30
_MERGED_PX = 2.0
_MAGNITUDE_NOISE, _DETECTION_MARGIN_MAG = 0.1, 0.3
_ZERO_POINT, _INDEX_MAX = 4000.0, 4095
_BRIGHT_MAG = 1.5
_HORIZON = 0.02


@dataclass(frozen=True)
class World:
    """Site, mount, camera, clock and sky as they are; changes over time begin at ``at_s`` from the start.

    ``wider_columns`` is by how much further apart than stated stars stand along a row of pixels, as a share.
    ``moves_arcsec_per_h`` and ``slip_arcsec`` turn the sensor along columns, rows and about the boresight, waves and
    vibration across it. ``wander`` is a correlated error across the boresight: arcsec, and its time constant in s.
    From ``at_s`` on frames are read ``late_s`` later.
    A station file that is ``vouched`` for states how well site and mount are known; the host's clock is synchronised.
    ``clouds`` are (from s, to s, magnitudes). A wall hides the pixels left of ``wall_px``, from ``at_s`` on; dew hides
    ``dew_share`` of the stars there, others in each frame.
    From ``frozen_from_s`` on the sensor sends one picture again and again.
    A drive turns the mount about the pole, westwards, ``driven`` times as fast as the Earth turns.
    """

    site: Site
    azimuth_deg: float
    altitude_deg: float
    roll_deg: float = 0.0
    size_px: int = 1024
    focal_length_px: float = 4169.9
    principal_point_px: tuple[float, float] = (0.0, 0.0)
    k1: float = 0.0
    wider_columns: float = 0.0
    mirrored: bool = False
    noise_px: float = 0.2
    whole_pixels: bool = True
    faintest_mag: float = 6.2
    hot_pixels: int = 0
    brightness: bool = True
    most_stars: int = _MOST_OBJECTS
    clock_s: float = 0.0
    clock_ppm: float = 0.0
    clock_step_s: float = 0.0
    late_s: float = 0.0
    at_s: float = 0.0
    slip_arcsec: tuple[float, ...] = (0.0, 0.0, 0.0)
    moves_arcsec_per_h: tuple[float, ...] = (0.0, 0.0, 0.0)
    wave_arcsec: tuple[float, ...] = (0.0, 0.0)
    wave_period_s: float = 600.0
    vibration_arcsec: float = 0.0
    vibration_hz: float = 3.3
    wander: tuple[float, float] = (0.0, 1.0)
    clouds: tuple[tuple[float, float, float], ...] = ()
    wall_px: float = 0.0
    dew_share: float = 1.0
    frozen_from_s: float = math.inf
    driven: float = 0.0
    vouched: bool = False

    def at(self, **changes: float) -> "World":
        """With another site: latitude_deg, longitude_deg, height_m, pressure_hpa, temperature_c."""
        return replace(self, site=replace(self.site, **changes))

    def sensor(self) -> MadeSensor:
        """On the mount, before anything moves."""
        axes = mounted(self.azimuth_deg, self.altitude_deg, self.roll_deg)
        return MadeSensor(axes, self.focal_length_px, self.size_px, self.k1, self.mirrored)

    def fast_s(self, time_s: float) -> float:
        """How fast the host's clock is."""
        return self.clock_s + 1e-6 * self.clock_ppm * time_s + (self.clock_step_s if time_s >= self.at_s else 0.0)


@dataclass(frozen=True)
class Plan:
    """When, how long and how often; of a ``raw`` capture all times are of the sensor's clock, which runs as ill."""

    start: str
    seconds: float
    rate_hz: float
    seed: int
    raw: bool = False


def session(stated: World, true: World, plan: Plan) -> SessionData:
    """What the station makes of a night under the true world when its file states another."""
    setup = _set_up(station_text(stated), plan.start)
    loop = StationLoop(setup, anchor_utc_ns=from_text(plan.start) if plan.raw else None)
    loop.take(list(_chunks(true, plan, setup)))
    loop.finish()
    if not loop.session.clock:
        loop.session.clock = [ClockReading(from_text(plan.start), 0, "kernel PLL", True, 0.0, 0.01)]
    return loop.session


def station_text(world: World) -> str:
    """The station file that says a world is so."""
    site, middle = world.site, (world.size_px - 1) / 2
    x, y = (middle + part for part in world.principal_point_px)
    air = f"pressure_hpa: {site.air_pressure_hpa}, temperature_c: {site.air_temperature_c}"
    air += ", uncertainty: {position_m: 20, pressure_hpa: 2}" if world.vouched else ""
    survey = ", uncertainty: {azimuth_arcsec: 8, altitude_arcsec: 8, roll_arcsec: 30}" if world.vouched else ""
    return f"""version: 1
sensor: {{name: made, rows: {world.size_px}, columns: {world.size_px}, focal_length_px: {world.focal_length_px},
         mirrored: {str(world.mirrored).lower()}, radial_distortion: [{world.k1}, 0], principal_point_px: [{x}, {y}]}}
site: {{latitude_deg: {site.latitude_deg}, longitude_deg: {site.longitude_deg}, height_m: {site.height_m}, {air}}}
mount: {{azimuth_deg: {world.azimuth_deg}, altitude_deg: {world.altitude_deg}, roll_deg: {world.roll_deg}{survey}}}
protocol: {"panorama-v1" if world.whole_pixels else "panorama-v1-subpixel"}
"""


@functools.lru_cache(maxsize=4)
def _set_up(text: str, start: str) -> Setup:
    return set_up(parse_station(text), text, utc_ns=from_text(start))


def _chunks(true: World, plan: Plan, setup: Setup) -> Iterator[Chunk]:
    rng = np.random.default_rng(plan.seed)
    start_ns, sequence = from_text(plan.start), itertools.count()
    kept = None
    for number, (time_s, xy_px, index) in enumerate(_frames(true, plan, start_ns, rng)):
        xy_px, index = kept if kept and time_s >= true.frozen_from_s else (xy_px, index)
        kept = xy_px, index
        message = PanoramaMessage(
            time_us=round((time_s + (true.fast_s(time_s) if plan.raw else 0.0)) * 1e6) + 1_000_000,
            frame_no=number,
            exposure_s=_EXPOSURE_S,
            flags=frozenset(),
            temperature_c=20 + 3 * math.sin(time_s / 900),
            xy_px=xy_px,
            index=index,
        )
        since_s = time_s + _LATENCY_S + _BYTE_S + rng.exponential(3e-4) + (true.late_s if time_s >= true.at_s else 0)
        read_ns = start_ns + round((since_s + true.fast_s(time_s)) * NS_PER_S)
        mono_ns = round((since_s + 3600) * NS_PER_S)
        yield Chunk(read_ns, mono_ns, setup.protocol.encode(message, sequence=next(sequence)))


def _frames(
    true: World, plan: Plan, start_ns: int, rng: np.random.Generator
) -> Iterator[tuple[float, NDArray[np.float64], NDArray[np.float64]]]:
    """Time in s, pixels (N, 2) and index values (N,) of each panorama."""
    time_s = np.arange(max(round(plan.seconds * plan.rate_hz), 2)) / plan.rate_hz
    directions, magnitudes = _stars(true, time_s, start_ns)
    turns = _turns(true, time_s, rng)
    hot = rng.integers(0, true.size_px, (true.hot_pixels, 2)).astype(float), rng.uniform(100, 2000, true.hot_pixels)
    for number, at_s in enumerate(time_s.tolist()):
        seen, sensor = directions(at_s), true.sensor()
        sensor = replace(sensor, axes=Rotation.from_rotvec(turns[number]).as_matrix() @ sensor.axes)
        sensor = replace(sensor, axes=sensor.axes @ _driven(true, at_s).T)
        inside = (seen @ sensor.axes[2] > 0.3) & (seen[:, 2] > _HORIZON)
        xy_px = sensor.pixels(seen[inside]) + true.principal_point_px
        xy_px[:, 0] += true.wider_columns * (xy_px[:, 0] - (true.size_px - 1) / 2)
        dimmed = sum(much for since, until, much in true.clouds if since <= at_s < until)
        faintness = magnitudes[inside] + dimmed + rng.normal(0, _MAGNITUDE_NOISE, int(inside.sum()))
        shown = ((xy_px > -0.5) & (xy_px < true.size_px - 0.5)).all(axis=1)
        if true.wall_px and at_s >= true.at_s:
            dewed = np.ones(len(shown), dtype=bool) if true.dew_share == 1 else rng.random(len(shown)) < true.dew_share
            shown &= (xy_px[:, 0] >= true.wall_px) | ~dewed
        shown &= faintness < true.faintest_mag - _DETECTION_MARGIN_MAG
        xy_px = xy_px[shown] + rng.normal(0, true.noise_px, (int(shown.sum()), 2))
        yield at_s, *_objects(true, xy_px, _ZERO_POINT * 10 ** (-0.4 * (faintness[shown] - _BRIGHT_MAG)), hot)


def _objects(
    true: World,
    xy_px: NDArray[np.float64],
    brightness: NDArray[np.float64],
    hot: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The brightest, one of a row of the detector at most; of two within two pixels only the brighter is there."""
    xy_px, brightness = np.concatenate([xy_px, hot[0]]), np.concatenate([brightness, hot[1]])
    order = np.argsort(-brightness, kind="stable")
    xy_px, brightness = xy_px[order], brightness[order]
    apart = np.linalg.norm(xy_px[:, None] - xy_px[None], axis=2)
    apart[np.tril_indices(len(xy_px))] = np.inf
    alone = ~(apart < _MERGED_PX).any(axis=0)
    xy_px, brightness = np.clip(xy_px[alone], 0, true.size_px - 1), brightness[alone]
    xy_px = np.rint(xy_px) if true.whole_pixels else xy_px
    first = np.unique(np.rint(xy_px[:, 1]), return_index=True)[1]
    kept = np.sort(first)[: true.most_stars]
    index = np.clip(np.rint(brightness[kept]), 1, _INDEX_MAX) if true.brightness else np.full(len(kept), 100.0)
    return xy_px[kept], index


def _stars(true: World, time_s: NDArray[np.float64], start_ns: int):
    """A function from time to directions (N, 3) of the stars that come into the field, and their magnitudes (N,)."""
    catalog = _catalog()
    nodes_ns = start_ns + np.arange(-1, int(time_s[-1] // _NODE_S) + 4) * _NODE_S * NS_PER_S
    sky, sensor = AstropySky(true.site), true.sensor()
    half_rad = math.hypot(1, 1) * true.size_px / 2 / true.focal_length_px + math.radians(1.0)
    boresight, _ = sky.boresight_and_up(np.broadcast_to(sensor.axes, (len(nodes_ns), 3, 3)), nodes_ns)
    near = (catalog.magnitude <= true.faintest_mag) & ((catalog.icrs @ boresight.T).max(axis=1) > math.cos(half_rad))
    seen = sky.seen(catalog.icrs[near], nodes_ns)

    def directions(at_s: float) -> NDArray[np.float64]:
        node = int(at_s // _NODE_S)
        x = at_s / _NODE_S - node
        weights = (-x * (x - 1) * (x - 2) / 6, (x + 1) * (x - 1) * (x - 2) / 2,
                   -(x + 1) * x * (x - 2) / 2, (x + 1) * x * (x - 1) / 6)  # fmt: skip
        return np.tensordot(weights, seen[node : node + 4], 1)

    return directions, catalog.magnitude[near]


@functools.lru_cache(maxsize=1)
def _catalog():
    return load_catalog(faintest_magnitude=8.0).at_epoch(2026.3)


def _driven(true: World, at_s: float) -> NDArray[np.float64]:
    """The rotation (3, 3) of the horizon frame by which the drive has turned the mount."""
    latitude = math.radians(true.site.latitude_deg)
    west_rad = true.driven * EARTH_RATE_RAD_PER_S * at_s
    return Rotation.from_rotvec([0.0, -west_rad * math.cos(latitude), -west_rad * math.sin(latitude)]).as_matrix()


def _turns(true: World, time_s: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Rotation vectors (M, 3) in rad, in the horizon frame, of what moves the sensor on its mount."""
    late = (time_s >= true.at_s).astype(float)
    shifts = np.outer(late, true.slip_arcsec) + np.outer(time_s / 3600, true.moves_arcsec_per_h)
    wave = np.sin(2 * math.pi * time_s / true.wave_period_s + rng.uniform(0, 2 * math.pi))
    shifts[:, :2] += np.outer(wave, true.wave_arcsec)
    phases = 2 * math.pi * true.vibration_hz * time_s[:, None] + np.array([0.0, 1.0])
    shifts[:, :2] += true.vibration_arcsec * math.sqrt(2) * np.sin(phases)
    shifts[:, :2] += _wander(true, time_s, rng)
    right, up, out = true.sensor().axes
    return ARCSEC_RAD * (shifts @ np.array([up, right, out]))


def _wander(true: World, time_s: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    size, lasts_s = true.wander
    kept = math.exp(-float(time_s[1]) / lasts_s)
    fresh = (
        rng.normal(0, size, (len(time_s), 2)) * np.r_[1.0, np.full(len(time_s) - 1, math.sqrt(1 - kept**2))][:, None]
    )
    return np.array(list(itertools.accumulate(fresh, lambda before, new: kept * before + new)))
