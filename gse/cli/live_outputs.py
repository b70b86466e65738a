"""Outputs of a running session: live view, status line, frames as JSON lines."""

import contextlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import click

from drivers.chunk import LinkEvent
from drivers.ports import is_mock
from gse.cli.options import (
    LOOPBACK,
    bind_option,
    gathered,
    http_port_option,
    json_frames_option,
    save_rrd_option,
    view_option,
)
from gse.diagnosis.diagnosis import LiveDiagnosis
from gse.errors import UsageError
from gse.recording.session_format import RecorderKind
from gse.sessions.forecast import Forecast, snapshot
from gse.station.events import Notes
from gse.station.frame_results import FrameResults, frame_json
from gse.station.loop import Listener, StationLoop
from gse.station.session_data import SessionData
from gse.view.live_state import LiveState
from gse.view.status import StatusLine

if TYPE_CHECKING:
    from gse.view.live import LiveView

_LOOPBACK = ("127.0.0.1", "localhost")
ViewMode = Literal["web", "native", "none"]


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """How a session is shown while it runs."""

    view: ViewMode
    bind: str
    http_port: int
    save_rrd: Path | None
    json_frames: bool

    def __post_init__(self) -> None:
        if self.view != "web" and (self.http_port or self.bind != LOOPBACK):
            raise UsageError("--http-port and --bind are for the web pages: add --view web")


live_options = gathered(
    "live", LiveOptions, view_option, bind_option, http_port_option, save_rrd_option, json_frames_option
)


class JsonFrames:
    """Each frame as one line of JSON on stdout."""

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Print the frames."""
        for result in results:
            click.echo(json.dumps(frame_json(result)))

    def on_event(self, event: LinkEvent) -> None:
        """Events are not frames."""


class _WorkingFolder:
    """Goes back to the working folder where somebody deleted it and the recorder made it anew."""

    def __init__(self) -> None:
        self._folder = os.getcwd()

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """They are not written here."""

    def on_event(self, event: LinkEvent) -> None:
        """Follow the session file that was restored."""
        if event.kind == RecorderKind.FILE_RESTORED:
            with contextlib.suppress(OSError):
                os.chdir(self._folder)


class LiveOutputs:
    """The listeners of a session, opened after the setup and closed with the session.

    ``diagnose`` announces findings while the session runs, and when its verdict is to be expected. ``progress`` gives
    the words on a replay of which so many bytes were replayed; ``quiet`` shows nothing else of it on stderr.
    """

    def __init__(
        self,
        options: LiveOptions,
        *,
        diagnose: bool = True,
        notes: Notes | None = None,
        progress: Callable[[int], str] = lambda replayed_bytes: "",
        quiet: bool = False,
    ) -> None:
        self._quiet = quiet
        self._progress = progress
        self._options = options
        self._notes = notes
        self._diagnose = diagnose
        self._live: LiveView | None = None
        self._forecast: Forecast | None = None
        self._status: StatusLine | None = None

    def listeners(self, loop: StationLoop, folder: Path | None, live: LiveState) -> Sequence[Listener]:
        """The requested listeners and the ``live`` state, which the status line and the requested view show."""
        listeners: list[Listener] = [JsonFrames()] if self._options.json_frames else []
        if self._diagnose or self._options.view != "none":  # the verdict itself comes sooner than its forecast
            self._forecast = Forecast(live, loop.sky.fill)
            listeners.append(self._forecast)
        listeners.append(live)
        self._open_status(loop, folder, live)
        if self._options.view != "none" or self._options.save_rrd is not None:
            self._open_view(loop, folder, live)
        if not self._diagnose:
            return listeners
        # Simulated and recorded data wait for a look: then it comes at the same place each time.
        beside = None if is_mock(loop.setup.station.port.url) else snapshot
        return [*listeners, _WorkingFolder(), _live_diagnosis(listeners, beside)]

    def ask(self, question: str) -> None:
        """Show a question to the operator; empty when it is answered."""
        if self._status is not None:
            self._status.ask(question)

    def enter_judging(self) -> None:
        """Show that the session is closed and judged."""
        if self._forecast is not None:
            self._forecast.close()
        if self._live is not None:
            self._live.enter_judging()

    def conclude(self, report: dict[str, Any]) -> None:
        """Show the verdict in the view."""
        if self._status is not None:
            self._status.close()
        if self._live is not None:
            from gse.report.conclusion import explained

            self._live.conclude(report["conclusion"]["headline"], explained(report["conclusion"]))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._forecast is not None:
            self._forecast.close()
        if self._status is not None:
            self._status.close()
        if self._live is not None:
            self._live.close()

    def _open_status(self, loop: StationLoop, folder: Path | None, live: LiveState) -> None:
        if self._options.view == "none" and not self._quiet:
            click.echo("to see it live: --view web", err=True)
        link = loop.session.link
        status = StatusLine(live, folder, progress=lambda: self._progress(link.bytes_in), quiet=self._quiet)
        status.__enter__()
        self._status = live.add(status)

    def _open_view(self, loop: StationLoop, folder: Path | None, live: LiveState) -> None:
        from gse.view.live import LiveView

        view = LiveView(
            live,
            mode=self._options.view,
            save_rrd=self._options.save_rrd,
            catalog=loop.setup.identifier.catalog,
            bind=self._options.bind,
            port=self._options.http_port,
            folder=folder,
            notes=self._notes,
        )
        if view.url:
            in_rerun = f" (rerun: {view.rerun_url})" if view.rerun_url else ""
            click.echo(f"live page: {view.url}{in_rerun}", err=True)
        if view.url and self._options.bind not in _LOOPBACK and self._notes is not None:
            click.echo(f"notes from other machines: {view.url}#token={view.token}", err=True)
        live.page = view.url or None
        self._live = live.add(view)


def _live_diagnosis(listeners: Sequence[Listener], snapshot: Callable[[SessionData], SessionData] | None) -> Listener:
    """Findings go to the other listeners, not into the session."""

    def announce(event: LinkEvent) -> None:
        for listener in listeners:
            listener.on_event(event)

    return LiveDiagnosis(announce, snapshot)
