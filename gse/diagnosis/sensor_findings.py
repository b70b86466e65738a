"""What is wrong with a sensor's own answers: a line for each of convention, zeros, standstill, delay, bias, noise."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.misplaced_stars import STARS_FALL_OUT
from gse.station.events import Finding
from gse.station.frame_columns import Columns
from gse.station.own_answers import OwnAnswerTruth, SensorAnswers, by_other_stars_arcsec, field_of, own_truth
from gse.station.results import attitude_errors
from gse.station.session_data import SessionData
from gse.station.session_tables import ANGLES, QUATERNION
from gse.statistics.onboard_equivalence import OnboardEquivalence, answer_differences
from gse.statistics.sensor_convention import ConventionSearch, convention_finding, is_wrong
from gse.statistics.star_terms import roll_of_a_fix
from gse.values.attitude_convention import from_angles
from gse.values.axis import ON_SKY
from gse.values.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import NS_PER_S

# Definitions of a sensor's own answer, and its offset from the answer here by each of them.
#
# Air and aberration part the stars of a field unevenly. A sensor may answer the mean over its stars, as the one here
# does from the same panorama, over the whole field, or its boresight alone. What no idea explains is an error of its
# own.

_MOST_ROWS = 1 << 14
"""Evenly over the session: medians of so many are known well, and rotations of more are large."""


def by_each_idea(
    session: SessionData, own: SensorAnswers, rows: NDArray[np.int64]
) -> tuple[NDArray[np.int64], list[NDArray[np.float64]]] | None:
    """Some rows (K,) of the frames that both answer, and offsets (K, 2) east and north: by stars, field, boresight.

    None without a truth, and before a star simulator, which has no air.
    """
    truth, frames = own_truth(session), session.frames.columns
    if truth is None or truth.mount.inertial is not None:
        return None
    rows = rows[:: -(-len(rows) // _MOST_ROWS)]
    utc_ns = frames["utc_ns"][rows]
    angles = (frames[name][rows].astype(np.float64) for name in ("ra_deg", "de_deg", "roll_deg"))
    # the answers here are from catalogue places, with the air and the aberration of their stars left in
    simple = OwnAnswerTruth(truth.truth, truth.mount, False, field_of(session.station.sensor.camera()))
    here = attitude_errors(from_angles(*angles), simple.expected(utc_ns))[:, :2]
    of_sensor = np.column_stack([own.d_ra_cosde_arcsec[rows], own.d_de_arcsec[rows]])
    by_field = of_sensor - np.column_stack([frames["d_ra_cosde_arcsec"][rows], frames["d_de_arcsec"][rows]])
    boresight = OwnAnswerTruth(truth.truth, truth.mount, truth.aberration_corrected)
    middle_ns = utc_ns[len(rows) // 2 :][:1]
    of_field = attitude_errors(truth.expected(middle_ns), boresight.expected(middle_ns))[:, :2]
    return rows, [of_sensor - here, by_field, by_field + of_field]


# The sensor's own answers against those that follow here from the same panoramas: bias, delay, roll, noise.
#
# Both are of the same stars, so that another identifier or another choice of stars parts them by no more than the noise
# of each.

_SIGMAS = 5.0
_PIXEL_SIGMAS = 4.0
"""Stars that stay on their rows keep the error of their pixels there for the whole session."""
_WHOLE_PIXELS_PX, _CENTROIDS_PX = 1 / math.sqrt(12), 0.05
"""Root mean square of that error: of a rounded place, and of a centroid that is pulled to the middle of its pixel."""
_SAME_PLACES_ARCSEC = 1.0
"""What the errors of centroids that were sent do to the answers here they do to the sensor's."""
_BLOCKS = 20
_FEWEST = 40
_NOISY = 3.0
"""Times the scatter of the answers here: an identifier with a third of the stars scatters by less than twice that."""
_OF_LIMIT = 0.1
"""Less noise than this share of its limit does no harm."""
_ONE_SIDED_SHARE = 0.01
_WHOLE_FRAME = 0.1
_MORE_THAN_DELAY = 1.2
"""Times the turn that a delay makes: other stars in the sensor's fix move either."""
_ROLL_IS_WORSE = 10.0
_MOST_DELAY_S = 300.0
"""No sensor answers later: what lies further off in RA is a bias."""
_MOST_EARLY_S = 30.0
"""No sensor answers for so late an instant: it would have to know the sky before it sees it."""
_TURN_ARCSEC = 360 * 3600.0
_MEDIAN_OF_STEPS = math.sqrt(2) * 0.6745
"""Median of the difference of two normal numbers, in their standard deviations."""


