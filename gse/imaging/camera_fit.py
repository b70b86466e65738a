"""The camera fitted to identified stars: focal length, principal point, radial distortion, tangential on request.

Each panorama has an attitude of its own, so that neither mount nor clock enter. Minimised is the difference of
the undistorted measured place and the place of the star by the pinhole, in pixels (Gauss-Newton with Cauchy weights;
the attitudes are eliminated by the Schur complement). Stars must be given as they are seen: apparent and refracted.

To first order the principal point cannot be told from the attitude: with 14 deg of field and 10,000 stars it is good to
half a pixel, and moving it moves the boresight. So principal point and distortion are held where they were unless the
stars show otherwise with some certainty, and a mount must be fitted anew after a principal point has moved.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.errors import UsageError
from gse.values.attitude import solve_attitudes
from gse.values.camera import Camera
from gse.values.constants import MAD_TO_SIGMA
from gse.values.matrices import inv, product, solve
from gse.values.star_influence import star_covariance

MIN_STARS = 50
"""Five parameters (or seven) and three per panorama want more equations than that many stars give."""
MIN_STARS_OF_ONE = 20
"""One panorama has no more than 30 stars: these give 40 equations for its eight unknowns (or ten)."""

_MIN_PER_FRAME = 4
_ROUNDS = 30
_STEADY_PX = 1e-7
_CAUCHY = 2.4
"""Weights 1 / (1 + (r / (2.4 sigma))^2): 95 % efficient for Gaussian noise (Holland & Welsch 1977)."""
_NOISE_FLOOR_PX = 1e-6
_MAP_CELLS = 8
_HOLDABLE = {"principal point": [1, 2], "distortion": [3, 4], "tangential distortion": [5, 6]}
_HELD_BELOW = 16.0
"""Chi-square of two parameters: by chance one in 3000 is larger."""
_HOLD = 1e12
"""Times the weight of a prior: nothing moves against it."""


@dataclass(frozen=True, slots=True, eq=False)
class StarField:
    """One panorama with names: where objects are, (N, 2) px, and the directions (N, 3) in which their stars are seen,
    in any axes that are fixed during the exposure; ``numbers`` (N,) identify the stars across panoramas."""

    xy_px: NDArray[np.float64]
    stars: NDArray[np.float64]
    numbers: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Residuals:
    """How far stars lie from their places, in pixels; ``outliers`` are further than 5 sigma off."""

    n: int
    rms_px: float
    median_px: float
    sigma_axis_px: float
    outliers: int


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A fitted camera.

    ``sigma`` are the standard deviations of focal length, principal point x and y (px), k1, k2, and p1 and p2 where
    they were fitted, from ``covariance`` (5, 5) or (7, 7) in that order. The errors of one star are taken as dependent
    on each other, however many panoramas it is in: it lies on the same pixels in many of them. ``map_px`` (8, 8, 3)
    holds the mean residual along x and y and the number of stars in each cell of the detector, rows first. ``held``
    names what was left as it was (``principal point``, ``distortion``), because its change would have been within 4
    sigma; the covariance is that without holding.
    """

    camera: Camera
    before: Residuals
    after: Residuals
    covariance: NDArray[np.float64]
    map_px: NDArray[np.float64]
    panoramas: int
    held: tuple[str, ...]

    @property
    def sigma(self) -> tuple[float, ...]:
        """Standard deviations of focal length, principal point x and y, k1, k2, and p1, p2 where they were fitted."""
        return tuple(float(value) for value in np.sqrt(np.diag(self.covariance)))


def calibrate(
    camera: Camera, fields: Sequence[StarField], *, anchor: Camera | None = None, tangential: bool = False
) -> Calibration:
    """Fit a camera, starting from one that identified the stars; UsageError where there are too few.

    ``anchor`` (default: the same) is the camera whose principal point and distortion are held. Tangential distortion
    stays as it is unless ``tangential``: it is hard to tell from the principal point.
    """
    fields = [field for field in fields if len(field.xy_px) >= _MIN_PER_FRAME]
    stars = sum(len(field.xy_px) for field in fields)
    fewest = MIN_STARS_OF_ONE if len(fields) == 1 else MIN_STARS
    if stars < fewest:
        raise UsageError(f"{stars} identified stars are too few to calibrate on; expected at least {fewest}")
    anchor = anchor or camera
    prior = _prior(anchor)[: 7 if tangential else 5]
    free = _fitted(camera, anchor, fields, prior)
    covariance = _covariance(free, fields)
    held = {
        name: places
        for name, places in _HOLDABLE.items()
        if places[-1] < len(prior)
        and _chi_square(_parameters(free.camera) - _parameters(anchor), covariance, places) < _HELD_BELOW
    }
    for places in held.values():
        prior[places] *= _HOLD
    fit = _fitted(free.camera, anchor, fields, prior) if held else free
    before = _residuals(camera, fields, _attitudes(camera, fields))
    after = _residuals(fit.camera, fields, fit.rotations)
    return Calibration(
        fit.camera, before, after, covariance, _map(fit.camera, fields, fit.rotations), len(fields), tuple(held)
    )


