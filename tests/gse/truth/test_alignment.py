"""The fit of the mount: its 1 sigma, its gate for outliers, what it says of itself."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.errors import UsageError
from gse.truth import Alignment, fit_mount, horizon_to_sensor, small_rotations, time_blocks
from gse.truth.alignment import _most_central
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount

ARCSEC = math.pi / 180 / 3600
START_NS = from_text("2026-03-20T18:30:07Z")
"""Not a multiple of the 20 s of a block: blocks count from the first frame."""
MOUNT = Mount(azimuth_deg=123.0, altitude_deg=41.0, roll_deg=200.0)
SIGMA = np.array([3.0, 4.0, 30.0])


def instants(count, step_s=1.0):
    return START_NS + np.round(np.arange(count) * step_s * NS_PER_S).astype(np.int64)


def turned(errors_arcsec, mount=MOUNT):
    """Measured rotations with these errors (M, 3)."""
    return Rotation.from_rotvec(np.asarray(errors_arcsec) * ARCSEC).as_matrix() @ horizon_to_sensor(mount)


def noise(count, seed=0):
    return np.random.default_rng(seed).normal(0, SIGMA, (count, 3))


def pulls(errors_of, count, step_s):
    """Errors of many fits in units of their stated standard deviations, root mean square by axis."""
    squares = []
    for seed in range(80):
        fitted = fit_mount(instants(count, step_s), turned(errors_of(seed)))
        off = small_rotations(horizon_to_sensor(fitted.mount)[None], horizon_to_sensor(MOUNT))[0] / ARCSEC
        squares.append((off / fitted.sigma_arcsec) ** 2)
    return np.sqrt(np.mean(squares, axis=0))


def test_the_stated_sigma_is_one_standard_deviation_of_the_fit():
    assert (np.abs(pulls(lambda seed: noise(60, seed), 60, 0.5) - 1) < 0.25).all()


def test_errors_that_last_twenty_seconds_do_not_count_as_many():
    """20 frames in each 20 s, all with one error."""
    together = pulls(lambda seed: np.repeat(noise(30, seed), 20, axis=0), 600, 1.0)
    assert (np.abs(together - 1) < 0.25).all()


@pytest.mark.parametrize(("step_s", "frames"), [(1.0, 160), (0.5, 160)])
def test_the_sigma_is_of_eight_blocks_where_a_session_has_no_more(step_s, frames):
    """The variance of Student's t with 7 degrees of freedom is 7 / 5."""
    errors = noise(frames)
    means = errors.reshape(8, frames // 8, 3).mean(axis=1)
    fitted = fit_mount(instants(frames, step_s), turned(errors))
    expected = means.std(axis=0, ddof=1) / math.sqrt(8) * math.sqrt(7 / 5)
    assert fitted.sigma_arcsec == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("seconds", [80, 90, 160, 400])
def test_blocks_last_twenty_seconds_or_an_eighth_of_what_there_is(seconds):
    """An eighth of the time from the first frame to the last, so that a frame or so is left for a ninth."""
    counts = np.bincount(time_blocks(instants(seconds)))
    assert len(counts) == pytest.approx(max(8, seconds / 20), abs=1)
    assert counts[0] == pytest.approx(min(20, seconds / 8), abs=1)


def test_the_mount_is_the_mean_of_the_frames_and_the_scatter_their_standard_deviation():
    errors = noise(100)
    fitted = fit_mount(instants(100), turned(errors))
    off = small_rotations(horizon_to_sensor(fitted.mount)[None], horizon_to_sensor(MOUNT))[0] / ARCSEC
    assert off == pytest.approx(errors.mean(axis=0), abs=1e-3)
    assert fitted.scatter_arcsec == pytest.approx(tuple(errors.std(axis=0, ddof=1)), rel=1e-4)
    assert (fitted.n, fitted.rejected) == (100, 0)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("sigmas", "rejected"), [(4.0, 0), (-4.0, 0), (6.0, 1), (-6.0, 1), (1000.0, 1)])
def test_a_frame_is_rejected_beyond_five_sigma_on_any_axis(axis, sigmas, rejected):
    errors = np.clip(noise(400, 3), -3 * SIGMA, 3 * SIGMA)
    errors[200] = 0.0
    errors[200, axis] = sigmas * SIGMA[axis]
    fitted = fit_mount(instants(400), turned(errors))
    assert (fitted.n, fitted.rejected) == (400 - rejected, rejected)


