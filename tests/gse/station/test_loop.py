"""The station's loop gives the same night whether it lives through it or replays it."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from skies.one_by_one import Made, results_of

from drivers.chunk import Chunk, LinkEvent
from drivers.clock import ClockReading
from drivers.link import SerialLink
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.external.identifier import ExternalIdentifier
from gse.recording.session_format import RecordedTimings
from gse.sessions.replay import ReplayOptions
from gse.station.events import ClockStep, StationKind
from gse.station.frame_results import FrameResults
from gse.station.loop import StationLoop
from gse.station.reception import Received
from gse.station.results import OwnAnswer, Status, Subject
from gse.station.session_data import SessionData
from gse.station.setup import Setup, set_up
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.instant import NS_PER_DAY, NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.panorama import Panorama, Panoramas
from protocols import Ack, AttitudeMessage, PanoramaMessage, StatusMessage, load_protocol

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


# Turns of the loop, by hand


@pytest.fixture(scope="module")
def setup() -> Setup:
    return set_up(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, utc_ns=START_NS)


def empty(*after_s: float) -> Panoramas:
    """Panoramas without objects: there is nothing to identify."""
    return Panoramas.from_panoramas(
        [Panorama(START_NS + round(s * NS_PER_S), np.zeros((0, 2)), np.zeros(0), n) for n, s in enumerate(after_s)]
    )


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

    def receive(self, timeout_s: float) -> list[Chunk | LinkEvent]:
        self.calls.append(timeout_s)
        return self._given.pop(0) if self._given else []

    def close(self) -> None:
        self.calls.append("close")


def texts(session: SessionData) -> list[str]:
    return [one.text for one in session.events if one.kind == "NOTE"]


def test_a_session_runs_until_its_link_is_at_its_end(setup: Setup) -> None:
    port, rounds = Port([event(1)], [event(2), event(3)]), []
    session = StationLoop(setup).run(port, [event(0)], each=lambda results: rounds.append(results))
    assert texts(session) == ["event 0", "event 1", "event 2", "event 3"]
    assert port.calls == [0.2, 0.2]
    assert rounds == [[], [], [], []]  # what came first, two rounds, and the end


def test_a_session_ends_when_it_is_told_to_and_a_live_port_is_closed_first_and_emptied(setup: Setup) -> None:
    asked = iter([False, True])
    port = Port([event(1)], [event(2)], [event(3)], [event(4)], is_live=True)
    session = StationLoop(setup).run(port, stop=lambda: next(asked))
    assert texts(session) == ["event 1", "event 2", "event 3", "event 4"]
    assert port.calls == [0.2, "close", 0, 0, 0, 0]


def test_what_is_left_in_a_recording_is_not_read_when_a_session_is_told_to_end(setup: Setup) -> None:
    port = Port([event(1)], [event(2)])
    assert texts(StationLoop(setup).run(port, stop=lambda: True)) == []
    assert port.calls == []


def test_results_of_the_bytes_behind_the_end_are_results_of_the_session(setup: Setup) -> None:
    data, rounds = panorama_frame(), []
    port = Port([Chunk(*at(0), data[:20])], [Chunk(*at(1), data[20:])], is_live=True, later=1)
    session = StationLoop(setup).run(port, each=rounds.append)
    assert [len(results) for results in rounds] == [0, 0, 1]
    assert len(session.frames) == 1
    assert session.raw_sha256 == hashlib.sha256(data).hexdigest()


def panorama_frame(number: int = 1) -> bytes:
    nothing = np.zeros((0, 2)), np.zeros(0)
    message = PanoramaMessage(1000 * number, number, 0.1, frozenset(), 20.0, *nothing)
    return load_protocol("panorama-v1").encode(message, sequence=number)


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


@pytest.mark.parametrize(
    ("most", "align", "sizes"),
    [(1024, False, [1024, 1024, 452]), (2, False, [2] * 1250), (1024, True, [1] * 2500)],
)
def test_panoramas_that_wait_are_taken_1024_at_a_time_and_one_by_one_while_the_mount_is_fitted(
    setup: Setup, most: int, align: bool, sizes: list[int]
) -> None:
    station = setup.station.model_copy(update={"mount": Mount(align="first 60 s")}) if align else setup.station
    loop = StationLoop(replace(setup, station=station))
    assert loop.most_at_once == 1024
    loop.most_at_once = most
    asked = list(loop._asked(empty(*range(2500))))
    assert [len(one.panoramas) for one in asked] == sizes
    assert [n for one in asked for n in one.panoramas.frame_no.tolist()] == list(range(2500))
    assert len(list(loop._asked(empty()))) == 0


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
    loop.ahead, loop.listeners, loop.most_at_once = AtOnce(), [heard], 2
    loop._identify(Received([(3, event(1)), (9, event(2))], empty(*range(9))))
    # Parts of 2, 1, [event], 2, 2, 2, [event]: all but the latest two are told.
    assert loop.ahead.given == 5
    told = [one.text if isinstance(one, LinkEvent) else one[0] for one in heard.told]
    assert [one for one in told if isinstance(one, str) and one.startswith("event")] == ["event 1"]
    assert [(one - START_NS) // NS_PER_S for one in told if isinstance(one, int)] == list(range(7))
    loop.finish()
    assert loop.session.events[-1] == event(2)
    assert len(loop.session.frames) == 9


def test_events_of_a_kind_beyond_a_thousand_are_counted_and_every_one_is_heard(setup: Setup) -> None:
    loop, heard = StationLoop(setup), Heard()
    loop.listeners = [heard, heard]
    for number in range(1003):
        loop.on_event(event(number, "REOPENED"))
    loop.on_event(event(1, "LOST"))
    assert (len(loop.session.events), loop.session.events_not_kept) == (1001, 3)
    assert (loop.session.link.reconnects, len(heard.told)) == (1003, 2008)


def test_fifty_thousand_statuses_are_kept_and_have_no_place_among_the_results(setup: Setup) -> None:
    loop, message = StationLoop(setup), StatusMessage(time_us=1)
    loop.session.statuses = [(0, message)] * 49_999
    assert [loop._has_place((number, message)) for number in (7, 8)] == [False, False]
    assert len(loop.session.statuses) == 50_000
    assert loop.session.statuses[-1] == (7, message)
    assert loop._has_place(event(1)) is True
    assert loop._has_place(Ack("START", 1)) is False
    assert len(loop.session.statuses) == 50_000


@pytest.mark.parametrize(("utc_ns", "has_place"), [(None, False), (0, True), (START_NS, True)])
def test_an_own_answer_is_kept_and_has_a_place_where_it_has_an_instant(
    setup: Setup, utc_ns: int | None, has_place: bool
) -> None:
    loop = StationLoop(setup)
    assert loop._has_place(OwnAnswer(AttitudeMessage(5, frame_no=3), START_NS, utc_ns)) is has_place
    assert loop.session.sensor_attitudes.columns["host_utc_ns"].tolist() == [START_NS]


def test_identification_times_are_the_recorded_ones_in_a_replay_and_this_hosts_own_are_kept_beside(
    setup: Setup,
) -> None:
    recorded = RecordedTimings()
    recorded.add(5, 120.5)
    recorded.add(7, 80.0)
    panoramas = replace(empty(0, 1, 2), time_us=np.array([5, 6, 7]))
    identified = SimpleNamespace(elapsed_us=np.array([1.0, math.nan, 3.0]))
    for timings, expected in ((recorded, [120.5, math.nan, 80.0]), (None, [1.0, math.nan, 3.0])):
        loop = StationLoop(setup, recorded=timings)
        found = loop._elapsed_us(panoramas, identified)
        assert found.tolist() == pytest.approx(expected, nan_ok=True)
        assert loop.own_elapsed_us.tolist() == [1.0, 3.0]


def test_the_date_of_the_first_panorama_decides_which_sky_is_sought(setup: Setup) -> None:
    """The first of these is from 1971, for which there are no tables; the second would have some."""
    loop = StationLoop(setup)
    panoramas = empty(0, 1)
    panoramas.utc_ns[0] = from_text("1971-06-01T00:00:00Z")
    loop._identify(Received([], panoramas))
    (lacking,) = [one for one in loop.session.events if one.kind == StationKind.NO_TRUTH]
    assert (lacking.utc_ns, lacking.mono_ns) == (panoramas.utc_ns[0], 0)
    assert loop.session.earth_orientation is None


def test_a_step_of_the_clock_before_the_first_panorama_leaves_the_sky_to_be_sought(setup: Setup) -> None:
    loop = StationLoop(setup)
    loop.on_event(ClockStep(START_NS, 0, StationKind.CLOCK_STEP, "", NS_PER_S))
    assert loop._truth_sought is False
    assert loop.observe(empty(0)[0]).panorama.utc_ns == START_NS
    assert loop._truth_sought is True
    loop.on_event(ClockStep(START_NS + NS_PER_S, 0, StationKind.CLOCK_STEP, "", NS_PER_S))
    assert loop._truth_sought is True


def mounted(setup: Setup, mount: Mount) -> StationLoop:
    station = setup.station.model_copy(update={"mount": mount})
    return StationLoop(replace(setup, station=station), earth_orientation=EarthOrientation.from_disk(START_NS))


def test_the_mount_of_the_station_file_counts_from_the_first_and_one_to_be_fitted_once_it_is(setup: Setup) -> None:
    stated = mounted(setup, Mount(azimuth_deg=10.0, altitude_deg=80.0))
    assert stated._first_seconds is None
    assert stated._frame_processor.mount == Mount(azimuth_deg=10.0, altitude_deg=80.0)
    loop = mounted(setup, Mount(align="first 20 s"))
    assert loop._frame_processor.mount is None
    mount = Mount(azimuth_deg=123.0, altitude_deg=41.0, roll_deg=200.0)
    truth = SiderealTruth(loop.setup.station.site, loop.session.earth_orientation)
    loop._prepare(START_NS)
    for second in range(20):
        attitude = truth.attitude_true(START_NS + second * NS_PER_S, mount)
        panorama = Panorama(START_NS + second * NS_PER_S, np.zeros((0, 2)), np.zeros(0))
        made = Made(panorama, Status.IDENTIFIED, "", "neighbour", attitude_geometric=attitude)
        loop._store(results_of([made]))
    loop._prepare(START_NS + 20 * NS_PER_S - 1)
    assert loop.session.alignment is None
    loop._prepare(START_NS + 20 * NS_PER_S)
    assert loop.session.alignment.n == 20
    assert loop._frame_processor.mount is loop.session.alignment.mount
    assert loop._frame_processor.mount.altitude_deg == pytest.approx(41.0, abs=1e-6)
    (told,) = [one for one in loop.session.events if one.kind == StationKind.ALIGNED]
    assert (told.utc_ns, told.mono_ns, told.text) == (START_NS + 20 * NS_PER_S, 0, str(loop.session.alignment))
    assert loop._first_seconds is None
    assert [len(one.panoramas) for one in loop._asked(empty(*range(5)))] == [5]


@pytest.mark.parametrize(("attitude", "is_mean"), [("paper-mean", True), ("wahba", False)])
def test_the_mean_of_the_paper_is_taken_where_the_station_file_asks_for_it(
    setup: Setup, attitude: str, is_mean: bool
) -> None:
    station = parse_station(f"{BUILT_IN_TEXT}identifier: {{attitude: {attitude}}}\n")
    assert StationLoop(replace(setup, station=station))._frame_processor.paper_mean is is_mean


class EventsAt:
    """Events that results bring, at given places."""

    def __init__(self, *places: int) -> None:
        self._places = places

    def brought_by(self, results: FrameResults, session: SessionData, first: int) -> list[tuple[int, LinkEvent]]:
        return [(place, event(100 * first + place)) for place in self._places]


@pytest.mark.parametrize(
    ("places", "told"),
    [
        ((), [0, 1, 2, 3]),
        ((0,), ["event 200", 0, 1, 2, 3]),
        ((0, 0, 2), ["event 200", "event 200", 0, 1, "event 202", 2, 3]),
        ((1, 4), [0, "event 201", 1, 2, 3, "event 204"]),
    ],
)
def test_listeners_see_results_in_their_order_with_the_events_that_they_bring_between_them(
    setup: Setup, places: tuple[int, ...], told: list[int | str]
) -> None:
    """After two results that the session has already."""
    loop, heard = StationLoop(setup), Heard()

    def made(panoramas: Panoramas) -> FrameResults:
        return results_of([Made(one, Status.NO_MATCH, "", "neighbour") for one in panoramas])

    loop._store(made(empty(0, 1)))
    loop.listeners, loop._result_events = [heard], EventsAt(*places)
    loop._store(made(empty(0, 1, 2, 3)))
    seen = [one.text if isinstance(one, LinkEvent) else (one[0] - START_NS) // NS_PER_S for one in heard.told]
    assert seen == told
    assert len(loop.session.frames) == 6


def test_an_answer_without_a_panorama_shows_no_sky(setup: Setup) -> None:
    loop = StationLoop(setup)
    message = AttitudeMessage(5, frame_no=3, state="lost", latency_s=0.1)
    (results,) = loop._identify(Received([(0, OwnAnswer(message, START_NS + 5, START_NS))], empty()))
    assert [(one.status, one.identifier) for one in results] == [(Status.NO_MATCH, "sensor")]
    assert loop.sky.sees_objects is False
    assert loop.session.frames.columns["frame_no"].tolist() == [3]
    assert loop.session.earth_orientation is not None


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
