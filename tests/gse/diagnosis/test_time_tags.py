"""Time tags that stand still, leap or run away, on frames whose clocks are made by hand."""

import numpy as np
import pytest
from skies.known_nights import session

from drivers.chunk import LinkEvent
from gse.diagnosis.plain_findings import _off, often_stand_still, time_tag_faults, wrapped_tags
from gse.station.columns import FRAME
from gse.station.events import ClockStep, StationKind
from gse.station.exclusions import after_restart, excluded, leapt_clock
from gse.values.instant import NS_PER_S, from_text

START_NS = from_text("2026-03-20T18:30:00Z")


def frames(count=200, step_s=0.1):
    made = np.zeros(count, dtype=FRAME)
    made["frame_no"] = np.arange(count)
    made["host_utc_ns"] = made["utc_ns"] = START_NS + np.round(np.arange(count) * step_s * NS_PER_S).astype(np.int64)
    made["time_us"] = 1_000_000 + np.round(np.arange(count) * step_s * 1e6).astype(np.int64)
    return made


def faults(made, events=()):
    return time_tag_faults(made, events)


def test_sound_tags_are_no_fault():
    assert faults(frames()) == ()
    assert faults(frames(2)) == ()


@pytest.mark.parametrize(("count", "is_told"), [(2, False), (3, True)])
def test_three_frames_are_enough_for_a_leap(count, is_told):
    made = frames(count)
    made["time_us"][count - 1 :] += 60_000_000
    assert [line.startswith("sensor time tag: it leapt by +60.00 s") for line in faults(made)] == [True] * is_told


def test_without_host_times_nothing_is_told():
    made = frames()
    made["time_us"][100:] += 3_000_000
    assert len(faults(made)) == 1
    made["host_utc_ns"][7] = 0
    assert faults(made) == ()


def capture(leap_s, at=100, *, pause_s=0.0, late=0, missing=0):
    """Frames whose times are the sensor's own, with a leap of its clock before one of them, or a true pause.

    ``late`` frames after it show the sky from before it; so many exposures are ``missing``.
    """
    made = frames(step_s=0.5)
    after = np.arange(len(made)) >= at
    sky_s = np.arange(len(made)) * 0.5 + pause_s * after
    sky_s[at : at + late] = sky_s[at - 1]
    made["utc_ns"][after] += round((leap_s + pause_s) * NS_PER_S)
    made["frame_no"][after] += missing
    made["ra_deg"], made["de_deg"] = (350 + sky_s * 360 / 86_164) % 360, -40.0
    made["host_utc_ns"] = 0
    return made


def restart(made, at=100, lost_s=0.5):
    """The sensor starts anew before a frame, to which the capture gives the time of the one before."""
    made["utc_ns"][at:] -= round(lost_s * NS_PER_S)
    return LinkEvent(int(made["utc_ns"][at - 1]), 0, StationKind.SENSOR_RESET, "the sensor started anew")


@pytest.mark.parametrize(
    ("lost_s", "words"),
    [(0.5, []), (0.9, []), (1.1, ["1 s early"]), (30.0, ["30 s early"]), (-3.0, ["3 s late"])],
)
def test_after_a_restart_a_capture_knows_its_times_by_the_stars_alone(lost_s, words):
    made = capture(0.0, pause_s=max(lost_s - 0.5, 0.0))
    event = restart(made, lost_s=lost_s)
    left_out = list(after_restart([event], made))
    told = [item.reason.split("by the stars they are ")[1] for item in left_out]
    assert told == [f"{word} from then on" for word in words]
    assert [f"sensor time tag: {item.reason}" for item in left_out] == list(faults(made, [event]))
    assert [excluded(made["utc_ns"], [item]).sum() for item in left_out] == [101] * len(words)
    assert list(after_restart([], made)) == []
    made["host_utc_ns"] = made["utc_ns"]
    assert list(after_restart([event], made)) == []