def test_the_first_and_the_last_instant_are_those_of_frames_that_were_used():
    errors = noise(50)
    errors[[0, -1]] = 3600.0
    fitted = fit_mount(instants(50), turned(errors))
    assert (fitted.from_ns, fitted.until_ns) == (int(instants(50)[1]), int(instants(50)[-2]))


@pytest.mark.parametrize("count", [25, 1000])
def test_two_false_answers_in_five_do_not_move_the_mount(count):
    rotations = turned(noise(count))
    false = np.arange(count) % 5 < 2
    rotations[false] = Rotation.random(int(false.sum()), rng=np.random.default_rng(2)).as_matrix()
    fitted = fit_mount(instants(count), rotations)
    assert fitted.rejected == false.sum()
    off = small_rotations(horizon_to_sensor(fitted.mount)[None], horizon_to_sensor(MOUNT))[0] / ARCSEC
    assert (np.abs(off) < 5 * SIGMA / math.sqrt(0.6 * count)).all()


@pytest.mark.parametrize("count", [25, 1000])
@pytest.mark.parametrize("about", np.vstack([np.eye(3), [0.6, 0.8, 0.0], [0.6, 0.0, -0.8]]).tolist())
def test_false_answers_that_begin_a_session_half_a_turn_away_do_not_move_the_mount(count, about):
    """From half a turn away the others scatter to both sides: the fit must begin among the majority."""
    rotations = turned(noise(count))
    false = np.arange(count) < 0.4 * count
    rotations[false] = Rotation.from_rotvec(math.pi * np.array(about)).as_matrix() @ rotations[false]
    fitted = fit_mount(instants(count), rotations)
    assert fitted.rejected == false.sum()
    off = small_rotations(horizon_to_sensor(fitted.mount)[None], horizon_to_sensor(MOUNT))[0] / ARCSEC
    assert (np.abs(off) < 5 * SIGMA / math.sqrt(0.6 * count)).all()


@pytest.mark.parametrize("degrees", [1e-6, 3.0, 80.0, 120.0, 180.0])
def test_rotations_from_one_to_each_of_others_are_small_or_up_to_half_a_turn(degrees):
    vectors = math.radians(degrees) * np.vstack([np.eye(3), [0.6, 0.0, 0.8]])
    here = horizon_to_sensor(MOUNT)
    found = small_rotations(Rotation.from_rotvec(vectors).as_matrix() @ here, here)
    assert np.abs(found) == pytest.approx(vectors, abs=1e-12)


def test_one_frame_is_a_mount_of_unknown_precision():
    fitted = fit_mount(instants(1), turned([[5.0, 0.0, 0.0]]))
    assert np.isnan(fitted.scatter_arcsec).all()
    assert np.isnan(fitted.covariance_arcsec2).all()
    assert np.shape(fitted.covariance_arcsec2) == (3, 3)
    assert (fitted.n, fitted.rejected) == (1, 0)


def test_two_frames_have_a_scatter():
    fitted = fit_mount(instants(2), turned([[1.0, 2.0, -3.0], [-1.0, -2.0, 3.0]]))
    assert fitted.scatter_arcsec == pytest.approx((math.sqrt(2), math.sqrt(8), math.sqrt(18)), rel=1e-4)
    assert np.isnan(fitted.sigma_arcsec).all()  # two blocks say nothing of the uncertainty of their mean


def test_equal_frames_are_all_used():
    fitted = fit_mount(instants(40), turned(np.zeros((40, 3))))
    assert (fitted.n, fitted.rejected) == (40, 0)
    assert max(fitted.sigma_arcsec) < 1e-6


def test_no_frame_is_refused():
    with pytest.raises(UsageError, match="no frame was identified"):
        fit_mount([], np.empty((0, 3, 3)))


def alignment(mount, covariance):
    rows = tuple((row[0], row[1], row[2]) for row in np.asarray(covariance, dtype=float).tolist())
    return Alignment(mount, rows, (1.0, 1.0, 1.0), 321, 4, 0, 1)


