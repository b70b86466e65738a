"""Frames that are lost while this computer does not run the station."""

from collections.abc import Sequence

import pytest
from devices.injected_clocks import InjectedClocks, Sky

from drivers.chunk import Chunk, LinkEvent, LinkKind
from gse.assessment.not_run import lost_while_not_run
from gse.assessment.verdict import judge
from gse.station.loop import StationLoop
from gse.station.results import Verdict
from gse.station.session_data import SessionData

HELD = 5
"""Frames that the port holds while nobody reads it."""


@pytest.fixture(scope="module")
def sky() -> Sky:
    return Sky()


def session_of(sky: Sky, stopped: range, told: bool, others: Sequence[int] = ()) -> SessionData:
    """A session without the frames of some numbers, and an event where the station runs again."""
    items: list[Chunk | LinkEvent] = []
    resumed: Chunk | None = None
    chunks = list(sky.chunks(InjectedClocks(), (0.0, 0.0), None, False))
    for number, chunk in enumerate(chunks):
        if number in others or number in stopped[HELD:]:
            continue
        if number in stopped[:HELD]:  # read at the end of the stop
            resumed = chunks[stopped.stop]
            chunk = Chunk(resumed.utc_ns - 50_000_000, resumed.mono_ns - 50_000_000, chunk.data)
            if number == stopped.start and told:
                items.append(LinkEvent(chunk.utc_ns, chunk.mono_ns, LinkKind.NOT_RUN, "for 6.0 s"))
        items.append(chunk)
    loop = StationLoop(sky.setup)
    loop.take(items)
    loop.finish()
    return loop.session


def test_what_is_lost_in_a_stop_of_the_station_is_not_held_against_the_sensor(sky: Sky) -> None:
    stopped = range(100, 200)
    session = session_of(sky, stopped, told=True)
    assert lost_while_not_run(session) == len(stopped) - HELD == session.panoramas_lost
    assessment = judge(session)
    assert assessment.verdict is Verdict.INCONCLUSIVE
    assert any("95 were lost while this computer did not run" in reason for reason in assessment.reasons)
    assert any(finding.cause == "station stopped" for finding in assessment.findings)


def test_the_same_loss_without_a_stop_is_the_sensors(sky: Sky) -> None:
    assert judge(session_of(sky, range(100, 200), told=False)).verdict is Verdict.FAIL


def test_a_stop_excuses_no_frames_that_were_lost_elsewhere(sky: Sky) -> None:
    others = [*range(20, 80), *range(250, 350)]  # before the stop, and long after it
    session = session_of(sky, range(100, 130), told=True, others=others)
    assert lost_while_not_run(session) == 25
    assert judge(session).verdict is Verdict.FAIL
