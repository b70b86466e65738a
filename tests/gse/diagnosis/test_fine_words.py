"""Findings of fine causes in words: numbers by hand, from coefficients that are given."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, f

from gse.diagnosis.competing_models import Predictions
from gse.diagnosis.fine_causes import TANGENTIAL, FineHypothesis, Named
from gse.diagnosis.fine_findings import _WORDS, Setting
from gse.diagnosis.late_frames import LateFrames
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.site import Site

SETTING = Setting(
    Camera(1024, 1024, 4000.0, (511.5, 511.5), radial_distortion=(0.001, 0.0)),
    Site(latitude_deg=48.0, longitude_deg=11.0, pressure_hpa=1000.0, temperature_c=15.0),
    Mount(azimuth_deg=130.0, altitude_deg=60.0, roll_deg=25.0),
    from_text("2026-03-20T15:00:00Z"),
    0.1,
    10.0,
)


def said(cause, *coefficients, kind="", at_s=math.nan, error=0.0, rivals=(), **setting):
    columns = Predictions(*(np.zeros((1, 1, 1)) for _ in range(3)))
    equals = tuple(FineHypothesis(rival, rival, columns) for rival in rivals)
    one = Named(
        FineHypothesis(cause, kind, columns, at_s=at_s),
        np.array(coefficients),
        np.full(len(coefficients), error),
        equals,
    )
    finding = _WORDS[cause](one, replace(SETTING, **setting))
    return f"{finding.cause}: {finding.size}; {', '.join(finding.equals)}"


@pytest.mark.parametrize(
    ("cause", "coefficients", "words"),
    [
        # Refraction goes as p / T: 50 hPa of 1000 less are as 288.15 K / 0.95, 15 K more.
        ("refraction", (-50.0,), ["site.pressure_hpa: 950, in force is 1000", "temperature (+15 K)"]),
        ("refraction", (20.0,), ["site.pressure_hpa: 1020", "temperature (-6 K)"]),
        # 1152.6 hPa are on no record: 288.15 K at 1000 hPa bend as 250 K do.
        ("refraction", (152.6,), ["temperature: the stars fit site.temperature_c: -23, in force is 15"]),
        ("focal length", (0.002,), ["0.200 % too short", "focal_length_px: 4008.00"]),
        ("focal length", (-0.002,), ["0.200 % too long", "focal_length_px: 3992.00"]),
        ("distortion", (0.004,), ["2.05 px too far in", "radial_distortion: [0.005000, 0.000000]"]),
        ("distortion", (-0.004, 0.001), ["1.54 px too far out", "radial_distortion: [-0.003000, 0.001000]"]),
        ("principal point", (2.0, -1.5), ["+2.00 px in x and -1.50 px in y", "principal_point_px: [513.50, 510.00]"]),
        # A pixel of 1 / 4000 is 51.57 arcsec.
        ("principal point", (2.0, -1.5), ["a mount turned by 129 arcsec"]),
        ("clock drift", (-250.0,), ["250 ppm slow", "0.900 s in an hour"]),
        ("clock drift", (250.0,), ["250 ppm fast"]),
        ("clock offset", (1.0,), ["clock is 1.0000 s fast", "a leap second", "latency: frames that are stamped 1.000"]),
        ("clock offset", (-1.5,), ["1.5000 s slow", "longitude_deg: 11.00627", "about the pole by -22.6 arcsec"]),
        ("clock offset", (18.0,), ["clock set to GPS time"]),
        ("clock offset", (37.0,), ["clock set to TAI"]),
        ("clock offset", (240.0,), ["longitude_deg: 9.99726"]),  # a degree, less what the Earth turns more in 240 s
        ("site", (36.0,), ["site.latitude_deg: 48.01000, stated is 48", "+1112 m on the ground"]),
        ("site", (3600.0,), ["site.latitude_deg: 49.00000"]),
        ("mount moves", (1.0, -2.0, 30.0), ["+1.0 arcsec/h in azimuth", "-2.0 arcsec/h in altitude", "+30.0"]),
        ("thermal sinusoid", (3.0, 4.0, 12.0, 84.0, 999.0), ["swings by +-85.0 arcsec across the boresight"]),
    ],
)
def test_a_cause_is_told_in_the_unit_that_an_operator_turns(cause, coefficients, words):
    text = said(cause, *coefficients)
    assert all(word in text for word in words), text


@pytest.mark.parametrize(
    ("kind", "arcsec", "words"), [("azimuth", 3600.0, "azimuth_deg: 131.00000"), ("roll", -72.0, "roll_deg: 24.98000")]
)
def test_one_angle_of_the_mount_is_given_as_it_should_be(kind, arcsec, words):
    assert words in said("mount", arcsec, kind=kind)


def test_a_size_is_told_with_twice_its_standard_error():
    assert "0.200 % too short (+- 0.01 %)" in said("focal length", 0.002, error=0.00005)
    assert "+36.0 arcsec (+- 1) in altitude" in said("mount", 36.0, kind="altitude", error=0.5)
    assert "(+36.0 +- 1 arcsec" in said("site", 36.0, error=0.5)
    assert "fast (+- 0.1 s)" in said("clock offset", 0.9, error=0.05)


@pytest.mark.parametrize(("searched", "chance"), [(1, 8e-5), (10, 8e-6)])
@pytest.mark.parametrize("columns", [1, 3])
def test_a_cause_is_worth_naming_where_noise_would_hardly_explain_as_much(searched, chance, columns):
    """One session in 500, shared by 25 causes: by chi squared of as many degrees as columns, by F of few stars."""
    none = Predictions(*(np.zeros((1, 1, columns)) for _ in range(3)))
    one = FineHypothesis("cause", "kind", none, is_change=True, searched=searched)
    assert chi2.sf(one.is_worth, columns) == pytest.approx(chance)
    assert f.sf(one.is_sure(9.0) / columns, columns, 9.0) == pytest.approx(chance)


@pytest.mark.parametrize(("at_s", "words"), [(90.0, "15:01:30Z"), (3600.0, "16:00:00Z")])
def test_what_happens_at_an_instant_is_told_with_it(at_s, words):
    assert words in said("clock step", 0.25, at_s=at_s)
    assert "stepped by +0.250 s" in said("clock step", 0.25, at_s=at_s)
    assert words in said("slip of the mount", 1.0, 2.0, 3.0, at_s=at_s)


@pytest.mark.parametrize(("at_s", "words"), [(599.0, "period of 599 s"), (900.0, "period of 15 min")])
def test_a_period_is_told_in_seconds_or_minutes(at_s, words):
    assert words in said("thermal sinusoid", 3.0, 4.0, kind="columns", at_s=at_s)
    assert "+-5.0 arcsec along columns" in said("thermal sinusoid", 3.0, 4.0, kind="columns", at_s=at_s)


def read_late(by_s, since_s=60.0):
    """Frames of five minutes that are read later from an instant on."""
    time_s = np.arange(0.0, 300.0)
    return LateFrames(SETTING.first_ns + (time_s * NS_PER_S).astype(np.int64), by_s * (time_s >= since_s))


def test_a_step_of_time_that_no_stamp_shows_may_be_the_link_and_says_so():
    text = said("clock step", -0.27, at_s=90.0)
    assert text.startswith("clock step: the host's clock stepped by -0.270 s")
    assert "a link or a proxy by which frames come 0.270 s earlier" in text
    assert "a slip of the mount about the pole by -4.1 arcsec" in text


@pytest.mark.parametrize(("delay_s", "side"), [(0.3, "later"), (-0.3, "earlier")])
def test_a_step_of_time_is_the_links_where_frames_come_as_much_later_against_the_sensors_tags(delay_s, side):
    text = said("clock step", delay_s + 0.01, at_s=90.0, late=read_late(delay_s))
    assert text.startswith(f"link delay: frames come 0.300 s {side} from 2026-03-20T15:01:00Z on")
    assert "a host whose clocks were all set by as much" in text
    assert f"about the pole by {15.04 * delay_s:+.1f} arcsec" in text


@pytest.mark.parametrize("delay_s", [0.0, -0.3, 0.2])
def test_a_step_of_time_that_neither_the_hosts_clocks_nor_the_sensors_tags_show_is_the_mounts(delay_s):
    text = said("clock step", 0.3, at_s=90.0, late=read_late(delay_s))
    assert text.startswith("slip of the mount: at 2026-03-20T15:01:30Z by +4.5 arcsec about the pole")
    assert "exposures are 0.300 s later than its time tags" in text


@pytest.mark.parametrize(
    ("arcsec", "rivals", "delay_s", "cause"),
    [
        (4.0, ["clock step"], 0.3, "link delay"),
        (4.0, [], 0.3, "slip of the mount"),
        (40.0, ["clock step"], 0.3, "slip of the mount"),
        (4.0, ["clock step"], 0.0, "slip of the mount"),
    ],
)
def test_a_slip_that_may_be_a_step_of_time_is_the_links_where_its_stamps_step(arcsec, rivals, delay_s, cause):
    text = said("slip of the mount", arcsec, kind="azimuth", at_s=90.0, rivals=rivals, late=read_late(delay_s))
    assert text.startswith(f"{cause}: ")
    assert ("clock step or link delay" in text) == (cause != "link delay" and bool(rivals))


@pytest.mark.parametrize(("off_hpa", "has_equal"), [(-299.0, True), (-301.0, False), (70.0, True)])
def test_a_temperature_is_told_as_an_equal_of_a_pressure_within_three_tenths(off_hpa, has_equal):
    assert ("temperature (" in said("refraction", off_hpa)) is has_equal


def test_a_lens_that_is_not_centred_is_told_with_what_to_write_beside_what_was_stated():
    """Three times the root of the sum of squares, at the edge of 512 px."""
    camera = replace(SETTING.camera, tangential_distortion=(0.001, -0.002))
    columns = Predictions(*(np.zeros((1, 1, 1)) for _ in range(3)))
    one = Named(FineHypothesis("distortion", TANGENTIAL, columns), np.array([0.003, 0.004]), np.zeros(2), ())
    finding = _WORDS["distortion"](one, replace(SETTING, camera=camera))
    assert "up to 7.68 px off" in finding.size
    assert "tangential_distortion: [0.004000, 0.002000]" in finding.size
    assert finding.next_step == "gse calibrate SESSION --tangential --write FILE"


@pytest.mark.parametrize(
    ("cause", "coefficients", "error", "words"),
    [
        ("principal point", (2.0, -1.5), 0.1, "(+- 0.2)"),
        ("clock drift", (250.0,), 20.0, "(+- 40)"),
        ("refraction", (-50.0,), 5.0, "(+- 10)"),
        ("focal length", (0.002,), 0.0001, "(+- 0.02 %)"),
    ],
)
def test_a_figure_has_twice_its_standard_error_beside_it(cause, coefficients, error, words):
    assert words in said(cause, *coefficients, error=error)


def clocks_apart(ppm):
    """Frames of 400 s whose host's clock runs so fast against the sensor's tags."""
    time_s = np.arange(0.0, 400.0, 0.1)
    return LateFrames(SETTING.first_ns + (time_s * NS_PER_S).astype(np.int64), 1e-6 * ppm * time_s)


@pytest.mark.parametrize(("ppm", "how"), [(1000.0, "1000 ppm fast"), (-1000.0, "1000 ppm slow")])
@pytest.mark.parametrize(
    ("cause", "coefficients"),
    [("slip of the mount", (3.6, 4.8, 1.0)), ("clock step", (0.4,)), ("mount moves", (30.0, 40.0, 5.0))],
)
def test_a_turn_of_the_sky_is_the_hosts_clock_where_its_stamps_drift_as_much_against_the_tags(
    cause, coefficients, ppm, how
):
    """In 400 s 1000 ppm are 0.4 s or 6.0 arcsec, in an hour 54."""
    text = said(cause, *coefficients, kind="azimuth", at_s=200.0, rivals=("clock drift",), late=clocks_apart(ppm))
    assert text.startswith("clock drift: ")
    assert how in text


@pytest.mark.parametrize(
    ("arcsec", "ppm", "rivals"),
    [
        (12.2, 1000.0, ("clock drift",)),  # twice as much, and a bit
        (2.9, 1000.0, ("clock drift",)),  # less than half
        (0.55, 95.0, ("clock drift",)),  # as much, but what a crystal may do
        (6.0, 1000.0, ("thermal sinusoid",)),  # the stars do not take it for a drift
    ],
)
def test_a_slip_stays_one_where_the_clocks_do_not_say_the_same(arcsec, ppm, rivals):
    text = said("slip of the mount", arcsec, kind="azimuth", at_s=200.0, rivals=rivals, late=clocks_apart(ppm))
    assert text.startswith("slip of the mount: ")


@pytest.mark.parametrize(("arcsec", "ppm"), [(11.8, 1000.0), (3.1, 1000.0), (0.63, 105.0)])
def test_a_slip_that_is_known_badly_is_the_clocks_within_a_factor_of_two(arcsec, ppm):
    text = said(
        "slip of the mount", arcsec, kind="azimuth", at_s=200.0, rivals=("clock drift",), late=clocks_apart(ppm)
    )
    assert text.startswith("clock drift: ")


@pytest.mark.parametrize(
    ("of_stars_ppm", "of_tags_ppm", "words"),
    [
        (54.0, 3.0, "mount moves: by +2.9 arcsec/h about the pole"),
        (-54.0, 3.0, "mount moves: by -2.9 arcsec/h about the pole"),
        (54.0, 26.0, "mount moves"),
        (54.0, 28.0, "clock drift: the host's clock runs 54 ppm fast"),
        (54.0, 80.0, "clock drift"),
        (54.0, 82.0, "mount moves"),
    ],
)
def test_a_turn_about_the_pole_is_the_mounts_where_the_hosts_clock_keeps_the_tags_time(
    of_stars_ppm, of_tags_ppm, words
):
    assert said("clock drift", of_stars_ppm, late=clocks_apart(of_tags_ppm)).startswith(words)


@pytest.mark.parametrize(("ppm", "is_crystal"), [(100.0, True), (101.0, False)])
def test_two_crystals_may_run_as_fast_as_each_other(ppm, is_crystal):
    assert ("clocks of host and sensor that both run" in said("clock drift", ppm, late=clocks_apart(0.0))) is is_crystal


def test_a_sensor_that_restarts_tells_the_drift_of_its_longer_life():
    late = clocks_apart(54.0)
    late.late_s[1500:] += 2000.0
    assert late.drift == pytest.approx(54e-6, rel=1e-3)


@pytest.mark.parametrize(
    ("cause", "coefficient", "words"),
    [
        (
            "clock drift",
            3.0,
            "sensor clock drift: the sensor's time tags, by which this capture has its times, run 3 ppm",
        ),
        ("clock offset", 2.0, "clock offset: the start that was given (--start-utc) is 2.00 s late"),
        ("clock step", 1.5, "sensor time tag: the sensor's time tags, by which this capture has its times, stepped by"),
    ],
)
def test_a_capture_without_host_times_says_nothing_of_the_hosts_clock(cause, coefficient, words):
    told = said(cause, coefficient, at_s=10.0, error=0.1, has_host=False)
    assert told.startswith(words)
    assert "host's clock" not in told


@pytest.mark.parametrize(
    ("cause", "kind", "coefficient", "words"),
    [
        ("pixel pitch", "columns", 0.003, "columns lie 0.300 % further (+- 0.1 %) than rows"),
        ("pixel pitch", "rows", -0.003, "rows lie 0.300 % closer (+- 0.1 %) than columns"),
        ("pixel origin", "pixel origin", -1.01, "1.01 px off along both axes: the sensor counts pixels from 1"),
        ("pixel origin", "pixel origin", 0.49, "0.49 px off along both axes: the sensor counts pixels from the corner"),
    ],
)
def test_pixels_that_are_not_square_or_counted_otherwise_are_told_with_their_size(cause, kind, coefficient, words):
    assert words in said(cause, coefficient, kind=kind, error=0.0005)


@pytest.mark.parametrize("has_host", [True, False])
def test_where_its_time_tags_are_absolute_a_clock_that_is_off_is_the_sensors(has_host):
    told = said("clock offset", 2.0, error=0.1, has_host=has_host, is_absolute=True)
    assert told.startswith("clock offset: the sensor's clock is 2.00 s fast")
