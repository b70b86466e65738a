"""What a sensor states of its own answers by items of its ATTITUDE message, against what these answers show.

``sigma_x``, ``sigma_y`` and ``sigma_z`` are standard deviations of an answer about the sensor's axes, those of
``sensor.attitude.rotation`` as with its rates. ``quality`` is a number or a word for how good an answer is.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from gse.station.own_answers import paired
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import CountedFrames
from gse.statistics.sampling import MIN_N_EFF, error_bounds
from gse.statistics.session_statistics import Statistics
from gse.values.attitude_convention import to_answers
from gse.values.instant import NS_PER_S
from gse.values.matrices import product
from protocols import ItemValue
from protocols.vocabulary import quantity

SIGMAS = ("sigma_x", "sigma_y", "sigma_z")
QUALITY = "quality"
_NAN = float("nan")
_MOST_VALUES, _GROUPS = 8, 4
"""A quality of more values than these is put into so many groups of equally many answers."""


@dataclass(frozen=True, slots=True)
class StatedAccuracy:
    """The scatter of answers about an axis against the accuracy that they state.

    ``chi_square`` is that of the errors about their mean over the stated sigma, per degree of freedom: 1 where they
    scatter as stated. ``low`` and ``high`` are its 95 % interval for ``n_eff`` independent answers with normal errors;
    NaN where these are too few. ``stated_arcsec`` is the root mean square of the stated sigma.
    """

    axis: str
    answers: int
    n_eff: float
    stated_arcsec: float
    scatter_arcsec: float
    chi_square: float
    low: float
    high: float

    @property
    def word(self) -> str:
        """What the interval says."""
        if math.isnan(self.low):
            return "too few independent answers to tell"
        return "more than stated" if self.low > 1 else "less than stated" if self.high < 1 else "as stated"


@dataclass(frozen=True, slots=True)
class _Answers:
    """The sensor's answers to frames, in the order of time: rows (K,) of these, places (K,) in the table of answers."""

    rows: NDArray[np.int64]
    places: NDArray[np.int64]
    utc_ns: NDArray[np.int64]
    counted: CountedFrames
    errors_arcsec: NDArray[np.float64]
    """(K, 3): cross_x, cross_y and roll."""


def _own_answers(session: SessionData, stats: Statistics) -> _Answers | None:
    frames, names = session.frames.columns, ("cross_x_arcsec", "cross_y_arcsec", "d_roll_arcsec")
    if session.subject is Subject.SENSOR:
        counted, columns = stats.counted, [frames[name] for name in names]
    elif stats.own is not None and stats.own_counted is not None:
        counted, columns = stats.own_counted, [getattr(stats.own, name) for name in names]
    else:
        return None
    rows, places = paired(frames, session.sensor_attitudes.columns)
    order = np.argsort(frames["utc_ns"][rows], kind="stable")
    rows, places = rows[order], places[order]
    errors = np.column_stack([column[rows] for column in columns])
    return _Answers(rows, places, frames["utc_ns"][rows], counted, errors)


