"""How a sensor does under each condition: availability, false answers and noise against Moon, Sun, altitude, stars
in the field and temperature, over all its nights; and from which angle to Moon and Sun it holds.

Each condition is cut into bins. A share has the exact bounds of gse.campaign.decision on what its nights leave, so a
bin that one night filled, or in which nights disagree, says little. A frame that the sky excuses does not count
against the sensor. One that is excused because no star was seen, with no cloud before or after, may as well be
blinded: it keeps a bin from showing that the sensor holds, and never shows that it does not.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.special import stdtrit

from gse.campaign.dataset import AGAIN, FRAMES, Committed, DataSet
from gse.campaign.decision import CampaignRow, share_over_nights
from gse.campaign.nights import Session
from gse.campaign.storage import StorageError
from gse.station.results import SkyCondition, Status, Subject
from gse.station.sky_condition import SUN_LIMIT_DEG
from gse.truth.solar_system import moon_lit_share
from gse.verdict.requirements import AVAILABILITY, FALSE_ANSWERS

SUNSET_DEG = -0.83
"""Altitude of the Sun's centre when its upper limb sets: refraction and half of its diameter."""
_HALF_LIT = 0.5
_TWILIGHT_DEG = -24.0
"""Below it the altitude of the Sun makes no difference: astronomical twilight ends at -18 deg."""
_GAP = 2.5
"""Answers farther apart than so many usual steps are not successive."""
_NAN = float("nan")
_SHARED = (
    "utc", "expected", "sky_condition", "stars_expected", "temperature_c",
    "sun_altitude_deg", "sun_separation_deg", "moon_altitude_deg", "moon_separation_deg",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Tally:
    """Counts of some frames of one night.

    ``n_eff`` is the number of independent frames among the ``expected``, ``blind`` those that are excused because no
    star was seen, ``squares`` the sum of squared differences of ``pairs`` of successive errors along two axes.
    """

    expected: float
    answered: float
    n_eff: float
    blind: float
    answers: float
    false: float
    squares: float
    pairs: float


class BinOutcome(StrEnum):
    """Whether a sensor keeps its limits in a bin.

    Undecided is a share below its limit whose bound reaches it. Too few are frames whose share keeps the limit without
    showing it, or that would decide nothing had they all been answered.
    """

    HOLDS = "holds"
    FAILS = "fails"
    UNDECIDED = "undecided"
    TOO_FEW = "too few"


@dataclass(frozen=True, slots=True)
class Bin:
    """What a sensor did from ``low`` to ``high`` of a condition, with 95 % bounds; NaN where nothing is known.

    ``noise_arcsec`` is the standard deviation of one axis on the sky from successive answers, with the two-sided
    ``noise_u_arcsec`` of the scatter between nights.
    """

    low: float
    high: float
    nights: int
    frames: int
    blind: int
    availability: float
    availability_lower: float
    availability_upper: float
    false_share: float
    false_lower: float
    false_upper: float
    noise_arcsec: float
    noise_u_arcsec: float
    outcome: BinOutcome


@dataclass(frozen=True, slots=True)
class Holding:
    """The angle from which a sensor holds lies between ``low_deg`` and ``high_deg`` with 95 %.

    ``low_deg`` is NaN where no bin shows that it fails, ``high_deg`` where none shows that it holds.
    ``nearest_deg`` is the smallest angle with frames.
    """

    low_deg: float
    high_deg: float
    nearest_deg: float

    def text(self) -> str:
        """A sentence for the page."""
        if math.isnan(self.low_deg) and math.isnan(self.high_deg):
            return "These sessions do not tell from which angle the sensor holds."
        if math.isnan(self.low_deg):
            return (
                f"The sensor holds from {self.high_deg:g} deg on. No angle is shown at which it fails; "
                f"the smallest that was seen is {self.nearest_deg:g} deg."
            )
        if math.isnan(self.high_deg):
            return f"The sensor fails at {self.low_deg:g} deg; no angle is shown from which it holds."
        return f"The sensor holds from an angle between {self.low_deg:g} and {self.high_deg:g} deg (95 %)."


@dataclass(frozen=True, slots=True)
class BinnedCondition:
    """The bins of one condition that have frames, in order; ``holding`` of an angle to Moon or Sun."""

    name: str
    unit: str
    bins: tuple[Bin, ...]
    holding: Holding | None


@dataclass(frozen=True, slots=True)
class _Kind:
    """A condition: its value in each frame, NaN where it does not apply, and the width of its bins."""

    name: str
    unit: str
    width: float
    value: Callable[[Session, dict[str, NDArray[np.float64]]], NDArray[np.float64]]
    is_angle: bool = False


def _moon(columns: dict[str, NDArray[np.float64]], *, half_lit: bool) -> NDArray[np.float64]:
    up = (columns["moon_altitude_deg"] > 0) & (columns["sun_altitude_deg"] < SUN_LIMIT_DEG)
    return np.where(up & ((columns["moon_lit"] >= _HALF_LIT) == half_lit), columns["moon_separation_deg"], _NAN)


def _where(values: NDArray[np.float64], applies: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.where(applies, values, _NAN)


_KINDS = (
    _Kind("angle to the Moon, half lit or more", "deg", 5, lambda _, of: _moon(of, half_lit=True), is_angle=True),
    _Kind("angle to the Moon, less than half lit", "deg", 5, lambda _, of: _moon(of, half_lit=False), is_angle=True),
    _Kind(
        "angle to the Sun, risen",
        "deg",
        5,
        lambda _, of: _where(of["sun_separation_deg"], of["sun_altitude_deg"] > SUNSET_DEG),
        is_angle=True,
    ),
    _Kind(
        "altitude of the Sun",
        "deg",
        6,
        lambda _, of: _where(of["sun_altitude_deg"], of["sun_altitude_deg"] > _TWILIGHT_DEG),
    ),
    _Kind(
        "altitude of the boresight",
        "deg",
        10,
        lambda session, of: np.full(len(of["expected"]), session.row["mount_altitude_deg"], dtype=np.float64),
    ),
    _Kind("catalogue stars in the field", "", 5, lambda _, of: of["stars_expected"]),
    _Kind("temperature of the detector", "degC", 5, lambda _, of: of["temperature_c"]),
)


def conditions(
    dataset: DataSet, sessions: Iterable[Session], subject: Subject, rows: Iterable[CampaignRow]
) -> list[BinnedCondition]:
    """The conditions of one sensor's sessions; ``rows`` have the limits that say whether it holds."""
    limits = {row.name: row.limit for row in rows if row.subject == subject.value}
    found: dict[str, dict[int, dict[str, list[_Tally]]]] = {kind.name: {} for kind in _KINDS}
    for session in sessions:
        columns = frame_columns(_frames(dataset, session, subject), subject)
        for kind in _KINDS:
            for place, tally in _tallies(session, columns, kind, subject):
                found[kind.name].setdefault(place, {}).setdefault(session.night, []).append(tally)
    made = [_condition(kind, found[kind.name], limits) for kind in _KINDS]
    return [one for one in made if len(one.bins) >= (1 if one.holding else 2)]


def frame_columns(frames: pa.Table, subject: Subject) -> dict[str, NDArray[np.float64]]:
    """What conditions look at, as columns (M,) of numbers, masks as 0 and 1; unknown numbers are NaN."""
    columns: dict[str, NDArray[np.float64]] = {}
    for name in _SHARED:
        values = frames[name]
        if name == "utc":
            columns[name] = values.cast(pa.int64()).to_numpy().astype(np.float64)
            columns["moon_lit"] = moon_lit_share(values.cast(pa.int64()).to_numpy())
        elif name == "sky_condition":
            blind = [word in (SkyCondition.NO_STARS, SkyCondition.DAYLIGHT) for word in values.to_pylist()]
            columns["blind"] = np.array(blind, dtype=np.float64)
        else:
            columns[name] = _numbers(values)
    who = subject.value
    if subject is Subject.SENSOR:
        columns["answered"] = np.nan_to_num(_numbers(frames["sensor_acquired"]))
    else:
        words = frames["onboard_status"].to_pylist()
        columns["answered"] = np.array([word == Status.IDENTIFIED for word in words], dtype=np.float64)
    for name in ("false", "used"):
        columns[name] = np.nan_to_num(_numbers(frames[f"{who}_{name}"]))
    for axis in ("d_ra_cosde_arcsec", "d_de_arcsec"):
        columns[axis] = _numbers(frames[f"{who}_{axis}"])
    return columns


def _numbers(values: pa.ChunkedArray) -> NDArray[np.float64]:
    return np.asarray(values.cast(pa.float64()).to_numpy(), dtype=np.float64)


def _frames(dataset: DataSet, session: Session, subject: Subject) -> pa.Table:
    who = subject.value
    answered = "sensor_acquired" if subject is Subject.SENSOR else "onboard_status"
    of_subject = [f"{who}_{name}" for name in ("false", "used", "d_ra_cosde_arcsec", "d_de_arcsec")]
    path = Committed(str(session.row["sensor"]), session.night, str(session.row["key"])).path(FRAMES)
    frames = dataset.read(path, [*_SHARED, answered, *of_subject])
    if frames is None:
        raise StorageError(f"{dataset.url}/{path} is missing; {AGAIN}", dataset.url)
    return frames


def _tallies(
    session: Session, columns: dict[str, NDArray[np.float64]], kind: _Kind, subject: Subject
) -> Iterable[tuple[int, _Tally]]:
    """The counts of one session for each bin of a condition."""
    value = kind.value(session, columns)
    known = np.isfinite(value)
    if not known.any():
        return
    place = np.full(len(value), np.iinfo(np.int64).min)
    place[known] = np.floor(value[known] / kind.width).astype(np.int64)
    of, n_eff = (session.row[f"{subject.value}_available_{part}"] or 0 for part in ("of", "n_eff"))
    worth = min(n_eff / of, 1.0) if of else 1.0
    expected, answered = columns["expected"] > 0, columns["answered"] > 0
    blind = ~expected & (columns["blind"] > 0) & ~answered
    squares = _successive_squares(columns, place)
    for number in np.unique(place[known]).tolist():
        here = place == number
        count = float((expected & here).sum())
        pairs = squares[here[1:] & np.isfinite(squares)]
        yield (
            int(number),
            _Tally(
                count,
                float((expected & answered & here).sum()),
                worth * count,
                float((blind & here).sum()),
                float((answered & here).sum()),
                float(((columns["false"] > 0) & here).sum()),
                float(pairs.sum()),
                float(len(pairs)),
            ),
        )


def _successive_squares(columns: dict[str, NDArray[np.float64]], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Squared differences (M - 1,) of successive errors on the sky, NaN where there are none within one bin."""
    step = np.diff(columns["utc"])
    used = columns["used"] > 0
    usual = float(np.median(step)) if len(step) else 0.0
    fit = used[1:] & used[:-1] & (place[1:] == place[:-1]) & (step > 0) & (step <= _GAP * usual)
    squares = np.diff(columns["d_ra_cosde_arcsec"]) ** 2 + np.diff(columns["d_de_arcsec"]) ** 2
    return np.where(fit, squares, _NAN)


def _condition(kind: _Kind, found: dict[int, dict[str, list[_Tally]]], limits: dict[str, float]) -> BinnedCondition:
    bins = tuple(_bin(kind.width, place, nights, limits) for place, nights in sorted(found.items()))
    return BinnedCondition(kind.name, kind.unit, bins, holding(bins) if kind.is_angle and bins else None)


def _bin(width: float, place: int, nights: dict[str, list[_Tally]], limits: dict[str, float]) -> Bin:
    expected, answered, n_eff, blind, answers, false, squares, pairs = (
        np.array([sum(getattr(one, name) for one in tallies) for tallies in nights.values()])
        for name in _Tally.__slots__
    )
    available = share_over_nights(answered, expected, n_eff)
    wrong = share_over_nights(false, answers, answers)
    noise, noise_u = _noise(squares, pairs)
    at_least, at_most = limits.get(AVAILABILITY.name, _NAN), limits.get(FALSE_ANSWERS.name, _NAN)
    with_blind, worth = expected + blind, n_eff + blind
    if available.upper < at_least or wrong.lower > at_most:
        outcome = BinOutcome.FAILS
    elif (doubted := share_over_nights(answered, with_blind, worth)).lower >= at_least:
        outcome = BinOutcome.HOLDS
    elif doubted.value < at_least <= share_over_nights(with_blind, with_blind, worth).lower:
        outcome = BinOutcome.UNDECIDED
    else:
        outcome = BinOutcome.TOO_FEW
    return Bin(
        low=place * width,
        high=(place + 1) * width,
        nights=len(nights),
        frames=int(expected.sum()),
        blind=int(blind.sum()),
        availability=available.value,
        availability_lower=available.lower,
        availability_upper=available.upper,
        false_share=wrong.value,
        false_lower=wrong.lower,
        false_upper=wrong.upper,
        noise_arcsec=noise,
        noise_u_arcsec=noise_u,
        outcome=outcome,
    )


def _noise(squares: NDArray[np.float64], pairs: NDArray[np.float64]) -> tuple[float, float]:
    """Standard deviation of one axis, and its two-sided 95 % uncertainty from the scatter of the nights."""
    if not pairs.sum():
        return _NAN, _NAN
    noise = math.sqrt(float(squares.sum() / pairs.sum()) / 4)
    nightly = np.sqrt(squares[pairs > 0] / pairs[pairs > 0] / 4)
    n = len(nightly)
    if n < 2:
        return noise, _NAN
    return noise, float(stdtrit(n - 1, 0.975)) * float(np.std(nightly, ddof=1)) / math.sqrt(n)


def holding(bins: tuple[Bin, ...]) -> Holding:
    """The angle from which a sensor holds: not below the highest bin that fails, and from where on all bins hold.

    A bin with too few frames is as one without any.
    """
    low = max((one.low for one in bins if one.outcome is BinOutcome.FAILS), default=_NAN)
    high = _NAN
    for one in reversed([one for one in bins if one.outcome is not BinOutcome.TOO_FEW]):
        if one.outcome is not BinOutcome.HOLDS:
            break
        high = one.low
    return Holding(low, high, min(one.low for one in bins))
