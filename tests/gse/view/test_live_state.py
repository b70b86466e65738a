"""The one state of a running session: what its displays read is the same, and never changes under them."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from skies.one_by_one import results_of
from skies.synthetic_night import synthetic_frames, synthetic_night

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading, read_clock
from gse.sessions.replay import replay_session
from gse.sessions.status_file import StatusFile
from gse.station.events import Notes, StationKind
from gse.station.results import Status
from gse.values.instant import NS_PER_S
from gse.view.glance import Glance
from gse.view.live_state import STATE_EVERY_NS, LiveState
from gse.view.status import StatusLine
from gse.view.verdict_text import headline, verdict_so_far

OWN_ANSWERS = Path(__file__).parents[3] / "replays" / "golden" / "own-answers.mcap"
NOW = ClockReading(0, 0, "kernel PLL", True, 0.0, 0.01)


class States:
    """A display that keeps each state, and the time of the last result that came with it."""

    def __init__(self) -> None:
        self.states = []
        self.last_ns = []

    def on_results(self, results, so_far) -> None:
        self.states.append(so_far)
        self.last_ns.append(results[-1].panorama.utc_ns)

    def on_event(self, event, so_far) -> None:
        self.states.append(so_far)


def test_a_state_that_was_read_stays_as_it_was_while_more_comes() -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    kept = live.add(States())
    shown = []
    for number, frame in enumerate(synthetic_frames(60)):
        live.on_event(LinkEvent(0, 0, LinkKind.STREAMING, f"event {number}"))
        live.on_results(results_of([frame]), session)
        session.link.frames_lost += 1
        shown += [verdict_so_far(state) + str(state.events) for state in kept.states[-2:]]
    assert [verdict_so_far(state) + str(state.events) for state in kept.states] == shown
    assert len(set(shown)) == 2 * 60


def test_a_long_batch_is_cut_so_that_no_state_is_far_behind() -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    kept = live.add(States())
    live.on_results(results_of(list(synthetic_frames(301, trouble=False))), session)
    assert [state.frames for state in kept.states] == [1, 101, 201, 301]
    assert np.diff(kept.last_ns).max() <= STATE_EVERY_NS + NS_PER_S // 10
    assert [state.utc_ns for state in kept.states] == kept.last_ns


def test_a_camera_that_is_not_as_stated_is_not_called_a_sky_without_stars() -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    glance = Glance(live)
    unidentified = {"status": Status.TOO_FEW, "attitude": None, "attitude_error": None}
    frames = [replace(frame, **unidentified) for frame in synthetic_frames(201, trouble=False)]
    live.on_results(results_of(frames), session)
    live.on_event(LinkEvent(0, 0, StationKind.NO_STARS, "30 objects, and none is identified"))
    assert live.so_far.silence.startswith("NO STARS for 20 s")
    live.on_event(LinkEvent(0, 0, StationKind.FINDING, "mirrored image: the image is mirrored"))
    assert live.so_far.silence.startswith("NO ANSWER for 20 s")
    assert "no stars" not in str(StatusLine(live, console=Console(width=132, force_terminal=True)).line())
    now = ClockReading(live.so_far.utc_ns, 0, "kernel PLL", True, 0.0, 0.01)
    glance.absorb(now)
    word = glance.document(now)["word"]
    assert word["text"].startswith("NO ANSWER")
    assert "the image is mirrored" in word["detail"]


def test_what_came_with_the_results_is_in_one_state_only() -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    kept = live.add(States())
    live.on_results(results_of(list(synthetic_frames(150, trouble=False))), session)
    live.on_event(LinkEvent(0, 0, StationKind.NOTE, "lens cap off"))
    assert [len(state.readings) for state in kept.states] == [len(session.clock), 0, 0, 0]


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A live state, and what its displays say, after a session whose own answers are far off."""
    folder, made = tmp_path_factory.mktemp("status"), []

    def listeners(loop):
        made.append(LiveState(loop.setup.station))
        return made

    replay_session(OWN_ANSWERS, make_listeners=listeners)
    (live,) = made
    status_file, glance = StatusFile(folder, live, Notes()), Glance(live)
    status_file.close(0)
    glance.absorb(NOW)
    return live.so_far, json.loads((folder / "status.json").read_text()), glance.document(NOW)


def test_the_status_file_says_of_the_limits_what_the_glance_page_does(shown) -> None:
    so_far, status, document = shown
    assert status["so_far"] == headline(so_far)
    outside = [axis["name"] for axis in document["axes"] if axis["subject"] == "sensor" and axis["outside"]]
    assert outside == ["dRA*", "dDE"]
    assert all(f"mean |sensor {name}|" in status["so_far"] for name in outside)
    assert (status["frames"], status["identified"]) == (document["frames"], document["identified"])


@pytest.mark.parametrize(
    ("waited_s", "url", "is_told"), [(12, "loop://", True), (0.5, "loop://", False), (12, "sim://", False)]
)
def test_what_is_late_because_this_computer_is_behind_says_so_on_every_display(waited_s, url, is_told) -> None:
    session = synthetic_night(20)
    port = session.station.port.model_copy(update={"url": url})
    session.station = session.station.model_copy(update={"port": port})
    session.frames.columns["host_utc_ns"] = read_clock().utc_ns - round(waited_s * NS_PER_S)
    live = LiveState(session.station)
    glance = Glance(live)
    live.on_results(results_of(list(synthetic_frames(20, trouble=False))), session)
    glance.absorb(NOW)
    texts = (
        StatusLine(live, console=Console(file=io.StringIO(), width=200)).line().plain,
        glance.document(NOW)["word"]["detail"],
        verdict_so_far(live.so_far),
    )
    assert [" s behind" in text for text in texts] == [is_told] * 3
