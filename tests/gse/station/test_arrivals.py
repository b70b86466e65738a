"""Steps of the host's clock between two frames, told by three clocks."""

import pytest

from gse.instant import NS_PER_S
from gse.station.arrivals import CLOCK_STEP_NS, Arrivals, _step_in_words
from gse.station.byte_stream import FrameAt
from gse.station.results import LinkCounters
from protocols import Frame, load_protocol

FRAME = Frame(0, 40, "PANORAMA", 0, 1, b"")
START_NS = 1_774_018_800 * NS_PER_S


def stepped(*, utc_s, mono_s, tag_s, has_times=True):
    """The step between two frames by how much each clock went on; ``tag_s`` is None where there are no time tags."""
    arrivals = Arrivals(load_protocol("panorama-v1"), LinkCounters(), has_times=has_times)
    found = []
    for went_on in (0, 1):
        utc_ns, mono_ns = START_NS + round(went_on * utc_s * NS_PER_S), round((5000 + went_on * mono_s) * NS_PER_S)
        at = FrameAt(FRAME, utc_ns, mono_ns, utc_ns)
        tag_us = None if tag_s is None else round((1000 + went_on * tag_s) * 1e6)
        found.append(arrivals.clock_step(at, tag_us))
    assert found[0] is None
    return found[1]


@pytest.mark.parametrize(
    ("utc_s", "mono_s", "tag_s", "step_s", "utc_kept"),
    [
        (15.0, 0.1, 15.0, 14.9, True),  # the host slept
        (15.0, 0.1, 0.1, 14.9, False),  # UTC was set
        (0.1, 600.1, 0.1, -600.0, True),  # the monotonic clock leapt
        (35.0, 20.0, 35.0, 15.0, True),  # the host slept for 15 of 35 s
        (35.0, 20.0, 20.0, 15.0, False),  # UTC was set while no frame came for 20 s
        (0.0, 10.0, 0.0, -10.0, True),  # and the sensor's stands still as UTC does
        (-9.9, 0.1, 0.1, -10.0, False),
        (1.1, 0.1, 1.1, 1.0, True),  # just long enough for a suspension
        (1.09, 0.1, 1.09, 0.99, False),
        (15.0, 0.1, None, 14.9, False),
        (15.0, 0.1, -20.0, 14.9, False),  # the sensor began anew
        (0.1052, 0.1, 0.1, 0.0052, False),
    ],
)
def test_a_step_is_of_utc_unless_the_sensors_clock_went_along_with_it(utc_s, mono_s, tag_s, step_s, utc_kept):
    step = stepped(utc_s=utc_s, mono_s=mono_s, tag_s=tag_s)
    assert step.step_ns == pytest.approx(step_s * NS_PER_S, abs=200)
    assert step.utc_kept is utc_kept


@pytest.mark.parametrize(
    ("mono_s", "off_s", "is_step"),
    [
        (0.001, 0.0049, False),
        (0.001, 0.0051, True),
        (10.0, 0.0149, False),  # a clock that is slewed by a thousandth
        (10.0, 0.0151, True),
        (3600.0, 0.0549, False),  # by 50 ms at most
        (3600.0, 0.0551, True),
        (10.0, -0.0151, True),
    ],
)
def test_what_a_slewed_clock_can_do_is_no_step(mono_s, off_s, is_step):
    assert CLOCK_STEP_NS == 5_000_000
    assert (stepped(utc_s=mono_s + off_s, mono_s=mono_s, tag_s=mono_s) is not None) == is_step


def test_stamps_that_no_clock_has_show_no_step():
    assert stepped(utc_s=600.0, mono_s=0.1, tag_s=0.1, has_times=False) is None


@pytest.mark.parametrize(
    ("step_s", "utc_kept", "words"),
    [
        (2.5, False, "the host's UTC clock stepped by +2.500 s"),
        (-2.5, False, "the host's UTC clock stepped by -2.500 s"),
        (
            2.5,
            True,
            "the host was suspended: its monotonic clock stood still for 2.500 s, in which UTC and the sensor's",
        ),
        (-2.5, True, "the host's monotonic clock leapt by +2.500 s; UTC and the sensor's clock did not"),
    ],
)
def test_a_step_is_told_in_the_words_of_the_clock_that_made_it(step_s, utc_kept, words):
    assert _step_in_words(round(step_s * NS_PER_S), utc_kept).startswith(words)
