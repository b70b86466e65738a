"""Nights with one thing wrong, the right word and the first cause written beside each before it was run.

    python benchmarks/wrong_nights.py [--seeds 2] [--only jolt] [--clean 20] [--keep FOLDER]

Nothing of the station's own simulator, truth or protocols makes them: the sky is astropy's, the frames are written from
the byte table of the interface control document, and only the places of the catalogue's stars come from ``gse catalog
export``. Each night is a raw capture with a station file, replayed as an operator would.
"""

import argparse
import contextlib
import csv
import functools
import io
import json
import re
import struct
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import astropy.units as u
import numpy as np
from astropy.constants import c
from astropy.coordinates import FK5, AltAz, EarthLocation, SkyCoord, get_body, get_body_barycentric_posvel
from astropy.time import Time, TimeDelta
from astropy.utils import iers
from scipy.spatial.transform import Rotation

from gse.cli import main as gse

ARCSEC = np.pi / 180 / 3600
NODE_S, FAINTEST_MAG, SIZE_PX, FOCAL_PX = 60.0, 6.2, 1024, 4169.905
PASS, FAIL, OPEN = "PASS", "FAIL", "INCONCLUSIVE"
ANY = ""


@dataclass
class Frame:
    """One exposure: what the detector shows, and the sensor's own answer (RA, DE, roll in deg) where it sends one."""

    time_s: float
    number: int
    xy_px: np.ndarray
    index: np.ndarray
    own_deg: list[float] | None = None
    acquired: bool = True
    status: int = 0
    sent: bool = True
    alone: bool = False
    quaternion: tuple[float, ...] | None = None


Frames = list[Frame]
Meddle = Callable[[Frames, np.random.Generator], Frames | None]


@dataclass(frozen=True)
class Night:
    """What is true, what is stated otherwise, and what must come out.

    ``words`` are the right ones; ``cause`` are patterns, with ``or`` between them, of the first finding, or
    of the first reason after ``reason:``.
    ``place`` is what is true otherwise than in TRUE. ``turn_arcsec`` gives from the time what turns the sensor about
    its columns, rows and boresight.
    """

    name: str
    words: tuple[str, ...]
    cause: str = ""
    stated: dict[str, object] = field(default_factory=dict)
    vouched: bool = False
    clock: str = "1ms"
    start: str = "2026-03-20T15:00:00"
    frames: int = 400
    step_s: float = 0.5
    own: bool = False
    turn_arcsec: Callable[[float], tuple[float, float, float]] = lambda time_s: (0.0, 0.0, 0.0)
    dim_mag: Callable[[float], float] = lambda time_s: 0.0
    hidden: Callable[[np.ndarray, float], np.ndarray] | None = None
    meddle: Meddle | None = None
    start_off_s: float = 0.0
    command: str = ""
    noise_px: float = 0.1
    place: dict[str, object] = field(default_factory=dict)
    alone: bool = False
    quaternions: bool = False


TRUE = {
    "rows": SIZE_PX, "columns": SIZE_PX, "focal_length_px": FOCAL_PX, "principal_point_px": [511.5, 511.5],
    "mirrored": "false", "latitude_deg": -6.53, "longitude_deg": 106.7, "height_m": 200.0, "pressure_hpa": 985.0,
    "temperature_c": 24.0, "azimuth_deg": 40.0, "altitude_deg": 62.0, "roll_deg": 20.0,
}  # fmt: skip
SENSOR = ("rows", "columns", "focal_length_px", "principal_point_px", "mirrored")
MOUNT = ("azimuth_deg", "altitude_deg", "roll_deg")
SITE = ("latitude_deg", "longitude_deg", "height_m", "pressure_hpa", "temperature_c")


def station_text(night: Night) -> str:
    """The station file of a night, as it is stated."""
    stated = {**TRUE, **night.place, **night.stated}
    sensor, site = (", ".join(f"{key}: {stated[key]}" for key in keys) for keys in (SENSOR, SITE))
    mount = ", ".join(f"{key}: {stated[key]}" for key in MOUNT)
    if night.vouched:
        site += ", uncertainty: {position_m: 20}"
        mount += ", uncertainty: {azimuth_arcsec: 8, altitude_arcsec: 8, roll_arcsec: 30}"
    return f"""version: 1
sensor: {{name: made, {sensor}}}
site: {{name: roof, {site}, relative_humidity: 0.8}}
mount: {{{mount}}}
port: {{url: "loop://", baudrate: 115200}}
protocol: {protocol_of(night)}
{f"identifier: {{algorithm: external, command: {json.dumps(night.command.split())}}}" if night.command else ""}
"""


def protocol_of(night: Night) -> str:
    if night.quaternions:
        return "{folder}/quaternion.yaml"
    return "{folder}/alone.yaml" if night.alone else "panorama-v1-subpixel"


# The sky


