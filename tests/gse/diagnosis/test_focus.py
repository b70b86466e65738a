"""Stars that scatter more and more: named as defocus, unless they fade or did so from the beginning."""

import numpy as np
import pytest
from skies.known_nights import session

from gse.diagnosis.plain_findings import FocusLoss, _fades, focus_finding, focus_loss
from gse.statistics.counted_frames import counted_frames

STARS = [(100.0 + 80 * k, 900.0 - 70 * k, 0.0, 0.0) for k in range(10)]
PIXEL_ARCSEC = 49.46


def night(first_px, last_px, *, transparency=(1.0, 1.0), stars=10):
    made = session(100, step_s=1.0, matches=STARS[:stars])
    frames, matches, rng = made.frames.columns, made.frames.matches, np.random.default_rng(8)
    share = matches["frame"] / 99
    scatter = PIXEL_ARCSEC * first_px * (last_px / first_px) ** share
    for name in ("residual_x_arcsec", "residual_y_arcsec"):
        matches[name] = rng.normal(0, scatter)
    frames["transparency"] = np.linspace(*transparency, len(frames))
    return focus_loss(made, counted_frames(made))


def test_stars_that_scatter_ever_more_are_out_of_focus_and_the_growth_is_told():
    found = night(0.2, 0.8)
    assert found.first_px == pytest.approx(0.24, rel=0.1)
    assert found.last_px == pytest.approx(0.68, rel=0.1)
    finding = focus_finding(found)
    assert finding.cause == "defocus"
    assert f"{found.last_px:.2f} px in the last quarter" in finding.size


@pytest.mark.parametrize(
    ("scatter_px", "options"),
    [
        ((0.3, 0.3), {}),
        ((0.8, 0.2), {}),
        ((0.3, 0.4), {}),
        ((0.2, 0.8), {"transparency": (1.0, 0.4)}),
        ((0.2, 0.8), {"stars": 4}),
    ],
    ids=["steady", "better", "a third more", "behind a cloud", "few stars"],
)
def test_nothing_is_said_of_other_stars(scatter_px, options):
    assert night(*scatter_px, **options) is None


@pytest.mark.parametrize(("last", "fades"), [(3, True), (2, False)])
def test_stars_fade_where_most_of_the_last_quarter_is_darker_by_more_than_a_quarter(last, fades):
    transparency = np.where(np.arange(20) < 20 - last, 1.0, 0.74).astype(np.float32)
    assert _fades(transparency) is fades
    assert not _fades(np.where(np.arange(20) < 15, 1.0, 0.76).astype(np.float32))


# Where it begins to count


def growing(last_px, *, rows=20, stars=10):
    """Residuals of one size in each frame: 0.2 px in the first quarter, ``last_px`` in the last, growing between."""
    made = session(rows, step_s=1.0, matches=STARS[:stars])
    frames, matches = made.frames.columns, made.frames.matches
    size = np.interp(matches["frame"] / (rows - 1), [0.25, 0.75], [0.2, last_px])
    sign = np.where((matches["frame"] + matches["star"]) % 2, 1.0, -1.0)
    for name in ("residual_x_arcsec", "residual_y_arcsec"):
        matches[name] = PIXEL_ARCSEC * size * sign
    frames["transparency"] = 1.0
    return focus_loss(made, counted_frames(made))


@pytest.mark.parametrize(("last_px", "is_told"), [(0.299, False), (0.301, True)])
def test_scatter_must_grow_by_half(last_px, is_told):
    found = growing(last_px)
    assert (found is not None) is is_told
    if found is not None:
        assert (found.first_px, found.last_px) == (pytest.approx(0.2, rel=1e-3), pytest.approx(last_px, rel=1e-3))


@pytest.mark.parametrize(("rows", "is_told"), [(19, False), (20, True)])
def test_two_hundred_stars_must_be_seen(rows, is_told):
    assert (growing(0.8, rows=rows) is not None) is is_told


@pytest.mark.parametrize(("stars", "is_told"), [(5, False), (6, True)])
def test_six_stars_must_be_seen(stars, is_told):
    assert (growing(0.8, rows=60, stars=stars) is not None) is is_told


def test_unknown_transparency_fades_nothing_and_three_quarters_of_it_are_as_bright():
    assert not _fades(np.full(8, np.nan, dtype=np.float32))
    assert not _fades(np.zeros(0, dtype=np.float32))
    assert not _fades(np.array([1.0, 0.75], dtype=np.float32))
    assert _fades(np.array([np.nan, 1.0, np.nan, 0.74], dtype=np.float32))
    assert _fades(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], dtype=np.float32)) is False


def test_the_finding_names_both_quarters():
    assert str(focus_finding(FocusLoss(0.25, 0.75))) == (
        "defocus: single stars scatter by 0.75 px in the last quarter of the session, by 0.25 px in the first, and are "
        "as bright as before; this session cannot tell it apart from: seeing that grows, a vibration that smears "
        "single stars; next: look at focus and temperature of the lens, and repeat the session"
    )


def with_sizes(size_px, stars):
    """Residuals of each frame (rows) and star in px, on both axes together."""
    places = [(60.0 + 50 * k, 900.0 - 45 * k, 0.0, 0.0) for k in range(stars)]
    made = session(len(size_px), step_s=1.0, matches=places)
    frames, matches = made.frames.columns, made.frames.matches
    size = PIXEL_ARCSEC * size_px[matches["frame"], matches["star"]]
    matches["residual_x_arcsec"], matches["residual_y_arcsec"] = 1.4 * size, 0.2 * size
    frames["transparency"] = 1.0
    return focus_loss(made, counted_frames(made))


def test_the_first_quarter_ends_before_a_quarter_and_the_last_begins_at_three_of_the_time():
    """Of 21 frames the first five and the last six; a frame scatters by a tenth of a pixel more than the one before."""
    size_px = 0.1 * np.arange(1.0, 22.0)
    found = with_sizes(np.tile(size_px[:, None], 10), 10)
    assert found.first_px == pytest.approx(np.sqrt(np.mean(size_px[:5] ** 2)), rel=1e-3)
    assert found.last_px == pytest.approx(np.sqrt(np.mean(size_px[15:] ** 2)), rel=1e-3)


@pytest.mark.parametrize(("stars", "is_told"), [(12, False), (18, True)])
def test_residuals_below_a_tenth_of_a_pixel_are_as_good_as_none(stars, is_told):
    """Half of the stars grow from nothing to a tenth of a pixel, half to one: by the logarithms of 2 and of 101.

    Of 12 stars the mean of these is 4.7 standard errors, of 18 it is 5.7; as few add a tenth to them.
    """
    size_px = np.zeros((24, stars))
    size_px[12:] = np.where(np.arange(stars) % 2, 0.1, 1.0)
    assert (with_sizes(size_px, stars) is not None) is is_told
