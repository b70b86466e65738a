"""Bytes become panoramas in UTC, and every byte is counted."""

import math
import zlib
from dataclasses import replace
from datetime import UTC, date, datetime

import numpy as np
import pytest
from devices.float_protocol import DESCRIPTION
from devices.float_protocol import PROTOCOL as FLOATS
from hypothesis import given
from hypothesis import strategies as st

from drivers.chunk import Chunk, LinkEvent
from gse.station.reception import (
    HOTTEST_C,
    LONGEST_EXPOSURE_S,
    News,
    Reception,
    SensorClock,
    _brightest_first,
    chaos_in_words,
)
from gse.station.results import OwnAnswer
from gse.values.instant import LAST_NS
from gse.values.panorama import Panorama, Parts
from protocols import (
    Ack,
    AttitudeMessage,
    Frame,
    FrameDecoder,
    PanoramaMessage,
    StatusMessage,
    load_protocol,
    parse_protocol,
)
from protocols.description import DelayDescription, TimeDescription
from protocols.sequence import SLACK

PROTOCOL = load_protocol("panorama-v1")
Item = Panorama | News
BAUDRATE = 115200
BYTE_NS = 10 * 1_000_000_000 // BAUDRATE
EXPOSURE_S = 0.1
START_NS = 1_774_018_800_000_000_000
BOOTED_NS = 5_000_000_000


def frame(number: int, time_us: int, *, flags: frozenset[str] = frozenset()) -> bytes:
    message = PanoramaMessage(
        time_us=time_us,
        frame_no=number,
        exposure_s=EXPOSURE_S,
        flags=flags,
        temperature_c=20.0,
        xy_px=np.array([[10.0, 20.0], [30.0, 40.0]]),
        index=np.array([200.0, 100.0]),
    )
    return PROTOCOL.encode(message, sequence=number % 65536)


def arrival(time_us: int, late_ns: int = 0) -> tuple[int, int]:
    """UTC and monotonic stamps of the first byte of a frame exposed at ``time_us`` after START."""
    after_ns = time_us * 1000 + round(EXPOSURE_S / 2 * 1e9) + BYTE_NS + late_ns
    return START_NS + after_ns, BOOTED_NS + after_ns


def received(reception: Reception, *chunks: Chunk) -> list[Item]:
    frames = [found for chunk in chunks for found in reception.stream.feed(chunk)]
    return [*reception.receive(frames), *reception.receive(reception.stream.finish())]


def panoramas(items: list[Item]) -> list[Panorama]:
    return [item for item in items if isinstance(item, Panorama)]


def events(items: list[Item]) -> list[str]:
    return [item.kind for item in items if isinstance(item, LinkEvent)]


def test_mid_exposure_is_half_an_exposure_and_a_byte_before_the_first_byte() -> None:
    (panorama,) = panoramas(received(Reception(PROTOCOL, baudrate=BAUDRATE), Chunk(*arrival(0), frame(1, 0))))
    assert abs(panorama.utc_ns - START_NS) < 1000


def test_the_jitter_of_the_host_is_filtered_by_the_sensors_time_tag() -> None:
    random = np.random.default_rng(1)
    late_ns = random.uniform(20_000, 20_000_000, 400)
    chunks = [Chunk(*arrival(100_000 * n, int(late)), frame(n, 100_000 * n)) for n, late in enumerate(late_ns, start=1)]
    found = panoramas(received(Reception(PROTOCOL, baudrate=BAUDRATE), *chunks))
    errors_ns = [p.utc_ns - START_NS - 100_000_000 * n for n, p in enumerate(found, start=1)]
    assert max(errors_ns[200:]) < 500_000
    assert min(errors_ns) >= 0


def test_a_drifting_sensor_clock_is_followed() -> None:
    clock = SensorClock()
    for n in range(1000):
        true_ns = n * 1_000_000_000
        utc_ns = clock.utc_ns(round(true_ns / 1000 * (1 - 50e-6)), arrived_mono_ns=true_ns, utc_minus_mono_ns=0)
    assert abs(utc_ns - true_ns) < 2_000_000


