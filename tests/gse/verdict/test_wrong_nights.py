"""Nights by astropy alone with one thing wrong, judged: the word and what it is named for."""

import re
from dataclasses import replace

import numpy as np
import pytest
from skies.own_answers import with_answers
from skies.wrong_night import Plan, World, session

from gse.diagnosis.misplaced_stars import dark_half
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status, Subject, Verdict
from gse.statistics.decision import Outcome
from gse.values.site import Site
from gse.verdict.assessment import judge

SITE = Site(latitude_deg=48.2, longitude_deg=11.6, height_m=500.0, pressure_hpa=955.0, temperature_c=8.0)
WORLD = World(SITE, azimuth_deg=130.0, altitude_deg=60.0, roll_deg=30.0)
PLAN = Plan("2026-03-20T21:30:00Z", 60.0, 2.0, seed=6)


@pytest.mark.parametrize(("clock_s", "scale"), [(18.0, "GPS time"), (37.0, "TAI")])
def test_a_clock_of_another_time_scale_is_a_mistake_of_the_set_up(clock_s, scale):
    judged = judge(session(WORLD, replace(WORLD, clock_s=clock_s), PLAN))
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.reasons[0].startswith(f"set-up: clock set to {scale}: ")
    assert any("by the set-up (clock set to" in reason for reason in judged.reasons)


SHORT = replace(PLAN, seconds=20.0)
"""Forty frames."""
TURNS = {
    "a mount a little below the old threshold": {"azimuth_deg": 130.5},
    "one a little above it": {"azimuth_deg": 130.7},
    "a mount that looks too low": {"altitude_deg": 59.9},
    "a roll": {"roll_deg": 30.4},
    "a clock that is fast": {"clock_s": 20.0},
    "as much slow": {"clock_s": -20.0},
    "a minute": {"clock_s": 60.0},
    "a latitude": {"latitude_deg": 48.35},
    "a longitude": {"longitude_deg": 12.6},
}


def turned_by(change):
    of_site = {key: value for key, value in change.items() if key in ("latitude_deg", "longitude_deg")}
    return replace(WORLD.at(**of_site), **{key: value for key, value in change.items() if key not in of_site})


@pytest.mark.parametrize("change", TURNS.values(), ids=TURNS)
def test_a_turned_sky_is_the_set_ups_at_every_size_and_sign_where_nobody_vouches_for_it(change):
    judged = judge(session(WORLD, turned_by(change), SHORT))
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.reasons[0].startswith("set-up: ")
    assert "clock vouched for by the host's clock (kernel PLL, 0.01 s)" in judged.reasons[0]
    assert "nobody vouches for mount and site" in judged.reasons[0]


@pytest.mark.parametrize("change", TURNS.values(), ids=TURNS)
def test_it_is_the_sensors_where_everything_is_vouched_for(change):
    judged = judge(session(replace(WORLD, vouched=True), turned_by(change), SHORT))
    assert judged.verdict is Verdict.FAIL
    assert judged.findings[0].cause == "alignment of the sensor"
    assert "mount.uncertainty.azimuth_arcsec: 8" in judged.findings[0].size
    assert not any(reason.startswith("set-up") for reason in judged.reasons)


@pytest.mark.parametrize(
    ("true", "cause", "words"),
    [
        ({"principal_point_px": (1.0, 1.0)}, "pixel origin", "the sensor counts pixels from 1"),
        ({"principal_point_px": (-0.5, -0.5)}, "pixel origin", "from the corner of the first one"),
        ({"wider_columns": 0.002}, "pixel pitch", "columns lie 0."),
        ({"clock_s": 365 * 86_400.0}, "date off by a year", "365 days ahead of UTC"),
        ({"clock_s": -366 * 86_400.0}, "date off by a year", "366 days behind UTC"),
        ({"clock_s": -31 * 86_400.0}, "date off by days", "31 days behind UTC"),
        ({"clock_s": 181 * 86_400.0}, "date off by days", "181 days ahead of UTC"),
    ],
)
def test_a_mistake_that_looks_like_a_turned_mount_is_named_by_what_it_is(true, cause, words):
    finding = judge(session(WORLD, replace(WORLD, **true), SHORT)).findings[0]
    assert finding.cause == cause
    assert words in finding.size


