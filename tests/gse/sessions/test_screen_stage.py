"""The stage of a screen: what it plans, and what it says of the page that shows it."""

import time
from dataclasses import replace

import numpy as np
import pytest
from devices.screen_station import STATION

from drivers.clock import read_clock
from gse.sessions.screen import AHEAD_NS, UNKNOWN_MS, PageReport, Stage, sky_document
from gse.simulator.scenario import parse_scenario
from gse.values.instant import NS_PER_S
from gse.values.screen import Shown

SCENE = """\
text: two attitudes
scene:
  steps: [{ra_deg: 10, de_deg: 20, for_s: 5}, {ra_deg: 30, de_deg: 40, turn_deg_per_s: [0, 0.5, 0], for_s: 5}]
"""
READY = PageReport(1920, 1080, 1.0, True, 2.0)


def staged(scene=SCENE):
    return Stage(STATION, parse_scenario(scene, "test"))


def shown(news):
    return [item for item in news if isinstance(item, Shown)]


def events(news):
    return [item for item in news if not isinstance(item, Shown)]


def test_the_first_step_is_planned_once_a_page_is_ready_and_knows_the_time():
    stage = staged()
    assert shown(stage.take()) == []
    stage.hears(replace(READY, round_trip_ms=UNKNOWN_MS))
    assert shown(stage.take()) == []
    before_ns = read_clock().utc_ns
    stage.hears(READY)
    (first,) = shown(stage.take())
    assert (first.ra_deg, first.de_deg) == (10, 20)
    assert 0 <= first.from_ns - before_ns - AHEAD_NS - 30_000_000 < NS_PER_S  # the panel's light comes 30 ms later
    assert first.within_ms == pytest.approx(np.hypot(500 / 60, np.hypot(1.0, 20.0)), abs=0.01)
    assert shown(stage.take()) == []  # the next one is not due


def test_the_page_gets_each_planned_step_once_with_axes_and_rate():
    stage = staged()
    stage.hears(READY)
    stage.take()
    (step,) = stage.planned(0)
    assert stage.planned(1) == []
    axes = np.array(step["axes"])
    assert axes @ axes.T == pytest.approx(np.eye(3))
    ra, de = np.radians([10, 20])
    assert axes[2] == pytest.approx([np.cos(de) * np.cos(ra), np.cos(de) * np.sin(ra), np.sin(de)])
    assert step["turn_rad_per_s"] == [0, 0, 0]


def test_without_a_scene_the_direction_of_the_station_file_stands():
    stage = staged("text: nothing")
    stage.hears(READY)
    (still,) = shown(stage.take())
    assert (still.ra_deg, still.de_deg, still.roll_deg) == (83, -2, 20)
    assert not stage.is_over


@pytest.mark.parametrize(
    ("page", "words"),
    [
        (replace(READY, visible=False), "the page is hidden"),
        (replace(READY, ratio=1.1), "1.1 pixels of the panel for one of its own: set its zoom to 100 %"),
        (replace(READY, ratio=1.25), "the display's scale to 100 %"),
        (replace(READY, gap_ms=80.0), "stood for 80 ms instead of 17: this computer is busy"),
        (replace(READY, width=1366, height=768), "the page has 1366 x 768 pixels, the station file says 1920 x 1080"),
    ],
)
def test_a_page_that_cannot_show_the_scene_is_lost_with_what_to_do(page, words):
    stage = staged()
    stage.hears(READY)
    stage.take()
    stage.hears(page)
    ((kind, text),) = events(stage.take())
    assert kind == "SCREEN_LOST"
    assert words in text
    stage.hears(READY)
    assert events(stage.take()) == [("SCREEN_SHOWS", "the page shows the scene")]


def test_a_picture_that_is_missed_now_and_then_is_no_trouble():
    assert replace(READY, gap_ms=51.0).trouble(STATION.screen) == ""


def test_a_page_that_is_closed_is_lost_once():
    stage = staged()
    stage.hears(READY)
    stage.take()
    stage.leaves()
    ((kind, _),) = events(stage.take())
    assert kind == "SCREEN_LOST"
    assert stage.take() == []


def test_a_step_that_was_drawn_late_is_told_and_its_instant_is_known_less_well():
    stage = staged()
    stage.hears(READY)
    (planned,) = shown(stage.take())
    stage.drawn(0, 3.0)
    assert stage.take() == []
    stage.drawn(0, 80.0)
    told, corrected = stage.take()
    assert told == ("SCREEN_LATE", "the page drew 80 ms late: this computer is busy, or the browser is")
    assert corrected.from_ns == planned.from_ns
    assert corrected.within_ms == pytest.approx(80 + planned.within_ms)


def test_a_page_that_is_opened_again_while_a_step_stands_is_not_late():
    stage = staged()
    stage.hears(READY)
    (planned,) = shown(stage.take())
    stage.leaves()
    stage.take()
    while read_clock().utc_ns <= planned.from_ns:  # half a second
        time.sleep(0.05)
    stage.hears(READY)
    stage.drawn(0, 26_000.0)
    assert stage.take() == [("SCREEN_SHOWS", "the page shows the scene")]


def test_the_page_gets_all_stars_that_it_may_show_and_what_the_scene_adds():
    objects = "objects: [{ra_deg: 10, de_deg: 20, magnitude: -4, diameter_deg: 0.5}]"
    stage = staged(SCENE + f"  {objects}\n")
    sky = sky_document(stage)
    stars = np.array(sky["stars"]).reshape(-1, 4)
    assert stars[:-1, 3].max() <= STATION.screen.magnitude_limit
    assert len(stars) > 4000
    assert stars[-1, 3] == -4
    assert sky["discs"] == [(len(stars) - 1, pytest.approx(np.radians(0.5) * 5000, abs=0.01))]
    assert np.abs(np.linalg.norm(stars[:, :3], axis=1) - 1).max() < 1e-6
