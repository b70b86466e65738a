"""A screen as the sky before a sensor: the stage, which plans what stands on it, behind the page that draws it.

The page draws; the stage only plans. A change is planned some tenths of a second ahead, so that the page knows it in
time, and is recorded when it is planned: the session has it before any frame can show it. The page converts instants to
its browser's clock by the answers to its questions (as NTP does: the quickest answer of many is the best one), and
tells when it drew, and how well it knows the time. What it tells is an event: it was late, hidden, closed, of another
size; the stretch until it is well again is no sky.

One lock guards all; the server's thread and the loop's thread call in, and neither waits for the other.
"""

import json
import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Any

import numpy as np
from tornado.ioloop import PeriodicCallback
from tornado.websocket import WebSocketHandler

from drivers.clock import read_clock
from gse.config.station import Station
from gse.simulator.scenario import Scenario, SceneStep
from gse.simulator.scene import added_objects, false_magnitudes, false_places, scene_catalog
from gse.station.events import StationKind
from gse.values.attitude_convention import from_angles
from gse.values.instant import NS_PER_S
from gse.values.screen import Screen, Shown
from gse.view.server import Content, Page

AHEAD_NS = 500_000_000
"""A change is planned so long before it: the loop looks five times a second, and a page on this machine needs less."""
_SILENT_NS = 2 * NS_PER_S
"""A page that shows tells so twice a second; one that is silent for longer has gone, or its browser stopped it."""
_MOST_PICTURES = 3.5
"""Pictures that may be missed while a scene turns: at 0.5 deg/s and 60 Hz two of them are half a minute of arc."""
UNKNOWN_MS = 1000.0
"""How well the page's time is known before its first question was answered."""
_STAR_DIGITS = 7
"""Of a unit vector: 0.02 arcsec."""


@dataclass(slots=True)
class PageReport:
    """What the page reported last: its size in pixels of the panel, its state, and how well it knows the time."""

    width: int
    height: int
    ratio: float
    visible: bool
    round_trip_ms: float = UNKNOWN_MS
    gap_ms: float = 0.0
    """The longest time that a picture of a scene that turns stood since the report before."""
    heard_ns: int = 0

    def trouble(self, screen: Screen) -> str:
        """Why this page cannot show the screen of the station file; empty where it can."""
        if not self.visible:
            return "the page is hidden: bring its window to the front"
        if abs(self.ratio - 1) > 1e-6:
            return (
                f"the browser draws {self.ratio:g} pixels of the panel for one of its own: set its zoom to 100 % "
                "(Ctrl-0) and the display's scale to 100 %"
            )
        if (self.width, self.height) != (screen.columns, screen.rows):
            return (
                f"the page has {self.width} x {self.height} pixels, the station file says {screen.columns} x "
                f"{screen.rows}: show it full-screen (F11) on the right monitor"
            )
        if self.gap_ms > _MOST_PICTURES * 1000 / screen.refresh_hz:
            return (
                f"a picture of the scene that turns stood for {self.gap_ms:.0f} ms instead of "
                f"{1000 / screen.refresh_hz:.0f}: this computer is busy, or its graphics are too slow for the panel"
            )
        return ""


