"""Results of panoramas: columns of many, and the result of one as a view of its row."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gse.external.identifier import Given
from gse.identifier import Answers
from gse.station.columns import ANSWER_CHECKS, STATUSES, empty_rows
from gse.station.non_stellar import HOT_PIXEL, KINDS, UNKNOWN, Others
from gse.station.results import ERRORS, AnswerCheck, AttitudeError, Match, Matches, Starlight, Status
from gse.station.session_tables import MATCH, OTHER
from gse.station.shown_stars import rows_of
from gse.values import instant
from gse.values.attitude import Attitude, Attitudes, angles_deg
from gse.values.panorama import Panorama, Panoramas

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrameResult:
    """Result of a panorama, the ``k``-th of ``results``; one line of gse.frame/1."""

    results: "FrameResults"
    k: int

    @property
    def panorama(self) -> Panorama:
        """The panorama itself."""
        return self.results.panoramas[self.k]

    @property
    def row(self) -> NDArray[np.void]:
        """The one row (1,) of FRAME."""
        return self.results.rows[self.k : self.k + 1]

    @property
    def alone(self) -> "FrameResults":
        """The same as columns of one panorama."""
        return self.results.part(self.k, self.k + 1)

    @property
    def status(self) -> Status:
        """The outcome."""
        return STATUSES[int(self.results.status[self.k])]

    @property
    def detail(self) -> str:
        """Why there is no answer, in one line for a person; empty where there is one."""
        return self.results.details.get(self.k, "")

    @property
    def identifier(self) -> str:
        """The name of the identifier, or ``sensor`` where the sensor itself answered."""
        return self.results.identifier

    @property
    def false_match_probability(self) -> float:
        """Bound on the probability of such an answer to a panorama of random objects; NaN where none is known."""
        return float(self.results.answers.false_match_probability[self.k])

    @property
    def attitude(self) -> Attitude | None:
        """What the sensor would answer: from catalogue places in ICRS, with aberration and refraction in it."""
        return self.results.attitudes[self.k]

    @property
    def attitude_geometric(self) -> Attitude | None:
        """The same, freed of aberration and refraction."""
        return self.results.geometric[self.k]

    @property
    def attitude_true(self) -> Attitude | None:
        """Where the mount looked: geometric direction, ICRS axes."""
        return self.results.true[self.k]

    @property
    def attitude_error(self) -> AttitudeError | None:
        """Geometric minus true attitude."""
        error = self.results.errors_arcsec[self.k]
        return None if np.isnan(error).all() else AttitudeError(*error.tolist())

    @property
    def has_roll(self) -> bool:
        """False for an answer of RA and DE alone, whose roll means nothing."""
        return bool(self.results.has_roll[self.k])

    @property
    def matches(self) -> list[Match]:
        """The objects that the answer names, brightest first."""
        return self.results.matches[self.k]

    @property
    def others(self) -> tuple[tuple[int, str], ...]:
        """Objects without a star: (object, "hot pixel" | "Jupiter" | "unknown" ...)."""
        return self.results.others[self.k]

    @property
    def elapsed_us(self) -> float | None:
        """Time from objects to RA and DE; None where no identifier was asked."""
        elapsed_us = float(self.results.elapsed_us[self.k])
        return None if math.isnan(elapsed_us) else elapsed_us

    @property
    def answer_check(self) -> AnswerCheck:
        """The reference identifier's check of the answer."""
        return ANSWER_CHECKS[int(self.results.answer_check[self.k])]

    @property
    def given(self) -> Given | None:
        """What an external identifier gave."""
        return self.results.given.get(self.k)