def test_times_that_restarts_move_little_by_little_are_off_from_where_a_second_is_full():
    made = capture(0.0)
    events = [restart(made, at, 0.4) for at in range(20, 200, 20)]
    (item,) = after_restart(events, made)
    assert item.reason.endswith("by the stars they are 1 s early from then on")
    assert item.from_ns == events[2].utc_ns


@pytest.mark.parametrize("leap_s", [20.0, 3600.0, 36_000.0])
def test_a_capture_shows_a_leap_of_the_sensors_clock_by_a_sky_that_stands_still(leap_s):
    made = capture(leap_s)
    (item,) = leapt_clock(made)
    assert (item.from_ns, item.until_ns) == (made["utc_ns"][100], made["utc_ns"][-1] + 1)
    assert item.time_error_s == pytest.approx(leap_s)
    assert faults(made) == (
        f"sensor time tag: the sensor's clock leapt by {leap_s:+.1f} s, while the sky did not turn",
    )


@pytest.mark.parametrize(
    "made",
    [
        capture(0.0),
        capture(4.0),  # gse.diagnosis.fine_findings tells it
        capture(0.0, pause_s=3600.0),
        capture(0.0, pause_s=60.0, late=4),
        capture(60.0, missing=120),
    ],
    ids=["nothing", "short", "pause", "old pictures after a pause", "exposures are missing"],
)
def test_a_pause_of_the_sensor_is_no_leap_of_its_clock(made):
    assert list(leapt_clock(made)) == []


@pytest.mark.parametrize("ra_deg", [350.0, np.nan])
def test_without_a_sky_that_turns_nothing_tells_a_leap(ra_deg):
    made = capture(60.0)
    made["ra_deg"] = ra_deg
    assert list(leapt_clock(made)) == []


@pytest.mark.parametrize(("still", "is_told"), [(2, False), (3, True)])
def test_a_tag_stands_still_from_three_frames_on(still, is_told):
    made = frames()
    made["time_us"][50 : 50 + still + 1] = made["time_us"][50]
    expected = f"sensor time tag: it stood still in {still} frames while the host's clock went on"
    assert (expected in faults(made)) == is_told


@pytest.mark.parametrize(("still", "is_often"), [(0, False), (20, False), (21, True), (199, True)])
def test_a_tag_that_stands_still_in_more_than_a_tenth_of_the_frames_does_so_often(still, is_often):
    made = frames()
    made["time_us"][: still + 1] = made["time_us"][0]
    assert often_stand_still(made) == is_often
    assert not often_stand_still(made[:0])


def test_frames_that_are_read_at_once_with_one_tag_do_not_stand_still():
    made = frames()
    made["time_us"][50:60], made["host_utc_ns"][50:60] = made["time_us"][50], made["host_utc_ns"][50]
    assert not any("stood still" in line for line in faults(made))


def test_a_tag_that_does_not_move_has_not_leapt_ahead_of_a_host_that_went_back():
    made = frames()
    made["host_utc_ns"][100:] -= 2 * NS_PER_S
    made["time_us"][100] = made["time_us"][99]
    assert not any("leapt" in line for line in faults(made))


def test_a_step_of_the_host_before_the_first_frame_hides_no_leap():
    made = frames()
    made["time_us"][100:] += 3_000_000
    early = ClockStep(START_NS - NS_PER_S, 0, StationKind.CLOCK_STEP, "", 5 * NS_PER_S)
    assert any("leapt by +3.00 s" in line for line in faults(made, (early,)))


@pytest.mark.parametrize(("leap_s", "is_told"), [(0.6, False), (0.7, True)])
def test_a_leap_is_half_a_second_beyond_a_frame_and_a_half_with_its_size_and_time(leap_s, is_told):
    """Half a second, and one and a half of the usual steps: so much may frames be ahead that are read at once."""
    made = frames()
    made["time_us"][100:] += round(leap_s * 1e6)
    text = f"sensor time tag: it leapt by {leap_s:+.2f} s at 2026-03-20T18:30:10.0Z"
    assert (text in faults(made)) == is_told


