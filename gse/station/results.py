"""Words and values of results: statuses, matches, attitude errors, starlight; byte and frame counters of the link."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.process.jit import compiled
from gse.values.attitude import Attitude
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.panorama import Parts
from protocols import AttitudeMessage


class Status(StrEnum):
    """Outcome of a panorama; ``status`` in gse.frame/1."""

    IDENTIFIED = "IDENTIFIED"
    TOO_FEW = "TOO_FEW"
    NO_MATCH = "NO_MATCH"
    AMBIGUOUS = "AMBIGUOUS"
    SENSOR_FAULT = "SENSOR_FAULT"
    IDENTIFIER_FAULT = "IDENTIFIER_FAULT"
    """An external identifier crashed, hung or gave nonsense."""


class AnswerCheck(StrEnum):
    """The reference identifier's check of an answer under test; UNKNOWN where it has no answer itself."""

    CORRECT = "correct"
    FALSE = "false"
    ABSENT = "absent"
    UNKNOWN = "unknown"


class SkyCondition(StrEnum):
    """What the stars, the Sun and the objects of some seconds say of the sky."""

    UNKNOWN = "unknown"
    CLEAR = "clear"
    CLOUDED = "clouded"
    NO_STARS = "no stars"
    DAYLIGHT = "daylight"


class Verdict(StrEnum):
    """Verdict on a session."""

    PASS = "PASS"
    FAIL = "FAIL"
    INCONCLUSIVE = "INCONCLUSIVE"


class Subject(StrEnum):
    """Source of the answers under test."""

    ONBOARD = "onboard"
    """The identifier under test: the onboard-equivalent one, run here."""
    SENSOR = "sensor"
    """The answers that the sensor itself sends."""


@dataclass(frozen=True, slots=True)
class OwnAnswer:
    """An ATTITUDE message: when its first byte was read, and the UTC of its exposure where no panorama gives it."""

    message: AttitudeMessage
    host_utc_ns: int
    utc_ns: int | None
    sequence: int = 0


