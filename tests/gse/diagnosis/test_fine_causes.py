"""Fine causes, injected into stars on a detector: named with their size, and nothing on clean sessions."""

import re
from dataclasses import replace

import numpy as np
import pytest
from skies.star_errors import CAMERA, SETTINGS, Truth, findings_of, made, model_of

from gse.diagnosis.fine_causes import fine_causes
from gse.mount import Mount

SITE, MOUNT = SETTINGS[0]
TRUE = Truth(SITE, MOUNT)


def found(truth, duration_s=600.0, seed=3, **noise):
    return findings_of(truth, SITE, MOUNT, duration_s, np.random.default_rng(seed), **noise)


def only(truth, duration_s=600.0):
    (finding,) = found(truth, duration_s)
    return finding


def number(pattern, text):
    return float(re.search(pattern, text)[1])


@pytest.mark.parametrize(
    ("duration_s", "noise"),
    [(60.0, {"whole_pixels": True}), (600.0, {"wander": (3.0, 30.0)}), (7200.0, {})],
    ids=["pixels", "slow", "white"],
)
def test_a_clean_session_shows_nothing(duration_s, noise):
    assert found(TRUE, duration_s, **noise) == ()


def test_a_clock_offset_is_named_with_what_looks_the_same():
    finding = only(replace(TRUE, clock_s=1.0))
    assert finding.cause == "clock offset"
    assert number(r"is ([\d.]+) s fast", finding.size) == pytest.approx(1.0, abs=0.06)
    assert {equal.split(" ")[0] for equal in finding.equals} == {"longitude", "a", "latency:"}


def test_an_azimuth_is_named_with_the_right_one():
    finding = only(replace(TRUE, mount=replace(MOUNT, azimuth_deg=130.02)))
    assert finding.cause == "mount"
    assert number(r"mount.azimuth_deg: ([\d.]+)", finding.size) == pytest.approx(130.02, abs=0.001)


def test_an_altitude_beyond_the_zenith_is_given_as_a_station_file_takes_it():
    stated = Mount(azimuth_deg=0.0, altitude_deg=90.0, roll_deg=25.0)
    true = Mount(azimuth_deg=180.0, altitude_deg=89.98, roll_deg=205.0)
    (finding,) = findings_of(Truth(SITE, true), SITE, stated, 600.0, np.random.default_rng(3))
    angles = {name: number(rf"mount.{name}_deg: ([\d.]+)", finding.size) for name in ("azimuth", "altitude", "roll")}
    assert angles == {"azimuth": 180, "altitude": pytest.approx(89.98, abs=0.001), "roll": 205}


def test_an_azimuth_beyond_north_is_given_as_a_station_file_takes_it():
    stated, true = replace(MOUNT, azimuth_deg=359.99), replace(MOUNT, azimuth_deg=0.02)
    (finding,) = findings_of(Truth(SITE, true), SITE, stated, 600.0, np.random.default_rng(3))
    assert number(r"mount.azimuth_deg: ([\d.]+)", finding.size) == pytest.approx(0.02, abs=0.001)


def test_a_mount_that_is_off_in_all_angles_is_given_them():
    true = Mount(azimuth_deg=130.02, altitude_deg=60.01, roll_deg=25.2)
    finding = only(replace(TRUE, mount=true))
    assert finding.cause == "mount"
    assert number(r"azimuth ([\d.]+), altitude", finding.size) == pytest.approx(130.02, abs=0.001)
    assert number(r"altitude ([\d.]+), roll", finding.size) == pytest.approx(60.01, abs=0.001)
    assert number(r"roll ([\d.]+) deg", finding.size) == pytest.approx(25.2, abs=0.002)


def test_a_latitude_is_named():
    finding = only(replace(TRUE, site=replace(SITE, latitude_deg=SITE.latitude_deg + 0.01)))
    assert finding.cause == "site"
    assert number(r"site.latitude_deg: (-[\d.]+)", finding.size) == pytest.approx(-6.52, abs=0.0005)


def test_air_that_is_not_there_is_named_and_no_mount():
    finding = only(replace(TRUE, site=replace(SITE, pressure_hpa=0.0)))
    assert finding.cause == "refraction"
    assert number(r"site.pressure_hpa: (-?\d+)", finding.size) == pytest.approx(0, abs=40)


def test_air_that_is_much_colder_than_stated_is_a_temperature_and_no_record_pressure():
    finding = only(replace(TRUE, site=replace(SITE, temperature_c=-40.0)))
    assert finding.cause == "refraction"
    assert number(r"site.temperature_c: (-?\d+)", finding.size) == pytest.approx(-40, abs=12)


def test_a_focal_length_is_named_and_no_moving_mount():
    finding = only(replace(TRUE, camera=replace(CAMERA, focal_length_px=4182.4)), 7200.0)
    assert finding.cause == "focal length"
    assert number(r"focal_length_px: ([\d.]+)", finding.size) == pytest.approx(4182.4, abs=0.5)