@dataclass(slots=True)
class Stage:
    """Plans the steps of a scene and keeps what the page tells; ``scenario`` None shows the still direction."""

    station: Station
    scenario: Scenario
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _page: PageReport | None = None
    _joined_ns: int = 0
    """When the page was opened."""
    _trouble: str = "no page is open"
    _from_ns: list[int] = field(default_factory=list)
    """When the page draws each step that is planned."""
    _shown: list[Shown] = field(default_factory=list)
    _news: list[Shown | tuple[str, str]] = field(default_factory=list)

    @property
    def screen(self) -> Screen:
        """The screen of the station."""
        assert self.station.screen is not None
        return self.station.screen

    @property
    def steps(self) -> tuple[SceneStep, ...]:
        """The scene; the still direction of the station file where it has no steps."""
        if self.scenario.scene.steps:
            return self.scenario.scene.steps
        still = self.station.mount.inertial
        assert still is not None
        return (SceneStep(ra_deg=still.ra_deg, de_deg=still.de_deg, roll_deg=still.roll_deg, for_s=86_400),)

    @property
    def is_over(self) -> bool:
        """Whether a scene with an end has been shown to its end."""
        with self._lock:
            if not self.scenario.scene.steps or len(self._from_ns) < len(self.steps):
                return False
            return read_clock().utc_ns >= self._from_ns[-1] + round(self.steps[-1].for_s * NS_PER_S)

    def take(self) -> list[Shown | tuple[str, str]]:
        """What was planned, and the events of the page (kind and text), since the last call; plans what is due."""
        now_ns = read_clock().utc_ns
        with self._lock:
            self._look(now_ns)
            self._plan(now_ns)
            taken, self._news = self._news, []
            return taken

    def hears(self, page: PageReport) -> None:
        """Take the report of the page."""
        page.heard_ns = read_clock().utc_ns
        with self._lock:
            if self._page is None:
                self._joined_ns = page.heard_ns
            self._page = page

    def leaves(self) -> None:
        """The page was closed."""
        with self._lock:
            self._page = None

    def drawn(self, step: int, late_ms: float) -> None:
        """The page drew a step so much after its instant: until then the one before stood, and no frame counts.

        A page that was opened while a step stood already is not late: the time without a page is left out by itself.
        """
        with self._lock:
            if not 0 <= step < len(self._shown) or late_ms <= self._shown[step].within_ms:
                return
            if self._from_ns[step] < self._joined_ns:
                return
            text = f"the page drew {late_ms:.0f} ms late: this computer is busy, or the browser is"
            self._news.append((StationKind.SCREEN_LATE, text))
            self._shown[step] = replace(self._shown[step], within_ms=round(late_ms + self._within_ms(), 3))
            self._news.append(self._shown[step])

    def planned(self, known: int) -> list[dict[str, Any]]:
        """The steps that are planned beyond the first ``known`` ones, as the page needs them."""
        with self._lock:
            begins = list(enumerate(self._from_ns))[known:]
        return [{"step": step, "from_ms": from_ns / 1e6, **_drawable(self, step)} for step, from_ns in begins]

    def _within_ms(self) -> float:
        """How well the instant of a change is known: half a picture, the page's time, the panel's latency."""
        page_ms = self._page.round_trip_ms / 2 if self._page is not None else UNKNOWN_MS
        return math.hypot(500 / self.screen.refresh_hz, page_ms, self.screen.latency_uncertainty_ms)

    def _look(self, now_ns: int) -> None:
        """Tell where the page begins or ceases to show the screen."""
        page = self._page
        if page is None:
            trouble = "no page is open: open it on the monitor before the sensor"
        elif now_ns - page.heard_ns > _SILENT_NS:
            trouble = "the page is silent: its browser stopped it, or its window is hidden"
        else:
            trouble = page.trouble(self.screen)
        if trouble == self._trouble:
            return
        lost, self._trouble = bool(trouble), trouble
        kind = StationKind.SCREEN_LOST if lost else StationKind.SCREEN_SHOWS
        self._news.append((kind, trouble or "the page shows the scene"))

    def _plan(self, now_ns: int) -> None:
        if not self._from_ns:
            # Not before the page's clock is compared: without that the change could not be placed in time.
            if not self._trouble and self._page is not None and self._page.round_trip_ms < UNKNOWN_MS:
                self._begin(now_ns + AHEAD_NS)
            return
        ends_ns = self._from_ns[-1] + round(self.steps[len(self._from_ns) - 1].for_s * NS_PER_S)
        if len(self._from_ns) < len(self.steps) and now_ns > ends_ns - AHEAD_NS:
            self._begin(ends_ns)

    def _begin(self, from_ns: int) -> None:
        """Plan the next step from an instant on."""
        shown, latency_ns = self.steps[len(self._from_ns)], round(self.screen.latency_ms * 1e6)
        self._from_ns.append(from_ns)
        angles = shown.ra_deg, shown.de_deg, shown.roll_deg
        within_ms = round(self._within_ms(), 3)
        self._shown.append(Shown(from_ns + latency_ns, *angles, shown.turn_deg_per_s, within_ms))
        self._news.append(self._shown[-1])


def _drawable(stage: Stage, step: int) -> dict[str, Any]:
    """Numbers of a step as the page needs them: axes of the screen in ICRS, rates, stars with magnitudes, spots."""
    shown, screen, scene = stage.steps[step], stage.screen, stage.scenario.scene
    axes = from_angles(*(np.array([angle]) for angle in (shown.ra_deg, shown.de_deg, shown.roll_deg)))[0]
    spots = np.column_stack([false_places(scene, step, screen.columns, screen.rows), false_magnitudes(scene)])
    return {
        "axes": np.round(axes, 12).tolist(),
        "turn_rad_per_s": np.radians(shown.turn_deg_per_s).tolist(),
        "spots": np.round(spots, 3).tolist(),
    }


