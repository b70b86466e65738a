"""Mount fit: on the first seconds of a running session, or on a whole recording."""

import math
from array import array
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.errors import UsageError
from gse.station.columns import ANSWER_CHECKS
from gse.station.frame_results import FrameResult, FrameResults
from gse.station.results import AnswerCheck
from gse.station.session_data import SessionData
from gse.station.session_tables import residuals_of, xy_px_of
from gse.station.sky_condition import DOUBTFUL_SHARE, FEWEST_EXPECTED, SUN_LIMIT_DEG, WINDOW_NS
from gse.truth import Alignment, SiderealTruth, fit_mount, horizon_to_sensor, small_rotations, time_blocks, truth_of
from gse.truth.solar_system import sun_altitude_deg
from gse.values.axis import ON_SKY
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.instant import NS_PER_S
from gse.values.matrices import product
from gse.values.star_influence import attitude_operators, star_covariance, unfitted
from gse.values.text import count_text

MIN_FRAMES = 10
"""Fewest identified frames for a fit in a running session; the fit waits until it has them."""

MINUTE_NS = 60 * NS_PER_S
LONGEST_WAIT_NS = 3600 * NS_PER_S
"""Nautical twilight of the lower latitudes is over by then; of the polar summer nothing better comes."""
MOST_TIMES = 10
"""Of the seconds that were asked for, to take where these show the mount too badly."""
_OF_LIMIT = 0.1
"""A mount that is known to this share of a limit adds one part in seventy to what its errors make of it."""
_RECENT_FRAMES = 100
"""Those of the last seconds, whose windows of the sky are closed in part."""


class MeasuredMounts:
    """Directions of the mount as each identified frame shows them: a listener of the station's loop."""

    def __init__(self) -> None:
        self._utc_ns = array("q")
        self._rotations = array("d")
        self._truth: SiderealTruth | None = None

    def __len__(self) -> int:
        return len(self._utc_ns)

    def add(self, result: FrameResult, truth: SiderealTruth) -> None:
        """Add a frame; one without an answer, or with a false one, is ignored."""
        if result.attitude_geometric is None or result.answer_check is AnswerCheck.FALSE:
            return
        utc_ns = result.panorama.utc_ns
        self._utc_ns.append(utc_ns)
        rotation = product(result.attitude_geometric.icrs_to_sensor, truth.icrs_to_horizon(utc_ns).T)
        self._rotations.extend(rotation.ravel().tolist())

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Take frames from the loop."""
        if self._truth is None:
            self._truth = truth_of(
                session.station.site, session.station.mount, session.earth_orientation, session.shown
            )
        if self._truth is not None:
            for result in results:
                self.add(result, self._truth)

    def on_event(self, event: object) -> None:
        """Events are ignored."""

    @property
    def utc_ns(self) -> NDArray[np.int64]:
        """Instants (M,)."""
        return np.array(self._utc_ns, dtype=np.int64)

    @property
    def horizon_to_sensor(self) -> NDArray[np.float64]:
        """Rotations (M, 3, 3)."""
        return np.array(self._rotations, dtype=np.float64).reshape(-1, 3, 3)

    def fit(self, session: SessionData) -> Alignment:
        """Fit the mount to all frames of the session; UsageError without a frame."""
        return fit_mount(self.utc_ns, self.horizon_to_sensor, persistent_arcsec2=persistent_arcsec2(session))


def persistent_arcsec2(session: SessionData) -> NDArray[np.float64]:
    """Covariance (3, 3) of a session's mean attitude, from the part of the residuals that lasts over 20 s."""
    frames, matches = session.frames.columns, session.frames.matches
    false = ANSWER_CHECKS.index(AnswerCheck.FALSE)
    matches = matches[matches["named"] & (frames["answer_check"][matches["frame"]] != false)]
    if len(matches) == 0:
        return np.zeros((3, 3))
    xy_px = xy_px_of(matches)
    residuals = residuals_of(matches)
    errors = unfitted(residuals, matches["frame"])
    operators = attitude_operators(session.station.sensor.camera().directions(xy_px), matches["frame"])
    blocks = time_blocks(frames["utc_ns"])[matches["frame"]]
    total = star_covariance(operators, errors, matches["star"], blocks, within_blocks=False)
    return total / len(np.unique(matches["frame"])) ** 2


