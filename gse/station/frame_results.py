"""Results of many panoramas as columns; the FrameResult of one is made on demand."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitudes, angles_deg
from gse.identifier import Answers, Identification
from gse.panorama import Panoramas
from gse.station.columns import ANSWER_CHECKS, STATUSES, empty_rows
from gse.station.frame_table import MATCH, OTHER
from gse.station.non_stellar import HOT_PIXEL, KINDS, UNKNOWN, Others
from gse.station.results import NO_MATCHES, AttitudeError, FrameResult, MatchColumns, Matches, Starlights
from gse.station.starlight import rows_of

ERRORS = tuple(field.name for field in fields(AttitudeError))


@dataclass(frozen=True, slots=True, eq=False)
class FrameResults(Sequence[FrameResult]):
    """Results of K panoramas; ``results[k]`` is one of them.

    ``status`` and ``answer_check`` (K,) are places in STATUSES and ANSWER_CHECKS, ``details`` the details that are not
    empty. The matches of ``answers`` have residuals (M, 2). ``errors_arcsec`` (K, 5) are the fields of AttitudeError,
    NaN where there is none, as ``elapsed_us`` (K,). ``made`` are the results that were made one by one.
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
    answer_check: NDArray[np.uint8]
    others: Others
    light: Starlights
    left_out: MatchColumns
    made: Sequence[FrameResult] = ()

    @classmethod
    def of(cls, results: Sequence[FrameResult]) -> Self:
        """The columns of results that were made one by one."""
        errors = [result.attitude_error for result in results]
        matches = [result.matches for result in results]
        return cls(
            Panoramas.of([result.panorama for result in results]),
            results[0].identifier,
            results[0].matches.name_of,
            np.array([STATUSES.index(result.status) for result in results], dtype=np.uint8),
            {k: result.detail for k, result in enumerate(results) if result.detail},
            Answers.of(
                [Identification(m.objects, m.stars, _probability(r)) for m, r in zip(matches, results, strict=True)]
            ),
            np.concatenate([np.zeros((0, 2)), *(of_one.residuals_arcsec for of_one in matches)]),
            np.array([np.nan if result.elapsed_us is None else result.elapsed_us for result in results]),
            Attitudes.of([result.attitude for result in results]),
            Attitudes.of([result.attitude_geometric for result in results]),
            Attitudes.of([result.attitude_true for result in results]),
            np.array([astuple(error) if error else (np.nan,) * 5 for error in errors], dtype=np.float64),
            np.array([ANSWER_CHECKS.index(result.answer_check) for result in results], dtype=np.uint8),
            Others.of([result.others for result in results]),
            Starlights.of([result.light for result in results]),
            MatchColumns.of([result.left_out for result in results]),
            results,
        )

    def __len__(self) -> int:
        return len(self.panoramas)

    def __iter__(self) -> Iterator[FrameResult]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> FrameResult:  # type: ignore[override]
        if self.made:
            return self.made[k]
        answer, rows = self.answers[k], self.answers.parts.rows(k)
        named = answer if isinstance(answer, Identification) else None
        error = self.errors_arcsec[k]
        return FrameResult(
            self.panoramas[k],
            STATUSES[self.status[k]],
            self.details.get(k, ""),
            self.identifier,
            identification=named,
            attitude=self.attitudes[k],
            matches=Matches(named.objects, named.stars, self.residuals_arcsec[rows], self.star_name)
            if named
            else NO_MATCHES,
            elapsed_us=None if np.isnan(self.elapsed_us[k]) else float(self.elapsed_us[k]),
            attitude_geometric=self.geometric[k],
            attitude_error=None if np.isnan(error).all() else AttitudeError(*error.tolist()),
            attitude_true=self.true[k],
            answer_check=ANSWER_CHECKS[self.answer_check[k]],
            others=self.others[k],
            left_out=self.left_out[k],
            light=self.light[k],
        )

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
        answered[[k for k, result in enumerate(self.made) if not result.has_roll], 2] = np.nan
        for axis, name in enumerate(("ra", "de", "roll")):
            rows[f"{name}_deg"], rows[f"{name}_true_deg"] = answered[:, axis], true[:, axis]
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
        stars = self.answers.parts, self.answers.objects, self.answers.stars, self.residuals_arcsec
        rows = self._match_rows(MatchColumns(*stars, self.star_name), True)
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

    def _match_rows(self, matches: MatchColumns, named: bool) -> NDArray[np.void]:
        rows = np.empty(len(matches.objects), dtype=MATCH)
        seen = rows_of(self.panoramas.parts, matches)
        rows["frame"], rows["star"], rows["named"] = matches.parts.of_row, matches.stars, named
        rows["x_px"], rows["y_px"] = self.panoramas.xy_px.take(seen, axis=0).T
        rows["brightness"] = self.panoramas.brightness.take(seen)
        rows["residual_x_arcsec"], rows["residual_y_arcsec"] = matches.residuals_arcsec.T
        return rows


class NewResults(Sequence[FrameResult]):
    """Results that follow each other, each made when it is asked for; ``rows`` (K,) are their rows of FRAME."""

    def __init__(self, results: Sequence[FrameResult], rows: NDArray[np.void], first: int = 0) -> None:
        self.rows = rows
        self._results, self._first = results, first

    @classmethod
    def of(cls, results: Sequence[FrameResult]) -> Self:
        """Results that were made one by one."""
        return cls(results, FrameResults.of(results).rows())

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[FrameResult]:
        return (self._results[k] for k in range(self._first, self._first + len(self)))

    def __getitem__(self, k: int) -> FrameResult:  # type: ignore[override]
        return self._results[range(self._first, self._first + len(self))[k]]


def _probability(result: FrameResult) -> float:
    return result.identification.false_match_probability if result.identification else np.nan
