"""The station's loop gives the same night whether it lives through it or replays it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.chunk import Chunk, LinkEvent
from drivers.link import SerialLink
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.instant import NS_PER_DAY, NS_PER_S
from gse.panorama import Panorama
from gse.sessions.replay import ReplayOptions
from gse.station.event_kinds import ClockStep, StationKind
from gse.station.frame_results import NewResults
from gse.station.loop import StationLoop
from gse.station.session_data import SessionData
from gse.station.setup import set_up
from gse.truth import EarthOrientation
from protocols import StatusMessage, load_protocol

START_NS = 1_774_018_800 * NS_PER_S


FAULTS = Path(__file__).parents[3] / "replays" / "golden" / "faults.mcap"


class Heard:
    """A sink that keeps, in order, what it is told."""

    def __init__(self) -> None:
        self.told: list[object] = []

    def on_results(self, results: NewResults, session: SessionData) -> None:
        assert len(results), "a sink is told of nothing"
        for result in results:
            answer = result.identification.stars.tolist() if result.identification else None
            told = result.panorama.utc_ns, result.status, answer, result.attitude_error, result.answer_check
            self.told.append((*told, result.others, result.light))

    def on_event(self, event: LinkEvent) -> None:
        self.told.append(event)


def at(seconds: int) -> tuple[int, int]:
    return START_NS + seconds * NS_PER_S, seconds * NS_PER_S


def status() -> bytes:
    message = StatusMessage(time_us=1, temperature_c=20.0, supply_v=5.0, mode="streaming", firmware=(1, 2, 3), serial=1)
    return load_protocol("panorama-v1").encode(message, sequence=1)


def test_a_silence_before_the_port_is_lost_has_its_place_before_it_in_a_replay_too() -> None:
    setup = set_up(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, utc_ns=START_NS)
    live, replayed = StationLoop(setup), StationLoop(setup)
    opened, data = LinkEvent(*at(0), "OPENED", "the port is open"), Chunk(*at(1), status())
    lost = LinkEvent(*at(20), "LOST", "the port is gone")
    for item in (opened, data, lost):
        live.pass_time(item.utc_ns, item.mono_ns)
        live.take([item])
        replayed.take([item])
    kinds = [event.kind for event in replayed.session.events]
    assert kinds == ["OPENED", "WAITING", "SYNCING", "STREAMING", "STALE", "LOST", "NO_PORT"]
    assert replayed.session.events == live.session.events


def test_panoramas_that_waited_together_are_told_as_if_each_had_come_alone() -> None:
    with SerialLink(ReplayOptions().url(FAULTS)) as link:
        items = link.receive(1.0)
    heard = []
    for rounds in ([[item] for item in items], [items]):
        loop = StationLoop(set_up(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, utc_ns=items[0].utc_ns))
        loop.listeners = [Heard()]
        for waiting in rounds:
            loop.take(waiting)
        heard.append(loop.listeners[0].told)
    assert heard[0] == heard[1]
    assert sum(isinstance(told, LinkEvent) for told in heard[0]) > 1
    assert sum(isinstance(told, tuple) for told in heard[0]) > 50


def test_after_a_step_of_the_clock_beyond_its_reach_truth_is_sought_for_the_new_date() -> None:
    loop = StationLoop(set_up(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, utc_ns=START_NS))
    panorama, years_ns = Panorama(START_NS, np.zeros((0, 2)), np.zeros(0)), 8 * 366 * NS_PER_DAY
    loop.observe(panorama)
    first = loop.session.earth_orientation
    for event, utc_ns, is_new in (
        (LinkEvent(START_NS - years_ns, 0, "NOTE", "no step"), START_NS - years_ns, False),
        (ClockStep(START_NS + NS_PER_S, 0, StationKind.CLOCK_STEP, "", NS_PER_S), START_NS + NS_PER_S, False),
        (ClockStep(START_NS - years_ns, 0, StationKind.CLOCK_STEP, "", -years_ns), START_NS - years_ns, True),
    ):
        loop.on_event(event)
        loop.observe(replace(panorama, utc_ns=utc_ns))
        now = loop.session.earth_orientation
        assert (now is not first) is is_new
    assert now == EarthOrientation.from_disk(START_NS - years_ns)
