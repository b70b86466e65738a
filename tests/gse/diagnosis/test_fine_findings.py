"""Limits and terms of the findings of fine causes, each from both sides, worked by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gse.diagnosis.competing_models import Predictions
from gse.diagnosis.fine_causes import TANGENTIAL, FineHypothesis, Named
from gse.diagnosis.fine_findings import _WORDS, Setting, Vibration, _vibration
from gse.diagnosis.late_frames import LateFrames
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.site import Site

SETTING = Setting(
    Camera(1024, 1024, 4000.0, (511.5, 511.5)),
    Site(latitude_deg=48.0, longitude_deg=11.0, pressure_hpa=1000.0, temperature_c=15.0),
    Mount(azimuth_deg=130.0, altitude_deg=60.0, roll_deg=25.0),
    from_text("2026-03-20T15:00:00Z"),
    0.4,
    10.0,
)
NONE = Predictions(*(np.zeros((1, 1, 1)) for _ in range(3)))


def found(cause, *coefficients, kind="", at_s=math.nan, errors=None, rivals=(), setting=SETTING):
    """The finding; rivals are pairs of cause and kind."""
    equals = tuple(FineHypothesis(*rival, NONE) for rival in rivals)
    sizes = np.array(coefficients)
    known = np.zeros(len(sizes)) if errors is None else np.array(errors)
    return _WORDS[cause](Named(FineHypothesis(cause, kind, NONE, at_s=at_s), sizes, known, equals), setting)


def delayed(by_s, late_from_s=60.0, first_s=0.0):
    """Five minutes of frames that are read later from an instant on."""
    time_s = np.arange(first_s, 300.0)
    return LateFrames(SETTING.first_ns + (time_s * NS_PER_S).astype(np.int64), by_s * (time_s >= late_from_s))


def drifting(ppm):
    """Frames of 400 s whose host's clock runs so fast against the sensor's tags."""
    time_s = np.arange(0.0, 400.0, 0.1)
    return LateFrames(SETTING.first_ns + (time_s * NS_PER_S).astype(np.int64), 1e-6 * ppm * time_s)


def with_late(late):
    return replace(SETTING, late=late)


# What cannot be told apart


@pytest.mark.parametrize(
    ("rival", "words"),
    [
        (("clock offset", "clock"), "clock offset or longitude"),
        (("clock step", "clock step"), "clock step or link delay"),
        (("mount", "azimuth"), "mount (azimuth)"),
        (("mount", "mount"), "mount"),
        (("distortion", "k1 and k2"), "distortion"),
        (("distortion", TANGENTIAL), "distortion (tangential)"),
        (("refraction", "refraction"), "refraction"),
    ],
)
def test_a_rival_is_told_by_its_cause_and_by_its_kind_where_that_says_more(rival, words):
    assert found("focal length", 0.002, rivals=[rival]).equals == (words,)


def test_a_rival_of_the_same_cause_is_not_told_and_another_one_once():
    rivals = [("focal length", "other"), ("refraction", "refraction"), ("refraction", "refraction")]
    assert found("focal length", 0.002, rivals=rivals).equals == ("refraction",)


# Clock offset


@pytest.mark.parametrize(
    ("fast_s", "words"),
    [
        (2.4, "latency: frames that are stamped 2.400 s late"),
        (0.6, "latency: frames that are stamped 0.600 s late"),
        (-0.6, "latency: frames that are stamped 0.600 s early"),
        (-2.4, "latency: frames that are stamped 2.400 s early"),
        (2.5, None),
        (-2.5, None),
        (2.6, None),
    ],
)
def test_a_latency_of_less_than_two_and_a_half_seconds_looks_like_a_clock(fast_s, words):
    assert [equal for equal in found("clock offset", fast_s).equals if "latency" in equal] == ([words] if words else [])


@pytest.mark.parametrize(
    ("fast_s", "error_s", "exposure_s", "end"),
    [
        (0.2, 0.01, 0.4, "one end"),
        (-0.2, 0.01, 0.4, "one end"),
        (0.229, 0.01, 0.4, "one end"),
        (0.231, 0.01, 0.4, None),
        (0.171, 0.01, 0.4, "one end"),
        (0.169, 0.01, 0.4, None),
        (0.4, 0.01, 0.4, "the wrong end"),
        (-0.429, 0.01, 0.4, "the wrong end"),
        (-0.431, 0.01, 0.4, None),
        (0.2, 0.033, 0.4, "one end"),
        (0.2, 0.034, 0.4, None),  # known no better than a quarter of the exposure: it may be anything
        (0.34375, 0.03125, 0.5, None),  # three standard errors from half the exposure, exactly
        (0.1875, 0.03125, 0.375, None),  # three standard errors are a quarter, exactly
    ],
)
def test_half_an_exposure_or_a_whole_one_within_three_standard_errors_may_be_a_stamp_of_an_end(
    fast_s, error_s, exposure_s, end
):
    equals = found("clock offset", fast_s, errors=[error_s], setting=replace(SETTING, exposure_s=exposure_s)).equals
    stamps = [equal for equal in equals if "time stamp" in equal]
    assert stamps == ([f"a time stamp of {end} of the exposure ({exposure_s:g} s)"] if end else [])


def test_a_date_that_is_off_by_whole_days_looks_like_a_clock():
    """A sidereal day is 235.9 s shorter than a day."""
    equals = found("clock offset", 471.8).equals
    assert "a date that is 2 days ahead" in equals
    assert "a date that is 2 days behind" in found("clock offset", -471.8).equals


@pytest.mark.parametrize(
    ("fast_s", "error_s", "is_leap"),
    [
        (1.0, 0.2, True),
        (-1.0, 0.2, True),
        (1.0, 0.21, False),  # so badly known it is near to a second by chance
        (1.375, 0.125, True),  # three standard errors
        (1.38, 0.125, False),
        (0.625, 0.125, True),
        (0.62, 0.125, False),
    ],
)
def test_a_second_within_three_standard_errors_that_is_known_is_a_leap_second(fast_s, error_s, is_leap):
    assert found("clock offset", fast_s, errors=[error_s]).size.endswith(": a leap second") is is_leap


@pytest.mark.parametrize(
    ("fast_s", "error_s", "cause"),
    [
        (18.0, 0.2, "clock set to GPS time"),
        (18.2, 0.1, "clock set to GPS time"),
        (18.4, 0.1, "clock offset"),
        (-18.0, 0.1, "clock offset"),
        (36.8, 0.1, "clock set to TAI"),
        (37.0, 0.3, "clock offset"),
        (36.0, 0.1, "clock offset"),
    ],
)
def test_a_clock_that_is_fast_by_a_time_scale_is_called_after_it(fast_s, error_s, cause):
    assert found("clock offset", fast_s, errors=[error_s]).cause == cause


@pytest.mark.parametrize(
    ("error_s", "words"),
    [
        (0.0, "77.1235 s fast (+- 0 s)"),
        (0.00005, "77.1235 s fast (+- 0.0001 s)"),
        (0.004, "77.1235 s fast (+- 0.008 s)"),
        (0.05, "77.123 s fast (+- 0.1 s)"),
        (0.4, "77.12 s fast (+- 0.8 s)"),
        (1.0, "77.1 s fast (+- 2 s)"),
        (4.0, "77.1 s fast (+- 8 s)"),
        (20.0, "77 s fast (+- 40 s)"),
        (300.0, "77 s fast (+- 600 s)"),
    ],
)
def test_a_clock_is_told_to_the_second_digit_of_its_error_of_four_at_most(error_s, words):
    assert words in found("clock offset", 77.12346, errors=[error_s]).size


@pytest.mark.parametrize(("fast_s", "side"), [(0.4, "fast"), (-0.4, "slow")])
def test_a_clock_that_is_off_by_a_part_of_a_second_has_its_side(fast_s, side):
    assert f"0.4000 s {side}" in found("clock offset", fast_s).size


# The mount


def test_a_mount_that_is_turned_across_its_boresight_goes_along_a_great_circle():
    """A degree to the right at an altitude of 60 deg: by Napier's rules.

    The great circle begins level. At its end it points below the horizontal by as much as the roll has changed.
    """
    finding = found("mount", 3600.0, 0.0, 0.0, kind="mount")
    degree, altitude = math.radians(1.0), math.radians(60.0)
    fits_altitude = math.asin(math.sin(altitude) * math.cos(degree))
    fits_azimuth = 130.0 + math.degrees(math.atan2(math.tan(degree), math.cos(altitude)))
    dips = math.degrees(math.acos(math.cos(altitude) / math.cos(fits_altitude)))
    assert finding.size == (
        "it is off by +3600.0 arcsec in azimuth (on the sky), +0.0 arcsec in altitude, +0.0 arcsec in roll: the stars "
        f"fit azimuth {fits_azimuth:.5f}, altitude {math.degrees(fits_altitude):.5f}, roll {25.0 - dips:.4f} deg"
    )


@pytest.mark.parametrize(
    ("coefficients", "words"),
    [
        ((0.0, 3600.0, 0.0), "azimuth 130.00000, altitude 61.00000, roll 25.0000 deg"),
        ((0.0, -7200.0, 0.0), "azimuth 130.00000, altitude 58.00000, roll 25.0000 deg"),
        ((0.0, 0.0, 1800.0), "azimuth 130.00000, altitude 60.00000, roll 25.5000 deg"),
    ],
)
def test_a_mount_that_is_turned_up_or_about_its_boresight_has_that_angle_otherwise(coefficients, words):
    assert words in found("mount", *coefficients, kind="mount").size


def test_three_angles_of_a_mount_are_what_an_alignment_writes():
    finding = found("mount", 1.0, 2.0, 3.0, kind="mount")
    assert finding.cause == "mount"
    assert finding.next_step == "gse align SESSION --write FILE"


def turned_about_the_pole(arcsec, aside_arcsec=0.0):
    """The three angles of a mount that is turned eastwards about the pole at 48 deg, and by a little in altitude."""
    latitude, azimuth, altitude = (math.radians(angle) for angle in (48.0, 130.0, 60.0))
    polar = np.array([0.0, math.cos(latitude), math.sin(latitude)])
    along = np.array([math.sin(azimuth), math.cos(azimuth), 0.0])
    boresight = math.cos(altitude) * along + [0.0, 0.0, math.sin(altitude)]
    to_the_right = np.array([along[1], -along[0], 0.0])
    level = to_the_right, np.cross(to_the_right, boresight)
    up, right = float(level[0] @ polar), float(level[1] @ polar)
    return arcsec * -right, arcsec * up + aside_arcsec, arcsec * -float(boresight @ polar)


@pytest.mark.parametrize(("days", "side"), [(365, "ahead"), (-365, "behind")])
@pytest.mark.parametrize(("aside_arcsec", "is_told"), [(0.0, True), (50.0, True), (70.0, False)])
def test_a_mount_that_is_turned_as_by_a_wrong_year_may_be_one(days, side, aside_arcsec, is_told):
    """365 days are 57 s less than 366 turns of the Earth, and precession turns aside.

    The sky of a date that is ahead seems to lie 57 s further east than it should: so does the mount, about the pole.
    """
    short_s = 366 * 86_164.0905 - 365 * 86_400
    turns = turned_about_the_pole(math.copysign(15.04107 * short_s, days), aside_arcsec)
    finding = found("mount", *turns, kind="mount")
    assert finding.equals == (f"a date that is 365 days {side}",) * is_told
    assert finding.next_step.startswith("see whether the host's date is right" if is_told else "gse align")


@pytest.mark.parametrize(
    ("altitude_deg", "arcsec", "words"),
    [
        (89.0, 3600.0, "mount.altitude_deg: 90.00000"),
        (89.0, 1800.0, "mount.altitude_deg: 89.50000"),
        (89.0, 5400.0, "mount.azimuth_deg: 50, mount.altitude_deg: 89.50000, mount.roll_deg: 20"),
        (90.0, 360.0, "mount.azimuth_deg: 50, mount.altitude_deg: 89.90000, mount.roll_deg: 20"),
    ],
)
def test_an_altitude_beyond_the_zenith_is_told_from_the_other_side(altitude_deg, arcsec, words):
    mount = Mount(azimuth_deg=230.0, altitude_deg=altitude_deg, roll_deg=200.0)
    finding = found("mount", arcsec, kind="altitude", setting=replace(SETTING, mount=mount))
    assert finding.size.endswith(f"the stars fit {words}")


@pytest.mark.parametrize(
    ("azimuth_deg", "arcsec", "words"),
    [
        (359.5, 1800.0, "360.00000"),
        (359.5, 3600.0, "0.50000"),
        (-359.5, 0.0, "-359.50000"),
        (-359.5, -1800.0, "-360.00000"),
        (-359.5, -3600.0, "359.50000"),
        (-10.0, 3600.0, "-9.00000"),
    ],
)
def test_an_azimuth_beyond_a_whole_turn_is_told_within_it(azimuth_deg, arcsec, words):
    """A station file takes -360 to 360."""
    mount = replace(SETTING.mount, azimuth_deg=azimuth_deg)
    finding = found("mount", arcsec, kind="azimuth", setting=replace(SETTING, mount=mount))
    assert finding.size.endswith(f"the stars fit mount.azimuth_deg: {words}")


# The site and the camera


def test_a_latitude_is_told_with_its_error_and_as_a_way_on_the_ground():
    """A second of latitude is 30.9 m."""
    finding = found("site", -36.0, errors=[1.5])
    assert finding.size == (
        "latitude: the stars fit site.latitude_deg: 47.99000, stated is 48 (-36.0 +- 3 arcsec, -1112 m on the ground)"
    )
    assert finding.equals == ("a mount that leans to north or south",)


@pytest.mark.parametrize(
    ("error", "words"), [(0.0000751, "0.02 %"), (0.0000747, "0.01 %"), (0.0005, "0.1 %"), (0.0, "0 %")]
)
def test_a_focal_length_has_twice_its_error_in_per_cent(error, words):
    assert f"too short (+- {words})" in found("focal length", 0.002, errors=[error]).size


@pytest.mark.parametrize(("k1", "words"), [(0.0005, "0.26 px too far in"), (-0.0005, "0.26 px too far out")])
def test_stars_of_a_lens_that_pulls_more_than_stated_lie_too_far_in(k1, words):
    assert words in found("distortion", k1).size


def test_a_principal_point_has_the_greater_error_of_both_and_a_turn_that_looks_the_same():
    """250 px of atan(1 / 4000) are 12 891.55 arcsec."""
    finding = found("principal point", 200.0, -150.0, errors=[0.1, 0.3])
    assert "+200.00 px in x and -150.00 px in y (+- 0.6): the stars fit" in finding.size
    assert finding.size.endswith("sensor.principal_point_px: [711.50, 361.50]")
    assert finding.equals == ("a mount turned by 12892 arcsec, were it not for the field's edges",)


# Air


def test_air_that_is_known_badly_has_twice_its_error():
    finding = found("refraction", -50.0, errors=[3.0])
    assert finding.size == "pressure: the stars fit site.pressure_hpa: 950, in force is 1000 (+- 6)"
    assert finding.equals == ("temperature (+15 K)",)


@pytest.mark.parametrize(
    ("off_hpa", "words"),
    [
        (85.0, "pressure: the stars fit site.pressure_hpa: 1085, in force is 1000 (+- 20)"),
        # 1086 hPa are on no record. 288.15 K at 1000 hPa bend as 265.33 K do, and 8 hPa of 1086 are 2.12 K.
        (86.0, "temperature: the stars fit site.temperature_c: -8, in force is 15 (+- 4)"),
    ],
)
def test_a_pressure_beyond_any_record_is_a_temperature(off_hpa, words):
    assert found("refraction", off_hpa, errors=[8.0]).size == words


def test_what_is_a_temperature_has_no_temperature_beside_it():
    assert found("refraction", 86.0).equals == ()
    assert found("refraction", 85.0).equals == ("temperature (-23 K)",)


@pytest.mark.parametrize(
    ("stated_hpa", "off_hpa", "equals"),
    [(1000.0, -300.0, ()), (0.5, 0.1, ("temperature (-48 K)",)), (0.0, 100.0, ()), (0.0, 0.0, ())],
)
def test_a_temperature_looks_the_same_within_three_tenths_of_a_pressure(stated_hpa, off_hpa, equals):
    site = replace(SETTING.site, pressure_hpa=stated_hpa)
    assert found("refraction", off_hpa, setting=replace(SETTING, site=site)).equals == equals


# Drifts and steps


@pytest.mark.parametrize(("ppm", "words"), [(0.6, "1 ppm fast"), (-0.6, "1 ppm slow")])
def test_a_clock_that_drifts_has_its_side_and_error(ppm, words):
    finding = found("clock drift", ppm, errors=[0.1])
    assert finding.size == f"the host's clock runs {words} (+- 0.2), 0.002 s in an hour"
    assert finding.equals == ("a mount that turns about the pole",)


def test_without_stamps_a_mount_that_moves_is_no_clock():
    """As far as the sky turns in an hour: a clock that stands still would show the same."""
    finding = found("mount moves", 54_148.0, 0.0, 0.0, kind="mount moves", rivals=[("clock drift", "clock drift")])
    assert finding.cause == "mount moves"
    assert finding.equals == ("a sensor whose optics drift", "clock drift")


@pytest.mark.parametrize(
    ("coefficients", "cause"),
    [
        (
            (20.0, 60.0, 500.0),
            "clock drift",
        ),  # the root of the squares is 63, 1000 ppm make 54: roll counts for nothing
        ((10.0, 10.0, 500.0), "mount moves"),
        ((100.0, 60.0, 0.0), "mount moves"),
        ((26.0, 0.0, 0.0), "mount moves"),
        ((28.0, 0.0, 0.0), "clock drift"),
        ((107.0, 0.0, 0.0), "clock drift"),
        ((109.0, 0.0, 0.0), "mount moves"),
    ],
)
def test_a_mount_moves_as_much_as_a_clock_within_a_factor_of_two_across_the_sky(coefficients, cause):
    rivals = [("clock drift", "clock drift")]
    finding = found("mount moves", *coefficients, kind="mount moves", rivals=rivals, setting=with_late(drifting(1000)))
    assert finding.cause == cause


def test_a_clock_that_drifts_by_stamps_and_stars_is_told_with_both():
    rivals = [("clock drift", "clock drift")]
    finding = found("mount moves", 54.0, 0.0, 0.0, kind="all", rivals=rivals, setting=with_late(drifting(1000)))
    assert finding.size == (
        "the host's clock runs 1000 ppm fast, by its stamps against the sensor's time tags and by the stars (+54.0 "
        "arcsec/h in azimuth (on the sky), +0.0 arcsec/h in altitude, +0.0 arcsec/h in roll)"
    )
    assert finding.equals == ("a sensor's clock that drifts, beside a mount that moves as much",)


@pytest.mark.parametrize(
    ("coefficients", "cause"),
    [((3.6, 4.8, 200.0), "clock drift"), ((2.0, 7.0, 0.0), "clock drift"), ((2.0, 2.0, 9.0), "slip of the mount")],
)
def test_a_slip_is_as_much_as_a_clock_across_the_sky(coefficients, cause):
    """400 s of 1000 ppm are 6.0 arcsec."""
    rivals = [("clock drift", "clock drift")]
    setting = with_late(drifting(1000))
    assert found("slip of the mount", *coefficients, at_s=200.0, rivals=rivals, setting=setting).cause == cause


@pytest.mark.parametrize(
    ("step_s", "delay_s", "error_s", "cause"),
    [
        (0.34375, 0.25, 0.03125, "link delay"),  # three standard errors apart
        (0.35, 0.25, 0.03125, "slip of the mount"),
        (0.26, 0.25, 0.0, "link delay"),
        (0.28, 0.25, 0.0, "slip of the mount"),  # 30 ms, more than an adapter has
        (0.375, 0.375, 0.1249, "link delay"),
        (0.375, 0.375, 0.125, "slip of the mount"),  # a delay that the stars do not know from none
        (0.019, 0.019, 0.0, "slip of the mount"),
        (0.021, 0.021, 0.0, "link delay"),
    ],
)
def test_a_step_of_time_is_the_links_where_it_is_the_same_within_its_error_and_more_than_that(
    step_s, delay_s, error_s, cause
):
    setting = with_late(delayed(delay_s))
    assert found("clock step", step_s, at_s=90.0, errors=[error_s], setting=setting).cause == cause


def test_a_step_of_time_is_told_to_the_second_and_with_its_side():
    early = found("clock step", -0.4, at_s=90.5, setting=with_late(delayed(0.0)))
    assert early.size == "at 2026-03-20T15:01:30Z by -6.0 arcsec about the pole"
    assert early.equals == ("a sensor whose exposures are 0.400 s earlier than its time tags from then on",)
    alone = found("clock step", 0.4, at_s=90.5)
    assert alone.size == "the host's clock stepped by +0.400 s at 2026-03-20T15:01:30Z"
    assert alone.equals[0] == "a link or a proxy by which frames come 0.400 s later from then on"


def test_a_delay_is_told_from_the_second_on_in_which_it_begins():
    setting = with_late(delayed(0.3, late_from_s=60.5, first_s=0.5))
    assert "0.300 s later from 2026-03-20T15:01:00Z on, by" in found("clock step", 0.3, at_s=90.0, setting=setting).size


@pytest.mark.parametrize(
    ("coefficients", "delay_s", "cause"),
    [
        ((4.0, 3.0, 200.0), 0.3, "link delay"),  # 0.3 s are 4.5 arcsec: 5 are less than twice as much
        ((5.0, 7.4, 0.0), 0.3, "link delay"),  # 8.93 of 9.02
        ((5.0, 7.6, 0.0), 0.3, "slip of the mount"),  # 9.10
        ((0.1, 0.0, 0.0), 0.02, "slip of the mount"),  # an adapter's latency
        ((0.1, 0.0, 0.0), 0.0201, "link delay"),
        ((0.1, 0.0, 0.0), -0.0201, "link delay"),
    ],
)
def test_a_slip_is_the_links_where_its_delay_turns_the_sky_half_as_much(coefficients, delay_s, cause):
    rivals, setting = [("clock step", "clock step")], with_late(delayed(delay_s))
    assert found("slip of the mount", *coefficients, at_s=90.0, rivals=rivals, setting=setting).cause == cause


def test_without_stamps_a_step_of_time_may_be_the_sensors_own():
    """The time of a raw capture is that of its tags, from the stated start on: the host's clock has no part in it."""
    equals = found("clock step", -0.994, at_s=299.0).equals
    assert [text.split(",")[0] for text in equals[1:]] == [
        "a step of the sensor's own time tags",
        "a slip of the mount about the pole by -15.0 arcsec",
    ]


