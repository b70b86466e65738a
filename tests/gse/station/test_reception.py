"""Bytes become panoramas in UTC, and every byte is counted."""

import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.chunk import Chunk, LinkEvent
from gse.instant import LAST_NS
from gse.panorama import Panorama
from gse.station.arrivals import chaos_in_words
from gse.station.reception import News, Reception
from gse.station.sensor_clock import SensorClock
from protocols import PanoramaMessage, load_protocol
from protocols.frame_budget import SLACK

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
    assert len(reception.stream._stamps) <= 4096 // 100 + 2  # one discard


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
