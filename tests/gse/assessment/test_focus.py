"""Stars that scatter more and more: named as defocus, unless they fade or did so from the beginning."""

import numpy as np
import pytest
from skies.known_nights import session

from gse.assessment.counted_frames import counted_frames
from gse.assessment.focus import focus_finding, focus_loss

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