@functools.lru_cache(maxsize=1)
def catalog() -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 3) in ICRS at 2026.2, and magnitudes (N,)."""
    with tempfile.TemporaryDirectory() as folder:
        station, stars = Path(folder) / "station.yaml", Path(folder) / "stars.csv"
        station.write_text(station_text(Night("", ())))
        run("catalog", "export", "--station", str(station), "--list", str(stars), "--epoch", "2026.2")
        lines = [line for line in stars.read_text().splitlines() if line and not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    ra, de, magnitude = (np.array([float(row[key]) for row in rows]) for key in COLUMNS_OF_LIST)
    ra, de = np.radians(ra), np.radians(de)
    return np.column_stack([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)]), magnitude


COLUMNS_OF_LIST = ("ra_deg", "de_deg", "magnitude")


def horizon(site: dict[str, object], start: str, seconds: np.ndarray, icrs: np.ndarray) -> np.ndarray:
    """Directions (M, N, 3), east, north, up, in which stars are seen at so many seconds from the start."""
    place = EarthLocation.from_geodetic(
        site["longitude_deg"] * u.deg, site["latitude_deg"] * u.deg, site["height_m"] * u.m
    )
    instants = (Time(start, scale="utc").tai + TimeDelta(seconds, format="sec")).utc
    air = {"pressure": site["pressure_hpa"] * u.hPa, "temperature": site["temperature_c"] * u.deg_C}
    frame = AltAz(obstime=instants[:, None], location=place, relative_humidity=0.8, obswl=0.6 * u.um, **air)
    stars = SkyCoord(*icrs.T, representation_type="cartesian", frame="icrs").spherical
    seen = SkyCoord(stars.lon[None], stars.lat[None], frame="icrs").transform_to(frame)
    azimuth, altitude = seen.az.rad, seen.alt.rad
    level = np.cos(altitude)
    return np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(altitude)], axis=-1)


def axes_of(azimuth_deg: float, altitude_deg: float, roll_deg: float) -> np.ndarray:
    """Columns, rows and boresight (3, 3) of the sensor in the horizon frame."""
    a, h, r = np.radians([azimuth_deg, altitude_deg, roll_deg])
    out = np.array([np.cos(h) * np.sin(a), np.cos(h) * np.cos(a), np.sin(h)])
    zenith, right = np.array([-np.sin(h) * np.sin(a), -np.sin(h) * np.cos(a), np.cos(h)]), np.zeros(3)
    right[:2] = np.cos(a), -np.sin(a)
    up = np.cos(r) * zenith - np.sin(r) * right
    return np.array([np.cos(r) * right + np.sin(r) * zenith, -up, out])


def turned(axes: np.ndarray, arcsec: tuple[float, float, float]) -> np.ndarray:
    """The axes after a turn about themselves."""
    x, y, z = np.asarray(arcsec) * ARCSEC
    angle = float(np.hypot(np.hypot(x, y), z))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle == 0:
        return axes
    turn = np.eye(3) + np.sin(angle) / angle * cross + (1 - np.cos(angle)) / angle**2 * cross @ cross
    return turn.T @ axes


def exposures(night: Night, rng: np.random.Generator) -> Frames:
    """The frames of a night before anybody meddles with them."""
    seconds = np.arange(night.frames) * night.step_s
    nodes = np.arange(-1, int(seconds[-1] // NODE_S) + 4) * NODE_S
    true = {**TRUE, **night.place}
    site, axes = {key: true[key] for key in SITE}, axes_of(*(true[key] for key in MOUNT))
    icrs, magnitudes = catalog()
    first = horizon(site, night.start, nodes[[0, -1]], icrs)
    near = (first @ axes[2] > np.cos(np.radians(36))).any(axis=0) & (magnitudes < FAINTEST_MAG)
    icrs, magnitudes = icrs[near], magnitudes[near]
    grid = horizon(site, night.start, nodes, icrs)
    frames = []
    for number, at_s in enumerate(seconds.tolist()):
        node, x = int(at_s // NODE_S), at_s / NODE_S % 1
        weights = (-x * (x - 1) * (x - 2) / 6, (x + 1) * (x - 1) * (x - 2) / 2,
                   -(x + 1) * x * (x - 2) / 2, (x + 1) * x * (x - 1) / 6)  # fmt: skip
        sensor = np.tensordot(weights, grid[node : node + 4], 1) @ turned(axes, night.turn_arcsec(at_s)).T
        frames.append(one_exposure(night, number, at_s, sensor, icrs, magnitudes, rng))
    return frames


def one_exposure(
    night: Night, number: int, at_s: float, sensor: np.ndarray, icrs: np.ndarray, magnitudes: np.ndarray,
    rng: np.random.Generator,
) -> Frame:  # fmt: skip
    xy = FOCAL_PX * sensor[:, :2] / np.where(sensor[:, 2:] > 0.5, sensor[:, 2:], np.nan) + 511.5
    inside = ((xy > 0) & (xy < SIZE_PX - 1)).all(axis=1)
    own = None
    if night.own:
        vectors = sensor[inside] / np.linalg.norm(sensor[inside], axis=1)[:, None]
        left, _, right = np.linalg.svd(vectors.T @ icrs[inside])
        attitude = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
        own = angles_of(turned(attitude, tuple(rng.normal(0, [2, 2, 20]))))
    seen = magnitudes + rng.normal(0, 0.1, len(magnitudes)) + night.dim_mag(at_s)
    inside &= seen < FAINTEST_MAG - 0.4
    if night.hidden is not None:
        inside &= ~night.hidden(xy, at_s)
    order = np.flatnonzero(inside)[np.argsort(seen[inside], kind="stable")]
    alone = [k for n, k in enumerate(order) if (np.hypot(*(xy[order[:n]] - xy[k]).T) > 2).all()][:30]
    places = xy[alone] + rng.normal(0, night.noise_px, (len(alone), 2))
    index = np.clip(np.rint(4000 * 10 ** (-0.4 * (seen[alone] - 1.5))), 1, 4095)
    return Frame(at_s, number, places, index, own, alone=night.alone)


def angles_of(icrs_to_sensor: np.ndarray) -> list[float]:
    """RA, DE and roll in deg: roll is the position angle of image up."""
    out, up = icrs_to_sensor[2], -icrs_to_sensor[1]
    ra, de = np.arctan2(out[1], out[0]), np.arcsin(out[2])
    east = np.array([-np.sin(ra), np.cos(ra), 0])
    north = np.array([-np.sin(de) * np.cos(ra), -np.sin(de) * np.sin(ra), np.cos(de)])
    return [float(np.degrees(angle)) for angle in (ra % (2 * np.pi), de, np.arctan2(up @ east, up @ north))]


# The wire, by the byte table of the interface control document


def encoded(frames: Frames) -> bytes:
    sequence, out = 0, bytearray()
    for one in frames:
        if not one.sent:
            continue
        time_us = round(one.time_s * 1e6) + 1_000_000
        head = struct.pack(">QIIHhBB", time_us, one.number, 100_000, one.status, 2000, len(one.xy_px), 0)
        slots = b"".join(
            struct.pack(">HHH", *(int(np.clip(round(32 * part), 0, 65535)) for part in (y, x)), int(index))
            for (x, y), index in zip(one.xy_px.tolist(), one.index, strict=True)
        )
        if not one.alone:
            out += framed(1, head + slots.ljust(180, b"\0"), sequence)
            sequence += 1
        if one.own_deg is not None:
            ra, de, roll = one.own_deg
            angles = struct.pack(">IiI", round(ra % 360 * 1e6), round(de * 1e6), round(roll % 360 * 1e6))
            if one.quaternion is not None:
                angles = struct.pack(">4d", *one.quaternion)
            answer = struct.pack(">BBI", 12, int(one.acquired), 40_000) + bytes(10)
            out += framed(3, struct.pack(">QI", time_us, one.number) + angles + answer, sequence)
            sequence += 1
    return bytes(out)


def framed(kind: int, payload: bytes, sequence: int) -> bytes:
    body = struct.pack(">BBHH", kind, 0, len(payload), sequence % 65536) + payload
    return b"\x1a\xcf\xfc\x1d" + body + struct.pack(">I", zlib.crc32(body))


# What is done to frames


def own_off(which: Callable[[Frame], bool], arcmin: Callable[[Frame], float] | float) -> Meddle:
    """The sensor's own answers lie so far off in declination, called good all the same."""

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        for one in frames:
            if one.own_deg and which(one):
                one.own_deg[1] += (arcmin(one) if callable(arcmin) else arcmin) / 60

    return meddle


def own_held(since_s: float, until_s: float) -> Meddle:
    """The last answer before a time goes on."""

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        last = next(one for one in frames[::-1] if one.time_s < since_s)
        for one in frames:
            if since_s <= one.time_s < until_s:
                one.own_deg = list(last.own_deg or ())

    return meddle


def shown_from(other: Callable[[int], bool], elsewhere_s: float) -> Meddle:
    """Some panoramas are of the sky of another time of the night."""

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        later = exposures(Night("", (), frames=len(frames), start="2026-03-20T18:00:00"), rng)
        for one, another in zip(frames, later, strict=True):
            if other(one.number):
                one.xy_px, one.index = another.xy_px, another.index

    return meddle


def each(change: Callable[[Frame], object]) -> Meddle:
    """Change every frame by itself."""

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        for one in frames:
            change(one)

    return meddle


def standing(since_s: float, until_s: float) -> Meddle:
    """One picture is sent again and again."""

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        kept = next(one for one in frames if one.time_s >= since_s)
        for one in frames:
            if since_s <= one.time_s < until_s:
                one.xy_px, one.index = kept.xy_px, kept.index

    return meddle