def test_later_leaps_are_counted():
    made = frames()
    for row in (0, 100, 150):
        made["time_us"][row + 1 :] += 2_000_000
    (line,) = faults(made)
    assert "leapt by +2.00 s at 2026-03-20T18:30:00.1Z, and 2 times more" in line


def test_missing_frames_are_no_leap_but_what_they_do_not_explain_is():
    made = frames()
    made["frame_no"][100:] += 20
    made["time_us"][100:] += 2_000_000
    assert faults(made) == ()
    made["time_us"][100:] += 2_000_000
    assert any("leapt by +4.00 s" in line for line in faults(made))


@pytest.mark.parametrize("row", [1, 100])
def test_a_step_of_the_hosts_clock_is_no_leap_of_the_tag(row):
    made = frames()
    made["host_utc_ns"][row:] -= 2 * NS_PER_S
    at_ns = int(made["host_utc_ns"][row])
    assert any("it leapt" in line for line in faults(made))
    step = ClockStep(at_ns, 0, StationKind.CLOCK_STEP, "the clock was set", -2 * NS_PER_S)
    assert faults(made, [step]) == ()


@pytest.mark.parametrize(("share", "word"), [(1.06, "6 % fast"), (0.94, "6 % slow"), (1.04, ""), (0.96, "")])
@pytest.mark.parametrize("steps", [40, 39])
def test_tags_that_run_away_for_forty_frames_are_told(share, word, steps):
    made = frames(steps + 1)
    made["time_us"] = 1_000_000 + np.round(np.arange(steps + 1) * 1e5 * share).astype(np.int64)
    expected = (f"sensor time tag: it ran {word} from 2026-03-20T18:30:00.0Z",) if word and steps == 40 else ()
    assert faults(made) == expected


def test_the_worst_stretch_is_told_with_its_begin():
    made = frames()
    made["time_us"][41:81] += np.arange(1, 41, dtype=np.uint64) * 7_000
    made["time_us"][81:] += 280_000
    made["time_us"][121:161] += np.arange(1, 41, dtype=np.uint64) * 20_000
    made["time_us"][161:] += 800_000
    assert faults(made) == ("sensor time tag: it ran 20 % fast from 2026-03-20T18:30:12.0Z",)


def test_arrivals_that_jitter_by_a_third_of_their_period_are_no_fault_of_the_tags():
    told = 0
    for seed in range(20):
        made = frames(step_s=0.05)
        late_ns = np.random.default_rng(seed).normal(0.0, 8e6, len(made))
        made["host_utc_ns"] += np.round(late_ns).astype(np.int64)
        told += len(faults(made))
    assert told == 0


@pytest.mark.parametrize(("host_s", "is_told"), [(0.5, False), (0.6, True)])
def test_a_tag_stands_still_where_the_host_went_on_by_more_than_half_the_usual_time(host_s, is_told):
    made = frames(40, 1.0)
    made["time_us"][10:14] = made["time_us"][10]
    made["host_utc_ns"][10:14] = made["host_utc_ns"][10] + np.round(np.arange(4) * host_s * NS_PER_S).astype(np.int64)
    assert any("stood still in 3 frames" in line for line in faults(made)) == is_told


@pytest.mark.parametrize(("leap_s", "is_told"), [(2.0, False), (2.001, True)])
@pytest.mark.parametrize("missing", [0, 3])
def test_a_leap_is_more_than_half_a_second_and_a_frame_and_a_half_for_each_that_is_missing(leap_s, is_told, missing):
    """A frame a second, so that half a second and one and a half are two, and those of three missing ones 6.5 s."""
    made = frames(20, 1.0)
    made["frame_no"][10:] += missing
    made["time_us"][10:] += round((leap_s + 1.5 * missing) * 1e6)
    text = f"it leapt by {leap_s + 1.5 * missing:+.2f} s at 2026-03-20T18:30:10.0Z"
    assert any(text in line for line in faults(made)) == is_told


