"""The live view in a real browser: the page opens, the plots draw, and no request leaves the machine."""

import io
import itertools
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from devices.browser import Visits, browser
from devices.patience import PATIENCE_S
from devices.proxy import Proxy
from PIL import Image
from skies.one_by_one import results_of
from skies.synthetic_night import small_catalog, synthetic_frames, synthetic_night

from drivers.chunk import LinkEvent
from gse.station.events import Notes, StationKind
from gse.view.drawing import ORANGE, PINK, SKY_BLUE, VERMILLION
from gse.view.glance import Glance
from gse.view.live import LiveView
from gse.view.live_state import LiveState
from gse.view.saved_view import save_view
from gse.view.server import Content, ViewServer

FRAMES = 299
"""The 300th would have no answer, and so no stars to see."""


@pytest.fixture(scope="module")
def visit() -> Iterator[Visits]:
    """Pages of one browser."""
    with browser() as visits:
        yield visits


@contextmanager
def sent_again_and_again(live: LiveState) -> Iterator[None]:
    """Frames keep coming while the page is looked at, as on the roof."""
    session = synthetic_night(20)
    ended = threading.Event()

    def send() -> None:
        for event in session.events:
            live.on_event(event)
        for frame in synthetic_frames(FRAMES):
            live.on_results(results_of([frame]), session)
        ended.wait()

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        ended.set()
        sender.join()


def pixels_near(picture: np.ndarray, colour: tuple[int, int, int], box: tuple[float, float, float, float]) -> int:
    """Pixels of a colour within a part of the picture (left, top, right, bottom as shares)."""
    height, width = picture.shape[:2]
    left, top, right, bottom = box
    part = picture[int(top * height) : int(bottom * height), int(left * width) : int(right * width)].astype(int)
    return int((np.abs(part - colour).sum(axis=2) < 60).sum())


GRAPHS = (0.0, 0.0, 0.5, 0.6)
PANORAMA = (0.505, 0.03, 0.79, 0.58)
SCATTER = (0.505, 0.6, 0.645, 0.97)
DRAWN = {
    "the lines of dRA* and dDE": (SKY_BLUE, GRAPHS, 150),
    "the limits": (VERMILLION, GRAPHS, 150),
    "the identified stars": (SKY_BLUE, PANORAMA, 50),
    "the planet and its name": (PINK, PANORAMA, 5),
    "the unidentified object": (ORANGE, PANORAMA, 0),
    "the points of the scatter": (SKY_BLUE, SCATTER, 10),
}
"""Colour, part of the picture, and what there are more pixels than."""