def hot(count: int) -> Meddle:
    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        xy_px, index = rng.uniform(20, 1000, (count, 2)), rng.uniform(200, 2000, count)
        for one in frames:
            places, light = np.concatenate([xy_px, one.xy_px]), np.concatenate([index, one.index])
            order = np.argsort(-light, kind="stable")[:30]
            one.xy_px, one.index = places[order], light[order]

    return meddle


def moonlit(night: Night, false: int, hides_px: float) -> Meddle:
    """Where the Moon stands on the detector, false bright objects stand about it, and stars near it are not seen."""
    true = {**TRUE, **night.place}

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        for one, (x, y) in zip(frames, moon_px(true, night, [one.time_s for one in frames]), strict=True):
            if not (0 < x < SIZE_PX and 0 < y < SIZE_PX):
                continue
            kept = np.hypot(*(one.xy_px - (x, y)).T) > hides_px
            glare = rng.normal((x, y), hides_px / 2, (false, 2))
            inside = ((glare > 0) & (glare < SIZE_PX - 1)).all(axis=1)
            places = np.concatenate([glare[inside], one.xy_px[kept]])
            light = np.concatenate([rng.integers(1500, 4096, inside.sum()), one.index[kept]])
            order = np.argsort(-light, kind="stable")[:30]
            one.xy_px, one.index = places[order], light[order]
            one.acquired = false < 10

    return meddle


def moon_px(true: dict[str, object], night: Night, seconds: list[float]) -> np.ndarray:
    """Where the Moon stands on the plane of the detector (M, 2), by astropy; nan behind it."""
    where = EarthLocation.from_geodetic(*(true[key] * u.deg for key in SITE[1::-1]), true["height_m"] * u.m)
    instants = Time(night.start, scale="utc") + TimeDelta(seconds, format="sec")
    seen = get_body("moon", instants, where).transform_to(AltAz(obstime=instants, location=where))
    axes = axes_of(*(true[key] for key in MOUNT))
    azimuth, altitude = seen.az.rad, seen.alt.rad
    level = np.cos(altitude)
    sensor = np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(altitude)], axis=-1) @ axes.T
    return FOCAL_PX * sensor[:, :2] / np.where(sensor[:, 2:] > 0.5, sensor[:, 2:], np.nan) + 511.5


def wide(x_share: float) -> Meddle:
    return each(lambda one: one.xy_px.__setitem__((slice(None), 0), 511.5 + (1 + x_share) * (one.xy_px[:, 0] - 511.5)))


def between(since_s: float, until_s: float, value: float) -> Callable[[float], float]:
    return lambda time_s: value if since_s <= time_s < until_s else 0.0


def moved(since_s: float, until_s: float, *arcsec: float) -> Callable[[float], tuple[float, float, float]]:
    return lambda time_s: tuple(arcsec) if since_s <= time_s < until_s else (0.0, 0.0, 0.0)  # type: ignore[return-value]


def swing(arcsec: float, period_s: float) -> Callable[[float], tuple[float, float, float]]:
    return lambda time_s: (0.0, arcsec * float(np.sin(2 * np.pi * time_s / period_s)), 0.0)


def rate(arcsec_per_s: float) -> Callable[[float], tuple[float, float, float]]:
    return lambda time_s: (arcsec_per_s * time_s, 0.0, 0.0)


def driven(times: float) -> Callable[[float], tuple[float, float, float]]:
    """A drive turns the mount about the pole, westwards, so many times as fast as the Earth turns."""
    latitude = np.radians(TRUE["latitude_deg"])
    pole = axes_of(*(TRUE[key] for key in MOUNT)) @ np.array([0.0, np.cos(latitude), np.sin(latitude)])
    return lambda time_s: tuple((-15.041067 * times * time_s * pole).tolist())  # type: ignore[return-value]


def turned_at(*turns: tuple[float, float, float, float]) -> Callable[[float], tuple[float, float, float]]:
    """From each time on, in s, the mount is turned by so many arcsec about columns, rows and boresight."""
    return lambda time_s: next((turn[1:] for turn in turns[::-1] if time_s >= turn[0]), (0.0, 0.0, 0.0))


def wall(share: float) -> Callable[[np.ndarray, float], np.ndarray]:
    """What lies in so much of the field, from the left, is hidden."""
    return lambda xy_px, time_s: xy_px[:, 0] < share * SIZE_PX


def dew(towards: tuple[float, float], share: float = 0.97, since_s: float = 0.0) -> Callable[..., np.ndarray]:
    """In the half of the field on one side of its middle so many of the stars are hidden, others in each frame."""
    rng = np.random.default_rng(7)

    def hidden(xy_px: np.ndarray, time_s: float) -> np.ndarray:
        beyond = (xy_px - 511.5) @ np.array(towards) > 0
        return beyond & (rng.random(len(xy_px)) < share) & (time_s >= since_s)

    return hidden


def tree(per_s: float) -> Callable[[np.ndarray, float], np.ndarray]:
    return lambda xy_px, time_s: xy_px[:, 0] < per_s * time_s * SIZE_PX


def own_as(angles: Callable[[float, float, float], tuple[float, float, float]]) -> Meddle:
    """The sensor states its own RA, DE and roll otherwise."""
    return each(lambda one: setattr(one, "own_deg", list(angles(*one.own_deg or (0.0, 0.0, 0.0)))))


def of_date(ra: float, de: float, roll: float) -> tuple[float, float, float]:
    """Of the equinox of 2026.2, by astropy's precession."""
    here = SkyCoord(ra * u.deg, de * u.deg, frame="icrs")
    up = here.directional_offset_by(roll * u.deg, 1 * u.arcmin)
    here, up = (one.transform_to(FK5(equinox="J2026.2")) for one in (here, up))
    return here.ra.deg, here.dec.deg, here.position_angle(up).deg


def precessed_back(ra: float, de: float, roll: float) -> tuple[float, float, float]:
    """As far from ICRS as those of date, on the other side."""
    of = of_date(ra, de, roll)
    return 2 * ra - of[0], 2 * de - of[1], 2 * roll - of[2]


def quaternions(order: Callable[[tuple[float, ...]], tuple[float, ...]], first: Meddle | None = None) -> Meddle:
    """The sensor states quaternions, in some order of x, y, z and the scalar; every second one of the other sign."""

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        if first is not None:
            first(frames, rng)
        for one in frames:
            ra, de, roll = np.radians(one.own_deg)
            out = np.array([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
            north = np.array([-np.sin(de) * np.cos(ra), -np.sin(de) * np.sin(ra), np.cos(de)])
            up = np.cos(roll) * north + np.sin(roll) * np.array([-np.sin(ra), np.cos(ra), 0])
            axes = np.array([np.cross(out, up), -up, out])
            turn = Rotation.from_matrix(axes.T).as_quat() * (-1) ** one.number
            one.quaternion = order(tuple(turn.tolist()))

    return meddle


def own_late(frames_late: int) -> Meddle:
    """The sensor's own answer is that of so many exposures before; at first it has none."""

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        answers = [one.own_deg for one in frames]
        for one in frames:
            one.own_deg, one.acquired = answers[one.number - frames_late], one.number >= frames_late

    return meddle


def displaced(start: str, by: Callable[[Time], np.ndarray]) -> Meddle:
    """The sensor's own RA and DE are displaced by vectors (3, M) at the instants of a night."""

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        instants = Time(start, scale="utc") + TimeDelta([one.time_s for one in frames], format="sec")
        own = np.array([one.own_deg for one in frames])
        x, y, z = SkyCoord(*own.T[:2] * u.deg, frame="icrs").cartesian.xyz.value + by(instants)
        there = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))]).T
        for one, angles in zip(frames, there.tolist(), strict=True):
            one.own_deg[:2] = angles

    return meddle


