"""Terms combined and expanded: sums of distributions whose quantiles are known or integrated by scipy."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import scipy.special
import scipy.stats

from gse.statistics.uncertainty import TO_STANDARD, Distribution, Term, combined, half_width
from gse.values.axis import AXES, D_DE, D_RA_COSDE, D_ROLL

NORMAL, RECTANGULAR, STUDENT = Distribution.NORMAL, Distribution.RECTANGULAR, Distribution.STUDENT
TERM = Term("term", 1.0, "arcsec", 3.0, 4.0, 5.0, "A", "because", "measure")


@pytest.mark.parametrize(
    ("parts", "coverage", "expected"),
    [
        (((3.0, NORMAL, math.inf), (4.0, NORMAL, math.inf)), 0.95, 5 * 1.9599640),
        (((2.0, NORMAL, math.inf),), 0.9, 2 * 1.6448536),
        (((2.0, NORMAL, math.inf),), 0.5, 2 * 0.6744898),
        # A rectangle of standard deviation 1 is sqrt(3) wide on either side.
        (((1.0, RECTANGULAR, math.inf),), 0.95, 0.95 * math.sqrt(3)),
        (((2.0, RECTANGULAR, math.inf),), 0.5, math.sqrt(3)),
        # Two alike make a triangle of twice the half-width.
        (((1.0, RECTANGULAR, math.inf),) * 2, 0.95, 2 * math.sqrt(3) * (1 - math.sqrt(0.05))),
        (((1.0, RECTANGULAR, math.inf),) * 2, 0.9, 2 * math.sqrt(3) * (1 - math.sqrt(0.1))),
        (((3.0, STUDENT, 5.0),), 0.95, 3 * scipy.stats.t.ppf(0.975, 5)),
        (((3.0, STUDENT, 29.0),), 0.9, 3 * scipy.stats.t.ppf(0.95, 29)),
        (((3.0, STUDENT, 30.0),), 0.95, 3 * scipy.stats.t.ppf(0.975, 30)),
        (((3.0, STUDENT, math.inf),), 0.95, 3 * 1.9599640),
    ],
)
def test_a_half_width_is_that_of_the_distribution_of_the_sum(parts, coverage, expected) -> None:
    assert half_width(parts, coverage) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("other", [(1.5, RECTANGULAR, math.inf), (1.5, STUDENT, 4.0), (0.3, STUDENT, 60.0)])
@pytest.mark.parametrize("coverage", [0.9, 0.95])
def test_a_normal_error_beside_another_one_is_their_convolution(other, coverage) -> None:
    """P(|x + y| < w), integrated over the other one's values."""
    size, kind, freedom = other
    law = scipy.stats.uniform(-math.sqrt(3) * size, 2 * math.sqrt(3) * size)
    law = scipy.stats.t(freedom, scale=size) if kind is STUDENT else law
    y = law.ppf((np.arange(20_000) + 0.5) / 20_000)

    def inside(width):
        return float((scipy.special.ndtr((width - y) / 0.8) - scipy.special.ndtr((-width - y) / 0.8)).mean())

    expected = scipy.optimize.brentq(lambda width: inside(width) - coverage, 0.5, 20.0)
    assert half_width(((0.8, NORMAL, math.inf), other), coverage) == pytest.approx(expected, rel=3e-4)


def test_a_distribution_of_heavy_tails_is_cut_where_less_than_a_thousandth_is_left() -> None:
    """Of two degrees of freedom; cut tails make it narrower by as little."""
    assert half_width(((1.0, STUDENT, 2.0),), 0.95) == pytest.approx(scipy.stats.t.ppf(0.975, 2), rel=0.015)
    assert half_width(((1.0, STUDENT, 2.0),), 0.95) < scipy.stats.t.ppf(0.975, 2)


def test_terms_add_in_squares_apart_by_what_they_share() -> None:
    terms = (TERM, replace(TERM, ra_arcsec=4.0, de_arcsec=0.0), replace(TERM, ra_arcsec=12.0, common=False))
    found = combined(terms, D_RA_COSDE)
    assert (found.common_arcsec, found.varying_arcsec, found.standard_arcsec) == pytest.approx((5.0, 12.0, 13.0))
    assert found.expanded_arcsec == pytest.approx(13 * 1.9599640)
    assert found.k == pytest.approx(1.9599640)
    assert found.one_sided_arcsec == pytest.approx(13 * 1.6448536)
    assert found.known
    assert combined(terms, D_DE).standard_arcsec == pytest.approx(math.hypot(4.0, 4.0))
    assert combined(terms, D_ROLL).varying_arcsec == 5.0


