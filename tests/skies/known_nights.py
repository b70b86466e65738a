"""Nights made of numbers, whose errors are known: no stars, no identifier."""

import math
from dataclasses import replace

import numpy as np
from skies.one_by_one import Made, Stars, results_of

from drivers.clock import ClockReading
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.identifier import Identification
from gse.station.frame_results import ERRORS
from gse.station.results import AnswerCheck, AttitudeError, Status
from gse.station.session_data import SessionData
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.attitude import angles_deg
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import MountUncertainty
from gse.values.panorama import Panorama
from gse.values.site import SiteUncertainty

START_NS = from_text("2026-03-20T18:30:00Z")
STATION = parse_station(BUILT_IN_TEXT)
VOUCHED = STATION.model_copy(
    update={
        "mount": replace(
            STATION.mount, uncertainty=MountUncertainty(azimuth_arcsec=9.0, altitude_arcsec=9.0, roll_arcsec=9.0)
        ),
        "site": replace(STATION.site, uncertainty=SiteUncertainty(position_m=9.0)),
    }
)
"""The same, with a survey of mount and site: the clock of these nights is synchronised."""
TABLE = EarthOrientation.from_disk(START_NS)
TRUTH = SiderealTruth(STATION.site, TABLE)
NONE = AttitudeError(0.0, 0.0, 0.0, 0.0, 0.0)


def session(
    count=2000,
    *,
    step_s=0.1,
    noise=5.0,
    bias=(0.0, 0.0, 0.0),
    drift_per_h=(0.0, 0.0),
    judged=AnswerCheck.CORRECT,
    sensor_ppm=0.0,
    station=STATION,
    matches=(),
    seed=1,
):
    """A night of ``count`` frames with known errors in dRA*, dDE and roll, in arcsec."""
    rng = np.random.default_rng(seed)
    made = SessionData(station, BUILT_IN_TEXT, "panorama-v1", earth_orientation=TABLE)
    made.catalog = {"epoch_jyear": 2016.0}
    made.clock = [ClockReading(START_NS, 0, "kernel PLL", True, 0.0, 0.01)]
    numbers = np.arange(count)
    utc_ns = START_NS + np.round(numbers * step_s * NS_PER_S).astype(np.int64)
    errors = rng.normal(0, (noise, noise, 10 * noise), (count, 3)) + bias
    errors[:, :2] += np.outer(numbers * step_s / 3600, drift_per_h)
    if count:
        made.frames.extend(*rows_of(utc_ns, numbers, errors, frame(START_NS, 0, NONE, judged, sensor_ppm, matches)))
        made.frames.columns["time_us"] = np.round((utc_ns - START_NS) / 1000 * (1 - sensor_ppm * 1e-6))
    return made


def rows_of(utc_ns, numbers, errors, like):
    """Rows of FRAME and of MATCH of frames that are like one, but for what differs from frame to frame.

    They take a tenth of the time of frames that are made one by one.
    """
    one = results_of([like])
    rows, matches = np.repeat(one.rows, len(numbers)), np.tile(one.match_rows(), len(numbers))
    rows["utc_ns"], rows["frame_no"] = utc_ns, numbers
    rows["host_utc_ns"] = utc_ns + [late_ns(number) for number in numbers.tolist()]
    ra, de, roll = errors.T
    for name, values in zip(ERRORS, (ra, de, roll, ra, -de), strict=True):
        rows[name] = values
    true = angles_deg(TRUTH.attitudes_true(TRUTH.icrs_to_horizon_at(utc_ns), STATION.mount).icrs_to_sensor)
    for axis, name in enumerate(("ra", "de", "roll")):
        rows[f"{name}_deg"] = rows[f"{name}_true_deg"] = true[:, axis]
    if like.answer_check is AnswerCheck.CORRECT:
        rows["ra_reference_deg"], rows["de_reference_deg"] = true[:, 0], true[:, 1]
    matches["frame"] = np.repeat(numbers, len(matches) // len(numbers))
    return rows, matches


def late_ns(number):
    """How long after the end of its exposure a frame is read."""
    return 200_000 + round(-2e6 * math.log(1 - (number * 0.6180339887) % 1))


def frame(utc_ns, number, error, judged=AnswerCheck.CORRECT, sensor_ppm=0.0, matches=()):
    true = TRUTH.attitude_true(utc_ns, STATION.mount)
    time_us = round((utc_ns - START_NS) / 1000 * (1 - sensor_ppm * 1e-6))
    xy_px = np.array([[x, y] for x, y, _, _ in matches]).reshape(-1, 2)
    panorama = Panorama(utc_ns, xy_px, np.ones(len(xy_px)), number, 0.1, time_us, utc_ns + late_ns(number))
    return Made(
        panorama,
        Status.IDENTIFIED,
        "",
        "neighbour",
        identification=Identification(np.arange(0), np.arange(0), 1e-9),
        attitude=true,
        matches=Stars(*[np.arange(len(matches))] * 2, np.array(matches).reshape(-1, 4)[:, 2:], str),
        elapsed_us=150.0,
        attitude_error=error,
        attitude_true=true,
        answer_check=judged,
    )


def unanswered(number, status=Status.NO_MATCH):
    panorama = Panorama(START_NS + number * NS_PER_S, np.empty((0, 2)), np.empty(0), number)
    return Made(panorama, status, "", "neighbour", answer_check=AnswerCheck.ABSENT)
