"""Live view of a running session: the glance page, and rerun one click away.

Neither can delay the measurement: the page reads the live state, rerun takes results behind a queue that drops. The
glance page works where rerun is absent or has died.
"""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self

from drivers.chunk import LinkEvent
from gse.catalog import StarCatalog
from gse.errors import GseError
from gse.station.events import Notes
from gse.station.frame_results import FrameResults
from gse.view.glance import Glance
from gse.view.live_state import LiveState, SessionSoFar
from gse.view.server import USUAL_PORT, Content, ViewServer
from gse.view.viewer import check_rerun, open_native_viewer

if TYPE_CHECKING:
    from gse.view.rerun_feed import RerunFeed

_LOG = logging.getLogger(__name__)

ViewMode = Literal["web", "native", "none"]


class LiveView:
    """A view of a running session; a display of its ``live`` state, and a context manager.

    ``mode`` is ``web`` (pages at ``url``), ``native`` (rerun's own window), or ``none``: then only ``save_rrd`` is
    written. ``bind`` is the address of all servers, ``port`` that of the pages; 0 for the usual or another free one.
    ``notes`` takes the notes of the glance page; without it there are none.
    """

    def __init__(
        self,
        live: LiveState,
        *,
        mode: ViewMode = "web",
        save_rrd: Path | None = None,
        catalog: StarCatalog | None = None,
        bind: str = "127.0.0.1",
        port: int = 0,
        folder: Path | None = None,
        notes: Notes | None = None,
    ) -> None:
        self.url = self.token = ""
        self._glance = Glance(live, folder=folder)
        self._feed = _feed(live, mode, save_rrd, catalog, bind)
        self._server: ViewServer | None = None
        if mode == "web":
            self._serve(bind, port, notes)

    @property
    def rerun_url(self) -> str:
        """Of the page with rerun's view; empty without one."""
        return f"{self.url}rerun" if self.url and self._feed else ""

    @property
    def dropped(self) -> int:
        """Frames that are not in rerun because it was too slow."""
        return self._feed.dropped if self._feed else 0

    def _serve(self, bind: str, port: int, notes: Notes | None) -> None:
        content = Content(
            glance=self._glance,
            notes=notes,
            piece_after=self._feed.piece_after if self._feed else None,
        )
        try:
            self._server = ViewServer(bind, port, content, usual_port=USUAL_PORT)
        except GseError as error:
            _LOG.warning("no live view: %s; the session goes on", error)
            return
        self.url, self.token = self._server.url, self._server.token

    def on_results(self, results: FrameResults, so_far: SessionSoFar) -> None:
        """Show results; dropped where the view is too slow."""
        if self._feed:
            self._feed.on_results(results, so_far)

    def on_event(self, event: LinkEvent, so_far: SessionSoFar) -> None:
        """Show an event."""
        if self._feed:
            self._feed.on_event(event, so_far)

    def enter_judging(self) -> None:
        """Show that the session is closed and judged."""
        self._glance.enter_judging()
        if self._feed:
            self._feed.hurry()

    def conclude(self, verdict: str, reasons: Sequence[str]) -> None:
        """Show the verdict, as a report prints it, at the end."""
        self._glance.conclude(verdict, tuple(reasons))
        if self._feed:
            self._feed.conclude(verdict, reasons)

    def close(self) -> None:
        """Show pending items, for some seconds at most, and end."""
        if not self._glance.has_ended:
            self._glance.conclude("", ())
        if self._server:
            self._server.close()
        if self._feed:
            self._feed.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _feed(
    live: LiveState,
    mode: ViewMode,
    save_rrd: Path | None,
    catalog: StarCatalog | None,
    bind: str,
) -> "RerunFeed | None":
    """rerun's part of the view; None where it cannot be had, which a line says."""
    try:
        check_rerun()
        from gse.view.rerun_feed import RerunFeed

        feed = RerunFeed(
            live,
            serve=mode == "native",
            pages=mode == "web",
            save_rrd=save_rrd,
            catalog=catalog,
            bind=bind,
        )
    except (GseError, ImportError) as error:
        _LOG.warning("no view in rerun: %s; the session goes on", error)
        return None
    if mode == "native":
        try:
            open_native_viewer(f"rerun+http://{bind}:{feed.grpc_port}/proxy")
        except GseError as error:
            _LOG.warning("no window of rerun: %s; the session goes on", error)
    return feed