def test_one_large_rectangle_is_expanded_by_less_than_a_normal_error() -> None:
    found = combined((replace(TERM, distribution=RECTANGULAR), replace(TERM, ra_arcsec=0.01)), D_RA_COSDE)
    assert found.k == pytest.approx(0.95 * math.sqrt(3), rel=1e-3)
    assert found.one_sided_arcsec == pytest.approx(0.9 * math.sqrt(3) * 3.0, rel=1e-3)
    few = combined((replace(TERM, distribution=STUDENT, degrees_of_freedom=4.0),), D_DE)
    assert few.expanded_arcsec == pytest.approx(4 * scipy.stats.t.ppf(0.975, 4), rel=1e-3)


def test_a_term_that_is_unknown_leaves_all_open() -> None:
    found = combined((TERM, replace(TERM, ra_arcsec=math.inf, common=False)), D_RA_COSDE)
    assert (found.standard_arcsec, found.expanded_arcsec, found.one_sided_arcsec) == (math.inf, math.inf, math.inf)
    assert (found.common_arcsec, found.varying_arcsec) == (3.0, math.inf)
    assert math.isnan(found.k)
    assert not found.known


def test_without_terms_nothing_is_open() -> None:
    for terms in ((), (replace(TERM, de_arcsec=0.0),)):
        found = combined(terms, D_DE)
        assert (found.standard_arcsec, found.expanded_arcsec, found.one_sided_arcsec) == (0.0, 0.0, 0.0)
        assert math.isnan(found.k)
        assert found.known


def test_a_term_is_a_normal_error_of_all_frames_that_is_corrected_unless_it_says_otherwise() -> None:
    assert (TERM.distribution, TERM.degrees_of_freedom) == (NORMAL, math.inf)
    assert (TERM.corrected, TERM.common, TERM.absorbed) == (True, True, False)
    assert math.isnan(TERM.size_arcsec)
    assert [TERM.of(axis) for axis in AXES] == [3.0, 4.0, 5.0]
    assert np.isfinite(TERM.standard)


def test_a_small_term_counts_and_half_an_interval_of_95_percent_is_two_standard_uncertainties() -> None:
    found = combined((replace(TERM, ra_arcsec=0.3), replace(TERM, ra_arcsec=0.4)), D_RA_COSDE)
    assert found.standard_arcsec == pytest.approx(0.5)
    assert pytest.approx(scipy.stats.norm.ppf(0.975), rel=1e-7) == 1 / TO_STANDARD


def test_of_student_two_a_grid_of_eighty_standard_uncertainties_to_either_side_is_kept() -> None:
    """What lies beyond is left out of the whole: a hundred and fifty-six millionths."""
    kept = 1 - 2 * scipy.stats.t.sf(80.0, 2)
    expected = scipy.stats.t.ppf((1 + 0.95 * kept) / 2, 2)
    assert half_width(((1.0, STUDENT, 2.0),), 0.95) == pytest.approx(expected, rel=2e-4)


@pytest.mark.parametrize("size", [0.01, 1.0, 300.0])
@pytest.mark.parametrize(
    ("kind", "freedom", "quantile"),
    [
        (RECTANGULAR, math.inf, 0.95 * math.sqrt(3)),
        (STUDENT, 29.0, scipy.stats.t.ppf(0.975, 29)),
        (STUDENT, 30.0, scipy.stats.t.ppf(0.975, 30)),
        (STUDENT, 1e4, scipy.stats.t.ppf(0.975, 1e4)),
        (STUDENT, math.inf, scipy.stats.norm.ppf(0.975)),
    ],
)
def test_a_half_width_grows_with_its_standard_uncertainty(size, kind, freedom, quantile) -> None:
    assert half_width(((size, kind, freedom),), 0.95) == pytest.approx(size * quantile, rel=4e-5)


def test_a_large_and_a_small_rectangle_make_a_trapezium() -> None:
    """Half-widths of 5 and 1: flat to 4, then a slope; nine tenths lie within 4 and what the slope adds."""
    parts = ((5 / math.sqrt(3), RECTANGULAR, math.inf), (1 / math.sqrt(3), RECTANGULAR, math.inf))
    # Beyond w between 4 and 6 lie (6 - w)^2 / 20 on both sides together.
    assert half_width(parts, 0.95) == pytest.approx(6 - math.sqrt(20 * 0.05), rel=1e-5)
    assert half_width(parts, 0.9) == pytest.approx(6 - math.sqrt(20 * 0.1), rel=1e-5)
    assert half_width(parts, 0.5) == pytest.approx(2.5, rel=1e-5)
