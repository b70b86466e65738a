"""The summary of the sky over a session, by hand."""

import math

import numpy as np
import pytest
from skies.known_nights import session

from gse.report.terminal import sky_lines
from gse.station.columns import SKY_CONDITIONS
from gse.station.results import SkyCondition
from gse.statistics.sampling import percentiles
from gse.statistics.sky_summary import MOST_STRETCHES, seen_share, sky_summary, zero_point_mag


def frames_of(conditions, *, seen=8, expected=10):
    frames = session(len(conditions)).frames.columns
    frames["sky_condition"] = [SKY_CONDITIONS.index(condition) for condition in conditions]
    frames["stars_seen"], frames["stars_expected"] = seen, expected
    frames["limiting_mag"] = 5.0
    return frames


CLEAR, CLOUDED = SkyCondition.CLEAR, SkyCondition.CLOUDED


def test_stretches_follow_each_other_and_the_most_frequent_condition_is_that_of_the_session():
    frames = frames_of([CLEAR] * 4 + [CLOUDED] * 3 + [CLEAR] * 2)
    found = sky_summary(frames)
    assert [(part.condition, part.frames) for part in found.stretches] == [(CLEAR, 4), (CLOUDED, 3), (CLEAR, 2)]
    assert (found.stretches[1].from_ns, found.stretches[1].until_ns) == tuple(frames["utc_ns"][[4, 6]].tolist())
    assert found.condition is CLEAR
    assert found.shares == {CLEAR: 6 / 9, CLOUDED: 3 / 9}
    assert found.stretches_more == 0


def test_depth_is_that_of_the_clear_frames_and_else_of_those_with_stars():
    frames = frames_of([CLEAR, CLEAR, CLOUDED, CLOUDED, CLOUDED])
    frames["limiting_mag"] = [5.0, 6.0, 2.0, 2.0, 2.0]
    assert sky_summary(frames).limiting_mag == 5.5
    frames["sky_condition"] = SKY_CONDITIONS.index(CLOUDED)
    frames["stars_seen"] = [1, 0, 0, 0, 0]
    assert sky_summary(frames).limiting_mag == 5.0


def test_no_more_stars_are_seen_than_are_expected_and_of_none_there_is_no_share():
    frames = frames_of([CLEAR] * 4)
    frames["stars_seen"], frames["stars_expected"] = [5, 12, 1, 3], [10, 10, 1, 0]
    assert seen_share(frames)[:3].tolist() == [0.5, 1.0, 1.0]
    assert math.isnan(seen_share(frames)[3])
    assert sky_summary(frames).stars_expected == (0.0, 10.0)