def aberration(times: float) -> Callable[[Time], np.ndarray]:
    """By the Earth's velocity about the Sun, so many times: 1 takes out what a simple sensor leaves in."""
    return lambda instants: times * (get_body_barycentric_posvel("earth", instants)[1].xyz / c).to_value(u.one)


def lifted(place: dict[str, object], times: float) -> Callable[[Time], np.ndarray]:
    """By so many times the refraction at the boresight, away from the horizon."""
    true = {**TRUE, **place}

    def by(instants: Time) -> np.ndarray:
        where = EarthLocation.from_geodetic(*(true[key] * u.deg for key in SITE[1::-1]), true["height_m"] * u.m)
        air = {"temperature": true["temperature_c"] * u.deg_C, "relative_humidity": 0.8, "obswl": 0.6 * u.um}
        without, within = (
            AltAz(true["azimuth_deg"] * u.deg, true["altitude_deg"] * u.deg, obstime=instants, location=where,
                  pressure=pressure * u.hPa, **air)
            for pressure in (0, true["pressure_hpa"])
        )  # fmt: skip
        return times * (SkyCoord(without).icrs.cartesian.xyz - SkyCoord(within).icrs.cartesian.xyz).value

    return by


def scattered(frames: Frames, rng: np.random.Generator) -> None:
    """The sensor's own answers have a noise of 100 arcsec in declination."""
    for one in frames:
        one.own_deg[1] += rng.normal(0, 100 / 3600)


def restarted(frames: Frames, rng: np.random.Generator) -> Frames:
    """The sensor is silent from 100 to 130 s, and then its clock and its numbers begin anew."""
    kept = [one for one in frames if not 100 <= one.time_s < 130]
    late = [one for one in kept if one.time_s >= 130]
    first_s, first = late[0].time_s, late[0].number
    for one in late:
        one.time_s, one.number = one.time_s - first_s, one.number - first
    return kept


def fast(share: float) -> Meddle:
    return each(lambda one: setattr(one, "time_s", one.time_s * (1 + share)))


def in_pairs(frames: Frames, rng: np.random.Generator) -> Frames:
    """Of two frames the later one comes first."""
    return [frames[k ^ 1] for k in range(len(frames))]


def in_a_corner(one: Frame) -> bool:
    return bool((np.hypot(*(one.xy_px - 511.5).T) > 600).any())


def set_attribute(name: str, value: Callable[[Frame], object]) -> Meddle:
    return each(lambda one: setattr(one, name, value(one)))


def of_size(columns: int, rows: int) -> dict[str, object]:
    """The keys of a station file that states so large a detector."""
    return {"columns": columns, "rows": rows, "principal_point_px": [(columns - 1) / 2, (rows - 1) / 2]}


OWN_FALSE = r"reason:^sensor (false answers|d(RA|DE))"
SET_UP = (OPEN,)
HALF = "obstruction|half of the field"
MARCH, DAWN, RA_ZERO = "2026-03-20T15:00:00", "2026-03-20T21:50:00", "2026-08-20T17:43:40"
NORTH = {"latitude_deg": 78.0, "longitude_deg": 15.0}
ZENITH, POLE = {**NORTH, "altitude_deg": 90.0}, {**NORTH, "azimuth_deg": 0.0, "altitude_deg": 77.95}
WINTER = "2026-01-20T20:00:00"
DAY_S = 86_400.0


def under_the_moon(night: Night, false: int, hides_px: float) -> Night:
    """A night towards the Moon."""
    place = {"azimuth_deg": 330.0, "altitude_deg": 53.0, **night.place}
    night = replace(night, start="2026-03-26T13:00:00", place=place)
    glare = moonlit(night, false, hides_px)

    def meddle(frames: Frames, rng: np.random.Generator) -> None:
        glare(frames, rng)
        if night.meddle is not None:
            night.meddle(frames, rng)
            for one in frames:
                one.acquired = True

    return replace(night, meddle=meddle)


