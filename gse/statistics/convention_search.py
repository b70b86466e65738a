"""Search for the convention of a sensor's own answers: all discrete ones against a minute of sky.

Each convention makes attitudes of the numbers that the sensor sent; a right one leaves a small, steady turn against the
truth (the noise of both, and how the sensor's body frame sits on its detector), a wrong one a turn of degrees, or one
that moves with the sky. The size of a convention's misfit is that turn and its change over the stretch, in arcsec
across the boresight, with the turn about the boresight in proportion to how well it is known. A convention fits where
its size is within MOST_ARCSEC; those within three times the least and six standard uncertainties of it cannot be told
apart. Aberration moves all answers of a minute alike, by at most 20.5 arcsec, and so does a body frame that is turned:
it is named only where the one hypothesis fits within four standard uncertainties and the other is off by more than six.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gse.attitude_convention import (
    ROLL_ZEROS_DEG,
    AttitudeConvention,
    ReferenceFrame,
    from_quaternions,
    proper_axes,
    read_angles,
    read_quaternions,
)
from gse.matrices import length, product
from gse.station.attitude_error import attitude_errors
from gse.truth.frames import icrs_to_frame

MOST_ARCSEC = 360.0
"""A body frame is turned by less against its detector; precession since 2000 is more from 2008 on."""
FEWEST = 10
"""Answers that a search needs."""
_ROLL_IN_PROPORTION = 0.1
"""A turn about the boresight is known ten times worse: the field is some 14 deg wide."""
_LEAST_UNCERTAINTY_ARCSEC = 1.0
_TURN_ARCSEC = 360 * 3600.0
_SCREENED = 5
_SCREENED_WITHIN_COS = float(np.cos(np.radians(2.0)))
_BLOCKS = 20
_EQUAL_FACTOR, _EQUAL_SIGMAS = 3.0, 6.0
_FITS_SIGMAS, _OFF_SIGMAS = 4.0, 6.0
_DRIFT_SIGMAS = 5.0
_SOME_QUATERNIONS = np.array([[0.18, 0.37, 0.55, 0.73], [0.81, -0.29, 0.11, 0.5], [-0.4, 0.6, 0.3, -0.62]])
_SAME_READING = 1e-9
_FRAMES: tuple[ReferenceFrame, ...] = ("ICRS", "date", "B1950")
"""J2000 lies 0.02 arcsec from ICRS: no sensor shows the difference."""
_SCALARS: tuple[Literal["last", "first"], ...] = ("last", "first")
_UNITS: tuple[Literal["deg", "h"], ...] = ("deg", "h")
_SENSES: tuple[Literal["east", "west"], ...] = ("east", "west")


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What a sensor sent at instants (M,), RA, DE and roll (M, 3) or quaternions (M, 4), and what is true.

    ``true`` are rotations (M, 3, 3) from ICRS to the sensor with aberration left in, as a simple sensor answers, and
    ``true_corrected`` with aberration taken out. ``truth_arcsec`` is their standard uncertainty along each axis.
    """

    utc_ns: NDArray[np.int64]
    sent: NDArray[np.float64]
    true: NDArray[np.float64]
    true_corrected: NDArray[np.float64]
    truth_arcsec: float

    @property
    def is_quaternion(self) -> bool:
        """Whether quaternions were sent."""
        return len(self.sent.T) == 4


@dataclass(frozen=True, slots=True)
class Fit:
    """A convention, the misfit that it leaves in arcsec, and how well that is known."""

    convention: AttitudeConvention
    size_arcsec: float
    uncertainty_arcsec: float


@dataclass(frozen=True, slots=True)
class ConventionSearch:
    """The conventions that fit ``answers`` over ``duration_s``, the best first; none where ``nearest`` is too far off.

    Where ``aberration`` is not told, each of ``fits`` stands for both; ``aberration_arcsec`` is how far the boresight
    moves by it. ``roll_sent`` is False where angles came without a roll.
    """

    answers: int
    duration_s: float
    fits: tuple[Fit, ...]
    nearest: Fit
    aberration: Literal["corrected", "not corrected", "not told"]
    aberration_arcsec: float
    quaternions: bool
    roll_sent: bool

    def includes(self, stated: AttitudeConvention) -> bool:
        """Whether a stated convention is among those that fit, aberration aside."""
        return any(self._same(fit.convention, stated) for fit in self.fits)

    def _same(self, one: AttitudeConvention, stated: AttitudeConvention) -> bool:
        if one.frame != ("ICRS" if stated.frame == "J2000" else stated.frame):
            return False
        if self.quaternions:
            return bool(np.abs(_readings(one) - _readings(stated)).max() < _SAME_READING)
        if one.ra_unit != stated.ra_unit:
            return False
        same_roll = one.roll_through == stated.roll_through and one.roll_zero_deg == stated.roll_zero_deg
        return bool(same_roll or not self.roll_sent)


