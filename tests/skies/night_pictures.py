"""Pictures of a night sky as cameras publish them: drawn from the catalogue, developed and compressed.

A star is a Gaussian integrated over its pixels; the sky has a slope and a glow; each pixel sees one colour of a Bayer
mosaic and its neighbours fill in the others; then gamma, 8 bits and JPEG. All by a seed.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import convolve
from scipy.special import erf

from gse.catalog import StarCatalog
from gse.values.attitude import Attitude
from gse.values.camera import Camera

FULL_WELL = 15_000.0
"""Electrons of a saturated pixel."""
FAINTEST_MAGNITUDE = 9.0
_COLOURS = np.array([0.8, 1.0, 0.7])
"""Of starlight, red, green and blue."""
_RADIUS_PX = 15


@dataclass(frozen=True)
class NightPicture:
    """Electrons (rows, columns), and the pixels (N, 2) and electrons (N,) of the stars in it, brightest first."""

    electrons: NDArray[np.float64]
    xy_px: NDArray[np.float64]
    light: NDArray[np.float64]


def camera_of(columns: int, rows: int, across_deg: float, *, mirrored: bool = False) -> Camera:
    """A camera whose rows show this many degrees."""
    focal_px = columns / 2 / math.tan(math.radians(across_deg) / 2)
    return Camera(rows, columns, focal_px, ((columns - 1) / 2, (rows - 1) / 2), mirrored=mirrored)


def night_picture(
    camera: Camera,
    attitude: Attitude,
    stars: StarCatalog,
    random: np.random.Generator,
    *,
    saturating_magnitude: float = 2.5,
    sigma_px: float = 1.2,
    sky_electrons: float = 150.0,
) -> NightPicture:
    """The electrons of one exposure: stars, a sky that is twice as bright below as above with a glow, and noise."""
    bright = stars.rows(np.flatnonzero(stars.magnitude < FAINTEST_MAGNITUDE))
    ahead = bright.icrs @ attitude.icrs_to_sensor[2] > math.cos(camera.diagonal_rad / 2 + 0.01)
    seen = bright.rows(np.flatnonzero(ahead))
    xy_px = camera.pixels(seen.icrs @ attitude.icrs_to_sensor.T)
    inside = np.flatnonzero(camera.contains(xy_px))
    saturating = 2 * math.pi * sigma_px**2 * FULL_WELL
    light = saturating * 10 ** (0.4 * (saturating_magnitude - seen.magnitude[inside]))
    electrons = drawn((camera.rows, camera.columns), xy_px[inside], light, sigma_px) + sky(camera, sky_electrons)
    electrons += random.standard_normal(electrons.shape, dtype=np.float32) * np.sqrt(electrons + 25)
    order = np.argsort(-light)
    return NightPicture(electrons, xy_px[inside][order], light[order])


def drawn(
    shape: tuple[int, int], xy_px: NDArray[np.float64], light: NDArray[np.float64], sigma_px: float
) -> NDArray[np.float64]:
    """Stars (N, 2) of so much light each, on nothing."""
    picture = np.zeros(shape, dtype=np.float32)
    steps = np.arange(-_RADIUS_PX, _RADIUS_PX + 2) - 0.5
    for (x, y), electrons in zip(xy_px, light, strict=True):
        column, row = round(x), round(y)
        across = np.diff(erf((column + steps - x) / sigma_px / math.sqrt(2))) / 2
        down = np.diff(erf((row + steps - y) / sigma_px / math.sqrt(2))) / 2
        top, left = row - _RADIUS_PX, column - _RADIUS_PX
        rows, columns = slice(max(-top, 0), max(shape[0] - top, 0)), slice(max(-left, 0), max(shape[1] - left, 0))
        spot = electrons * down[rows, None] * across[columns]
        picture[max(top, 0) :, max(left, 0) :][: spot.shape[0], : spot.shape[1]] += spot
    return picture


def sky(camera: Camera, electrons: float) -> NDArray[np.float64]:
    """The background of a picture: a slope, and the glow of a town in one corner."""
    y, x = np.ogrid[0 : camera.rows, 0 : camera.columns]
    reach = (camera.columns / 3) ** 2
    glow = np.exp(-((x - camera.columns) ** 2 + (y - camera.rows) ** 2) / (2 * reach))
    return (electrons * (1 + y / camera.rows + 2 * glow)).astype(np.float32)


def published(picture: NightPicture, *, gain: float = 1.0, quality: int = 90) -> Image.Image:
    """The picture as it is published: mosaic, demosaicing, gamma and 8 bits; ``save`` it as JPEG of ``quality``."""
    linear = np.clip(picture.electrons * gain / FULL_WELL, 0, 1)
    rows, columns = linear.shape
    colours = np.empty((rows, columns, 3), dtype=np.float32)
    near = np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 2.0], [1.0, 2.0, 1.0]])
    y, x = np.ogrid[0:rows, 0:columns]
    for colour, sees in enumerate(((y % 2 == 0) & (x % 2 == 0), (y + x) % 2 == 1, (y % 2 == 1) & (x % 2 == 1))):
        shown = np.where(sees, linear * _COLOURS[colour], 0)
        colours[:, :, colour] = convolve(shown, near) / convolve(sees.astype(np.float32), near)
    return Image.fromarray(np.rint(255 * np.clip(colours, 0, 1) ** (1 / 2.2)).astype(np.uint8))