def test_a_line_for_a_person_says_mount_frames_and_one_sigma():
    text = str(alignment(MOUNT, np.diag([9.0, 16.0, 400.0])))
    assert "fitted on 321 frames: azimuth 123.00000, altitude 41.00000, roll 200.0000 deg" in text
    assert "good to 5.00 arcsec across and 20.0 arcsec about the boresight (1 sigma)" in text


@pytest.mark.parametrize(
    "mount", [MOUNT, Mount(azimuth_deg=10, altitude_deg=75, roll_deg=330), Mount(azimuth_deg=250, altitude_deg=-20)]
)
def test_the_sigmas_of_the_three_angles_follow_from_how_the_mount_turns_with_each(mount):
    covariance = np.array([[9.0, 2.0, -4.0], [2.0, 16.0, 5.0], [-4.0, 5.0, 400.0]])
    step_deg = 1e-4
    here = horizon_to_sensor(mount)
    by_angle = []
    for name in ("azimuth_deg", "altitude_deg", "roll_deg"):
        angles = {n: getattr(mount, n) for n in ("azimuth_deg", "altitude_deg", "roll_deg")}
        angles[name] += step_deg
        by_angle.append(small_rotations(horizon_to_sensor(Mount(**angles))[None], here)[0] / math.radians(step_deg))
    inverse = np.linalg.inv(np.array(by_angle).T)
    expected = np.sqrt(np.diag(inverse @ covariance @ inverse.T))
    assert alignment(mount, covariance).sigma_azimuth_altitude_roll_arcsec == pytest.approx(tuple(expected), rel=1e-4)


def test_at_the_zenith_azimuth_and_roll_share_what_is_known_of_their_sum():
    azimuth, altitude, roll = alignment(Mount(), np.diag([9.0, 9.0, 400.0])).sigma_azimuth_altitude_roll_arcsec
    assert azimuth == pytest.approx(10.0)
    assert roll == pytest.approx(10.0)
    assert altitude == pytest.approx(3.0)


@pytest.mark.parametrize("first", [0, 3, 10])
def test_a_fit_begins_at_a_frame_of_the_majority(first):
    """Of 21 frames ten are turned each its own way, wherever among the others they stand."""
    rng = np.random.default_rng(first)
    rotations = np.array([np.eye(3)] * 21) + rng.normal(0, 1e-5, (21, 3, 3))
    turned = range(first, first + 10)
    rotations[first : first + 10] = Rotation.random(10, rng=rng).as_matrix()
    assert _most_central(rotations) not in turned


def test_of_many_frames_every_few_stand_for_all():
    rotations = np.array([np.eye(3)] * 1000)
    rotations[:450] = Rotation.random(450, rng=np.random.default_rng(2)).as_matrix()
    assert 450 <= _most_central(rotations) < 1000


@pytest.mark.parametrize(
    ("since_s", "blocks"),
    [
        # 160 s and more: blocks of 20 s.
        ([0, 19.999999999, 20, 39.999999999, 40, 160], [0, 0, 1, 1, 2, 8]),
        ([1000, 0, 30, 980], [50, 0, 1, 49]),
        # 80 s: eight blocks of 10 s, which are a nanosecond longer, so that the last frame is in the eighth.
        ([0, 10, 10.000000001, 20.000000001, 20.000000002, 80], [0, 0, 1, 1, 2, 7]),
        ([0], [0]),
        ([0, 0.000000001], [0, 1]),
    ],
)
def test_a_frame_belongs_to_the_block_of_its_time_since_the_first(since_s, blocks):
    utc_ns = START_NS + np.array([round(s * NS_PER_S) for s in since_s])
    assert time_blocks(utc_ns).tolist() == blocks


def test_four_blocks_are_the_fewest_that_tell_their_uncertainty():
    """Means of -2, 2, -1 and 1: a variance of 10 / 3, a quarter of it for the mean, and 3 of Student's t with 3."""
    errors = np.array([[-2.0, 0, 0], [2.0, 0, 0], [-1.0, 0, 0], [1.0, 0, 0]]) * [1, 0, 0]
    errors[:, 1], errors[:, 2] = 2 * errors[:, 0], errors[:, 0] ** 2 - 2.5
    fitted = fit_mount(instants(4, 100.0), turned(errors))
    assert fitted.covariance_arcsec2[0][0] == pytest.approx(2.5, rel=1e-4)
    assert fitted.covariance_arcsec2[1][1] == pytest.approx(10.0, rel=1e-4)
    assert fitted.covariance_arcsec2[0][1] == pytest.approx(5.0, rel=1e-4)
    assert fitted.covariance_arcsec2[0][2] == pytest.approx(0.0, abs=1e-3)
    assert (fitted.from_ns, fitted.until_ns) == (START_NS, START_NS + 300 * NS_PER_S)
    three = fit_mount(instants(3, 100.0), turned(errors[:3]))
    assert np.isnan(three.covariance_arcsec2).all()