def missing_in_the_end(page) -> list[str]:
    """What is not drawn when all should be; a software renderer needs its time."""
    page.wait_for_selector("canvas.visible")
    until_s = time.monotonic() + 2 * PATIENCE_S
    missing = list(DRAWN)
    while missing and time.monotonic() < until_s:
        page.wait_for_timeout(1000)
        picture = np.array(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
        missing = [what for what, (colour, box, least) in DRAWN.items() if pixels_near(picture, colour, box) <= least]
    return missing


def test_the_live_page_draws_what_is_sent_and_no_request_leaves_the_machine(visit: Visits) -> None:
    live = LiveState(synthetic_night(1).station)
    view = live.add(LiveView(live, mode="web", catalog=small_catalog()))
    with view, sent_again_and_again(live), visit() as seen:
        seen.page.goto(view.url + "rerun")
        assert missing_in_the_end(seen.page) == []
        assert seen.hosts() == {"127.0.0.1"}
        assert any("/piece.rrd?" in url for url in seen.requests)


def test_a_saved_night_is_shown_by_the_same_page(visit: Visits, tmp_path: Path) -> None:
    session = synthetic_night(FRAMES)
    save_view(session, small_catalog(), tmp_path / "night.rrd", "PASS", ["all limits are kept"])
    with ViewServer("127.0.0.1", 0, Content(recording=tmp_path / "night.rrd")) as page, visit() as seen:
        seen.page.goto(page.url)
        assert missing_in_the_end(seen.page) == []
        assert seen.hosts() == {"127.0.0.1"}


def test_the_page_cannot_call_out_even_if_it_tries(visit: Visits) -> None:
    with ViewServer("127.0.0.1", 0, Content()) as page, visit() as seen:
        seen.page.goto(page.url + "rerun.js")
        seen.page.goto(page.url)
        blocked = seen.page.evaluate("fetch('http://localhost:1/').then(() => 'sent', e => String(e))")
        assert "sent" not in blocked
        assert any("Content Security Policy" in error for error in seen.errors)


def test_the_glance_page_works_through_a_tunnel_with_another_port(visit: Visits) -> None:
    session, notes = synthetic_night(20), Notes()
    live = LiveState(session.station)
    glance = Glance(live)
    for frame in synthetic_frames(20, trouble=False):
        live.on_results(results_of([frame]), session)
    content = Content(glance=glance, notes=notes)
    with ViewServer("0.0.0.0", 0, content) as server, Proxy(server.port) as tunnel, visit() as seen:
        seen.page.goto(f"http://localhost:{tunnel.port}/")
        seen.page.wait_for_selector("#axis-1")
        assert seen.page.inner_text("#word-text") not in ("", "CONNECTING")
        seen.page.fill("#note-text", "clouds from the west")
        seen.page.press("#note-text", "Enter")
        seen.page.wait_for_selector("#note-answer:has-text('noted: clouds from the west')")
        assert notes.take() == ["clouds from the west"]
        assert seen.errors == []


SIZES = {
    "small phone": (320, 640),
    "phone": (390, 844),
    "phone on its side": (844, 390),
    "tablet": (820, 1180),
    "laptop": (1280, 720),
    "wide": (1920, 1080),
}
THEMES = ("", "red,large")
CUT = """() => [...document.querySelectorAll('main *, footer *')].filter((node) => {
  const box = node.getBoundingClientRect(), style = getComputedStyle(node);
  if (!box.width || node.closest('#word, .uplot') || node.tagName === 'INPUT') return false;
  const isCut = node.clientWidth && style.display !== 'inline' && node.scrollWidth > node.clientWidth + 1;
  return isCut || box.right > innerWidth + 1;
}).map((node) => `${node.tagName}#${node.id} ${node.textContent.slice(0, 30)}`)"""
"""What is wider than its box or than the window; the word is scaled into its box."""


def least_contrast(page) -> float:
    """The least contrast of small text to the ground of its panel (WCAG 2.2), in the theme that the page has."""
    read = "(name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim()"
    light = {}
    for name in ("--panel", "--dim", "--limit", "--text"):
        code = page.evaluate(f"({read})('{name}')").lstrip("#")
        shares = np.array([int(code[place : place + 2], 16) / 255 for place in (0, 2, 4)])
        linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
        light[name] = 0.05 + float(linear @ (0.2126, 0.7152, 0.0722))
    return min(light[name] / light["--panel"] for name in ("--dim", "--limit", "--text"))


def test_the_glance_page_fits_its_window_in_each_size_and_theme_with_one_request(visit: Visits) -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    glance = Glance(live)
    for frame in synthetic_frames(20, trouble=False):
        live.on_results(results_of([frame]), session)
    with ViewServer("127.0.0.1", 0, Content(glance=glance)) as server, visit() as seen:
        for size, theme in itertools.product(SIZES.values(), THEMES):
            seen.page.goto("about:blank")
            seen.page.set_viewport_size({"width": size[0], "height": size[1]})
            seen.page.goto(f"{server.url}#{theme}")
            seen.page.wait_for_selector("#axis-1")
            place = seen.page.evaluate("document.getElementById('word-text').getBoundingClientRect().toJSON()")
            room = seen.page.evaluate("[document.documentElement.scrollWidth, document.body.className]")
            assert seen.page.inner_text("#word-text") not in ("", "CONNECTING")
            assert place["height"] >= size[1] / 10, (size, theme)
            assert place["right"] <= size[0], (size, theme)
            assert room == [size[0], ""], (size, theme)
            lines = "[...document.querySelectorAll('.figures')]"
            assert seen.page.evaluate(f"{lines}.filter((line) => line.scrollWidth > line.clientWidth).length") == 0
        assert least_contrast(seen.page) >= 3.5
        before_data = "document.body.className = 'empty'; [...document.querySelectorAll('main > *, footer')]"
        laid_out = seen.page.evaluate(f"{before_data}.filter((node) => node.offsetHeight).map((node) => node.id)")
        assert laid_out == ["head"], "the first paint waits for one word"
        assert {url for url in seen.requests if url.startswith("http")} == {server.url}
        assert seen.errors == []


LONG = {
    "frames": 358211,
    "frames_lost": 1234,
    "since_answer_s": 5999.0,
    "dawn_min": 1435,
    "clock": "NOT synchronised; host - sensor clock -12.345 s",
    "stars": {"seen": 113, "expected": 121, "objects": 140, "limiting_mag": 5.3},
    "port": "hwgrep://FTDI.*serial=A10000000000000000000000000000000000000000000000",
    "items": [["temperature_of_the_detector_degc", "21.57 degC", "red"]],
    "errors": None,
}
"""Facts of a long night that goes wrong; none of it is news of the errors."""


def test_long_figures_are_cut_in_no_size_and_theme(visit: Visits) -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    for frame in synthetic_frames(20, trouble=False, bias_arcsec=(-1234.5, 1234.5)):
        live.on_results(results_of([frame]), session)
    first = "document.body.className = 'empty'; at('word-text').style.transform = ''; put('word-text', 'CONNECTING');"
    with ViewServer("127.0.0.1", 0, Content(glance=Glance(live))) as server, visit() as seen:
        for size, theme in itertools.product(SIZES.values(), THEMES):
            seen.page.goto("about:blank")
            seen.page.set_viewport_size({"width": size[0], "height": size[1]})
            seen.page.goto(f"{server.url}#{theme}")
            seen.page.wait_for_selector("#axis-1")
            long = f"(() => {{ show({{...latest, ...{json.dumps(LONG)}}}); return ({CUT})(); }})()"
            assert seen.page.evaluate(long) == [], (size, theme)
            room = f"(() => {{ {first} return at('word').clientWidth - at('word-text').offsetWidth; }})()"
            assert seen.page.evaluate(room) >= 0, (size, theme)
        assert seen.errors == []


def test_a_bias_of_a_quarter_of_the_limit_is_far_from_zero_and_other_axes_are_one_click_away(visit: Visits) -> None:
    session = synthetic_night(20)
    limit = session.station.limits.d_ra_cosde_arcsec
    live = LiveState(session.station)
    glance = Glance(live)
    for frame in synthetic_frames(200, trouble=False, bias_arcsec=(limit / 4, 0.0)):
        live.on_results(results_of([frame]), session)
    live.on_event(LinkEvent(frame.panorama.utc_ns - 10**10, 0, StationKind.NOTE, "clouds from the west"))
    with ViewServer("127.0.0.1", 0, Content(glance=glance)) as server, visit() as seen:
        seen.page.set_viewport_size({"width": 1280, "height": 720})
        seen.page.goto(server.url)
        seen.page.wait_for_selector("#axis-1")
        share = "(u.valToPos(0, 'y') - u.valToPos(15, 'y')) / u.over.clientHeight"
        for which in ("close", "whole"):
            assert seen.page.evaluate(f"(() => {{ const u = plots[0].{which}; return {share}; }})()") > 0.4
        assert seen.page.evaluate("plots[0].close.data[5].at(-1)") == pytest.approx(15, abs=3)
        assert seen.page.evaluate("document.getElementById('plots').clientHeight") >= 360
        assert seen.page.evaluate("errors.marks.map((mark) => mark[3])") == ["clouds from the west"]
        seen.page.click("[data-view=roll]")
        seen.page.wait_for_selector("#axis-0 h2:has-text('roll (arcsec)')")
        assert seen.page.query_selector("#axis-1") is None
        seen.page.click("[data-view=across]")
        seen.page.wait_for_selector("#axis-1 h2:has-text('y (arcsec)')")
        assert seen.errors == []


def test_an_alarm_stands_on_the_page_until_somebody_has_seen_it(visit: Visits) -> None:
    session, notes = synthetic_night(20), Notes()
    live = LiveState(session.station)
    live.alarms = ("link: the port is gone",)
    with ViewServer("127.0.0.1", 0, Content(glance=Glance(live), notes=notes)) as server, visit() as seen:
        seen.page.goto(server.url)
        seen.page.wait_for_selector("#alarm-text:has-text('link: the port is gone')")
        seen.page.click("#alarm-seen")
        seen.page.wait_for_selector("#note-answer:has-text('noted: alarm seen: link: the port is gone')")
        (note,) = notes.take()
        live.on_event(LinkEvent(0, 0, StationKind.NOTE, note))
        seen.page.wait_for_selector("#alarms", state="hidden")
        assert seen.errors == []
