"""The mistakes of a set-up that are tried, as tables: each sign, order, quarter turn and time zone by hand."""

from dataclasses import replace

import pytest

from gse.diagnosis.gross_causes import CORRECT, SET_CLOCK, GrossHypothesis, of_clock, of_mount, of_site
from gse.values.mount import Mount
from gse.values.site import Site

SITE = Site(latitude_deg=48.5, longitude_deg=11.25)
MOUNT = Mount(azimuth_deg=30.0, altitude_deg=60.0, roll_deg=25.0)
STATED = GrossHypothesis("stated", "", CORRECT, SITE, MOUNT)
SIDEREAL_DAY_S = 86_164.0905


def sites(latitude_deg, longitude_deg):
    site = Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg)
    return {one.cause: (one.site.latitude_deg, one.site.longitude_deg) for one in of_site(site, MOUNT)}


@pytest.mark.parametrize(
    ("stated", "tried"),
    [
        (
            (48.5, 11.25),
            {
                "longitude sign": (48.5, -11.25),
                "latitude sign": (-48.5, 11.25),
                "latitude and longitude signs": (-48.5, -11.25),
                "latitude and longitude exchanged": (11.25, 48.5),
            },
        ),
        (
            (-6.5, 106.75),  # no station file can state a latitude of 106.75 deg
            {
                "longitude sign": (-6.5, -106.75),
                "latitude sign": (6.5, 106.75),
                "latitude and longitude signs": (6.5, -106.75),
            },
        ),
        ((48.5, 200.0), {"latitude sign": (-48.5, 200.0)}),  # nor a longitude of -200 deg
    ],
)
def test_signs_and_order_of_the_site_are_tried_where_a_station_file_can_state_them(stated, tried):
    assert sites(*stated) == tried


@pytest.mark.parametrize(
    ("stated", "cause", "is_tried"),
    [
        ((10.0, 180.0), "longitude sign", True),
        ((10.0, 180.1), "longitude sign", False),
        ((10.0, 180.0), "latitude and longitude signs", True),
        ((10.0, 180.1), "latitude and longitude signs", False),
        ((10.0, -90.0), "latitude and longitude exchanged", True),
        ((10.0, -90.1), "latitude and longitude exchanged", False),
    ],
)
def test_what_no_station_file_can_state_is_not_tried(stated, cause, is_tried):
    assert (cause in sites(*stated)) is is_tried


def test_a_hypothesis_of_the_site_says_what_to_write():
    size = {one.cause: one.size for one in of_site(SITE, MOUNT)}
    assert size["longitude sign"] == "the stars fit site.longitude_deg: -11.25"
    assert size["latitude and longitude signs"].endswith("site.latitude_deg: -48.5 and site.longitude_deg: -11.25")
    assert size["latitude and longitude exchanged"].endswith("site.latitude_deg: 11.25 and site.longitude_deg: 48.5")
    assert {(one.next_step, one.clock_s, one.mount) for one in of_site(SITE, MOUNT)} == {(CORRECT, 0.0, MOUNT)}


def angles(mount):
    return [
        (one.cause, one.mount.azimuth_deg, one.mount.altitude_deg, one.mount.roll_deg) for one in of_mount(SITE, mount)
    ]


def test_each_other_way_to_count_the_angles_of_a_mount_is_tried():
    assert angles(MOUNT) == [
        ("azimuth from south", 210.0, 60.0, 25.0),
        ("azimuth off by 90 deg", 120.0, 60.0, 25.0),
        ("azimuth off by 90 deg", 300.0, 60.0, 25.0),
        ("azimuth counted westwards", 330.0, 60.0, 25.0),
        ("wrong hemisphere of the mount", 150.0, 60.0, 25.0),
        ("zenith distance for altitude", 30.0, 30.0, 25.0),
        ("altitude sign", 30.0, -60.0, 25.0),
        ("roll off by 90 deg", 30.0, 60.0, 115.0),
        ("roll off by 180 deg", 30.0, 60.0, 205.0),
        ("roll off by 90 deg", 30.0, 60.0, 295.0),
        ("roll sign", 30.0, 60.0, 335.0),
        ("azimuth and altitude exchanged", 60.0, 30.0, 25.0),
    ]


def test_a_hypothesis_of_the_mount_says_what_to_write():
    size = {one.cause: one.size for one in of_mount(SITE, MOUNT)}
    assert size["azimuth from south"] == "the stars fit mount.azimuth_deg: 210"
    assert size["altitude sign"] == "the stars fit mount.altitude_deg: -60"
    assert size["azimuth and altitude exchanged"].endswith("mount.azimuth_deg: 60 and mount.altitude_deg: 30")


