"""When a running session will have its verdict.

``judge`` asks the whole session and takes a third of a second after an hour, so a thread of its own asks it of a
snapshot, made by the loop in a millisecond. Between two questions the thread pauses a hundred times as long as the last
one took: one per cent of one processor at most, however long the session is.
"""

import copy
import math
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from drivers.chunk import LinkEvent
from gse.process.release_memory import trim
from gse.station.frame_columns import FrameColumns
from gse.station.frame_results import FrameResults
from gse.station.results import Verdict
from gse.station.session_data import SessionData
from gse.view.live_state import LiveState

if TYPE_CHECKING:
    from gse.verdict.assessment import Assessment

EVERY_S = 10.0
_PAUSES = 100.0
_FEWEST_FRAMES = 30
_SETTLES_S = 300.0
"""Before, the drift of the mount is so little known that its uncertainty alone may exceed a limit."""
_NIGHT_MINUTES = 720.0
"""A verdict that comes later comes not in this session."""
_SET_UP = "set-up: "
"""What a reason begins with that a longer session does not change."""
_MOST_NAMED = 2


class Forecast:
    """A listener that finds how long a session still has to be, and its metrics (ECSS-E-ST-60-20C) so far.

    Both go into the ``live`` state, for its displays.

    ``fill_sky`` fills the sky columns of a snapshot's frames (rows of FRAME), which the loop itself does at the end.
    """

    def __init__(self, live: LiveState, fill_sky: Callable[[FrameColumns], None] = lambda frames: None) -> None:
        self._live, self._fill_sky = live, fill_sky
        self._begun = threading.Event()
        self._wanted = threading.Event()
        self._wanted.set()
        self._closing = threading.Event()
        self._snapshots: queue.SimpleQueue[SessionData | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="forecast", daemon=True)
        self._thread.start()

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Hand a snapshot to the thread where it wants one."""
        self._begun.set()
        if self._wanted.is_set() and len(session.frames) >= _FEWEST_FRAMES:
            self._wanted.clear()
            taken = snapshot(session)
            self._fill_sky(taken.frames.columns)
            self._snapshots.put(taken)

    def on_event(self, event: LinkEvent) -> None:
        """Events are in the snapshots."""

    def close(self) -> None:
        """End the thread; it does not ask again."""
        self._closing.set()
        self._snapshots.put(None)
        self._begun.set()

    def _run(self) -> None:
        self._begun.wait()  # the first frame is shown before all that judges is imported
        if self._closing.is_set():
            return
        from gse.report.metric_table import metrics_in_markdown
        from gse.verdict.assessment import judge

        while (session := self._snapshots.get()) is not None:
            began_s = time.thread_time()
            with suppress(Exception):  # a forecast that fails must not end the session; the verdict will say why
                assessment = judge(session)
                self._live.forecast = forecast_text(assessment)
                self._live.names = assessment.statistics.names
                self._live.metrics = metrics_in_markdown(assessment.statistics)
            trim()  # all threads allocate in heaps of their own, whose holes grew by 4 MiB a minute
            if self._closing.wait(max(EVERY_S, _PAUSES * (time.thread_time() - began_s))):
                return
            self._wanted.set()


def snapshot(session: SessionData) -> SessionData:
    """The session so far, which later results and events do not change."""
    return replace(
        session,
        frames=session.frames.snapshot(),
        link=replace(session.link, discarded_bytes_by_reason=dict(session.link.discarded_bytes_by_reason)),
        events=list(session.events),
        clock=list(session.clock),
        statuses=list(session.statuses),
        sensor_attitudes=copy.copy(session.sensor_attitudes),
        star_names=session.star_names.snapshot(),
        external_counts=copy.deepcopy(session.external_counts),
        shown=replace(session.shown, shown=list(session.shown.shown)),
    )


def forecast_text(assessment: "Assessment") -> str:
    """When a verdict is to be expected, in a line."""
    from gse.statistics.decision import Claim
    from gse.verdict.session_plan import lacks_sky, minutes_left, rows_left

    if assessment.verdict is not Verdict.INCONCLUSIVE:
        return f"{assessment.word}, if it ended now"
    if assessment.reasons and assessment.reasons[0].startswith(_SET_UP):
        return f"no verdict as it goes: {': '.join(assessment.reasons[0].split(': ')[:2])}"
    if lacking := lacks_sky(assessment):
        return f"no verdict as it goes: {lacking}"
    left = rows_left(assessment)
    if not any(item.requirement.claim is Claim.ACCURACY for item in left):
        return "no verdict as it goes: no answer was compared with truth"
    minutes = minutes_left(assessment)
    if math.isnan(minutes):
        return "verdict: too early to tell"
    if minutes > _NIGHT_MINUTES and assessment.statistics.duration_s < _SETTLES_S:
        return "verdict: too early to tell"
    if minutes > _NIGHT_MINUTES:
        never = [item.row.name for item in left if item.minutes > _NIGHT_MINUTES]
        return f"no verdict as it goes: {', '.join(never[:_MOST_NAMED]) or assessment.reasons[0]}"
    if minutes < 1:
        return "a verdict in less than a minute"
    return f"a verdict in {minutes:.0f} more minutes" if minutes >= 1.5 else "a verdict in one more minute"