@pytest.mark.parametrize("numbers", [[0] * 20, list(range(20, 0, -1))])
def test_a_sensor_whose_numbers_stand_or_run_back_misses_no_frame(numbers):
    made = frames(20, 1.0)
    made["frame_no"] = numbers
    made["time_us"][10:] += 1_900_000
    assert faults(made) == ()
    made["time_us"][10:] += 200_000
    assert any("leapt by +2.10 s" in line for line in faults(made))


@pytest.mark.parametrize("row", [1, 10, 19])
def test_a_step_of_the_host_hides_the_leap_at_it_and_no_other(row):
    made = frames(20, 1.0)
    made["time_us"][row:] += 3_000_000
    for at, is_told in ((row - 1, True), (row, False), (row + 1, True)):
        if at in (0, len(made)):
            continue
        step = ClockStep(int(made["host_utc_ns"][at]), 0, StationKind.CLOCK_STEP, "the clock was set", -3 * NS_PER_S)
        assert any("leapt" in line for line in faults(made, (step,))) == is_told


@pytest.mark.parametrize(("leaps", "words"), [(1, ""), (2, ", and 1 times more"), (3, ", and 2 times more")])
def test_leaps_after_the_first_are_counted(leaps, words):
    made = frames(20, 1.0)
    for number in range(leaps):
        made["time_us"][5 + 3 * number :] += 3_000_000 + 1_000_000 * number
    assert faults(made) == (f"sensor time tag: it leapt by +3.00 s at 2026-03-20T18:30:05.0Z{words}",)


