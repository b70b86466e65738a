"""The scene before the lens: stars, planets and satellites on the detector's plane, behind clouds."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.catalog import StarCatalog, load_catalog, merge_doubles
from gse.config.station import Station
from gse.simulator.scenario import Air, Motion, Scenario, SceneSection, profile_at
from gse.simulator.sky import CELL_NS, FIRST_PLANET, MOON, SUN, AstropySite, BodyCell, Sky, SkyCell, Track, bodies_over
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_S, to_julian_year
from gse.values.matrices import product
from gse.values.mount import Mount
from gse.values.screen import Screen

# Where a mount points: turns of the head, one after the other.
#
# Written from the words of gse.values.mount, not from gse.truth, so that the one can be tested by the other.


def horizon_to_sensor(mount: Mount) -> NDArray[np.float64]:
    """The matrix (3, 3) that takes horizon vectors (x east, y north, z up) to the sensor frame (right, down, out)."""
    # Look at the northern horizon, upright: right is east, down is below, out is north.
    upright_north = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    # Turn the head to the right by the azimuth, tilt it up, roll the image top to the left.
    to_the_right = _about(2, mount.azimuth_deg)
    tilt_up = _about(0, -mount.altitude_deg)
    roll_left = _about(2, mount.roll_deg)
    rotation: NDArray[np.float64] = product(roll_left, tilt_up, upright_north, to_the_right)
    return rotation


def _about(axis: int, angle_deg: float) -> NDArray[np.float64]:
    """The matrix (3, 3) that turns vectors about an axis, anticlockwise seen from its end."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    matrix = np.eye(3)
    matrix[[one, other], [one, other]] = cosine
    matrix[one, other], matrix[other, one] = -sine, sine
    return matrix


def moved_by(motion: Motion, since_start_s: float) -> NDArray[np.float64]:
    """The matrix (3, 3) from the sensor frame of the mount at rest to that of the moved one."""
    moved = np.array(motion.drift_arcsec_per_h) * (since_start_s / 3600)
    for at_s, *arcsec in motion.slips:
        moved += np.array(arcsec) * (since_start_s >= at_s)
    slow = math.sin(2 * math.pi * since_start_s / motion.sinusoid_period_s)
    quick = math.sin(2 * math.pi * since_start_s * motion.vibration_hz)
    moved[:2] += slow * np.array(motion.sinusoid_arcsec) + quick * np.array(motion.vibration_arcsec)
    if not moved.any():
        return np.eye(3)
    from scipy.spatial.transform import Rotation  # a quarter of a second, which a mount at rest need not wait

    along_columns, along_rows, about = moved * ARCSEC_RAD
    # A boresight that goes to larger columns leaves the old one at smaller ones.
    rotation: NDArray[np.float64] = Rotation.from_rotvec([along_rows, -along_columns, about]).as_matrix()
    return rotation


# Brightness of the sky: night, Moon and twilight, in magnitudes per square arcsecond.
#
# The Moon's glow follows Krisciunas & Schaefer 1991, PASP 103, 1033, equations 2, 3, 15, 20, 21 (some 20 % accurate).
# Twilight at the zenith is a parabola through Patat, Ugolnikov & Postylyakov 2006, A&A 455, 385 (V band, Sun 5 to 16
# deg down), drawn out in a straight line to sunset; its gradient towards the Sun is a rough guess.

DARK_MAGNITUDE = 21.3
"""Zenith of a moonless night at a good site, V per square arcsecond."""
EXTINCTION_PER_AIRMASS = 0.2
_BRIGHTEST_MAGNITUDE = 3.0
"""Clear daylight."""
_NANOLAMBERT_ZERO, _NANOLAMBERT_SLOPE, _NANOLAMBERT_UNIT = 20.7233, 0.92104, 34.08


def sky_magnitude(
    directions_horizon: NDArray[np.float64],
    bodies: BodyCell,
    utc_ns: int,
    dark_magnitude: float = DARK_MAGNITUDE,
    *,
    sunlight: bool = True,
) -> NDArray[np.float64]:
    """Surface brightness (N,) of the sky in directions (N, 3), x east, y north, z up; as at night without sunlight."""
    places = bodies.track.directions(utc_ns)
    light = _light(dark_magnitude * np.ones(len(directions_horizon)))
    if sunlight:
        light = light + _light(_twilight_magnitude(directions_horizon, places[SUN]))
    if places[MOON][2] > 0:
        light = light + _moonlight(directions_horizon, places[MOON], bodies.magnitude[MOON])
    magnitude = (_NANOLAMBERT_ZERO - np.log(light / _NANOLAMBERT_UNIT)) / _NANOLAMBERT_SLOPE
    return np.asarray(np.maximum(magnitude, _BRIGHTEST_MAGNITUDE), dtype=np.float64)