@given(st.lists(st.integers(1, 300), max_size=12), st.binary(max_size=60))
def test_cuts_and_noise_change_no_panorama_and_lose_no_byte(cuts: list[int], noise: bytes) -> None:
    stream = frame(1, 100_000) + noise + frame(2, 200_000)
    stamps = arrival(100_000)
    places = sorted({min(sum(cuts[: n + 1]), len(stream)) for n in range(len(cuts))} | {len(stream)})
    pieces = [stream[a:b] for a, b in zip([0, *places], places, strict=False)]
    whole, cut = Reception(PROTOCOL, baudrate=BAUDRATE), Reception(PROTOCOL, baudrate=BAUDRATE)
    one = panoramas(received(whole, Chunk(*stamps, stream)))
    other = panoramas(received(cut, *(Chunk(*stamps, piece) for piece in pieces)))
    assert [(p.utc_ns, p.frame_no) for p in one] == [(p.utc_ns, p.frame_no) for p in other]
    assert whole.counters == cut.counters
    assert whole.counters.bytes_in == whole.counters.bytes_framed + whole.counters.bytes_discarded == len(stream)
    assert whole.stream.raw_sha256 == cut.stream.raw_sha256


@given(st.lists(st.integers(1, 12), min_size=3, max_size=12), st.integers(1, 5))
def test_frames_that_wait_together_bring_what_they_bring_one_by_one(numbers: list[int], at_once: int) -> None:
    """Copies, gaps and restarts among them."""
    data = [frame(number, 100_000 * number) for number in numbers]
    found = []
    for step in (1, at_once):
        reception = Reception(PROTOCOL, baudrate=BAUDRATE)
        frames = [
            at for place, one in enumerate(data) for at in reception.stream.feed(Chunk(*arrival(100_000 * place), one))
        ]
        items = [item for k in range(0, len(frames), step) for item in reception.receive(frames[k : k + step])]
        seen = [(p.utc_ns, p.frame_no, p.xy_px.tolist()) if isinstance(p, Panorama) else p for p in items]
        found.append((seen, reception.counters))
    assert found[0] == found[1]


def test_a_repeated_sequence_number_is_dropped_and_a_gap_is_counted() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    data = frame(1, 100_000) + frame(1, 100_000) + frame(5, 500_000)
    assert [p.frame_no for p in panoramas(received(reception, Chunk(*arrival(0), data)))] == [1, 5]
    assert (reception.counters.duplicates, reception.counters.frames_lost) == (1, 3)


@pytest.mark.parametrize(
    ("numbers", "frames_lost", "others_lost"),
    [
        ([(1, 1), (2, 2), (3, 3)], 0, 0),
        ([(1, 1), (3, 2), (4, 3)], 1, 1),
        ([(1, 1), (3, 3), (4, 4)], 1, 0),
        ([(1, 1), (5, 3), (7, 4)], 4, 3),
        ([(1, 1), (3, 5), (4, 6)], 1, 0),
        ([(1, 0), (3, 0), (5, 0)], 2, 0),
    ],
    ids=["none", "another frame", "a panorama", "both", "exposures not sent", "no numbers of exposures"],
)
def test_between_panoramas_of_consecutive_exposures_no_panorama_is_lost(
    numbers: list[tuple[int, int]], frames_lost: int, others_lost: int
) -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    for sequence, frame_no in numbers:
        message = PanoramaMessage(
            time_us=100_000 * sequence,
            frame_no=frame_no,
            exposure_s=EXPOSURE_S,
            flags=frozenset(),
            temperature_c=20.0,
            xy_px=np.zeros((0, 2)),
            index=np.zeros(0),
        )
        received(reception, Chunk(*arrival(100_000 * sequence), PROTOCOL.encode(message, sequence=sequence)))
    assert (reception.counters.frames_lost, reception.others_lost) == (frames_lost, others_lost)


@pytest.mark.parametrize("flags", [frozenset[str](), frozenset({"clock reset"})])
def test_a_sensor_that_starts_anew_is_an_event_and_its_clock_is_learned_again(flags: frozenset[str]) -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    later = arrival(60_000_000)
    items = received(
        reception,
        Chunk(*arrival(50_000_000), frame(500, 50_000_000)),
        Chunk(*later, frame(1, 1_000, flags=flags)),
    )
    assert "SENSOR_RESET" in events(items)
    assert reception.counters.sensor_resets == 1
    assert abs(panoramas(items)[1].utc_ns - START_NS - 60_000_000_000) < 1000


