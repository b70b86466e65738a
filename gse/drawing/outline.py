"""The border of the field of view on the celestial sphere."""

import itertools

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude
from gse.camera import Camera
from gse.matrices import product


def field_outline_icrs(attitude: Attitude, camera: Camera) -> NDArray[np.float64]:
    """The border of the detector on the celestial sphere, (N, 3) closed, ICRS axes."""
    return np.asarray(product(field_outline_sensor(camera), attitude.icrs_to_sensor))


def field_outline_sensor(camera: Camera) -> NDArray[np.float64]:
    """The same in sensor axes: it is the same for all attitudes."""
    right, bottom, steps = camera.columns - 0.5, camera.rows - 0.5, np.linspace(0, 1, 9)
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom], [-0.5, -0.5]])
    sides = [a + (b - a) * steps[:, None] for a, b in itertools.pairwise(corners)]
    return camera.directions(np.concatenate(sides))