def test_without_stamps_a_slip_is_the_mounts():
    rivals = [("clock step", "clock step"), ("clock drift", "clock drift")]
    finding = found("slip of the mount", 4.0, 0.0, 0.0, kind="slip", at_s=30.0, rivals=rivals)
    assert finding.cause == "slip of the mount"
    assert finding.size.startswith("at 2026-03-20T15:00:30Z by +4.0 arcsec in azimuth (on the sky), ")
    assert finding.equals == ("clock step or link delay", "clock drift")


# What swings and shakes


@pytest.mark.parametrize(("at_s", "beats"), [(19.9, True), (20.0, False), (600.0, False)])
def test_a_swing_of_fewer_than_two_hundred_frames_may_be_a_vibration_that_beats_with_them(at_s, beats):
    said = "a vibration near a multiple of 10 Hz, the frame rate, with which it beats"
    expected = ("a mount that swings", said) if beats else ("a mount that swings",)
    assert found("thermal sinusoid", 3.0, 4.0, kind="rows", at_s=at_s).equals == expected


@pytest.mark.parametrize(
    ("at_s", "words"), [(599.4, "599 s"), (600.0, "10 min"), (600.5, "10 min"), (36_000.0, "600 min")]
)
def test_a_period_is_told_in_minutes_from_ten_on(at_s, words):
    size = found("thermal sinusoid", 3.0, 4.0, kind="rows", at_s=at_s).size
    assert size == f"the boresight swings by +-5.0 arcsec along rows with a period of {words}"