@pytest.mark.parametrize(("change", "causes"), [(1e-5, []), (1.5e-4, ["focal length"])])
def test_a_camera_is_named_only_beyond_what_places_on_the_pixels_hide(change, causes):
    """Stars move by 0.004 and 0.06 px (root mean square); centroids hide 0.01."""
    longer = replace(CAMERA, focal_length_px=CAMERA.focal_length_px * (1 + change))
    assert [finding.cause for finding in found(replace(TRUE, camera=longer), 7200.0)] == causes


def test_distortion_is_named_and_no_moving_mount():
    finding = only(replace(TRUE, camera=replace(CAMERA, radial_distortion=(0.002, 0.0))), 7200.0)
    assert finding.cause == "distortion"
    assert number(r"radial_distortion: \[([\d.]+)", finding.size) == pytest.approx(0.002, rel=0.05)


def test_one_star_in_a_corner_that_errs_is_no_distortion():
    """A fit of two terms follows it, so that its residual does not show it."""
    frames, matches = made(TRUE, SITE, MOUNT, 60.0, np.random.default_rng(1))
    off_px = np.column_stack([matches["x_px"], matches["y_px"]]) - CAMERA.principal_point_px
    radius_px = np.hypot(*off_px.T)
    corner = matches["star"] == matches["star"][radius_px.argmax()]
    for name, off in zip(("x", "y"), off_px.T, strict=True):
        matches[f"residual_{name}_arcsec"][corner] += 5 * (off / radius_px)[corner]
    model = model_of(frames, matches[(radius_px < 500) | corner], SITE, MOUNT)
    assert model.field is not None
    assert fine_causes(model) == ()


def test_a_principal_point_is_named_with_the_mount_beside_it():
    finding = only(replace(TRUE, camera=replace(CAMERA, principal_point_px=(516.5, 507.5))))
    assert finding.cause == "principal point"
    assert number(r"principal_point_px: \[([\d.]+)", finding.size) == pytest.approx(516.5, abs=0.1)
    assert number(r"principal_point_px: \[[\d.]+, ([\d.]+)", finding.size) == pytest.approx(507.5, abs=0.1)
    assert any("mount" in equal for equal in finding.equals)


def test_a_drifting_clock_is_named_in_ppm():
    finding = only(replace(TRUE, clock_ppm=-250.0), 7200.0)
    assert finding.cause == "clock drift"
    assert number(r"runs (\d+) ppm slow", finding.size) == pytest.approx(250, abs=15)


def test_a_step_of_the_clock_is_named_with_its_time():
    finding = only(replace(TRUE, clock_step_s=1.0, at_s=240.0))
    assert finding.cause == "clock step"
    assert number(r"stepped by \+([\d.]+) s", finding.size) == pytest.approx(1.0, abs=0.05)
    assert re.search(r"at 2026-03-20T15:0(3:5|4:0)\dZ", finding.size)


def test_a_slip_is_named_with_its_time():
    finding = only(replace(TRUE, slip_arcsec=(15.0, -20.0, 0.0), at_s=360.0))
    assert finding.cause == "slip of the mount"
    assert re.search(r"at 2026-03-20T15:0(5:5|6:0)\dZ", finding.size)


def test_a_mount_that_sinks_is_named():
    finding = only(replace(TRUE, moves_arcsec_per_h=(60.0, 0.0, 0.0)), 7200.0)
    assert finding.cause == "mount moves"


def test_a_thermal_swing_is_named_with_its_period():
    finding = only(replace(TRUE, wave_arcsec=(20.0, 10.0), wave_period_s=900.0), 7200.0)
    assert finding.cause == "thermal sinusoid"
    assert "period of 15 min" in finding.size
    assert number(r"\+-([\d.]+) arcsec", finding.size) == pytest.approx(22.4, abs=1.0)
    assert any("a vibration near a multiple" in equal for equal in finding.equals)


def test_vibration_is_named_with_its_size():
    finding = only(replace(TRUE, vibration_arcsec=30.0))
    assert finding.cause == "vibration"
    assert number(r"by ([\d.]+) arcsec", finding.size) == pytest.approx(42.4, rel=0.05)


def test_two_causes_that_are_there_are_both_named():
    both = replace(TRUE, camera=replace(CAMERA, focal_length_px=4182.4), slip_arcsec=(30.0, 0.0, 0.0), at_s=300.0)
    assert {finding.cause for finding in found(both)} == {"focal length", "slip of the mount"}


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"slip_arcsec": (30.0, 0.0, 0.0), "at_s": 30.0}, "slip of the mount"),
        ({"moves_arcsec_per_h": (2400.0, 0.0, 0.0)}, "mount moves"),
    ],
    ids=["slip", "moves"],
)
def test_whole_pixels_do_not_hide_what_is_plain(change, cause):
    """Stars cross a pixel in four seconds: what rounding does to them does not last a minute."""
    causes = [finding.cause for finding in found(replace(TRUE, **change), 60.0, whole_pixels=True)]
    assert causes == [cause]