def test_a_step_of_the_hosts_clock_is_an_event_and_moves_no_frame_against_another() -> None:
    utc_ns, mono_ns = arrival(200_000)
    items = received(
        Reception(PROTOCOL, baudrate=BAUDRATE),
        Chunk(*arrival(100_000), frame(1, 100_000)),
        Chunk(utc_ns + 400_000_000, mono_ns, frame(2, 200_000)),
    )
    assert events(items) == ["CLOCK_STEP"]
    first, second = panoramas(items)
    assert second.utc_ns - first.utc_ns == 500_000_000


def test_the_frames_of_a_raw_capture_follow_the_sensors_clock_from_the_instant_given() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE, anchor_utc_ns=START_NS)
    items = received(reception, Chunk(START_NS, 0, frame(1, 7_000_000) + frame(2, 7_100_000)))
    assert [p.utc_ns for p in panoramas(items)] == [START_NS, START_NS + 100_000_000]


def anchored(*frames: bytes) -> list[float]:
    """Seconds after START of the panoramas of a raw capture."""
    reception = Reception(PROTOCOL, baudrate=BAUDRATE, anchor_utc_ns=START_NS)
    items = received(reception, Chunk(START_NS, 0, b"".join(frames)))
    return [(p.utc_ns - START_NS) / 1e9 for p in panoramas(items)]


def test_in_a_raw_capture_a_clock_that_leaps_by_centuries_moves_no_later_panorama() -> None:
    leaps = [1, 2**64 - 1, 3, 2**53 - 1, 5]
    frames = [frame(number, time_us) for number, time_us in enumerate(leaps, 1)]
    assert anchored(*frames, frame(6, 100_005)) == [0, 0, 0, 0, 0, 0.1]


def test_in_a_raw_capture_a_clock_pauses_for_a_year_at_most() -> None:
    year_s = 366 * 86_400
    assert anchored(frame(1, 0), frame(2, year_s * 10**6)) == [0, year_s]
    assert anchored(frame(1, 0), frame(2, (year_s + 1) * 10**6)) == [0, 0]


def test_in_a_raw_capture_a_sensor_that_starts_anew_later_than_the_anchor_never_steps_back() -> None:
    assert anchored(frame(500, 10_000_000), frame(501, 100_000_000), frame(1, 12_000_000)) == [0, 90, 90]


def test_in_a_raw_capture_stored_data_older_than_the_anchor_leave_the_anchor_alone() -> None:
    stored = bytearray(frame(2, 50_000_000))
    stored[5] = 1
    stored[-4:] = zlib.crc32(stored[4:-4]).to_bytes(4, "big")
    assert anchored(frame(1, 100_000_000), bytes(stored), frame(3, 101_000_000)) == [0, -50, 1]


def test_a_raw_capture_has_no_host_times_and_its_events_stand_where_they_happened() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE, anchor_utc_ns=START_NS)
    data = frame(500, 10_000_000) + frame(501, 100_000_000) + frame(1, 1_000)
    items = received(reception, Chunk(START_NS, 0, data))
    assert [p.host_utc_ns for p in panoramas(items)] == [0, 0, 0]
    (reset,) = [item for item in items if isinstance(item, LinkEvent)]
    assert reset.utc_ns == START_NS + 90_000_000_000


def test_an_index_over_the_maximum_is_a_problem_of_the_panorama_not_of_the_link() -> None:
    data = bytearray(frame(1, 1))
    first_index = 10 + 22 + 4
    data[first_index : first_index + 2] = (5000).to_bytes(2, "big")
    data[-4:] = zlib.crc32(data[4:-4]).to_bytes(4, "big")
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    (panorama,) = panoramas(received(reception, Chunk(*arrival(0), bytes(data))))
    assert "5000" in panorama.problems[0]
    assert reception.counters.bytes_discarded == 0


def test_objects_that_come_unsorted_are_brightest_first_in_the_panorama() -> None:
    message = PanoramaMessage(
        time_us=1,
        frame_no=1,
        exposure_s=EXPOSURE_S,
        flags=frozenset(),
        temperature_c=20.0,
        xy_px=np.array([[10.0, 20.0], [30.0, 40.0]]),
        index=np.array([100.0, 200.0]),
    )
    chunk = Chunk(*arrival(0), PROTOCOL.encode(message, sequence=1))
    (panorama,) = panoramas(received(Reception(PROTOCOL, baudrate=BAUDRATE), chunk))
    assert panorama.brightness.tolist() == [200, 100]
    assert panorama.xy_px.tolist() == [[30, 40], [10, 20]]


