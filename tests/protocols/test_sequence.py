"""Sequence accounting: duplicates, gaps, wrap, late frames, resets."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from protocols import Arrival, SequenceTracker


def arrivals(*sequences: int, tracker: SequenceTracker | None = None) -> list[Arrival]:
    tracker = tracker or SequenceTracker()
    return [tracker.accept(sequence) for sequence in sequences]


def test_consecutive_numbers_are_next_across_the_wrap() -> None:
    tracker = SequenceTracker()
    assert arrivals(65534, 65535, 0, 1, tracker=tracker) == [Arrival.NEXT] * 4
    assert (tracker.lost, tracker.duplicates, tracker.resets) == (0, 0, 0)


def test_a_repeated_number_is_a_duplicate_and_counted() -> None:
    tracker = SequenceTracker()
    assert arrivals(7, 7, 8, tracker=tracker) == [Arrival.NEXT, Arrival.DUPLICATE, Arrival.NEXT]
    assert (tracker.duplicates, tracker.lost) == (1, 0)


def test_a_gap_is_counted_as_lost_frames_across_the_wrap_too() -> None:
    tracker = SequenceTracker()
    assert arrivals(65533, 2, tracker=tracker) == [Arrival.NEXT, Arrival.GAP]
    assert (tracker.lost, tracker.last_gap) == (4, 4)


def test_a_gap_of_more_than_half_a_turn_is_believed_when_the_clock_goes_on() -> None:
    tracker = SequenceTracker()
    tracker.accept(0, time_us=0)
    tracker.accept(1, time_us=100_000)
    assert tracker.accept(50_001, time_us=5_000_100_000, elapsed_s=5000.0) is Arrival.GAP
    assert tracker.lost == 49_999


def test_one_pair_of_numbers_a_few_apart_tells_no_period_and_a_second_does() -> None:
    tracker = SequenceTracker()
    tracker.accept(100, time_us=0)
    tracker.accept(104, time_us=100_000)
    assert tracker.accept(500, time_us=60_100_000) is Arrival.CHAOS
    tracker.accept(504, time_us=60_200_000)
    assert tracker.accept(904, time_us=70_200_000) is Arrival.GAP
    assert tracker.lost == 3 + 3 + 399


@pytest.mark.parametrize(("missing", "arrival"), [(140, Arrival.GAP), (170, Arrival.CHAOS)])
def test_a_pause_of_the_sensor_among_its_frames_is_not_its_period(missing: int, arrival: Arrival) -> None:
    """Nor are two frames that come close together: in 5 s and 10 s more 150 frames can be missing, and few more."""
    tracker = SequenceTracker()
    times_us = [0, 100_000, 200_000, 201_000, 300_000, 5_300_000, 5_400_000, 5_500_000]
    for sequence, time_us in enumerate(times_us):
        tracker.accept(sequence, time_us=time_us)
    assert tracker.accept(8 + missing, time_us=times_us[-1] + 10_000_000) is arrival


@pytest.mark.parametrize(("behind", "arrival"), [(64, Arrival.LATE), (65, Arrival.RESET)])
def test_a_straggler_is_known_sixty_four_numbers_later_and_no_more(behind: int, arrival: Arrival) -> None:
    tracker = SequenceTracker()
    arrivals(0, *range(2, 2 + behind), tracker=tracker)
    assert tracker.last == 1 + behind
    assert tracker.accept(1) is arrival
    assert (tracker.late, tracker.resets) == ((1, 0) if arrival is Arrival.LATE else (0, 1))


def test_a_number_that_goes_back_without_a_clock_is_a_restart_not_sixty_thousand_lost_frames() -> None:
    tracker = SequenceTracker()
    assert arrivals(500, 0, 1, tracker=tracker) == [Arrival.NEXT, Arrival.RESET, Arrival.NEXT]
    assert tracker.lost == 0


def test_a_clock_that_jumps_back_is_a_reset_and_no_frame_is_lost() -> None:
    tracker = SequenceTracker()
    tracker.accept(100, time_us=10_000_000)
    assert tracker.accept(0, time_us=50_000) is Arrival.RESET
    assert tracker.accept(1, time_us=150_000) is Arrival.NEXT
    assert (tracker.resets, tracker.lost) == (1, 0)


def test_a_clock_that_jumps_back_is_a_reset_even_where_the_number_goes_on_or_stays() -> None:
    for sequence in (100, 101):
        tracker = SequenceTracker()
        tracker.accept(100, time_us=10_000_000)
        assert tracker.accept(sequence, time_us=50_000) is Arrival.RESET


def test_the_sensors_own_word_is_a_reset() -> None:
    tracker = SequenceTracker()
    tracker.accept(100, time_us=10_000_000)
    assert tracker.accept(101, time_us=10_100_000, restarted=True) is Arrival.RESET


def test_a_copy_of_the_frame_that_told_of_a_reset_is_a_duplicate() -> None:
    tracker = SequenceTracker()
    tracker.accept(100, time_us=10_000_000)
    tracker.accept(0, time_us=50_000, restarted=True)
    assert tracker.accept(0, time_us=50_000, restarted=True) is Arrival.DUPLICATE
    assert (tracker.resets, tracker.duplicates) == (1, 1)


def test_a_frame_that_comes_after_its_successor_is_late_and_no_longer_lost() -> None:
    tracker = SequenceTracker()
    tracker.accept(5, time_us=500)
    tracker.accept(7, time_us=700)
    assert tracker.lost == 1
    assert tracker.accept(6, time_us=600) is Arrival.LATE
    assert tracker.accept(8, time_us=800) is Arrival.NEXT
    assert (tracker.lost, tracker.late, tracker.resets) == (0, 1, 0)


def test_a_copy_that_comes_after_another_frame_is_a_duplicate_not_a_reset() -> None:
    tracker = SequenceTracker()
    for sequence in (5, 6):
        tracker.accept(sequence, time_us=100 * sequence)
    assert tracker.accept(5, time_us=500) is Arrival.DUPLICATE
    assert tracker.accept(7, time_us=700) is Arrival.NEXT


def test_frames_without_a_clock_share_the_counter_with_those_that_have_one() -> None:
    tracker = SequenceTracker()
    assert tracker.accept(5, time_us=500) is Arrival.NEXT
    assert tracker.accept(6) is Arrival.NEXT
    assert tracker.accept(7, time_us=400) is Arrival.RESET


def test_a_number_that_was_lost_one_turn_ago_is_not_taken_for_a_late_frame() -> None:
    tracker = SequenceTracker(modulus=256)
    for sequence in (*range(10), *range(11, 256), *range(9)):
        tracker.accept(sequence)
    assert tracker.accept(10) is Arrival.GAP
    assert (tracker.lost, tracker.late) == (2, 0)


def test_a_protocol_without_numbers_knows_only_resets() -> None:
    tracker = SequenceTracker(modulus=0)
    assert [tracker.accept(-1, time_us=t) for t in (1, 2, 1)] == [Arrival.NEXT, Arrival.NEXT, Arrival.RESET]


@example(first=0, fates=[0] * 200, modulus=256)
@given(st.integers(0, 65535), st.lists(st.integers(0, 3), min_size=1, max_size=200), st.sampled_from([256, 65536]))
def test_sent_equals_received_plus_lost_less_duplicates(first: int, fates: list[int], modulus: int) -> None:
    """Each number is sent once: fate 0 loses it, 1 and 2 deliver it, 3 delivers it twice.

    The first two come, so that the sensor's period is known.
    """
    tracker = SequenceTracker(modulus)
    fates = [1, 1, *fates, 1]
    received = 0
    for number, fate in enumerate(fates):
        for _ in range((0, 1, 1, 2)[fate]):
            tracker.accept((first + number) % modulus, time_us=1000 * number)
            received += 1
    assert len(fates) == received - tracker.duplicates + tracker.lost
    assert tracker.duplicates == fates.count(3)
    assert tracker.resets == 0


def test_without_numbers_a_copy_with_the_same_time_is_a_duplicate_and_another_frame_is_none() -> None:
    tracker = SequenceTracker(0)
    found = [tracker.accept(-1, time_us=time_us, is_copy=lambda: True) for time_us in (10, 20, 20, 30)]
    assert found == [Arrival.NEXT, Arrival.NEXT, Arrival.DUPLICATE, Arrival.NEXT]
    assert tracker.accept(-1, time_us=30, is_copy=lambda: False) is Arrival.NEXT
    assert tracker.duplicates == 1


def test_numbers_that_go_on_in_steps_are_counted_in_steps() -> None:
    tracker = SequenceTracker(200, 2)
    found = [tracker.accept(n, elapsed_s=0.1) for n in (194, 196, 198, 0, 4, 6, 2)]
    assert found == [*[Arrival.NEXT] * 4, Arrival.GAP, Arrival.NEXT, Arrival.LATE]
    assert tracker.lost == 0