@dataclass(frozen=True, slots=True)
class Explained:
    """No fault of a sensor: shifts, turns and scatter up to these have their causes, as aberration or stars.

    ``same_stars_arcsec`` is the shift where the sensor takes those stars that are identified here.
    """

    shift_arcsec: float
    same_stars_arcsec: float
    roll_arcsec: float
    scatter_arcsec: float


def beside_panoramas(
    session: SessionData, own: SensorAnswers, alike: OnboardEquivalence | None, explained: Explained
) -> Iterator[Finding]:
    """A finding for each way in which the answers differ by more than is explained."""
    offset = tuple(_offset(session, own, explained))
    yield from offset
    by_delay_arcsec = _roll_of_delay_arcsec(session, own) if any(one.cause == "sensor delay" for one in offset) else 0.0
    yield from _turned(session, own, explained.roll_arcsec + by_delay_arcsec)
    yield from _noisy(session, own, explained.scatter_arcsec)
    yield from _one_sided(alike)


def _offset(session: SessionData, own: SensorAnswers, explained: Explained) -> Iterator[Finding]:
    """How the sensor's answers lie off, where that is more than its aberration and its stars explain."""
    frames = session.frames.columns
    both = _compared(own.d_de_arcsec, frames["d_de_arcsec"])
    if len(both) < _FEWEST:
        return
    least = _PIXEL_SIGMAS * _of_pixels_arcsec(session, both)
    columns = [axis.column for axis in ON_SKY]
    apart = np.column_stack([getattr(own, name)[both] - frames[name][both] for name in columns])
    circle = _TURN_ARCSEC * np.cos(np.radians(frames["de_true_deg"][both]))
    apart[:, 0] = apart[0, 0] + (apart[:, 0] - apart[0, 0] + circle / 2) % circle - circle / 2
    off = _Off.typical(frames, both, apart)
    by_stars_arcsec = max(least, explained.shift_arcsec)
    if not off.is_beyond(by_stars_arcsec):
        same = least if _are_whole(session) else _SAME_PLACES_ARCSEC
        ideas = by_each_idea(session, own, both) if math.isfinite(explained.same_stars_arcsec) else None
        by_idea = [_Off.typical(frames, ideas[0], one) for one in ideas[1]] if ideas else []
        if not by_idea or not all(one.is_beyond(same) for one in by_idea):
            return
        off, by_stars_arcsec = by_idea[0], explained.same_stars_arcsec
        if not off.is_beyond(by_stars_arcsec):
            return
    yield _bias_or_delay(frames, both, off, least, by_stars_arcsec)


def _bias_or_delay(
    frames: Columns, rows: NDArray[np.int64], off: "_Off", least_arcsec: float, by_stars_arcsec: float
) -> Finding:
    """A mount at rest cannot tell them apart; a shift along RA alone, or of whole frames, is a delay first.

    ``by_stars_arcsec`` is what other stars make of it: as much in DE hides no delay.
    """
    ra, de = off.ra, off.de
    where = f"{_angle(ra)} east and {_angle(de)} north of those that follow from its own panoramas"
    cos_de = math.cos(math.radians(float(np.nanmedian(frames["de_true_deg"][rows]))))
    late_s = -ra / (EARTH_RATE_ARCSEC_PER_S * max(cos_de, 1e-9))
    along_ra = abs(de) <= max(_SIGMAS * off.de_error, 0.1 * abs(ra))
    along_ra |= abs(de) <= least_arcsec and _is_whole_frames(frames["utc_ns"][rows], late_s)
    may_be_delay = cos_de >= 0.05 and -_MOST_EARLY_S <= late_s <= _MOST_DELAY_S
    if not along_ra or not may_be_delay:
        is_near_ra = abs(de) <= min(by_stars_arcsec, abs(ra)) and may_be_delay
        return Finding(
            "sensor bias",
            f"its answers lie {where}",
            ("a body frame that is turned by as much", *([_delay_beside(late_s)] if is_near_ra else [])),
            next_step="compare its camera model and catalogue, and how its body frame lies on the detector",
        )
    side = "before" if late_s > 0 else "after"
    return Finding(
        "sensor delay",
        f"its answers lie {where}, as those of {abs(late_s):.2f} s {side} the exposure that they are marked with",
        ("a bias of its own in RA", f"a body frame that is turned about the pole by {_angle(ra / cos_de)}"),
        "look which exposure its firmware names in ATTITUDE; a session with the sensor mounted at another roll tells: "
        "a delay stays in RA, a bias and a body frame turn with the sensor",
    )


