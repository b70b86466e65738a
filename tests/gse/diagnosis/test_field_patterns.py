"""Errors of stars over the field: where on a pixel each stood, and few of them."""

from dataclasses import replace

import numpy as np
import pytest
from skies.star_errors import CAMERA, SETTINGS, Truth, made

from gse.diagnosis.field_patterns import (
    PARAMETERS,
    StarErrors,
    _patterns,
    _scaled,
    _solved,
    _unabsorbed,
    _variance_of_pulls,
    _variance_of_sums,
    field_of_errors,
    unexplained_residuals,
)
from gse.truth import horizon_to_sensor
from gse.truth.refraction import Refraction
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.site import Site
from gse.values.star_influence import FrameFits

SITE, MOUNT = SETTINGS[0]
PIXEL_ARCSEC = CAMERA.pixel_rad * ARCSEC_PER_RAD


@pytest.fixture(scope="module")
def sky():
    frames, matches = made(Truth(SITE, MOUNT), SITE, MOUNT, 60.0, np.random.default_rng(1))
    return frames, matches[matches["frame"] % 20 == 0]


def field_of(sky, matches, used=None):
    frames, _ = sky
    used = np.ones(len(frames), dtype=bool) if used is None else used
    return field_of_errors(matches, frames["utc_ns"], used, CAMERA, SITE, horizon_to_sensor(MOUNT)[:, 2])


@pytest.mark.parametrize(("off_px", "turned"), [(2.0, 1.0), (0.5, -1.0), (0.25, -1j)])
def test_the_phase_of_a_star_is_that_of_its_true_place_on_a_pixel(sky, off_px, turned):
    """Measured where it is, less its residual: half a pixel off is the other phase, whole pixels are none."""
    matches = sky[1].copy()
    matches["residual_x_arcsec"], matches["residual_y_arcsec"] = off_px * PIXEL_ARCSEC, 0.0
    phases = field_of(sky, matches).stars.phases
    x, y = (np.exp(2j * np.pi * matches[name].astype(float)) for name in ("x_px", "y_px"))
    assert phases == pytest.approx(np.column_stack([x * turned, y]), abs=2e-3)


@pytest.mark.parametrize(
    ("stars", "phases", "variance"),
    [
        ((7, 7), (1, 1), 36.0),  # a star that stays on its place on the pixel: twice 3 arcsec
        ((7, 7), (1, 1j), 18.0),
        ((7, 7), (1, -1), 0.0),  # one that crosses a pixel
        ((7, 9), (1, -1), 18.0),  # two stars know nothing of each other
    ],
)
def test_what_a_place_on_a_pixel_leaves_of_a_sum_adds_up_within_a_star_alone(stars, phases, variance):
    """Each row turns the first of two sums by as much as its star is off along columns, the second along rows."""
    count, both = len(stars), np.column_stack([phases, phases]).astype(complex)
    zeros, rows = np.zeros((count, 2)), np.arange(count)
    errors = StarErrors(rows, rows, np.array(stars), np.zeros((count, 3, 2)), zeros, both, phase_arcsec=3.0)
    found = errors._of_phases(np.array([np.eye(2)] * count))
    assert found == pytest.approx(np.diag([variance, variance]), abs=1e-12)


@pytest.mark.parametrize(("rows", "is_enough"), [(99, False), (120, True)])
def test_a_hundred_stars_are_needed(sky, rows, is_enough):
    assert (field_of(sky, sky[1][:rows]) is not None) == is_enough