class _CameraFit(NamedTuple):
    """A camera, an attitude for each panorama (P, 3, 3), and the normal matrix (K, K) of the camera's K parameters."""

    camera: Camera
    rotations: NDArray[np.float64]
    normal: NDArray[np.float64]


def _fitted(camera: Camera, anchor: Camera, fields: Sequence[StarField], prior: NDArray[np.float64]) -> _CameraFit:
    fit = _CameraFit(camera, _attitudes(camera, fields), np.eye(len(prior)))
    for _ in range(_ROUNDS):
        fit, step_px = _improve(fit, anchor, fields, prior)
        if step_px < _STEADY_PX:
            break
    return fit


def _chi_square(change: NDArray[np.float64], covariance: NDArray[np.float64], places: list[int]) -> float:
    part = change[places]
    return float(product(part, solve(covariance[np.ix_(places, places)], part)))


def _attitudes(camera: Camera, fields: Sequence[StarField]) -> NDArray[np.float64]:
    whole, place = _together(fields)
    ends = np.bincount(place).cumsum()
    return solve_attitudes(camera.directions(whole.xy_px), whole.stars, ends, camera.pixel_rad).icrs_to_sensor


def _together(fields: Sequence[StarField]) -> tuple[StarField, NDArray[np.int64]]:
    """All stars of all panoramas, and the panorama of each (N,): sums over each take a tenth of the time of a loop."""
    columns = [(field.xy_px, field.stars, field.numbers) for field in fields]
    place = np.repeat(np.arange(len(fields)), [len(field.numbers) for field in fields])
    return StarField(*(np.concatenate(column) for column in zip(*columns, strict=True))), place