@pytest.mark.parametrize("days", [-340, -270, -205, 93, 184, 306])
def test_a_date_is_told_by_its_aberration_and_precession_far_from_the_equator_too(days):
    """They are many seconds about the pole there, by which it is no clock that fits a mount that is vouched for."""
    polar = replace(WORLD.at(latitude_deg=65.0), azimuth_deg=20.0, altitude_deg=85.0, whole_pixels=False, vouched=True)
    judged = judge(session(polar, replace(polar, clock_s=days * 86_400.0), SHORT))
    assert judged.verdict is Verdict.INCONCLUSIVE
    way = "ahead of" if days > 0 else "behind"
    assert judged.reasons[0].startswith(f"set-up: date off by days: the host's date is {abs(days)} days {way} UTC")


@pytest.mark.parametrize("off_px", [(1.0, -1.0), (0.75, 0.75)])
def test_a_pixel_along_one_axis_alone_or_a_part_of_one_is_no_origin(off_px):
    found = judge(session(WORLD, replace(WORLD, principal_point_px=off_px), SHORT)).findings
    assert "pixel origin" not in {finding.cause for finding in found}


def test_a_longitude_is_named_before_the_clock_where_only_that_is_vouched_for():
    judged = judge(session(WORLD, turned_by({"longitude_deg": 12.6}), SHORT))
    assert judged.reasons[0].startswith("set-up: longitude: the stars fit site.longitude_deg: 12.6")
    assert "clock offset" in judged.findings[0].equals[0]


def test_an_exact_hit_of_a_mistake_is_named_though_everything_is_vouched_for():
    judged = judge(session(replace(WORLD, vouched=True), replace(WORLD, azimuth_deg=310.0), SHORT))
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.reasons[0].startswith("set-up: azimuth from south: ")
    assert "mount.uncertainty.azimuth_arcsec: 8" in judged.reasons[0]
    assert "both cannot be" in judged.reasons[0]


@pytest.mark.parametrize(
    ("size_px", "vouched"), [(2048, True), (2048, False), (1200, False), (1080, True), (768, False)]
)
def test_a_detector_of_another_size_is_a_mistake_of_the_set_up(size_px, vouched):
    judged = judge(session(replace(WORLD, size_px=size_px, vouched=vouched), WORLD, SHORT))
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.reasons[0].startswith("set-up: detector size: objects lie at x up to ")
    assert f"states {size_px} columns and {size_px} rows" in judged.reasons[0]
    assert "1024" in judged.reasons[0]
    assert judged.findings[0].cause == "detector size"


@pytest.mark.parametrize(("at", "off_px"), [("stated", -60.0), ("true", -60.0), ("true", -10.0)])
def test_a_principal_point_elsewhere_makes_no_other_detector(at, off_px):
    sharp = replace(WORLD, whole_pixels=False, noise_px=0.05)
    worlds = {"stated": sharp, "true": sharp} | {at: replace(sharp, principal_point_px=(off_px, 0.0))}
    found = judge(session(**worlds, plan=SHORT)).findings
    assert found[0].cause != "detector size"


def test_what_an_external_program_adds_itself_is_no_set_up():
    """It counts pixels from 1, so that its answers lie a pixel off the stars that it names."""
    made = session(WORLD, WORLD, SHORT)
    station = made.station
    limits = replace(station.limits, d_ra_cosde_arcsec=20.0, d_de_arcsec=20.0)
    external = replace(station.identifier, algorithm="external", command=("./onboard",))
    made.station = station.model_copy(update={"identifier": external, "limits": limits})
    frames, pixel_arcsec = made.frames.columns, 49.465
    for axis in ("x", "y"):
        frames[f"cross_{axis}_arcsec"] += pixel_arcsec
        made.frames.matches[f"residual_{axis}_arcsec"] += pixel_arcsec
    roll = np.radians(frames["roll_true_deg"])
    frames["d_ra_cosde_arcsec"] += pixel_arcsec * (np.cos(roll) + np.sin(roll))
    frames["d_de_arcsec"] += pixel_arcsec * (np.sin(roll) - np.cos(roll))
    assert judge(made).verdict is Verdict.FAIL


