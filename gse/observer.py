"""The observer: one panorama in, everything the station can say about it out."""

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.attitude import Attitude, paper_mean, solve_attitude
from gse.camera import Camera
from gse.comparison import compare
from gse.config import Mount
from gse.identifier import Identification, Identifier, Unidentified
from gse.non_stars import NonStars
from gse.panorama import MAX_OBJECTS, Panorama
from gse.results import FrameResult, Judge, Matches, Status
from gse.truth import SiderealTruth

CENTROID_SIGMA_PX = 0.3
"""Position noise of a whole-pixel object, 1 / sqrt(12) px, for the covariance of an attitude."""

SAME_BORESIGHT_RAD = math.radians(0.05)
"""The answer under test is correct when its boresight is within this of the judge's."""

ARCSEC_PER_RAD = 180 * 3600 / math.pi
FAULT_FLAGS = frozenset({"detector fault", "memory fault"})


@dataclass(frozen=True, slots=True)
class Observer:
    """What stands ready for each panorama: camera, identifier under test, judge, and sidereal truth for a mount.

    There is no ``truth`` for instants before the Earth orientation table, and no ``mount`` while it is being fitted:
    then nothing is compared. ``paper_mean`` takes the boresight as [S] does, instead of Wahba's.
    """

    camera: Camera
    index_max: int
    identifier: Identifier
    judge: Identifier | None
    non_stars: NonStars
    truth: SiderealTruth | None
    mount: Mount | None
    paper_mean: bool = False

    def observe(self, panorama: Panorama) -> FrameResult:
        """Identify, solve, correct, compare, judge. ``elapsed_us`` is this host's time from objects to RA and DE."""
        fault = self._fault(panorama)
        if fault:
            return FrameResult(panorama, Status.SENSOR_FAULT, fault, self.identifier.name)
        started_ns = time.perf_counter_ns()
        directions_sensor = self.camera.directions(panorama.xy_px)
        answer = self.identifier.identify(directions_sensor, panorama.index)
        attitude = None if isinstance(answer, Unidentified) else self._solve(answer, directions_sensor)
        elapsed_us = round((time.perf_counter_ns() - started_ns) / 1000, 1)
        judge = self._judge(attitude, directions_sensor, panorama.index)
        if isinstance(answer, Unidentified) or attitude is None:
            status, detail = _explain(answer)
            return FrameResult(panorama, status, detail, self.identifier.name, elapsed_us=elapsed_us, judge=judge)
        geometric = self._geometric(panorama.utc_ns, answer, attitude, directions_sensor)
        true = self.truth.attitude_true(panorama.utc_ns, self.mount) if self.truth and self.mount else None
        return FrameResult(
            panorama,
            Status.IDENTIFIED,
            "",
            self.identifier.name,
            identification=answer,
            attitude=attitude,
            matches=self._matches(answer, attitude, directions_sensor),
            elapsed_us=elapsed_us,
            attitude_geometric=geometric,
            discrepancy=compare(geometric, true) if geometric and true else None,
            attitude_true=true,
            judge=judge,
            others=self.non_stars.name(
                panorama,
                directions_sensor,
                answer.objects,
                geometric or attitude,
                truth_known=self.truth is not None,
            ),
        )

    def _fault(self, panorama: Panorama) -> str:
        faults = sorted(panorama.flags & FAULT_FLAGS)
        if faults:
            return f"the sensor reports {' and '.join(faults)}"
        if panorama.problems:
            return f"the sensor sent what it should not: {panorama.problems[0]}"
        if len(panorama.index) > MAX_OBJECTS:
            return f"{len(panorama.index)} objects came, at most {MAX_OBJECTS} were expected"
        if len(panorama.index) and panorama.index.max() > self.index_max:
            return f"index value {panorama.index.max():.0f} came, at most {self.index_max} was expected"
        return ""

    def _solve(self, answer: Identification, directions_sensor: NDArray[np.float64]) -> Attitude:
        return self._attitude(directions_sensor[answer.objects], self.identifier.catalog.icrs[answer.stars])

    def _attitude(self, directions_sensor: NDArray[np.float64], stars_icrs: NDArray[np.float64]) -> Attitude:
        """Wahba's attitude, or the mean about the sensor centre of [S] where the station file says so."""
        attitude = solve_attitude(directions_sensor, stars_icrs, CENTROID_SIGMA_PX * self.camera.pixel_rad)
        return paper_mean(attitude, directions_sensor, stars_icrs) if self.paper_mean else attitude

    def _geometric(
        self, utc_ns: int, answer: Identification, attitude: Attitude, directions_sensor: NDArray[np.float64]
    ) -> Attitude | None:
        """The attitude from apparent places and un-refracted directions (DESIGN decision 5)."""
        if self.truth is None:
            return None
        zenith_sensor = attitude.icrs_to_sensor @ self.truth.icrs_to_horizon(utc_ns)[2]
        return self._attitude(
            self.truth.unrefracted(directions_sensor[answer.objects], zenith_sensor),
            self.truth.apparent(self.identifier.catalog.icrs[answer.stars], utc_ns),
        )

    def _matches(self, answer: Identification, attitude: Attitude, directions_sensor: NDArray[np.float64]) -> Matches:
        catalog = self.identifier.catalog
        expected_sensor = catalog.icrs[answer.stars] @ attitude.icrs_to_sensor.T
        residuals = (directions_sensor[answer.objects] - expected_sensor)[:, :2] * ARCSEC_PER_RAD
        return Matches(answer.objects, answer.stars, residuals, catalog.name)

    def _judge(
        self, attitude: Attitude | None, directions_sensor: NDArray[np.float64], index: NDArray[np.float64]
    ) -> Judge:
        if self.judge is None:
            return Judge.NONE
        truth = self.judge.identify(directions_sensor, index)
        if isinstance(truth, Unidentified):
            return Judge.NONE
        if attitude is None:
            return Judge.ABSENT
        judged = solve_attitude(directions_sensor[truth.objects], self.judge.catalog.icrs[truth.stars], 1e-4)
        apart_rad = math.dist(attitude.boresight_icrs, judged.boresight_icrs)
        return Judge.CORRECT if apart_rad < SAME_BORESIGHT_RAD else Judge.FALSE


def _explain(answer: Identification | Unidentified) -> tuple[Status, str]:
    if isinstance(answer, Unidentified):
        return Status(answer.reason), answer.detail
    return Status.NO_MATCH, "no attitude follows from the matches"