def _summed(values: NDArray[np.float64], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Sums (P, ...) of the values (N, ...) of each panorama."""
    return np.add.reduceat(values, np.flatnonzero(np.diff(place, prepend=-1)), axis=0)


def _parameters(camera: Camera) -> NDArray[np.float64]:
    optics = camera.radial_distortion, camera.tangential_distortion
    return np.array([camera.focal_length_px, *camera.principal_point_px, *optics[0], *optics[1]])


def _with(camera: Camera, parameters: NDArray[np.float64]) -> Camera:
    f, x, y, k1, k2, p1, p2 = (float(value) for value in parameters)
    moved = replace(camera, focal_length_px=f, principal_point_px=(x, y))
    return replace(moved, radial_distortion=(k1, k2), tangential_distortion=(p1, p2))


def _prior(camera: Camera) -> NDArray[np.float64]:
    """Inverse variances that keep parameters which the stars do not tell: a tenth of f and width, 0.1 in k and p."""
    lengths = camera.focal_length_px / 10, camera.columns / 10, camera.columns / 10
    return np.array([*lengths, 0.1, 0.1, 0.1, 0.1]) ** -2.0


def _misfit(
    camera: Camera, field: StarField, rotation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Residuals (N, 2), their derivatives by the camera (N, 2, 7) and by a small rotation of the attitude (N, 2, 3).

    The rotation (3, 3) is that of all stars, or there is one for each (N, 3, 3).
    """
    # A measured place is undistorted, which is a polynomial, and the pinhole's place of the star is taken from it:
    # residual = offset (1 + k1 s^2 + k2 s^4) + aside - f (x / z, y / z). Distorting the star's place instead would
    # take an inversion at each step.
    offset = field.xy_px - camera.principal_point_px
    s2 = (offset**2).sum(axis=1) / (camera.columns / 2) ** 2
    k1, k2 = camera.radial_distortion
    stretch = 1 + s2 * (k1 + s2 * k2)
    x, y, z = (rotation * field.stars[:, None, :]).sum(axis=-1).T
    flip = np.array([-1.0 if camera.mirrored else 1.0, 1.0])
    pinhole = np.column_stack([x / z, y / z]) * flip
    half = camera.columns / 2
    a, b = (offset / half).T
    by_p1, by_p2 = np.column_stack([2 * a * b, a**2 + 3 * b**2]), np.column_stack([3 * a**2 + b**2, 2 * a * b])
    p1, p2 = camera.tangential_distortion
    aside = half * (p1 * by_p1 + p2 * by_p2)
    residual = offset * stretch[:, None] + aside - camera.focal_length_px * pinhole
    by_s2 = (k1 + 2 * k2 * s2) * 2 / (camera.columns / 2) ** 2
    by_camera = np.empty((len(offset), 2, 7))
    by_camera[:, :, 0] = -pinhole
    by_camera[:, :, 1:3] = -(
        stretch[:, None, None] * np.eye(2) + by_s2[:, None, None] * offset[:, :, None] * offset[:, None, :]
    )
    across = 2 * np.array([[p1 * b + 3 * p2 * a, p1 * a + p2 * b], [p1 * a + p2 * b, 3 * p1 * b + p2 * a]])
    by_camera[:, :, 1:3] -= across.transpose(2, 0, 1)
    by_camera[:, :, 3] = offset * s2[:, None]
    by_camera[:, :, 4] = offset * (s2**2)[:, None]
    by_camera[:, :, 5], by_camera[:, :, 6] = half * by_p1, half * by_p2
    # v + w x v: d(x/z) and d(y/z) by w
    u, v = x / z, y / z
    by_rotation = np.empty((len(offset), 2, 3))
    by_rotation[:, 0] = np.column_stack([-u * v, 1 + u * u, -v])
    by_rotation[:, 1] = np.column_stack([-(1 + v * v), u * v, u])
    by_rotation *= -camera.focal_length_px * flip[None, :, None]
    return residual, by_camera, by_rotation


def _improve(
    fit: _CameraFit, anchor: Camera, fields: Sequence[StarField], prior: NDArray[np.float64]
) -> tuple[_CameraFit, float]:
    """One Gauss-Newton step, and how far it moves a corner."""
    # The unknowns are K of the camera and three of each attitude, and no attitude knows of another:
    #
    #     [ normal     cross_1  cross_2 .. ] [ step   ]   [ right   ]
    #     [ cross_1^T  A_1      0          ] [ turn_1 ] = [ right_1 ]
    #     [ cross_2^T  0        A_2        ] [ turn_2 ]   [ right_2 ]
    #
    # So each panorama gives up its turn by its own 3 x 3 block, turn = A^-1 (right - cross^T step), and K equations
    # are left, however many panoramas there are (the Schur complement).
    camera, count = fit.camera, len(prior)
    stars, place = _together(fields)
    residual, by_all, by_rotation = _misfit(camera, stars, fit.rotations[place])
    by_camera, weight = by_all[:, :, :count], _weight(residual, _sigma_axis_px(residual))
    rotation_normal, cross = _of_attitudes(by_rotation, by_camera, weight, place)
    rotation_right = -_summed(np.einsum("n,nki,nk->ni", weight, by_rotation, residual), place)
    eliminated = solve(rotation_normal, np.concatenate([cross, rotation_right[:, :, None]], axis=2))
    flat, flat_cross = by_camera.reshape(-1, count), cross.reshape(-1, count)
    weighted = np.repeat(weight, 2)[:, None] * flat
    normal = (
        np.diag(prior) + product(weighted.T, flat) - product(flat_cross.T, eliminated[:, :, :count].reshape(-1, count))
    )
    right = prior * (_parameters(anchor) - _parameters(camera))[:count]
    right = right - product(weighted.T, residual.ravel()) - product(flat_cross.T, eliminated[:, :, count].ravel())
    step = solve(normal, right)
    turned = _turned(fit.rotations, eliminated[:, :, count] - product(eliminated[:, :, :count], step))
    # A step is told in pixels, by how far it moves a star at the edge: k moves one by half * k there, p by three times.
    half = camera.columns / 2
    reach = np.array([half / camera.focal_length_px, 1, 1, half, half, 3 * half, 3 * half])[:count]
    moved = _parameters(camera)
    moved[:count] += step
    return _CameraFit(_with(camera, moved), turned, normal), float(np.abs(step * reach).max())


def _of_attitudes(
    by_rotation: NDArray[np.float64],
    by_camera: NDArray[np.float64],
    weight: NDArray[np.float64],
    place: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of each panorama: the normal matrix of its attitude (P, 3, 3), and of that and the camera (P, 3, K)."""
    weighted = (weight[:, None, None] * by_rotation).transpose(0, 2, 1)
    return _summed(product(weighted, by_rotation), place), _summed(product(weighted, by_camera), place)


def _covariance(fit: _CameraFit, fields: Sequence[StarField]) -> NDArray[np.float64]:
    """Covariance (K, K) of an M-estimate (Huber 1981, section 7.6) whose errors depend on each other star by star."""
    camera, rotations, normal = fit
    stars, place = _together(fields)
    residual, by_all, by_rotation = _misfit(camera, stars, rotations[place])
    by_camera, sigma = by_all[:, :, : len(normal)], _sigma_axis_px(residual)
    weight = _weight(residual, sigma)
    rotation_normal, cross = _of_attitudes(by_rotation, by_camera, weight, place)
    # What a star does to the camera: its own slope, less the part that the attitude of its panorama takes over.
    operators = (by_camera - product(by_rotation, solve(rotation_normal, cross)[place])).transpose(0, 2, 1)
    softness = [_softness(residual[place == panorama], sigma) for panorama in range(len(fields))]
    summed = star_covariance(operators, weight[:, None] * residual, stars.numbers, place, within_blocks=True)
    # What the fit takes out of the residuals: its parameters from all stars, three angles from each panorama.
    different, per_panorama = len(np.unique(stars.numbers)), len(place) / len(fields)
    left = (1 - 1.5 / per_panorama) * (1 - len(normal) / 2 / different)
    inverse = inv(normal) / (float(np.concatenate(softness).mean()) * left)
    return np.asarray(product(inverse, summed, inverse), dtype=np.float64)


def _softness(residual: NDArray[np.float64], sigma_px: float) -> NDArray[np.float64]:
    """By how much less than its weight a star resists (N,): a growing residual lowers the weight itself."""
    s2 = (residual**2).sum(axis=1) / (_CAUCHY * sigma_px) ** 2
    return np.asarray(1 / (1 + s2) ** 2 / (1 / (1 + s2)).mean(), dtype=np.float64)


def _weight(residual: NDArray[np.float64], sigma_px: float) -> NDArray[np.float64]:
    weight = 1 / sigma_px**2 / (1 + (residual**2).sum(axis=1) / (_CAUCHY * sigma_px) ** 2)
    return np.asarray(weight, dtype=np.float64)


def _turned(rotations: NDArray[np.float64], by: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations (..., 3, 3) turned by rotation vectors (..., 3) after them: Rodrigues' formula."""
    x, y, z = np.moveaxis(by, -1, 0)
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(*by.shape, 3)
    turns_by = np.linalg.norm(by, axis=-1)[..., None, None] / np.pi
    turn = np.eye(3) + np.sinc(turns_by) * cross + np.sinc(turns_by / 2) ** 2 / 2 * product(cross, cross)
    return np.asarray(product(turn, rotations), dtype=np.float64)


def _all_residuals(camera: Camera, fields: Sequence[StarField], rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    stars, place = _together(fields)
    return _misfit(camera, stars, rotations[place])[0]


def _sigma_axis_px(residual: NDArray[np.float64]) -> float:
    return max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), _NOISE_FLOOR_PX)


def _residuals(camera: Camera, fields: Sequence[StarField], rotations: NDArray[np.float64]) -> Residuals:
    residual = _all_residuals(camera, fields, rotations)
    length = np.hypot(residual[:, 0], residual[:, 1])
    sigma = _sigma_axis_px(residual)
    good = length <= 5 * sigma
    rms = float(np.sqrt((length[good] ** 2).mean())) if good.any() else math.nan
    return Residuals(len(length), rms, float(np.median(length)), sigma, int((~good).sum()))


def _map(camera: Camera, fields: Sequence[StarField], rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean residual along x and y and number of stars in 8 x 8 cells of the detector, without outliers."""
    residual = _all_residuals(camera, fields, rotations)
    xy_px = np.concatenate([field.xy_px for field in fields])
    good = np.hypot(residual[:, 0], residual[:, 1]) <= 5 * _sigma_axis_px(residual)
    size = np.array([camera.columns, camera.rows])
    cell = np.clip(((xy_px[good] + 0.5) / size * _MAP_CELLS).astype(int), 0, _MAP_CELLS - 1)
    place = cell[:, 1] * _MAP_CELLS + cell[:, 0]
    count = np.bincount(place, minlength=_MAP_CELLS**2)
    sums = [np.bincount(place, weights=residual[good, axis], minlength=_MAP_CELLS**2) for axis in (0, 1)]
    means = [np.divide(total, count, out=np.zeros(len(total)), where=count > 0) for total in sums]
    return np.column_stack([*means, count]).reshape(_MAP_CELLS, _MAP_CELLS, 3)