def test_stars_of_frames_that_do_not_count_and_outliers_are_left_out(sky):
    matches = sky[1].copy()
    whole = field_of(sky, matches)
    used = np.ones(len(sky[0]), dtype=bool)
    used[: len(used) // 2] = False
    assert len(field_of(sky, matches, used).stars.frames) == (matches["frame"] >= len(used) // 2).sum()
    matches["residual_x_arcsec"][::50] = 1000.0
    assert len(whole.stars.frames) - len(field_of(sky, matches).stars.frames) == len(matches[::50])


def test_parameters_are_solved_in_their_own_units_and_zero_where_nothing_tells_them():
    """Units that differ by ten powers of ten; a third parameter that is the sum of both tells nothing more."""
    units, truth = np.array([1e-5, 1e5]), np.array([3e5, -2e-5])
    design = np.random.default_rng(2).normal(size=(50, 2)) * units
    normal = design.T @ design
    assert _solved(normal, normal @ truth) == pytest.approx(truth, rel=1e-6)
    assert np.diag(_scaled(normal)) == pytest.approx([1.0, 1.0])
    assert _scaled(normal)[0, 1] == pytest.approx(normal[0, 1] / np.sqrt(normal[0, 0] * normal[1, 1]))
    doubled = np.column_stack([design[:, 0], design[:, 0]])
    assert _solved(doubled.T @ doubled, doubled.T @ design[:, 0]) == pytest.approx([0.5, 0.5])


def test_errors_twice_as_large_tell_the_same_parameters_a_quarter_as_well(sky):
    one, two = sky[1].copy(), sky[1].copy()
    for name in ("residual_x_arcsec", "residual_y_arcsec"):
        two[name] = 2 * one[name]
    once, twice = field_of(sky, one), field_of(sky, two)
    assert twice.normal == pytest.approx(once.normal / 4, rel=1e-4)
    assert twice.right == pytest.approx(once.right / 2, rel=1e-3, abs=1e-6 * np.abs(once.right).max())
    assert twice.freedom == pytest.approx(once.freedom)
    for field in (once, twice):
        assert field.by_star.sum(axis=0) == pytest.approx(field.normal, rel=1e-6)
        assert field.right_by_star.sum(axis=0) == pytest.approx(field.right, rel=1e-6)


def test_what_single_stars_keep_has_two_axes_of_each_less_an_attitude(sky):
    stars = field_of(sky, sky[1]).stars
    for count, freedom in ((1, 1.0), (2, 1.0), (3, 3.0), (10, 17.0)):
        assert replace(stars, stars=np.arange(20) % count).freedom == freedom


def test_more_air_lifts_a_star_towards_the_zenith_by_its_share_of_the_refraction():
    """At 45 deg from the zenith, which lies in the picture's -y: measured less true is up, bend / pressure per hPa."""
    site = Site(latitude_deg=48.0, longitude_deg=11.0, pressure_hpa=950.0, temperature_c=10.0)
    zenith_sensor = np.array([0.0, -1.0, 1.0]) / np.sqrt(2)
    *_, air = _patterns(CAMERA, site, zenith_sensor, np.array([CAMERA.principal_point_px]))
    per_hpa = Refraction.at(site).bend_rad(np.pi / 4) * ARCSEC_PER_RAD / 950.0
    assert np.abs(air[0]) == pytest.approx([0.0, per_hpa], rel=2e-3, abs=1e-9)
    assert air[0, 1] < 0


# By hand


def patterns_at(*xy_px):
    """What each parameter does to stars there, in arcsec per unit (N, 2, 8)."""
    site, zenith = Site(latitude_deg=48.0, longitude_deg=11.0), np.array([0.0, 0.0, 1.0])
    return np.stack(list(_patterns(CAMERA, site, zenith, np.array(xy_px, dtype=float))), axis=2)


FOCAL_PX, HALF_PX = CAMERA.focal_length_px, CAMERA.columns / 2
ASIDE_PX, CENTRE_PX = 400.0, CAMERA.principal_point_px[0]
SINE_OF_PX = ARCSEC_PER_RAD / FOCAL_PX / np.hypot(1, ASIDE_PX / FOCAL_PX) ** 3
"""By so much the sine of a direction grows for a pixel farther out, 400 px from the centre, in arcsec."""


@pytest.mark.parametrize(
    ("name", "px_per_unit"),
    [
        ("focal length", (ASIDE_PX, 0.0)),  # a longer lens: each star is nearer to the middle by its share
        ("k1", (-ASIDE_PX * (ASIDE_PX / HALF_PX) ** 2, 0.0)),
        ("k2", (-ASIDE_PX * (ASIDE_PX / HALF_PX) ** 4, 0.0)),
        ("p2", (-3 * ASIDE_PX**2 / HALF_PX, 0.0)),
        ("principal point x", (1.0, 0.0)),
    ],
)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_parameter_of_the_camera_moves_a_star_aside_by_browns_formula(name, px_per_unit, axis):
    """Stated less true direction. Along rows the second of a pair does what the first does along columns."""
    if axis:
        name = {"p2": "p1", "principal point x": "principal point y"}.get(name, name)
    place = [CENTRE_PX, CENTRE_PX]
    place[axis] += ASIDE_PX
    found = patterns_at(place)[0, :, PARAMETERS.index(name)]
    assert found[axis] == pytest.approx(px_per_unit[0] * SINE_OF_PX, rel=2e-4)
    assert found[1 - axis] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("name", ["p1", "p2"])
def test_tangential_distortion_moves_a_star_across_by_its_own_term_on_the_diagonal(name):
    """2 p u v on the one axis, p (s^2 + 2 v^2) on the other: here 2 and 4 p u^2. No more than 2 deg off the middle."""
    aside_px = 100.0
    found = patterns_at([CENTRE_PX + aside_px, CENTRE_PX + aside_px])[0, :, PARAMETERS.index(name)]
    unit = aside_px**2 / HALF_PX / FOCAL_PX * ARCSEC_PER_RAD
    expected = (-2 * unit, -4 * unit) if name == "p1" else (-4 * unit, -2 * unit)
    assert found == pytest.approx(expected, rel=5e-3)


def test_the_air_that_a_site_does_not_state_is_the_standard_atmosphere():
    """A hectopascal more bends by the 1013th part of what the air at sea level does."""
    zenith = np.array([0.0, -1.0, 1.0]) / np.sqrt(2)
    *_, air = _patterns(CAMERA, Site(latitude_deg=0.0, longitude_deg=0.0, height_m=0.0), zenith,
                        np.array([CAMERA.principal_point_px]))  # fmt: skip
    stated = Site(latitude_deg=0.0, longitude_deg=0.0, pressure_hpa=1013.25, temperature_c=15.0)
    bend_arcsec = Refraction.at(stated).bend_rad(np.pi / 4) * ARCSEC_PER_RAD
    assert air[0, 1] == pytest.approx(-bend_arcsec / 1013.25, rel=2e-3)


def stars_of(frames, seed=3):
    """Directions of eight stars in each frame, and the frame of each."""
    xy_px = np.random.default_rng(seed).uniform(0, 1023, (8 * frames, 2))
    return CAMERA.directions(xy_px), np.repeat(np.arange(frames), 8)


def test_a_pattern_that_is_a_turn_of_each_frame_is_taken_up_by_the_attitudes():
    directions, frames = stars_of(3)
    turns = np.array([[1.0, -2.0, 30.0], [0.5, 4.0, -10.0], [-3.0, 0.0, 7.0]])
    moved = np.cross(turns[frames], directions)[:, :2]
    rest = np.random.default_rng(4).normal(size=moved.shape)
    patterns = np.stack([moved, moved + rest, rest], axis=2)
    left, found = _unabsorbed(patterns, FrameFits.from_directions(directions, frames))
    assert found[:, :, 0] == pytest.approx(turns, abs=1e-9)
    assert left[:, :, 0] == pytest.approx(0.0, abs=1e-9)
    assert left[:, :, 1] == pytest.approx(left[:, :, 2], abs=1e-9)
    assert found[:, :, 1] - found[:, :, 2] == pytest.approx(turns, abs=1e-9)
    assert np.abs(left[:, :, 2] - rest).max() > 0.1


@pytest.mark.parametrize(
    ("rest", "star", "fitted", "variance", "freedom"),
    [
        # Sums 4, 1 and 2, 0: 21 over three rows of two axes; two stars have two axes each, of which some were fitted.
        ([[1.0, 2.0], [3.0, -1.0], [2.0, 0.0]], [0, 0, 1], 8, 21 / 6 * 4, 1.0),
        ([[1.0, 2.0], [3.0, -1.0], [2.0, 0.0]], [0, 0, 1], 2, 21 / 6 * 4 / 2, 2.0),
        ([[1.0, 2.0], [3.0, -1.0], [2.0, 0.0]], [0, 0, 1], 0, 21 / 6, 4.0),
        # Those of one star that cancel count as single ones.
        ([[1.0, 3.0], [-1.0, -3.0]], [0, 0], 0, 5.0, 2.0),
    ],
)
def test_the_variance_of_a_residual_grows_as_those_of_one_star_add_up(rest, star, fitted, variance, freedom):
    sightings = np.bincount(star)
    found = _variance_of_sums(np.array(rest), np.array(star), sightings, fitted)
    assert found == pytest.approx((variance, freedom))


def test_the_variance_of_pulls_is_that_of_the_parameter_at_which_single_stars_pull_most():
    """Ten stars of two rows: pulls of 2 and 6 at the one, of 2 and 0 at the other; nine parameters of ten are lost."""
    left = np.zeros((20, 2, 2))
    left[:, 0, 0] = 1.0
    left[:, 1, 1] = [1.0, -1.0] * 10
    rest = np.column_stack([np.repeat([1.0, 3.0], 10), np.repeat([1.0, 0.0], 10)])
    rest[:, 1] *= [1.0, -1.0] * 10
    star = np.arange(20) // 2
    normal = np.diag([20.0, 20.0])
    assert _variance_of_pulls(left, rest, star, normal) == pytest.approx(5 * (2**2 + 6**2) / 20 * 10)
    few = _variance_of_pulls(left[:4], rest[:4], star[:4], normal)
    assert few == pytest.approx(2 * 2**2 / 20 * 2)


def test_what_a_star_keeps_in_two_stretches_of_time_goes_into_a_sum_with_both():
    """Off by 3 arcsec along columns in both, and by 2 of them with its place on a pixel: a sum of two has both twice.

    The scatter of stretches shows what is in each of them: only the products of the two are left.
    """
    shift_x = np.zeros((2, 3, 2))
    shift_x[:, 1, 0] = -1.0
    errors = StarErrors(
        np.arange(2),
        np.array([0, 100 * 10**9]),
        np.array([7, 7]),
        shift_x,
        np.array([[3.0, 0.0], [3.0, 0.0]]),
        np.ones((2, 2), dtype=complex),
        phase_arcsec=2.0,
    )
    weights = np.tile(np.eye(3)[None, :1], (2, 1, 1))
    assert errors.covariance_arcsec2(weights) == pytest.approx(np.array([[2 * 9.0 + 2**2 * 4.0]]), rel=1e-6)


def test_the_star_that_tells_most_of_some_parameters_is_that_with_the_greatest_share_in_them(sky):
    by_star = np.zeros((3, 8, 8))
    by_star[0] = np.diag([9.0, 1, 1, 1, 1, 1, 1, 1])
    by_star[1] = np.diag([1.0, 5, 1, 1, 1, 1, 1, 1])
    by_star[2] = np.diag([1.0, 1, 600, 1, 1, 1, 1, 1])
    field = replace(field_of(sky, sky[1]), by_star=by_star, normal=by_star.sum(axis=0))
    assert [field.most_told_by(np.array(parts)) for parts in ([0], [1], [2], [0, 1])] == [0, 1, 2, 0]


# What is left out


def test_a_hundred_rows_are_enough_but_not_with_an_outlier_among_them(sky):
    matches = sky[1][:100].copy()
    assert field_of(sky, matches) is not None
    matches["residual_x_arcsec"][7] = 3000.0
    assert field_of(sky, matches) is None


@pytest.mark.parametrize(("length_arcsec", "is_kept"), [(5.0, True), (5.1, False)])
def test_a_star_that_errs_by_more_than_five_times_the_median_is_left_out(sky, length_arcsec, is_kept):
    matches = sky[1].copy()
    matches["residual_x_arcsec"], matches["residual_y_arcsec"] = 0.6, 0.8
    matches["residual_x_arcsec"][3], matches["residual_y_arcsec"][3] = 0.0, -length_arcsec
    assert len(field_of(sky, matches).stars.frames) == len(matches) - (not is_kept)


@pytest.mark.parametrize(("stars", "is_kept"), [(3, False), (4, True)])
def test_a_frame_of_fewer_than_four_stars_is_left_out(sky, stars, is_kept):
    matches = sky[1]
    first = matches["frame"][0]
    short = np.flatnonzero(matches["frame"] == first)[stars:]
    found = field_of(sky, np.delete(matches, short))
    assert (first in found.stars.frames) is is_kept
    assert (first in found.rows) is is_kept
    assert len(found.stars.frames) == len(matches) - len(short) - (0 if is_kept else stars)


@pytest.mark.parametrize(("more", "every"), [(0, 1), (1, 2), (21, 2)])
def test_of_more_than_forty_thousand_rows_every_second_frame_is_taken(sky, more, every):
    frames, _ = sky
    matches = np.resize(sky[1][:20], 40_000 + more)
    matches["frame"] = np.arange(len(matches)) // 20
    utc_ns = frames["utc_ns"][0] + 10**8 * np.arange(2002)
    found = field_of_errors(matches, utc_ns, np.ones(2002, dtype=bool), CAMERA, SITE, horizon_to_sensor(MOUNT)[:, 2])
    assert found.rows.tolist() == list(range(0, len(matches) // 20, every))


# What is found


def test_a_principal_point_that_is_off_moves_the_attitude_by_as_many_pixels(sky):
    """Nearly all of it is taken up: stars that lie to the right are those of a boresight to the left."""
    field = field_of(sky, sky[1])
    x, y = (field.shifts[:, :, PARAMETERS.index(f"principal point {axis}")] for axis in "xy")
    assert len(x) == len(field.rows) == len(np.unique(sky[1]["frame"]))
    assert x[:, 0] == pytest.approx(-PIXEL_ARCSEC, rel=0.03)
    assert y[:, 1] == pytest.approx(-PIXEL_ARCSEC, rel=0.03)
    moved = field.moved_px[:, :, PARAMETERS.index("principal point x")]
    assert moved[:, 0] == pytest.approx(1.0, rel=0.03)
    assert moved[:, 1] == pytest.approx(0.0, abs=0.03)


def test_a_thousand_stars_at_most_show_how_far_parameters_move_them(sky):
    rows = len(field_of(sky, sky[1]).stars.frames)
    assert len(field_of(sky, sky[1]).moved_px) == -(-rows // -(-rows // 1000))
    assert len(field_of(sky, sky[1][:1000]).moved_px) == 1000
    assert len(field_of(sky, sky[1][:1001]).moved_px) == 501
    assert len(field_of(sky, sky[1][:1020]).moved_px) == 510


@pytest.mark.parametrize(("is_whole", "least_px"), [(True, 0.02), (False, 0.01)])
def test_whole_pixels_hide_twice_as_much_as_centroids(sky, is_whole, least_px):
    matches = sky[1].copy()
    for name in ("x_px", "y_px"):
        matches[name] = np.rint(matches[name]) + (0.0 if is_whole else 0.25)
    assert field_of(sky, matches).least_px == least_px
    matches["x_px"] = np.rint(matches["x_px"])
    assert field_of(sky, matches).least_px == least_px


def test_errors_that_go_with_the_place_on_a_pixel_are_told_with_their_root_mean_square(sky):
    """A cosine of 2 arcsec, a tenth more by what the fit of twenty stars is thought to have taken; the errors are so
    small against a pixel that the place is the measured one.
    """
    matches = sky[1].copy()
    for axis in "xy":
        noise = np.random.default_rng(5).normal(0, 0.1, len(matches))
        matches[f"residual_{axis}_arcsec"] = 2.0 * np.cos(2 * np.pi * matches[f"{axis}_px"].astype(float)) + noise
    found = field_of(sky, matches).stars.phase_arcsec
    assert found == pytest.approx(2.0 / np.sqrt(2) / np.sqrt(1 - 1.5 / 20), rel=0.05)


def test_what_a_longer_lens_leaves_of_the_stars_is_solved_for_and_taken_away(sky):
    matches = sky[1].copy()
    xy_px = np.column_stack([matches["x_px"], matches["y_px"]]).astype(float)
    directions, zenith = CAMERA.directions(xy_px), horizon_to_sensor(MOUNT)[:, 2]
    patterns = np.stack(list(_patterns(CAMERA, SITE, zenith, xy_px)), axis=2)
    left, _ = _unabsorbed(patterns, FrameFits.from_directions(directions, matches["frame"]))
    noise = np.random.default_rng(6).normal(0, 0.01, (len(matches), 2))
    residuals = 1e-3 * left[:, :, 0] + noise
    matches["residual_x_arcsec"], matches["residual_y_arcsec"] = residuals.T
    field = field_of(sky, matches)
    assert _solved(field.normal, field.right)[0] == pytest.approx(1e-3, rel=0.02)
    rest = unexplained_residuals(field, matches, CAMERA, SITE, zenith)
    assert residuals.std() > 20 * noise.std()
    assert rest.std() == pytest.approx(noise.std(), rel=0.05)
