"""Ten real frames of one camera over four months: a person saw the clouds, and one mount holds for all nights."""

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gse.config.station import parse_station
from gse.sessions.replay import replay_session
from gse.station.columns import SKY_CONDITIONS, STATUSES
from gse.station.mount_alignment import MeasuredMounts
from gse.station.results import SkyCondition, Status
from gse.station.session_data import SessionData

LOWELL = Path(__file__).parents[3] / "replays" / "lowell"
FRAMES: dict[str, Any] = json.loads((LOWELL / "frames.json").read_text())
WITHOUT_STARS = {"000": SkyCondition.NO_STARS, "009": SkyCondition.NO_STARS, "002": SkyCondition.DAYLIGHT}
"""Two overcast nights and a dawn."""
HAZE = "011"
"""Overcast by its label: a bright haze about the Moon, with a few stars."""
CLEAR = sorted(set(FRAMES) - {*WITHOUT_STARS, HAZE})
ARCMIN = np.pi / 180 / 60


@functools.cache
def replayed(name: str) -> tuple[SessionData, MeasuredMounts]:
    measured = MeasuredMounts()
    session = replay_session(LOWELL / f"{name}.mcap", make_listeners=lambda loop: [measured]).session
    return session, measured


def condition(name: str) -> SkyCondition:
    (frame,) = replayed(name)[0].frames.columns.rows()
    return SKY_CONDITIONS[frame["sky_condition"]]


@pytest.mark.parametrize("name", WITHOUT_STARS)
def test_no_star_is_named_behind_a_closed_cloud_or_at_dawn(name: str) -> None:
    (frame,) = replayed(name)[0].frames.columns.rows()
    assert STATUSES[frame["status"]] is not Status.IDENTIFIED
    assert frame["stars_seen"] == 0
    assert condition(name) is WITHOUT_STARS[name]


@pytest.mark.parametrize("name", CLEAR)
def test_a_sky_with_stars_is_clear(name: str) -> None:
    assert condition(name) is SkyCondition.CLEAR


def test_a_haze_with_a_few_stars_about_the_moon_is_not_called_clear() -> None:
    assert condition(HAZE) is SkyCondition.UNKNOWN


def test_overcast_frames_show_fewer_of_the_expected_stars_than_all_others() -> None:
    shares = {name: replayed(name)[0].frames.columns.rows()[0] for name in FRAMES if name != "002"}
    shares = {name: frame["stars_seen"] / frame["stars_expected"] for name, frame in shares.items()}
    overcast = [share for name, share in shares.items() if FRAMES[name]["clouded_cells_of_33"] == 33]
    others = [share for name, share in shares.items() if FRAMES[name]["clouded_cells_of_33"] < 33]
    assert max(overcast) < min(others)


def test_the_mount_of_one_night_holds_on_all_others_within_5_arcmin() -> None:
    (one,) = replayed("005")[1].horizon_to_sensor
    for name in (*CLEAR, HAZE):
        (other,) = replayed(name)[1].horizon_to_sensor
        assert np.linalg.norm(other[2] - one[2]) < 5 * ARCMIN, name


def test_the_station_file_states_that_mount() -> None:
    (frame,) = replayed("005")[0].frames.columns.rows()
    assert np.hypot(frame["d_ra_cosde_arcsec"], frame["d_de_arcsec"]) < 10


def test_a_session_made_of_images_is_not_marked_simulated_for_want_of_a_port() -> None:
    """Its station file names no port, and the port of one that names none is the simulated sensor's."""
    session = replayed("005")[0]
    assert "port" not in parse_station(session.station_text).model_fields_set
    assert not session.is_simulated