def _delay_beside(late_s: float) -> str:
    return f"answers of {abs(late_s):.2f} s {'before' if late_s > 0 else 'after'} their exposure, by other stars"


@dataclass(frozen=True, slots=True)
class _Off:
    """An offset east and north in arcsec, and how well it is known."""

    ra: float
    ra_error: float
    de: float
    de_error: float

    @classmethod
    def typical(cls, frames: Columns, rows: NDArray[np.int64], arcsec: NDArray[np.float64]) -> "_Off":
        """The typical one of offsets (K, 2) in rows (K,) of the frames."""
        return cls(*_typical(frames, rows, arcsec[:, 0]), *_typical(frames, rows, arcsec[:, 1]))

    def is_beyond(self, least_arcsec: float) -> bool:
        """Whether it is greater than that, and than noise makes it."""
        return math.hypot(self.ra, self.de) > max(least_arcsec, _SIGMAS * math.hypot(self.ra_error, self.de_error))


def _roll_of_delay_arcsec(session: SessionData, own: SensorAnswers) -> float:
    """By how much the sky turns about the boresight while it moves past as far as the answers are late."""
    frames = session.frames.columns
    late_arcsec = abs(float(np.nanmedian(own.d_ra_cosde_arcsec - frames["d_ra_cosde_arcsec"])))
    return _MORE_THAN_DELAY * late_arcsec * abs(math.tan(math.radians(float(np.nanmedian(frames["de_true_deg"])))))