def test_a_sensor_whose_picture_stands_still_is_frozen_and_no_moving_mount():
    """Its time tags go on; clean whole pixels of the same night are seldom those of the frame before."""
    (finding,) = judge(session(WORLD, replace(WORLD, frozen_from_s=20.0), PLAN)).findings
    assert finding.cause == "frozen sensor"
    assert finding.size.startswith("81 panoramas in a row show the same objects on the same pixels, for 40 s")


def test_a_sensor_that_sends_no_brightness_fails_with_the_reason():
    judged = judge(session(WORLD, replace(WORLD, brightness=False), PLAN))
    assert judged.verdict is Verdict.FAIL
    (finding,) = judged.findings
    assert finding.cause == "faulty panoramas"
    assert "the same for all objects" in finding.size


def test_an_identifier_that_knows_too_few_stars_is_named_and_not_the_optics():
    """A field of eight degrees: 20 stars to magnitude 7.3, and 4 to the catalogue's 6.6."""
    world = replace(WORLD, azimuth_deg=133.87, roll_deg=-94.94, focal_length_px=7322.0, faintest_mag=7.6)
    world = replace(world, altitude_deg=60.0, whole_pixels=False)
    assessment = judge(session(world, world, Plan("2026-03-20T21:30:00Z", 4.0, 3.0, 1)))
    (finding,) = assessment.findings
    assert finding.cause == "identifier without an answer"
    assert "none of 12 panoramas" in finding.size
    assert "its catalogue holds 4" in finding.size or "its catalogue holds 3" in finding.size
    assert "identifier.catalog_stars" in finding.next_step


def test_errors_that_single_stars_explain_are_their_noise():
    world = replace(WORLD, size_px=512, focal_length_px=703.0, faintest_mag=4.6, whole_pixels=False, noise_px=0.6)
    told = judge(session(world, world, replace(PLAN, seconds=40.0)))
    (finding,) = told.findings
    assert finding.cause == "centroid noise"
    assert "(0.6" in finding.size or "(0.5" in finding.size


LENS = replace(WORLD, focal_length_px=731.0, faintest_mag=3.9, whole_pixels=False, noise_px=0.1)


def test_a_wide_lens_that_is_not_as_stated_is_no_fault_of_the_identifier():
    """Half of the stars at the edge are not where they are looked for, and the answers of such panoramas are wrong."""
    told = judge(session(LENS, replace(LENS, k1=-0.01), replace(PLAN, seconds=20.0, rate_hz=3.0)))
    assert [finding.cause for finding in told.findings] == ["distortion"]
    assert told.verdict is Verdict.INCONCLUSIVE
    assert told.reasons[0].startswith("set-up: distortion: ")


def test_a_wide_lens_that_leaves_few_right_answers_is_the_cameras():
    told = judge(session(LENS, replace(LENS, k1=-0.01), replace(PLAN, seconds=12.0)))
    (finding,) = told.findings
    assert finding.cause == "camera"
    assert "a distortion of the lens" in finding.equals


def test_a_wide_field_that_reaches_to_the_horizon_is_told_before_the_camera():
    low = replace(LENS, altitude_deg=30.0)
    told = judge(session(low, replace(low, k1=-0.03), replace(PLAN, seconds=12.0)))
    assert told.findings[0].cause == "field near the horizon"
    assert "down to an altitude of" in told.findings[0].size


