"""What is wrong with a sensor's own answers: a line for each of convention, zeros, standstill, delay, bias, noise."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gse.budget.star_terms import roll_of_a_fix
from gse.constants import EARTH_RATE_ARCSEC_PER_S
from gse.diagnosis.beside_panoramas import Explained, beside_panoramas
from gse.diagnosis.misplaced_stars import STARS_FALL_OUT
from gse.finding import Finding
from gse.station.attitude_table import ANGLES, QUATERNION
from gse.station.own_answers import SensorAnswers
from gse.station.session_data import SessionData
from gse.statistics.convention_search import ConventionSearch
from gse.statistics.onboard_equivalence import OnboardEquivalence
from gse.statistics.sensor_answers import by_other_stars_arcsec
from gse.statistics.sensor_convention import convention_finding, is_wrong

_STAR_SIGMAS = 4.0
_OTHER_STARS = 0.2
"""Of the stars here: a sensor that takes so many more or fewer chooses them otherwise."""
_STANDSTILL_S = 2.0
_FEWEST_ALIKE = 5
"""So many answers in a row that are the same to the last digit, for so long: the sky has turned by 30 arcsec."""
_MOST_ALIKE = 0.5
"""Of the answers: the median of all is then one that stood still."""
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
    puts_off = bool({finding.cause for finding in named} & {*STARS_FALL_OUT, "refraction"})
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
