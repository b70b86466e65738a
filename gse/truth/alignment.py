"""Direction of the mount from measured attitudes: a mean of rotations, with its residuals.

Works with rotations, not angles: the zenith and the poles are not special cases.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import erfa
import numpy as np
from numpy.typing import NDArray

from gse.errors import UsageError
from gse.truth.frames import horizon_to_sensor, mount_of
from gse.values.constants import ARCSEC_PER_RAD, MAD_TO_SIGMA
from gse.values.matrices import pinv, product
from gse.values.mount import Mount

_REJECT_SIGMA = 5.0
_ROUNDS = 20
_MOST_COMPARED = 200
"""Frames of which each is compared with each other: 200 are 3 MB."""
_BLOCK_NS = 20_000_000_000
"""Frames within 20 s share the errors of the same pixels: their means count as independent, not they."""
_MIN_BLOCKS = 8
"""A shorter fit than 160 s has shorter blocks: fewer means do not tell their own scatter."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """A fitted mount: from the instants ``from_ns`` to ``until_ns``, on ``n`` frames, with ``rejected`` others.

    ``covariance_arcsec2`` (3 x 3) is of the fitted direction's small rotation vector in the sensor frame (x, y across
    the boresight, z about it), from the scatter of means over 20 s, and from what single stars keep for longer where
    the stars were given; ``scatter_arcsec`` is the standard deviation of a single frame about the fit on the same axes.
    """

    mount: Mount
    covariance_arcsec2: tuple[tuple[float, float, float], ...]
    scatter_arcsec: tuple[float, float, float]
    n: int
    rejected: int
    from_ns: int
    until_ns: int

    def __str__(self) -> str:
        x, y, roll = self.sigma_arcsec
        return (
            f"mount fitted on {self.n} frames: azimuth {self.mount.azimuth_deg:.5f}, altitude "
            f"{self.mount.altitude_deg:.5f}, roll {self.mount.roll_deg:.4f} deg; good to {math.hypot(x, y):.2f} arcsec "
            f"across and {roll:.1f} arcsec about the boresight (1 sigma)"
        )

    @property
    def sigma_arcsec(self) -> tuple[float, float, float]:
        """Standard deviations of the fit: across the boresight along columns and rows, and about it."""
        x, y, z = (math.sqrt(max(self.covariance_arcsec2[i][i], 0.0)) for i in range(3))
        return x, y, z

    @property
    def sigma_azimuth_altitude_roll_arcsec(self) -> tuple[float, float, float]:
        """Standard deviations of the three angles; near the zenith azimuth and roll grow alike: only their sum is
        known there."""
        # Columns: by how much the sensor frame turns (about its own axes) per radian of azimuth, altitude and roll.
        rotation = horizon_to_sensor(self.mount)
        azimuth = math.radians(self.mount.azimuth_deg)
        axes_horizon = np.column_stack([[0, 0, -1.0], [math.cos(azimuth), -math.sin(azimuth), 0.0], -rotation[2]])
        turns = product(rotation, axes_horizon)
        inverse = pinv(turns, rcond=1e-12)
        variance = np.diag(product(inverse, np.array(self.covariance_arcsec2), inverse.T))
        one, two, three = (float(value) for value in np.sqrt(np.maximum(variance, 0.0)))
        return one, two, three


def fit_mount(
    utc_ns: Sequence[int] | NDArray[np.int64],
    horizon_to_sensor_each: NDArray[np.float64],
    *,
    persistent_arcsec2: NDArray[np.float64] | float = 0.0,
) -> Alignment:
    """The mount from measured rotations (M, 3, 3), horizon frame to sensor frame, at instants (M,).

    ``persistent_arcsec2`` (3, 3) is the covariance of what the stars keep (gse.values.star_influence): frames do not
    show it. Frames further than 5 sigma from the median are rejected. UsageError without a frame.
    """
    if len(utc_ns) == 0:
        raise UsageError("the mount cannot be fitted: no frame was identified; expected at least one")
    instants = np.asarray(utc_ns, dtype=np.int64)
    fitted = horizon_to_sensor_each[_most_central(horizon_to_sensor_each)]
    kept: NDArray[np.bool_] = np.ones(len(instants), dtype=bool)
    # Begin at the frame nearest to most others, since a mean over a false answer may lie nowhere near any of them. Then
    # in turn: leave out what is far from the median, and move to the mean of the rest, until neither changes.
    for _ in range(_ROUNDS):
        residual = small_rotations(horizon_to_sensor_each, fitted)
        middle = np.median(residual[kept], axis=0)
        sigma = np.maximum(MAD_TO_SIGMA * np.median(np.abs(residual[kept] - middle), axis=0), 1e-9)
        before, kept = kept, np.all(np.abs(residual - middle) <= _REJECT_SIGMA * sigma, axis=1)
        step = residual[kept].mean(axis=0)
        fitted = product(erfa.rv2m(-step), fitted)  # ERFA's turns the axes
        if (kept == before).all() and float(np.abs(step).max()) < 1e-12:
            break
    residual = small_rotations(horizon_to_sensor_each[kept], fitted) * ARCSEC_PER_RAD
    scatter = residual.std(axis=0, ddof=1) if len(residual) > 1 else np.full(3, math.nan)
    covariance = _covariance(instants[kept], residual) + persistent_arcsec2
    return Alignment(
        mount_of(fitted),
        tuple((row[0], row[1], row[2]) for row in covariance.tolist()),
        (float(scatter[0]), float(scatter[1]), float(scatter[2])),
        int(kept.sum()),
        int((~kept).sum()),
        int(instants[kept][0]),
        int(instants[kept][-1]),
    )


def small_rotations(rotations: NDArray[np.float64], about: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vectors (M, 3), in radians in the sensor frame, from one rotation (3, 3) to each of (M, 3, 3)."""
    turns = product(rotations, about.T)
    if (np.trace(turns, axis1=1, axis2=2) > 0).all():
        return np.asarray(-erfa.rm2v(turns))
    from scipy.spatial.transform import Rotation  # of half a turn ERFA loses the axis; most runs need not wait for this

    vectors: NDArray[np.float64] = Rotation.from_matrix(turns).as_rotvec().reshape(-1, 3)
    return vectors


def _most_central(rotations: NDArray[np.float64]) -> int:
    """A frame among the majority: the one nearest to half of the others, of at most _MOST_COMPARED."""
    step = math.ceil(len(rotations) / _MOST_COMPARED)
    some = rotations[::step]
    distance2 = ((some[:, None] - some[None]) ** 2).sum(axis=(2, 3))
    return int(np.median(distance2, axis=1).argmin()) * step


def time_blocks(utc_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """The numbers (M,) of the stretches of time, 20 s or less, whose means count as independent."""
    since_ns = utc_ns - utc_ns.min()
    return np.asarray(since_ns // min(_BLOCK_NS, int(since_ns.max()) // _MIN_BLOCKS + 1), dtype=np.int64)


def _covariance(utc_ns: NDArray[np.int64], residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the mean of residuals (M, 3), with the variance of Student's t of so few means."""
    blocks = time_blocks(utc_ns)
    # Frames within a few seconds show the same stars on the same pixels, so their scatter about each other tells little
    # of the error of the mean; means of 20 s stretches tell it.
    means = np.array([residual[blocks == number].mean(axis=0) for number in np.unique(blocks)])
    freedom = len(means) - 1
    if freedom < 3:
        return np.full((3, 3), math.nan)
    left = means - means.mean(axis=0)
    return np.asarray(product(left.T, left) / len(means) / (freedom - 2), dtype=np.float64)