@pytest.mark.parametrize("count", [10, 40])
def test_a_rate_is_off_where_five_errors_of_its_median_do_not_explain_it(count):
    """Half of the numbers lie 0.01 to either side, the median between: its error is 1.2533 * 1.4826 * 0.01 / root."""
    error = 1.253314 * 1.482602 * 0.01 / np.sqrt(count)
    jitter = np.tile([-0.01, 0.01], count // 2)
    for sign in (-1, 1):
        inside, outside = 1 + sign * 4.99 * error + jitter, 1 + sign * 5.01 * error + jitter
        assert _off(np.array([inside, outside])) == pytest.approx([0.0, sign * 5.01 * error], abs=1e-12)


@pytest.mark.parametrize(("share", "is_told"), [(1.0501, True), (1.0499, False), (0.9499, True), (0.9501, False)])
def test_tags_that_are_off_by_a_twentieth_run_away(share, is_told):
    made = frames(41, 1.0)
    made["time_us"] = 1_000_000 + np.round(np.arange(41) * 1e6 * share).astype(np.int64)
    how = "fast" if share > 1 else "slow"
    assert faults(made) == (f"sensor time tag: it ran 5 % {how} from 2026-03-20T18:30:00.0Z",) * is_told


def test_frames_that_the_host_reads_at_once_or_whose_tag_stands_tell_no_rate():
    """Each tenth is read with the one before: those left are exact, and run by a tenth too fast."""
    made = frames(60, 1.0)
    made["time_us"] = 1_000_000 + np.round(np.arange(60) * 1.1e6).astype(np.int64)
    made["host_utc_ns"][10::10] = made["host_utc_ns"][9:59:10] + NS_PER_S // 2
    assert any("ran 10 % fast" in line for line in faults(made))
    made["time_us"][5:8] = made["time_us"][5]
    assert any("ran 10 % fast from 2026-03-20T18:30:00.0Z" in line for line in faults(made))


def test_of_two_stretches_the_one_that_is_off_by_more_is_told_whichever_its_sign():
    made = frames(121, 1.0)
    steps_s = np.repeat([1.06, 0.9, 1.0], 40)
    made["time_us"][1:] = 1_000_000 + np.round(np.cumsum(steps_s) * 1e6).astype(np.int64)
    assert faults(made) == ("sensor time tag: it ran 10 % slow from 2026-03-20T18:30:40.0Z",)


@pytest.mark.parametrize(("host_s", "is_told"), [(0.45, False), (0.5, False), (0.55, True)])
def test_frames_that_the_host_reads_faster_than_twice_as_fast_as_usual_tell_no_rate(host_s, is_told):
    """Eighty a second apart, then forty whose tags run by a fifth too fast."""
    made = frames(121, 1.0)
    steps_s = np.repeat([1.0, host_s], [80, 40])
    made["host_utc_ns"][1:] = START_NS + np.round(np.cumsum(steps_s) * NS_PER_S).astype(np.int64)
    made["time_us"][1:] = 1_000_000 + np.round(np.cumsum(steps_s * np.repeat([1.0, 1.2], [80, 40])) * 1e6).astype(int)
    assert faults(made) == ("sensor time tag: it ran 20 % fast from 2026-03-20T18:31:20.0Z",) * is_told


@pytest.mark.parametrize("held_frames", [2, 5, 10])
@pytest.mark.parametrize("held_s", [0.0, 0.002])
def test_frames_that_are_read_in_groups_are_no_fault_of_the_tags(held_frames, held_s):
    """An adapter keeps them until the last of a group has come, and hands them over one after the other."""
    made = frames(400, 0.02)
    group = np.arange(400) // held_frames
    together_ns = made["host_utc_ns"][np.minimum((group + 1) * held_frames - 1, 399)]
    made["host_utc_ns"] = together_ns + np.round(np.arange(400) % held_frames * held_s * NS_PER_S).astype(np.int64)
    assert faults(made) == ()


@pytest.mark.parametrize(
    ("bits", "unit_us", "words"),
    [(16, 1000, "16 bits of 1 ms"), (32, 1, "32 bits of 1 us"), (24, 10, "24 bits of 10 us")],
)
def test_tags_that_begin_anew_when_their_counter_is_full_are_no_restart(bits, unit_us, words):
    made = session(200, step_s=1.0)
    full_us = 2**bits * unit_us
    made.frames.columns["time_us"] = (full_us - 50_500_000 + np.arange(200) * 1_000_000) % full_us
    (finding,) = wrapped_tags(made)
    assert finding.size.endswith(f"after {full_us / 1e6:.6g} s: it counts {words}")
    made.frames.columns["time_us"] = np.arange(200) % 90 * 1_000_000  # a restart
    assert list(wrapped_tags(made)) == []


@pytest.mark.parametrize(("step_s", "group_s"), [(0.02, 0.016), (0.1, 0.2), (0.1, 0.064), (0.01, 0.016), (0.2, 0.7)])
def test_bytes_that_an_adapter_hands_over_in_groups_are_no_fault_of_the_tags(step_s, group_s):
    made = frames(400, step_s)
    group_ns = round(group_s * NS_PER_S)
    made["host_utc_ns"] = -(-made["host_utc_ns"] // group_ns) * group_ns
    assert faults(made) == ()


@pytest.mark.parametrize("share", [1.25, 0.7])
def test_tags_that_run_off_are_a_fault_in_groups_too(share):
    made = frames(400, 0.02)
    made["time_us"] = 1_000_000 + (share * (made["time_us"].astype(np.int64) - 1_000_000)).astype(np.int64)
    made["host_utc_ns"] = -(-made["host_utc_ns"] // 16_000_000) * 16_000_000
    [line] = faults(made)
    assert "it ran" in line


@pytest.mark.parametrize("first", [0, 47, 85, 360])
def test_a_sensor_whose_frames_wait_and_then_come_together_has_no_fault_of_its_tags(first):
    """Each is a quarter of a frame later than the one before, forty of them, and then as much earlier."""
    made = frames(480, 0.02)
    waits_s = 0.005 * np.concatenate([np.arange(40), np.arange(40, 0, -1)])
    made["host_utc_ns"][first : first + 80] += np.round(waits_s * NS_PER_S).astype(np.int64)
    assert faults(made) == ()
