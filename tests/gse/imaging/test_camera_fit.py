"""The camera fitted to identified stars."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import UsageError
from gse.identifier import make_identifier
from gse.imaging.camera_fit import (
    StarField,
    _CameraFit,
    _chi_square,
    _covariance,
    _improve,
    _map,
    _misfit,
    _parameters,
    _prior,
    _residuals,
    _sigma_axis_px,
    _softness,
    _turned,
    _weight,
    _with,
    calibrate,
)
from gse.imaging.session_fit import PanoramaSample, calibrate_session, hot_pixels
from gse.values.camera import Camera
from gse.values.panorama import Panorama

NOISE_PX = 0.25
STATION = parse_station(BUILT_IN_TEXT)
TRUE = Camera(1024, 1024, 4169.9, (535.3, 487.2), (0.004, -0.001))


def random_fields(camera, rng, *, panoramas=120, stars=20, false_share=0.0):
    """Star fields of random attitudes, as a camera shows them, with noise and false names."""
    fields = []
    for rotation in Rotation.random(panoramas, rng=rng).as_matrix():
        xy = rng.uniform(0, 1023, (stars, 2))
        seen = camera.directions(xy) @ rotation
        false = rng.random(stars) < false_share
        xy = np.where(false[:, None], rng.uniform(0, 1023, (stars, 2)), xy + rng.normal(0, NOISE_PX, xy.shape))
        fields.append(StarField(xy, seen, len(fields) * stars + np.arange(stars)))
    return fields


def values(camera):
    return np.array([camera.focal_length_px, *camera.principal_point_px, *camera.radial_distortion])


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_camera_is_found_within_its_stated_sigma(mirrored):
    true = Camera(1024, 1024, 4169.9, (535.3, 487.2), (0.004, -0.001), mirrored)
    start = Camera(1024, 1024, 4169.9 * 1.002, (511.5, 511.5), (0.0, 0.0), mirrored)
    pulls = []
    for seed in range(4):
        fitted = calibrate(start, random_fields(true, np.random.default_rng(seed), false_share=0.02))
        pulls.append((values(fitted.camera) - values(true)) / fitted.sigma)
    rms = np.sqrt((np.array(pulls) ** 2).mean())
    assert 0.6 < rms < 1.5
    assert fitted.after.sigma_axis_px == pytest.approx(NOISE_PX, rel=0.1)
    assert fitted.before.rms_px > 5 * fitted.after.rms_px


def test_without_noise_the_camera_is_exact():
    rng = np.random.default_rng(1)
    fields = [
        StarField(xy, TRUE.directions(xy) @ rotation, np.arange(12))
        for rotation, xy in zip(
            Rotation.random(40, rng=rng).as_matrix(), rng.uniform(0, 1023, (40, 12, 2)), strict=True
        )
    ]
    fitted = calibrate(Camera(1024, 1024, 4200.0, (511.5, 511.5)), fields)
    assert values(fitted.camera) == pytest.approx(values(TRUE), rel=1e-6, abs=1e-6)


def test_what_the_stars_do_not_tell_is_left_as_it_was():
    true = Camera(1024, 1024, 4175.0, (511.5, 511.5))
    start = Camera(1024, 1024, 4169.9, (511.5, 511.5))
    fitted = calibrate(start, random_fields(true, np.random.default_rng(9)))
    assert fitted.held == ("principal point", "distortion")
    assert fitted.camera.principal_point_px == pytest.approx((511.5, 511.5), abs=1e-6)
    assert fitted.camera.radial_distortion == pytest.approx((0, 0), abs=1e-9)
    assert fitted.camera.focal_length_px == pytest.approx(4175.0, abs=4 * fitted.sigma[0])
    assert fitted.sigma[1] > 0.3


def test_the_residual_map_shows_where_on_the_detector_stars_are_off():
    rng = np.random.default_rng(2)
    fields = []
    for field in random_fields(TRUE, rng):
        corner = (field.xy_px[:, :1] < 128) & (field.xy_px[:, 1:] > 895)
        fields.append(StarField(field.xy_px + np.where(corner, [0.8, -0.6], 0.0), field.stars, field.numbers))
    residual_map = calibrate(TRUE, fields).map_px
    assert residual_map[7, 0, 0] > 0.5
    assert residual_map[7, 0, 1] < -0.35
    assert np.abs(residual_map[:7, 1:, :2]).max() < 0.2
    assert residual_map[:, :, 2].sum() > 2300


def test_a_few_stars_seen_again_and_again_leave_a_larger_sigma_than_as_many_different_ones():
    rng = np.random.default_rng(5)
    xy = rng.uniform(0, 1023, (12, 2))
    seen, shown = TRUE.directions(xy), xy + rng.normal(0, NOISE_PX, xy.shape)
    again = calibrate(TRUE, [StarField(shown + rng.normal(0, 0.02, xy.shape), seen, np.arange(12))] * 100)
    different = calibrate(TRUE, random_fields(TRUE, rng, panoramas=100, stars=12))
    assert again.sigma[0] > 3 * different.sigma[0]
    assert abs(again.camera.focal_length_px - TRUE.focal_length_px) < 4 * again.sigma[0]


@pytest.mark.parametrize(("panoramas", "stars", "said"), [(1, 19, "19 identified.* 20"), (2, 24, "48 identified.* 50")])
def test_too_few_stars_are_refused_with_their_number(panoramas, stars, said):
    fields = random_fields(TRUE, np.random.default_rng(3), panoramas=panoramas, stars=stars)
    with pytest.raises(UsageError, match=said):
        calibrate(TRUE, fields)


@pytest.fixture(scope="module")
def identifier():
    return make_identifier(STATION.identifier, STATION.sensor.camera(), load_catalog())


def session(camera, identifier, *, count=40, hot=()):
    """Panoramas of a sky that moves by 15 arcsec/s, every 20 s, whole pixels, with hot pixels."""
    rng = np.random.default_rng(4)
    sample = PanoramaSample()
    first = Rotation.from_euler("xyz", [0.3, 0.5, 0.2])
    for number in range(count):
        rotation = (first * Rotation.from_rotvec([0, 0, number * 20 * 7.29e-5])).as_matrix()
        xy = camera.pixels(identifier.catalog.icrs @ rotation.T)
        inside = np.flatnonzero(camera.contains(xy))[:26]
        xy = np.rint(np.vstack([xy[inside] + rng.normal(0, 0.1, (len(inside), 2)), *[[pixel] for pixel in hot]]))
        brightness = np.linspace(4000, 300, len(xy))
        panorama = Panorama(number * 20_000_000_000, xy, brightness, number)
        sample.add(panorama)
    return sample


@pytest.mark.parametrize(("scale", "mirrored"), [(1.02, False), (1.0, True), (0.99, True)])
def test_a_session_is_calibrated_from_a_wrong_focal_length_or_without_its_mirror(identifier, scale, mirrored):
    start = STATION.sensor.camera()
    true = Camera(1024, 1024, start.focal_length_px / scale, (513.0, 510.0), (0.002, 0.0), mirrored)
    result = calibrate_session(session(true, identifier, hot=[(100, 200), (900, 31)]), start, identifier, None)
    fitted = result.calibration
    assert result.identified_before == 0
    assert result.identified_after > 0.9 * result.panoramas
    assert fitted.camera.mirrored is mirrored
    assert fitted.camera.focal_length_px == pytest.approx(true.focal_length_px, rel=3e-4)
    assert result.hot_pixels == ((100, 200), (900, 31))
    assert fitted.after.rms_px < 0.6


def test_a_session_that_nothing_can_identify_says_what_to_check(identifier):
    foreign = Camera(1024, 1024, 2000.0, (511.5, 511.5))
    with pytest.raises(UsageError, match=r"none of \d panoramas.*check sensor"):
        calibrate_session(session(foreign, identifier, count=2), STATION.sensor.camera(), identifier, None)


def test_an_empty_session_is_refused():
    with pytest.raises(UsageError, match="no panorama"):
        calibrate_session(PanoramaSample(), TRUE, None, None)


def test_hot_pixels_are_not_named_where_the_sky_stood_still():
    still = [np.array([[10.0, 20.0]])] * 40
    none = [np.empty(0, dtype=np.int64)] * 40
    assert hot_pixels(still, none, moved_px=1.0) == ()
    assert hot_pixels(still, none, moved_px=100.0) == ((10, 20),)
    assert hot_pixels(still, [np.array([0])] * 40, moved_px=100.0) == ()


def test_a_sample_keeps_panoramas_from_the_whole_session():
    sample = PanoramaSample()
    for number in range(5000):
        sample.add(Panorama(number, np.empty((0, 2)), np.empty(0), number))
    numbers = [panorama.frame_no for panorama in sample.spread(100)]
    assert len(numbers) == 100
    assert numbers[0] < 50
    assert numbers[-1] > 4900


def test_residuals_are_those_of_gaussian_noise_and_outliers_are_counted_apart():
    rng = np.random.default_rng(12)
    fitted = calibrate(TRUE, random_fields(TRUE, rng, panoramas=150))
    assert fitted.after.n == 150 * 20
    assert fitted.after.sigma_axis_px == pytest.approx(NOISE_PX, rel=0.08)
    assert fitted.after.rms_px == pytest.approx(NOISE_PX * np.sqrt(2), rel=0.08)
    assert fitted.after.median_px == pytest.approx(NOISE_PX * np.sqrt(2 * np.log(2)), rel=0.08)
    assert fitted.after.outliers == 0
    with_false = calibrate(TRUE, random_fields(TRUE, rng, panoramas=150, false_share=0.03))
    assert with_false.after.outliers == pytest.approx(90, abs=30)
    assert with_false.after.rms_px == pytest.approx(fitted.after.rms_px, rel=0.08)


@pytest.mark.parametrize(("error_px", "outliers"), [(0.74, 0), (0.745, 1), (50.0, 1)])
def test_an_outlier_lies_further_off_than_five_sigma(error_px, outliers):
    """Errors of 0.1 px on each axis are a sigma of 1.4826 times that."""
    camera = Camera(1024, 1024, 4169.9, (511.5, 511.5))
    xy = np.random.default_rng(1).uniform(100, 900, (100, 2))
    errors = np.where(np.random.default_rng(2).random((100, 2)) < 0.5, 0.1, -0.1)
    errors[17] = error_px, 0.0
    found = _residuals(camera, [StarField(xy + errors, camera.directions(xy), np.arange(100))], np.eye(3)[None])
    assert (found.n, found.outliers) == (100, outliers)
    assert found.sigma_axis_px == pytest.approx(0.14826)
    assert found.median_px == pytest.approx(0.1 * np.sqrt(2))
    within = [0.02] * 99 + ([] if outliers else [error_px**2])
    assert found.rms_px == pytest.approx(np.sqrt(np.mean(within)))


@pytest.mark.parametrize(("panoramas", "stars", "enough"), [(5, 10, True), (7, 7, False), (100, 3, False)])
def test_fifty_stars_are_needed_in_panoramas_of_four_or_more(panoramas, stars, enough):
    fields = random_fields(TRUE, np.random.default_rng(3), panoramas=panoramas, stars=stars)
    if enough:
        assert calibrate(TRUE, fields).panoramas == panoramas
        return
    with pytest.raises(UsageError, match=f"{panoramas * stars if stars > 3 else 0} identified stars .* at least 50"):
        calibrate(TRUE, fields)


def test_panoramas_of_four_stars_take_part_and_those_of_three_do_not():
    rng = np.random.default_rng(4)
    fields = random_fields(TRUE, rng, panoramas=10, stars=20) + random_fields(TRUE, rng, panoramas=6, stars=4)
    fields += random_fields(TRUE, rng, panoramas=9, stars=3)
    assert calibrate(TRUE, fields).panoramas == 16


def test_a_principal_point_that_the_stars_tell_is_moved_and_one_within_four_sigma_is_not():
    start = Camera(1024, 1024, 4169.9, (511.5, 511.5))
    moved = Camera(1024, 1024, 4169.9, (517.5, 511.5))
    fitted = calibrate(start, random_fields(moved, np.random.default_rng(9)))
    assert "principal point" not in fitted.held
    assert fitted.camera.principal_point_px[0] == pytest.approx(517.5, abs=4 * fitted.sigma[1])


def test_a_cell_with_one_star_shows_its_residual_and_an_empty_one_none():
    fitted = calibrate(TRUE, random_fields(TRUE, np.random.default_rng(5), panoramas=12, stars=8))
    count = fitted.map_px[:, :, 2]
    assert (count == 1).sum() > 5
    assert (np.abs(fitted.map_px[count == 1][:, :2]) > 0).all()
    assert (fitted.map_px[count == 0] == 0).all()


def test_the_map_counts_every_star_in_its_cell_but_the_outliers():
    fitted = calibrate(TRUE, random_fields(TRUE, np.random.default_rng(6), panoramas=150))
    count = fitted.map_px[:, :, 2]
    assert count.shape == (8, 8)
    assert count.sum() == 3000
    # Uniform over 1023 px: 47 stars in each cell.
    assert count.min() > 20
    assert count.max() < 80


def test_tangential_distortion_is_fitted_on_request_and_else_left_alone():
    true = Camera(1024, 1024, 4169.9, (511.5, 511.5), (0.004, -0.001), False, (0.004, -0.003))
    start = Camera(1024, 1024, 4169.9, (511.5, 511.5))
    fields = random_fields(true, np.random.default_rng(4))
    fitted = calibrate(start, fields, tangential=True)
    assert len(fitted.sigma) == 7
    off = np.array(fitted.camera.tangential_distortion) - true.tangential_distortion
    assert (np.abs(off) < 4 * np.array(fitted.sigma[5:])).all()
    assert (np.array(fitted.sigma[5:]) < 0.001).all()
    without = calibrate(start, fields)
    assert without.camera.tangential_distortion == (0.0, 0.0)
    assert without.covariance.shape == (5, 5)
    assert without.after.rms_px > fitted.after.rms_px


def test_without_noise_tangential_distortion_is_exact():
    true = Camera(1024, 1024, 4169.9, (530.0, 500.0), (0.004, -0.001), True, (0.003, 0.002))
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 1023, (40, 12, 2))
    turns = Rotation.random(40, rng=rng).as_matrix()
    fields = [StarField(xy, true.directions(xy) @ turn, np.arange(12)) for turn, xy in zip(turns, places, strict=True)]
    fitted = calibrate(Camera(1024, 1024, 4170.0, (511.5, 511.5), mirrored=True), fields, tangential=True)
    assert values(fitted.camera) == pytest.approx(values(true), rel=1e-6, abs=1e-6)
    assert fitted.camera.tangential_distortion == pytest.approx((0.003, 0.002), abs=1e-7)


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_derivatives_of_the_residuals_are_those_of_small_steps(mirrored):
    rng = np.random.default_rng(8)
    camera = Camera(1024, 1024, 4169.9, (535.3, 487.2), (0.3, -0.2), mirrored, (0.02, -0.03))
    attitude = Rotation.random(rng=rng)
    xy = rng.uniform(0, 1023, (9, 2))
    field = StarField(xy, camera.directions(xy) @ attitude.as_matrix(), np.arange(9))
    _, by_camera, by_rotation = _misfit(camera, field, attitude.as_matrix())

    def residual(parameters, turn):
        return _misfit(_with(camera, parameters), field, (Rotation.from_rotvec(turn) * attitude).as_matrix())[0]

    values, still = _parameters(camera), np.zeros(3)
    for place, step in enumerate(np.where(np.abs(values) > 10, 1e-2, 1e-6)):
        change = step * np.eye(len(values))[place]
        slope = (residual(values + change, still) - residual(values - change, still)) / (2 * step)
        assert by_camera[:, :, place] == pytest.approx(slope, rel=1e-5, abs=1e-5)
    for place, turn in enumerate(1e-6 * np.eye(3)):
        slope = (residual(values, turn) - residual(values, -turn)) / 2e-6
        assert by_rotation[:, :, place] == pytest.approx(slope, rel=1e-5, abs=1e-2)


def test_a_star_resists_by_the_divergence_of_its_pull():
    """Half of it, along both axes together, in that of the mean weight: what the fit takes the scatter to be."""
    residual, step = np.random.default_rng(3).normal(0, 1.5, (40, 2)), 1e-6
    divergence = np.zeros(len(residual))
    for axis in range(2):
        off = step * np.eye(2)[axis]
        ahead, behind = (_weight(place, 0.4)[:, None] * place for place in (residual + off, residual - off))
        divergence += (ahead - behind)[:, axis] / (2 * step)
    assert _softness(residual, 0.4) == pytest.approx(divergence / 2 / _weight(residual, 0.4).mean(), rel=1e-5)


def test_a_star_on_the_last_edge_of_the_detector_is_in_the_last_cell():
    fields = random_fields(TRUE, np.random.default_rng(4), panoramas=20)
    xy = fields[0].xy_px.copy()
    xy[0] = 1023.5
    seen = fields[0].stars.copy()
    seen[0] = (TRUE.directions(xy[:1]) @ rotation_of(fields[0]))[0]
    counted = calibrate(TRUE, [StarField(xy, seen, fields[0].numbers), *fields[1:]]).map_px[:, :, 2]
    assert counted.sum() == 400


def rotation_of(field):
    """The attitude under which a star field was made."""
    return Rotation.align_vectors(TRUE.directions(field.xy_px), field.stars)[0].as_matrix()


@pytest.mark.parametrize("axis", [0, 1])
def test_the_cells_of_the_map_begin_half_a_pixel_before_their_first_pixel(axis):
    """128 pixels of 1024 each: the edge of the first two lies at 127.5."""
    camera = Camera(1024, 1024, 4169.9, (511.5, 511.5))
    xy = np.full((2, 2), 60.0)
    xy[:, axis] = 127.4, 127.6
    counted = _map(camera, [StarField(xy, camera.directions(xy), np.arange(2))], np.eye(3)[None])[:, :, 2]
    assert [counted[0, 0], counted[0, 1] if axis == 0 else counted[1, 0]] == [1, 1]
    assert counted.sum() == 2


def test_a_star_at_2_4_sigma_weighs_half_of_one_on_its_place():
    """Holland & Welsch 1977: 95 % efficient for Gaussian noise."""
    weights = _weight(np.array([[0.0, 0.0], [2.4 * 0.3, 0.0], [0.0, 2.4 * 0.3], [3 * 2.4 * 0.3, 0.0]]), 0.3)
    assert weights == pytest.approx(np.array([1, 1 / 2, 1 / 2, 1 / 10]) / 0.3**2)


@pytest.mark.parametrize("off", [(0.004, 0.0), (0.0, 0.004)])
def test_what_the_stars_tell_of_either_axis_of_a_lens_is_not_held(off):
    true = Camera(1024, 1024, 4169.9, (511.5, 511.5), (0.0, 0.0), False, off)
    fields = random_fields(true, np.random.default_rng(4))
    fitted = calibrate(Camera(1024, 1024, 4169.9, (511.5, 511.5)), fields, tangential=True)
    assert "tangential distortion" not in fitted.held
    assert fitted.camera.tangential_distortion == pytest.approx(off, abs=0.002)
    still = Camera(1024, 1024, 4169.9, (511.5, 511.5))
    held = calibrate(still, random_fields(still, np.random.default_rng(4)), tangential=True)
    assert "tangential distortion" in held.held
    assert held.camera.tangential_distortion == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_rotation_is_turned_by_a_vector_and_by_none_at_all_stays():
    stated = Rotation.from_euler("xyz", [10.0, 20.0, 30.0], degrees=True)
    by = np.array([0.01, -0.02, 0.03])
    assert np.abs(_turned(stated.as_matrix(), by) - (Rotation.from_rotvec(by) * stated).as_matrix()).max() < 1e-14
    assert (_turned(stated.as_matrix(), np.zeros(3)) == stated.as_matrix()).all()


WIDE = Camera(800, 1200, 4000.0, (610.0, 390.0), (0.02, -0.01), False, (0.003, -0.002))
"""Not square: which of the two sides counts must show."""


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_residual_of_a_camera_without_distortion_is_how_far_an_object_is_off(mirrored):
    camera = Camera(800, 1200, 4000.0, (610.0, 390.0), mirrored=mirrored)
    xy = np.random.default_rng(1).uniform(0, 799, (20, 2))
    off = np.random.default_rng(2).normal(0, 1.0, (20, 2))
    turn = Rotation.from_euler("xyz", [0.3, 0.5, 0.2]).as_matrix()
    residual, _, _ = _misfit(camera, StarField(xy + off, camera.directions(xy) @ turn, np.arange(20)), turn)
    assert residual == pytest.approx(off, abs=1e-9)


def test_a_star_on_its_place_has_no_residual_whatever_the_lens():
    xy = np.random.default_rng(1).uniform(0, 799, (20, 2))
    turn = Rotation.from_euler("xyz", [0.3, 0.5, 0.2]).as_matrix()
    residual, _, _ = _misfit(WIDE, StarField(xy, WIDE.directions(xy) @ turn, np.arange(20)), turn)
    assert np.abs(residual).max() < 1e-9


def test_without_stars_a_focal_length_is_known_to_a_tenth_and_so_is_the_principal_point():
    assert _prior(WIDE) ** -0.5 == pytest.approx(np.array([400.0, 120.0, 120.0, 0.1, 0.1, 0.1, 0.1]))


def test_the_parameters_of_a_camera_are_in_the_order_of_its_covariance():
    assert _parameters(WIDE).tolist() == [4000.0, 610.0, 390.0, 0.02, -0.01, 0.003, -0.002]
    assert _with(Camera(800, 1200, 1.0, (0.0, 0.0)), _parameters(WIDE)) == WIDE


def test_a_change_is_measured_in_its_uncertainty():
    covariance = np.diag([1.0, 4.0, 9.0, 16.0])
    covariance[1, 2] = covariance[2, 1] = 3.0
    # The inverse of ((4, 3), (3, 9)) is ((9, -3), (-3, 4)) / 27.
    change = np.array([100.0, 2.0, -1.0, 100.0])
    assert _chi_square(change, covariance, [1, 2]) == pytest.approx((9 * 4 + 2 * 3 * 2 + 4) / 27)


@pytest.mark.parametrize(
    ("residual_px", "sigma_px"), [(0.2, 1.4826 * 0.2), (1e-6, 1.4826e-6), (0.5e-6, 1e-6), (0, 1e-6)]
)
def test_the_scatter_is_that_of_the_median_and_never_less_than_a_millionth_of_a_pixel(residual_px, sigma_px):
    residual = np.array([[residual_px, -residual_px], [-residual_px, 1000.0], [residual_px, residual_px]])
    assert _sigma_axis_px(residual) == pytest.approx(sigma_px, rel=1e-12)


def dense(camera, fields, rotations, count):
    """All equations at once: the derivatives (2 N, count + 3 P), the residuals (2 N,) and the weights (2 N,)."""
    rows, residuals = [], []
    for number, (field, rotation) in enumerate(zip(fields, rotations, strict=True)):
        residual, by_camera, by_rotation = _misfit(camera, field, rotation)
        part = np.zeros((len(residual), 2, count + 3 * len(fields)))
        part[:, :, :count] = by_camera[:, :, :count]
        part[:, :, count + 3 * number : count + 3 * number + 3] = by_rotation
        rows.append(part.reshape(2 * len(residual), -1))
        residuals.append(residual)
    residual = np.concatenate(residuals)
    sigma = 1.4826 * np.median(np.abs(residual))
    weight = 1 / (sigma**2 + (residual**2).sum(axis=1) / 2.4**2)
    return np.concatenate(rows), residual, weight, sigma


@pytest.mark.parametrize("count", [5, 7])
def test_a_step_is_that_of_all_equations_at_once(count):
    """The camera, its prior, and three angles of each panorama: without the Schur complement."""
    fields = random_fields(WIDE, np.random.default_rng(4), panoramas=8, stars=12)
    rotations = np.array([Rotation.align_vectors(WIDE.directions(f.xy_px), f.stars)[0].as_matrix() for f in fields])
    camera = Camera(800, 1200, 4010.0, (600.0, 400.0), (0.01, 0.0), False, (0.001, 0.001))
    anchor, prior = Camera(800, 1200, 3900.0, (580.0, 410.0), (0.1, 0.1)), np.linspace(1e-3, 2.0, count)
    equations, residual, weight, _ = dense(camera, fields, rotations, count)
    pull = prior * (_parameters(anchor) - _parameters(camera))[:count]
    weighted = equations * np.repeat(weight, 2)[:, None]
    whole = weighted.T @ equations
    whole[:count, :count] += np.diag(prior)
    right = -weighted.T @ residual.ravel()
    right[:count] += pull
    step = np.linalg.solve(whole, right)
    fit, step_px = _improve(_CameraFit(camera, rotations, np.eye(count)), anchor, fields, prior)
    moved = _parameters(camera)
    moved[:count] += step[:count]
    assert _parameters(fit.camera) == pytest.approx(moved, rel=1e-8, abs=1e-10)
    for number, (after, before) in enumerate(zip(fit.rotations, rotations, strict=True)):
        turned = Rotation.from_rotvec(step[count + 3 * number :][:3]).as_matrix() @ before
        assert np.abs(after - turned).max() < 1e-9
    schur = np.linalg.inv(np.linalg.inv(whole)[:count, :count])
    assert fit.normal == pytest.approx(schur, rel=1e-5, abs=1e-6 * np.abs(schur).max())
    # At the edge of the detector, 600 px from its middle: a focal length moves it by 600 / 4010 of its change.
    at_edge = np.abs(step[:count] * np.array([600 / 4010, 1, 1, 600, 600, 1800, 1800])[:count])
    assert step_px == pytest.approx(at_edge.max(), rel=1e-8)


@pytest.mark.parametrize(
    ("place", "edge_px"), [(0, 600 / 4000), (1, 1.0), (2, 1.0), (3, 600.0), (4, 600.0), (5, 1800.0), (6, 1800.0)]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_is_measured_by_how_far_it_moves_the_edge_of_the_detector(place, edge_px, sign):
    """600 px from the middle, where k moves a star by as much times k, and p1 or p2 by three times that."""
    fields = random_fields(WIDE, np.random.default_rng(4), panoramas=3, stars=8)
    rotations = np.array([Rotation.align_vectors(WIDE.directions(f.xy_px), f.stars)[0].as_matrix() for f in fields])
    by = sign * 1e-3 * np.eye(7)[place]
    anchor = _with(WIDE, _parameters(WIDE) + by)
    fit, step_px = _improve(_CameraFit(WIDE, rotations, np.eye(7)), anchor, fields, np.full(7, 1e18))
    assert _parameters(fit.camera) == pytest.approx(_parameters(anchor), rel=1e-9, abs=1e-9)
    assert step_px == pytest.approx(1e-3 * edge_px, rel=1e-6)


@pytest.mark.parametrize("count", [5, 7])
def test_the_covariance_is_that_of_all_equations_at_once(count):
    """Stars that differ have one variance along each axis; the fit took K parameters and three of each panorama."""
    fields = random_fields(WIDE, np.random.default_rng(6), panoramas=10, stars=12)
    rotations = np.array([Rotation.align_vectors(WIDE.directions(f.xy_px), f.stars)[0].as_matrix() for f in fields])
    equations, residual, weight, sigma = dense(WIDE, fields, rotations, count)
    whole = (equations * np.repeat(weight, 2)[:, None]).T @ equations
    whole[:count, :count] += np.diag(np.full(count, 1e-3))
    inverse = np.linalg.inv(whole)[:count]
    shifts = equations.reshape(len(residual), 2, -1) @ inverse.T
    variance = ((weight[:, None] * residual) ** 2).mean(axis=0)
    s2 = (residual**2).sum(axis=1) / (2.4 * sigma) ** 2
    softness = (1 / (1 + s2) ** 2).reshape(10, 12).mean(axis=1) / (1 / (1 + s2)).reshape(10, 12).mean(axis=1)
    left = (1 - 3 / (2 * 12)) * (1 - count / (2 * 120))
    normal = np.linalg.inv(inverse[:, :count])
    expected = np.einsum("nac,nad,a->cd", shifts, shifts, variance) / (softness.mean() * left) ** 2
    found = _covariance(_CameraFit(WIDE, rotations, normal), fields)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("chi_square", "held"), [(15.5, True), (16.5, False)])
@pytest.mark.parametrize(("name", "places"), [("principal point", [1, 2]), ("distortion", [3, 4])])
def test_a_change_is_held_below_a_chi_square_of_sixteen(name, places, chi_square, held):
    fields = random_fields(TRUE, np.random.default_rng(9), panoramas=40)
    far = Camera(1024, 1024, 4169.9, (700.0, 300.0), (0.3, 0.3))
    free = calibrate(TRUE, fields, anchor=far)
    assert free.held == ()
    change = np.sqrt(np.diag(free.covariance))[places] * np.array([1.0, -0.5])
    change *= np.sqrt(chi_square / (change @ np.linalg.solve(free.covariance[np.ix_(places, places)], change)))
    parameters = _parameters(far)
    parameters[places] = _parameters(free.camera)[places] + change
    found = calibrate(TRUE, fields, anchor=_with(far, parameters))
    assert (name in found.held) is held
    expected = parameters[places] if held else _parameters(free.camera)[places]
    assert _parameters(found.camera)[places] == pytest.approx(expected, rel=2e-3 if not held else 1e-6, abs=1e-4)