@dataclass(frozen=True, slots=True)
class Match:
    """An identified object: its row in the panorama, the star's name, and the residual.

    The residual is measured minus expected direction, along columns and rows, both freed of refraction and aberration
    where site and time are known.
    """

    object: int
    star: str
    residual_x_arcsec: float
    residual_y_arcsec: float

    @property
    def residual_arcsec(self) -> float:
        """Length of the residual in arcsec."""
        return math.hypot(self.residual_x_arcsec, self.residual_y_arcsec)


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Objects of K panoramas that are stars, as columns of M rows, in parts; ``matches[k]`` are those of one.

    ``objects`` (M,) are rows of their panorama, ``stars`` (M,) rows of the catalogue that ``name_of`` knows, and
    ``residuals_arcsec`` is (M, 2); brightest first.
    """

    parts: Parts
    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    residuals_arcsec: NDArray[np.float64]
    name_of: Callable[[int], str]

    @classmethod
    def none(cls, count: int) -> Self:
        """No matches of so many panoramas."""
        nothing = np.zeros(0, np.int64)
        return cls(Parts(np.zeros(count + 1, dtype=np.int64)), nothing, nothing, np.zeros((0, 2)), str)

    def __getitem__(self, k: int) -> list[Match]:
        rows = self.parts.rows(k)
        columns = self.objects[rows].tolist(), self.stars[rows].tolist(), self.residuals_arcsec[rows].tolist()
        return [Match(row, self.name_of(star), x, y) for row, star, (x, y) in zip(*columns, strict=True)]

    def part(self, begin: int, end: int) -> Self:
        """The matches of the panoramas from ``begin`` to before ``end``."""
        parts, rows = self.parts.part(begin, end)
        return type(self)(parts, self.objects[rows], self.stars[rows], self.residuals_arcsec[rows], self.name_of)


@dataclass(frozen=True, slots=True)
class AttitudeError:
    """Measured minus true attitude, all in arcsec.

    ``d_ra_cosde`` is towards east and ``d_de`` towards north, at the true boresight (on the tangent plane there, so
    that the poles are not special cases); ``d_roll`` about the boresight; ``cross_x`` and ``cross_y`` are the
    cross-boresight errors in the sensor frame: where the measured boresight lies along columns and rows.
    """

    d_ra_cosde_arcsec: float
    d_de_arcsec: float
    d_roll_arcsec: float
    cross_x_arcsec: float
    cross_y_arcsec: float


ERRORS = tuple(item.name for item in fields(AttitudeError))
"""Columns of errors, in their order."""


def attitude_error(measured: Attitude, true: Attitude) -> AttitudeError:
    """The error of a measured attitude against the true one.

    E = measured true^T; the directions are taken on the tangent plane of the true boresight with the angle itself as
    length (arcs from the true boresight), the roll is the part of E about the boresight: no angle is subtracted from
    another, so that neither the poles nor RA = 0 nor an error of many degrees is a special case. At a pole itself
    "east" is that of the meridian RA = 0.
    """
    (error,) = attitude_errors(measured.icrs_to_sensor[None], true.icrs_to_sensor[None])
    return AttitudeError(*error.tolist())


def attitude_errors(measured: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """``attitude_error`` of measured rotations (K, 3, 3) against true ones: the fields of AttitudeError, (K, 5)."""
    errors_arcsec = np.empty((len(measured), 5))
    _put_errors(np.ascontiguousarray(measured), np.ascontiguousarray(true), errors_arcsec)
    return errors_arcsec


@compiled
def _put_errors(measured: NDArray[np.float64], true: NDArray[np.float64], errors_arcsec: NDArray[np.float64]) -> None:
    """Put the fields of AttitudeError (K, 5) for rotations (K, 3, 3) into ``errors_arcsec``."""
    for k in range(len(measured)):
        e = np.zeros((3, 3))
        for i in range(3):
            for j in range(3):
                for axis in range(3):
                    e[i, j] += measured[k, i, axis] * true[k, j, axis]
        x, y = e[2, 0], e[2, 1]  # the measured boresight, in the true frame
        across = math.hypot(x, y)
        arc = ARCSEC_PER_RAD * (math.atan2(across, e[2, 2]) / across if across else 1.0)
        bx, by, bz = true[k, 2, 0], true[k, 2, 1], true[k, 2, 2]
        level = math.hypot(bx, by)
        cos_ra, sin_ra = (bx / level, by / level) if level else (1.0, 0.0)
        off_x, off_y = x * true[k, 0, 0] + y * true[k, 1, 0], x * true[k, 0, 1] + y * true[k, 1, 1]
        off_z = x * true[k, 0, 2] + y * true[k, 1, 2]
        errors_arcsec[k, 0] = arc * (cos_ra * off_y - sin_ra * off_x)
        errors_arcsec[k, 1] = arc * (level * off_z - bz * (cos_ra * off_x + sin_ra * off_y))
        errors_arcsec[k, 2] = ARCSEC_PER_RAD * math.atan2(e[1, 0] - e[0, 1], e[0, 0] + e[1, 1])
        errors_arcsec[k, 3], errors_arcsec[k, 4] = arc * x, arc * y


@dataclass(frozen=True, slots=True, eq=False)
class Starlight:
    """What the named stars of K panoramas show of the sky, as columns (K,); NaN where none is named.

    ``zero_point_mag`` is the magnitude of a star with index value 1, ``limiting_mag`` that of the faintest named star.
    Objects brighter than ``faintest_index`` would be in the catalogue if they were stars.
    """

    stars: NDArray[np.int64]
    zero_point_mag: NDArray[np.float64]
    limiting_mag: NDArray[np.float64]
    faintest_index: NDArray[np.float64]

    @classmethod
    def none(cls, count: int) -> Self:
        """So many panoramas that show nothing."""
        nothing = np.full(count, np.nan)
        return cls(np.zeros(count, dtype=np.int64), nothing, nothing.copy(), np.full(count, np.inf))

    def fill(self, places: NDArray[np.bool_], others: Self) -> None:
        """Take the others' values at these places (K,)."""
        for column in fields(self):
            getattr(self, column.name)[places] = getattr(others, column.name)[places]

    def part(self, begin: int, end: int) -> Self:
        """The light of the panoramas from ``begin`` to before ``end``."""
        return type(self)(*(getattr(self, column.name)[begin:end] for column in fields(self)))


@dataclass(slots=True)
class LinkCounters:
    """Counters of all received bytes and all expected frames.

    ``frames_repeated`` counts the panoramas that a frozen sensor sent again and again instead of new ones; they are
    among the ``duplicates``. ``objects_beyond`` are those of panoramas of which only the 30 brightest are looked at.
    Of a sensor that is polled, ``requests`` were sent; ``unanswered`` ones got no panorama, ``late_answers`` came after
    the time that the station file gives, ``unasked`` panoramas without a request.
    """

    bytes_in: int = 0
    bytes_framed: int = 0
    bytes_discarded: int = 0
    frames: int = 0
    discarded_bytes_by_reason: dict[str, int] = field(default_factory=dict)
    duplicates: int = 0
    frames_repeated: int = 0
    frames_lost: int = 0
    objects_beyond: int = 0
    sensor_resets: int = 0
    requests: int = 0
    unanswered: int = 0
    late_answers: int = 0
    unasked: int = 0
    reconnects: int = 0
