"""Data of a session before anything came, and what of it is lost."""

import pytest
from skies.known_nights import STATION

from gse.config.station import BUILT_IN_TEXT
from gse.station.events import ClockStep, StationKind
from gse.station.results import LinkCounters, Subject
from gse.station.session_data import SessionData
from gse.station.session_tables import FrameTable


def session(**changes):
    return SessionData(STATION, BUILT_IN_TEXT, "panorama-v1", **changes)


def test_a_session_begins_with_nothing():
    made = session()
    assert made.subject is Subject.ONBOARD
    assert (len(made.frames), made.events, made.clock, made.statuses, len(made.sensor_attitudes)) == (0, [], [], [], 0)
    assert (made.events_not_kept, made.others_lost, made.panoramas_lost) == (0, 0, 0)
    assert (made.raw_sha256, made.catalog, made.versions, made.excluded) == ("", {}, {}, ())
    assert made.truncated is False
    frames = FrameTable()
    assert SessionData(STATION, BUILT_IN_TEXT, "panorama-v1", frames).frames is frames
    nothing = made.stars, made.earth_orientation, made.alignment, made.clock_error_s, made.external
    assert nothing == (None,) * 5
    assert (made.external_counts.answers, made.external_counts.own_times) == (0, 0)


@pytest.mark.parametrize(
    ("frames_lost", "others_lost", "frames_repeated", "panoramas_lost"),
    [(0, 0, 0, 0), (10, 0, 0, 10), (10, 4, 0, 6), (10, 4, 3, 9), (0, 0, 3, 3), (4, 4, 0, 0)],
)
def test_lost_panoramas_are_the_lost_frames_that_may_be_some_and_the_copies_of_a_frozen_sensor(
    frames_lost, others_lost, frames_repeated, panoramas_lost
):
    link = LinkCounters(frames_lost=frames_lost, frames_repeated=frames_repeated)
    assert session(link=link, others_lost=others_lost).panoramas_lost == panoramas_lost


def test_a_step_of_the_clock_is_one_of_utc_unless_it_is_said_otherwise():
    assert ClockStep(1, 0, StationKind.CLOCK_STEP, "", 5).utc_kept is False
