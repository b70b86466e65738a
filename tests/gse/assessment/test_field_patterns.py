"""Errors of stars over the field: where on a pixel each stood, and few of them."""

from dataclasses import replace

import numpy as np
import pytest
from skies.star_errors import CAMERA, SETTINGS, Truth, made

from gse.assessment.field_patterns import StarErrors, _patterns, _scaled, _solved, field_of_errors
from gse.constants import ARCSEC_PER_RAD
from gse.site import Site
from gse.truth import horizon_to_sensor
from gse.truth.refraction import Refraction

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