def lost_of(numbers: list[int]) -> tuple[int, list[str]]:
    """Frames counted as lost, and the events, where frames of these sequence numbers come at 10 Hz."""
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    chunks = [
        Chunk(*arrival(100_000 * place), frame(number, 100_000 * place))
        for place, number in enumerate(numbers, start=1)
    ]
    items = received(reception, *chunks)
    return reception.counters.frames_lost, events(items)


@given(st.lists(st.integers(0, 65535), min_size=2, max_size=60))
def test_never_more_frames_count_as_lost_than_can_have_been_sent(numbers: list[int]) -> None:
    lost, _ = lost_of(numbers)
    # The period may be taken for as short as a step of eight sequence numbers says.
    assert lost <= 8 * len(numbers) + SLACK


def test_sequence_numbers_without_sense_are_an_event_and_no_losses() -> None:
    rng = np.random.default_rng(2)
    numbers = [*range(1, 20), *rng.integers(0, 65536, 173).tolist()]
    lost, told = lost_of(numbers)
    assert lost <= SLACK
    assert told.count("SEQUENCE_CHAOS") > 150


def test_an_outage_of_ten_minutes_is_counted_frame_by_frame() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    places = [*range(1, 30), *range(6030, 6040)]
    chunks = [Chunk(*arrival(100_000 * place), frame(place, 100_000 * place)) for place in places]
    assert events(received(reception, *chunks)) == []
    assert reception.counters.frames_lost == 6000


def test_stamps_and_tags_that_no_clock_has_are_kept_within_what_an_instant_can_be() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    last = 2**64 - 1
    stamps = [(last, 0), (0, last), (last, last), (5, 5), arrival(300_000)]
    chunks = [Chunk(*stamp, frame(place, 100_000 * place)) for place, stamp in enumerate(stamps, start=1)]
    found = panoramas(received(reception, *chunks))
    assert len(found) == len(stamps)
    assert all(0 <= panorama.utc_ns <= LAST_NS and 0 <= panorama.host_utc_ns <= LAST_NS for panorama in found)


def test_noise_leaves_no_stamps_behind() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    rng = np.random.default_rng(3)
    for number in range(2000):
        reception.stream.feed(Chunk(START_NS + number, number, rng.bytes(100)))
    assert len(reception.stream._chunks) <= 4096 // 100 + 2  # one discard


def frozen_after_5() -> tuple[Reception, list[Item]]:
    """Ten seconds at 10 Hz, of which the last nine and a half bring the same frame again and again."""
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    chunks = [
        Chunk(*arrival(number * 100_000), frame(min(number, 5), min(number, 5) * 100_000)) for number in range(100)
    ]
    return reception, received(reception, *chunks)


def test_a_frozen_sensor_is_an_event_and_its_copies_are_counted_as_missing() -> None:
    reception, items = frozen_after_5()
    assert len(panoramas(items)) == 6
    assert events(items) == ["FROZEN"]
    assert reception.counters.frames_repeated == reception.counters.duplicates == 94


def test_a_line_that_doubles_every_frame_is_not_a_frozen_sensor() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    chunks = [Chunk(*arrival(number * 100_000), 2 * frame(number, number * 100_000)) for number in range(20)]
    items = received(reception, *chunks)
    assert (events(items), reception.counters.duplicates, reception.counters.frames_repeated) == ([], 20, 0)


@pytest.mark.parametrize(
    ("before", "words"), [(7, "another frame 7: its sequence number stands still"), (900, "frame 900: more than can")]
)
def test_why_a_sequence_number_makes_no_sense_is_told(before, words):
    assert f"frame 7 on the wire follows {words}" in chaos_in_words(7, before)


# Instants to the nanosecond, and what comes beside panoramas

OWN = """
version: 1
name: own
byte_order: little
framing: {kind: slip}
header: [{name: type, type: u8}]
checksum: {name: crc32}
messages:
  ATTITUDE:
    code: 3
    direction: from sensor
    fields:
      - {name: time, type: u64, unit: us}
      - {name: frame_no, type: u32}
      - {name: ra, type: f64, unit: deg}
      - {name: de, type: f64, unit: deg}
      - {name: state, type: u8, values: {0: lost, 1: acquired}}
      - {name: latency, type: f64, unit: s}
"""


