"""Real images of the night sky through replay://: right stars, right direction, right side of the Earth."""

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gse.sessions.replay import ReplayOptions, replay_session
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status
from gse.values.attitude import Attitude

NIGHT_SKY = Path(__file__).parents[3] / "replays" / "night-sky"
TRUTH: dict[str, Any] = json.loads((NIGHT_SKY.parents[1] / "benchmarks/real-sky/truth.json").read_text())
ROOFTOP = sorted(name for name in TRUTH if name.startswith("rooftop"))
TRIPOD = sorted(name for name in TRUTH if name.startswith("tripod"))
ARCSEC_PER_RAD = 180 * 3600 / np.pi


@functools.cache
def replayed(name: str, **options: Any) -> np.void:
    """The only frame of a session."""
    frames = replay_session(NIGHT_SKY / f"{name}.mcap", options=ReplayOptions(**options)).session.frames.columns
    assert len(frames) == 1
    row: np.void = frames.rows()[0]
    return row


def status(frame: np.void) -> Status:
    return STATUSES[frame["status"]]


def boresight_error_arcsec(frame: np.void, truth: dict[str, Any]) -> float:
    found = Attitude.from_angles(frame["ra_deg"], frame["de_deg"], 0).boresight_icrs
    true = Attitude.from_angles(truth["ra_deg"], truth["de_deg"], 0).boresight_icrs
    return float(np.linalg.norm(found - true)) * ARCSEC_PER_RAD


@pytest.mark.parametrize("name", ROOFTOP)
def test_a_rooftop_panorama_in_whole_pixels_is_right_within_30_arcsec(name: str) -> None:
    frame = replayed(name)
    assert status(frame) is Status.IDENTIFIED
    assert boresight_error_arcsec(frame, TRUTH[name]) < 30


@pytest.mark.parametrize("name", ROOFTOP)
def test_a_sub_pixel_rooftop_panorama_is_right_within_5_arcsec(name: str) -> None:
    frame = replayed(f"{name}-subpixel")
    assert boresight_error_arcsec(frame, TRUTH[name]) < 5


@pytest.mark.parametrize("name", ROOFTOP)
def test_the_rooftop_looks_where_its_scales_and_the_time_say(name: str) -> None:
    frame = replayed(name)
    assert abs(frame["d_ra_cosde_arcsec"]) < 0.5 * 3600
    assert abs(frame["d_de_arcsec"]) < 0.5 * 3600


def test_five_of_six_tripod_panoramas_are_right_within_120_arcsec() -> None:
    frames = {name: replayed(name) for name in TRIPOD}
    right = [
        name
        for name, frame in frames.items()
        if status(frame) is Status.IDENTIFIED and boresight_error_arcsec(frame, TRUTH[name]) < 120
    ]
    assert len(right) >= 5


@pytest.mark.parametrize("kind", ["", "-literal", "-subpixel"])
def test_no_answer_is_false_hot_pixels_or_not(kind: str) -> None:
    for name in (*ROOFTOP, *TRIPOD):
        frame = replayed(name + kind)
        if status(frame) is Status.IDENTIFIED:
            assert boresight_error_arcsec(frame, TRUTH[name]) < 120, name + kind
        assert ANSWER_CHECKS[frame["answer_check"]] is not AnswerCheck.FALSE


def test_a_clock_in_1970_gives_an_answer_but_no_comparison() -> None:
    replay = replay_session(NIGHT_SKY / f"{TRIPOD[0]}.mcap")
    frame = replay.session.frames.columns.rows()[0]
    assert status(frame) is Status.IDENTIFIED
    assert np.isnan(frame["d_de_arcsec"])
    assert "NO_TRUTH" in [event.kind for event in replay.session.events]


def test_the_cut_of_the_chunks_changes_nothing() -> None:
    whole = replayed(ROOFTOP[0])
    for most in (1, 7, 100):
        assert replayed(ROOFTOP[0], chunk_bytes=most).tobytes() == whole.tobytes()