def _item_values(session: SessionData, name: str, unit: str | None) -> NDArray[np.float64] | None:
    """The values (M,) of an item of ATTITUDE by answer, NaN where none was kept; None where there is no such item.

    Each answer brings one of them, of which every ``stride``-th is kept.
    """
    table, answers = session.housekeeping, len(session.sensor_attitudes)
    number = next((k for k, item in enumerate(table.items) if item.name == name and item.message == "ATTITUDE"), None)
    if number is None:
        return None
    factor = 1.0
    if unit is not None:
        try:
            factor = quantity(f"1 {table.items[number].unit}", unit)
        except ValueError:  # no angle
            return None
    kept = table.rows["value"][table.rows["item"] == number]
    if len(kept) != -(-answers // table.stride):  # a stretch of a session has fewer answers
        return None
    values = np.full(answers, np.nan)
    values[:: table.stride] = kept * factor
    return values


def stated_accuracy(session: SessionData, stats: Statistics) -> tuple[StatedAccuracy, ...]:
    """Of each axis with a stated accuracy, over the answers that enter the statistics of accuracy."""
    sigmas = {name: values for name in SIGMAS if (values := _item_values(session, name, "arcsec")) is not None}
    answers = _own_answers(session, stats) if sigmas else None
    if answers is None:
        return ()
    x, y, roll = answers.errors_arcsec.T
    to_axes = to_answers(np.eye(3)[None], session.station.sensor.attitude)[0]
    turns = product(np.column_stack([-y, x, -roll]), to_axes.T)  # the measured boresight lies at turn x z
    found = []
    for name, values in sigmas.items():
        sigma, error = values[answers.places], turns[:, SIGMAS.index(name)]
        known = answers.counted.used[answers.rows] & np.isfinite(error) & np.isfinite(sigma) & (sigma > 0)
        if known.any():
            found.append(_stated_accuracy(name[-1], error[known], sigma[known], answers.utc_ns[known]))
    return tuple(found)


def _stated_accuracy(
    axis: str, error: NDArray[np.float64], sigma: NDArray[np.float64], utc_ns: NDArray[np.int64]
) -> StatedAccuracy:
    off = error - np.average(error, weights=sigma**-2)
    scaled = off / sigma
    n_eff = error_bounds(scaled, (utc_ns - utc_ns[0]) / NS_PER_S).n_eff
    chi_square = low = high = _NAN
    if n_eff >= MIN_N_EFF:
        freedom = n_eff - 1
        chi_square = float((scaled**2).mean()) * n_eff / freedom
        low, high = (chi_square * freedom / float(chdtri(freedom, share)) for share in (0.025, 0.975))
    stated, scatter = (math.sqrt(float((values**2).mean())) for values in (sigma, off))
    return StatedAccuracy(axis, len(error), n_eff, stated, scatter, chi_square, low, high)


@dataclass(frozen=True, slots=True)
class OfQuality:
    """The answers whose quality lies between two values: how many were judged and false, the error of the boresights.

    The errors are of all of them whose truth is known, the false ones, too.
    """

    lowest: ItemValue
    highest: ItemValue
    answers: int
    false: int
    median_arcsec: float
    p95_arcsec: float


def errors_by_quality(session: SessionData, stats: Statistics) -> tuple[OfQuality, ...]:
    """Of each value of the quality that a sensor states, or of four groups where it has many."""
    values = _item_values(session, QUALITY, None)
    answers = _own_answers(session, stats) if values is not None else None
    if answers is None or values is None:
        return ()
    item = next(item for item in session.housekeeping.items if item.name == QUALITY)
    quality, judged = values[answers.places], answers.counted.judged[answers.rows]
    rows = np.flatnonzero(judged & ~answers.counted.excluded[answers.rows] & np.isfinite(quality))
    if not len(rows):
        return ()
    ends = np.unique(quality[rows])
    if len(ends) > _MOST_VALUES and not (item.words or item.are_bits):
        parts = np.arange(1, _GROUPS + 1) / _GROUPS
        ends = np.unique(np.quantile(quality[rows], parts, method="inverted_cdf"))
    off = np.hypot(answers.errors_arcsec[:, 0], answers.errors_arcsec[:, 1])
    false, group = answers.counted.false[answers.rows], np.searchsorted(ends, quality)
    found = []
    for number in range(len(ends)):
        of_one = rows[group[rows] == number]
        known = off[of_one][np.isfinite(off[of_one])]
        median, p95 = np.percentile(known, [50, 95]).tolist() if len(known) else (_NAN, _NAN)
        lowest, highest = (item.value(float(end)) for end in (quality[of_one].min(), quality[of_one].max()))
        found.append(OfQuality(lowest, highest, len(of_one), int(false[of_one].sum()), median, p95))
    return tuple(found)