def own(time_us: int, latency_s: float = 0.25) -> AttitudeMessage:
    return AttitudeMessage(
        time_us, ra_deg=10.0, de_deg=20.0, roll_deg=30.0, frame_no=7, state="acquired", latency_s=latency_s
    )


def at_exposure(number: int, exposure_s: float, temperature_c: float = 20.0) -> bytes:
    message = PanoramaMessage(number, number, exposure_s, frozenset(), temperature_c, np.zeros((0, 2)), np.zeros(0))
    return FLOATS.encode(message, sequence=number)


@pytest.mark.parametrize(
    ("exposure_s", "half_ns"),
    [
        *((0.0, 0), (0.25, 125_000_000), (LONGEST_EXPOSURE_S, round(LONGEST_EXPOSURE_S / 2 * 1e9))),
        *((invalid, 0) for invalid in (LONGEST_EXPOSURE_S + 0.5, -0.25, math.nan, math.inf)),
    ],
)
def test_a_panorama_is_half_an_exposure_and_a_byte_before_it_came_and_without_a_valid_one_a_byte(
    exposure_s: float, half_ns: int
) -> None:
    """A byte of ten bits takes 1 ms at 10,000 baud."""
    reception = Reception(FLOATS, baudrate=10_000)
    (panorama,) = panoramas(received(reception, Chunk(START_NS, BOOTED_NS, at_exposure(1, exposure_s))))
    assert panorama.utc_ns == START_NS - 1_000_000 - half_ns
    assert panorama.host_utc_ns == START_NS
    is_valid = 0 <= exposure_s <= LONGEST_EXPOSURE_S
    assert panorama.exposure_s == pytest.approx(exposure_s if is_valid else math.nan, nan_ok=True)


@pytest.mark.parametrize(
    ("came_c", "is_kept"),
    [(0.0, True), *((sign * of * HOTTEST_C, of == 1) for sign in (1, -1) for of in (1, 1.001))],
)
def test_a_temperature_beyond_a_million_degrees_is_none(came_c: float, is_kept: bool) -> None:
    reception = Reception(FLOATS, baudrate=BAUDRATE)
    (panorama,) = panoramas(received(reception, Chunk(START_NS, BOOTED_NS, at_exposure(1, 0.1, came_c))))
    assert panorama.temperature_c == pytest.approx(came_c if is_kept else math.nan, nan_ok=True)


@pytest.mark.parametrize(
    ("latency_s", "before_ns"),
    [
        *((0.25, 250_000_000), (0.0, 0), (LONGEST_EXPOSURE_S, round(LONGEST_EXPOSURE_S * 1e9))),
        *((LONGEST_EXPOSURE_S + 0.5, 0), (-0.25, 0), (math.nan, 0)),
    ],
)
def test_an_answer_of_a_sensor_without_panoramas_is_its_processing_time_and_a_byte_before_it_came(
    latency_s: float, before_ns: int
) -> None:
    protocol = parse_protocol(OWN, "own")
    reception = Reception(protocol, baudrate=10_000)
    (answer,) = received(reception, Chunk(START_NS, BOOTED_NS, protocol.encode(own(5, latency_s), 0)))
    assert isinstance(answer, OwnAnswer)
    assert (answer.host_utc_ns, answer.sequence) == (START_NS, 0)
    assert answer.utc_ns == START_NS - 1_000_000 - before_ns


def test_an_answer_beside_panoramas_has_no_instant_of_its_own_and_its_number() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    items = received(reception, Chunk(START_NS, BOOTED_NS, frame(1, 5) + PROTOCOL.encode(own(5), 2)))
    assert [type(item) for item in items] == [Panorama, OwnAnswer]
    assert (items[1].utc_ns, items[1].host_utc_ns, items[1].sequence) == (None, START_NS, 2)
    assert items[0].sequence == 1


def status(time_us: int = 5) -> StatusMessage:
    return StatusMessage(time_us, temperature_c=20.0, supply_v=5.0, mode="streaming", firmware=(1, 2, 3), serial=1)


