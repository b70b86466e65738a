"""The convention of a session's own answers: what is stated in the station file against what its sky shows."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import Finding
from gse.station.frame_columns import Columns
from gse.station.own_answers import OwnAnswerTruth, own_truth, paired
from gse.station.results import AnswerCheck, Status, Subject, attitude_errors
from gse.station.session_data import SessionData
from gse.station.session_tables import ANGLES, QUATERNION
from gse.truth import mount_of, truth_of
from gse.truth.frames import icrs_to_frame
from gse.truth.orientation import FIRST_NS
from gse.values.attitude_convention import (
    ROLL_ZEROS_DEG,
    AnswerRotation,
    AttitudeConvention,
    ReferenceFrame,
    from_angles,
    from_quaternions,
    proper_axes,
    read_angles,
    read_quaternions,
    to_answers,
    to_quaternions,
)
from gse.values.axis import ON_SKY
from gse.values.instant import NS_PER_S
from gse.values.matrices import eigh, length, product

# Search for the convention of a sensor's own answers: all discrete ones against a minute of sky.
#
# Each convention makes attitudes of the numbers that the sensor sent; a right one leaves a small, steady turn against
# the truth (the noise of both, and how the sensor's body frame sits on its detector), a wrong one a turn of degrees, or
# one that moves with the sky. The size of a convention's misfit is that turn and its change over the stretch, in arcsec
# across the boresight, with the turn about the boresight in proportion to how well it is known. A convention fits where
# its size is within MOST_ARCSEC; those within three times the least and six standard uncertainties of it cannot be told
# apart. Aberration moves all answers of a minute alike, by at most 20.5 arcsec, and so does a body frame that is
# turned: it is named only where the one hypothesis fits within four standard uncertainties and the other is off by more
# than six.

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
class SentAnswers:
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
class ConventionFit:
    """A convention, the misfit that it leaves in arcsec, and how well that is known."""

    convention: AttitudeConvention
    size_arcsec: float
    uncertainty_arcsec: float


@dataclass(frozen=True, slots=True)
class ConventionSearch:
    """The conventions that fit ``answers`` over ``duration_s``, the best first; none where ``nearest`` is too far off.

    Where ``aberration`` is not told, each of ``fits`` stands for both; ``aberration_arcsec`` is how far the boresight
    moves by it. ``roll_sent`` is False where angles came without a roll. ``explained`` is the share of all answers of
    the session that the best one brings to where the reference, or truth, has them.
    """

    answers: int
    duration_s: float
    fits: tuple[ConventionFit, ...]
    nearest: ConventionFit
    aberration: Literal["corrected", "not corrected", "not told"]
    aberration_arcsec: float
    quaternions: bool
    roll_sent: bool
    explained: float = 1.0

    def includes(self, stated: AttitudeConvention) -> bool:
        """Whether a stated convention is among those that fit, aberration aside."""
        return any(self._same(fit.convention, stated) for fit in self.fits)

    def _same(self, one: AttitudeConvention, stated: AttitudeConvention) -> bool:
        if one.frame != ("ICRS" if stated.frame == "J2000" else stated.frame):
            return False
        if self.quaternions:
            stated = replace(stated, rotation=None)  # the evidence is in the frame of the answers already
            return bool(np.abs(_readings(one) - _readings(stated)).max() < _SAME_READING)
        if one.ra_unit != stated.ra_unit:
            return False
        same_roll = one.roll_through == stated.roll_through and one.roll_zero_deg == stated.roll_zero_deg
        return bool(same_roll or not self.roll_sent)


def search_convention(evidence: SentAnswers) -> ConventionSearch | None:
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


def _candidates(evidence: SentAnswers) -> Iterator[AttitudeConvention]:
    if evidence.is_quaternion:
        yield from _quaternion_candidates(evidence)
        return
    roll_sent = not np.isnan(evidence.sent[:, 2]).any()
    for frame, unit in itertools.product(_FRAMES, _UNITS):
        for through, zero_deg in (
            itertools.product(_SENSES, ROLL_ZEROS_DEG) if roll_sent else ((_SENSES[0], ROLL_ZEROS_DEG[0]),)
        ):
            yield AttitudeConvention(frame=frame, ra_unit=unit, roll_through=through, roll_zero_deg=zero_deg)


def _quaternion_candidates(evidence: SentAnswers) -> Iterator[AttitudeConvention]:
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


def _cosines(evidence: SentAnswers, some: NDArray[np.int64], base: AttitudeConvention) -> NDArray[np.float64]:
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


def _fit(evidence: SentAnswers, convention: AttitudeConvention) -> ConventionFit:
    """The misfit with the aberration that fits better."""
    misfits = [_misfit(evidence, convention, true) for true in (evidence.true, evidence.true_corrected)]
    size, uncertainty = min(misfits)
    return ConventionFit(convention, size, uncertainty)


def _aberration(
    evidence: SentAnswers, convention: AttitudeConvention
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


def _misfit(evidence: SentAnswers, convention: AttitudeConvention, true: NDArray[np.float64]) -> tuple[float, float]:
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
    order = np.argsort(utc_ns, kind="stable")
    size, longer = divmod(len(order), min(_BLOCKS, len(order) // 2))  # so many blocks have one more
    parts = order[: longer * (size + 1)].reshape(-1, size + 1), order[longer * (size + 1) :].reshape(-1, size)
    medians = np.concatenate([np.median(turns[blocks], axis=1) for blocks in parts])
    place = np.linspace(-0.5, 0.5, len(medians))
    slope = product(place, medians) / product(place, place)
    scatter = (medians - medians.mean(axis=0) - np.outer(place, slope)).std(axis=0, ddof=2)
    error_of_slope = scatter / np.sqrt(product(place, place))
    significant = np.abs(slope) > _DRIFT_SIGMAS * error_of_slope + _LEAST_UNCERTAINTY_ARCSEC
    change = length(np.where(significant, slope, 0.0))
    return medians.mean(axis=0), change, float(scatter.max()) / np.sqrt(len(medians))


def _plain(fits: list[ConventionFit]) -> list[ConventionFit]:
    """One fit, the plainest, of each set of conventions that read every quaternion alike, the best set first.

    A quaternion read with its scalar at the other end is the same one turned by an axis: each reading has a twin.
    """
    kept: dict[bytes, ConventionFit] = {}
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


SEARCHED_S = 60.0
NEARLY_ALL = 0.95
"""Least share of the answers that a convention explains where it is the reason; another turn is the sensor's."""
_TIMES_LIMIT = 3.0
"""An answer that lies further off is false, whatever the convention."""
MOST_ANSWERS = 300
_FEWEST_PANORAMAS = 10
_BY_PANORAMAS_ARCSEC = 1.0
"""The same stars on the same pixels: what the camera's errors do to the one they do to the other."""
_TO_STANDARD = 0.5
_FRAME_WORDS = {
    "ICRS": "in ICRS or J2000",
    "J2000": "in ICRS or J2000",
    "date": "of date",
    "B1950": "of B1950 (FK4)",
}


