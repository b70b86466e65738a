"""What a star simulator leaves open, by hand."""

import math

import pytest

from gse.statistics.budget_terms import inertial_terms
from gse.statistics.uncertainty import Distribution
from gse.values.mount import InertialDirection, InertialUncertainty

STATED = InertialUncertainty(across_arcsec=19.6, roll_arcsec=98.0)
AT = "2026-06-21T05:00:00Z"


def terms(*, clock_error_s=0.5, **direction):
    shown = InertialDirection(ra_deg=83.0, de_deg=60.0, uncertainty=STATED, **direction)
    return {term.name: term for term in inertial_terms(shown, clock_error_s)}


def on_axes(term):
    return term.ra_arcsec, term.de_arcsec, term.roll_arcsec


def test_the_stated_direction_is_known_to_half_of_the_width_that_holds_95_percent():
    found = terms()
    assert set(found) == {"shown direction", "shown roll"}
    assert on_axes(found["shown direction"]) == pytest.approx((10.0, 10.0, 0.0), rel=1e-4)
    assert on_axes(found["shown roll"]) == pytest.approx((0.0, 0.0, 50.0), rel=1e-4)
    assert not found["shown direction"].corrected


@pytest.mark.parametrize(
    ("rates", "expected"),
    [
        ({"ra_rate_arcsec_per_s": -20.0}, (10.0, 0.0, 0.0)),  # at the cosine of 60 deg
        ({"de_rate_arcsec_per_s": 20.0}, (0.0, 20.0, 0.0)),
        ({"roll_rate_arcsec_per_s": -300.0}, (0.0, 0.0, 300.0)),
    ],
)
def test_a_scene_that_moves_is_elsewhere_by_its_rate_times_the_error_of_the_clock(rates, expected):
    clock = terms(clock_error_s=math.sqrt(3), at=AT, **rates)["clock"]
    assert clock.standard == pytest.approx(1.0)
    assert on_axes(clock) == pytest.approx(expected)
    assert clock.distribution is Distribution.RECTANGULAR


def test_a_clock_that_is_not_known_leaves_open_only_what_moves():
    clock = terms(clock_error_s=math.inf, at=AT, de_rate_arcsec_per_s=1.0)["clock"]
    assert on_axes(clock) == (0.0, math.inf, 0.0)
