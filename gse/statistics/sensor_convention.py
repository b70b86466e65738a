"""The convention of a session's own answers: what is stated in the station file against what its sky shows."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.attitude_convention import AttitudeConvention, from_angles
from gse.finding import Finding
from gse.instant import NS_PER_S
from gse.matrices import product
from gse.station.attitude_table import ANGLES, QUATERNION
from gse.station.frame_columns import Columns
from gse.station.frame_table import ANSWER_CHECKS, STATUSES
from gse.station.own_answers import OwnAnswerTruth, own_truth, paired
from gse.station.results import AnswerCheck, Status, Subject
from gse.station.session_data import SessionData
from gse.statistics.convention_search import ConventionSearch, Evidence, search_convention
from gse.truth import mount_of, truth_of
from gse.truth.orientation import FIRST_NS

SEARCHED_S = 60.0
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


def session_convention(session: SessionData, seconds: float = SEARCHED_S) -> ConventionSearch | None:
    """The conventions that fit the first answers of a session; None where too few can be compared with anything."""
    found = evidence_of(session, seconds)
    return None if found is None else search_convention(found)


def evidence_of(session: SessionData, seconds: float = SEARCHED_S) -> Evidence | None:
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
    return Evidence(utc_ns, sent, left_in, taken_out, _mount_arcsec(session))


def _confirmed(frames: Columns) -> NDArray[np.bool_]:
    identified = (frames["status"] == STATUSES.index(Status.IDENTIFIED)) & np.isfinite(frames["roll_deg"])
    return np.asarray(identified & (frames["answer_check"] != ANSWER_CHECKS.index(AnswerCheck.FALSE)))


def _first(utc_ns: NDArray[np.int64], rows: NDArray[np.int64], seconds: float) -> NDArray[np.int64]:
    """The rows of the first seconds, at most MOST_ANSWERS of them."""
    rows = rows[utc_ns[rows] <= utc_ns[rows].min() + round(seconds * NS_PER_S)]
    return rows[:: -(-len(rows) // MOST_ANSWERS)]


def _sent(answers: NDArray[np.void]) -> NDArray[np.float64]:
    """Angles where all answers have them, else quaternions."""
    names = ANGLES if np.isfinite(answers["ra_deg"]).all() else QUATERNION
    return np.column_stack([answers[name] for name in names])


def _by_stars(session: SessionData, rows: NDArray[np.int64], answers: NDArray[np.void]) -> Evidence:
    frames = session.frames.columns.rows(rows)
    utc_ns = frames["utc_ns"]
    left_in = from_angles(frames["ra_deg"], frames["de_deg"], frames["roll_deg"])
    taken_out = left_in
    station, middle = session.station, len(rows) // 2
    truth = truth_of(station.site, station.mount, session.earth_orientation)
    if truth is not None and station.mount.inertial is None:
        mount = mount_of(product(left_in[middle], truth.icrs_to_horizon(int(utc_ns[middle])).T))
        of_both = [OwnAnswerTruth(truth, mount, corrected).shifts(utc_ns) for corrected in (True, False)]
        taken_out = product(of_both[0], of_both[1].transpose(0, 2, 1), left_in)
    return Evidence(utc_ns, _sent(answers), left_in, taken_out, _BY_PANORAMAS_ARCSEC)


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
    """Whether other conventions fit than the stated one, aberration aside."""
    return search is not None and bool(search.fits) and not search.includes(stated)


def convention_finding(search: ConventionSearch | None, stated: AttitudeConvention) -> Iterator[Finding]:
    """Where the stated convention is not the one that fits, or its word on aberration is not."""
    if search is None or not search.fits:
        return
    if not search.includes(stated):
        yield Finding(
            "sensor convention",
            f"its answers follow another one than the station file states: {words_of(search)}",
            next_step="gse conventions shows what to state as sensor.attitude",
        )
    elif search.aberration not in ("not told", stated.aberration):
        yield Finding(
            "sensor aberration",
            f"it is {search.aberration} in its answers, the station file states {stated.aberration}: "
            f"{search.aberration_arcsec:.1f} arcsec here",
            equals=("a body frame that is turned by as much",),
            next_step="state sensor.attitude.aberration as it is",
        )


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