def test_news_stand_in_their_order_with_the_number_of_panoramas_before_them() -> None:
    """A STATUS bears the instant of its last byte; copies are dropped."""
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    data = PROTOCOL.encode(status(), 1) + frame(2, 5) + frame(3, 6) + PROTOCOL.encode(Ack("START", 9), 4)
    frames = [
        *reception.stream.feed(Chunk(START_NS, BOOTED_NS, data[:5])),
        *reception.stream.feed(Chunk(START_NS + 700, BOOTED_NS + 700, data[5:] + PROTOCOL.encode(Ack("START", 9), 4))),
    ]
    event = LinkEvent(START_NS, 0, "NOTE", "clouds")
    got = reception.receive([*frames[:2], event, *frames[2:]])
    places = [(before, type(item)) for before, item in got.news]
    assert places == [(0, tuple), (1, LinkEvent), (2, Ack)]
    assert got.news[0][1] == (START_NS + 700, status())
    assert [p.frame_no for p in got.panoramas] == [2, 3]
    assert [type(item) for item in got] == [tuple, Panorama, LinkEvent, Panorama, Ack]
    assert reception.counters.duplicates == 1


def test_the_time_of_a_status_tells_a_host_that_slept_and_no_restart() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    first, slept = Chunk(START_NS, BOOTED_NS, PROTOCOL.encode(status(50_000_000), 1)), 15 * 10**9
    later = Chunk(START_NS + slept, BOOTED_NS, PROTOCOL.encode(status(65_000_000), 2))
    back = Chunk(START_NS + slept + 10, BOOTED_NS + 10, PROTOCOL.encode(status(3), 3))
    (step,) = [item for item in received(reception, first, later, back) if isinstance(item, LinkEvent)]
    assert (step.kind, step.utc_kept, step.step_ns) == ("CLOCK_STEP", True, slept)
    assert reception.counters.sensor_resets == 0


@pytest.mark.parametrize(("tag_us", "late_ns"), [(15_000_000, 0), (0, 900_000)])
def test_after_a_host_slept_the_clock_of_the_sensor_is_learned_anew_and_after_a_step_of_utc_it_is_not(
    tag_us: int, late_ns: int
) -> None:
    """The first panorama came 1 ms late, the second 0.1 ms, the third 1 ms after a step of 15 s."""
    reception, made = Reception(PROTOCOL, baudrate=BAUDRATE), []
    for number, time_us, late, slept_s in ((1, 0, 1_000_000, 0), (2, 100_000, 100_000, 0), (3, 200_000, 1_000_000, 15)):
        utc_ns, mono_ns = arrival(time_us, late)
        tag = time_us + tag_us * (slept_s > 0)
        made += panoramas(received(reception, Chunk(utc_ns + slept_s * 10**9, mono_ns, frame(number, tag))))
    told_ns = made[2].utc_ns - START_NS - 200_000_000 - 15 * 10**9
    assert abs(told_ns - (1_000_000 - late_ns)) < 20


def test_only_an_answer_of_a_sensor_without_panoramas_tells_a_restart_by_its_time() -> None:
    protocol = parse_protocol(OWN, "own")
    reception = Reception(protocol, baudrate=BAUDRATE)
    chunks = [Chunk(*arrival(time_us), protocol.encode(own(tag), 0)) for time_us, tag in ((0, 9_000_000), (10**6, 5))]
    assert events(received(reception, *chunks)) == ["SENSOR_RESET"]
    beside = Reception(PROTOCOL, baudrate=BAUDRATE)
    chunks = [
        Chunk(*arrival(time_us), PROTOCOL.encode(own(tag), number))
        for number, time_us, tag in ((1, 0, 9_000_000), (2, 10**6, 5))
    ]
    assert events(received(beside, *chunks)) == []


def test_a_restart_is_told_with_its_frame_and_its_instants() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    later = arrival(60_000_000)
    items = received(reception, Chunk(*arrival(50_000_000), frame(500, 50_000_000)), Chunk(*later, frame(1, 1_000)))
    (reset,) = [item for item in items if isinstance(item, LinkEvent)]
    assert (reset.utc_ns, reset.mono_ns) == later
    assert reset.text == "the sensor started anew: frame 1 on the wire, its clock or counter jumped back"


def test_a_raw_capture_may_begin_in_1970() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE, anchor_utc_ns=0)
    items = received(reception, Chunk(START_NS, 0, frame(1, 7_000_000) + frame(2, 7_100_000)))
    assert [p.utc_ns for p in panoramas(items)] == [0, 100_000_000]
    protocol = parse_protocol(OWN, "own")
    captured = Reception(protocol, baudrate=BAUDRATE, anchor_utc_ns=0)
    (answer,) = received(captured, Chunk(START_NS, 0, protocol.encode(own(7_000_000), 0)))
    assert (answer.utc_ns, answer.host_utc_ns) == (0, 0)


