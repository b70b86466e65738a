"""A sensor whose picture stands still, by how far the sky moves meanwhile."""

import math

import numpy as np
import pytest
from skies.known_nights import STATION, session

from gse.diagnosis.plain_findings import _longest_run, still_panoramas

SAME_STARS = tuple((100.0 + 60 * star, 900.0 - 50 * star, 0.0, 0.0) for star in range(12))
PIXEL_ARCSEC = 206_265 / STATION.sensor.camera().focal_length_px


def frozen(duration_s, *, de_deg=0.0, frames=21):
    """A sensor that sends the same picture for so long."""
    made = session(frames, step_s=duration_s / (frames - 1), matches=SAME_STARS)
    made.frames.columns["de_true_deg"][:] = de_deg
    return still_panoramas(made)


@pytest.mark.parametrize(("duration_s", "de_deg"), [(60.0, 0.0), (200.0, 0.0), (200.0, 60.0)])
def test_a_picture_that_stands_still_is_told_with_how_far_the_sky_moves(duration_s, de_deg):
    """By 360 deg in a sidereal day of 86164.1 s, times the cosine of the declination."""
    moved_px = 1_296_000 / 86_164.1 * duration_s * math.cos(math.radians(de_deg)) / PIXEL_ARCSEC
    finding = frozen(duration_s, de_deg=de_deg)
    assert finding.cause == "frozen sensor"
    assert finding.size.startswith("21 panoramas in a row show the same objects on the same pixels, ")
    assert f"for {duration_s:.0f} s in which the sky moves by {moved_px:.0f} px;" in finding.size


@pytest.mark.parametrize(("moved_px", "is_frozen"), [(1.9, False), (2.1, True)])
def test_the_sky_must_move_by_two_pixels_before_a_picture_stands_still(moved_px, is_frozen):
    duration_s = moved_px * PIXEL_ARCSEC / 15.04107
    assert (frozen(duration_s) is not None) == is_frozen


@pytest.mark.parametrize(("frames", "is_frozen"), [(4, False), (5, True)])
def test_five_panoramas_with_the_same_picture_show_that_it_stands_still(frames, is_frozen):
    assert (frozen(600.0, frames=frames) is not None) == is_frozen


def test_of_the_longest_run_of_one_picture_the_first_and_the_last_are_told():
    """Five pictures, ten times the same, five others; a frame that is missing ends a run."""
    pictures = np.array([*range(5), *[9] * 10, *range(10, 15)], dtype=float)[:, None]
    rows = np.arange(20)
    assert _longest_run(rows, pictures) == (5, 14)
    assert _longest_run(np.where(rows < 8, rows, rows + 1), pictures) == (8, 14)
    assert _longest_run(rows, np.zeros((20, 1))) == (0, 19)


def test_at_the_pole_the_field_turns_about_its_middle():
    """Half of the diagonal of 1024 pixels at 4170 of focal length is 9.85 deg, as far as stars turn about it."""
    half_rad = math.atan(math.hypot(512, 512) / STATION.sensor.camera().focal_length_px)
    assert math.degrees(half_rad) == pytest.approx(9.85, abs=0.01)
    moved_px = 15.04107 * 6000 * half_rad / PIXEL_ARCSEC
    assert f"for 6000 s in which the sky moves by {moved_px:.0f} px" in frozen(6000.0, de_deg=90.0).size


@pytest.mark.parametrize("column", range(3))
def test_another_number_of_stars_or_other_sums_of_their_places_are_another_picture(column):
    pictures = np.ones((20, 3))
    pictures[13:, column] = 2.0
    assert _longest_run(np.arange(20), pictures) == (0, 12)


def test_the_same_stars_at_other_places_of_the_same_sum_along_columns_are_another_picture():
    """The picture is their number and the sums of both places."""
    made = session(21, step_s=60.0, matches=SAME_STARS)
    assert still_panoramas(made) is not None
    matches = made.frames.matches
    matches["y_px"] += matches["frame"]
    assert still_panoramas(made) is None


@pytest.mark.parametrize(("alike", "is_frozen"), [(4, False), (5, True)])
def test_five_panoramas_are_counted_from_the_first_that_is_alike(alike, is_frozen):
    """After five whose pictures differ."""
    made = session(5 + alike, step_s=60.0, matches=SAME_STARS)
    matches = made.frames.matches
    matches["x_px"] += np.maximum(5 - matches["frame"].astype(int), 0)
    found = still_panoramas(made)
    assert (found is not None) is is_frozen
    assert found is None or found.size.startswith(
        "5 panoramas in a row show the same objects on the same pixels, for 240 s"
    )


def sent_often(times, *, unit_px=1 / 32, frames=40, step_s=0.5):
    """A sensor that sends each of its pictures so many times; the sky moves by 0.15 px in half a second."""
    made = session(frames, step_s=step_s, matches=SAME_STARS)
    made.frames.columns["de_true_deg"][:] = 0.0
    matches = made.frames.matches
    shown = matches["frame"].astype(int) // times * times
    noise_units = (7 * shown + 3 * (np.arange(len(matches)) % 12)) % 5 if unit_px < 1 else 0
    matches["x_px"] = (np.round((matches["x_px"] + shown * 0.15) / unit_px) + noise_units) * unit_px
    return still_panoramas(made)


def test_a_sensor_that_sends_each_picture_twice_is_told():
    finding = sent_often(2)
    assert finding.cause == "repeated panoramas"
    assert finding.size.startswith(
        "20 of 40 panoramas show each star exactly where the one before shows it, while the sky moves by 0.15 px"
    )


def test_pictures_that_all_differ_are_no_copies():
    assert sent_often(1) is None


def test_whole_pixels_that_stay_the_same_are_no_copies():
    assert sent_often(1, unit_px=1.0) is None
    assert sent_often(2, unit_px=1.0) is None


@pytest.mark.parametrize(("step_s", "is_told"), [(0.19, False), (0.22, True)])
def test_between_a_picture_and_its_copy_the_sky_moves_by_two_units_of_the_places(step_s, is_told):
    """Of a 32nd of a pixel; 15.04 arcsec/s are 0.3 px/s."""
    assert (sent_often(2, step_s=step_s) is not None) == is_told


@pytest.mark.parametrize(("frames", "is_told"), [(9, False), (10, True)])
def test_five_copies_tell_it(frames, is_told):
    assert (sent_often(2, frames=frames) is not None) == is_told
