"""The page of a screen in a real Chromium: its stars against the catalogue, its reports, its manners."""

import io
import time

import numpy as np
import pytest
from devices.browser import browser
from devices.patience import PATIENCE_S
from devices.screen_station import STATION
from PIL import Image

from gse.catalog import load_catalog
from gse.sessions.screen import Stage, screen_content
from gse.simulator.scenario import parse_scenario
from gse.values.attitude import Attitude
from gse.values.instant import to_julian_year
from gse.values.screen import Shown
from gse.view.server import ViewServer

SCENE = """\
text: one attitude
scene:
  steps: [{ra_deg: 359.9, de_deg: 60, roll_deg: 170, for_s: 600}]
  false_objects: 1
  seed: 3
"""


@pytest.fixture(scope="module")
def visit():
    with browser() as opened:
        yield opened


@pytest.fixture
def stage():
    return Stage(STATION, parse_scenario(SCENE, "test"))


@pytest.fixture
def served(stage):
    with ViewServer("127.0.0.1", 0, screen_content(stage)) as server:
        yield server


def news_until(stage, wanted):
    """All news up to the first that is wanted."""
    news, until_s = [], time.monotonic() + PATIENCE_S
    while not any(wanted(item) for item in news):
        assert time.monotonic() < until_s, news
        news += stage.take()
        time.sleep(0.05)
    return news


def wait_until(page, condition):
    """Wait for the page's script; the page lets no text be run, so that it is asked again and again from outside."""
    until_s = time.monotonic() + PATIENCE_S
    while not page.evaluate(condition):
        assert time.monotonic() < until_s, condition
        time.sleep(0.05)


def is_shown(item):
    return isinstance(item, Shown)


def linear_light(page):
    image = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("L"), dtype=np.float64)
    return (image / 255) ** STATION.screen.gamma


def test_each_star_stands_where_the_catalogue_has_it_to_a_hundredth_of_a_pixel(visit, served, stage):
    with visit(size=(1920, 1080)) as opened:
        opened.page.goto(served.url)
        (shown,) = [item for item in news_until(stage, is_shown) if is_shown(item)]
        wait_until(opened.page, "drawn === 0")
        light = linear_light(opened.page)
        assert opened.errors == []
        assert opened.hosts() == {"127.0.0.1"}
    catalog = load_catalog(faintest_magnitude=6.0).at_epoch(to_julian_year(shown.from_ns))
    directions = catalog.icrs @ Attitude.from_angles(359.9, 60, 170).icrs_to_sensor.T
    ahead = directions[:, 2] > 0.9
    x, y = (
        959.5 + 5000 * directions[ahead, 0] / directions[ahead, 2],
        539.5 + 5000 * directions[ahead, 1] / directions[ahead, 2],
    )
    on_screen = (x > 10) & (x < 1909) & (y > 10) & (y < 1069)
    places, magnitudes = np.column_stack([x, y])[on_screen], catalog.magnitude[ahead][on_screen]
    off = []
    for place, magnitude in zip(places, magnitudes, strict=True):
        column, row = np.rint(place).astype(int)
        part = light[row - 6 : row + 7, column - 6 : column + 7]
        rows, columns = np.mgrid[row - 6 : row + 7, column - 6 : column + 7]
        alone = np.sort(np.hypot(*(places - place).T))[1] > 15
        if alone:
            assert part.max() == pytest.approx(10 ** (-0.4 * (magnitude - 1.5)), rel=0.25)
            off.append([(part * columns).sum() / part.sum() - place[0], (part * rows).sum() / part.sum() - place[1]])
    assert len(off) > 40
    assert np.sqrt(np.mean(np.square(off))) < 0.01


def test_the_page_knows_the_time_of_the_station_to_some_milliseconds(visit, served, stage):
    with visit(size=(1920, 1080)) as opened:
        opened.page.goto(served.url)
        news_until(stage, is_shown)
        page_ms = opened.page.evaluate("performance.now() + clock.offset")
        assert abs(page_ms - time.time() * 1000) < 100  # the way of the answer is in it


def test_a_second_page_is_sent_away_and_the_first_goes_on(visit, served, stage):
    with visit(size=(1920, 1080)) as first, visit(size=(1920, 1080)) as second:
        first.page.goto(served.url)
        news_until(stage, is_shown)
        second.page.goto(served.url)
        wait_until(second.page, "say.textContent.includes('another page shows the screen already')")
        wait_until(first.page, "drawn === 0")
        assert "SCREEN_LOST" not in [item[0] for item in stage.take() if not is_shown(item)]


def test_a_page_of_another_size_shows_nothing_and_says_so(visit, served, stage):
    with visit(size=(1280, 720)) as opened:
        opened.page.goto(served.url)
        news = news_until(stage, lambda item: "1280 x 720" in str(item))
    assert not any(is_shown(item) for item in news)


@pytest.mark.parametrize(("ratio", "size"), [(1.1, (1745, 982)), (1.25, (1536, 864))])
def test_a_zoom_and_a_scaled_display_show_nothing_and_are_named(visit, served, stage, ratio, size):
    with visit(size=size, ratio=ratio) as opened:
        opened.page.goto(served.url)
        news = news_until(stage, lambda item: f"the browser draws {ratio:g} pixels of the panel" in str(item))
    assert "set its zoom to 100 % (Ctrl-0) and the display's scale to 100 %" in str(news[-1])
    assert not any(is_shown(item) for item in news)


TURNING = """\
text: a scene that turns
scene: {steps: [{ra_deg: 83, de_deg: -2, turn_deg_per_s: [0, 0.5, 0], for_s: 600}]}
"""


def test_a_picture_that_stands_too_long_while_the_scene_turns_is_told(visit):
    stage = Stage(STATION, parse_scenario(TURNING, "test"))
    with ViewServer("127.0.0.1", 0, screen_content(stage)) as server, visit(size=(1920, 1080)) as opened:
        opened.page.goto(server.url)
        news_until(stage, is_shown)
        wait_until(opened.page, "drawn === 0 && turnedAt !== null")
        opened.page.evaluate("for (const end = performance.now() + 400; performance.now() < end;);")
        (*_, told) = news_until(stage, lambda item: not is_shown(item) and "instead of 17" in item[1])
    assert told[0] == "SCREEN_LOST"


def test_the_page_is_small(served):
    from urllib.request import urlopen

    sizes = [len(urlopen(served.url + name, timeout=PATIENCE_S).read()) for name in ("", "screen.js")]
    assert sum(sizes) < 50_000