def test_numbers_that_make_no_sense_in_a_raw_capture_stand_at_its_latest_instant() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE, anchor_utc_ns=START_NS)
    data = [frame(number, 100_000 * number) for number in (1, 2, 3)] + [frame(3, 400_000)]
    (chaos,) = [item for item in received(reception, Chunk(5, 0, b"".join(data))) if isinstance(item, LinkEvent)]
    assert (chaos.kind, chaos.utc_ns) == ("SEQUENCE_CHAOS", START_NS + 200_000_000)
    assert chaos.text == "frame 3 on the wire follows another frame 3: its sequence number stands still"


@pytest.mark.parametrize(
    ("index", "counts", "order"),
    [
        ([], [], []),
        ([3, 2, 1], [3], [0, 1, 2]),
        ([9, 3, 5], [3], [0, 2, 1]),
        ([1, 2, 3], [3], [2, 1, 0]),
        ([5, 7, 7, 5], [4], [1, 2, 0, 3]),
        ([9, 8, 10, 2], [2, 2], [0, 1, 2, 3]),
        ([8, 9, 10, 2], [2, 2], [1, 0, 2, 3]),
        ([3, 1, 2], [2, 0, 1], [0, 1, 2]),
        ([1, 2], [1, 1], [0, 1]),
    ],
)
def test_objects_stand_brightest_first_within_their_panorama_and_equal_ones_as_they_came(index, counts, order) -> None:
    found = _brightest_first(np.array(index, dtype=float), Parts.of_counts(counts))
    assert np.arange(len(index))[found].tolist() == order


def test_panoramas_keep_the_rows_of_their_objects_on_the_wire() -> None:
    """The second of three messages is a copy, whose objects belong to nobody."""
    index = [[1.0, 3.0, 2.0], [9.0, 9.0], [5.0, 6.0]]
    messages = []
    for number, one in enumerate(index):
        xy_px = np.array([[number, number + row] for row in range(len(one))], dtype=float)
        messages.append(PanoramaMessage(number, number, 0.1, frozenset(), 20.0, xy_px, np.array(one)))
    frames = [PROTOCOL.encode(messages[k], sequence=k) for k in (0, 2)]
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    first, last = panoramas(received(reception, Chunk(*arrival(0), frames[0] + frames[0] + frames[1])))
    assert (first.brightness.tolist(), first.wire_rows.tolist()) == ([3.0, 2.0, 1.0], [1, 2, 0])
    assert (last.brightness.tolist(), last.wire_rows.tolist()) == ([6.0, 5.0], [1, 0])
    assert last.xy_px[:, 1].tolist() == [3.0, 2.0]


def test_copies_alone_bring_nothing() -> None:
    reception = Reception(PROTOCOL, baudrate=BAUDRATE)
    (first,) = panoramas(received(reception, Chunk(*arrival(0), frame(1, 5))))
    again = reception.receive(reception.stream.feed(Chunk(*arrival(1000), frame(1, 5))))
    assert (list(again), len(again.panoramas), first.frame_no) == ([], 0, 1)


@pytest.mark.parametrize("number", [0, 1, 65_535])
def test_a_panorama_bears_its_number_on_the_wire(number: int) -> None:
    message = PanoramaMessage(5, 7, EXPOSURE_S, frozenset(), 20.0, np.zeros((0, 2)), np.zeros(0))
    chunk = Chunk(*arrival(0), PROTOCOL.encode(message, number))
    (panorama,) = panoramas(received(Reception(PROTOCOL, baudrate=BAUDRATE), chunk))
    assert panorama.sequence == number


def test_a_panorama_of_a_wire_without_numbers_bears_number_zero() -> None:
    protocol = parse_protocol(DESCRIPTION.replace("  - {name: sequence, type: u16}\n", ""), "floats")
    message = PanoramaMessage(5, 7, EXPOSURE_S, frozenset(), 20.0, np.zeros((0, 2)), np.zeros(0))
    (panorama,) = panoramas(
        received(Reception(protocol, baudrate=BAUDRATE), Chunk(*arrival(0), protocol.encode(message, 0)))
    )
    assert panorama.sequence == 0


