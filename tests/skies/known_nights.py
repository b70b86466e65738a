"""Nights made of numbers, whose errors are known: no stars, no identifier."""

import math

import numpy as np
from skies.one_by_one import add_frames

from drivers.clock import ClockReading
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.identifier import Identification
from gse.instant import NS_PER_S, from_text
from gse.panorama import Panorama
from gse.station.results import AnswerCheck, AttitudeError, FrameResult, Matches, Status
from gse.station.session_data import SessionData
from gse.truth import EarthOrientation, SiderealTruth

START_NS = from_text("2026-03-20T18:30:00Z")
STATION = parse_station(BUILT_IN_TEXT)
TABLE = EarthOrientation.from_disk(START_NS)
TRUTH = SiderealTruth(STATION.site, TABLE)


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
    results = []
    for number in range(count):
        utc_ns = START_NS + round(number * step_s * NS_PER_S)
        hours = number * step_s / 3600
        ra, de = rng.normal(0, noise, 2) + bias[:2] + np.array(drift_per_h) * hours
        roll = float(rng.normal(0, 10 * noise)) + bias[2]
        results.append(frame(utc_ns, number, AttitudeError(ra, de, roll, ra, -de), judged, sensor_ppm, matches))
    add_frames(made.frames, results)
    return made


def frame(utc_ns, number, error, judged=AnswerCheck.CORRECT, sensor_ppm=0.0, matches=()):
    true = TRUTH.attitude_true(utc_ns, STATION.mount)
    time_us = round((utc_ns - START_NS) / 1000 * (1 - sensor_ppm * 1e-6))
    late_ns = 200_000 + round(-2e6 * math.log(1 - (number * 0.6180339887) % 1))
    xy_px = np.array([[x, y] for x, y, _, _ in matches]).reshape(-1, 2)
    panorama = Panorama(utc_ns, xy_px, np.ones(len(xy_px)), number, 0.1, time_us, utc_ns + late_ns)
    return FrameResult(
        panorama,
        Status.IDENTIFIED,
        "",
        "neighbour",
        identification=Identification(np.arange(0), np.arange(0), 1e-9),
        attitude=true,
        matches=Matches(*[np.arange(len(matches))] * 2, np.array(matches).reshape(-1, 4)[:, 2:], str),
        elapsed_us=150.0,
        attitude_error=error,
        attitude_true=true,
        answer_check=judged,
    )


def unanswered(number, status=Status.NO_MATCH):
    panorama = Panorama(START_NS + number * NS_PER_S, np.empty((0, 2)), np.empty(0), number)
    return FrameResult(panorama, status, "", "neighbour", answer_check=AnswerCheck.ABSENT)