def test_a_distortion_is_told_in_a_field_that_reaches_to_the_horizon():
    low = replace(LENS, altitude_deg=30.0)
    told = judge(session(low, replace(low, k1=-0.01), replace(PLAN, seconds=12.0)))
    assert [finding.cause for finding in told.findings] == ["distortion"]
    assert "radial_distortion: [-0.01" in told.findings[0].size


def test_air_that_is_not_that_of_the_height_fails_no_sensor():
    world = replace(WORLD, altitude_deg=20.0, whole_pixels=False)
    told = judge(session(world.at(pressure_hpa=0.0), world, PLAN))
    assert told.findings[0].cause == "refraction"
    assert told.verdict is Verdict.INCONCLUSIVE
    assert any("by the set-up (refraction)" in reason for reason in told.reasons)


def test_a_proxy_that_delays_each_frame_is_no_step_of_the_clock():
    world = replace(WORLD, whole_pixels=False, noise_px=0.1, at_s=30.0)
    (finding,) = judge(session(world, replace(world, late_s=0.6), replace(PLAN, seconds=120.0))).findings
    assert finding.cause == "link delay"
    assert finding.size.startswith("frames come 0.600 s later from 2026-03-20T21:30:30Z on")


@pytest.mark.parametrize("seconds", [60.0, 200.0])
@pytest.mark.parametrize("times", [1.0, 0.99727], ids=["sidereal", "solar"])
def test_a_drive_is_a_mistake_of_the_set_up(times, seconds):
    judged = judge(session(WORLD, replace(WORLD, driven=times), replace(PLAN, seconds=seconds, rate_hz=1.0)))
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.reasons[0].startswith("set-up: mount follows the sky: the sensor sees the same stars all the time")
    assert "nobody vouches for mount and site" in judged.reasons[0]
    assert [finding.cause for finding in judged.findings] == ["mount follows the sky"]


@pytest.mark.parametrize(
    ("stated", "true"),
    [({"vouched": True}, {"driven": 1.0}), ({}, {"frozen_from_s": 0.0})],
    ids=["a mount that is vouched for", "a picture that stands still"],
)
def test_it_is_none_of_another(stated, true):
    stated = replace(WORLD, **stated)
    assert judge(session(stated, replace(stated, **true), PLAN)).verdict is Verdict.FAIL


@pytest.mark.parametrize(("off_arcsec", "word"), [(0.0, Verdict.INCONCLUSIVE), (100.0, Verdict.FAIL)])
def test_own_answers_are_judged_on_the_mount_that_a_drive_turns(off_arcsec, word):
    """By a degree and a half, so that the last of them lie a degree from most."""
    made = session(WORLD, replace(WORLD, driven=1.0), replace(PLAN, seconds=600.0, rate_hz=0.5))
    angles = np.column_stack([made.frames.columns[f"{name}_deg"] for name in ("ra", "de", "roll")])
    angles[:, 1] += off_arcsec / 3600
    judged = judge(with_answers(made, angles, np.full(len(angles), 12)))
    assert judged.verdict is word
    failing = {row.name for row in judged.rows if row.outcome is Outcome.FAIL}
    assert failing == ({"mean |dDE|", "95 % of |dDE|"} if off_arcsec else set())
    assert {row.subject for row in judged.rows if row.outcome is Outcome.FAIL} <= {Subject.SENSOR}


EQUATOR = Site(latitude_deg=-6.53, longitude_deg=106.7, height_m=200.0, pressure_hpa=985.0, temperature_c=24.0)
OPEN = World(EQUATOR, azimuth_deg=40.0, altitude_deg=62.0, roll_deg=20.0, whole_pixels=False)
"""A field of sixteen expected stars."""
EVENING = Plan("2026-03-20T15:00:00Z", 20.0, 2.0, seed=6)


@pytest.mark.parametrize("wall_px", [360.0, 680.0])
def test_a_wall_in_the_field_is_named_by_the_side_on_which_it_stands(wall_px):
    told = judge(session(OPEN, replace(OPEN, wall_px=wall_px), EVENING))
    assert told.findings[0].cause == "obstruction"
    assert "left side of the image" in told.findings[0].size
    assert told.verdict is not Verdict.FAIL


