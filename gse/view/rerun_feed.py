"""Running session in rerun, fed by a separate thread behind a bounded queue.

The feed cannot delay the measurement: ``on_results`` puts a frame on a bounded queue or counts it as dropped.

A page asks for a piece (``piece_after``) when its viewer has shown the one before. So a slow viewer gets longer
pieces, each up to the newest data, and a late one begins with the last ten minutes in one piece. A window of rerun's
own fetches its data from a server in this process; an absent, frozen or killed one delays nothing. (A client connection
to a viewer does block, after some 36,000 frames.)
"""

import logging
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import rerun as rr

from drivers.chunk import LinkEvent
from gse.catalog import StarCatalog
from gse.station.frame_results import FrameResult, FrameResults
from gse.values.instant import NS_PER_S
from gse.view.glance_word import bare_verdict
from gse.view.live_state import LiveState, SessionSoFar
from gse.view.saved_view import rrd_file_sink
from gse.view.scene import Scene
from gse.view.verdict_text import standing, verdict_at_end, verdict_so_far
from gse.view.viewer import NextPiece, free_port

_LOG = logging.getLogger(__name__)

QUEUE_FRAMES = 2000
"""Three minutes at 10 Hz; some 10 MB."""

BATCH_FRAMES = 250
BATCH_EVERY_S = 1.0
"""Frames go to rerun in batches, because a viewer takes its time for each batch, not for each frame."""

_VERDICT_WITHIN_S = 3.0
"""How long the last piece waits for the verdict."""

MEMORY_LIMIT = "1MB"
"""Data that rerun's server keeps for a window of rerun's own that opens late, some seconds."""

_CLOSE_WITHIN_S = 9.0


@dataclass(frozen=True, slots=True)
class _Shown:
    """A result, with the state after all that came with it; ``is_first`` of these."""

    frame: FrameResult
    so_far: SessionSoFar
    is_first: bool


@dataclass(frozen=True, slots=True)
class _Happened:
    event: LinkEvent
    so_far: SessionSoFar


@dataclass(frozen=True, slots=True)
class _Concluded:
    verdict: str
    reasons: tuple[str, ...]


_Item = _Shown | _Happened | _Concluded


class RerunFeed:
    """rerun's recording of a running session; a display of its ``live`` state, and a context manager.

    With ``serve`` a window of rerun's own gets the data from rerun's server on ``grpc_port`` of ``bind``; with
    ``pages`` somebody asks for pieces. UsageError where it cannot listen there, or ``save_rrd`` cannot be written.
    """

    def __init__(
        self,
        live: LiveState,
        *,
        serve: bool = True,
        save_rrd: Path | None = None,
        catalog: StarCatalog | None = None,
        bind: str = "127.0.0.1",
        queue_frames: int = QUEUE_FRAMES,
        pages: bool = False,
    ) -> None:
        self.grpc_port = free_port(bind) if serve else 0
        self._given = 0
        self._taken = 0
        self._concluded = threading.Event()
        self._queue: deque[_Item] = deque(maxlen=queue_frames)
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._scene: Scene | None = None
        self._every_picture = not (serve or pages)
        self._awake = threading.Event()
        self._stream = rr.RecordingStream("gse", send_properties=False)
        sinks: list[object] = [] if save_rrd is None else [rrd_file_sink(save_rrd)]
        if serve:
            sinks.append(_server(bind, self.grpc_port))
        self._stream.set_sinks(*sinks)
        self._thread = threading.Thread(target=self._run, args=(live, catalog), name="live view", daemon=True)
        self._thread.start()

    def on_results(self, results: FrameResults, so_far: SessionSoFar) -> None:
        """Show results; a full queue drops its oldest item."""
        for number, result in enumerate(results):
            self._put(_Shown(result, so_far, is_first=number == 0))

    def on_event(self, event: LinkEvent, so_far: SessionSoFar) -> None:
        """Show an event of the link."""
        self._put(_Happened(event, so_far))

    def hurry(self) -> None:
        """Show the last, incomplete batch at once: the session has ended."""
        self._awake.set()

    def piece_after(self, place: str, *, last: bool = False) -> NextPiece:
        """What a page does not have yet, after the place that its last piece stated (none: empty).

        The ``last`` piece has the verdict, unless that does not come within seconds.
        """
        if last:
            self._concluded.wait(_VERDICT_WITHIN_S)
        with self._lock:
            return self._scene.piece_after(place) if self._scene else NextPiece()

    def conclude(self, verdict: str, reasons: Sequence[str]) -> None:
        """Show the verdict, as a report prints it, at the end."""
        self._put(_Concluded(verdict, tuple(reasons)))
        self.hurry()

    def _put(self, item: _Item) -> None:
        # A deque drops its oldest item by itself, and has no lock that the loop could wait for.
        self._queue.append(item)
        self._given += 1

    @property
    def dropped(self) -> int:
        """Items that the queue had no room for: neither taken nor waiting. Exact while no other thread is at work."""
        return max(0, self._given - self._taken - len(self._queue))

    def close(self) -> None:
        """Show the queued items, for at most some seconds, and end."""
        self._closing.set()
        self._awake.set()
        self._thread.join(_CLOSE_WITHIN_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self, live: LiveState, catalog: StarCatalog | None) -> None:
        try:
            self._feed(live, catalog)
        except Exception as error:
            # An error in the view must not end the session.
            _LOG.warning("the live view has ended (%s: %s); the session goes on", type(error).__name__, error)

    def _feed(self, live: LiveState, catalog: StarCatalog | None) -> None:
        scene = Scene(self._stream, live.station, catalog, live=True)
        self._scene = scene
        feed = _SceneFeed(scene, live, every_picture=self._every_picture)
        while True:
            last = self._closing.is_set()
            while batch := self._take():
                with self._lock:
                    feed.add(batch, self.dropped)
                if any(isinstance(item, _Concluded) for item in batch):
                    self._concluded.set()
            if last:
                break
            self._awake.wait(BATCH_EVERY_S)
            self._awake.clear()
        with self._lock:
            feed.finish()
        self._stream.flush()
        self._stream.disconnect()

    def _take(self) -> list[_Item]:
        batch: list[_Item] = []
        while self._queue and len(batch) < BATCH_FRAMES:
            batch.append(self._queue.popleft())
            self._taken += 1
        return batch


