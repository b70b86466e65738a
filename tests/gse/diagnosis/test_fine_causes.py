"""Fine causes, injected into stars on a detector: named with their size, and nothing on clean sessions."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from scipy.optimize import brentq
from skies.star_errors import CAMERA, SETTINGS, Truth, findings_of, made, model_of

from gse.diagnosis.competing_models import Observed, Predictions, by_its_noise, fitted
from gse.diagnosis.field_patterns import FieldOfErrors, StarErrors
from gse.diagnosis.fine_causes import (
    FineHypothesis,
    _beside,
    _explains,
    _is_rest,
    _is_seen,
    _of_its_noise,
    _outlasts_stars,
    _refined,
    _without_idle,
    fine_causes,
    score,
    together,
    told,
)
from gse.diagnosis.session_model import ErrorSeries, SessionModel
from gse.values.mount import Mount

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


# Causes that compete, by hand

K = 40
"""Ordinates; the errors are of 80 frames."""
NOISE = np.random.default_rng(1).normal(size=(K, 3))
WORTH = float(scipy.stats.chi2.isf(0.002 / 25, 1))
"""What a column must gain: noise does as much in one of 12 500 sessions."""


def seen(cosines=NOISE, *, parameters=(0.0, 0.0, 0.0), of_field=1.0, freedom=0.0):
    """Errors with these ordinates; a field whose parameters are known to 1 over the root of ``of_field``."""
    normal = of_field * np.eye(3)
    return Observed(80, np.zeros(3), np.eye(3), cosines, normal, normal @ np.array(parameters), freedom)


def with_ordinates(**at):
    """Noise of which some ordinates along columns are other ones."""
    cosines = NOISE.copy()
    for name, value in at.items():
        cosines[int(name[1:]), 0] = value
    return cosines


def cause(*ordinates, name="cause", field=(), **options):
    """What stands in one ordinate along columns (a column for each), or in one parameter of the field."""
    count = len(ordinates) + len(field)
    cosines, parameters = np.zeros((K, 3, count)), np.zeros((3, count))
    for column, place in enumerate(ordinates):
        cosines[place, 0, column] = 1.0
    for column, place in enumerate(field, start=len(ordinates)):
        parameters[place, column] = 1.0
    return FineHypothesis(name, name, Predictions(np.zeros((3, count)), cosines, parameters), **options)


def test_causes_stand_side_by_side_in_their_order():
    columns = together(seen(), [cause(4), cause(7, field=[2])])
    assert [part.shape for part in (columns.mean, columns.cosines, columns.field)] == [(3, 3), (K, 3, 3), (3, 3)]
    assert columns.cosines[[4, 7, 7], 0, [0, 1, 2]].tolist() == [1.0, 1.0, 0.0]
    assert columns.field[2].tolist() == [0.0, 0.0, 1.0]
    nothing = together(seen(), [])
    assert [part.shape for part in (nothing.mean, nothing.cosines, nothing.field)] == [(3, 0), (K, 3, 0), (3, 0)]


def test_a_score_is_twice_the_likelihood_less_what_the_last_cause_costs():
    """Five for a column, and twice the logarithm of the places at which it was looked for."""
    observed, first, last = seen(with_ordinates(_4=20.0)), cause(4, searched=9), cause(7, 8, searched=30)
    assert score(observed, []) == fitted(observed, together(observed, [])).twice_log_likelihood
    both = fitted(observed, first.columns + last.columns).twice_log_likelihood
    assert score(observed, [first, last]) == pytest.approx(both - 10 - 2 * math.log(30))
    assert _explains(observed, [first, last]) == pytest.approx(both - 10)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("sigmas", "is_possible"), [(2.98, True), (3.02, False)])
def test_a_cause_is_hopeless_whose_first_coefficient_lies_three_sigmas_outside_of_its_bounds(side, sigmas, is_possible):
    """Parameters are 7, 0.5 and -2, each known to a hundredth; the earlier cause has no bounds."""
    observed = seen(parameters=(7.0, 0.5, -2.0), of_field=1e4, freedom=1e8)
    bound = 0.5 - side * sigmas * 0.01
    bounds = (-math.inf, bound) if side > 0 else (bound, math.inf)
    last = cause(field=[1, 2], bounds=bounds)
    found = score(observed, [cause(field=[0], bounds=(-1.0, 1.0)), last])
    assert math.isfinite(found) if is_possible else found == -math.inf


@pytest.mark.parametrize(
    ("named", "beside"),
    [
        ([], set()),
        (["clock offset"], {"clock offset", "mount", "site", "pixel origin"}),
        (["site"], {"clock offset", "mount", "site", "pixel origin"}),
        (["mount moves"], {"clock drift", "mount moves"}),
        (["refraction"], {"focal length", "distortion", "refraction", "pixel pitch"}),
        (["principal point"], set()),
        (["clock step", "thermal sinusoid"], set()),
        (["mount", "clock drift"], {"clock offset", "mount", "site", "pixel origin", "clock drift", "mount moves"}),
    ],
)
def test_a_constant_error_a_drift_and_a_pattern_of_the_field_have_one_cause_each(named, beside):
    assert _beside([cause(4, name=name) for name in named]) == beside


def test_what_slow_noise_gains_is_that_of_what_other_causes_leave_with_and_without_a_change():
    """A cause in one ordinate alone takes all of it."""
    slow = NOISE * np.array([300.0, 200.0, 100.0, 60.0, 40.0, 30.0, 20.0] + [1.0] * (K - 7))[:, None]
    first, change = cause(20), cause(1, is_change=True)
    without = slow.copy()
    without[20, 0] = 0.0
    left = without.copy()
    left[1, 0] = 0.0
    observed = seen(slow)
    assert _of_its_noise(observed, [first], change) == pytest.approx(by_its_noise(without, left), rel=1e-6)
    assert by_its_noise(without, left) > 5
    assert _of_its_noise(observed, [first], replace(change, is_change=False)) == 0.0


def with_field(*, moved_px=(), least_px=0.01, by_star=None, right_by_star=None, normal=None, right=None):
    none = np.zeros(0)
    field = FieldOfErrors(normal, right, 1.0, by_star, right_by_star, none, none, None, np.array(moved_px), least_px)
    series = ErrorSeries(np.arange(80), np.arange(80.0), np.zeros((80, 3)))
    return SessionModel(series, field, SITE, MOUNT, False, np.eye(3))


@pytest.mark.parametrize(
    ("known", "least_px", "is_seen"),
    [
        # Of three stars one moves by 5 px per unit, the others by none: 2.887 px in the mean square, 0.2 of it
        (0.0, 0.5773, True),
        (0.0, 0.5774, False),
        (0.1999, 0.0, True),
        (0.2001, 0.0, False),
    ],
)
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_cause_moves_the_stars_by_more_than_pixels_hide_and_than_is_stated(known, least_px, is_seen, sign):
    observed = seen(parameters=(8.0, 0.2 * sign, 0.0), of_field=1e8, freedom=1e8)
    moved = np.zeros((3, 2, 3))
    moved[0, :, 1] = 3.0, -4.0
    moved[:, :, 0] = 100.0
    model = with_field(moved_px=moved, least_px=least_px)
    assert _is_seen(model, observed, [cause(field=[0])], cause(field=[1], known=known)) is is_seen


@pytest.mark.parametrize(("known", "is_seen"), [(0.19, True), (0.21, False)])
def test_of_two_coefficients_the_first_is_stated_so_well(known, is_seen):
    observed = seen(parameters=(8.0, 0.2, 50.0), of_field=1e8, freedom=1e8)
    model = with_field(moved_px=np.ones((3, 2, 3)))
    assert _is_seen(model, observed, [cause(field=[0])], cause(field=[1, 2], known=known)) is is_seen


def test_a_cause_that_moves_no_star_over_the_field_is_seen_and_so_are_all_without_stars():
    observed = seen(parameters=(0.1, 0.0, 0.0), of_field=1e8, freedom=1e8)
    model = with_field(moved_px=np.zeros((2, 2, 3)))
    assert _is_seen(model, observed, [], cause(4, known=1e9))
    assert not _is_seen(model, observed, [], cause(field=[0]))
    assert _is_seen(replace(model, field=None), observed, [], cause(field=[0], known=1e9))


def at_place(place, tried):
    """A bump about an ordinate, which notes where it was moved to."""
    cosines = np.zeros((K, 3, 1))
    cosines[:, 0, 0] = np.exp(-0.5 * ((np.arange(K) - place) / 3) ** 2)
    tried.append(place)
    columns = Predictions(np.zeros((3, 1)), cosines, np.zeros((3, 1)))
    return FineHypothesis("bump", "bump", columns, place=place, spacing=4.0, moved=lambda other: at_place(other, tried))


@pytest.mark.parametrize("true_place", [17.3125, 18.6875, 18.0])
def test_a_place_is_refined_to_a_64th_of_the_distance_of_those_that_were_tried(true_place):
    """Half of it to either side first."""
    observed = seen(1e-3 * NOISE + 30 * at_place(true_place, []).columns.cosines[:, :, 0])
    tried = []
    found = _refined(observed, [], at_place(18.0, tried))
    assert found.place == true_place
    assert tried[:3] == [18.0, 16.0, 20.0]
    assert len(tried) == 1 + 2 * 6


def test_a_place_is_refined_beside_the_causes_that_are_named_already():
    tried = []
    other = at_place(19.0, [])
    observed = seen(1e-3 * NOISE + 30 * (other.columns.cosines + at_place(16.5, []).columns.cosines)[:, :, 0])
    assert _refined(observed, [other], at_place(18.0, tried)).place == 16.5


@pytest.mark.parametrize(
    ("earlier", "size", "is_rest"),
    [
        ({5: 100.0}, 19.9, True),
        ({5: 100.0}, -19.9, True),
        ({5: 100.0}, 20.1, False),
        ({5: 100.0, 6: 30.0}, 19.9, True),
        ({5: 30.0, 6: 100.0}, 19.9, True),
        ({5: 30.0, 6: 100.0}, 20.1, False),
    ],
)
def test_a_change_less_than_a_fifth_of_the_greatest_earlier_one_is_a_rest(earlier, size, is_rest):
    observed = seen(with_ordinates(_9=size, **{f"_{place}": value for place, value in earlier.items()}))
    named = [cause(place, is_change=True) for place in earlier]
    change = cause(9, is_change=True)
    assert _is_rest(observed, named, change) is is_rest
    assert not _is_rest(observed, named, replace(change, is_change=False))
    assert not _is_rest(observed, [replace(one, is_change=False) for one in named], change)
    assert not _is_rest(observed, [], change)


@pytest.mark.parametrize(("beyond", "is_kept"), [(-0.01, False), (0.01, True)])
def test_an_earlier_cause_stays_where_it_gains_what_noise_does_in_one_of_12500_sessions(beyond, is_kept):
    best = cause(20)

    def gain(size):
        observed = seen(with_ordinates(_9=size, _20=50.0))
        with_it = fitted(observed, cause(9).columns + best.columns).twice_log_likelihood
        return with_it - fitted(observed, best.columns).twice_log_likelihood

    size = brentq(lambda size: gain(size) - WORTH - beyond, 1.0, 20.0)
    observed, earlier = seen(with_ordinates(_9=size, _20=50.0)), cause(9)
    assert _without_idle(observed, [earlier], best) == ([earlier] if is_kept else [])


def two_stars(size, *, told=(90.0, 10.0)):
    """Of the second parameter they tell so much, of the third the second one more: both have it of this size."""
    by_star = np.array([np.diag([1.0, told[0], 1.0]), np.diag([1.0, told[1], 5.0])])
    right_by_star = by_star @ np.array([0.0, size, 0.0])
    normal, right = by_star.sum(axis=0), right_by_star.sum(axis=0)
    model = with_field(by_star=by_star, right_by_star=right_by_star, normal=normal, right=right)
    return model, replace(seen(freedom=1e9), normal=normal, right=right)


@pytest.mark.parametrize(("size", "is_more"), [(0.881, False), (0.883, True)])
@pytest.mark.parametrize("told", [(90.0, 10.0), (10.0, 90.0)])
def test_what_moves_stars_over_the_field_is_worth_half_without_the_star_that_tells_most_of_it(size, is_more, told):
    """Of a hundred one tells ninety: ten times 0.882 squared are 7.78, half of what a column must gain."""
    half = WORTH / 2
    assert half == pytest.approx(7.78, abs=0.01)
    model, observed = two_stars(size, told=told)
    assert _outlasts_stars(model, observed, [], cause(field=[1])) is is_more
    assert _outlasts_stars(model, observed, [], cause(9)) is True
    assert _outlasts_stars(replace(model, field=None), observed, [], cause(field=[1])) is True


@pytest.mark.parametrize(("size", "is_more"), [(0.97, False), (0.98, True)])
def test_of_two_parameters_the_star_is_left_out_that_tells_most_of_both(size, is_more):
    """The first tells 0.9 of the one and a sixth of the other; two columns must gain 18.87."""
    half = float(scipy.stats.chi2.isf(0.002 / 25, 2)) / 2
    assert half == pytest.approx(10 * 0.9713**2, rel=1e-3)
    model, observed = two_stars(size)
    assert _outlasts_stars(model, observed, [], cause(field=[1, 2])) is is_more


def swinging(amplitude, cycles=(3,), *, noise_arcsec=0.5, stars=1):
    """Eighty frames of noise that swing along columns, and the cause of waves of one arcsec, after an earlier one.

    Of several ``stars`` none keeps an error.
    """
    waves = [np.cos(2 * np.pi * count * (np.arange(80) + 0.5) / 80) for count in (*cycles, 11, 13, 15)]
    noise = noise_arcsec * np.random.default_rng(7).normal(size=(80, 3))
    noise[:, 0] -= np.column_stack(waves) @ np.linalg.lstsq(np.column_stack(waves), noise[:, 0], rcond=None)[0]
    errors = noise + amplitude * np.outer(waves[0], [1.0, 0.0, 0.0])
    places = np.arange(80)
    none = np.zeros((80, 2))
    of_stars = StarErrors(places, places * 10**9, places % stars, np.zeros((80, 3, 2)), none, none + 0j, 0.0)
    field = replace(with_field().field, stars=of_stars) if stars > 1 else None
    model = SessionModel(ErrorSeries(places, places.astype(float), errors), field, SITE, MOUNT, False, np.eye(3))
    *columns, second, third, fourth = (np.outer(wave, [1.0, 0.0, 0.0]) for wave in waves)
    earlier = FineHypothesis("earlier", "earlier", model.columns(second, third, fourth), is_change=True)
    return model, [earlier], FineHypothesis("swing", "swing", model.columns(*columns), is_change=True)


def observed_by(model):
    """As if there were no stars over the field."""
    return replace(model, field=None).observed()


@pytest.mark.parametrize("cycles", [(3,), (3, 5)])
@pytest.mark.parametrize(("noise_arcsec", "stars"), [(0.5, 1), (0.5, 20), (1.0, 20)])
@pytest.mark.parametrize(("share", "is_more"), [(0.999, False), (1.001, True)])
def test_a_change_must_be_sure_beyond_its_frames_and_what_models_leave_open_which_stars_tell_badly(
    cycles, noise_arcsec, stars, share, is_more
):
    """By the F test of Welch and Satterthwaite's degrees of freedom: of 120 ordinates, and of two axes of each star.

    Models leave a twentieth of an arcsec open (root mean square): of the amplitude its root of two. Without stars over
    the field there is one degree of freedom, of twenty 37.
    """
    model, named, swing = swinging(1.0, cycles, noise_arcsec=noise_arcsec, stars=stars)
    errors = told(model, observed_by(model), named, swing, []).errors
    of_models = float(np.mean(2 * 0.05**2 / errors**2))
    assert 0.1 < of_models < 0.8
    freedom = 1 / ((1 - of_models) ** 2 / 120 + of_models**2 / (37 if stars == 20 else 1))
    count = len(cycles)
    amplitude = errors[0] * math.sqrt(count * scipy.stats.f.isf(0.002 / 25, count, freedom))
    model, named, swing = swinging(share * amplitude, cycles, noise_arcsec=noise_arcsec, stars=stars)
    assert _outlasts_stars(model, observed_by(model), named, swing) is is_more


def test_a_cause_is_told_with_its_coefficients_and_their_errors():
    observed = seen(parameters=(7.0, 0.5, -2.0), of_field=1e4, freedom=1e8)
    first, last = cause(field=[0]), cause(field=[1, 2])
    found = told(None, observed, [first, last], last, [])
    assert found.hypothesis is last
    assert found.coefficients == pytest.approx([0.5, -2.0])
    assert found.errors == pytest.approx([0.01, 0.01], rel=1e-3)
    assert told(None, observed, [first, last], first, []).coefficients == pytest.approx([7.0])


@pytest.mark.parametrize(("worse_by", "is_equal"), [(8.9, True), (9.1, False)])
def test_a_rival_that_explains_the_same_within_three_standard_errors_is_an_equal_however_long_it_was_searched_for(
    worse_by, is_equal
):
    """It stands partly in another ordinate, which is 0."""
    observed, one = seen(with_ordinates(_9=20.0, _10=0.0)), cause(9)

    def rival(angle, name="rival"):
        cosines = np.zeros((K, 3, 1))
        cosines[[9, 10], 0, 0] = math.cos(angle), math.sin(angle)
        return FineHypothesis(name, name, Predictions(np.zeros((3, 1)), cosines, np.zeros((3, 1))), searched=500)

    def worse(angle):
        pair = (fitted(observed, hypothesis.columns).twice_log_likelihood for hypothesis in (one, rival(angle)))
        return next(pair) - next(pair)

    angle = brentq(lambda angle: worse(angle) - worse_by, 0.0, 1.0)
    other, same = rival(angle), rival(angle, "cause")
    assert told(None, observed, [one], one, [same, other]).equals == ((other,) if is_equal else ())