def sky_document(stage: Stage) -> dict[str, Any]:
    """What stays the same for all steps: the screen, and the stars of the whole sky that it can show."""
    screen, scene = stage.screen, stage.scenario.scene
    camera = screen.camera()
    catalog = scene_catalog(scene, read_clock().utc_ns, screen.magnitude_limit)
    added, magnitudes = added_objects(scene)
    stars = np.column_stack([np.concatenate([catalog.icrs, added]), np.concatenate([catalog.magnitude, magnitudes])])
    sizes = [math.radians(item.diameter_deg) * camera.focal_length_px for item in scene.objects]
    return {
        "columns": screen.columns,
        "rows": screen.rows,
        "focal_px": camera.focal_length_px,
        "radial": screen.radial_distortion,
        "tangential": screen.tangential_distortion,
        "gamma": screen.gamma,
        "spot_px": screen.spot_px,
        "faintest": screen.magnitude_limit,
        "brightest": screen.brightest_magnitude,
        "refresh_hz": screen.refresh_hz,
        "discs": list(_discs(sizes, len(catalog))),
        "stars": np.round(stars, _STAR_DIGITS).ravel().tolist(),
    }


def _discs(sizes_px: list[float], first: int) -> Iterator[tuple[int, float]]:
    """The rows of the stars that are discs, with their diameters."""
    return ((first + k, round(size, 2)) for k, size in enumerate(sizes_px) if size > 0)


# The pages of a screen on the web server of a view: what is shown, its script, and what both say to each other.

_EVERY_MS = 50
"""Between two looks for what is planned."""
_MOST_PX, _MOST_RATIO, _MOST_MS = 1 << 16, 100.0, 1e6
"""Larger numbers come from no browser."""


def screen_content(stage: Stage) -> Content:
    """What a server shows for a stage: the page of the screen, at / and at /screen."""
    page = {"name": "screen.html", "media_type": "text/html; charset=utf-8"}
    script = {"name": "screen.js", "media_type": "text/javascript; charset=utf-8"}
    only = {"stage": stage, "open": []}
    pages = (
        ("/", _File, page),
        ("/screen", _File, page),
        ("/screen.js", _File, script),
        ("/screen/live", _LiveScreen, only),
    )
    return Content(pages=pages)


class _File(Page):
    """A file of the page."""

    def get(self) -> None:
        self.set_header("Content-Type", self.extra["media_type"])
        self.finish(resources.files("gse.sessions").joinpath(self.extra["name"]).read_text(encoding="utf-8"))


class _LiveScreen(Page, WebSocketHandler):
    """The page at work: it asks the time and reports, and is told what is planned. One page at a time."""

    def open(self, *args: str, **kwargs: str) -> None:
        self._stage: Stage = self.extra["stage"]
        self._known = 0
        self._push: PeriodicCallback | None = None
        if self.extra["open"]:
            self.close(1013, "another page shows the screen already: close this one")
            return
        self.extra["open"].append(self)
        self.set_nodelay(True)
        self.write_message(json.dumps({"sky": sky_document(self._stage)}))
        self._push = PeriodicCallback(self._tell, _EVERY_MS)
        self._push.start()

    def on_message(self, message: str | bytes) -> None:
        if self._push is None:
            return
        try:
            told = json.loads(message)
            if "drawn" in told:
                self._stage.drawn(int(told["drawn"]), _number(told["late_ms"], _MOST_MS))
                return
            self._stage.hears(_report(told))
            self.write_message({"asked": _number(told["asked"], 1e12), "now_ms": read_clock().utc_ns / 1e6})
        except (ValueError, KeyError, TypeError, RecursionError):
            self.close(1007, "that is no report of the page")

    def on_close(self) -> None:
        if self._push is not None:
            self._push.stop()
            self.extra["open"].remove(self)
            self._stage.leaves()

    def _tell(self) -> None:
        scenes = self._stage.planned(self._known)
        if scenes:
            self._known += len(scenes)
            self.write_message(json.dumps({"scenes": scenes}))


def _report(told: dict[str, Any]) -> PageReport:
    trip_ms = UNKNOWN_MS if told["round_trip_ms"] is None else _number(told["round_trip_ms"], _MOST_MS)
    width, height = (round(_number(told[name], _MOST_PX)) for name in ("width", "height"))
    ratio, gap_ms = _number(told["ratio"], _MOST_RATIO), _number(told["gap_ms"], _MOST_MS)
    return PageReport(width, height, ratio, told["visible"] is True, trip_ms, min(max(gap_ms, 0.0), _MOST_MS))


def _number(value: Any, most: float) -> float:
    if not abs(float(value)) <= most:
        raise ValueError
    return float(value)
