"""Gross causes, each injected into skies of astropy alone."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skies.astropy_attitudes import BOGOR, FIELD, MOUNT, MUNICH, SITES, START_NS, TABLE, attitudes

from gse.diagnosis.gross_causes import RawAttitudes, _of_angle, gross_cause, wrong_dates
from gse.values.instant import NS_PER_S
from gse.values.mount import Mount, MountUncertainty


def found(site, mount, true_site=None, true_mount=None, clock_s=0.0):
    cause = gross_cause(attitudes(true_site or site, true_mount or mount, clock_s), site, mount, TABLE)
    return cause.finding if cause else None


@pytest.mark.parametrize("site", SITES, ids=lambda site: f"{site.latitude_deg}")
def test_a_right_set_up_shows_nothing(site):
    assert found(site, MOUNT) is None


@pytest.mark.parametrize("site", SITES, ids=lambda site: f"{site.latitude_deg}")
@pytest.mark.parametrize(
    ("cause", "change"),
    [
        ("latitude sign", lambda site: {"latitude_deg": -site.latitude_deg}),
        ("longitude sign", lambda site: {"longitude_deg": -site.longitude_deg}),
        (
            "latitude and longitude signs",
            lambda site: {"latitude_deg": -site.latitude_deg, "longitude_deg": -site.longitude_deg},
        ),
        (
            "latitude and longitude exchanged",
            lambda site: {"latitude_deg": site.longitude_deg, "longitude_deg": site.latitude_deg},
        ),
    ],
)
def test_a_wrong_sign_or_order_of_the_site_is_named(site, cause, change):
    if cause.endswith("exchanged") and abs(site.longitude_deg) > 90:
        pytest.skip("no station file can state it")
    true = replace(site, **change(site))
    finding = found(site, MOUNT, true_site=true)
    assert finding.cause == cause
    stated = [f"site.{name}: {value:g}" for name, value in change(site).items()]
    assert finding.size.startswith(f"the stars fit {' and '.join(stated)};")
    assert finding.equals == ()


@pytest.mark.parametrize(
    ("cause", "true"),
    [
        ("azimuth from south", {"azimuth_deg": 310.0}),
        ("azimuth off by 90 deg", {"azimuth_deg": 220.0}),
        ("azimuth off by 90 deg", {"azimuth_deg": 40.0}),
        ("azimuth counted westwards", {"azimuth_deg": 230.0}),
        ("wrong hemisphere of the mount", {"azimuth_deg": 50.0}),
        ("zenith distance for altitude", {"altitude_deg": 30.0}),
        ("roll off by 90 deg", {"roll_deg": 115.0}),
        ("roll off by 90 deg", {"roll_deg": 295.0}),
        ("roll off by 180 deg", {"roll_deg": 205.0}),
        ("roll sign", {"roll_deg": 335.0}),
    ],
)
def test_a_wrong_angle_of_the_mount_is_named_with_the_right_one(cause, true):
    finding = found(BOGOR, MOUNT, true_mount=replace(MOUNT, **true))
    assert finding.cause == cause
    ((name, value),) = true.items()
    assert f"mount.{name}: {value:g};" in finding.size
    assert finding.equals == ()


@pytest.mark.parametrize(
    ("clock_s", "cause", "words"),
    [
        (7 * 3600, "clock set to local time", "7 h ahead of UTC, as the local time of the zone UTC+7"),
        (-4 * 3600, "clock set to local time", "4 h behind UTC, as the local time of the zone UTC-4"),
        (5.75 * 3600, "clock set to local time", "UTC+5:45"),
        (86400, "clock off by a day", "one day ahead"),
        (-86400, "clock off by a day", "one day behind"),
        (12345.0, "clock offset", "3 h 25 min 45 s fast"),
    ],
)
@pytest.mark.parametrize("site", SITES, ids=lambda site: f"{site.latitude_deg}")
def test_a_clock_that_is_off_is_named_with_its_offset(site, clock_s, cause, words):
    finding = found(site, MOUNT, clock_s=clock_s)
    assert finding.cause == cause
    assert words in finding.size


@pytest.mark.parametrize(("longitude_deg", "clock_s"), [(106.7, 12345.0), (150.0, -12345.0), (-150.0, 12345.0)])
def test_a_clock_offset_has_the_longitude_as_its_equal_under_which_the_sky_stands_as_it_was_seen(
    longitude_deg, clock_s
):
    """The Earth turns by 360.98565 deg in a day."""
    finding = found(replace(MUNICH, longitude_deg=longitude_deg), MOUNT, clock_s=clock_s)
    (fits_deg,) = (float(re.search(r"site\.longitude_deg: (-?[\d.]+)", equal)[1]) for equal in finding.equals[:1])
    apart_deg = fits_deg - (longitude_deg - 360.98565 * clock_s / 86400)
    assert apart_deg == pytest.approx(360 * round(apart_deg / 360), abs=0.02)
    assert -180 <= fits_deg < 180


def test_at_the_zenith_azimuth_and_roll_are_equals():
    finding = found(MUNICH, Mount(), true_mount=Mount(azimuth_deg=90.0))
    assert "azimuth" in finding.cause
    assert any("roll" in equal for equal in finding.equals)


@pytest.mark.parametrize(
    ("true", "words"),
    [
        ({"azimuth_deg": 167.3}, "mount.azimuth_deg: 167.300"),
        ({"altitude_deg": 57.0}, "mount.altitude_deg: 57.000"),
        ({"roll_deg": 30.0}, "mount.roll_deg: 30.000"),
        ({"azimuth_deg": 10.0, "altitude_deg": 50.0, "roll_deg": 77.0}, "azimuth 10.00, altitude 50.00, roll 77.00"),
    ],
)
def test_a_mount_that_no_single_mistake_explains_is_given_its_angles(true, words):
    finding = found(MUNICH, MOUNT, true_mount=replace(MOUNT, **true))
    assert finding.cause == "mount"
    assert words in finding.size


def test_a_latitude_that_is_wrong_is_named():
    finding = found(MUNICH, MOUNT, true_site=replace(MUNICH, latitude_deg=53.2))
    assert finding.cause == "latitude"
    assert "site.latitude_deg: 53.200" in finding.size


@pytest.mark.parametrize("beyond_deg", [0.0, 0.0005])
def test_a_mount_at_the_zenith_or_a_hair_beyond_is_an_equal_of_the_latitude(beyond_deg):
    true = Mount(azimuth_deg=180.0, altitude_deg=90.0 - beyond_deg, roll_deg=205.0)
    stated = Mount(azimuth_deg=0.0, altitude_deg=89.5, roll_deg=25.0)
    finding = found(MUNICH, stated, true_mount=true)
    told = [finding.cause + ": " + finding.size, *finding.equals]
    assert any("mount.altitude_deg: 90.000" in text for text in told), told
    assert any("latitude (" in text or text.startswith("latitude:") for text in told), told


def test_another_town_is_named_with_its_place():
    finding = found(MUNICH, MOUNT, true_site=replace(MUNICH, latitude_deg=46.9, longitude_deg=9.5))
    assert finding.cause == "site"
    assert "latitude_deg: 46.9" in finding.size
    assert "longitude_deg: 9.5" in finding.size
    assert finding.equals == ("a mount whose base is not level",)


def test_another_continent_is_named_with_its_place():
    finding = found(BOGOR, MOUNT, true_site=replace(MUNICH, latitude_deg=2.0, longitude_deg=16.0))
    assert finding.cause == "site"
    assert "latitude_deg: 2.0" in finding.size or "latitude_deg: 1.99" in finding.size
    assert "longitude_deg: 16.0" in finding.size or "longitude_deg: 15.99" in finding.size


def test_a_gross_mistake_is_named_on_a_mount_that_was_set_by_hand_too():
    finding = found(MUNICH, replace(MOUNT, altitude_deg=59.9), true_site=replace(MUNICH, latitude_deg=-48.2),
                    true_mount=MOUNT)  # fmt: skip
    assert finding.cause == "latitude sign"
    assert "all but 0.10 deg" in finding.size


def test_one_false_answer_among_the_frames_changes_nothing():
    raw = attitudes(MUNICH, MOUNT, 7 * 3600.0, frames=5)
    rotations = raw.icrs_to_sensor.copy()
    rotations[2] = rotations[2].T
    finding = gross_cause(replace(raw, icrs_to_sensor=rotations), MUNICH, MOUNT, TABLE).finding
    assert finding.cause == "clock set to local time"


def test_a_mount_that_is_driven_with_the_sky_is_named():
    still = attitudes(MUNICH, MOUNT).icrs_to_sensor[:1]
    raw = RawAttitudes(START_NS + np.arange(5) * 600 * NS_PER_S, np.repeat(still, 5, axis=0), FIELD)
    cause = gross_cause(raw, MUNICH, MOUNT, TABLE)
    assert cause.finding.cause == "mount follows the sky"
    assert not cause.is_exact
    # the second is as near to half of the five as the third, and 1800 s of 15.041 arcsec from the last
    assert cause.finding.size.endswith("while the ground turned by 7.52 deg")
    assert cause.finding.is_gross


@pytest.mark.parametrize(
    ("thousands", "words"), [(1, "1,000 times as fast"), (2, "1,000,000 times as fast"), (-1, "slowly")]
)
def test_a_sky_that_turns_a_thousand_times_too_fast_is_told_by_another_unit_of_the_tags(thousands, words):
    raw = attitudes(MUNICH, MOUNT, frames=9)
    squeezed_ns = raw.utc_ns[0] + np.round((raw.utc_ns - raw.utc_ns[0]) / 1000.0**thousands).astype(np.int64)
    finding = gross_cause(replace(raw, utc_ns=squeezed_ns), MUNICH, MOUNT, TABLE).finding
    assert finding.cause == "time tags in another unit"
    assert words in finding.size


def switched(*elsewhere, frames=9):
    """Answers of which some show the sky 20 deg aside."""
    raw, other = (attitudes(MUNICH, replace(MOUNT, azimuth_deg=azimuth), frames=frames) for azimuth in (130.0, 150.0))
    rotations = raw.icrs_to_sensor.copy()
    rotations[list(elsewhere)] = other.icrs_to_sensor[list(elsewhere)]
    return gross_cause(replace(raw, icrs_to_sensor=rotations), MUNICH, MOUNT, TABLE)


@pytest.mark.parametrize("elsewhere", [(1, 3, 5, 7), (0, 1, 4, 5, 8), (2, 5, 6)])
def test_two_pointings_that_alternate_are_no_mount_that_follows_the_sky(elsewhere):
    finding = switched(*elsewhere).finding
    assert finding.cause == "two pointings"
    assert "20.00 deg apart" in finding.size


def test_directions_that_come_and_go_are_no_other_unit_of_the_tags():
    """From one panorama to the next the sky turns a thousand times too fast, to and fro."""
    raw, other = (attitudes(MUNICH, replace(MOUNT, azimuth_deg=azimuth), frames=15) for azimuth in (130.0, 220.0))
    rotations, away = raw.icrs_to_sensor.copy(), np.arange(15) % 3 == 1
    rotations[away] = other.icrs_to_sensor[away]
    quick = raw.utc_ns[0] + np.arange(15) * (13 * NS_PER_S)
    finding = gross_cause(replace(raw, icrs_to_sensor=rotations, utc_ns=quick), MUNICH, MOUNT, TABLE).finding
    assert finding.cause != "time tags in another unit"


def test_a_mount_that_was_moved_once_is_told_with_the_time():
    finding = switched(5, 6, 7, 8).finding
    assert finding.cause == "slip of the mount"
    assert finding.size.startswith("before ")


def test_a_mount_that_turns_steadily_was_not_moved_once():
    """By 0.5 deg of roll: half of the answers lie near to a first direction, and half to a second one."""
    raw = attitudes(MUNICH, MOUNT, frames=15)
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, np.radians(0.5), 15), [0, 0, 1])).as_matrix()
    cause = gross_cause(replace(raw, icrs_to_sensor=turns @ raw.icrs_to_sensor), MUNICH, MOUNT, TABLE)
    assert cause is None or cause.finding.cause != "slip of the mount"


def test_a_single_answer_elsewhere_is_a_false_one():
    assert switched(4) is None


def test_an_error_of_a_fifth_of_a_degree_is_not_gross():
    assert found(MUNICH, MOUNT, true_mount=replace(MOUNT, altitude_deg=60.2)) is None


@pytest.mark.parametrize(("off_deg", "is_gross"), [(0.29, False), (0.31, True), (-0.29, False), (-0.31, True)])
def test_an_error_of_three_tenths_of_a_degree_is_the_least_that_is_gross(off_deg, is_gross):
    finding = found(MUNICH, MOUNT, true_mount=replace(MOUNT, altitude_deg=60.0 + off_deg))
    assert (finding is not None) == is_gross
    assert finding is None or f"its altitude is off by {off_deg:+.3f} deg" in finding.size


def test_a_clock_that_no_zone_explains_is_a_gross_finding():
    finding = found(MUNICH, MOUNT, clock_s=12345.0)
    assert (finding.cause, finding.is_gross) == ("clock offset", True)


def test_one_sign_is_named_before_two_where_the_second_changes_nothing():
    date_line = replace(MUNICH, longitude_deg=180.0)
    finding = found(replace(date_line, latitude_deg=-48.2), MOUNT, true_site=date_line)
    assert finding.cause == "latitude sign"
    assert "latitude and longitude signs" in finding.equals[0]


def test_azimuth_and_altitude_exchanged_are_named():
    true = replace(MOUNT, azimuth_deg=35.0)
    finding = found(MUNICH, replace(true, azimuth_deg=60.0, altitude_deg=35.0), true_mount=true)
    assert finding.cause == "azimuth and altitude exchanged"
    assert "mount.azimuth_deg: 35 and mount.altitude_deg: 60" in finding.size


@pytest.mark.parametrize(("hours", "zone"), [(5.5, "UTC+5:30"), (-3.5, "UTC-3:30"), (5.75, "UTC+5:45")])
def test_a_zone_of_half_an_hour_is_named_beside_a_mount_set_by_hand(hours, zone):
    by_hand = replace(MOUNT, azimuth_deg=MOUNT.azimuth_deg + 0.1)
    finding = found(BOGOR, MOUNT, true_mount=by_hand, clock_s=hours * 3600)
    assert finding.cause == "clock set to local time"
    assert zone in finding.size


@pytest.mark.parametrize(("days", "words"), [(30, "30 days ahead"), (-7, "7 days behind"), (366, "366 days ahead")])
def test_a_date_off_by_days_is_an_equal_of_the_clock_that_turns_as_much(days, words):
    fast_s = days * 86_400 - round(days * 86_400 / 86_164.0905) * 86_164.0905 + 2.0
    assert f"a date that is {words}" in list(wrong_dates(fast_s))
    assert not list(wrong_dates(fast_s + 60))


@pytest.mark.parametrize(
    ("name", "fits_deg", "words"),
    [
        ("azimuth", 5.0, "azimuth is off by -125.000 deg: the stars fit mount.azimuth_deg: 5.000"),
        ("azimuth", 350.0, "azimuth is off by -140.000 deg: the stars fit mount.azimuth_deg: 350.000"),
        ("roll", 355.0, "roll is off by -30.000 deg: the stars fit mount.roll_deg: 355.000"),
        ("altitude", 55.0, "altitude is off by -5.000 deg: the stars fit mount.altitude_deg: 55.000"),
        ("altitude", -10.0, "altitude is off by -70.000 deg: the stars fit mount.altitude_deg: -10.000"),
    ],
)
def test_an_angle_that_is_off_is_told_as_a_station_file_takes_it(name, fits_deg, words):
    finding = _of_angle(name, MOUNT, replace(MOUNT, **{f"{name}_deg": fits_deg}))
    assert words in finding.size
    assert finding.is_gross


@pytest.mark.parametrize(
    ("true", "true_site"),
    [({"azimuth_deg": 10.0, "altitude_deg": 50.0, "roll_deg": 77.0}, MUNICH), ({}, replace(MUNICH, latitude_deg=53.2)),
     ({}, replace(MUNICH, latitude_deg=46.9, longitude_deg=9.5)), ({"roll_deg": 30.0}, MUNICH)],
)  # fmt: skip
def test_each_turn_of_a_set_up_is_a_gross_finding(true, true_site):
    assert found(MUNICH, MOUNT, true_site=true_site, true_mount=replace(MOUNT, **true)).is_gross


# Limits


@pytest.mark.parametrize(("altitude_deg", "equals"), [(89.9999, ["azimuth off by 90 deg"]), (89.99, [])])
def test_a_mistake_that_leaves_more_than_noise_is_no_equal(altitude_deg, equals):
    """Near the zenith azimuth is as good as roll: a quarter turn of it leaves 1.4 times the distance."""
    stated = replace(MOUNT, altitude_deg=altitude_deg)
    finding = found(MUNICH, stated, true_mount=replace(stated, roll_deg=115.0))
    assert finding.cause == ("azimuth off by 90 deg" if equals else "roll off by 90 deg")
    assert [one.split(" (")[0] for one in finding.equals] == ["roll off by 90 deg"] * bool(equals)
    assert "; that explains 90.00 deg, all but " in finding.size


@pytest.mark.parametrize(
    ("true_azimuth_deg", "words"),
    [
        # Stated is 0.5, westwards it is 359.5
        (359.6, "its azimuth is off by -0.900 deg: the stars fit mount.azimuth_deg: 359.600"),
        (359.501, "the stars fit mount.azimuth_deg: 359.5; that explains 1.00 deg, all but 4 arcsec"),
    ],
)
def test_a_mistake_must_leave_noise_where_an_angle_leaves_nothing(true_azimuth_deg, words):
    stated = replace(MOUNT, azimuth_deg=0.5)
    finding = found(MUNICH, stated, true_mount=replace(stated, azimuth_deg=true_azimuth_deg))
    assert finding.size == words


@pytest.mark.parametrize(("vouched_arcsec", "is_exact"), [(10.0, False), (200.0, True)])
def test_a_mistake_is_exact_within_what_is_stated_of_the_mount(vouched_arcsec, is_exact):
    known = MountUncertainty(azimuth_arcsec=vouched_arcsec, altitude_arcsec=vouched_arcsec)
    raw = attitudes(MUNICH, replace(MOUNT, azimuth_deg=310.0, altitude_deg=60.05))
    cause = gross_cause(raw, MUNICH, replace(MOUNT, uncertainty=known), TABLE)
    assert (cause.finding.cause, cause.is_exact) == ("azimuth from south", is_exact)


def tilted(off_deg, *frames):
    """Five answers of a mount that is turned by 20 deg, some of them turned about the boresight."""
    raw = attitudes(MUNICH, replace(MOUNT, azimuth_deg=150.0), frames=5)
    rotations = raw.icrs_to_sensor.copy()
    for frame in frames:
        rotations[frame] = Rotation.from_rotvec([0.0, 0.0, off_deg], degrees=True).as_matrix() @ rotations[frame]
    return gross_cause(replace(raw, icrs_to_sensor=rotations), MUNICH, MOUNT, TABLE)


def test_three_of_five_frames_must_hold_still():
    assert "its azimuth is off by +20.0" in tilted(30.0, 1, 2).finding.size
    raw = attitudes(MUNICH, replace(MOUNT, azimuth_deg=150.0), frames=5)
    rotations = raw.icrs_to_sensor.copy()
    for frame, off_deg in ((0, 30.0), (2, -50.0), (4, 90.0)):
        rotations[frame] = Rotation.from_rotvec([0.0, 0.0, off_deg], degrees=True).as_matrix() @ rotations[frame]
    assert gross_cause(replace(raw, icrs_to_sensor=rotations), MUNICH, MOUNT, TABLE) is None


@pytest.mark.parametrize(("share", "is_driven"), [(0.19, True), (0.21, False)])
def test_a_mount_follows_the_sky_where_the_sensor_sees_it_turn_by_less_than_a_fifth_of_the_ground(share, is_driven):
    """Of five answers half lie 600 s from the middle one, the last 1800 s; the mount goes with the sky otherwise."""
    fixed = 3 * share / (1 + 3 * share)
    still, places = attitudes(MUNICH, MOUNT).icrs_to_sensor[0], np.array([-3, -1, 0, 1, 3])
    turns_deg = np.outer(-fixed * 600 * 15.041067 / 3600 * places, [0.0, 0.0, 1.0])
    rotations = still @ Rotation.from_rotvec(turns_deg, degrees=True).as_matrix()
    cause = gross_cause(RawAttitudes(START_NS + (places + 3) * 600 * NS_PER_S, rotations, FIELD), MUNICH, MOUNT, TABLE)
    assert (cause is not None and cause.finding.cause == "mount follows the sky") is is_driven
