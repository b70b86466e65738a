"""A long night is judged and drawn in little more memory than its frames take."""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import pytest
from synthetic_night import START_NS, synthetic_frames, synthetic_night

from gse.frame_table import FRAME
from gse.night import Night
from gse.report.drawn import Drawn
from gse.results import NO_MATCHES
from gse.verdict import judge

FRAMES = 30_000


@pytest.fixture(scope="module")
def night() -> Night:
    made = synthetic_night(1000)
    pattern = [replace(frame, matches=NO_MATCHES) for frame in synthetic_frames(1000)]
    for number in range(1000, FRAMES):
        frame, utc_ns = pattern[number % 1000], START_NS + number * 100_000_000
        stamps = {"utc_ns": utc_ns, "host_utc_ns": utc_ns + 5_000_000, "time_us": number * 100_000, "frame_no": number}
        made.frames.append(replace(frame, panorama=replace(frame.panorama, **stamps)))
    return made


@pytest.mark.parametrize(("made_of", "most_rows"), [(judge, 4.5), (Drawn.of, 2.8)], ids=["judged", "drawn"])
def test_a_night_is_made_sense_of_without_copies_of_its_rows(
    night: Night, made_of: Callable[[Night], object], most_rows: float
) -> None:
    """Where whole rows were selected and sorted it took 5.9 and 3.2 times the memory of the frames beside them."""
    made_of(night)
    tracemalloc.start()
    try:
        made_of(night)
        assert tracemalloc.get_traced_memory()[1] < most_rows * FRAME.itemsize * FRAMES
    finally:
        tracemalloc.stop()
