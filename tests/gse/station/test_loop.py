"""The station's loop gives the same night whether it lives through it or replays it."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from drivers.chunk import Chunk, LinkEvent
from drivers.clock import ClockReading
from drivers.link import SerialLink
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.external.identifier import ExternalIdentifier
from gse.recording.session_format import RecordedTimings
from gse.sessions.replay import ReplayOptions
from gse.station.events import ClockStep, StationKind
from gse.station.frame_results import FrameResults
from gse.station.loop import MOST_AT_ONCE, MOST_STATUSES, RECEIVE_TIMEOUT_S, StationLoop
from gse.station.results import Subject
from gse.station.session_data import SessionData
from gse.station.setup import Setup, set_up
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.instant import NS_PER_DAY, NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.panorama import Panorama, Panoramas
from protocols import PanoramaMessage, StatusMessage, load_protocol

START_NS = 1_774_018_800 * NS_PER_S


FAULTS = Path(__file__).parents[3] / "replays" / "golden" / "faults.mcap"


class Heard:
    """A sink that keeps, in order, what it is told."""

    def __init__(self) -> None:
        self.told: list[object] = []

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        assert len(results), "a sink is told of nothing"
        for result in results:
            stars = [match.star for match in result.matches]
            told = result.panorama.utc_ns, result.status, stars, result.attitude_error, result.answer_check
            self.told.append((*told, result.others, int(result.row["stars_seen"][0])))

    def on_event(self, event: LinkEvent) -> None:
        self.told.append(event)


def at(seconds: int) -> tuple[int, int]:
    return START_NS + seconds * NS_PER_S, seconds * NS_PER_S


def status(time_us: int = 1, serial: int = 1) -> bytes:
    told = {"temperature_c": 20.0, "supply_v": 5.0, "mode": "streaming", "firmware": (1, 2, 3)}
    return load_protocol("panorama-v1").encode(StatusMessage(time_us=time_us, serial=serial, **told), sequence=1)


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


# Turns of the loop, by hand


@pytest.fixture(scope="module")
def setup() -> Setup:
    return set_up(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, utc_ns=START_NS)


def event(number: int, kind: str = "NOTE") -> LinkEvent:
    return LinkEvent(START_NS + number, 0, kind, f"event {number}")


class Port:
    """A link that gives these items, one list a call, and is at its end with the last; it notes how it is called."""

    def __init__(self, *given: list[Chunk | LinkEvent], is_live: bool = False, later: int = 0) -> None:
        self._given, self.is_live, self._later = list(given), is_live, later
        self.calls: list[object] = []

    @property
    def at_end(self) -> bool:
        return len(self._given) <= self._later

    def receive(self, timeout_s: float, most: int = 0) -> list[Chunk | LinkEvent]:
        self.calls.append(timeout_s)
        return self._given.pop(0) if self._given else []

    @property
    def backlog_bytes(self) -> int:
        return sum(len(item.data) for items in self._given for item in items if isinstance(item, Chunk))

    def close(self) -> None:
        self.calls.append("close")


def texts(session: SessionData) -> list[str]:
    return [one.text for one in session.events if one.kind == "NOTE"]


def test_a_session_runs_until_its_link_is_at_its_end(setup: Setup) -> None:
    port, rounds = Port([event(1)], [event(2), event(3)]), []
    session = StationLoop(setup).run(port, [event(0)], each=lambda results: rounds.append(results))
    assert texts(session) == ["event 0", "event 1", "event 2", "event 3"]
    assert port.calls == [RECEIVE_TIMEOUT_S] * 2
    assert rounds == [[], [], [], []]  # what came first, two rounds, and the end


def test_a_session_ends_when_it_is_told_to_and_a_live_port_is_closed_first_and_emptied(setup: Setup) -> None:
    asked = iter([False, True])
    port = Port([event(1)], [event(2)], [event(3)], [event(4)], is_live=True)
    session = StationLoop(setup).run(port, stop=lambda: next(asked))
    assert texts(session) == ["event 1", "event 2", "event 3", "event 4"]
    assert port.calls == [RECEIVE_TIMEOUT_S, "close", 0, 0, 0, 0]


@pytest.mark.parametrize("leaves", [True, False])
def test_a_session_that_is_to_end_processes_what_waits_or_leaves_it_and_says_how_much(
    setup: Setup, leaves: bool
) -> None:
    frames = [Chunk(*at(number), panorama_frame(number)) for number in range(200)]
    asked = iter([False, True])
    port, loop = Port(frames[:150], frames[150:], is_live=True), StationLoop(setup)
    session = loop.run(port, stop=lambda: next(asked), leave=lambda: leaves)
    assert port.calls[:2] == [0.2, "close"]
    assert len(session.frames) < 150 if leaves else len(session.frames) == 200
    left = frames[len(session.frames) :]
    assert loop.left_bytes == sum(len(chunk.data) for chunk in left)


def test_what_is_left_in_a_recording_is_not_read_when_a_session_is_told_to_end(setup: Setup) -> None:
    port = Port([event(1)], [event(2)])
    assert texts(StationLoop(setup).run(port, stop=lambda: True)) == []
    assert port.calls == []


def test_results_of_the_bytes_behind_the_end_are_results_of_the_session(setup: Setup) -> None:
    data, rounds = panorama_frame(), []
    port = Port([Chunk(*at(0), data[:20])], [Chunk(*at(1), data[20:])], is_live=True, later=1)
    session = StationLoop(setup).run(port, each=rounds.append)
    assert [len(results) for results in rounds] == [0, 1, 0]
    assert len(session.frames) == 1
    assert session.raw_sha256 == hashlib.sha256(data).hexdigest()


def panorama_frame(number: int = 1) -> bytes:
    nothing = np.zeros((0, 2)), np.zeros(0)
    message = PanoramaMessage(1000 * number, number, 0.1, frozenset(), 20.0, *nothing)
    return load_protocol("panorama-v1").encode(message, sequence=number)


def panorama_frames(count: int, *, first: int = 1) -> bytes:
    return b"".join(map(panorama_frame, range(first, first + count)))


class Source:
    """A program that answers nothing, and notes that it was ended."""

    identity: ClassVar[dict[str, str]] = {"name": "made"}
    is_closed = False

    def close(self) -> None:
        self.is_closed = True


def test_an_external_identifier_is_ended_with_the_session_whatever_ends_it(setup: Setup) -> None:
    for port in (Port(), None):
        source = Source()
        loop = StationLoop(replace(setup, identifier=ExternalIdentifier(setup.identifier.catalog, source)))
        if port is None:
            with pytest.raises(AttributeError):
                loop.run(port)
        else:
            loop.run(port)
        assert source.is_closed
        assert loop.session.external == {"name": "made"}
    loop = StationLoop(setup)
    loop.run(Port())
    assert loop.session.external is None


@pytest.mark.parametrize(("most", "sizes"), [(None, [MOST_AT_ONCE, 3]), (2, [2, 2, 1])])
def test_panoramas_that_wait_are_processed_so_many_at_a_time(setup: Setup, most: int | None, sizes: list[int]) -> None:
    loop = StationLoop(setup)
    loop.most_at_once = most or loop.most_at_once
    results = loop.take([Chunk(*at(1), panorama_frames(sum(sizes)))])
    assert [len(some) for some in results] == sizes
    assert loop.session.frames.columns["frame_no"].tolist() == list(range(1, sum(sizes) + 1))


class AtOnce:
    """Another thread that does what it is given at once."""

    def __init__(self) -> None:
        self.given = 0

    def submit(self, call: Callable[[Panoramas], object], part: Panoramas) -> SimpleNamespace:
        self.given += 1
        found = call(part)
        return SimpleNamespace(result=lambda: found)


def test_two_parts_are_identified_ahead_of_the_one_that_is_concluded(setup: Setup) -> None:
    loop, heard = StationLoop(setup), Heard()
    loop.take([Chunk(*at(0), panorama_frames(1))])
    loop.ahead, loop.listeners, loop.most_at_once = AtOnce(), [heard], 2
    some, more = panorama_frames(3, first=2), panorama_frames(6, first=5)
    loop.take([Chunk(*at(1), some), event(1), Chunk(*at(2), more), event(2)])
    # Parts of 2, 1, [event], 2, 2, 2, [event]: all but the latest two are told.
    assert loop.ahead.given == 5
    assert [isinstance(one, LinkEvent) for one in heard.told] == [False] * 3 + [True] + [False] * 4
    loop.finish()
    assert event(2) in loop.session.events
    assert len(loop.session.frames) == 10


def test_events_of_a_kind_beyond_a_thousand_are_counted_and_every_one_is_heard(setup: Setup) -> None:
    loop, heard = StationLoop(setup), Heard()
    loop.listeners = [heard, heard]
    for number in range(1003):
        loop.on_event(event(number, "REOPENED"))
    loop.on_event(event(1, "LOST"))
    assert (len(loop.session.events), loop.session.events_not_kept) == (1001, 3)
    assert (loop.session.link.reconnects, len(heard.told)) == (1003, 2008)


def test_a_sensor_that_names_itself_otherwise_than_before_is_an_event_and_one_that_names_no_number_is_none(
    setup: Setup,
) -> None:
    loop = StationLoop(setup)
    loop.take([Chunk(*at(second), status(serial=serial)) for second, serial in enumerate((7, 0, 7, 8, 0, 8))])
    told = [event for event in loop.session.events if event.kind == "OTHER_SENSOR"]
    assert [event.text for event in told] == [
        "the sensor says that it is number 8, it was 7 before: two sensors in one session"
    ]
    assert told[0].utc_ns == at(3)[0]


def test_so_many_statuses_are_kept_and_have_no_place_among_the_results(setup: Setup) -> None:
    loop = StationLoop(setup)
    loop.session.statuses = [(0, StatusMessage(time_us=2))] * (MOST_STATUSES - 1)
    assert loop.take([Chunk(*at(7), status()), Chunk(*at(8), status(time_us=3))]) == []
    assert len(loop.session.statuses) == MOST_STATUSES
    assert [message.time_us for _, message in loop.session.statuses[-2:]] == [2, 1]


def test_identification_times_are_the_recorded_ones_in_a_replay_and_this_hosts_own_are_kept_beside(
    setup: Setup,
) -> None:
    recorded = RecordedTimings()
    recorded.add(5, 120.5)
    for timings, expected in ((recorded, [120.5, None]), (None, "own")):
        loop = StationLoop(setup, recorded=timings)
        results = [loop.observe(under_the_sky(setup, 0, time_us=time_us)) for time_us in (5, 6)]
        own_us = loop.own_elapsed_us.tolist()
        assert min(own_us) > 0
        assert [result.elapsed_us for result in results] == (own_us if expected == "own" else expected)


def test_the_date_of_the_first_panorama_decides_which_sky_is_sought(setup: Setup) -> None:
    """The first of these is from 1971, for which there are no tables; the second would have some."""
    loop, early_ns = StationLoop(setup), from_text("1971-06-01T00:00:00Z")
    for utc_ns in (early_ns, START_NS):
        loop.observe(replace(under_the_sky(setup, 0), utc_ns=utc_ns))
    (lacking,) = [one for one in loop.session.events if one.kind == StationKind.NO_TRUTH]
    assert (lacking.utc_ns, lacking.mono_ns) == (early_ns, 0)
    assert loop.session.earth_orientation is None


def test_a_step_of_the_clock_before_the_first_panorama_leaves_the_sky_to_be_sought(setup: Setup) -> None:
    loop = StationLoop(setup)
    loop.on_event(ClockStep(START_NS, 0, StationKind.CLOCK_STEP, "", NS_PER_S))
    loop.observe(under_the_sky(setup, 0))
    assert loop.session.earth_orientation is not None


MOUNT = Mount(azimuth_deg=123.0, altitude_deg=61.0, roll_deg=200.0)


def under_the_sky(setup: Setup, second: int, *, time_us: int = 0) -> Panorama:
    """The stars that a sensor on MOUNT sees."""
    utc_ns = START_NS + second * NS_PER_S
    attitude = SiderealTruth(setup.station.site, EarthOrientation.from_disk(utc_ns)).attitude_true(utc_ns, MOUNT)
    xy_px = setup.camera.pixels(setup.identifier.catalog.icrs @ attitude.icrs_to_sensor.T)
    inside = np.flatnonzero(setup.camera.contains(xy_px))[:20]
    return Panorama(utc_ns, xy_px[inside], np.linspace(4000.0, 300.0, len(inside)), time_us=time_us)


def test_panoramas_come_one_by_one_while_the_mount_is_fitted(setup: Setup) -> None:
    """The next may bring it."""
    station = setup.station.model_copy(update={"mount": Mount(align="first 20 s")})
    results = StationLoop(replace(setup, station=station)).take([Chunk(*at(1), panorama_frames(3))])
    assert [len(some) for some in results] == [1, 1, 1]


def test_the_mount_of_the_station_file_counts_from_the_first(setup: Setup) -> None:
    station = setup.station.model_copy(update={"mount": MOUNT})
    assert StationLoop(replace(setup, station=station)).observe(under_the_sky(setup, 0)).attitude_error is not None


def test_the_mean_of_the_paper_is_taken_where_the_station_file_asks_for_it(setup: Setup) -> None:
    """Without an error in any direction both means agree; with some they do not."""
    station = parse_station(f"{BUILT_IN_TEXT}identifier: {{attitude: paper-mean}}\n")
    panorama = under_the_sky(setup, 0)
    panorama.xy_px[::2] += 1.0
    wahba, mean = (
        StationLoop(replace(setup, station=one)).observe(panorama).attitude_geometric
        for one in (setup.station, station)
    )
    assert 1e-11 < abs(wahba.icrs_to_sensor - mean.icrs_to_sensor).max() < 1e-4


def test_a_finished_session_has_its_housekeeping_and_what_its_counters_hold(setup: Setup) -> None:
    loop = StationLoop(setup)
    loop.take([Chunk(*at(0), status()), Chunk(*at(1), panorama_frame(2))])
    loop.read_clock(ClockReading(START_NS, 0, "simulated", True, 0.0, 0.01))
    assert len(loop.finish()) == 0
    assert loop.session.frames.columns["supply_v"].tolist() == [5.0]
    assert len(loop.session.clock) == 1
    assert loop.session.raw_sha256 == hashlib.sha256(status() + panorama_frame(2)).hexdigest()
    assert loop.session.others_lost == 0
    assert loop.session.subject is Subject.ONBOARD
    assert loop.session.stars.name(0) == setup.identifier.catalog.name(0)
    assert loop.session.versions["numpy"] == np.__version__


def test_bytes_that_the_end_completes_are_results_of_the_end(setup: Setup) -> None:
    """Two panoramas wait for another thread when the stream ends."""
    loop = StationLoop(setup)
    loop.ahead = AtOnce()
    assert loop.take([Chunk(*at(0), panorama_frame(1)), Chunk(*at(1), panorama_frame(2))]) == []
    assert [len(results) for results in loop.finish()] == [2]


def test_a_silence_is_told_while_no_bytes_come(setup: Setup) -> None:
    loop = StationLoop(setup)
    loop.take([Chunk(*at(0), status())])
    loop.pass_time(*at(60))
    assert "STALE" in [one.kind for one in loop.session.events]
