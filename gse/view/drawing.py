"""Shared by report and views: colours that the colour-blind tell apart, and the outline of the field."""

import itertools

import numpy as np
from numpy.typing import NDArray

from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.matrices import product

# Colours of views and report: those of Okabe and Ito, distinguishable with colour blindness.

SKY_BLUE = (86, 180, 233)
BLUE = (0, 114, 178)
GREEN = (0, 158, 115)
YELLOW = (240, 228, 66)
ORANGE = (230, 159, 0)
VERMILLION = (213, 94, 0)
PINK = (204, 121, 167)
GREY = (140, 140, 140)
PALE = (90, 90, 90)


def hex_of(colour: tuple[int, int, int]) -> str:
    """The colour as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def field_outline_icrs(attitude: Attitude, camera: Camera) -> NDArray[np.float64]:
    """The border of the detector on the celestial sphere, (N, 3) closed, ICRS axes."""
    return np.asarray(product(field_outline_sensor(camera), attitude.icrs_to_sensor))


def field_outline_sensor(camera: Camera) -> NDArray[np.float64]:
    """The same in sensor axes: it is the same for all attitudes."""
    right, bottom, steps = camera.columns - 0.5, camera.rows - 0.5, np.linspace(0, 1, 9)
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom], [-0.5, -0.5]])
    sides = [a + (b - a) * steps[:, None] for a, b in itertools.pairwise(corners)]
    return camera.directions(np.concatenate(sides))
