"""Raw attitudes: what a sensor sees of the catalogue's sky, before site, clock and mount are asked."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude, solve_attitude
from gse.camera import Camera
from gse.constants import ARCSEC_PER_RAD
from gse.diagnosis.gross_hypotheses import Hypothesis
from gse.instant import NS_PER_S
from gse.matrices import length, product
from gse.mount import Mount
from gse.star_influence import boresight_shifts
from gse.station.frame_columns import Columns
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor, small_rotations

_FRAMES = 15


@dataclass(frozen=True, slots=True, eq=False)
class RawAttitudes:
    """Attitudes as a sensor sees them, icrs_to_sensor (M, 3, 3) of catalogue places, at instants (M,) of the host.

    ``field_sensor`` (N, 3) are directions over the field of its camera.
    """

    utc_ns: NDArray[np.int64]
    icrs_to_sensor: NDArray[np.float64]
    field_sensor: NDArray[np.float64]

    def some(self, mask: NDArray[np.bool_]) -> "RawAttitudes":
        """First, middle and last of the masked (M,)."""
        return self.taken(np.flatnonzero(mask)[[0, int(mask.sum()) // 2, -1]])

    def taken(self, rows: NDArray[np.int64]) -> "RawAttitudes":
        """Some of them."""
        return RawAttitudes(self.utc_ns[rows], self.icrs_to_sensor[rows], self.field_sensor)

    @classmethod
    def of(cls, frames: Columns, answered: NDArray[np.int64], camera: Camera) -> "RawAttitudes":
        """From frames (rows of FRAME) of which these rows are answered, evenly spaced over them."""
        rows = answered[np.unique(np.linspace(0, len(answered) - 1, min(len(answered), _FRAMES)).astype(np.int64))]
        angles = np.column_stack([frames[name][rows] for name in ("ra_deg", "de_deg", "roll_deg")]).tolist()
        rotations = np.array([Attitude.from_angles(*of_one).icrs_to_sensor for of_one in angles])
        x, y = 0.7 * np.array([camera.columns, camera.rows]) / (2 * camera.focal_length_px)
        field = np.array([[0, 0, 1.0], [x, y, 1.0], [-x, y, 1.0], [x, -y, 1.0], [-x, -y, 1.0]])
        return cls(frames["utc_ns"][rows], rotations, field / np.linalg.norm(field, axis=1)[:, None])


def mount_under(raw: RawAttitudes, under: Hypothesis, orientation: EarthOrientation) -> NDArray[np.float64]:
    """The measured directions of the mount (M, 3, 3), corrected as a hypothesis has it."""
    truth = SiderealTruth(under.site, orientation)
    rotations = []
    for stamp_ns, icrs_to_sensor in zip(raw.utc_ns.tolist(), raw.icrs_to_sensor, strict=True):
        utc_ns = stamp_ns - round(under.clock_s * NS_PER_S)
        to_horizon = truth.icrs_to_horizon(utc_ns)
        straight = truth.unrefracted(raw.field_sensor, product(icrs_to_sensor, to_horizon[2]))
        apparent = truth.apparent(product(raw.field_sensor, icrs_to_sensor), utc_ns)
        rotations.append(product(solve_attitude(straight, apparent, 1e-4).icrs_to_sensor, to_horizon.T))
    return np.array(rotations)


def error_deg_of(measured: NDArray[np.float64], mount: Mount) -> float:
    """How far measured directions (M, 3, 3) are from a mount, on average over the frames."""
    turns = small_rotations(measured, horizon_to_sensor(mount))
    return math.degrees(length(turns.mean(axis=0)))


def errors_arcsec(measured: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """Errors (M, 3) of rotations along columns, along rows, and of roll."""
    return boresight_shifts(small_rotations(measured, true)) * ARCSEC_PER_RAD


def central(rotations: NDArray[np.float64]) -> int:
    """The rotation that is nearest to half of the others: no false answer."""
    distance2 = ((rotations[:, None] - rotations[None]) ** 2).sum(axis=(2, 3))
    return int(np.median(distance2, axis=1).argmin())