_STEADY_SIGMAS, _STEADY_ARCSEC = 6.0, 20.0


def fit_rotation(evidence: SentAnswers) -> AttitudeConvention | None:
    """The convention with the one rotation that brings all answers to the truth; None where none stays the same.

    A rotation between the frame of the answers and the sensor takes up body axes and the zero of the roll; what the
    sky's motion leaves to tell is the order of a quaternion and its direction, and the sense of the roll.
    """
    if len(evidence.utc_ns) < FEWEST or not (evidence.is_quaternion or np.isfinite(evidence.sent[:, 2]).all()):
        return None
    fits = [_with_rotation(evidence, one) for one in _to_be_turned(evidence)]
    convention, (size, uncertainty) = min(fits, key=lambda fit: fit[1][0])
    return convention if size <= max(_STEADY_SIGMAS * uncertainty, _STEADY_ARCSEC) else None


def _to_be_turned(evidence: SentAnswers) -> Iterator[AttitudeConvention]:
    if not evidence.is_quaternion:
        for unit, through in itertools.product(_UNITS, _SENSES):
            yield AttitudeConvention(ra_unit=unit, roll_through=through)
        return
    for scalar, conjugate, axes in itertools.product(_SCALARS, (False, True), proper_axes()):
        yield AttitudeConvention(scalar=scalar, conjugate=conjugate, reference_axes=axes)


def _with_rotation(
    evidence: SentAnswers, convention: AttitudeConvention
) -> tuple[AttitudeConvention, tuple[float, float]]:
    """A convention with its mean rotation to the sensor, and the misfit that is left."""
    read = read_quaternions if evidence.is_quaternion else read_angles
    of_answers = product(read(evidence.sent, convention), icrs_to_frame(convention.frame, evidence.utc_ns))
    turns = to_quaternions(product(evidence.true, of_answers.transpose(0, 2, 1)))
    _, vectors = eigh(product(turns.T, turns))
    mean = vectors[:, -1]
    turned = product(from_quaternions(mean[None]), of_answers)
    _, _, roll, x, y = attitude_errors(turned, evidence.true).T
    _, _, sampling = _mean_and_change(evidence.utc_ns, np.column_stack([x, y, roll]))
    expanded = 2 * max(float(np.hypot(evidence.truth_arcsec, sampling)), _LEAST_UNCERTAINTY_ARCSEC)
    quaternion = tuple((mean * (1.0 if mean[3] >= 0 else -1.0)).round(7).tolist())
    rotation = AnswerRotation(quaternion=quaternion, uncertainty_arcsec=round(expanded, 1), fitted=True)
    found = replace(convention, rotation=rotation)
    return found, _misfit(evidence, found, evidence.true)