def search_convention(evidence: Evidence) -> ConventionSearch | None:
    """Try all discrete conventions; None of fewer than FEWEST answers."""
    if len(evidence.utc_ns) < FEWEST:
        return None
    fits = sorted((_fit(evidence, one) for one in _candidates(evidence)), key=lambda fit: fit.size_arcsec)
    fits = _plain(fits) if evidence.is_quaternion else fits
    nearest = fits[0]
    reach = max(_EQUAL_FACTOR * nearest.size_arcsec, nearest.size_arcsec + _EQUAL_SIGMAS * nearest.uncertainty_arcsec)
    good = tuple(fit for fit in fits if fit.size_arcsec <= reach) if nearest.size_arcsec <= MOST_ARCSEC else ()
    apart = np.hypot(*attitude_errors(evidence.true_corrected, evidence.true).T[3:])
    return ConventionSearch(
        answers=len(evidence.utc_ns),
        duration_s=float(np.ptp(evidence.utc_ns)) / 1e9,
        fits=good,
        nearest=nearest,
        aberration=_aberration(evidence, nearest.convention) if good else "not told",
        aberration_arcsec=float(np.median(apart)),
        quaternions=evidence.is_quaternion,
        roll_sent=evidence.is_quaternion or bool(np.isfinite(evidence.sent[:, 2]).all()),
    )


def _candidates(evidence: Evidence) -> Iterator[AttitudeConvention]:
    if evidence.is_quaternion:
        yield from _quaternion_candidates(evidence)
        return
    roll_sent = not np.isnan(evidence.sent[:, 2]).any()
    for frame, unit in itertools.product(_FRAMES, _UNITS):
        for through, zero_deg in (
            itertools.product(_SENSES, ROLL_ZEROS_DEG) if roll_sent else ((_SENSES[0], ROLL_ZEROS_DEG[0]),)
        ):
            yield AttitudeConvention(frame=frame, ra_unit=unit, roll_through=through, roll_zero_deg=zero_deg)


def _quaternion_candidates(evidence: Evidence) -> Iterator[AttitudeConvention]:
    """Of 6,912 conventions those that leave less than 2 deg in a few answers, else the best of each frame and order."""
    some = np.unique(np.linspace(0, len(evidence.utc_ns) - 1, _SCREENED).astype(int))
    near, nearest = False, []
    for frame, scalar, conjugate in itertools.product(_FRAMES, _SCALARS, (False, True)):
        base = AttitudeConvention(scalar=scalar, conjugate=conjugate, frame=frame)
        cosine = _cosines(evidence, some, base)
        for place in np.argwhere(cosine > _SCREENED_WITHIN_COS).tolist():
            yield _with_axes(base, place)
        near = near or bool(cosine.max() > _SCREENED_WITHIN_COS)
        nearest.append(_with_axes(base, list(divmod(int(cosine.argmax()), cosine.shape[1]))))
    if not near:
        yield from nearest


def _cosines(evidence: Evidence, some: NDArray[np.int64], base: AttitudeConvention) -> NDArray[np.float64]:
    """Cosine (24, 24) of the greatest turn against the truth, by body axes and by reference axes, in some answers."""
    matrices = np.array(list(proper_axes().values()))
    stated = from_quaternions(evidence.sent[some], scalar=base.scalar, conjugate=base.conjugate)
    to_frame = product(icrs_to_frame(base.frame, evidence.utc_ns[some]), evidence.true[some].transpose(0, 2, 1))
    turned = np.einsum("kab,qbc,kcd->kqad", stated, matrices, to_frame)
    trace = np.einsum("pad,kqad->kpq", matrices, turned)
    return np.asarray(((trace - 1) / 2).min(axis=0))


def _with_axes(base: AttitudeConvention, place: list[int]) -> AttitudeConvention:
    words = list(proper_axes())
    return replace(base, body_axes=words[place[0]], reference_axes=words[place[1]])


