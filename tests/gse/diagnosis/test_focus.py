"""Stars that scatter more and more: named as defocus, unless they fade or did so from the beginning."""

import numpy as np
import pytest
import scipy.stats
from skies.known_nights import session

from gse.diagnosis.focus import _fades, _slope_within, focus_finding, focus_loss
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


def test_the_slope_within_stars_and_its_error_are_those_of_a_regression_clustered_by_star():
    rng = np.random.default_rng(4)
    star = np.repeat(np.arange(7), 30).astype(np.int32)
    at = rng.uniform(0, 1, 210)
    values = 5.0 * star + 0.7 * at + rng.normal(0, 0.3, 210)
    design = np.column_stack([at, star[:, None] == np.arange(7)])
    fit, *_ = np.linalg.lstsq(design, values, rcond=None)
    left, about = values - design @ fit, at - np.array([at[star == one].mean() for one in star])
    scores = np.array([(about * left)[star == one].sum() for one in range(7)])
    error = np.sqrt((scores**2).sum()) / (about**2).sum() * scipy.stats.t.ppf(0.975, 6) / 1.96
    assert _slope_within(at, values, star) == pytest.approx((fit[0], error))
    assert _slope_within(at[:150], values[:150], star[:150])[1] == np.inf  # five stars tell too little