def rotation_as_yaml(convention: AttitudeConvention) -> str:
    """The line of a station file that states a convention with its rotation."""
    rotation = convention.rotation
    assert rotation is not None
    assert rotation.quaternion is not None
    keys = as_yaml(replace(convention, rotation=None))
    numbers = ", ".join(f"{number:.7f}" for number in rotation.quaternion)
    fitted = ", fitted: true" if rotation.fitted else ""
    stated = f"rotation: {{quaternion: [{numbers}], uncertainty_arcsec: {rotation.uncertainty_arcsec:g}{fitted}}}"
    return f"sensor: {{attitude: {{{', '.join(filter(None, (keys, stated)))}}}}}"


def session_convention(session: SessionData, seconds: float = SEARCHED_S) -> ConventionSearch | None:
    """The conventions that fit the first answers of a session; None where too few can be compared with anything."""
    evidence = evidence_of(session, seconds)
    found = None if evidence is None else search_convention(evidence)
    if found is None or not found.fits:
        return found
    return replace(found, explained=_explained(session, found.fits[0].convention))


def _explained(session: SessionData, convention: AttitudeConvention) -> float:
    """The share of some answers of the whole session that a convention brings to where they should be."""
    evidence = evidence_of(session, math.inf)
    assert evidence is not None
    read = read_quaternions if evidence.is_quaternion else read_angles
    measured = product(read(evidence.sent, convention), icrs_to_frame(convention.frame, evidence.utc_ns))
    limits = session.station.limits
    within_arcsec = _TIMES_LIMIT * max(limits.of(axis) for axis in ON_SKY)
    apart = [np.hypot(*attitude_errors(measured, true).T[3:]) for true in (evidence.true, evidence.true_corrected)]
    return float((np.minimum(*apart) <= within_arcsec).mean())


def evidence_of(session: SessionData, seconds: float = SEARCHED_S) -> SentAnswers | None:
    """The first answers beside the truth, in the frame of the answers where the station file says which that is."""
    found, stated = _evidence_of_sensor(session, seconds), session.station.sensor.attitude
    if found is None or stated.rotation is None:
        return found
    true, corrected = (to_answers(of, stated) for of in (found.true, found.true_corrected))
    return replace(found, true=true, true_corrected=corrected)


def _evidence_of_sensor(session: SessionData, seconds: float) -> SentAnswers | None:
    """The first answers beside the truth: what the stars of their panoramas show, or where the mount looked."""
    frames = session.frames.columns
    answers = session.sensor_attitudes.columns
    rows, places = paired(frames, answers)
    # A clock far off its time has no sidereal truth.
    good = answers["acquired"][places] & (frames["utc_ns"][rows] >= FIRST_NS)
    rows, places = rows[good], places[good]
    by_stars = rows[:0] if session.subject is Subject.SENSOR else rows[_confirmed(frames)[rows]]
    if len(by_stars) >= _FEWEST_PANORAMAS:
        chosen = _first(frames["utc_ns"], by_stars, seconds)
        return _by_stars(session, chosen, answers[places[np.searchsorted(rows, chosen)]])
    truth = own_truth(session)
    if truth is None or not len(rows):
        return None
    chosen = _first(frames["utc_ns"], rows, seconds)
    utc_ns, sent = frames["utc_ns"][chosen], _sent(answers[places[np.searchsorted(rows, chosen)]])
    left_in, taken_out = (
        OwnAnswerTruth(truth.truth, truth.mount, corrected, truth.field_sensor).expected(utc_ns)
        for corrected in (False, True)
    )
    return SentAnswers(utc_ns, sent, left_in, taken_out, _mount_arcsec(session))


def _confirmed(frames: Columns) -> NDArray[np.bool_]:
    identified = (frames["status"] == STATUSES.index(Status.IDENTIFIED)) & np.isfinite(frames["roll_deg"])
    return np.asarray(identified & (frames["answer_check"] != ANSWER_CHECKS.index(AnswerCheck.FALSE)))


