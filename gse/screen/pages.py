"""The pages of a screen on the web server of a view: what is shown, its script, and what both say to each other."""

import json
from importlib import resources
from typing import Any

from tornado.ioloop import PeriodicCallback
from tornado.websocket import WebSocketHandler

from drivers.clock import read_clock
from gse.screen.stage import UNKNOWN_MS, PageReport, Stage, sky_document
from gse.view.server import Content, Page

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
        self.finish(resources.files("gse.screen").joinpath(self.extra["name"]).read_text(encoding="utf-8"))


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