@pytest.mark.parametrize(
    ("frequency_hz", "words"),
    [(math.nan, ""), (2.345, ", at 2.35 Hz (or that plus or minus a multiple of 10 Hz)")],
)
def test_a_vibration_has_its_size_and_a_frequency_where_one_stands_out(frequency_hz, words):
    finding = _vibration(Vibration(3.04, 1.96, frequency_hz, 10.0))
    assert finding.cause == "vibration"
    assert (
        finding.size
        == f"the boresight shakes by 3.0 arcsec (rms) more than the 2.0 arcsec that its stars explain{words}"
    )
    assert finding.equals == ("seeing or exposures that smear",)
    assert finding.next_step == "stop what shakes (fan, wind, steps on the roof) and repeat the session"


@pytest.mark.parametrize(
    ("cause", "words"),
    [
        ("clock offset", "clock is 0.0000 s slow (+- 0 s)"),
        ("focal length", "it is 0.000 % too long (+- 0 %)"),
        ("distortion", "0.00 px too far out"),
        ("clock drift", "runs 0 ppm slow"),
    ],
)
def test_what_is_off_by_nothing_has_the_side_of_what_is_less(cause, words):
    assert words in found(cause, 0.0).size


def test_a_time_that_is_off_by_nothing_is_early():
    assert "latency: frames that are stamped 0.000 s early" in found("clock offset", 0.0).equals
    link, _, slip = found("clock step", 0.0, at_s=60.0).equals
    assert link == "a link or a proxy by which frames come 0.000 s earlier from then on"
    assert slip == "a slip of the mount about the pole by +0.0 arcsec"