@dataclass(frozen=True, eq=False)
class FrameResults(Sequence[FrameResult]):
    """Results of K panoramas as columns; ``results[k]`` is a view of one of them.

    ``status`` and ``answer_check`` (K,) are places in STATUSES and ANSWER_CHECKS, ``details`` the details that are not
    empty. The matches of ``answers`` have residuals (M, 2). ``errors_arcsec`` (K, 5) are the fields of AttitudeError,
    NaN where there is none, as ``elapsed_us`` (K,); a panorama may have an answer without a roll (``has_roll`` (K,)).
    ``reference_icrs`` (K, 3) is the boresight by the reference identifier, NaN where it has none, and ``given`` what
    an external identifier gave.
    """

    panoramas: Panoramas
    identifier: str
    star_name: Callable[[int], str]
    status: NDArray[np.uint8]
    details: Mapping[int, str]
    answers: Answers
    residuals_arcsec: NDArray[np.float64]
    elapsed_us: NDArray[np.float64]
    attitudes: Attitudes
    geometric: Attitudes
    true: Attitudes
    errors_arcsec: NDArray[np.float64]
    has_roll: NDArray[np.bool_]
    answer_check: NDArray[np.uint8]
    reference_icrs: NDArray[np.float64]
    others: Others
    light: Starlight
    left_out: Matches
    given: Mapping[int, Given] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.panoramas)

    def __iter__(self) -> Iterator[FrameResult]:
        return (FrameResult(self, k) for k in range(len(self)))

    def __getitem__(self, k: int) -> FrameResult:  # type: ignore[override]
        return FrameResult(self, range(len(self))[k])

    def part(self, begin: int, end: int) -> "FrameResults":
        """The results from ``begin`` to before ``end``."""
        if (begin, end) == (0, len(self)):
            return self
        each, (_, rows) = slice(begin, end), self.answers.parts.part(begin, end)
        return replace(
            self,
            panoramas=self.panoramas.part(begin, end),
            status=self.status[each],
            details=_within(self.details, begin, end),
            answers=self.answers.part(begin, end),
            residuals_arcsec=self.residuals_arcsec[rows],
            elapsed_us=self.elapsed_us[each],
            attitudes=self.attitudes.part(begin, end),
            geometric=self.geometric.part(begin, end),
            true=self.true.part(begin, end),
            errors_arcsec=self.errors_arcsec[each],
            has_roll=self.has_roll[each],
            answer_check=self.answer_check[each],
            reference_icrs=self.reference_icrs[each],
            others=self.others.part(begin, end),
            light=self.light.part(begin, end),
            left_out=self.left_out.part(begin, end),
            given=_within(self.given, begin, end),
        )

    @property
    def matches(self) -> Matches:
        """The matches of the answers."""
        answers = self.answers
        return Matches(answers.parts, answers.objects, answers.stars, self.residuals_arcsec, self.star_name)

    @cached_property
    def rows(self) -> NDArray[np.void]:
        """The rows (K,) of FRAME."""
        rows, panoramas, light = empty_rows(len(self)), self.panoramas, self.light
        for name in ("utc_ns", "host_utc_ns", "time_us", "frame_no", "sequence", "exposure_s", "temperature_c"):
            rows[name] = getattr(panoramas, name)
        rows["status"], rows["answer_check"], rows["elapsed_us"] = self.status, self.answer_check, self.elapsed_us
        rows["objects"] = np.minimum(panoramas.parts.counts, 255)
        rows["matched"] = np.minimum(self.answers.parts.counts, 255)
        rows["false_match_probability"] = self.answers.false_match_probability
        rows["stars_seen"] = np.minimum(light.stars, 255)
        rows["zero_point_mag"], rows["limiting_mag"] = light.zero_point_mag, light.limiting_mag
        rows["hot_pixels"], rows["false_objects"] = self.others.count(HOT_PIXEL), self._false_objects()
        answered, true = angles_deg(self.attitudes.icrs_to_sensor), angles_deg(self.true.icrs_to_sensor)
        answered[~self.has_roll, 2] = np.nan
        for axis, name in enumerate(("ra", "de", "roll")):
            rows[f"{name}_deg"], rows[f"{name}_true_deg"] = answered[:, axis], true[:, axis]
        x, y, z = self.reference_icrs.T
        rows["ra_reference_deg"] = np.degrees(np.arctan2(y, x)) % 360
        rows["de_reference_deg"] = np.degrees(np.arctan2(z, np.hypot(x, y)))
        for name, values in zip(ERRORS, self.errors_arcsec.T, strict=True):
            rows[name] = values
        return rows

    def _false_objects(self) -> NDArray[np.int64]:
        """Unknown objects that are brighter than every star that the mission catalogue lacks."""
        frame_of = self.others.parts.of_row
        brightness = self.panoramas.brightness.take(self.panoramas.parts.first[frame_of] + self.others.objects)
        return self.others.count(UNKNOWN, brightness > self.light.faintest_index[frame_of])

    def match_rows(self) -> NDArray[np.void]:
        """The rows (M,) of MATCH, by frame; ``frame`` counts from the first of these panoramas."""
        rows = self._match_rows(self.matches, True)
        if not len(self.left_out.objects):
            return rows
        rows = np.concatenate([rows, self._match_rows(self.left_out, False)])
        return rows.take(np.argsort(rows["frame"], kind="stable"))

    def other_rows(self) -> NDArray[np.void]:
        """The rows (M,) of OTHER, by frame; those of panoramas without an answer too."""
        panoramas, frame_of = self.panoramas, self.panoramas.parts.of_row
        kinds = np.full(len(frame_of), KINDS.index(UNKNOWN), dtype=np.uint8)
        kinds[panoramas.parts.first[self.others.parts.of_row] + self.others.objects] = self.others.kinds
        left = np.ones(len(frame_of), dtype=np.bool_)
        left[rows_of(panoramas.parts, self.answers)] = False
        rows = np.empty(int(left.sum()), dtype=OTHER)
        rows["frame"], rows["kind"] = frame_of[left], kinds[left]
        with np.errstate(over="ignore", invalid="ignore"):  # a sensor at fault sends any number
            rows["brightness"] = panoramas.brightness[left]
            rows["x_px"], rows["y_px"] = panoramas.xy_px[left].T
        return rows

    def _match_rows(self, matches: Matches, named: bool) -> NDArray[np.void]:
        rows = np.empty(len(matches.objects), dtype=MATCH)
        seen = rows_of(self.panoramas.parts, matches)
        rows["frame"], rows["star"], rows["named"] = matches.parts.of_row, matches.stars, named
        rows["x_px"], rows["y_px"] = self.panoramas.xy_px.take(seen, axis=0).T
        rows["brightness"] = self.panoramas.brightness.take(seen)
        rows["residual_x_arcsec"], rows["residual_y_arcsec"] = matches.residuals_arcsec.T
        return rows