class FirstSeconds:
    """Fits the mount on the first seconds of a sky that is good enough, for the frames that come after them.

    In twilight a few stars show the mount badly: the seconds begin where most of the expected ones are seen, or where
    it is dark, after an hour at the latest. Where the fit is worse than a tenth of a limit, more seconds are taken.
    """

    def __init__(self, duration_s: float, session: SessionData) -> None:
        self._session = session
        self._duration_ns = round(duration_s * NS_PER_S)
        self._first_ns: int | None = None
        self._begun_ns = self._looked_ns = self._due_ns = 0
        self._measured = MeasuredMounts()

    def add(self, result: FrameResult, truth: SiderealTruth) -> None:
        """Add a frame of the first seconds."""
        self._measured.add(result, truth)

    def alignment(self, utc_ns: int) -> Alignment | None:
        """The mount, once the first seconds are over and enough frames were identified; None before."""
        if self._first_ns is None:
            self._first_ns = self._begun_ns = self._looked_ns = utc_ns
            self._due_ns = self._duration_ns
        if utc_ns - self._looked_ns >= WINDOW_NS and utc_ns - self._first_ns < LONGEST_WAIT_NS:
            self._looked_ns = utc_ns
            if not self._is_good(utc_ns):
                self._begun_ns, self._due_ns, self._measured = utc_ns, self._duration_ns, MeasuredMounts()
        lasts_ns = utc_ns - self._begun_ns
        if lasts_ns < self._due_ns or len(self._measured) < MIN_FRAMES:
            return None
        alignment = self._measured.fit(self._session)
        if self._is_good_to_arcsec(alignment) or lasts_ns >= MOST_TIMES * self._duration_ns:
            return alignment
        self._due_ns = min(2 * lasts_ns, MOST_TIMES * self._duration_ns)
        return None

    def _is_good(self, utc_ns: int) -> bool:
        """Whether the sky is dark, or shows most of its stars all the same; before a star simulator it always is."""
        station, frames = self._session.station, self._session.frames.columns
        if station.mount.inertial is not None or sun_altitude_deg(station.site, utc_ns) <= SUN_LIMIT_DEG:
            return True
        recent = frames[max(len(frames) - _RECENT_FRAMES, 0) : len(frames)]
        expected = recent["stars_expected"]
        known = expected >= FEWEST_EXPECTED
        seen = np.minimum(recent["stars_seen"][known], expected[known])
        return not known.any() or bool(seen.sum() >= DOUBTFUL_SHARE * expected[known].sum())

    def _is_good_to_arcsec(self, alignment: Alignment) -> bool:
        x, y, _ = alignment.sigma_arcsec
        limits = self._session.station.limits
        return math.hypot(x, y) <= _OF_LIMIT * min(limits.of(axis) for axis in ON_SKY)

    @property
    def waited_s(self) -> float:
        """How long it waited for a sky that is good enough."""
        return 0.0 if self._first_ns is None else (self._begun_ns - self._first_ns) / NS_PER_S


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """Two-fold cross-validation of the mount fit: even minutes against the fit to the odd ones, and vice versa.

    ``repeatability_arcsec`` is the difference of the two halves' fits, along columns, rows and about the boresight;
    ``mean_abs_arcsec`` and ``rms_arcsec`` are of frames against the mount fitted on the other half, in the same order.
    """

    alignment: Alignment
    repeatability_arcsec: tuple[float, float, float]
    mean_abs_arcsec: tuple[float, float, float]
    rms_arcsec: tuple[float, float, float]


def cross_validated(measured: MeasuredMounts, session: SessionData) -> CrossValidation:
    """Fit on even minutes and validate on odd ones, and vice versa; UsageError with less than one frame in each.

    A recording shorter than six minutes is cut into six parts instead of minutes.
    """
    utc_ns, rotations = measured.utc_ns, measured.horizon_to_sensor
    if len(utc_ns) < 2:
        raise UsageError(f"{count_text(len(utc_ns), 'frame')} identified; an alignment needs at least 2, better 100")
    part_ns = min(MINUTE_NS, int(utc_ns[-1] - utc_ns[0]) // 6 + 1)
    odd = ((utc_ns - utc_ns[0]) // part_ns % 2).astype(np.bool_)
    if not odd.any():
        odd = (np.arange(len(utc_ns)) % 2).astype(np.bool_)
    fits = [fit_mount(utc_ns[half], rotations[half]) for half in (~odd, odd)]
    mounts = [horizon_to_sensor(fit.mount) for fit in fits]
    residual = np.empty((len(utc_ns), 3))
    for half, fitted in ((odd, mounts[0]), (~odd, mounts[1])):
        residual[half] = small_rotations(rotations[half], fitted) * ARCSEC_PER_RAD
    (apart,) = small_rotations(mounts[1][None], mounts[0]) * ARCSEC_PER_RAD
    return CrossValidation(
        measured.fit(session),
        _boresight_first(np.abs(apart)),
        _boresight_first(np.abs(residual).mean(axis=0)),
        _boresight_first(np.sqrt((residual**2).mean(axis=0))),
    )


def _boresight_first(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    """A turn about the sensor's y moves the boresight along columns, one about x along rows."""
    return float(vector[1]), float(vector[0]), float(vector[2])