def _fit(evidence: Evidence, convention: AttitudeConvention) -> Fit:
    """The misfit with the aberration that fits better."""
    misfits = [_misfit(evidence, convention, true) for true in (evidence.true, evidence.true_corrected)]
    size, uncertainty = min(misfits)
    return Fit(convention, size, uncertainty)


def _aberration(
    evidence: Evidence, convention: AttitudeConvention
) -> Literal["corrected", "not corrected", "not told"]:
    left_in, taken_out = (
        size / uncertainty
        for size, uncertainty in (
            _misfit(evidence, convention, true) for true in (evidence.true, evidence.true_corrected)
        )
    )
    if left_in <= _FITS_SIGMAS and taken_out > _OFF_SIGMAS:
        return "not corrected"
    if taken_out <= _FITS_SIGMAS and left_in > _OFF_SIGMAS:
        return "corrected"
    return "not told"


def _misfit(evidence: Evidence, convention: AttitudeConvention, true: NDArray[np.float64]) -> tuple[float, float]:
    """Size and standard uncertainty of what a convention leaves, in arcsec."""
    read = read_quaternions if evidence.is_quaternion else read_angles
    measured = product(read(evidence.sent, convention), icrs_to_frame(convention.frame, evidence.utc_ns))
    _, _, roll, x, y = attitude_errors(measured, true).T
    if not evidence.is_quaternion and np.isnan(evidence.sent[:, 2]).any():
        roll = np.zeros(len(x))
    roll = roll[0] + (roll - roll[0] + _TURN_ARCSEC / 2) % _TURN_ARCSEC - _TURN_ARCSEC / 2  # +-180 deg is no middle
    turns = np.column_stack([x, y, roll * _ROLL_IN_PROPORTION])
    mean, change, sampling = _mean_and_change(evidence.utc_ns, turns)
    uncertainty = max(float(np.hypot(evidence.truth_arcsec, sampling)), _LEAST_UNCERTAINTY_ARCSEC)
    return float(np.hypot(length(mean), change)), uncertainty


def _mean_and_change(utc_ns: NDArray[np.int64], turns: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """Mean (3,) of turns (M, 3), how much they change where that is significant, and the error of a mean.

    By medians of up to 20 blocks of time: single false answers do not count, and frames of one block share the errors
    of their pixels.
    """
    blocks = np.array_split(np.argsort(utc_ns, kind="stable"), min(_BLOCKS, len(utc_ns) // 2))
    medians = np.array([np.median(turns[block], axis=0) for block in blocks])
    place = np.linspace(-0.5, 0.5, len(medians))
    slope = product(place, medians) / product(place, place)
    scatter = (medians - medians.mean(axis=0) - np.outer(place, slope)).std(axis=0, ddof=2)
    error_of_slope = scatter / np.sqrt(product(place, place))
    significant = np.abs(slope) > _DRIFT_SIGMAS * error_of_slope + _LEAST_UNCERTAINTY_ARCSEC
    change = length(np.where(significant, slope, 0.0))
    return medians.mean(axis=0), change, float(scatter.max()) / np.sqrt(len(medians))


def _plain(fits: list[Fit]) -> list[Fit]:
    """One fit, the plainest, of each set of conventions that read every quaternion alike, the best set first.

    A quaternion read with its scalar at the other end is the same one turned by an axis: each reading has a twin.
    """
    kept: dict[bytes, Fit] = {}
    for fit in fits:
        key = fit.convention.frame.encode() + np.round(_readings(fit.convention), 6).tobytes()
        if key not in kept or _plainness(fit.convention) < _plainness(kept[key].convention):
            kept[key] = fit
    return list(kept.values())


def _readings(convention: AttitudeConvention) -> NDArray[np.float64]:
    return read_quaternions(_SOME_QUATERNIONS, convention)


def _plainness(convention: AttitudeConvention) -> tuple[int, ...]:
    axes = convention.reference_axes, convention.body_axes
    minus, moved = "".join(axes).count("-"), sum(words.replace("-", "") != "x y z" for words in axes)
    return ((axes[0] != "x y z") + (axes[1] != "x y z"), minus + moved, convention.conjugate)


def with_aberration(search: ConventionSearch) -> AttitudeConvention | None:
    """The convention that is named, None where none fits or several do; untold aberration as it is by default."""
    if len(search.fits) != 1:
        return None
    aberration = "not corrected" if search.aberration == "not told" else search.aberration
    return replace(search.fits[0].convention, aberration=aberration)
