"""Injected errors of single stars, of temperature and of starts are found within their intervals."""

import math

import numpy as np
import pytest
import scipy.stats
from skies.known_nights import STATION

from gse.station.session_tables import MATCH
from gse.statistics.spatial_errors import _field_basis, _noise, _part, _pixel_basis, spatial_errors
from gse.statistics.subject_statistics import first_fixes_s, thermal_error
from gse.values.constants import ARCSEC_PER_RAD

CAMERA = STATION.sensor.camera()
PIXEL_ARCSEC = CAMERA.pixel_rad * ARCSEC_PER_RAD


def matches(error_of=lambda x, y: 0.0, *, noise_arcsec=10.0, stars=60, frames=300, seed=1):
    """Stars that cross the detector in straight lines, each in half of the frames; errors along columns only."""
    rng = np.random.default_rng(seed)
    x0, y0 = rng.uniform(0, 800, stars), rng.uniform(0, 1000, stars)
    frame, star = (part.ravel() for part in np.meshgrid(np.arange(frames), np.arange(stars), indexing="ij"))
    seen = (frame // 50 + star) % 2 == 0
    frame, star = frame[seen], star[seen]
    rows = np.zeros(len(frame), dtype=MATCH)
    rows["frame"], rows["star"] = frame, star
    rows["x_px"], rows["y_px"] = x0[star] + 0.713 * frame, y0[star] + 0.0531 * frame
    noise = rng.normal(0, noise_arcsec, (2, len(frame)))
    rows["residual_x_arcsec"] = noise[0] + error_of(rows["x_px"], rows["y_px"])
    rows["residual_y_arcsec"] = noise[1]
    return rows


def found(rows):
    xy_px = np.column_stack([rows["x_px"], rows["y_px"]]).astype(float)
    return spatial_errors(rows, CAMERA.directions(xy_px), (CAMERA.columns, CAMERA.rows))


@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_has_no_spatial_error_within_its_interval(seed):
    for axis in found(matches(seed=seed)):
        assert axis.fov.low_arcsec == 0
        assert axis.pixel.low_arcsec == 0
        assert axis.fov.high_arcsec < 1
        assert axis.pixel.high_arcsec < 1
        assert 9 < axis.temporal.low_arcsec < 10.4 < axis.temporal.high_arcsec + 0.5


def test_noise_of_half_an_arcsecond_is_bounded_on_both_sides():
    for axis in found(matches(noise_arcsec=0.5)):
        assert 0.45 < axis.temporal.low_arcsec < axis.temporal.rms_arcsec < axis.temporal.high_arcsec < 0.6


def test_the_noise_of_the_boresight_is_that_of_a_star_over_the_root_of_their_number():
    for axis in found(matches(noise_arcsec=10.0)):  # 30 stars in each frame
        assert axis.temporal.boresight_arcsec == pytest.approx(10.0 / math.sqrt(30), rel=0.2)


def test_a_pixel_phase_error_of_a_twentieth_of_a_pixel_is_found():
    amplitude = 0.05 * PIXEL_ARCSEC
    x, y = found(matches(lambda x, y: amplitude * np.sin(2 * math.pi * x)))
    assert x.pixel.low_arcsec < amplitude / math.sqrt(2) < x.pixel.high_arcsec
    assert x.pixel.low_arcsec > 1
    assert 0 < x.pixel.boresight_arcsec < x.pixel.rms_arcsec
    assert x.fov.low_arcsec == 0
    assert y.pixel.low_arcsec == 0


def test_an_error_that_is_slow_over_the_field_is_found():
    def bent(x, y):
        return 4 * ((x / 512 - 1) ** 2 - 1 / 3)

    rows = matches(bent)
    x, y = found(rows)
    assert x.fov.low_arcsec < float(np.std(bent(rows["x_px"], rows["y_px"]))) < x.fov.high_arcsec
    assert x.pixel.low_arcsec == 0
    assert y.fov.low_arcsec == 0


@pytest.mark.parametrize("along", ["columns", "rows"])
def test_an_error_of_the_third_degree_is_of_the_field_and_no_noise(along):
    """Distortion is one. Legendre's polynomial has nothing of the first degree in it, its mean square is 1 in 7."""

    def bent(x, y):
        place = (x if along == "columns" else y) / 512 - 1
        return 8 * (5 * place**3 - 3 * place) / 2

    rows = matches(bent, noise_arcsec=1.0)
    x, y = found(rows)
    injected_arcsec = math.sqrt(np.mean(bent(rows["x_px"], rows["y_px"]) ** 2))
    assert injected_arcsec > 2.5
    assert x.fov.rms_arcsec == pytest.approx(injected_arcsec, rel=0.02)
    assert x.temporal.rms_arcsec == pytest.approx(y.temporal.rms_arcsec, rel=0.05)


def test_an_error_of_the_fourth_degree_belongs_to_no_part_of_the_field():
    def bent(x, y):
        place = y / 512 - 1
        return 8 * (35 * place**4 - 30 * place**2 + 3) / 8  # Legendre's polynomial: nothing of a lower degree is in it

    x, _ = found(matches(bent, noise_arcsec=1.0))
    assert x.temporal.rms_arcsec > x.fov.rms_arcsec


@pytest.mark.parametrize(("stars", "is_enough"), [(19, False), (20, True)])
def test_twenty_stars_are_needed_for_spatial_errors(stars, is_enough):
    assert (found(matches(stars=stars)) is not None) == is_enough


def thermal(per_k, *, seed=1, warming_k=7.0, count=6000):
    rng = np.random.default_rng(seed)
    time_s = np.arange(count) * 0.5
    temperature = 21 + warming_k * (1 - np.exp(-time_s / 600))
    error = per_k * temperature + rng.normal(0, 5, count)
    return thermal_error((time_s * 1e9).astype(np.int64), error, np.round(temperature, 1))


def test_a_boresight_that_follows_the_temperature_is_found_in_arcsec_per_kelvin():
    result = thermal(2.0)
    assert result.low_arcsec_per_k < 2.0 < result.high_arcsec_per_k
    assert result.high_arcsec_per_k - result.low_arcsec_per_k < 1
    assert result.range_k == pytest.approx(6.4, abs=0.3)


def test_noise_does_not_follow_the_temperature_in_nineteen_of_twenty_sessions():
    results = [thermal(0.0, seed=seed) for seed in range(40)]
    assert sum(one.low_arcsec_per_k <= 0 <= one.high_arcsec_per_k for one in results) >= 35


def test_where_residuals_do_not_correlate_the_interval_is_that_of_ordinary_regression():
    """Means of 32 blocks, their errors to and fro; 29 degrees of freedom are left beside mean, drift and slope."""
    number = np.arange(32)
    temperature, block = 20 + 3 * np.sin(number / 7), 1.5 * (-1.0) ** number
    error = 2 * temperature + 0.1 * number + block
    rows = np.repeat(number, 10)
    found = thermal_error(np.arange(320) * 10**9, error[rows], temperature[rows])
    design = np.column_stack([np.ones(32), number, temperature])
    fit, (square,), *_ = np.linalg.lstsq(design, error, rcond=None)
    sigma = math.sqrt(square / 29 * np.linalg.inv(design.T @ design)[2, 2])
    half = scipy.stats.t.ppf(0.975, 29) * sigma
    assert found.arcsec_per_k == pytest.approx(fit[2], rel=1e-6)
    assert found.low_arcsec_per_k == pytest.approx(fit[2] - half, rel=1e-6)
    assert found.high_arcsec_per_k == pytest.approx(fit[2] + half, rel=1e-6)
    assert found.range_k == pytest.approx(np.ptp(temperature))


def test_residuals_that_correlate_widen_it_as_kendall_has_the_bias_of_their_correlation():
    """(1 + 4 r) / n is missing in the correlation r of n residuals; (1 + r) / (1 - r) of them tell as much as one."""
    number = np.arange(32)
    temperature = 20 + 3 * np.sin(number / 7)
    course = 1.5 * np.sign(np.sin((number + 0.5) * math.pi / 2))  # two to one side, two to the other
    course += np.repeat([0.3, -0.3], 16)
    found = thermal_error(np.arange(320) * 10**9, (2 * temperature + course)[np.repeat(number, 10)],
                          temperature[np.repeat(number, 10)])  # fmt: skip
    design = np.column_stack([np.ones(32), number, temperature])
    fit, (square,), *_ = np.linalg.lstsq(design, 2 * temperature + course, rcond=None)
    left = 2 * temperature + course - design @ fit
    r = left[1:] @ left[:-1] / square
    r += (1 + 4 * r) / 32
    assert 0.05 < r < 0.9
    wider = (1 + r) / (1 - r)
    sigma = math.sqrt(square / 29 * wider * np.linalg.inv(design.T @ design)[2, 2])
    half = scipy.stats.t.ppf(0.975, 32 / wider - 3) * sigma
    assert found.high_arcsec_per_k == pytest.approx(fit[2] + half, rel=1e-5)


def test_residuals_that_correlate_widen_the_interval():
    number = np.arange(32)
    temperature = 20 + 3 * np.sin(number / 7)
    rows, rng = np.repeat(number, 10), np.random.default_rng(3)
    held = []
    for _ in range(60):
        course = rng.normal(size=33)
        for row in range(1, 33):
            course[row] = 0.6 * course[row - 1] + 0.8 * course[row]
        found = thermal_error(np.arange(320) * 10**9, course[1:][rows], temperature[rows])
        held.append(found.low_arcsec_per_k < 0 < found.high_arcsec_per_k)
    assert np.mean(held) >= 0.8


@pytest.mark.parametrize(("moved_k", "is_enough"), [(0.4, False), (0.6, True)])
def test_a_temperature_must_move_by_five_of_its_steps(moved_k, is_enough):
    temperature = 20 + moved_k * np.repeat([0.0, 1.0], 160)
    assert (thermal_error(np.arange(320) * 10**9, temperature, temperature) is not None) == is_enough


def test_a_steady_or_unknown_temperature_tells_nothing():
    assert thermal(2.0, warming_k=0.2) is None
    unknown = np.full(100, np.nan)
    assert thermal_error(np.arange(100), np.zeros(100), unknown) is None


def test_each_cold_start_has_its_time_to_first_fix():
    utc_ns = np.arange(9) * 10**9
    frame_no = np.array([5, 6, 7, 0, 1, 2, 0, 1, 2], dtype=np.uint32)
    good = np.array([False, True, True, True, True, True, False, False, False])
    fixes = first_fixes_s(utc_ns, frame_no, good)
    assert fixes[:2] == (1.0, 0.0)
    assert math.isnan(fixes[2])
    assert first_fixes_s(utc_ns[:0], frame_no[:0], good[:0]) == ()


# By hand


@pytest.mark.parametrize(
    ("fit", "rms2", "half", "boresight2"),
    [
        # 9 less noise of a half; twice its square and four times 9 of it; the boresight has half of each star
        (3.0, 8.5, 1.96 * math.sqrt(2 * 0.25 + 4 * 9 * 0.5), (2 * 1.5) ** 2 - 0.5),
        (0.1, 0.0, 1.96 * math.sqrt(2 * 0.25 + 4 * 0.01 * 0.5) + (0.01 - 0.5), 0.0),
    ],
)
def test_a_fitted_part_is_freed_of_its_noise(fit, rms2, half, boresight2):
    """A column of 1 and -1 whose coefficient has a variance of a half; two stars of a frame pull alike."""
    basis, shifts = np.array([[1.0], [-1.0], [1.0], [-1.0]]), np.full(4, 0.5)
    found = _part(basis, np.array([fit]), np.array([[0.5]]), shifts, np.array([4, 7, 4, 7]))
    assert found.rms_arcsec == pytest.approx(math.sqrt(rms2))
    assert found.high_arcsec == pytest.approx(math.sqrt(rms2 + half))
    assert found.low_arcsec == pytest.approx(math.sqrt(max(rms2 - half, 0.0)))
    assert found.boresight_arcsec == pytest.approx(math.sqrt(boresight2))


@pytest.mark.parametrize(("frames", "scale"), [(2, 4.0), (4, 4.0), (1, 1.6)])
def test_what_is_left_has_its_interval_by_how_stars_differ_and_the_share_that_a_fit_of_a_frame_took(frames, scale):
    """Three angles of the two equations of each star: of four stars 5 of 8 are left, of two or fewer a quarter."""
    left, star = np.array([1.0, -1.0, 2.0, -2.0]), np.array([0, 0, 1, 1])
    found = _noise(left, star, np.array([0.5, 0.5, 1.0, 1.0]), np.arange(4) % frames)
    differences = scale * np.array([2.0 - 2 * 2.5, 8.0 - 2 * 2.5])
    half = 1.96 * math.hypot(*differences) / 4
    assert found.rms_arcsec == pytest.approx(math.sqrt(2.5 * scale))
    assert found.low_arcsec == pytest.approx(math.sqrt(max(2.5 * scale - half, 0.0)))
    assert found.high_arcsec == pytest.approx(math.sqrt(2.5 * scale + half))
    assert found.boresight_arcsec == pytest.approx(math.sqrt(2.5 / frames * 2.5))


@pytest.mark.parametrize(("cycles", "is_pixel"), [(1, True), (2, True), (3, False)])
def test_two_harmonics_of_the_place_on_a_pixel_are_of_the_pixel(cycles, is_pixel):
    x, _ = found(matches(lambda x, y: 5 * np.sin(2 * math.pi * cycles * x), noise_arcsec=0.5))
    assert (x.pixel.rms_arcsec > 3.3) is is_pixel
    assert (x.temporal.rms_arcsec > 3.3) is not is_pixel
    assert (x.stars, x.n) == (60, 9000)


def at_places(places):
    """One star in one frame at each place."""
    rows = np.zeros(len(places), dtype=MATCH)
    rows["star"] = np.arange(len(places))
    rows["x_px"], rows["y_px"] = np.array(places, dtype=float).T
    return rows


def test_powers_of_the_place_reach_from_minus_one_to_one_over_the_detector_and_are_about_their_means():
    """On 800 columns and 1200 rows: two corners, the middle, the middle of a side, a place between."""
    basis = _field_basis(at_places([(0, 0), (800, 1200), (400, 600), (800, 600), (600, 300)]), (800, 1200))
    x, y = [-1.0, 1.0, 0.0, 1.0, 0.5], [-1.0, 1.0, 0.0, 0.0, -0.5]
    powers = [(0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (3, 0)]
    expected = np.array([[a**i * b**j for i, j in powers] for a, b in zip(x, y, strict=True)])
    assert basis == pytest.approx(expected - expected.mean(axis=0), abs=1e-12)


def test_harmonics_of_the_place_on_a_pixel_are_two_waves_of_each_axis():
    """At an eighth and a quarter of a pixel."""
    half = math.sqrt(0.5)
    waves = _pixel_basis(at_places([(5.125, 9.25), (7.0, 2.5)]))
    assert waves == pytest.approx(
        np.array([[half, half, 1.0, 0.0, 1.0, 0.0, 0.0, -1.0], [0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0]]), abs=1e-12
    )


def test_noise_along_rows_moves_the_boresight_more_where_all_stars_are_to_one_side_of_it():
    """Stars on a line of columns beside the boresight: their roll is told along rows alone, from far away.

    The value of a straight line at the boresight has the variance (1 + n m^2 / S) / n, with the mean place m and the
    sum of squares S about it; along columns no roll counts.
    """
    count, frames = 25, 400
    places = np.linspace(600.0, 1000.0, count)
    rng = np.random.default_rng(3)
    rows = np.zeros(count * frames, dtype=MATCH)
    rows["frame"], rows["star"] = np.repeat(np.arange(frames), count), np.tile(np.arange(count), frames)
    rows["x_px"], rows["y_px"] = np.tile(places, frames) + 0.37 * rows["frame"] % 1, 511.5
    rows["residual_x_arcsec"], rows["residual_y_arcsec"] = rng.normal(0, 10.0, (2, len(rows)))
    x, y = found(rows)
    mean, squares = (places - 511.5 + 0.5).mean(), ((places - places.mean()) ** 2).sum()
    left = math.sqrt(1 - 1.5 / count)  # what the fit of a frame took is put back in the noise of a star alone
    along_x = left / math.sqrt(count)
    along_y = along_x * math.sqrt(1 + count * mean**2 / squares)
    assert along_y > 2 * along_x
    assert x.temporal.boresight_arcsec == pytest.approx(along_x * x.temporal.rms_arcsec, rel=0.02)
    assert y.temporal.boresight_arcsec == pytest.approx(along_y * y.temporal.rms_arcsec, rel=0.02)