def test_a_cloud_that_takes_as_many_stars_is_no_wall():
    told = judge(session(OPEN, replace(OPEN, clouds=((0.0, 99.0, 1.2),)), EVENING))
    assert "obstruction" not in {finding.cause for finding in told.findings}


EAST = replace(OPEN, azimuth_deg=100.0)
HALF_DARK = replace(EAST, wall_px=512.0, dew_share=0.9)


@pytest.mark.parametrize(("at_s", "when"), [(0.0, ""), (10.0, "in the second half of the session, ")])
def test_half_of_a_field_that_shows_hardly_a_star_is_named_with_both_halves(at_s, when):
    told = judge(session(EAST, replace(HALF_DARK, at_s=at_s), EVENING))
    (finding,) = [one for one in told.findings if one.cause == "half of the field"]
    words = re.fullmatch(
        when + r"of (\d+) expected stars in the left half of the image (\d+) % were seen, of (\d+) in the right half "
        r"(\d+) %",
        finding.size,
    )
    dark, dark_percent, light, light_percent = map(int, words.groups())
    assert min(dark, light) >= 6
    assert dark_percent < 25
    assert light_percent > 90
    assert told.verdict is not Verdict.FAIL


NO_DARK_HALF = {
    "a clear sky": EAST,
    "dew that hides half of the stars": replace(HALF_DARK, dew_share=0.5),
    "a cloud": replace(EAST, clouds=((0.0, 99.0, 1.2),)),
    "too few stars to tell": replace(HALF_DARK, faintest_mag=5.2),
    "a third of the field": replace(HALF_DARK, wall_px=150.0),
}


@pytest.mark.parametrize("true", NO_DARK_HALF.values(), ids=NO_DARK_HALF)
def test_no_half_of_the_field_is_named_without_strong_evidence(true):
    assert not list(dark_half(session(EAST, true, EVENING)))


def test_a_mount_that_turns_is_named_and_no_vibration_beside_it():
    turning = replace(WORLD, moves_arcsec_per_h=(3600.0, 0.0, 0.0))
    told = judge(session(WORLD, turning, replace(PLAN, seconds=200.0)))
    assert [finding.cause for finding in told.findings] == ["mount moves"]


@pytest.mark.parametrize(("noise_px", "k1", "cause"), [(1.1, 0.0, "centroid noise"), (0.1, 0.02, "identifier without")])
def test_an_identifier_that_noise_keeps_from_answering_is_told_from_one_whose_stars_lie_elsewhere(noise_px, k1, cause):
    stated = replace(WORLD, whole_pixels=False)
    true = replace(stated, noise_px=noise_px, k1=k1)
    finding = judge(session(stated, true, SHORT)).findings[0]
    assert finding.cause.startswith(cause)


BY_TAGS = replace(PLAN, raw=True)


@pytest.mark.parametrize("vouched", [True, False])
@pytest.mark.parametrize("ppm", [400_000.0, -500_000.0])
def test_time_tags_that_run_wrong_are_a_mistake_of_the_set_up(ppm, vouched):
    stated = replace(WORLD, whole_pixels=False, noise_px=0.1, vouched=vouched)
    judged = judge(session(stated, replace(stated, clock_ppm=ppm), BY_TAGS))
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.reasons[0].startswith("set-up: sensor clock drift: the sensor's time tags")
    ran, way = judged.findings[0].size.split(" run ")[1].split(" ppm ")
    assert float(ran) == pytest.approx(abs(ppm), rel=0.01)
    assert way.startswith("fast" if ppm > 0 else "slow")


def test_time_tags_that_run_wrong_excuse_no_sensor_that_looks_elsewhere():
    stated = replace(WORLD, whole_pixels=False, noise_px=0.1, vouched=True)
    true = replace(stated, clock_ppm=400_000.0, altitude_deg=WORLD.altitude_deg + 0.05)
    assert judge(session(stated, true, BY_TAGS)).verdict is Verdict.FAIL


