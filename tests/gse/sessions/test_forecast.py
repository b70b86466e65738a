"""When a running session will have its verdict: asked of a snapshot, in words."""

import threading

import numpy as np
import pytest
from devices.patience import PATIENCE_S
from skies.known_nights import VOUCHED
from skies.one_by_one import add_frame, results_of
from skies.synthetic_night import small_catalog, synthetic_frames, synthetic_night

from drivers.clock import read_clock
from gse.sessions.forecast import Forecast, forecast_text, snapshot
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status
from gse.station.session_data import SessionData
from gse.station.star_names import STAR_NAME, StarNames
from gse.values.axis import AXES
from gse.verdict.assessment import judge
from gse.verdict.session_plan import rows_left
from gse.view.glance import Glance
from gse.view.live_state import LiveState
from protocols import StarsMessage


def test_a_snapshot_stays_as_it_is_while_the_session_grows() -> None:
    session = synthetic_night(200)
    taken = snapshot(session)
    columns, matches = taken.frames.columns.rows(), taken.frames.matches.copy()
    for frame in synthetic_frames(200, seed=2):
        add_frame(session.frames, frame)
    results = results_of([*synthetic_frames(1)])
    time_us, frame_no = int(results.panoramas.time_us[0]), int(results.panoramas.frame_no[0])
    session.star_names.take_list(StarsMessage(time_us, frame_no, objects=(0,), stars=(5,)))
    session.star_names.take_results(results)
    session.link.frames += 200
    session.events.clear()
    assert len(session.frames) == 400
    assert len(session.frames.matches) > len(matches)
    assert taken.frames.columns.rows().tobytes() == columns.tobytes()
    assert taken.frames.matches.tobytes() == matches.tobytes()
    assert (len(session.star_names.rows), len(taken.star_names.rows)) == (1, 0)
    assert taken.events
    assert taken.link.frames == session.link.frames - 200
    assert str(judge(taken).rows) == str(judge(synthetic_night(200)).rows)


@pytest.mark.parametrize(
    ("station", "bias_arcsec", "words"),
    [
        (None, (0.0, 0.0), "PASS, if it ended now"),
        (VOUCHED, (100.0, 0.0), "FAIL, if it ended now"),
        (None, (100.0, 0.0), "no verdict as it goes: set-up"),
    ],
)
def test_the_line_follows_the_verdict_so_far(station, bias_arcsec, words: str) -> None:
    session = synthetic_night(3000, station=station, bias_arcsec=bias_arcsec)
    assert forecast_text(judge(session)).startswith(words)


def test_a_session_without_an_answer_has_no_verdict_ahead_of_it() -> None:
    session = synthetic_night(200)
    session.frames.columns["d_ra_cosde_arcsec"] = session.frames.columns["d_de_arcsec"] = np.nan
    session.frames.columns["d_roll_arcsec"] = np.nan
    assert forecast_text(judge(session)).startswith("no verdict as it goes")


def dusk(frames: int, light: int) -> SessionData:
    """A night whose first frames are of a bright sky without a star."""
    session = synthetic_night(frames)
    first = session.frames.columns.rows()[:light]
    first["status"], first["answer_check"] = STATUSES.index(Status.TOO_FEW), ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    first["objects"] = first["stars_seen"] = 0
    first["sun_altitude_deg"] = -5.0
    for axis in AXES:
        first[axis.column] = np.nan
    for name in first.dtype.names or ():
        session.frames.columns[name][:light] = first[name]
    return session


def test_a_dusk_has_no_verdict_ahead_of_it_and_says_why() -> None:
    assert forecast_text(judge(dusk(1000, 600))) == "no verdict as it goes: no sky in 600 of 1000 frames"


def test_what_is_left_is_counted_in_the_part_that_had_a_sky() -> None:
    """Of 0 false answers at a limit of 1 % 299 are needed, at 10 a second: 200 are there, and 100 more take 10 s."""
    left = {item.row.name: item.minutes for item in rows_left(judge(dusk(1000, 800)))}
    assert left["false answers"] == pytest.approx(99 / 600, rel=0.1)


def test_the_loop_hands_over_one_snapshot_and_goes_on() -> None:
    session = synthetic_night(100)
    session.stars, names = small_catalog().listed, np.zeros(3, STAR_NAME)
    names["list"], names["number"] = (1, 1, 2), session.stars.ids[[0, 1, 1]]
    names["star"] = 0, 1, 0
    session.star_names = StarNames(names)
    (frame,) = synthetic_frames(1)
    live = LiveState(session.station)
    forecast = Forecast(live)
    try:
        for _ in range(3):
            forecast.on_results(results_of([frame]), session)
        pause = threading.Event()
        for _ in range(round(20 * PATIENCE_S)):
            if live.metrics:
                break
            pause.wait(0.05)
        assert live.forecast
        assert "| noise equivalent angle, x | " in live.metrics
        assert "| wrong star names | 1 of 3, in 1 of 2 lists |" in live.metrics
        assert Glance(live).document(read_clock())["items"] == [
            ("wrong star names", "1 of 3, in 1 of 2 lists", "yellow")
        ]
    finally:
        forecast.close()