def _within(by_place: Mapping[int, T], begin: int, end: int) -> dict[int, T]:
    """What belongs to the places from ``begin`` to before ``end``, counted from there."""
    return {k - begin: value for k, value in by_place.items() if begin <= k < end}


FRAME_SCHEMA = "gse.frame/1"


def frame_json(result: FrameResult) -> dict[str, Any]:
    """One panorama's result as JSON; numbers are rounded well below their meaning, absent ones are null.

    RA, DE and roll are the sensor's answer: from catalogue places in ICRS, not corrected for aberration and
    refraction; the d_... are measured minus true after these corrections.
    """
    panorama, attitude, error, matches = result.panorama, result.attitude, result.attitude_error, result.matches
    elapsed_us = result.elapsed_us
    return {
        "schema": FRAME_SCHEMA,
        "utc": instant.to_text(panorama.utc_ns),
        "frame_no": panorama.frame_no,
        "status": result.status.value,
        "detail": result.detail,
        "identifier": result.identifier,
        "ra_deg": round(attitude.ra_deg, 7) if attitude else None,
        "de_deg": round(attitude.de_deg, 7) if attitude else None,
        "roll_deg": round(attitude.roll_deg, 6) if attitude and result.has_roll else None,
        "frame": "ICRS",
        "matched": len(matches),
        "objects": len(panorama.brightness),
        "chance": _number(result.false_match_probability, 3),
        "elapsed_us": None if elapsed_us is None else round(elapsed_us, 1),
        "d_ra_cosde_arcsec": round(error.d_ra_cosde_arcsec, 3) if error else None,
        "d_de_arcsec": round(error.d_de_arcsec, 3) if error else None,
        "d_roll_arcsec": round(error.d_roll_arcsec, 3) if error and result.has_roll else None,
        "answer_check": result.answer_check.value,
        "matches": [
            {"object": match.object, "star": match.star, "residual_arcsec": round(match.residual_arcsec, 2)}
            for match in matches
        ],
        "others": [{"object": row, "kind": kind} for row, kind in result.others],
    }


def _number(value: float, digits: int) -> float | None:
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
