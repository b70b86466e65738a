"""The states of the link, each with its time, whatever way the data is cut."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.chunk import Chunk, LinkEvent, LinkKind
from drivers.link_state import LinkMonitor
from drivers.uart import received_at

S = 1_000_000_000
UTC = 1_774_000_000 * S
NOISE = bytes(range(100, 200))


def at(seconds: float) -> tuple[int, int]:
    return UTC + round(seconds * S), 77 + round(seconds * S)


def chunk(seconds: float, data: bytes = NOISE) -> Chunk:
    return Chunk(*at(seconds), data)


def opened() -> LinkMonitor:
    monitor = LinkMonitor(115200)
    monitor.port_event(LinkEvent(*at(0), "OPENED", "open"))
    return monitor


def seconds_of(events: list[LinkEvent]) -> list[tuple[str, float]]:
    return [(event.kind, (event.utc_ns - UTC) / S) for event in events]


def test_a_night_from_the_port_to_silence() -> None:
    monitor = LinkMonitor(115200)
    events = monitor.port_event(LinkEvent(*at(0), "NO_PORT", "none"))
    events += monitor.port_event(LinkEvent(*at(1), "OPENED", "open"))
    events += monitor.received(chunk(2), 0, ())
    events += monitor.received(chunk(2.1), 1, ())
    events += monitor.received(chunk(2.2), 1, ())
    events += monitor.pass_time(*at(9))
    events += monitor.received(chunk(10), 1, ())
    events += monitor.port_event(LinkEvent(*at(11), "LOST", "gone"))
    assert seconds_of(events) == [
        (LinkKind.NO_PORT, 0),
        (LinkKind.WAITING, 1),
        (LinkKind.SYNCING, 2),
        (LinkKind.STREAMING, 2.1),
        (LinkKind.STALE, 5.2),
        (LinkKind.SYNCING, 10),
        (LinkKind.STREAMING, 10),
        (LinkKind.NO_PORT, 11),
    ]


def test_no_bytes_and_no_valid_frames_are_told_apart() -> None:
    silent, unreadable = opened(), opened()
    silence = silent.pass_time(*at(20))
    noise = [event for n in range(40) for event in unreadable.received(chunk(n * 0.5), 0, {"no sync"})]
    assert seconds_of(silence) == [("SILENT", 3)]
    assert "no bytes" in silence[0].text
    assert silent.state == LinkKind.WAITING
    assert seconds_of(noise) == [(LinkKind.SYNCING, 0), ("NO_FRAMES", 3)]
    assert "but no valid frame" in noise[1].text
    assert unreadable.state == LinkKind.SYNCING


def test_frames_that_stop_while_bytes_go_on_are_not_called_silence() -> None:
    monitor = opened()
    monitor.received(chunk(0), 1, ())
    events = [event for n in range(1, 20) for event in monitor.received(chunk(n * 0.5), 0, {"bad crc"})]
    assert seconds_of(events) == [(LinkKind.SYNCING, 3)]
    assert "bad crc" in events[0].text


def test_a_wrong_baud_rate_is_recognised_and_said() -> None:
    sent = bytes.fromhex("1acffc1d0100") + bytes(range(0, 210))
    for sensor_baud in (9600, 19200):
        monitor = opened()
        heard = received_at(sent, sensor_baud, 115200)
        events = [event for n in range(8) for event in monitor.received(chunk(n * 0.5, heard), 0, {"no sync"})]
        assert "wrong baud rate" in events[-1].text
        assert "slower than 115200" in events[-1].text


def test_a_trickle_of_noise_is_not_called_a_baud_rate() -> None:
    monitor = opened()
    events = [event for n in range(8) for event in monitor.received(chunk(n * 0.5, b"?"), 0, ())]
    assert "slower than" not in events[-1].text


def test_silence_is_told_at_its_own_time_however_late_it_is_found_out() -> None:
    early, late = opened(), opened()
    for monitor in (early, late):
        monitor.received(chunk(1), 1, ())
    found_early = [event for n in range(10, 500) for event in early.pass_time(*at(n * 0.1))]
    assert found_early == late.pass_time(*at(50)) == [LinkEvent(*at(4), LinkKind.STALE, found_early[0].text)]


def test_a_host_that_was_booted_anew_is_not_silence() -> None:
    monitor = opened()
    monitor.received(chunk(1000), 1, ())
    assert monitor.received(Chunk(at(1010)[0], 5, NOISE), 1, ()) == []
    assert monitor.state == LinkKind.STREAMING


@given(
    pieces=st.lists(st.tuples(st.sampled_from([0.0, 0.1, 1.0, 2.9, 3.5, 8.0]), st.integers(0, 1)), max_size=12),
    cut=st.integers(1, 60),
)
def test_cutting_the_chunks_changes_nothing(pieces: list[tuple[float, int]], cut: int) -> None:
    whole, parts = opened(), opened()
    events_whole, events_parts = [], []
    seconds = 0.0
    for pause_s, frames in pieces:
        seconds += pause_s
        events_whole += whole.received(chunk(seconds), frames, ())
        # The frame, if there is one, is complete somewhere within the bytes.
        events_parts += parts.received(chunk(seconds, NOISE[:cut]), 0, ())
        events_parts += parts.received(chunk(seconds, NOISE[cut:80]), frames, ())
        events_parts += parts.received(chunk(seconds, NOISE[80:]), 0, ())
    events_whole += whole.pass_time(*at(seconds + 9))
    events_parts += parts.pass_time(*at(seconds + 9))
    assert seconds_of(events_whole) == seconds_of(events_parts)
    times = [event.mono_ns for event in events_whole]
    assert all(before <= after for before, after in pairwise(times))


def test_a_slow_sensor_is_silent_only_when_a_frame_and_the_next_are_missing() -> None:
    """Its housekeeping comes beside its panoramas, 100 s apart: that it is slow is seen at the second silence."""
    monitor = opened()
    events = [event for n in range(20) for s in (0, 0.5) for event in monitor.received(chunk(100 * n + s), 1, ())]
    stale = [at_s for kind, at_s in seconds_of(events) if kind == LinkKind.STALE]
    assert stale == [3.5, 103.5]
    (last,) = monitor.pass_time(*at(5000))
    assert seconds_of([last]) == [(LinkKind.STALE, 1900.5 + 199)]
    assert "no bytes for 199 s" in last.text


def test_one_outage_does_not_make_a_sensor_slow() -> None:
    monitor = opened()
    events = [event for s in (0, 1, 2, 60, 61, 62) for event in monitor.received(chunk(s), 1, ())]
    events += monitor.pass_time(*at(70))
    assert [at_s for kind, at_s in seconds_of(events) if kind == LinkKind.STALE] == [5, 65]


def test_a_sensor_that_is_fast_again_is_soon_missed() -> None:
    monitor = opened()
    for s in (0, 20, 40, 60, 80, *range(81, 90)):
        monitor.received(chunk(s), 1, ())
    assert seconds_of(monitor.pass_time(*at(93))) == [(LinkKind.STALE, 92)]


@given(st.data())
@settings(max_examples=300)
def test_chunks_that_come_together_change_the_state_as_one_by_one(data: st.DataObject) -> None:
    """Pauses of all lengths, a clock that jumps back, chunks with and without a frame, noise."""
    steps_s = st.sampled_from([0, 0.01, 0.1, 1, 2.9, 3, 3.1, 7, 100, -0.1, -50])
    kinds = st.sampled_from(["frame", "frame", "part", "noise"])
    drawn = data.draw(st.lists(st.tuples(steps_s, kinds), max_size=40))
    together, one_by_one = (LinkMonitor(115200, bytes_per_s=8) for _ in range(2))  # full by a chunk a second
    now_s, chunks, framed, noisy = 1000.0, [], [], {}
    for k, (step_s, kind) in enumerate(drawn):
        now_s += step_s
        chunks.append(chunk(now_s, NOISE[:8]))
        framed += [k] if kind == "frame" else []
        noisy |= {k: {"bad crc"}} if kind == "noise" else {}
    expected = [
        (k, event)
        for k in range(len(chunks))
        for event in one_by_one.received(chunks[k], int(k in framed), noisy.get(k, ()))
    ]
    cut = data.draw(st.integers(0, len(chunks)))
    found = together.received_all(chunks[:cut], [k for k in framed if k < cut], noisy)
    rest = {k - cut: reasons for k, reasons in noisy.items() if k >= cut}
    found += [
        (k + cut, event)
        for k, event in together.received_all(chunks[cut:], [k - cut for k in framed if k >= cut], rest)
    ]
    assert found == expected
    assert together.pass_time(*at(now_s + 500)) == one_by_one.pass_time(*at(now_s + 500))
    assert together.state == one_by_one.state


def test_a_clock_that_jumps_back_behind_frames_that_came_together_starts_the_silence_anew() -> None:
    monitor = LinkMonitor(115200)
    monitor.received_all([chunk(0), chunk(1)], [0, 1], {})
    monitor.received_all([chunk(1.5), chunk(2)], [0, 1], {})
    assert monitor.received_all([chunk(1.9)], [], {}) == []
    assert seconds_of(monitor.pass_time(*at(10))) == [("STALE", 4.9)]


def filled(share: float, *, of: slice = slice(None), frames: int = 1, bytes_per_s: float | None = 10_000) -> list[str]:
    """The kinds of events of some chunks of 12 s, which bring this share of what a line carries."""
    monitor = LinkMonitor(100_000, bytes_per_s=bytes_per_s)
    chunks = [chunk(k / 100, bytes(round(100 * share))) for k in range(1200)][of]
    return [event.kind for one in chunks for event in monitor.received(one, frames, ())][2:]


@pytest.mark.parametrize(
    ("share", "is_full"),
    [(0.5, False), (0.94, False), (0.96, True), (1.0, True), (1.02, True), (1.05, False), (3, False)],
)
def test_a_line_is_full_where_as_many_bytes_come_as_it_carries_and_not_more(share: float, is_full: bool) -> None:
    assert filled(share) == ["LINE_FULL"] * is_full
    monitor = LinkMonitor(100_000, bytes_per_s=10_000)
    chunks = [chunk(k / 100, bytes(round(100 * share))) for k in range(1200)]
    changes = monitor.received_all(chunks, range(1200), {})
    assert [(k, event.kind) for k, event in changes[2:]] == [(1000, "LINE_FULL")] * is_full


def test_a_line_is_not_full_by_a_short_burst_by_noise_nor_without_a_rate() -> None:
    assert filled(1.0, of=slice(900)) == []
    assert "LINE_FULL" not in filled(1.0, frames=0)
    assert filled(1.0, bytes_per_s=None) == []


def test_bytes_that_waited_while_the_computer_was_busy_fill_no_line() -> None:
    """A line that is 90 % full, of which 0.4 s of bytes come at once every 10 s."""
    monitor = LinkMonitor(100_000, bytes_per_s=10_000)
    events = []
    for k in range(6000):
        late = k % 1000 < 40
        if not late:
            data = bytes(90 * 41 if k % 1000 == 40 else 90)
            events += monitor.received(chunk(k / 100, data), 1, ())
    assert [event.kind for event in events] == [LinkKind.SYNCING, LinkKind.STREAMING]


def test_a_full_line_says_what_it_carries_and_what_came() -> None:
    monitor = LinkMonitor(100_000, bytes_per_s=10_000)
    events = [event for k in range(1200) for event in monitor.received(chunk(k / 100, bytes(98)), 1, ())]
    assert events[-1].text.startswith("the line carries 10,000 bytes/s at 100000 baud and 9,800 arrive: ")