def test_a_stream_is_a_test_from_the_first_frame_that_says_so() -> None:
    message = PROTOCOL.decode(next(iter(_frames_of(frame(1, 100_000)))))
    marked = [PROTOCOL.encode(message, sequence=number, flags=PROTOCOL.test_flag) for number in (3, 4)]
    data = frame(1, 100_000), frame(2, 200_000), *marked
    chunks = [Chunk(*arrival(100_000 * place), one) for place, one in enumerate(data, start=1)]
    assert events(received(Reception(PROTOCOL, baudrate=BAUDRATE), *chunks[:2])) == []
    items = received(Reception(PROTOCOL, baudrate=BAUDRATE), *chunks)
    assert [kind for kind in events(items) if kind != "SENSOR_RESET"] == ["TEST_STREAM"]


def _frames_of(data: bytes) -> list[Frame]:
    return [piece for piece in FrameDecoder(PROTOCOL).feed(data) if isinstance(piece, Frame)]


def times_of(
    tag_us_of_middle: int, *, delay_ns: int, time: TimeDescription, flags: frozenset[str] = frozenset()
) -> int:
    """How far the UTC of 30 exposures is off whose tags are so far from their middle, and which come so late."""
    chunks = [
        Chunk(*arrival(100_000 * n, delay_ns), frame(n, 100_000 * n + tag_us_of_middle, flags=flags))
        for n in range(1, 31)
    ]
    found = panoramas(received(Reception(PROTOCOL, baudrate=BAUDRATE, time=time), *chunks))
    off_ns = [panorama.utc_ns - START_NS - 100_000_000 * n for n, panorama in enumerate(found, start=1)]
    assert max(off_ns) - min(off_ns) < 1000
    return off_ns[0]


STATED = DelayDescription(value=85, uncertainty=10)


@pytest.mark.parametrize(
    ("time", "tag_us"),
    [
        (TimeDescription(delay_ms=STATED), 0),
        (TimeDescription(tag_of="start", delay_ms=STATED), -50_000),
        (TimeDescription(tag_of="end", delay_ms=STATED), 50_000),
        (TimeDescription(tag_of="sent", delay_ms=STATED), 135_000),
        (TimeDescription(scale="host", delay_ms=STATED), 12_345),
    ],
)
def test_a_stated_delay_is_taken_off_whatever_moment_the_tag_tells(time: TimeDescription, tag_us: int) -> None:
    assert abs(times_of(tag_us, delay_ns=85_000_000, time=time)) < 1000


def test_a_delay_that_is_not_stated_moves_nothing() -> None:
    assert times_of(0, delay_ns=85_000_000, time=TimeDescription()) == pytest.approx(85_000_000, abs=1000)


def test_an_absolute_clock_is_its_own_truth_unless_it_is_not_locked() -> None:
    """Its tags count from the begin of the session here, and the host's clock is 7 s fast."""
    epoch = datetime(2026, 3, 20, 15, tzinfo=UTC)
    assert epoch.timestamp() * 10**9 == START_NS
    time = TimeDescription(scale="utc", epoch=epoch)
    assert times_of(0, delay_ns=7_000_000_000, time=time) == 0
    chunks = [Chunk(*arrival(100_000 * n, 7_000_000_000), frame(n, 100_000 * n)) for n in range(1, 31)]
    assert events(received(Reception(PROTOCOL, baudrate=BAUDRATE, time=time), *chunks)) == ["SENSOR_CLOCK"]


def test_an_absolute_clock_that_is_not_locked_is_a_counter() -> None:
    text = DESCRIPTION.replace(
        "      - {name: frame_no",
        "      - {name: status, type: u8, bits: {0: clock not locked}}\n      - {name: frame_no",
    )
    protocol = parse_protocol(text, "locked.yaml")
    reception = Reception(protocol, baudrate=BAUDRATE, time=TimeDescription(scale="utc", epoch=date(2020, 1, 1)))
    message = replace(PanoramaMessage.empty(), time_us=50_000, flags=frozenset({"clock not locked"}))
    (panorama,) = panoramas(received(reception, Chunk(*arrival(0), protocol.encode(message, 1))))
    assert abs(panorama.utc_ns - START_NS) < 50_000_000
    assert reception.is_unlocked