@pytest.mark.parametrize(
    ("stated", "causes"),
    [
        ({"azimuth_deg": 90.0}, {"azimuth and altitude exchanged", "zenith distance for altitude"}),
        ({"azimuth_deg": 90.1}, {"zenith distance for altitude"}),
        ({"azimuth_deg": -300.0}, {"azimuth and altitude exchanged", "zenith distance for altitude"}),
        ({"azimuth_deg": -270.0}, {"azimuth and altitude exchanged", "zenith distance for altitude"}),
        ({"azimuth_deg": -269.5}, {"zenith distance for altitude"}),
        ({"altitude_deg": 0.0}, {"azimuth and altitude exchanged", "zenith distance for altitude"}),
        ({"altitude_deg": -1.0}, set()),  # nor is a zenith distance above 90 deg an altitude
    ],
)
def test_an_altitude_is_between_the_horizon_and_the_zenith(stated, causes):
    tried = {cause for cause, *_ in angles(replace(MOUNT, **stated))}
    assert tried & {"azimuth and altitude exchanged", "zenith distance for altitude"} == causes


def clock(fast_s):
    return [(one.cause, one.clock_s / 3600) for one in of_clock(STATED, fast_s)]


@pytest.mark.parametrize("hours", [*range(-12, 0), *range(1, 15), 5.5, -9.5, -3.5, -2.5, 3.5, 4.5, 6.5, 9.5, 10.5,
                                   5.75, 8.75, 12.75])  # fmt: skip
def test_a_clock_within_a_minute_of_a_time_zone_is_set_to_local_time(hours):
    for near_s in (-59.0, 59.0):
        assert ("clock set to local time", hours) in clock(3600 * hours + near_s)
    for far_s in (-61.0, 61.0):
        assert ("clock set to local time", hours) not in clock(3600 * hours + far_s)


@pytest.mark.parametrize(
    ("hours", "cause"),
    [
        (15, "clock off by hours"),
        (18.5, "clock off by hours"),
        (-13, "clock off by hours"),
        (7.5, "clock set to local time"),
    ],
)
def test_a_number_of_hours_that_is_no_zone_must_be_met_to_four_seconds(hours, cause):
    for near_s in (-3.9, 3.9):
        assert (cause, hours) in clock(3600 * hours + near_s)
    for far_s in (-4.1, 4.1):
        assert all(found != hours for _, found in clock(3600 * hours + far_s))


@pytest.mark.parametrize("hours", [-24, 24])
def test_a_date_that_is_off_by_a_day_turns_the_sky_by_four_minutes(hours):
    for fast_s in (3600.0 * hours - 59.0, 3600.0 * hours + 59.0, 3600.0 * hours - SIDEREAL_DAY_S * hours / 24):
        assert ("clock off by a day", hours) in clock(fast_s)


def test_an_offset_is_known_but_for_sidereal_days():
    assert clock(7 * 3600.0 - SIDEREAL_DAY_S) == clock(7 * 3600.0) == [("clock set to local time", 7.0)]


def test_no_hour_is_no_mistake_and_more_than_a_day_is_none_that_is_usual():
    assert clock(1.0) == []
    assert clock(25 * 3600.0) != []
    assert all(abs(hours) <= 25.5 for fast_h in (25.5, 26, -26) for _, hours in clock(fast_h * 3600.0))
    assert ("clock off by hours", 26.0) not in clock(26 * 3600.0)


@pytest.mark.parametrize(
    ("hours", "words"),
    [
        (7, "the host's clock is 7 h ahead of UTC, as the local time of the zone UTC+7 is"),
        (-4, "the host's clock is 4 h behind UTC, as the local time of the zone UTC-4 is"),
        (5.5, "the host's clock is 5.5 h ahead of UTC, as the local time of the zone UTC+5:30 is"),
        (-9.5, "the host's clock is 9.5 h behind UTC, as the local time of the zone UTC-9:30 is"),
        (12.75, "the host's clock is 12.75 h ahead of UTC, as the local time of the zone UTC+12:45 is"),
        (14, "the host's clock is 14 h ahead of UTC, as the local time of the zone UTC+14 is"),
        (-12, "the host's clock is 12 h behind UTC, as the local time of the zone UTC-12 is"),
        (14.5, "the host's clock is 14.5 h ahead of UTC"),
        (-12.5, "the host's clock is 12.5 h behind UTC"),
        (24, "the host's date is one day ahead UTC"),
        (-24, "the host's date is one day behind UTC"),
    ],
)
def test_a_clock_is_told_in_the_words_of_who_set_it(hours, words):
    found = [one for one in of_clock(STATED, 3600.0 * hours) if one.clock_s == 3600 * hours]
    assert [one.size.replace("ahead of UTC", "ahead UTC") if abs(hours) == 24 else one.size for one in found] == [words]
    assert found[0].next_step == SET_CLOCK