@pytest.mark.parametrize("off_px", [(1.0, -1.0), (20.0, 0.0)], ids=["by less than false_arcsec", "by more"])
def test_answers_that_truth_confirms_are_not_false_where_the_camera_is_stated_wrongly(off_px):
    """Its panoramas, seen by that camera, lie elsewhere: the reference would say so of each answer."""
    true = session(WORLD, WORLD, SHORT)
    made = session(WORLD, replace(WORLD, principal_point_px=off_px), SHORT)
    angles = np.column_stack([true.frames.columns[f"{name}_true_deg"] for name in ("ra", "de", "roll")])
    judged = judge(with_answers(made, angles, np.full(len(angles), 12)))
    own = judged.statistics.subjects[Subject.SENSOR]
    assert (own.false_answers.value, own.available.value) == (0.0, 1.0)
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.findings[0].cause in ("principal point", "pixel origin")


def beside_own_answers(stated, true, plan=SHORT, de_off_arcsec=0.0):
    """Panoramas of a true world, with own answers that are as the stated mount and site have them."""
    right, made = session(stated, stated, plan), session(stated, true, plan)
    angles = np.column_stack([right.frames.columns[f"{name}_true_deg"] for name in ("ra", "de", "roll")])
    return judge(with_answers(made, angles + np.array([0.0, de_off_arcsec / 3600, 0.0]), np.full(len(angles), 12)))


VOUCHED = replace(WORLD, vouched=True)
OF_CAMERA = {
    "one that the field shows": ({"principal_point_px": (20.0, 0.0)}, "principal point", "_point_px: [531.5"),
    "one that is turned": ({"altitude_deg": 60.1}, "camera", "all panoramas are turned by 358 arcsec"),
    "one that is rolled": ({"roll_deg": 30.6}, "camera", "all panoramas are turned by 0.61 deg"),
}


@pytest.mark.parametrize(("true", "cause", "words"), OF_CAMERA.values(), ids=OF_CAMERA)
def test_a_camera_is_not_as_stated_where_truth_confirms_the_sensors_own_answers(true, cause, words):
    judged = beside_own_answers(VOUCHED, replace(VOUCHED, **true))
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert judged.reasons[0].startswith(f"set-up: {cause}: ")
    assert words in judged.findings[0].size
    assert "the sensor's own answers show no turn of" in judged.findings[0].size
    assert not {"alignment of the sensor", "sensor bias", "sensor roll"} & {one.cause for one in judged.findings}


def test_own_answers_that_are_off_too_confirm_no_camera():
    judged = beside_own_answers(VOUCHED, replace(VOUCHED, principal_point_px=(20.0, 0.0)), de_off_arcsec=100.0)
    assert judged.verdict is Verdict.FAIL
    assert judged.findings[0].cause == "alignment of the sensor"


@pytest.mark.parametrize(("check", "expected"), [(AnswerCheck.ABSENT, 120), (AnswerCheck.UNKNOWN, 40)])
def test_answers_missing_under_the_moon_count_only_where_the_reference_has_them(check, expected):
    made = session(WORLD, WORLD, PLAN)
    frames = made.frames.columns
    glare = slice(30, 110)
    frames["moon_altitude_deg"], frames["moon_separation_deg"] = 40.0, 3.0
    frames["status"][glare], frames["answer_check"][glare] = STATUSES.index(Status.NO_MATCH), ANSWER_CHECKS.index(check)
    frames["stars_seen"][glare], frames["objects"][glare] = 5, 25
    judged = judge(made)
    assert judged.findings[0].cause == "the Moon"
    assert judged.findings[0].size.startswith("it was in the field in 80 of 80 frames without an answer of onboard: ")
    assert judged.statistics.subjects[Subject.ONBOARD].available.of == expected