def test_broken_cloud_gives_the_first_stretches_and_the_number_of_the_others():
    found = sky_summary(frames_of([CLEAR, CLOUDED] * (MOST_STRETCHES // 2 + 3)))
    assert (len(found.stretches), found.stretches_more) == (MOST_STRETCHES, 6)


def test_no_frames_have_no_sky():
    assert sky_summary(session(0).frames.columns) is None


def test_percentiles_leave_out_what_is_not_known():
    found = percentiles(np.array([np.nan, *range(101), np.inf]))
    assert (found.n, found.p50, found.p95, found.p99, found.max) == (101, 50.0, 95.0, 99.0, 100.0)
    assert percentiles(np.array([np.nan])).n == 0
    assert percentiles(np.array([np.nan])).max == pytest.approx(math.nan, nan_ok=True)


def test_the_zero_point_to_state_is_that_of_the_clear_frames_in_the_dark_for_one_second():
    frames = frames_of([CLEAR, CLEAR, CLOUDED, CLEAR])
    frames["zero_point_mag"] = [10.0, 10.5, 8.0, 14.0]
    frames["exposure_s"] = [0.1, 0.1, 0.1, 0.1]
    frames["sun_altitude_deg"] = [-30.0, -30.0, -30.0, -6.0]
    assert zero_point_mag(frames) == pytest.approx(12.75)
    assert math.isnan(zero_point_mag(frames[2:]))


@pytest.mark.parametrize(("stated", "is_told"), [({}, True), ({"stated_zero_point_mag": 12.7}, False)])
def test_a_sky_that_is_clear_against_itself_is_said_to_be_so(stated, is_told):
    sky = {"shares": {"clear": 1.0}, "limiting_mag": 5.3, "seen_share": 1.0} | stated
    line, *more = sky_lines(sky)
    assert line == "sky: clear 100 %; stars to magnitude 5.3, 100 % of the expected ones"
    assert any("Thin cloud that lasts the whole session cannot be seen" in told for told in more) == is_told
    (clouded,) = sky_lines(sky | {"shares": {"clouded": 1.0}})
    assert "hin cloud" not in clouded


def test_the_zero_point_is_that_of_clear_dark_frames_with_an_exposure_taken_to_a_second():
    frames = frames_of([CLEAR, CLEAR, CLEAR, CLOUDED, CLEAR])
    frames["zero_point_mag"] = [14.0, 14.0, 9.0, 1.0, 2.0]
    frames["exposure_s"] = [0.1, 0.1, 0.0, 0.1, 0.1]
    frames["sun_altitude_deg"] = [-30.0, -30.0, -30.0, -30.0, 5.0]
    assert zero_point_mag(frames) == pytest.approx(14.0 + 2.5)


def test_each_number_of_the_sky_has_its_own_range_or_median():
    nan = math.nan
    frames = frames_of([CLEAR] * 4 + [CLOUDED])
    frames["stars_seen"], frames["stars_expected"] = [9, 7, 20, 8, 1], [10, 10, 10, 0, 30]
    frames["sun_altitude_deg"] = [-30.0, -31.0, nan, -29.0, -32.0]
    frames["moon_altitude_deg"] = [5.0, 6.0, 7.0, nan, 4.0]
    frames["moon_separation_deg"] = [80.0, nan, 70.0, 90.0, 85.0]
    frames["limiting_mag"] = [5.0, nan, 6.0, 5.8, 1.0]
    frames["transparency"] = [0.9, 0.7, 0.8, nan, 0.1]
    found = sky_summary(frames)
    assert found.stars_expected == (0.0, 30.0)
    assert found.sun_altitude_deg == (-32.0, -29.0)
    assert found.moon_altitude_deg == (4.0, 7.0)
    assert found.moon_separation_deg == (70.0, 90.0)
    assert found.seen_share == pytest.approx(0.9)  # of 0.9, 0.7 and 1
    assert found.limiting_mag == pytest.approx(5.8)
    clear, clouded = found.stretches
    assert (clear.seen_share, clear.transparency, clear.limiting_mag) == pytest.approx((0.9, 0.8, 5.8))
    assert (clouded.seen_share, clouded.transparency, clouded.limiting_mag) == pytest.approx((1 / 30, 0.1, 1.0))
    frames["sun_altitude_deg"] = nan
    assert all(map(math.isnan, sky_summary(frames).sun_altitude_deg))


def test_a_stretch_lasts_from_its_earliest_frame_to_its_latest():
    frames = frames_of([CLEAR, CLEAR, CLEAR])
    frames["utc_ns"][:] = [30, 10, 20]  # the clock stepped
    (stretch,) = sky_summary(frames).stretches
    assert (stretch.from_ns, stretch.until_ns) == (10, 30)


@pytest.mark.parametrize(("sun_deg", "is_dark"), [(-12.0, True), (-11.99, False)])
def test_it_is_dark_until_nautical_twilight(sun_deg, is_dark):
    frames = frames_of([CLEAR])
    frames["zero_point_mag"], frames["exposure_s"], frames["sun_altitude_deg"] = 10.0, 100.0, sun_deg
    assert zero_point_mag(frames) == pytest.approx(5.0 if is_dark else math.nan, nan_ok=True)
