"""Saved view of a session in rerun: the scene of the live view, complete and with the verdict."""

from collections.abc import Sequence
from pathlib import Path

import rerun as rr

from drivers.chunk import LinkEvent
from gse.catalog import StarCatalog
from gse.config.station import Station
from gse.errors import UsageError
from gse.station.frame_results import NewResults
from gse.station.results import FrameResult
from gse.station.session_data import SessionData
from gse.view.glance_word import bare_verdict
from gse.view.own_answers import OwnAnswerErrors
from gse.view.scene import Scene
from gse.view.verdict_text import verdict_at_end, verdict_so_far

BATCH_FRAMES = 1000
"""Frames that go to rerun at once; nothing is dropped."""


class SavedView:
    """A listener that writes every frame of a session to a recording for rerun (.rrd).

    ``finish`` ends it. UsageError where the file cannot be written.
    """

    def __init__(self, station: Station, catalog: StarCatalog | None, path: Path) -> None:
        self._path = path
        self._stream = rr.RecordingStream("gse", send_properties=False)
        self._stream.set_sinks(rrd_file_sink(path))
        self._scene = Scene(self._stream, station, catalog, live=False)
        self._own = OwnAnswerErrors(station)
        self._frames: list[FrameResult] = []

    def on_results(self, results: NewResults, session: SessionData) -> None:
        """Add frames."""
        for result in results:
            self._own.take(result, session)
            self._frames.append(result)
        if len(self._frames) >= BATCH_FRAMES:
            self._send_objects()

    def on_event(self, event: LinkEvent) -> None:
        """Add an event."""
        self._scene.running.add_event(event)
        self._scene.event(event)

    def finish(self, session: SessionData, verdict: str, reasons: Sequence[str], *, metrics: str = "") -> None:
        """Write the columns of the session, the clock and the verdict, and close the file.

        ``session`` has the same frames that were added; ``metrics`` is a table in Markdown. UsageError where the disk
        did not take all of it: then no file is left.
        """
        try:
            self._finish(session, verdict, reasons, metrics)
        except RuntimeError as error:  # rerun's only one
            self._path.unlink(missing_ok=True)
            raise UsageError(f"cannot write {self._path}: {error}; is the disk full?") from error

    def _finish(self, session: SessionData, verdict: str, reasons: Sequence[str], metrics: str) -> None:
        self._send_objects()
        if len(session.frames):
            rows = session.frames.columns.rows()
            self._scene.add_columns(rows)
            self._scene.add_residuals(rows, session.frames.matches)
        self._scene.flush()
        self._scene.clock(session.clock)
        clock = session.clock[-1] if session.clock else None
        text = verdict_so_far(self._scene.running, session.link, clock, clock_error_s=session.clock_error_s)
        self._scene.words_for_all_times(verdict_at_end(verdict, list(reasons), text), metrics)
        if len(session.frames):
            self._scene.stands(int(session.frames.columns["utc_ns"][0]), bare_verdict(verdict))
        self._stream.flush()
        self._stream.disconnect()

    def _send_objects(self) -> None:
        self._scene.add_own_answers(self._own.errors())
        if self._frames:
            self._scene.add_objects(self._frames, pictures=len(self._frames))
            self._frames = []
        self._scene.show_log()


def rrd_file_sink(path: Path) -> object:
    """A sink of rerun that writes a new file; UsageError where it cannot be written (rerun itself only prints it)."""
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        raise UsageError(f"{path} exists already; choose another name") from None
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
    return rr.FileSink(str(path))
