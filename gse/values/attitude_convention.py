"""The convention of a sensor's own answers: how its angles or its quaternion are to be read."""

import functools
import itertools
import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from gse.values.matrices import det, product

ReferenceFrame = Literal["ICRS", "J2000", "date", "B1950"]
"""Axes of RA and DE: ICRS, mean equator and equinox of J2000.0, true ones of date, or mean ones of B1950.0 (FK4)."""


_ROUNDED = 1e-4
"""An alignment sheet gives some five digits."""
ROLL_ZEROS_DEG = (0, 90, 180, 270)


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerRotation:
    """How the frame of the answers (a cube, a bracket, a satellite) sits on the sensor, from an alignment sheet.

    It turns coordinates in the frame of the answers into those of the sensor (x along columns, y along rows, z out of
    the boresight): as a ``quaternion`` (vector first, scalar last, as AttitudeConvention has them), or as a matrix
    whose rows are the sensor's ``axes`` in the frame of the answers. ``uncertainty_arcsec`` is the half-width of 95 %
    about each axis. One that was ``fitted`` on answers takes their constant error away: a session with it is relative.
    """

    quaternion: tuple[float, float, float, float] | None = None
    axes: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]] | None = None
    uncertainty_arcsec: Annotated[float, Interval(ge=0, le=648_000)]
    fitted: bool = False

    def __post_init__(self) -> None:
        if (self.quaternion is None) is (self.axes is None):
            raise ValueError("expected quaternion: [x, y, z, scalar], or axes: three rows of three numbers")
        if self.quaternion is not None and abs(math.hypot(*self.quaternion) - 1) > _ROUNDED:
            raise ValueError(f"the quaternion has the length {math.hypot(*self.quaternion):.6g}: expected 1")
        matrix = self.matrix()
        if not np.allclose(product(matrix, matrix.T), np.eye(3), atol=_ROUNDED) or det(matrix) < 0:
            raise ValueError("axes: expected three right-handed unit vectors at right angles")

    def matrix(self) -> NDArray[np.float64]:
        """The rotation (3, 3) from the frame of the answers to the sensor."""
        if self.quaternion is not None:
            return np.asarray(from_quaternions(np.array([self.quaternion]))[0])
        return np.array(self.axes, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeConvention:
    """How the sensor states its attitude; the defaults are those of the station's own answers.

    A quaternion with the vector part v and the scalar s turns reference axes into body axes: a direction has the body
    coordinates ((s^2 - v.v) I + 2 v v^T - 2 s [v x]) times its reference coordinates; ``conjugate`` is the inverse.
    ``body_axes`` are the axes of its body frame in words of the sensor frame (x along columns, y along rows, z out of
    the boresight), ``reference_axes`` those of its reference frame in words of ``frame``; both are right-handed, or
    both are mirrored. RA comes in degrees of the protocol, or in hours where the number is that. The roll of angles is
    the position angle of image up from north through east (``east``) or through west, less ``roll_zero_deg``.
    ``aberration`` is whether stellar aberration was taken out. Where the answers are not of the sensor's own frame but
    of another body's, ``rotation`` leads from that to the sensor.
    """

    scalar: Literal["first", "last"] = "last"
    conjugate: bool = False
    body_axes: str = "x y z"
    reference_axes: str = "x y z"
    frame: ReferenceFrame = "ICRS"
    ra_unit: Literal["deg", "h"] = "deg"
    roll_through: Literal["east", "west"] = "east"
    roll_zero_deg: int = 0
    aberration: Literal["corrected", "not corrected"] = "not corrected"
    rotation: AnswerRotation | None = None

    def __post_init__(self) -> None:
        if self.roll_zero_deg not in ROLL_ZEROS_DEG:
            raise ValueError(f"roll_zero_deg is {self.roll_zero_deg}: expected 0, 90, 180 or 270")
        handed = {key: det(axes_matrix(getattr(self, key), key)) for key in ("body_axes", "reference_axes")}
        if handed["body_axes"] * handed["reference_axes"] < 0:
            raise ValueError(
                f"body_axes {self.body_axes!r} and reference_axes {self.reference_axes!r}: one is mirrored and the "
                "other is not, and no quaternion turns the one into the other; mirror both, or none"
            )


def axes_matrix(axes: str, key: str = "axes") -> NDArray[np.float64]:
    """The matrix (3, 3) whose rows are three signed axes such as ``-y x z``; ValueError for others."""
    words = axes.split()
    if sorted(word.removeprefix("-") for word in words) != ["x", "y", "z"]:
        raise ValueError(f"{key} is {axes!r:.60}: expected x, y and z in some order, each with - or without: -y x z")
    rows = np.zeros((3, 3))
    for row, word in enumerate(words):
        rows[row, "xyz".index(word[-1])] = -1.0 if word[0] == "-" else 1.0
    return rows


@functools.cache
def proper_axes() -> dict[str, NDArray[np.float64]]:
    """The 24 right-handed ways to name three signed axes, with their matrices (3, 3)."""
    found = {}
    for order in itertools.permutations("xyz"):
        for signs in itertools.product(("", "-"), repeat=3):
            words = " ".join(sign + axis for sign, axis in zip(signs, order, strict=True))
            matrix = axes_matrix(words)
            if det(matrix) > 0:
                found[words] = matrix
    return found


def from_quaternions(
    quaternions: NDArray[np.float64], *, scalar: str = "last", conjugate: bool = False
) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from reference to body axes, of quaternions (M, 4) in the order of the wire.

    Their length does not matter; one of length zero, or with NaN, gives NaN.
    """
    length = np.linalg.norm(quaternions, axis=1)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = quaternions / length
    w, x, y, z = unit.T if scalar == "first" else np.roll(unit, 1, axis=1).T
    rotations = np.empty((len(unit), 3, 3))
    rotations[:, 0] = np.column_stack([w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)])
    rotations[:, 1] = np.column_stack([2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)])
    rotations[:, 2] = np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z])
    return rotations.transpose(0, 2, 1) if conjugate else rotations


def to_quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions (M, 4), scalar last, of rotations (M, 3, 3) from reference to body axes."""
    trace = np.trace(rotations, axis1=1, axis2=2)
    squares = np.column_stack([1 + 2 * np.diagonal(rotations, axis1=1, axis2=2) - trace[:, None], 1 + trace]) / 4
    greatest = squares.argmax(axis=1)
    r = rotations
    x, y, z, w = squares.T
    yz, zx, xy = ((r[:, i, j] + r[:, j, i]) / 4 for i, j in ((1, 2), (2, 0), (0, 1)))
    wx, wy, wz = ((r[:, i, j] - r[:, j, i]) / 4 for i, j in ((1, 2), (2, 0), (0, 1)))
    products = np.array([[x, xy, zx, wx], [xy, y, yz, wy], [zx, yz, z, wz], [wx, wy, wz, w]])  # by the greatest
    rows = products[greatest, :, np.arange(len(r))]
    return np.asarray(rows / np.linalg.norm(rows, axis=1)[:, None])


def from_angles(
    ra_deg: NDArray[np.float64], de_deg: NDArray[np.float64], roll_deg: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from reference axes to the sensor, of angles (M,) as ``Attitude`` has them."""
    ra, de, roll = (np.radians(angle) for angle in (ra_deg, de_deg, roll_deg))
    sin_a, cos_a, sin_d, cos_d, zero = np.sin(ra), np.cos(ra), np.sin(de), np.cos(de), np.zeros(len(ra))
    boresight = np.column_stack([cos_d * cos_a, cos_d * sin_a, sin_d])
    east, north = np.column_stack([-sin_a, cos_a, zero]), np.column_stack([-sin_d * cos_a, -sin_d * sin_a, cos_d])
    down = -np.cos(roll)[:, None] * north - np.sin(roll)[:, None] * east
    return np.stack([np.cross(down, boresight), down, boresight], axis=1)


def read_angles(angles_deg: NDArray[np.float64], convention: AttitudeConvention) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from the axes of ``convention.frame`` to the sensor, of RA, DE and roll (M, 3) as they came.

    An answer without a roll is read with a roll of 0.
    """
    ra_deg, de_deg, roll_deg = angles_deg.T
    ra_deg = ra_deg * (15.0 if convention.ra_unit == "h" else 1.0)
    sign = 1.0 if convention.roll_through == "east" else -1.0
    if convention.rotation is None:
        roll_deg = np.nan_to_num(roll_deg)  # a direction alone says nothing of another body's
    return _to_sensor(from_angles(ra_deg, de_deg, sign * roll_deg + convention.roll_zero_deg), convention)


def read_quaternions(quaternions: NDArray[np.float64], convention: AttitudeConvention) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) from the axes of ``convention.frame`` to the sensor, of quaternions (M, 4) as they came."""
    stated = from_quaternions(quaternions, scalar=convention.scalar, conjugate=convention.conjugate)
    read = np.asarray(product(axes_matrix(convention.body_axes).T, stated, axes_matrix(convention.reference_axes)))
    return _to_sensor(read, convention)


def _to_sensor(rotations: NDArray[np.float64], convention: AttitudeConvention) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) to the sensor, of those to the frame of its answers."""
    if convention.rotation is None:
        return rotations
    return np.asarray(product(convention.rotation.matrix(), rotations))


def to_answers(rotations: NDArray[np.float64], convention: AttitudeConvention) -> NDArray[np.float64]:
    """Rotations (M, 3, 3) to the frame of the answers, of those to the sensor."""
    if convention.rotation is None:
        return rotations
    return np.asarray(product(convention.rotation.matrix().T, rotations))


def state_quaternions(rotations: NDArray[np.float64], convention: AttitudeConvention) -> NDArray[np.float64]:
    """The inverse of ``read_quaternions``: the numbers (M, 4) that a sensor with this convention sends."""
    rotations = to_answers(rotations, convention)
    stated = product(axes_matrix(convention.body_axes), rotations, axes_matrix(convention.reference_axes).T)
    if convention.conjugate:
        stated = stated.transpose(0, 2, 1)
    last = to_quaternions(stated)
    return np.roll(last, 1, axis=1) if convention.scalar == "first" else last


def state_angles(rotations: NDArray[np.float64], convention: AttitudeConvention) -> NDArray[np.float64]:
    """The inverse of ``read_angles``: RA, DE and roll (M, 3) that a sensor with this convention sends."""
    rotations = to_answers(rotations, convention)
    x, y, z = rotations[:, 2].T
    up = -rotations[:, 1]
    ra = np.arctan2(y, x)
    east = -np.sin(ra) * up[:, 0] + np.cos(ra) * up[:, 1]
    north = np.hypot(x, y) * up[:, 2] - z * (np.cos(ra) * up[:, 0] + np.sin(ra) * up[:, 1])
    roll_deg = np.degrees(np.arctan2(east, north)) - convention.roll_zero_deg
    sign = 1.0 if convention.roll_through == "east" else -1.0
    ra_deg = np.degrees(ra) % 360 / (15.0 if convention.ra_unit == "h" else 1.0)
    return np.column_stack([ra_deg, np.degrees(np.arctan2(z, np.hypot(x, y))), sign * roll_deg % 360])