def test_what_the_stars_keep_is_added_to_the_scatter_of_the_frames():
    errors, kept = noise(200), np.array([[4.0, 1.0, 0.5], [1.0, 9.0, -0.5], [0.5, -0.5, 100.0]])
    alone = fit_mount(instants(200), turned(errors))
    both = fit_mount(instants(200), turned(errors), persistent_arcsec2=kept)
    assert np.array(both.covariance_arcsec2) - alone.covariance_arcsec2 == pytest.approx(kept, abs=1e-9)


@pytest.mark.parametrize(("off_rad", "rejected"), [(4e-9, 0), (6e-9, 1)])
def test_of_equal_frames_one_is_rejected_beyond_five_billionths(off_rad, rejected):
    """A milliarcsecond: without a scatter of the others the last digits of a rotation must not count."""
    errors = np.zeros((40, 3))
    errors[30, 0] = off_rad / ARCSEC
    assert fit_mount(instants(40), turned(errors)).rejected == rejected


def test_sigmas_below_an_arcsecond_are_stated_as_they_are():
    fitted = alignment(MOUNT, np.diag([0.09, 0.16, 0.25]))
    assert fitted.sigma_arcsec == pytest.approx((0.3, 0.4, 0.5))
    assert "good to 0.50 arcsec across and 0.5 arcsec about" in str(fitted)
    level = alignment(Mount(azimuth_deg=20, altitude_deg=0, roll_deg=0), np.diag([0.09, 0.16, 0.25]))
    assert level.sigma_azimuth_altitude_roll_arcsec == pytest.approx((0.4, 0.3, 0.5))
    rounded = alignment(MOUNT, np.diag([-1e-20, 0.16, 0.25]))
    assert rounded.sigma_arcsec == pytest.approx((0.0, 0.4, 0.5))


def three_directions(count, middle):
    """Rotations a degree away from one, each third towards a direction of its own, but for the one in the middle."""
    towards = np.radians(120.0 * (np.arange(count) % 3))
    vectors = np.radians(1.0) * np.column_stack([np.cos(towards), np.sin(towards), np.zeros(count)])
    vectors[middle] = 0.0
    return Rotation.from_rotvec(vectors).as_matrix()


@pytest.mark.parametrize(
    ("count", "middle"), [(9, 4), (199, 77), (200, 77), (201, 78), (400, 250), (1000, 505), (1401, 504)]
)
def test_the_frame_in_the_middle_of_the_others_is_the_most_central(count, middle):
    """Each of 200 frames stands for itself, every second of 400, every fifth of a thousand."""
    assert _most_central(three_directions(count, middle)) == middle


@pytest.mark.parametrize(
    ("count", "middle", "step"), [(201, 77, 2), (400, 77, 2), (401, 301, 3), (1000, 507, 5), (1401, 505, 8)]
)
def test_a_fit_of_many_frames_begins_at_one_of_at_most_two_hundred(count, middle, step):
    found = _most_central(three_directions(count, middle))
    assert found != middle
    assert found % step == 0


def test_the_mount_is_where_the_turns_to_all_frames_add_up_to_nothing():
    """Degrees apart, where one mean of small turns is not enough."""
    vectors = np.radians(np.random.default_rng(5).uniform(-8, 8, (40, 3)))
    rotations = Rotation.from_rotvec(vectors).as_matrix() @ horizon_to_sensor(MOUNT)
    fitted = fit_mount(instants(40), rotations)
    assert fitted.n == 40
    left = small_rotations(rotations, horizon_to_sensor(fitted.mount))
    assert np.abs(left.mean(axis=0)).max() < 1e-9


def test_the_blocks_of_one_instant_are_one():
    assert time_blocks(np.full(5, START_NS)).tolist() == [0] * 5