NIGHTS = (
    # 1. The sensor's own answers are wrong while something else excuses the absence of answers.
    Night("dawn, half of the own answers 25' off", (FAIL,), OWN_FALSE, own=True, frames=900, step_s=2.0, start=DAWN,
          dim_mag=lambda s: max(0.0, (s - 400) / 200), meddle=own_off(lambda one: one.number >= 450, 25)),
    Night("cloud of 60 s, own answers 25' off in it", (FAIL,), OWN_FALSE, own=True, dim_mag=between(60, 120, 5),
          meddle=own_off(lambda one: 60 <= one.time_s < 120, 25)),
    Night("own answers drift off under cloud", (FAIL,), OWN_FALSE, own=True, dim_mag=between(60, 120, 5),
          meddle=own_off(lambda one: 60 <= one.time_s < 120, lambda one: (one.time_s - 60) / 2)),
    Night("one object in view, own answers 25' off", (FAIL, OPEN), r"reason:^sensor:? (false|.*compared|d(RA|DE))",
          own=True, frames=600,
          hidden=lambda xy, s: (np.arange(len(xy)) > 40) if 100 <= s < 122 else np.zeros(len(xy), bool),
          meddle=own_off(lambda one: 100 <= one.time_s < 122, 25)),
    Night("lens covered 30 s, own answers 25' off in it", (FAIL,), OWN_FALSE, own=True, dim_mag=between(60, 90, 20),
          meddle=own_off(lambda one: 60 <= one.time_s < 90, 25)),
    Night("85 % of the field hidden, own answers 25' off", (FAIL,), OWN_FALSE, own=True,
          hidden=lambda xy, s: wall(0.85)(xy, s) if s > 60 else np.zeros(len(xy), bool),
          meddle=own_off(lambda one: 60 <= one.time_s < 90, 25)),
    Night("last answer held 60 s under cloud", (FAIL,), r"reason:^sensor ", own=True, dim_mag=between(60, 120, 5),
          meddle=own_held(60, 120)),
    Night("own answers 1 deg off throughout", (FAIL,), "sensor bias", own=True, meddle=own_off(lambda one: True, 60)),
    Night("own answers 1 deg off in the first half", (FAIL,), OWN_FALSE, own=True,
          meddle=own_off(lambda one: one.number < 200, 60)),
    Night("own answers 100 arcsec off", (FAIL,), r"sensor (bias|delay)", own=True,
          meddle=own_off(lambda one: True, 100 / 60)),
    Night("own roll 1 deg off", (FAIL,), r"sensor roll", own=True,
          meddle=each(lambda one: one.own_deg.__setitem__(2, one.own_deg[2] + 1))),
    Night("answers alone, as they should be", (PASS,), ANY, own=True, alone=True),
    Night("answers alone, azimuth +0.3 deg", (OPEN,), "mount", {"azimuth_deg": 40.3}, own=True, alone=True),
    Night("answers alone, vouched, azimuth +0.3 deg", (FAIL,), ANY, {"azimuth_deg": 40.3}, True, own=True, alone=True),
    Night("answers alone, 12 of them 25' off", (FAIL,), OWN_FALSE, own=True, alone=True,
          meddle=own_off(lambda one: one.number % 33 == 5, 25)),
    Night("own answers off while a star is in a corner", (FAIL,), OWN_FALSE, own=True, meddle=own_off(in_a_corner, 25)),
    Night("own noise of 100 arcsec", (FAIL,), "sensor noise", own=True, meddle=scattered),
    Night("own answers of date", SET_UP, "sensor convention", own=True, meddle=own_as(of_date)),
    Night("own RA in hours", SET_UP, "sensor convention", own=True, meddle=own_as(lambda a, d, r: (a / 15, d, r))),
    Night("own roll to the west", SET_UP, "sensor convention", own=True, meddle=own_as(lambda a, d, r: (a, d, -r))),
    Night("own answers with aberration taken out", (PASS,), "sensor aberration", own=True,
          meddle=displaced(MARCH, aberration(1))),
    Night("own answers with aberration twice", (PASS,), "sensor bias", own=True,
          meddle=displaced(MARCH, aberration(-1))),
    Night("own answers with refraction twice at 45 deg, 52 arcsec", (PASS,), "sensor bias", own=True,
          place={"altitude_deg": 45.0}, meddle=displaced(MARCH, lifted({"altitude_deg": 45.0}, -1))),
    Night("own answers with refraction taken out at 28 deg, 100 arcsec", (FAIL,), "sensor bias", own=True,
          place={"altitude_deg": 28.0}, meddle=displaced(MARCH, lifted({"altitude_deg": 28.0}, 1))),
    Night("own answers precessed the wrong way", (FAIL,), "sensor bias", own=True, meddle=own_as(precessed_back)),
    Night("own answers a frame late", (PASS, OPEN), "sensor (delay|bias)", own=True, meddle=own_late(1)),
    Night("own answers ten frames late", (FAIL,), "sensor (delay|bias)", own=True, meddle=own_late(10)),
    Night("own boresight of the other direction", (FAIL,), "sensor bias", own=True,
          meddle=own_as(lambda a, d, r: ((a + 180) % 360, -d, r))),
    Night("own answers as quaternions", (PASS,), "none", own=True, quaternions=True,
          meddle=quaternions(lambda q: q)),
    Night("own quaternions with the scalar first", SET_UP, "sensor convention", own=True, quaternions=True,
          meddle=quaternions(lambda q: (q[3], *q[:3]))),
    Night("own quaternions the other way", SET_UP, "sensor convention", own=True, quaternions=True,
          meddle=quaternions(lambda q: (-q[0], -q[1], -q[2], q[3]))),
    Night("own quaternions 1 deg off in a third", (FAIL,), r"reason:^sensor (availability|false answers)", own=True,
          quaternions=True, meddle=quaternions(lambda q: q, own_off(lambda one: one.number % 3 == 1, 60))),
    Night("own DE of the other sign", (FAIL,), "sensor bias", own=True, meddle=own_as(lambda a, d, r: (a, -d, r))),
    # 2 and 3. Identifiers and panoramas.
    Night("an identifier that never answers", (FAIL,), ANY, frames=120, own=True,
          command="python3 {folder}/program.py 1 0"),
    Night("an identifier that answers all", (PASS,), ANY, frames=320, own=True,
          command="python3 {folder}/program.py 0 0"),
    Night("an identifier that is silent in bursts", (FAIL,), "reason:^onboard availability", frames=320, own=True,
          command="python3 {folder}/program.py 0.25 0"),
    Night("an identifier that is late in bursts", (FAIL,), "reason:^onboard availability", frames=120, own=True,
          command="python3 {folder}/program.py 0.2 0.4"),
    Night("3 % of the panoramas of another sky", (FAIL,), r"another sky or reason:false answers",
          meddle=shown_from(lambda n: n % 33 == 5, 0)),
    Night("a third of the panoramas of another sky", (FAIL,), r"two pointings or reason:false answers",
          meddle=shown_from(lambda n: n % 3 == 1, 0)),
    # 4. The set-up, for which nobody vouches.
    Night("azimuth +0.28 deg", SET_UP, "mount", {"azimuth_deg": 40.28}),
    Night("azimuth -0.35 deg", SET_UP, "mount", {"azimuth_deg": 39.65}),
    Night("altitude +0.3 deg", SET_UP, "mount", {"altitude_deg": 62.3}),
    Night("altitude -2 deg", SET_UP, "mount", {"altitude_deg": 60.0}),
    Night("roll +0.5 deg", SET_UP, "mount", {"roll_deg": 20.5}),
    Night("latitude +0.18 deg", SET_UP, "latitude|site", {"latitude_deg": -6.35}),
    Night("latitude -0.35 deg", SET_UP, "latitude|site", {"latitude_deg": -6.88}),
    Night("longitude +1 deg", SET_UP, "longitude|clock offset", {"longitude_deg": 107.7}),
    Night("latitude sign", SET_UP, "latitude sign|exchanged", {"latitude_deg": 6.53}),
    Night("longitude sign", SET_UP, "longitude sign", {"longitude_deg": -106.7}),
    Night("azimuth from south", SET_UP, "azimuth from south", {"azimuth_deg": 220.0}),
    Night("zenith distance for altitude", SET_UP, "zenith distance", {"altitude_deg": 28.0}),
    Night("roll +90 deg", SET_UP, "roll off by 90", {"roll_deg": 110.0}),
    Night("start 18 s late", SET_UP, "GPS|clock|longitude", clock="", start_off_s=18),
    Night("start 25 s early", SET_UP, "clock|longitude", clock="", start_off_s=-25),
    Night("start 1 h late", SET_UP, "clock|local time", clock="", start_off_s=3600),
    Night("start a year early", SET_UP, "date", clock="", start_off_s=-365 * 86_400),
    Night("mirrored", SET_UP, "mirrored", {"mirrored": "true"}),
    Night("focal length +0.3 %", SET_UP, "focal length", {"focal_length_px": FOCAL_PX * 1.003}),
    Night("focal length +3 %", SET_UP, "focal length", {"focal_length_px": FOCAL_PX * 1.03}),
    Night("rows and columns twice too many", SET_UP, "detector size", of_size(2048, 2048)),
    Night("rows and columns half", SET_UP, "detector size", of_size(512, 512)),
    Night("a quarter of the columns too few", SET_UP, "detector size", of_size(768, 1024)),
    Night("a quarter of the columns too many", SET_UP, "detector size", of_size(1280, 1024)),
    Night("a twentieth of the rows too many", SET_UP, "detector size", of_size(1024, 1080)),
    Night("binned by 2, and not so stated", SET_UP, "detector size", {**of_size(2048, 2048),
          "focal_length_px": 2 * FOCAL_PX}),
    Night("pixels 0.4 % wider along rows", (PASS, OPEN), "pixel pitch", meddle=wide(0.004)),
    Night("pixels counted from 1", SET_UP, "pixel origin|principal point",
          meddle=each(lambda one: setattr(one, "xy_px", one.xy_px + 1.3333))),
    Night("day and month exchanged, 30 days behind", SET_UP, "date", clock="", start="2026-04-03T15:00:00",
          start_off_s=-30 * DAY_S),
    Night("day and month exchanged, 149 days ahead, clock stated", SET_UP, "date", start="2026-03-08T15:00:00",
          start_off_s=149 * DAY_S),
    # ... and for which somebody vouches.
    Night("day and month exchanged, 205 days behind, mount vouched", SET_UP, "date", vouched=True, clock="",
          start="2026-11-04T22:00:00", start_off_s=-205 * DAY_S, place={**NORTH, "azimuth_deg": 20.0}),
    Night("vouched, sensor turned by 0.5 deg", (FAIL,), "alignment of the sensor", {"altitude_deg": 62.5}, True),
    Night("vouched, sensor turned by 200 arcsec", (FAIL,), "alignment of the sensor", {"altitude_deg": 62.055}, True),
    Night("vouched, azimuth from south", SET_UP, "azimuth from south", {"azimuth_deg": 220.0}, True),
    # ... but not the camera, whose station file the sensor's own right answers refute.
    Night("vouched, principal point stated 20 px off, own answers right", SET_UP, "principal point",
          {"principal_point_px": [531.5, 511.5]}, True, own=True),
    Night("vouched, principal point stated 3 px off, own answers right", SET_UP, "principal point",
          {"principal_point_px": [511.5, 514.5]}, True, own=True),
    Night("vouched, principal point stated 20 px off, own answers 100 arcsec off", (FAIL,), "alignment of the sensor",
          {"principal_point_px": [531.5, 511.5]}, True, own=True, meddle=own_off(lambda one: True, 100 / 60)),
    Night("vouched, principal point stated 20 px off, a third of the panoramas of another sky", (FAIL,), ANY,
          {"principal_point_px": [531.5, 511.5]}, True, own=True, meddle=shown_from(lambda n: n % 3 == 1, 0)),
    Night("principal point stated 20 px off, a third of the panoramas of another sky", (FAIL,), ANY,
          {"principal_point_px": [531.5, 511.5]}, own=True, meddle=shown_from(lambda n: n % 3 == 1, 0)),
    Night("principal point stated 20 px off, 3 % of the panoramas of another sky", (FAIL,), ANY,
          {"principal_point_px": [531.5, 511.5]}, own=True, meddle=shown_from(lambda n: n % 33 == 5, 0)),
    Night("principal point stated 20 px off", SET_UP, "principal point", {"principal_point_px": [531.5, 511.5]}),
    Night("vouched, principal point stated 20 px off, no own answers", (FAIL,), "alignment of the sensor",
          {"principal_point_px": [531.5, 511.5]}, True),
    Night("vouched, sensor turned by 0.5 deg, own answers too", (FAIL,), "alignment of the sensor",
          {"altitude_deg": 62.5}, True, own=True),
    # 6. Causes.
    Night("two sensors in one capture", (OPEN, FAIL), "two pointings",
          turn_arcsec=lambda s: (0.0, 72_000.0, 0.0) if round(s / 0.5) % 2 else (0.0, 0.0, 0.0)),
    Night("time tags in ms", SET_UP, "time tags",
          meddle=each(lambda one: setattr(one, "time_s", one.time_s / 1000))),
    Night("the sensor's clock is set on by an hour", SET_UP, "sensor time tag",
          meddle=each(lambda one: setattr(one, "time_s", one.time_s + 3600 * (one.time_s > 100)))),
    Night("a restart of 30 s, vouched", SET_UP, "sensor time tag", vouched=True, frames=600, meddle=restarted),
    Night("the sensor's clock 2 % fast", SET_UP, "sensor clock drift", meddle=fast(0.02)),
    Night("the sensor's clock 10 % slow, vouched", SET_UP, "sensor clock drift", vouched=True, meddle=fast(-0.1)),
    Night("time tags in 1/1024 s for half an hour", SET_UP, "sensor clock drift", frames=900, step_s=2.0,
          meddle=fast(0.024)),
    Night("frames in pairs exchanged", SET_UP, "sensor time tag", meddle=in_pairs),
    Night("a roll that drifts by 0.5 deg", SET_UP, "mount moves", turn_arcsec=lambda s: (0.0, 0.0, 9 * s)),
    Night("x and y exchanged in a tenth of the frames", (FAIL,), "mirrored image",
          meddle=each(lambda one: setattr(one, "xy_px", one.xy_px[:, :: -1 if one.number % 10 == 4 else 1].copy()))),
    Night("ten objects a frame, all as bright", (PASS, OPEN), "none",
          meddle=each(lambda one: vars(one).update(xy_px=one.xy_px[:10], index=np.minimum(one.index[:10], 900.0)))),
    Night("two thirds of the field behind a wall", (OPEN, FAIL, PASS), "obstruction", hidden=wall(0.67)),
    Night("four fifths of the field behind a wall", (OPEN, FAIL), "obstruction", hidden=wall(0.8)),
    Night("a third of the field behind a wall", (PASS, OPEN), "obstruction", hidden=wall(0.35)),
    Night("a tree grows over the field", (PASS, OPEN), "obstruction", frames=600, hidden=tree(0.9 / 300)),
    Night("dew on the lower half of the field", (PASS, OPEN), HALF, own=True, hidden=dew((0, 1))),
    Night("shade on the right half of the field", (PASS, OPEN), HALF, hidden=dew((1, 0), 1.0)),
    Night("dew on a corner half of the field", (PASS, OPEN), HALF, hidden=dew((-0.7, 0.7))),
    Night("thin dew on the upper half of the field", (PASS, OPEN), HALF, hidden=dew((0, -1), 0.8)),
    Night("dew on the left half from half way on", (PASS, OPEN, FAIL), HALF, frames=600,
          hidden=dew((-1, 0), since_s=150)),
    Night("dew on the lower half at high rate", (PASS, OPEN), HALF, frames=600, step_s=0.1, hidden=dew((0, 1))),
    Night("dew on the lower half of a field that passes", (PASS, OPEN, FAIL), HALF, frames=450, step_s=4.0,
          hidden=dew((0, 1))),
    Night("a mount that turns with 1 arcsec/s", (OPEN, FAIL), "mount moves|clock drift|mount follows",
          turn_arcsec=rate(1.0)),
    Night("a slip of 100 arcsec", SET_UP, "slip|step", frames=600, turn_arcsec=moved(150, 9999, 100.0, 40.0, 0.0)),
    Night("a swing of 80 arcsec", (OPEN, FAIL), "thermal", frames=900, turn_arcsec=swing(80.0, 150.0)),
    Night("vibration of 60 arcsec", (OPEN, FAIL), "vibration", turn_arcsec=swing(85.0, 1.37), frames=600),
    # At RA 0 and at the pole.
    Night("RA 0, own answers, all well", (PASS,), "none", own=True, start=RA_ZERO),
    Night("RA 0, own answers 100 arcsec off", (FAIL,), "sensor bias", own=True, start=RA_ZERO,
          meddle=own_off(lambda one: True, 100 / 60)),
    Night("RA 0, own answers 12 of them 25' off", (FAIL,), OWN_FALSE, own=True, start=RA_ZERO,
          meddle=own_off(lambda one: one.number % 33 == 5, 25)),
    Night("RA 0, own RA in hours", SET_UP, "sensor convention", own=True, start=RA_ZERO,
          meddle=own_as(lambda a, d, r: (a / 15, d, r))),
    Night("RA 0, azimuth +0.28 deg", SET_UP, "mount", {"azimuth_deg": 40.28}, start=RA_ZERO),
    Night("RA 0, start 0.9 s late, as without dUT1", (PASS, OPEN), "clock|longitude", start=RA_ZERO, start_off_s=0.9),
    Night("zenith at 78 N, own answers, all well", (PASS,), "none", own=True, start=WINTER, place=ZENITH),
    Night("zenith at 78 N, azimuth +0.28 deg", SET_UP, "mount|clock offset|longitude", {"azimuth_deg": 40.28},
          start=WINTER, place=ZENITH),
    Night("zenith at 78 N, latitude sign", SET_UP, "latitude sign", {"latitude_deg": -78.0}, start=WINTER,
          place=ZENITH),
    Night("DE 89.9, own answers, all well", (PASS,), "none", own=True, start=WINTER, place=POLE),
    Night("DE 89.9, own answers 12 of them 25' off", (FAIL,), OWN_FALSE, own=True, start=WINTER, place=POLE,
          meddle=own_off(lambda one: one.number % 33 == 5, -25)),
    Night("DE 89.9, roll +0.5 deg", SET_UP, "mount|clock offset|longitude", {"roll_deg": 20.5}, start=WINTER,
          place=POLE),
    Night("DE 89.9, start 25 s early", (PASS, OPEN), "clock|longitude|mount", start=WINTER, place=POLE, clock="",
          start_off_s=-25),
    Night("DE 89.9, own answers ten minutes late", (FAIL,), "sensor (delay|roll|bias)", own=True, start=WINTER,
          place=POLE, meddle=own_late(10), step_s=60.0, frames=120),
    Night("DE 89.9, own RA in hours", SET_UP, "sensor convention", own=True, start=WINTER, place=POLE,
          meddle=own_as(lambda a, d, r: (a / 15, d, r))),
    Night("DE 89.9, a slip of 100 arcsec", SET_UP, "slip|step", frames=600, start=WINTER, place=POLE,
          turn_arcsec=moved(150, 9999, 100.0, 40.0, 0.0)),
    # The Moon.
    under_the_moon(Night("the Moon stands in the field", (OPEN, FAIL), "the Moon", own=True), 24, 200),
    under_the_moon(Night("the Moon enters the field half way", (OPEN, FAIL), "the Moon", own=True, frames=600,
                         step_s=2.0, place={"azimuth_deg": 318.0, "altitude_deg": 49.5}), 24, 200),
    under_the_moon(Night("the Moon in the field hides all stars", SET_UP, "the Moon", own=True), 30, 2000),
    under_the_moon(Night("the Moon hides all stars, own answers 25' off", (FAIL,), ANY, own=True,
                         meddle=own_off(lambda one: one.number % 3 == 1, 25)), 30, 2000),
    under_the_moon(Night("the Moon stands in the field of a good sensor", (PASS,), "none", own=True), 1, 40),
    under_the_moon(Night("the Moon in the field, an identifier that is silent in bursts", (FAIL,), "none", own=True,
                         command="python3 {folder}/program.py 0.25 0", frames=320), 1, 40),
    Night("a drive at sidereal rate", SET_UP, "mount follows", frames=600, turn_arcsec=driven(1.0)),
    Night("a drive at solar rate", SET_UP, "mount follows", frames=600, turn_arcsec=driven(0.99727)),
    Night("a drive at sidereal rate for half a minute", SET_UP, "mount follows", frames=60, turn_arcsec=driven(1.0)),
    Night("a drive at sidereal rate for a quarter of an hour, own answers", SET_UP, "mount follows", own=True,
          frames=900, step_s=1.0, turn_arcsec=driven(1.0)),
    Night("a drive, own answers 100 arcsec off", (FAIL,), "mount follows", own=True, frames=600,
          turn_arcsec=driven(1.0), meddle=own_off(lambda one: True, 100 / 60)),
    Night("a drive, vouched", (FAIL,), "mount follows", vouched=True, frames=600, turn_arcsec=driven(1.0)),
    Night("turned twice, by 5 and 8 deg", SET_UP, "mount moved", frames=600, step_s=1.0,
          turn_arcsec=turned_at((200, 18_000, 0, 0), (400, 18_000, 28_000, 0))),
    Night("turned twice, by 18 deg", SET_UP, "mount moved", frames=600, step_s=1.0,
          turn_arcsec=turned_at((200, 64_800, 0, 0), (400, 0, 64_800, 0))),
    Night("turned to five pointings", SET_UP, "mount moved", frames=900, step_s=1.0, own=True,
          turn_arcsec=turned_at((180, 18_000, 0, 0), (360, 18_000, 28_000, 0), (540, 0, 9000, 36_000),
                                (720, -9000, 4000, 0))),
    Night("turned to five pointings within 0.1 deg", SET_UP, "mount moved", frames=900, step_s=1.0,
          turn_arcsec=turned_at((180, 300, 0, 0), (360, 100, -300, 0), (540, 0, 360, 360), (720, -200, 40, 0))),
    Night("turned twice, vouched", (FAIL,), "slip|pointings|mount", vouched=True, frames=600, step_s=1.0,
          turn_arcsec=turned_at((200, 18_000, 0, 0), (400, 18_000, 28_000, 0))),
    Night("own answers that jump twice", (FAIL,), OWN_FALSE, own=True, frames=600, step_s=1.0,
          meddle=own_off(lambda one: True, lambda one: (0, 3, -5)[int(one.time_s // 200)])),
    # 7. What must have a line.
    Night("a jolt of 300 arcsec for 10 s", SET_UP, "slip|jolt|moved", frames=600,
          turn_arcsec=moved(100, 110, 250.0, 160.0, 0.0)),
    Night("kicked by 0.5 deg for 40 s, and put back", SET_UP, "slip|moved", frames=600,
          turn_arcsec=moved(100, 140, 1500.0, 1000.0, 300.0)),
    Night("cloud for 50 s", (PASS, OPEN), ANY, frames=600, dim_mag=between(100, 150, 4)),
    Night("a fault bit in a tenth of the frames", (FAIL,), "fault or reason:fault",
          meddle=set_attribute("status", lambda one: 2 * (one.number % 10 == 3))),
    Night("2 % of panoramas 20' off", (FAIL, OPEN), "panoramas elsewhere",
          turn_arcsec=lambda s: (1200.0, 0.0, 0.0) if round(s / 0.5) % 50 == 7 else (0.0, 0.0, 0.0)),
    Night("one picture for 40 s", (FAIL,), "frozen", meddle=standing(60, 100)),
    Night("every third exposure never sent at random", (FAIL,), "reason:availability or reason:answered",
          meddle=lambda frames, rng: [setattr(one, "sent", bool(rng.random() > 0.3)) for one in frames[1:]] and None),
    Night("ten hot pixels", (PASS, OPEN), "hot pixel", meddle=hot(10)),
    Night("no brightness", (FAIL,), "faulty panoramas",
          meddle=each(lambda one: setattr(one, "index", np.full(len(one.index), 100.0)))),
    Night("noise of 1.5 px", (FAIL, OPEN), "centroid noise", noise_px=1.5),
    Night("a mount 5 arcsec/min off for 20 minutes", (OPEN, FAIL), "mount moves|clock drift", frames=900, step_s=1.3,
          turn_arcsec=rate(5 / 60)),
)  # fmt: skip

V1 = Path(__file__).parents[1] / "protocols" / "panorama-v1.yaml"
PROGRAM = """import json, pathlib, sys, time
told = json.loads(pathlib.Path(__file__).with_name("told.json").read_text())
share, late_s = float(sys.argv[1]), float(sys.argv[2])
for line in sys.stdin:
    if "frame_no" in line:
        number = json.loads(line)["frame_no"]
        silent = number % 40 < share * 40
        time.sleep(late_s * silent)
        print(json.dumps({"frame_no": number, **({"status": "NO_MATCH"} if silent else told[str(number)])}), flush=True)
"""
"""Told what is right; in bursts of a share of 40 panoramas it knows nothing, and says so late."""


def with_quaternions(protocol: str) -> str:
    """A protocol description with places in 1/32 px, whose ATTITUDE has q1 to q4 in place of RA, DE and roll."""
    numbers = "".join(f"      - {{name: q{k}, type: f64}}\n" for k in (1, 2, 3, 4))
    protocol = re.sub(r"(?m)^      - \{name: ra, .*\n.*\n      - \{name: roll, .*\n", numbers, protocol)
    return protocol.replace("    length: 40\n", "    length: 60\n").replace("\nscale: 1 ", "\nscale: 1/32 ")


def clean(number: int) -> Night:
    """A night in which all is as stated: sky, length and rate differ."""
    rng = np.random.default_rng(number)
    start = f"2026-0{rng.integers(1, 10)}-{rng.integers(10, 28)}T{rng.choice([13, 14, 15, 16, 17, 18, 19, 20])}:10:00"
    frames, step_s = [(300, 0.2), (300, 0.5), (400, 1.0), (450, 4.0)][number % 4]
    altitude_deg = float(rng.choice([40.0, 62.0, 75.0, 88.0]))
    noise_px = float(rng.choice([0.05, 0.1, 0.3]))
    return Night(
        f"clean {number}", (PASS, OPEN), "none", frames=frames, step_s=step_s, start=start, own=number % 3 == 0,
        noise_px=noise_px, place={"altitude_deg": altitude_deg},
    )  # fmt: skip


def run(*words: str) -> tuple[int, str]:
    """A command in this process: its exit code, and stdout."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            gse(list(words))
        except SystemExit as ended:
            code = int(ended.code or 0)
    if code in (2, 70):
        raise RuntimeError(f"gse {' '.join(words)}: {err.getvalue()[-2000:]}")
    return code, out.getvalue()


def judged(night: Night, seed: int, folder: Path) -> dict[str, object]:
    """The report of a night."""
    rng = np.random.default_rng([seed, zlib.crc32(night.name.encode())])
    frames = exposures(night, rng)
    if night.meddle is not None:
        frames = night.meddle(frames, rng) or frames
    if night.command:
        names = ("ra_deg", "de_deg", "roll_deg")
        told = {one.number: dict(zip(names, one.own_deg or (), strict=False)) for one in frames}
        (folder / "told.json").write_text(json.dumps(told))
        frames = [replace(one, own_deg=None) for one in frames]
    (folder / "night.bin").write_bytes(encoded(frames))
    (folder / "program.py").write_text(PROGRAM)
    (folder / "alone.yaml").write_text(re.sub(r"(?m)^  PANORAMA:\n(    .*\n)+", "", V1.read_text()))
    (folder / "quaternion.yaml").write_text(with_quaternions(V1.read_text()))
    (folder / "station.yaml").write_text(station_text(night).replace("{folder}", str(folder)))
    start = (Time(night.start, scale="utc") + TimeDelta(night.start_off_s, format="sec")).isot + "Z"
    clock = ("--clock-error", night.clock) if night.clock else ()
    station = ("--station", str(folder / "station.yaml"))
    words = ("replay", str(folder / "night.bin"), *station, "--start-utc", start, *clock, "--no-plots", "--json")
    return dict(json.loads(run(*words, "--out", str(folder))[1]))


def named(night: Night, report: dict[str, object]) -> bool:
    """Whether the cause that was written down is the first one."""
    findings, reasons = report["findings"], report["reasons"]
    if night.cause == "none":
        return not findings
    cause, reason = cause_of(findings[0]) if findings else "", reasons[0] if reasons else ""
    return any(
        re.search(pattern.removeprefix("reason:"), reason if pattern.startswith("reason:") else cause)
        for pattern in night.cause.split(" or ")
    )


def cause_of(finding: str) -> str:
    return finding.split(":")[0]


def results(asked: argparse.Namespace) -> Iterator[tuple[Night, bool, bool, str]]:
    nights = [one for one in NIGHTS if asked.only in one.name] * (not asked.clean)
    nights += [clean(number) for number in range(asked.first, asked.first + asked.clean)]
    for night in nights:
        for seed in range(1, 1 + (1 if night.cause == "none" else asked.seeds)):
            with folder_for(asked, night, seed) as folder:
                began = time.process_time()
                report = judged(night, seed, Path(folder))
            word = str(report["verdict"]).split(",")[0]
            findings = "; ".join(map(cause_of, report["findings"]))
            first = str(report["reasons"][0])[:150] if report["reasons"] else ""
            line = f"{time.process_time() - began:4.1f} s {word} [{findings}] {first}"
            yield night, word in night.words, named(night, report), line


@contextlib.contextmanager
def folder_for(asked: argparse.Namespace, night: Night, seed: int) -> Iterator[str]:
    if asked.keep is None:
        with tempfile.TemporaryDirectory() as folder:
            yield folder
        return
    folder = Path(asked.keep) / f"{re.sub('[^a-z0-9]+', ' ', night.name.lower()).strip().replace(' ', '-')}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    yield str(folder)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--only", default="")
    options.add_argument("--seeds", type=int, default=2)
    options.add_argument("--clean", type=int, default=0, help="so many clean nights instead")
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--keep", help="keep captures and reports in this folder")
    asked = options.parse_args()
    iers.conf.auto_download, iers.conf.auto_max_age = False, None
    count = words = causes = 0
    for night, is_word, is_cause, line in results(asked):
        count, words, causes = count + 1, words + is_word, causes + is_cause
        marks = f"{' ' if is_word else 'W'}{' ' if is_cause else 'C'}"
        print(f"{marks} {night.name}: {line}", flush=True)
    print(f"{count} nights: right word {words}, right cause first {causes}")


if __name__ == "__main__":
    sys.exit(main())
