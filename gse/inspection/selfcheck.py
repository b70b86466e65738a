"""The self-check: sessions of a made sensor with known errors go the way of every session; found against injected.

The sky is astropy's, the bytes are the protocol's, and from the first byte on all is the station's own: framing,
clock, identification, truth and statistics.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.config.station import parse_station
from gse.imaging.session_fit import PanoramaSample, calibrate_session
from gse.inspection.made_session import (
    FOCAL_LENGTH_PX,
    KNOWN_ERRORS,
    POINTINGS,
    SITE,
    START_NS,
    STATION_TEXT,
    AstropySky,
    KnownError,
    MadeSensor,
    MadeSky,
    begins_ns,
    chunks,
    east_and_north,
    stated_sensor,
    true_sensor,
)
from gse.inspection.selfcheck_result import CheckedRow, SelfCheckResult
from gse.process.installation import source_sha256
from gse.station.frame_results import FrameResults
from gse.station.loop import StationLoop
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.station.setup import Setup, set_up, versions
from gse.statistics.session_statistics import Statistics, statistics
from gse.truth import SiderealTruth
from gse.values.axis import AXES, CROSS_X, CROSS_Y, D_DE
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.instant import NS_PER_S
from gse.version import __version__

# What a known error must show as, by astropy's directions and plain least squares.

_STEP_RAD = 1e-6


def expected_arcsec(sky: AstropySky, error: KnownError) -> tuple[float, float, float]:
    """Mean dRA* (east), dDE (north) and roll (up from north through east): the true axes against the stated ones."""
    utc_ns = begins_ns()
    stated = np.broadcast_to(stated_sensor().axes, (len(utc_ns), 3, 3))
    true = np.array([true_sensor(error, instant).axes for instant in utc_ns.tolist()])
    boresight, up = sky.boresight_and_up(stated, utc_ns + round(error.clock_s * NS_PER_S))
    true_boresight, true_up = sky.boresight_and_up(true, utc_ns)
    east, north = east_and_north(boresight)
    left = np.cross(up, boresight)  # from north through east, where up is north
    moved = true_boresight - boresight
    errors = [(moved * east).sum(axis=1), (moved * north).sum(axis=1), (true_up * left).sum(axis=1)]
    d_ra_cosde, d_de, roll = (np.mean(errors, axis=1) * ARCSEC_PER_RAD).tolist()
    return d_ra_cosde, d_de, roll


def noise_arcsec(sensor: MadeSensor, fields: list[NDArray[np.float64]], noise_px: float) -> tuple[float, float]:
    """The boresight's scatter along columns and rows that position noise makes, over fields of directions (N, 3).

    By least squares on the pixels: the turns about the sensor's axes that explain the displacements best.
    """
    variances = []
    for directions in fields:
        still = sensor.pixels(directions)
        shifts = [sensor.turned(axis, _STEP_RAD).pixels(directions) - still for axis in sensor.axes]
        design = np.stack([shift.ravel() for shift in shifts], axis=1) / _STEP_RAD
        covariance = np.linalg.inv(design.T @ design) * noise_px**2
        # A turn about up moves the boresight along columns, one about right along rows.
        variances.append([covariance[1, 1], covariance[0, 0]])
    along_x, along_y = (np.sqrt(np.mean(variances, axis=0)) * ARCSEC_PER_RAD).tolist()
    return along_x, along_y


Station = Callable[[Setup], StationLoop]

_BORESIGHT_ARCSEC, _ROLL_ARCSEC, _DRIFT_ARCSEC_PER_H = 0.1, 1.0, 0.1
_NOISE_SHARE = 0.06
"""Three standard deviations of a scatter that 1,600 frames show."""
_FOCAL_PERCENT = 0.002
_DIGITS = 4


@dataclass(frozen=True, slots=True)
class _Found:
    """What the station made of a session: its statistics, its frames, and what calibrates its camera."""

    error: KnownError
    loop: StationLoop
    stats: Statistics
    sample: PanoramaSample
    unknown_objects: int


class _Frames:
    """A listener that keeps what the statistics do not."""

    def __init__(self) -> None:
        self.sample = PanoramaSample()
        self.unknown_objects = 0

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        for result in results:
            self.sample.add(result.panorama)
            self.unknown_objects += len(result.others)

    def on_event(self, event: object) -> None:
        """Events say nothing here: an hour without bytes is one."""


def selfcheck(
    utc: str,
    *,
    station: Station = StationLoop,
    errors: tuple[KnownError, ...] = KNOWN_ERRORS,
    each: Callable[[CheckedRow], None] = lambda row: None,
) -> SelfCheckResult:
    """Check the station, or another that is given, against known errors; ``utc`` is when. ``each`` gets every row."""
    rows = []
    for row in _rows(set_up_selfcheck(), station, errors):
        rows.append(row)
        each(row)
    return SelfCheckResult(__version__, source_sha256(), versions(), tuple(rows), utc)


@functools.lru_cache(maxsize=1)
def set_up_selfcheck() -> Setup:
    """The station that is said to look at the made sky."""
    return set_up(parse_station(STATION_TEXT), STATION_TEXT, utc_ns=START_NS)


def _rows(setup: Setup, station: Station, errors: tuple[KnownError, ...]) -> Iterator[CheckedRow]:
    sky = MadeSky(setup.identifier.catalog.icrs, max(error.frames for error in errors))
    for seed, error in enumerate(errors):
        watched = _watched(setup, station(setup), sky, error, seed)
        for quantity, unit, injected, found, tolerance in (*_attitude(sky, watched), *_own(sky, watched)):
            values = (round(float(value), _DIGITS) + 0.0 for value in (injected, found, tolerance))
            yield CheckedRow(error.name, quantity, unit, *values)


def _watched(setup: Setup, loop: StationLoop, sky: MadeSky, error: KnownError, seed: int) -> _Found:
    listener = _Frames()
    loop.listeners = [listener]
    loop.take(list(chunks(sky.frames(error, seed), setup.protocol, clock_s=error.clock_s)))
    loop.finish()
    return _Found(error, loop, statistics(loop.session), listener.sample, listener.unknown_objects)


_Compared = tuple[str, str, float, float, float]


def _attitude(sky: MadeSky, watched: _Found) -> Iterator[_Compared]:
    """The three angles that each error moves, or must leave alone; a wrong focal length leaves few answers."""
    if watched.error.focal_share:
        return
    expected = expected_arcsec(sky.sky, watched.error)
    yield from _angles(watched, Subject.ONBOARD, expected)
    if watched.error.own_east_arcsec is not None:
        east, north, roll = expected
        yield from _angles(watched, Subject.SENSOR, (east + watched.error.own_east_arcsec, north, roll))


def _angles(watched: _Found, subject: Subject, expected: tuple[float, float, float]) -> Iterator[_Compared]:
    tolerances = _BORESIGHT_ARCSEC, _BORESIGHT_ARCSEC, _ROLL_ARCSEC
    axes = watched.stats.subjects[subject].axes
    spread = 3 / math.sqrt(POINTINGS * watched.error.frames)
    for axis, tolerance, injected in zip(AXES, tolerances, expected, strict=True):
        # What noise adds to a mean of so many frames, three times.
        noise = spread * axes[axis.key].nea_arcsec if watched.error.noise_px else 0.0
        yield f"{subject} {axis.label}", axis.unit, injected, axes[axis.key].bias_arcsec, tolerance + noise


def _own(sky: MadeSky, watched: _Found) -> Iterator[_Compared]:
    """What the statistics call the error by its own name."""
    error, onboard = watched.error, watched.stats.onboard
    if not error.focal_share:
        yield from _answers(watched, Subject.ONBOARD, POINTINGS * (error.frames - error.blank), 0)
    if error.own_east_arcsec is not None:
        good, false = (POINTINGS * count for count in (error.frames - error.own_false, error.own_false))
        yield from _answers(watched, Subject.SENSOR, good, false)
    if error.poleward_arcsec_per_h:
        drift = onboard.axes[D_DE.key].drift_arcsec_per_h
        yield f"{Subject.ONBOARD} drift of dDE", "arcsec/h", error.poleward_arcsec_per_h, drift, _DRIFT_ARCSEC_PER_H
    if error.false_objects:
        injected = POINTINGS * error.frames * error.false_objects
        yield "objects that are not stars", "", injected, watched.unknown_objects, 0.0
    if error.noise_px:
        yield from _noise(sky, watched)
    if error.focal_share:
        yield "focal length", "%", 100 * error.focal_share, _focal_percent(watched), _FOCAL_PERCENT


def _answers(watched: _Found, subject: Subject, good: int, false: int) -> Iterator[_Compared]:
    found = watched.stats.subjects[subject]
    yield f"{subject} right answers", "", good, found.available.count, 0.0
    yield f"{subject} false answers", "", false, found.false_answers.count, 0.0


def _noise(sky: MadeSky, watched: _Found) -> Iterator[_Compared]:
    expected = noise_arcsec(stated_sensor(), sky.first_of_each(), watched.error.noise_px)
    for name, axis, injected in zip(("columns", "rows"), (CROSS_X, CROSS_Y), expected, strict=True):
        found = watched.stats.onboard.axes[axis.key].nea_arcsec
        yield f"{Subject.ONBOARD} NEA along {name}", "arcsec", injected, found, _NOISE_SHARE * injected


def _focal_percent(watched: _Found) -> float:
    setup, orientation = watched.loop.setup, watched.loop.session.earth_orientation
    truth = None if orientation is None else SiderealTruth(SITE, orientation)
    fitted = calibrate_session(watched.sample, setup.camera, setup.of_true_stars, truth).calibration.camera
    return 100 * (fitted.focal_length_px / FOCAL_LENGTH_PX - 1)