def _first(utc_ns: NDArray[np.int64], rows: NDArray[np.int64], seconds: float) -> NDArray[np.int64]:
    """The rows of the first seconds, at most MOST_ANSWERS of them."""
    if math.isfinite(seconds):
        rows = rows[utc_ns[rows] <= utc_ns[rows].min() + round(seconds * NS_PER_S)]
    return rows[:: -(-len(rows) // MOST_ANSWERS)]


def _sent(answers: NDArray[np.void]) -> NDArray[np.float64]:
    """Angles where all answers have them, else quaternions."""
    names = ANGLES if np.isfinite(answers["ra_deg"]).all() else QUATERNION
    return np.column_stack([answers[name] for name in names])


def _by_stars(session: SessionData, rows: NDArray[np.int64], answers: NDArray[np.void]) -> SentAnswers:
    frames = session.frames.columns.rows(rows)
    utc_ns = frames["utc_ns"]
    left_in = from_angles(frames["ra_deg"], frames["de_deg"], frames["roll_deg"])
    taken_out = left_in
    station, middle = session.station, len(rows) // 2
    truth = truth_of(station.site, station.mount, session.earth_orientation, session.shown)
    if truth is not None and station.mount.inertial is None:
        mount = mount_of(product(left_in[middle], truth.icrs_to_horizon(int(utc_ns[middle])).T))
        of_both = [OwnAnswerTruth(truth, mount, corrected).shifts(utc_ns) for corrected in (True, False)]
        taken_out = product(of_both[0], of_both[1].transpose(0, 2, 1), left_in)
    return SentAnswers(utc_ns, _sent(answers), left_in, taken_out, _BY_PANORAMAS_ARCSEC)


def _mount_arcsec(session: SessionData) -> float:
    """Standard uncertainty of the mount along each axis across the boresight."""
    if session.alignment is not None:
        return math.hypot(*session.alignment.sigma_arcsec[:2])
    shown = session.station.mount.inertial
    if shown is not None:
        return _TO_STANDARD * shown.uncertainty.across_arcsec
    known, site = session.station.mount.uncertainty, session.station.site.uncertainty
    return _TO_STANDARD * math.hypot(known.azimuth_arcsec, known.altitude_arcsec, site.vertical_arcsec)


def is_wrong(search: ConventionSearch | None, stated: AttitudeConvention) -> bool:
    """Whether other conventions than the stated one explain nearly all answers, aberration aside."""
    if search is None or not search.fits or search.includes(stated):
        return False
    return search.explained >= NEARLY_ALL


def convention_finding(search: ConventionSearch | None, stated: AttitudeConvention) -> Iterator[Finding]:
    """Where the stated convention is not the one that fits, or its word on aberration is not."""
    if search is None or not search.fits:
        return
    if is_wrong(search, stated):
        yield Finding(
            "sensor convention",
            f"its answers follow another one than the station file states: {words_of(search)}",
            next_step=f"state {to_state(search)} in the station file, and judge the same recording again: gse report "
            "SESSION --station FILE; gse conventions SESSION shows more",
        )
    elif search.includes(stated) and search.aberration not in ("not told", stated.aberration):
        yield Finding(
            "sensor aberration",
            f"it is {search.aberration} in its answers, the station file states {stated.aberration}: "
            f"{search.aberration_arcsec:.1f} arcsec here",
            equals=("a body frame that is turned by as much",),
            next_step="state sensor.attitude.aberration as it is",
        )


def to_state(search: ConventionSearch) -> str:
    """The line of a station file that states the convention that fits best."""
    named = with_aberration(search) or search.fits[0].convention
    return f"sensor: {{attitude: {{{as_yaml(named)}}}}}"


def as_yaml(convention: AttitudeConvention) -> str:
    """The keys that are not at their default."""
    pairs = [(item.name, getattr(convention, item.name)) for item in fields(convention)]
    changed = [(name, value) for name, value in pairs if value != getattr(AttitudeConvention(), name)]
    return ", ".join(f"{name}: {str(value).lower() if isinstance(value, bool) else value}" for name, value in changed)


def words_of(search: ConventionSearch) -> str:
    """The conventions that fit, in words: those keys that are not the station's own."""
    return ", or ".join(in_words(fit.convention, search) for fit in search.fits[:4])


def in_words(convention: AttitudeConvention, search: ConventionSearch) -> str:
    """A convention in words."""
    frame = _FRAME_WORDS[convention.frame]
    if search.quaternions:
        axes = [
            f"{name} axes {words}"
            for name, words in (("body", convention.body_axes), ("reference", convention.reference_axes))
            if words != "x y z"
        ]
        turned = "conjugate, " if convention.conjugate else ""
        return ", ".join([f"scalar {convention.scalar}, {turned}{frame}", *axes])
    unit = "hours" if convention.ra_unit == "h" else "degrees"
    words = f"RA in {unit}, {frame}"
    if search.roll_sent and (convention.roll_through, convention.roll_zero_deg) != ("east", 0):
        words += f", roll through {convention.roll_through} from {convention.roll_zero_deg} deg"
    return words
