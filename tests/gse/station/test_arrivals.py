"""Steps of the host's clock between two frames, told by three clocks."""

import pytest

from drivers.chunk import LinkEvent
from gse.station.byte_stream import FrameAt
from gse.station.events import StationKind
from gse.station.reception import Arrivals, chaos_in_words
from gse.station.results import LinkCounters
from gse.values.instant import NS_PER_S
from protocols import Arrival, Frame, load_protocol

FRAME = Frame(0, 40, "PANORAMA", 0, 1, b"", 40)
START_NS = 1_774_018_800 * NS_PER_S


# Limits of a step, to the nanosecond


def step_of(utc_ns, mono_ns, tag_us=None, *, has_times=True):
    """The step between two frames between which the clocks went on by so much."""
    arrivals = Arrivals(load_protocol("panorama-v1"), LinkCounters(), has_times=has_times)
    arrivals.clock_step(FrameAt(FRAME, START_NS, 10**13, 0, 0), 10**9)
    return arrivals.clock_step(
        FrameAt(FRAME, START_NS + utc_ns, 10**13 + mono_ns, 0, 0), None if tag_us is None else 10**9 + tag_us
    )


def test_stamps_that_no_clock_has_show_no_step():
    assert step_of(600 * NS_PER_S, NS_PER_S // 10, 100_000, has_times=False) is None


@pytest.mark.parametrize(
    ("utc_ns", "mono_ns", "is_step"),
    [
        (4_999_999, 0, False),
        (5_000_000, 0, True),
        (-4_999_999, 0, False),
        (-5_000_000, 0, True),
        (10 * NS_PER_S + 14_999_999, 10 * NS_PER_S, False),  # 10 s may be slewed by 10 ms
        (10 * NS_PER_S + 15_000_000, 10 * NS_PER_S, True),
        (100 * NS_PER_S + 54_999_999, 100 * NS_PER_S, False),  # and any time by 50 ms
        (100 * NS_PER_S + 55_000_000, 100 * NS_PER_S, True),
        (100 * NS_PER_S - 54_999_999, 100 * NS_PER_S, False),
        (100 * NS_PER_S - 55_000_000, 100 * NS_PER_S, True),
        (0, -4_999_999, False),  # a monotonic clock that goes back slews nothing
        (0, -5_000_000, True),
        (-10 * NS_PER_S + 4_999_999, -10 * NS_PER_S, False),
        (-10 * NS_PER_S + 5_000_000, -10 * NS_PER_S, True),
    ],
)
def test_a_clock_that_moves_by_five_milliseconds_and_what_may_be_slewed_was_stepped(utc_ns, mono_ns, is_step):
    step = step_of(utc_ns, mono_ns)
    assert (step is not None) is is_step
    if step is not None:
        assert (step.step_ns, step.utc_ns, step.mono_ns) == (utc_ns - mono_ns, START_NS + utc_ns, 10**13 + mono_ns)
        assert step.kind is StationKind.CLOCK_STEP


@pytest.mark.parametrize(
    ("utc_ns", "mono_ns", "tag_us", "utc_kept"),
    [
        (NS_PER_S, 0, 1_000_000, True),
        (NS_PER_S - 1000, 0, 999_999, False),  # too short for a suspension
        (-NS_PER_S, 0, 0, False),
        (0, NS_PER_S, 0, True),
        (0, NS_PER_S - 1, 0, False),
        (10 * NS_PER_S, 0, 5_000_001, True),
        (10 * NS_PER_S, 0, 5_000_000, False),  # as near to the one as to the other
        (10 * NS_PER_S, 0, 4_999_999, False),
        (10 * NS_PER_S, 0, 0, False),
        (10 * NS_PER_S, 0, -1, False),  # the sensor began anew
        (-10 * NS_PER_S, 0, -10_000_000, False),
        (10 * NS_PER_S, 0, None, False),
        (0, 10 * NS_PER_S, -1, False),
    ],
)
def test_utc_was_right_where_the_sensors_clock_went_on_rather_as_it_did(utc_ns, mono_ns, tag_us, utc_kept):
    assert step_of(utc_ns, mono_ns, tag_us).utc_kept is utc_kept


def test_a_frame_after_one_without_a_time_tag_tells_no_suspension():
    arrivals = Arrivals(load_protocol("panorama-v1"), LinkCounters(), has_times=True)
    arrivals.clock_step(FrameAt(FRAME, START_NS, 0, 0, 0), None)
    assert arrivals.clock_step(FrameAt(FRAME, START_NS + 15 * NS_PER_S, 0, 0, 0), 15_000_000).utc_kept is False


@pytest.mark.parametrize(
    ("utc_ns", "mono_ns", "tag_us", "text"),
    [
        (
            2_500_000_000,
            0,
            2_500_000,
            "the host was suspended: its monotonic clock stood still for 2.500 s, in which UTC and the sensor's clock "
            "went on",
        ),
        (0, 2_500_000_000, 0, "the host's monotonic clock leapt by +2.500 s; UTC and the sensor's clock did not"),
        (-2_500_000_000, 0, 0, "the host's UTC clock stepped by -2.500 s"),
        (5_000_000, 0, None, "the host's UTC clock stepped by +0.005 s"),
    ],
)
def test_a_step_is_told_whole_in_the_words_of_the_clock_that_made_it(utc_ns, mono_ns, tag_us, text):
    assert step_of(utc_ns, mono_ns, tag_us).text == text


# Frames by their sequence numbers


def accepted(arrivals, sequence, payload=b"", second=0.0, *, tag_us=None, flags=0, restarted=False):
    frame = Frame(0, 40, "PANORAMA", flags, sequence, payload, 40)
    return arrivals.accept(frame, round(second * NS_PER_S), tag_us, restarted=restarted)


def arrivals_of(*, has_times=True):
    counters = LinkCounters()
    return Arrivals(load_protocol("panorama-v1"), counters, has_times=has_times), counters


def after_others(arrivals, others, payload):
    """The class of frame 7 that comes again as ``payload`` after so many other frames."""
    for number in range(others):
        assert accepted(arrivals, 8 + number, b"%d" % number) is Arrival.NEXT
    return accepted(arrivals, 7, payload)


@pytest.mark.parametrize("others", [0, 1, 62, 63])
@pytest.mark.parametrize(("payload", "arrival"), [(b"same", Arrival.DUPLICATE), (b"other", Arrival.CHAOS)])
def test_a_number_comes_again_as_a_copy_where_its_bytes_are_among_those_of_the_latest_sixty_four_frames(
    others, payload, arrival
):
    arrivals, counters = arrivals_of()
    accepted(arrivals, 7, b"same")
    assert after_others(arrivals, others, payload) is arrival
    assert counters.duplicates == (arrival is Arrival.DUPLICATE)


def test_a_number_that_comes_again_later_is_a_restart():
    arrivals, counters = arrivals_of()
    accepted(arrivals, 7, b"same")
    assert after_others(arrivals, 64, b"same") is Arrival.RESET
    assert counters.duplicates == 0


def test_of_two_copies_the_later_one_counts():
    arrivals, counters = arrivals_of()
    assert [accepted(arrivals, 7, b"same") for _ in range(2)] == [Arrival.NEXT, Arrival.DUPLICATE]
    assert after_others(arrivals, 63, b"same") is Arrival.DUPLICATE
    assert counters.duplicates == 2


def test_a_number_that_comes_again_with_other_bytes_is_no_copy():
    arrivals, counters = arrivals_of()
    found = [accepted(arrivals, 7, payload, tag_us=5) for payload in (b"one", b"one", b"other")]
    assert found == [Arrival.NEXT, Arrival.DUPLICATE, Arrival.CHAOS]
    assert (counters.duplicates, counters.frames_lost, counters.sensor_resets) == (1, 0, 0)
    assert arrivals.before == 7


@pytest.mark.parametrize(("late_s", "arrival"), [(100.0, Arrival.GAP), (1.0, Arrival.CHAOS)])
@pytest.mark.parametrize("doubled", [False, True])
def test_the_hosts_time_since_the_frame_before_bounds_what_can_be_lost_whatever_copies_came_between(
    late_s, arrival, doubled
):
    """One frame a second by the sensor's clock; then 100 are missing, and the copy of the last comes late."""
    arrivals, counters = arrivals_of()
    for number in range(3):
        accepted(arrivals, number, b"%d" % number, float(number), tag_us=number * 10**6)
    if doubled:
        assert accepted(arrivals, 2, b"2", 1.9 + late_s, tag_us=2 * 10**6) is Arrival.DUPLICATE
    assert accepted(arrivals, 102, b"102", 2.0 + late_s) is arrival
    assert counters.frames_lost == (99 if arrival is Arrival.GAP else 0)


def test_stamps_that_mean_nothing_bound_no_loss():
    """The sensor's own clock does: it stands still."""
    arrivals, counters = arrivals_of(has_times=False)
    for number in range(3):
        accepted(arrivals, number, b"%d" % number, 0.0, tag_us=number * 10**6)
    assert accepted(arrivals, 102, b"102", 1000.0, tag_us=2 * 10**6 + 1) is Arrival.CHAOS
    assert counters.frames_lost == 0


@pytest.mark.parametrize(("flags", "arrival"), [(0, Arrival.RESET), (1, Arrival.NEXT), (2, Arrival.RESET)])
def test_a_stored_frame_looks_never_like_a_restart(flags, arrival):
    """Its clock is older, and it may still bear the word of a restart."""
    for tag_us, restarted in ((4, False), (6, True)):
        arrivals, counters = arrivals_of()
        accepted(arrivals, 1, b"1", tag_us=5)
        assert accepted(arrivals, 2, b"2", tag_us=tag_us, flags=flags, restarted=restarted) is arrival
        assert counters.sensor_resets == (arrival is Arrival.RESET)


def test_the_third_copy_in_a_row_is_an_event_with_three_frames_and_each_later_one_counts_for_itself():
    arrivals, counters = arrivals_of()
    frame = Frame(0, 40, "PANORAMA", 0, 9, b"", 40)
    arrivals.accept(frame, 0, None, restarted=False)
    arrivals.new_panorama(70)
    told, counted = [], []
    for number in range(1, 6):
        told.append(arrivals.repeated(frame, 70, 1000 + number, 2000 + number))
        counted.append(counters.frames_repeated)
    assert counted == [0, 0, 3, 4, 5]
    text = "the sensor repeats panorama 70, byte for byte, instead of new ones: it is frozen"
    assert told == [[], [], [LinkEvent(1003, 2003, StationKind.FROZEN, text)], [], []]
    arrivals.new_panorama(71)
    assert [arrivals.repeated(frame, 70, 1, 1) for _ in range(2)] == [[], []]
    assert counters.frames_repeated == 5


def test_a_copy_of_an_earlier_frame_is_no_repetition():
    arrivals, counters = arrivals_of()
    for number in (8, 9):
        accepted(arrivals, number, b"%d" % number)
    copy = Frame(0, 40, "PANORAMA", 0, 8, b"8", 40)
    assert [arrivals.repeated(copy, 70, 1, 1) for _ in range(5)] == [[]] * 5
    assert counters.frames_repeated == 0


@pytest.mark.parametrize(
    ("panoramas", "others_lost"),
    [
        ([(1, 10), (5, 11)], 3),  # three frames are missing, no exposure is
        ([(1, 10), (5, 12)], 2),
        ([(1, 10), (5, 14)], 0),
        ([(1, 10), (5, 15)], 0),  # four exposures without a frame of their own
        ([(1, 10), (5, 10)], 0),  # no number of an exposure
        ([(1, 10), (5, 9)], 0),
        ([(1, 10), (5, 11), (8, 12), (9, 13)], 5),
    ],
)
def test_frames_lost_between_panoramas_of_consecutive_exposures_were_others(panoramas, others_lost):
    arrivals, _ = arrivals_of()
    for sequence, frame_no in panoramas:
        accepted(arrivals, sequence, b"%d" % sequence, float(sequence))
        arrivals.new_panorama(frame_no)
    assert arrivals.others_lost == others_lost


@pytest.mark.parametrize(("restarted", "others_lost"), [(False, 3), (True, 0)])
def test_over_a_restart_nothing_tells_what_was_lost(restarted, others_lost):
    """Three frames are missing before one that is no panorama; the panorama behind it may be of a new start."""
    arrivals, _ = arrivals_of()
    accepted(arrivals, 100, b"100")
    arrivals.new_panorama(10)
    accepted(arrivals, 104, b"104", 1.0)
    accepted(arrivals, 105, b"105", 2.0, restarted=restarted)
    arrivals.new_panorama(11)
    assert arrivals.others_lost == others_lost


def test_a_number_that_makes_no_sense_is_told_whole():
    assert chaos_in_words(7, 900) == (
        "frame 7 on the wire follows frame 900: more than can have been sent in the time between; its sequence number "
        "makes no sense, and no frames count as lost"
    )
    assert chaos_in_words(7, 7) == "frame 7 on the wire follows another frame 7: its sequence number stands still"


@pytest.mark.parametrize(("late_s", "arrival"), [(100.0, Arrival.GAP), (1.0, Arrival.CHAOS)])
def test_the_hosts_time_counts_from_the_frame_before_and_not_from_its_start(late_s, arrival):
    """A host that has been up for a month."""
    arrivals, _ = arrivals_of()
    month_s = 30 * 86_400.0
    for number in range(3):
        accepted(arrivals, number, b"%d" % number, month_s + number, tag_us=number * 10**6)
    assert accepted(arrivals, 102, b"102", month_s + 2.0 + late_s) is arrival


def test_copies_are_counted_from_the_first_of_them_on_though_no_panorama_was_told():
    arrivals, counters = arrivals_of()
    frame = Frame(0, 40, "PANORAMA", 0, 9, b"", 40)
    arrivals.accept(frame, 0, None, restarted=False)
    assert [len(arrivals.repeated(frame, 70, 1, 1)) for _ in range(4)] == [0, 0, 1, 0]
    assert counters.frames_repeated == 4


def test_bits_that_stand_still_above_a_counter_are_named_with_the_mask():
    assert "mask: 0x3FFF" in chaos_in_words(0xC000, 0xFFFF)
    assert "mask: 0xFF" in chaos_in_words(0x500, 0x5FF)
    assert "mask" not in chaos_in_words(0xC001, 0xFFFF)
    assert "mask" not in chaos_in_words(0, 0xFFFF)