@pytest.mark.parametrize(
    ("hours", "words"),
    [
        (1, "the host's clock is 1 h ahead of UTC, as the local time of the zone UTC+1 is"),
        (0.5, "the host's clock is 0.5 h ahead of UTC, as the local time of the zone UTC+0:30 is"),
        (-0.5, "the host's clock is 0.5 h behind UTC, as the local time of the zone UTC-0:30 is"),
        (-1, "the host's clock is 1 h behind UTC, as the local time of the zone UTC-1 is"),
        (25, "the host's clock is 25 h ahead of UTC"),
        (-25, "the host's clock is 25 h behind UTC"),
    ],
)
def test_the_sign_of_a_clock_is_told_about_nought_and_beyond_a_day(hours, words):
    assert [one.size for one in of_clock(STATED, 3600.0 * hours) if one.clock_s == 3600 * hours] == [words]


@pytest.mark.parametrize(("hours", "limit_s"), [(7, 60.0), (-9.5, 60.0), (8.75, 60.0), (-24, 60.0), (7.5, 4.0)])
def test_a_clock_at_the_very_limit_is_not_near(hours, limit_s):
    for side in (-1, 1):
        assert hours not in [zone for _, zone in clock(3600.0 * hours + side * limit_s)]
        assert hours in [zone for _, zone in clock(3600.0 * hours + side * (limit_s - 0.001))]


@pytest.mark.parametrize("side", [-1, 1])
def test_a_clock_may_be_off_by_less_than_25_hours_and_a_half(side):
    assert ("clock off by hours", 25.5 * side) not in clock(25.5 * 3600.0 * side)
    assert ("clock off by hours", 25.5 * side) in clock((25.5 * 3600.0 - 0.001) * side)
    assert ("clock off by hours", 25.0 * side) in clock(25 * 3600.0 * side)


@pytest.mark.parametrize("days", [-1, 0, 1])
@pytest.mark.parametrize("hours", [7.0, -11.0, 0.5])
def test_a_clock_is_known_but_for_a_sidereal_day_on_either_side(hours, days):
    assert ("clock set to local time", hours) in clock(3600 * hours + days * SIDEREAL_DAY_S)
    assert ("clock set to local time", hours) not in clock(3600 * hours + 2 * days * SIDEREAL_DAY_S) or days == 0


@pytest.mark.parametrize(
    ("stated", "cause", "angle_deg"),
    [
        ({"azimuth_deg": 0.5}, "azimuth counted westwards", 359.5),
        ({"roll_deg": 0.25}, "roll sign", 359.75),
        ({"azimuth_deg": 350.0}, "azimuth from south", 170.0),
        ({"azimuth_deg": 350.0}, "wrong hemisphere of the mount", 190.0),
        ({"roll_deg": 300.0}, "roll off by 180 deg", 120.0),
        ({"altitude_deg": -5.0}, "altitude sign", 5.0),
        ({"altitude_deg": 0.0}, "zenith distance for altitude", 90.0),
        ({"azimuth_deg": -300.0}, "azimuth and altitude exchanged", 60.0),
        ({"azimuth_deg": 390.0}, "azimuth and altitude exchanged", 60.0),
    ],
)
def test_an_angle_is_tried_as_a_full_circle_counts_it(stated, cause, angle_deg):
    """An exchanged mount of these has the azimuth of 30 deg, or 60, as its altitude."""
    name = "azimuth" if "azimuth" in cause or "hemisphere" in cause else cause.split()[0].replace("zenith", "altitude")
    (found,) = (one for one in of_mount(SITE, replace(MOUNT, **stated)) if one.cause == cause)
    assert getattr(found.mount, f"{name}_deg") == pytest.approx(angle_deg)
    assert f"{name}_deg: {angle_deg:g}" in found.size
    if "exchanged" in cause:
        assert found.mount.altitude_deg == pytest.approx(stated["azimuth_deg"] % 360.0)
        assert found.size.endswith(f"and mount.altitude_deg: {stated['azimuth_deg'] % 360.0:g}")
