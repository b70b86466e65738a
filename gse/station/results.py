"""Result types: one result per panorama; byte and frame counters of the link."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude
from gse.external.identifier import Given
from gse.identifier.result import Identification
from gse.panorama import Panorama
from gse.parts import Parts
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
    """The objects of a panorama that are stars, as columns; iterating gives them as Match, brightest first.

    ``objects`` (M,) are rows of the panorama, ``stars`` (M,) rows of the catalogue that ``name_of`` knows, and
    ``residuals_arcsec`` is (M, 2).
    """

    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    residuals_arcsec: NDArray[np.float64]
    name_of: Callable[[int], str]

    def __len__(self) -> int:
        return len(self.objects)

    def __iter__(self) -> Iterator[Match]:
        columns = self.objects.tolist(), self.stars.tolist(), self.residuals_arcsec.tolist()
        return (Match(row, self.name_of(star), x, y) for row, star, (x, y) in zip(*columns, strict=True))


NO_MATCHES = Matches(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), str)


@dataclass(frozen=True, slots=True, eq=False)
class MatchColumns:
    """Matches of K panoramas as columns of M rows, in parts; ``columns[k]`` are those of one."""

    parts: Parts
    objects: NDArray[np.int64]
    stars: NDArray[np.int64]
    residuals_arcsec: NDArray[np.float64]
    name_of: Callable[[int], str]

    @classmethod
    def none(cls, count: int) -> Self:
        """No matches of so many panoramas."""
        nothing = NO_MATCHES.objects, NO_MATCHES.stars, NO_MATCHES.residuals_arcsec
        return cls(Parts(np.zeros(count + 1, dtype=np.int64)), *nothing, str)

    @classmethod
    def of(cls, matches: Sequence[Matches]) -> Self:
        """The columns of matches given one by one, of one catalogue."""
        return cls(
            Parts.of_counts([len(of_one) for of_one in matches]),
            np.concatenate([NO_MATCHES.objects, *(of_one.objects for of_one in matches)]),
            np.concatenate([NO_MATCHES.stars, *(of_one.stars for of_one in matches)]),
            np.concatenate([NO_MATCHES.residuals_arcsec, *(of_one.residuals_arcsec for of_one in matches)]),
            matches[0].name_of if matches else str,
        )

    def __getitem__(self, k: int) -> Matches:
        rows = self.parts.rows(k)
        return Matches(self.objects[rows], self.stars[rows], self.residuals_arcsec[rows], self.name_of)

    def __iter__(self) -> Iterator[Matches]:
        return (self[k] for k in range(len(self.parts)))


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


@dataclass(frozen=True, slots=True)
class Starlight:
    """What the named stars of a panorama show of the sky; NaN where none is named.

    ``zero_point_mag`` is the magnitude of a star with index value 1, ``limiting_mag`` that of the faintest named star.
    Objects brighter than ``faintest_index`` would be in the catalogue if they were stars.
    """

    stars: int = 0
    zero_point_mag: float = math.nan
    limiting_mag: float = math.nan
    faintest_index: float = math.inf


NO_STARLIGHT = Starlight()


@dataclass(frozen=True, slots=True, eq=False)
class Starlights:
    """Starlight of K panoramas as columns; ``light[k]`` is that of one."""

    stars: NDArray[np.int64]
    zero_point_mag: NDArray[np.float64]
    limiting_mag: NDArray[np.float64]
    faintest_index: NDArray[np.float64]

    @classmethod
    def of(cls, lights: Sequence[Starlight]) -> Self:
        """The columns of what panoramas show one by one."""
        made = cls.none(len(lights))
        for k, light in enumerate(lights):
            made.stars[k], made.zero_point_mag[k] = light.stars, light.zero_point_mag
            made.limiting_mag[k], made.faintest_index[k] = light.limiting_mag, light.faintest_index
        return made

    @classmethod
    def none(cls, count: int) -> Self:
        """So many panoramas that show nothing."""
        nothing = np.full(count, np.nan)
        return cls(np.zeros(count, dtype=np.int64), nothing, nothing.copy(), np.full(count, np.inf))

    def fill(self, places: NDArray[np.bool_], others: Self) -> None:
        """Take the others' values at these places (K,)."""
        for column in fields(self):
            getattr(self, column.name)[places] = getattr(others, column.name)[places]

    def __getitem__(self, k: int) -> Starlight:
        columns = self.zero_point_mag, self.limiting_mag, self.faintest_index
        return Starlight(int(self.stars[k]), *(float(column[k]) for column in columns))


@dataclass(frozen=True, slots=True, eq=False)
class FrameResult:
    """Result of one panorama; one line of gse.frame/1.

    ``attitude`` is what the sensor would answer: from catalogue places in ICRS, uncorrected for aberration and
    refraction. ``attitude_geometric`` is the same with these corrections, ``attitude_true`` where the mount looked
    (geometric direction, ICRS axes), and ``attitude_error`` is between these two. ``others`` classifies non-stellar
    objects: (object, "hot pixel" | "Jupiter" | "unknown" ...). ``left_out`` are stars that the answer does not name
    although the panorama shows them. ``given`` is what an external identifier gave; an answer
    of RA and DE alone ``has_roll`` False, and its roll means nothing.
    """

    panorama: Panorama
    status: Status
    detail: str
    identifier: str
    identification: Identification | None = None
    attitude: Attitude | None = None
    matches: Matches = NO_MATCHES
    elapsed_us: float | None = None
    attitude_geometric: Attitude | None = None
    attitude_error: AttitudeError | None = None
    attitude_true: Attitude | None = None
    answer_check: AnswerCheck = AnswerCheck.UNKNOWN
    others: tuple[tuple[int, str], ...] = ()
    left_out: Matches = NO_MATCHES
    light: Starlight = NO_STARLIGHT
    has_roll: bool = True
    given: Given | None = None


@dataclass(slots=True)
class LinkCounters:
    """Counters of all received bytes and all expected frames.

    ``frames_repeated`` counts the panoramas that a frozen sensor sent again and again instead of new ones; they are
    among the ``duplicates``.
    """

    bytes_in: int = 0
    bytes_framed: int = 0
    bytes_discarded: int = 0
    frames: int = 0
    discarded_bytes_by_reason: dict[str, int] = field(default_factory=dict)
    duplicates: int = 0
    frames_repeated: int = 0
    frames_lost: int = 0
    sensor_resets: int = 0
    reconnects: int = 0