def _server(bind: str, port: int) -> object:
    """rerun's data server, for pages of this machine, or of the address to which it is bound."""
    pages = [] if bind == "127.0.0.1" else ["http://*"]
    return rr.GrpcServerSink(bind, port, server_memory_limit=MEMORY_LIMIT, newest_first=True, cors_allow_origin=pages)


class _SceneFeed:
    """Adds queued items to a scene, in order."""

    def __init__(self, scene: Scene, live: LiveState, *, every_picture: bool) -> None:
        self._scene = scene
        self._live = live
        self._every_picture = every_picture
        self._dropped = 0
        self._panel_utc_ns = 0

    def add(self, batch: Sequence[_Item], dropped: int) -> None:
        states = [item.so_far for item in batch if not isinstance(item, _Concluded)]
        self._scene.so_far = so_far = states[-1] if states else self._scene.so_far
        frames = [item.frame for item in batch if isinstance(item, _Shown)]
        news = [item.so_far for item in batch if isinstance(item, _Shown) and item.is_first]
        if own_errors := [one.own_errors for one in news if len(one.own_errors)]:
            self._scene.add_own_answers(np.concatenate(own_errors))
        if frames:
            self._scene.add(frames, pictures=len(frames) if self._every_picture else 1)
        for item in batch:
            if isinstance(item, _Happened):
                self._scene.event(item.event)
            elif isinstance(item, _Concluded):
                self._conclude(item)
        self._scene.show_log()
        self._scene.clock([reading for one in news for reading in one.readings])
        self._dropped = dropped
        if so_far.utc_ns - self._panel_utc_ns >= NS_PER_S:
            self._panel_utc_ns = so_far.utc_ns
            self._scene.words(so_far.utc_ns, self._so_far(), self._live.metrics)
            self._scene.stands(so_far.utc_ns, standing(so_far))
            self._scene.add_latest_items(self._live.housekeeping)

    def _so_far(self) -> str:
        return verdict_so_far(self._scene.so_far, dropped=self._dropped)

    def _conclude(self, item: _Concluded) -> None:
        text = verdict_at_end(item.verdict, list(item.reasons), self._so_far())
        self._panel_utc_ns = 1 << 62
        self._scene.words(self._scene.so_far.utc_ns, text, self._live.metrics)
        self._scene.stands(self._scene.so_far.utc_ns, bare_verdict(item.verdict))

    def finish(self) -> None:
        self._scene.add_latest_items(self._live.housekeeping)
        self._scene.flush()
