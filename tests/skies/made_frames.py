"""Panoramas made from a catalogue: what the identifiers' tests look at."""

from dataclasses import dataclass

import numpy as np

from gse.catalog import StarCatalog, merge_doubles
from gse.values.camera import Camera
from gse.values.panorama import MAX_OBJECTS

ARCSEC = np.pi / 648000
FIELD_14_DEG = Camera(1024, 1024, 512 / np.tan(np.radians(7)), (511.5, 511.5))


@dataclass(frozen=True)
class Noise:
    """What stands between sky and panorama; false objects are uniform over field and magnitude limit - 4 .. limit."""

    position_arcsec: float = 10.0
    magnitude: float = 0.3
    false_objects: int = 0
    whole_pixels: bool = True
    limit: float = 6.0


@dataclass(frozen=True)
class MadeFrame:
    """One panorama, brightest first, with its truth; ``ids`` is 0 where an object is not a star."""

    xy_px: np.ndarray
    brightness: np.ndarray
    ids: np.ndarray
    icrs_to_sensor: np.ndarray


def icrs_to_sensor(boresight_icrs: np.ndarray, roll_rad: float) -> np.ndarray:
    """The rotation of a camera that looks along a direction."""
    aside = np.cross(boresight_icrs, [0.0, 0.0, 1.0] if abs(boresight_icrs[2]) < 0.9 else [1.0, 0.0, 0.0])
    x = aside / np.linalg.norm(aside)
    y = np.cross(boresight_icrs, x)
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    return np.array([c * x + s * y, c * y - s * x, boresight_icrs])


def sky_of(catalog: StarCatalog, camera: Camera, limit: float) -> StarCatalog:
    """The stars to two magnitudes below the limit, as the camera sees them."""
    return merge_doubles(catalog.rows(np.flatnonzero(catalog.magnitude < limit + 2)), 2 * camera.pixel_rad)


def made_frame(
    sky: StarCatalog, camera: Camera, boresight_icrs: np.ndarray, noise: Noise, rng: np.random.Generator
) -> MadeFrame:
    """The panorama of a direction, with random roll and noise."""
    rotation = icrs_to_sensor(boresight_icrs, rng.uniform(0, 2 * np.pi))
    near = np.flatnonzero(sky.icrs @ boresight_icrs > np.cos(camera.diagonal_rad / 2 + 0.01))
    sensor = sky.icrs[near] @ rotation.T + rng.normal(0, noise.position_arcsec * ARCSEC, (len(near), 3))
    xy = camera.pixels(sensor / np.linalg.norm(sensor, axis=1)[:, None])
    magnitude = sky.magnitude[near] + rng.normal(0, noise.magnitude, len(near))
    seen = camera.contains(xy) & (magnitude < noise.limit)
    count = noise.false_objects
    corner = [camera.columns, camera.rows]
    xy = np.concatenate([xy[seen], rng.uniform([0, 0], corner, (count, 2)) - 0.5])
    magnitude = np.concatenate([magnitude[seen], rng.uniform(noise.limit - 4, noise.limit, count)])
    ids = np.concatenate([sky.ids[near][seen], np.zeros(count, np.int64)])
    brightest = np.argsort(magnitude, kind="stable")[:MAX_OBJECTS]
    brightness = np.clip(np.rint(4096 * 10 ** (-0.4 * (magnitude[brightest] - noise.limit + 5))), 1, 4096)
    placed = xy[brightest]
    return MadeFrame(np.rint(placed) if noise.whole_pixels else placed, brightness, ids[brightest], rotation)
