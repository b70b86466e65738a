"""What is said of errors that no cause explains: noise of stars, or none of what is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import STATION, session

from gse.diagnosis.diagnosis import unexplained
from gse.station.columns import STATUSES
from gse.station.results import Status
from gse.statistics.session_statistics import statistics
from gse.values.constants import ARCSEC_PER_RAD

PLACES = [(100.0 + 90 * k, 900.0 - 80 * k) for k in range(9)]
"""Nine stars, of whose residuals a fit takes one and a half: a star's noise is sqrt(9 / 7.5) of them."""


def night(residual_arcsec, *, noise=30.0, limit=10.0, stars=9, roll_limit=1e6):
    limits = replace(STATION.limits, d_ra_cosde_arcsec=limit, d_de_arcsec=limit, d_roll_arcsec=roll_limit)
    made = session(
        300,
        noise=noise,
        station=STATION.model_copy(update={"limits": limits}),
        matches=tuple((x, y, residual_arcsec, residual_arcsec * (-1) ** k) for k, (x, y) in enumerate(PLACES[:stars])),
    )
    made.frames.columns["matched"] = stars
    return made


def said(made):
    return list(unexplained(made, statistics(made)))


def test_a_session_within_its_limits_has_nothing_to_explain():
    assert said(night(80.0, limit=300.0)) == []


def test_stars_that_scatter_as_much_as_the_boresight_does_are_the_cause():
    """80 arcsec of residual are 87.6 of a star, and a third of that of a boresight of nine."""
    (finding,) = said(night(80.0, noise=29.0))
    assert finding.cause == "centroid noise"
    pixel_arcsec = STATION.sensor.camera().pixel_rad * ARCSEC_PER_RAD
    of_star = 80 * math.sqrt(9 / 7.5)
    assert f"single stars scatter by {of_star:.0f} arcsec ({of_star / pixel_arcsec:.2f} px)" in finding.size
    assert "so that 9 of them leave 29 arcsec on each axis" in finding.size
    assert finding.size.startswith("95 % of |dRA*| is 5")


@pytest.mark.parametrize(("share", "cause"), [(1.35, "centroid noise"), (1.45, "none of these")])
def test_errors_beyond_1_4_of_what_the_stars_leave_have_another_cause(share, cause):
    made = night(80.0)
    frames, left = made.frames.columns, 80 * math.sqrt(9 / 7.5) / 3
    for name in ("cross_x_arcsec", "cross_y_arcsec"):
        frames[name] = share * left * (-1.0) ** np.arange(len(frames))
    (finding,) = said(made)
    assert finding.cause == cause


def test_without_stars_to_show_it_no_noise_is_blamed():
    assert [finding.cause for finding in said(night(80.0, stars=1))] == ["none of these"]
    assert [finding.cause for finding in said(night(0.0, stars=0))] == ["none of these"]


def test_a_roll_alone_is_not_the_noise_of_stars():
    made = night(300.0, limit=1e6, roll_limit=10.0)
    (finding,) = said(made)
    assert finding.cause == "none of these"
    assert finding.size.startswith("95 % of |roll| is")


def test_frames_without_an_answer_are_not_asked_for_their_stars():
    """A tenth of the frames has none; the others have nine stars each, as before."""
    made = night(80.0, noise=29.0)
    frames = made.frames.columns
    frames["status"][::10], frames["matched"][::10] = STATUSES.index(Status.NO_MATCH), 0
    (finding,) = said(made)
    assert finding.cause == "centroid noise"
    assert "so that 9 of them leave 29 arcsec" in finding.size


def test_a_fit_takes_all_that_one_star_and_a_half_show():
    made = night(80.0, noise=29.0)
    made.frames.columns["matched"] = np.arange(300) % 2 + 1
    assert [finding.cause for finding in said(made)] == ["none of these"]
    made.frames.columns["matched"] = 2
    (finding,) = said(made)
    assert "single stars scatter by 160 arcsec" in finding.size  # half of the square of two is left