def _compared(of_sensor: NDArray[np.float64], of_station: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.flatnonzero(np.isfinite(of_sensor) & np.isfinite(of_station))


def _of_pixels_arcsec(session: SessionData, rows: NDArray[np.int64]) -> float:
    """What pixels leave of the boresight, whatever the number of frames."""
    of_star_px = _WHOLE_PIXELS_PX if _are_whole(session) else _CENTROIDS_PX
    stars = max(float(np.median(session.frames.columns["matched"][rows])), 1.0)
    return of_star_px * session.station.sensor.camera().pixel_rad * ARCSEC_PER_RAD / math.sqrt(stars)


def _are_whole(session: SessionData) -> bool:
    """Whether places came as whole pixels, which are not those that the sensor answers by."""
    matches = session.frames.matches
    return all(bool((matches[name] == np.rint(matches[name])).all()) for name in ("x_px", "y_px"))


def _is_whole_frames(utc_ns: NDArray[np.int64], late_s: float) -> bool:
    """Whether it is the time of one frame or more: a firmware that names another exposure."""
    frames = abs(late_s) / max(float(np.median(np.diff(np.sort(utc_ns)))) / NS_PER_S, 1e-9)
    return round(frames) >= 1 and abs(frames - round(frames)) <= _WHOLE_FRAME * round(frames)


def _turned(session: SessionData, own: SensorAnswers, explained_arcsec: float) -> Iterator[Finding]:
    """How the sensor's answers are turned about the boresight: a field shows roll ten times worse than direction."""
    frames = session.frames.columns
    both = _compared(own.d_roll_arcsec, frames["d_roll_arcsec"])
    if len(both) < _FEWEST:
        return
    apart = (own.d_roll_arcsec[both] - frames["d_roll_arcsec"][both] + _TURN_ARCSEC / 2) % _TURN_ARCSEC
    roll, error = _typical(frames, both, apart - _TURN_ARCSEC / 2)
    least_arcsec = _ROLL_IS_WORSE * _PIXEL_SIGMAS * _of_pixels_arcsec(session, both)
    if abs(roll) <= max(least_arcsec, _SIGMAS * error, explained_arcsec):
        return
    yield Finding(
        "sensor roll",
        f"its roll lies {_angle(roll)} off the one that follows from its own panoramas",
        equals=("a body frame that is turned about the boresight",),
        next_step="compare how its body frame lies on the detector",
    )


def _noisy(session: SessionData, own: SensorAnswers, explained_arcsec: float) -> Iterator[Finding]:
    """Answers, the false ones aside, that scatter by far more than those that follow here from the same panoramas.

    ``explained_arcsec`` is what other stars from frame to frame make of it.
    """
    frames = session.frames.columns
    offsets_arcsec = answer_differences(own, frames)
    ahead = np.hypot(own.cross_x_arcsec, own.cross_y_arcsec) < _TURN_ARCSEC / 4  # behind, arcs have no steady direction
    both = np.flatnonzero(np.isfinite(offsets_arcsec[:, 0]) & ahead)
    if len(both) < _FEWEST:
        return
    off = offsets_arcsec[both] - np.median(offsets_arcsec[both], axis=0)
    both = both[np.hypot(*off.T) <= session.station.limits.false_beyond_arcsec]
    if len(both) < _FEWEST:
        return
    names = ("cross_x_arcsec", "cross_y_arcsec")
    of_sensor = math.hypot(*(_scatter(frames, both, getattr(own, name)[both]) for name in names))
    here = math.hypot(*(_scatter(frames, both, frames[name][both].astype(np.float64)) for name in names))
    limits = session.station.limits
    least_arcsec = _OF_LIMIT * min(limits.of(axis) for axis in ON_SKY)
    if of_sensor > max(_NOISY * here, least_arcsec, explained_arcsec):
        yield Finding(
            "sensor noise",
            f"its answers scatter by {of_sensor:.1f} arcsec from frame to frame, those that follow from its own "
            f"panoramas by {here:.1f}",
            next_step="compare how many stars its firmware uses, and how it finds their places",
        )


def _scatter(frames: Columns, rows: NDArray[np.int64], values: NDArray[np.float64]) -> float:
    """Standard deviation of values (K,) from one frame to the next, by the median, so that false answers count not."""
    steps = np.abs(np.diff(values[np.argsort(frames["utc_ns"][rows], kind="stable")]))
    return float(np.median(steps)) / _MEDIAN_OF_STEPS


def _one_sided(alike: OnboardEquivalence | None) -> Iterator[Finding]:
    """Panoramas that the sensor did not answer, though the station did; to answer more is not a fault."""
    if alike is None or alike.only_station <= _ONE_SIDED_SHARE * alike.answers:
        return
    yield Finding(
        "sensor answers otherwise",
        f"of {alike.answers} panoramas, {alike.only_station} were answered only here and {alike.only_sensor} only by "
        "the sensor",
        ("another catalogue or identifier in the sensor",),
        "compare frame by frame: frames.csv of gse report SESSION",
    )


def _typical(frames: Columns, rows: NDArray[np.int64], values: NDArray[np.float64]) -> tuple[float, float]:
    """Median of values (K,), and its error, by medians of blocks of time."""
    order = np.argsort(frames["utc_ns"][rows], kind="stable")
    medians = np.array([np.median(values[block]) for block in np.array_split(order, _BLOCKS)])
    return float(np.median(medians)), float(medians.std(ddof=1)) / math.sqrt(_BLOCKS)


def _angle(arcsec: float) -> str:
    return f"{arcsec:+.1f} arcsec" if abs(arcsec) < 3600 else f"{arcsec / 3600:+.3f} deg"


_STAR_SIGMAS = 4.0
_OTHER_STARS = 0.2
"""A sensor that uses more or fewer stars by this share chooses them in another way."""
_STANDSTILL_S = 2.0
_FEWEST_ALIKE = 5
"""So many answers in a row that are the same to the last digit, for so long: the sky has turned by 30 arcsec."""
_MOST_ALIKE = 0.5
"""Share of answers alike from which on the median of all is one that stood still."""
_OF_ABERRATION = 1.5
"""Times its size: what the noise of a fit adds to it."""


def sensor_findings(
    session: SessionData,
    own: SensorAnswers | None,
    search: ConventionSearch | None,
    alike: OnboardEquivalence | None = None,
    *,
    named: tuple[Finding, ...] = (),
) -> tuple[Finding, ...]:
    """A finding for each thing that the sensor's own answers look like; ``own`` are those beside panoramas.

    A camera or air that is ``named`` puts the answers here off, not the sensor's.
    """
    stated = session.station.sensor.attitude
    puts_off = bool({finding.cause for finding in named} & {*STARS_FALL_OUT, "camera", "refraction"})
    of_convention = tuple(convention_finding(search, stated))
    if puts_off and not is_wrong(search, stated):
        of_convention = ()  # 20 arcsec of aberration are not to be told beside it
    still = tuple(_standstill(session))
    found = [*of_convention, *_zeros(session), *(finding for finding, _ in still)]
    says_all = any(share > _MOST_ALIKE for _, share in still)  # its bias, roll and noise are those of standing still
    if own is not None and not is_wrong(search, stated) and not says_all:
        explained_arcsec = _OF_ABERRATION * search.aberration_arcsec if search and of_convention else 0.0
        explained_arcsec = math.inf if puts_off else explained_arcsec
        found += beside_panoramas(session, own, alike, _explained(session, own, explained_arcsec))
    return tuple(found)


def _explained(session: SessionData, own: SensorAnswers, shift_arcsec: float) -> Explained:
    """With what another choice of stars makes of the answers."""
    by_stars_arcsec = by_other_stars_arcsec(session)
    same_stars_arcsec = math.inf if shift_arcsec > 0 else _STAR_SIGMAS * _by_few_other_stars_arcsec(session, own)
    shift_arcsec = max(shift_arcsec, _STAR_SIGMAS * by_stars_arcsec)
    width_rad = math.sqrt(session.station.sensor.camera().solid_angle_sr)
    return Explained(shift_arcsec, same_stars_arcsec, roll_of_a_fix(shift_arcsec, width_rad), by_stars_arcsec)


def _by_few_other_stars_arcsec(session: SessionData, own: SensorAnswers) -> float:
    """What is left of that where the sensor takes the stars that are identified here, but as many more or fewer as it
    says, and one other at least; inf where it does not say, or takes far fewer: those are where they are for long."""
    stars, here = own.matched[own.matched > 0], session.frames.columns["matched"]
    here = here[here > 0]
    if not len(stars) or not len(here):
        return math.inf
    of_sensor, of_station = float(np.median(stars)), float(np.median(here))
    if abs(of_sensor - of_station) > _OTHER_STARS * of_station:
        return math.inf
    share = max(abs(1 / of_sensor - 1 / of_station), 2 / of_station**2)
    return by_other_stars_arcsec(session) * math.sqrt(of_sensor * share)


def _zeros(session: SessionData) -> Iterator[Finding]:
    answers = session.sensor_attitudes.columns
    zeros = answers["acquired"].copy()
    for name in _names(answers["ra_deg"])[:3]:
        zeros &= np.nan_to_num(answers[name]) == 0
    count = int(zeros.sum())
    if count:
        size = f"{count} of {len(answers)} say RA 0, DE 0 and roll 0, and are called good"
        yield Finding("sensor answers of zeros", size, next_step="look where its firmware answers without an attitude")


def _standstill(session: SessionData) -> Iterator[tuple[Finding, float]]:
    """Answers that stay while the sky turns, and their share.

    A sensor that looks at a fixed star field has a mount that says so.
    """
    answers = session.sensor_attitudes.columns
    acquired = np.flatnonzero(answers["acquired"])
    if len(acquired) < _FEWEST_ALIKE or session.station.mount.inertial is not None:
        return
    changed = np.zeros(len(acquired) - 1, dtype=np.bool_)
    for name in _names(answers["ra_deg"][acquired]):  # a column at a time: the rows of 8 h at 10 Hz are 24 MB
        changed |= np.diff(np.nan_to_num(answers[name][acquired])) != 0
    changes = np.flatnonzero(changed) + 1
    first, last = np.append(0, changes), np.append(changes, len(acquired)) - 1
    time_us = answers["time_us"][acquired].astype(np.int64)
    seconds = (time_us[last] - time_us[first]) / 1e6
    long = (seconds >= _STANDSTILL_S) & (last - first + 1 >= _FEWEST_ALIKE)
    if long.any():
        count, most_s = int((last - first + 1)[long].sum()), float(seconds[long].max())
        found = Finding(
            "sensor answers stand still",
            f"{count} of {len(acquired)} repeat the one before to the last digit, for up to {most_s:.1f} s, while the "
            f"sky turned by {most_s * EARTH_RATE_ARCSEC_PER_S:.0f} arcsec",
            next_step="look whether its firmware still ran",
        )
        yield found, count / len(acquired)


def _names(ra_deg: NDArray[np.float64]) -> tuple[str, ...]:
    """The columns of the numbers that the sensor sends as the direction."""
    return ANGLES if np.isfinite(ra_deg).any() else QUATERNION