def airmass(directions_horizon: NDArray[np.float64]) -> NDArray[np.float64]:
    """Air masses (N,) in directions (N, 3): Krisciunas & Schaefer 1991, equation 3; 5 at the horizon."""
    sin2_zenith_distance = 1 - np.clip(directions_horizon[:, 2], 0, 1) ** 2
    return np.asarray((1 - 0.96 * sin2_zenith_distance) ** -0.5, dtype=np.float64)


def _light(magnitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nanolamberts of magnitudes per square arcsecond."""
    return np.asarray(_NANOLAMBERT_UNIT * np.exp(_NANOLAMBERT_ZERO - _NANOLAMBERT_SLOPE * magnitude))


def _moonlight(
    directions: NDArray[np.float64], moon: NDArray[np.float64], moon_magnitude: float
) -> NDArray[np.float64]:
    """Nanolamberts that the air scatters from the Moon."""
    cosine = np.clip(product(directions, moon), -1, 1)
    separation_deg = np.degrees(np.arccos(cosine))
    illuminance = 10 ** (-0.4 * (moon_magnitude + 16.57))
    scattering = 10**5.36 * (1.06 + cosine**2) + 10 ** (6.15 - separation_deg / 40)
    to_the_moon = 10 ** (-0.4 * EXTINCTION_PER_AIRMASS * airmass(moon[None])[0])
    not_let_through = 1 - 10 ** (-0.4 * EXTINCTION_PER_AIRMASS * airmass(directions))
    return np.asarray(scattering * illuminance * to_the_moon * not_let_through)


def _twilight_magnitude(directions: NDArray[np.float64], sun: NDArray[np.float64]) -> NDArray[np.float64]:
    down_deg = -math.degrees(math.asin(float(sun[2])))
    from_five = max(min(down_deg - 5, 12.0), -10.0)
    zenith = 11.84 + 1.518 * from_five - 0.057 * max(from_five, 0.0) ** 2 + 4 * max(down_deg - 17, 0.0)
    # Twice as bright some 40 deg off the zenith on the Sun's side, half as bright on the other.
    sunwards = product(directions[:, :2], sun[:2]) / max(float(np.hypot(sun[0], sun[1])), 1e-9)
    return np.asarray(zenith - 1.2 * sunwards, dtype=np.float64)


_CLOUD_PX = 300.0
"""Size of a cloud's structure, in pixels of 49 arcsec."""
_CLOUD_PIXEL_RAD = 2.4e-4
_MOON_MOVES_RAD = 0.05
_SKYLIGHT_EVERY_NS = 10_000_000_000
"""In 10 s a twilight sky changes by 0.06 mag."""
_BEYOND_RAD = 0.05
"""How far beyond the field a star simulator's stars are kept ready for a sensor that turns."""
_SAME_WITHIN_PX = 3.0
"""So near to a star an object is that star."""
_PX_PER_MAGNITUDE = 0.3
"""Of two stars so near it is the nearer one, unless the other is much brighter."""
_STEP_RAD = 1e-3
_CAPPED_MAGNITUDE = 40.0
"""Per square arcsecond: no light at all."""


@dataclass(frozen=True, slots=True, eq=False)
class Moon:
    """The Moon on the detector's plane: its middle and the unit vector to the Sun's side (both (2,), x and y)."""

    xy_px: NDArray[np.float64]
    radius_px: float
    sunwards: NDArray[np.float64]
    phase_rad: float
    magnitude: float


class SimulatedScene:
    """What the camera of a device looks at; stars closer than ``merged_within_px`` are one, as in the optics."""

    def __init__(
        self, station: Station, scenario: Scenario, random: np.random.Generator, merged_within_px: float = 0.0
    ) -> None:
        self.camera: Camera = station.sensor.camera()
        self.horizon_to_sensor = horizon_to_sensor(station.mount)
        self._scenario = scenario
        self._site = AstropySite(station.site)
        self._merged_within_rad = merged_within_px * self.camera.pixel_rad
        self._sky: Sky | None = None
        self._sky_faintest = -math.inf
        self._satellites = Satellites(self.camera, scenario, random)
        self._start_ns = scenario.start_utc_ns
        self._radius_rad = 0.55 * self.camera.diagonal_rad
        self._points: SkyCell | None = None
        self._faintest = -math.inf
        self._skylight: tuple[int, float] = (-1, 0.0)

    def since_start_s(self, utc_ns: int) -> float:
        """Seconds of the scenario."""
        return (utc_ns - self._start_ns) * 1e-9

    def objects(
        self, middle_ns: int, faintest_magnitude: float, offsets_ns: tuple[int, ...] = (0,)
    ) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """Pixels (N, 2) at each offset from an instant, and magnitudes (N,) behind air and clouds.

        Among them are objects that lie outside the detector; the row of an object is the same at each offset.
        """
        points = self._points_at(middle_ns, faintest_magnitude)
        places = [self._pixels(points, middle_ns + offset_ns) for offset_ns in offsets_ns]
        magnitude = self._through_air(points, middle_ns)
        satellites = [self._satellites.pixels(self.since_start_s(middle_ns + offset_ns)) for offset_ns in offsets_ns]
        magnitude = np.concatenate([magnitude, self._satellites.magnitude])
        places = [np.concatenate(pair) for pair in zip(places, satellites, strict=True)]
        if self.is_capped(middle_ns):
            return places, np.full(len(magnitude), np.inf)
        second = self.since_start_s(middle_ns)
        dew_magnitudes = profile_at(self._scenario.air.dew_magnitudes, second)
        return places, magnitude + dew_magnitudes + self.cloud_magnitudes(places[0], second)

    def stars_at(self, utc_ns: int, xy_px: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The number of the star that each object of an exposure is, by its pixels (N, 2), and how far it is from there
        in arcsec; 0 where there is none."""
        points = self._points_at(utc_ns, self._faintest) if len(xy_px) else None
        if points is None or not len(points.ids):
            return np.zeros(len(xy_px), dtype=np.int64), np.zeros(len(xy_px))
        off_px = np.hypot(*(xy_px[:, None] - self._pixels(points, utc_ns)).transpose(2, 0, 1))
        unlikely = np.where(off_px < _SAME_WITHIN_PX, off_px + _PX_PER_MAGNITUDE * points.magnitude, np.inf)
        star = unlikely.argmin(axis=1)
        off_px = off_px[np.arange(len(star)), star]
        ids = np.where(off_px < _SAME_WITHIN_PX, points.ids[star], 0)
        return ids, off_px * self.camera.pixel_rad / ARCSEC_RAD

    def bodies(self, utc_ns: int) -> BodyCell:
        """Sun, Moon and planets."""
        return bodies_over(self._site, utc_ns)

    def boresight_sky_magnitude(self, utc_ns: int) -> float:
        """Surface brightness of the sky in the middle of the detector."""
        step = utc_ns // _SKYLIGHT_EVERY_NS
        if self.is_capped(utc_ns):
            return _CAPPED_MAGNITUDE
        if step != self._skylight[0]:
            middle_ns = step * _SKYLIGHT_EVERY_NS + _SKYLIGHT_EVERY_NS // 2
            self._skylight = step, float(self.sky_magnitudes(self.horizon_to_sensor[2:], middle_ns)[0])
        return self._skylight[1]

    def sky_magnitudes(self, directions_horizon: NDArray[np.float64], utc_ns: int) -> NDArray[np.float64]:
        """Surface brightness (N,) of the sky in directions (N, 3)."""
        if self.is_capped(utc_ns):
            return np.full(len(directions_horizon), _CAPPED_MAGNITUDE)
        air = self._scenario.air
        return sky_magnitude(directions_horizon, self.bodies(utc_ns), utc_ns, air.dark_magnitude, sunlight=air.sunlight)

    def turns(self, utc_ns: int) -> bool:
        """Whether stars move over the detector by more than the sky turns."""
        return False

    def blur(self, utc_ns: int) -> float:
        """By how many times wider than in focus the image of a star is."""
        return profile_at(self._scenario.optics.defocus, self.since_start_s(utc_ns))

    def is_capped(self, utc_ns: int) -> bool:
        """Whether a cap or a cover is on the lens."""
        second = self.since_start_s(utc_ns)
        return any(begin <= second < end for begin, end in self._scenario.air.capped_s)

    def cloud_magnitudes(self, xy_px: NDArray[np.float64], since_start_s: float) -> NDArray[np.float64]:
        """Extinction (N,) of the clouds that drift before the pixels (N, 2)."""
        return cloud_magnitudes(xy_px * (self.camera.pixel_rad / _CLOUD_PIXEL_RAD), since_start_s, self._scenario.air)

    def moon(self, utc_ns: int) -> Moon | None:
        """The Moon where it is on the detector or near it and above the horizon."""
        bodies = self.bodies(utc_ns)
        # Within 300 s it moves by 1.3 deg.
        if self.is_capped(utc_ns) or product(bodies.track.nodes[0, MOON], self.horizon_to_sensor[2]) < math.cos(
            self._radius_rad + _MOON_MOVES_RAD
        ):
            return None
        places_horizon = bodies.track.directions(utc_ns)
        if places_horizon[MOON][2] <= 0:
            return None
        moon_sensor, sun_sensor = product(places_horizon[[MOON, SUN]], self.horizon_to_sensor.T)
        xy_px, nearer_px = self.camera.pixels(np.array([moon_sensor, moon_sensor + _STEP_RAD * sun_sensor]))
        sunwards = (nearer_px - xy_px) / max(float(np.hypot(*(nearer_px - xy_px))), 1e-9)
        radius_px = bodies.moon_radius_rad / self.camera.pixel_rad
        return Moon(xy_px, radius_px, sunwards, bodies.moon_phase_rad, float(bodies.magnitude[MOON]))

    def _points_at(self, utc_ns: int, faintest_magnitude: float) -> SkyCell:
        """Stars and planets of the cell of an instant."""
        points = self._points
        is_here = points is not None and 0 <= utc_ns - points.track.start_ns < CELL_NS
        if points is None or not is_here or faintest_magnitude > self._faintest:
            sky = self._sky_to(faintest_magnitude)
            stars = sky.cell(utc_ns, self.horizon_to_sensor[2], self._radius_rad, faintest_magnitude)
            bodies = self.bodies(utc_ns)
            nodes = np.concatenate([stars.track.nodes, bodies.track.nodes[:, FIRST_PLANET:]], axis=1)
            magnitude = np.concatenate([stars.magnitude, bodies.magnitude[FIRST_PLANET:]])
            ids = np.append(stars.ids, np.zeros(len(bodies.magnitude[FIRST_PLANET:]), dtype=np.int64))
            points = SkyCell(Track(stars.track.start_ns, nodes), magnitude, ids)
            self._points, self._faintest = points, faintest_magnitude
        return points

    def _through_air(self, points: SkyCell, utc_ns: int) -> NDArray[np.float64]:
        """Magnitudes (N,) as they are seen through the air; none of what is below the horizon."""
        directions = points.track.directions(utc_ns)
        magnitude = points.magnitude + EXTINCTION_PER_AIRMASS * (airmass(directions) - 1)
        return np.where(directions[:, 2] > 0, magnitude, np.inf)

    def _sky_to(self, faintest_magnitude: float) -> Sky:
        """The stars that are bright enough to matter: all of the catalogue would take 20 MB."""
        if self._sky is None or faintest_magnitude > self._sky_faintest:
            catalog = load_catalog(faintest_magnitude=faintest_magnitude).at_epoch(to_julian_year(self._start_ns))
            self._sky, self._sky_faintest = Sky(self._site, catalog, self._merged_within_rad), faintest_magnitude
        return self._sky

    def _pixels(self, points: SkyCell, utc_ns: int) -> NDArray[np.float64]:
        moved = product(moved_by(self._scenario.motion, self.since_start_s(utc_ns)), self.horizon_to_sensor)
        return self.camera.pixels(product(points.track.directions(utc_ns), moved.T))


class ShownScene(SimulatedScene):
    """What a star simulator shows: the catalogue's stars about a stated direction, without Earth, air, Sun or planets.

    The direction is ``mount.inertial`` of the station, or what the steps of the scenario's scene say. The lens may
    have a cap on, dew and dust before it, and the stand may move, as under the sky. The page draws for the ``stated``
    screen, and the station's own is the real one: where they differ, the stars stand elsewhere, later, and brighter or
    fainter.
    """

    def __init__(
        self,
        station: Station,
        scenario: Scenario,
        random: np.random.Generator,
        merged_within_px: float = 0.0,
        stated: Screen | None = None,
    ) -> None:
        super().__init__(station, scenario, random, merged_within_px)
        self._station = station
        self._drawn_for = stated if station.screen is not None and stated != station.screen else None
        self._catalog: StarCatalog | None = None
        self._picked_about = np.zeros(3)

    def icrs_to_sensor(self, utc_ns: int) -> NDArray[np.float64]:
        """The rotation (3, 3) that is shown at an instant."""
        return icrs_to_sensor(self._station, self._scenario, utc_ns)

    def sky_magnitudes(self, directions_horizon: NDArray[np.float64], utc_ns: int) -> NDArray[np.float64]:
        """Surface brightness (N,) of the black between the stars: that of the scenario's dark sky."""
        dark = _CAPPED_MAGNITUDE if self.is_capped(utc_ns) else self._scenario.air.dark_magnitude
        return np.full(len(directions_horizon), dark)

    def moon(self, utc_ns: int) -> Moon | None:
        """None is shown."""
        return None

    def turns(self, utc_ns: int) -> bool:
        """Whether the scene turns."""
        steps = self._scenario.scene.steps
        return bool(steps) and any(steps[step_at(self._scenario, utc_ns)[0]].turn_deg_per_s)

    def _points_at(self, utc_ns: int, faintest_magnitude: float) -> SkyCell:
        """The stars near the boresight; in ICRS they stand still, and the sensor turns."""
        boresight = self.icrs_to_sensor(utc_ns)[2]
        is_deep_enough = faintest_magnitude <= self._faintest
        if self._catalog is None or not is_deep_enough:
            self._catalog = scene_catalog(self._scenario.scene, self._start_ns, faintest_magnitude)
        points = self._points
        if points is None or not is_deep_enough or product(self._picked_about, boresight) < math.cos(_BEYOND_RAD):
            near = product(self._catalog.icrs, boresight) > math.cos(min(self._radius_rad + _BEYOND_RAD, math.pi))
            stars = self._catalog.rows(np.flatnonzero(near))
            if self._merged_within_rad > 0:
                stars = merge_doubles(stars, self._merged_within_rad)
            added_icrs, added_magnitude = added_objects(self._scenario.scene)
            nodes = np.concatenate([stars.icrs, added_icrs])
            magnitude = np.concatenate([stars.magnitude, added_magnitude])
            ids = np.append(stars.ids, np.zeros(len(added_magnitude), dtype=np.int64))
            points = SkyCell(Track(utc_ns, np.repeat(nodes[None], 4, axis=0)), magnitude, ids)
            self._points, self._faintest, self._picked_about = points, faintest_magnitude, boresight
        return points

    def objects(
        self, middle_ns: int, faintest_magnitude: float, offsets_ns: tuple[int, ...] = (0,)
    ) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """As under the sky; false objects stand still on the detector for as long as a step lasts."""
        places, magnitude = super().objects(middle_ns, faintest_magnitude, offsets_ns)
        scene = self._scenario.scene
        if not scene.false_objects or self.is_capped(middle_ns):
            return places, magnitude
        step, _ = step_at(self._scenario, middle_ns)
        false_px = false_places(scene, step, self.camera.columns, self.camera.rows)
        return [np.concatenate([xy, false_px]) for xy in places], np.concatenate([magnitude, false_magnitudes(scene)])

    def _through_air(self, points: SkyCell, utc_ns: int) -> NDArray[np.float64]:
        real, stated = self._station.screen, self._drawn_for
        if real is None or stated is None:
            return points.magnitude
        fainter = np.maximum(points.magnitude - stated.brightest_magnitude, 0.0)
        return np.asarray(stated.brightest_magnitude + fainter * real.gamma / stated.gamma)

    def _pixels(self, points: SkyCell, utc_ns: int) -> NDArray[np.float64]:
        moved = moved_by(self._scenario.motion, self.since_start_s(utc_ns))
        real, stated, stars = self._station.screen, self._drawn_for, points.track.nodes[0]
        if real is None or stated is None:
            return self.camera.pixels(product(stars, product(moved, self.icrs_to_sensor(utc_ns)).T))
        drawn_ns = utc_ns - round((real.latency_ms - stated.latency_ms) * 1e6)
        page_px = stated.camera().pixels(product(stars, _on_screen(self._station, self._scenario, drawn_ns).T))
        return self.camera.pixels(product(real.camera().directions(page_px), product(moved, _looks(real)).T))


def icrs_to_sensor(station: Station, scenario: Scenario, utc_ns: int) -> NDArray[np.float64]:
    """The rotation (3, 3) of what is shown to a sensor: its head turned from the vernal equinox, step by step.

    Written from the words of gse.values, not from gse.truth, as ``horizon_to_sensor`` is.
    """
    rotation = _on_screen(station, scenario, utc_ns)
    return rotation if station.screen is None else np.asarray(product(_looks(station.screen), rotation))


def _on_screen(station: Station, scenario: Scenario, utc_ns: int) -> NDArray[np.float64]:
    """The same of a sensor that looks straight at the middle of the screen."""
    shown = station.mount.inertial
    assert shown is not None
    if scenario.scene.steps:
        return _of_scene(scenario, utc_ns)
    since_h = (utc_ns - shown.at_utc_ns) / NS_PER_S / 3600  # arcsec/s are deg/h
    angles = zip((shown.ra_deg, shown.de_deg, shown.roll_deg), shown.rates_arcsec_per_s, strict=True)
    return _looking_at(*(angle + rate * since_h for angle, rate in angles))


def _looks(screen: Screen) -> NDArray[np.float64]:
    """How the sensor's head is turned before a screen."""
    looks = screen.to_sensor
    # To look further right is a turn about down, further down one against right.
    x, y = math.radians(looks.x_deg), math.radians(looks.y_deg)
    tilt = product(_about(0, math.degrees(math.atan(math.tan(y) * math.cos(x)))), _about(1, -looks.x_deg))
    return np.asarray(product(_about(2, looks.roll_deg), tilt))


def step_at(scenario: Scenario, utc_ns: int) -> tuple[int, float]:
    """Which step of the scene is shown at an instant, and since how many seconds; the last one stays."""
    since_s, steps = max((utc_ns - scenario.start_utc_ns) / NS_PER_S, 0.0), scenario.scene.steps
    for place, step in enumerate(steps):
        if since_s < step.for_s or place == len(steps) - 1:
            return place, since_s
        since_s -= step.for_s
    return 0, since_s


def _of_scene(scenario: Scenario, utc_ns: int) -> NDArray[np.float64]:
    place, since_s = step_at(scenario, utc_ns)
    step = scenario.scene.steps[place]
    rotation = _looking_at(step.ra_deg, step.de_deg, step.roll_deg)
    if not any(step.turn_deg_per_s):
        return rotation
    from scipy.spatial.transform import Rotation  # a quarter of a second, for scenes that turn only

    turned = Rotation.from_rotvec(np.radians(step.turn_deg_per_s) * since_s).inv().as_matrix()
    return np.asarray(product(turned, rotation))


def _looking_at(ra_deg: float, de_deg: float, roll_deg: float) -> NDArray[np.float64]:
    # Look at the equinox, upright: right is west (-y), down is south (-z), out is x.
    upright_equinox = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    # RA grows to the left as one looks at the sky; image up towards east is a roll to the left.
    rotation: NDArray[np.float64] = product(
        _about(2, roll_deg), _about(0, -de_deg), upright_equinox, _about(2, -ra_deg)
    )
    return rotation


def scene_of(
    station: Station,
    scenario: Scenario,
    random: np.random.Generator,
    merged_within_px: float = 0.0,
    drawn_for: Screen | None = None,
) -> SimulatedScene:
    """What the camera of a device looks at: the sky, or a star simulator where its mount is fixed to the stars.

    A page draws the stars for the screen ``drawn_for``, mostly the device's own.
    """
    if station.mount.inertial is None:
        return SimulatedScene(station, scenario, random, merged_within_px)
    return ShownScene(station, scenario, random, merged_within_px, drawn_for)


class Satellites:
    """Satellites that cross the field in straight lines, at times and on ways that the seed decides."""

    def __init__(self, camera: Camera, scenario: Scenario, random: np.random.Generator) -> None:
        air = scenario.air
        count = int(random.poisson(air.satellites_per_minute * scenario.seconds / 60))
        self._middle_s = random.uniform(0, scenario.seconds, count)
        self._middle_px = random.uniform(0, 1, (count, 2)) * (camera.columns, camera.rows)
        way = random.uniform(0, 2 * math.pi, count)
        speed_px_per_s = np.radians(random.uniform(0.3, 1.0, count)) / camera.pixel_rad
        self._velocity_px_per_s = speed_px_per_s[:, None] * np.column_stack([np.cos(way), np.sin(way)])
        self.magnitude = random.uniform(1.0, 5.0, count)

    def pixels(self, since_start_s: float) -> NDArray[np.float64]:
        """Where they are (N, 2), on the detector or off it."""
        after_middle_s = (since_start_s - self._middle_s)[:, None]
        places: NDArray[np.float64] = self._middle_px + self._velocity_px_per_s * after_middle_s
        return places


def cloud_magnitudes(xy: NDArray[np.float64], since_start_s: float, air: Air) -> NDArray[np.float64]:
    """Extinction of moving clouds: a sum of waves, cut so that it covers the share of the sky that is asked."""
    deepest = profile_at(air.cloud_magnitudes, since_start_s)
    if deepest <= 0:
        return np.zeros(len(xy))
    x, y = ((xy - np.multiply(air.cloud_drift_px_per_s, since_start_s)) / _CLOUD_PX).T
    wave = (np.sin(x + 0.7 * np.sin(y)) + np.sin(0.6 * x - 1.1 * y + 2.0)) / 4 + 0.5
    depth = np.clip((wave - (1 - air.cloud_cover)) * 4 + air.cloud_cover, 0, 1)
    return np.asarray(deepest * depth, dtype=np.float64)


# The stars that are shown: the catalogue's, with what the scene leaves out, moves and adds.


def scene_catalog(scene: SceneSection, utc_ns: int, faintest_magnitude: float) -> StarCatalog:
    """The catalogue's stars to a magnitude as the scene shows them, at the date of ``utc_ns``.

    The same star is dropped, or off by the same, whatever else is shown: its draw depends on its number alone.
    """
    catalog = load_catalog(faintest_magnitude=faintest_magnitude).at_epoch(to_julian_year(utc_ns))
    if not scene.dropped and not scene.noise_arcsec:
        return catalog
    draws = np.array([_draw(scene.seed, number) for number in catalog.ids.tolist()])
    kept = draws[:, 0] >= scene.dropped
    off = draws[kept, 1:4] * scene.noise_arcsec * ARCSEC_RAD
    stars = catalog.rows(np.flatnonzero(kept))
    moved = stars.icrs + off - (off * stars.icrs).sum(axis=1)[:, None] * stars.icrs
    return replace(stars, icrs=moved / np.linalg.norm(moved, axis=1)[:, None])


def _draw(seed: int, star: int) -> NDArray[np.float64]:
    """A uniform number and three normal ones of a star."""
    random = np.random.default_rng((seed, star & (1 << 63) - 1))
    return np.concatenate([random.random(1), random.normal(size=3)])


def added_objects(scene: SceneSection) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (N, 3) and magnitudes (N,) of what the scene adds among the stars."""
    ra, de = np.radians([(item.ra_deg, item.de_deg) for item in scene.objects]).reshape(-1, 2).T
    directions = np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    return directions, np.array([item.magnitude for item in scene.objects])


def false_places(scene: SceneSection, step: int, columns: int, rows: int) -> NDArray[np.float64]:
    """Pixels (N, 2) of the false objects of a step, of a detector or a screen of so many columns and rows."""
    random = np.random.default_rng((scene.seed, step))
    return np.asarray(random.random((scene.false_objects, 2)) * (columns - 1, rows - 1))


FALSE_MAGNITUDES = 2.0, 5.0
"""False objects are as bright as the stars of a field, evenly spread between these."""


def false_magnitudes(scene: SceneSection) -> NDArray[np.float64]:
    """Magnitudes (N,) of the false objects."""
    return np.linspace(*FALSE_MAGNITUDES, scene.false_objects)
