"""The truth uncertainty budget: numbers by hand, by draws, and against the truth of changed inputs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, TABLE, session

from gse.station.results import attitude_error
from gse.statistics.truth_budget import SessionFacts, TruthUncertaintyBudget, session_facts, truth_budget
from gse.statistics.uncertainty import Distribution, Term, combined, half_width
from gse.truth import Alignment, EarthOrientation, SiderealTruth
from gse.values.axis import AXES, D_DE, D_RA_COSDE, D_ROLL
from gse.values.constants import EARTH_RATE_ARCSEC_PER_S
from gse.values.instant import from_text
from gse.values.mount import Mount, MountUncertainty
from gse.values.site import Site, SiteUncertainty

NORMAL, RECTANGULAR, STUDENT = Distribution.NORMAL, Distribution.RECTANGULAR, Distribution.STUDENT
LEANING = Mount(azimuth_deg=40, altitude_deg=45, roll_deg=10)
FACTS = SessionFacts(STATION.site, LEANING, TABLE, START_NS, 0.01)


def terms(facts):
    return {term.name: term for term in truth_budget(facts).terms}


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([(2.0, NORMAL, math.inf)], 3.92),
        ([(1.0, RECTANGULAR, math.inf)], 0.95 * math.sqrt(3)),
        # JCGM 101, 9.2.3: four rectangular terms of unit standard uncertainty, 95 % within 3.88
        ([(1.0, RECTANGULAR, math.inf)] * 4, 3.88),
        # JCGM 101, 9.2.4: three of 1 and one of 10, 95 % within 17.0
        ([(1.0, RECTANGULAR, math.inf)] * 3 + [(10.0, RECTANGULAR, math.inf)], 17.0),
        ([(1.0, STUDENT, 5.0)], 2.571),
        ([(1.0, STUDENT, 5.0), (1e-6, NORMAL, math.inf)], 2.571),
    ],
)
def test_the_expanded_uncertainty_is_that_of_the_distribution_of_the_sum(parts, expected):
    assert half_width(tuple(parts), 0.95) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(
    ("terms_of_one", "coverage", "expected"),
    [
        (1, 0.95, 0.95 * math.sqrt(3)),
        (1, 0.90, 0.90 * math.sqrt(3)),
        (2, 0.95, 2 * math.sqrt(3) * (1 - math.sqrt(0.05))),  # a triangle
        (2, 0.90, 2 * math.sqrt(3) * (1 - math.sqrt(0.10))),
    ],
)
def test_rectangular_terms_are_expanded_without_an_error_of_the_grid(terms_of_one, coverage, expected):
    """By geometry, to a hundred-thousandth: no cell of the grid is lost at its end."""
    assert half_width(((1.0, RECTANGULAR, math.inf),) * terms_of_one, coverage) == pytest.approx(expected, rel=1e-5)


def test_standard_uncertainties_combine_as_squares_and_each_term_has_its_evidence():
    budget = truth_budget(FACTS)
    for axis in AXES:
        found = budget.axes[axis.key]
        assert found.standard_arcsec == pytest.approx(math.sqrt(sum(term.of(axis) ** 2 for term in budget.terms)))
        assert found.standard_arcsec == pytest.approx(math.hypot(found.common_arcsec, found.varying_arcsec))
        assert found.one_sided_arcsec < found.expanded_arcsec == pytest.approx(found.k * found.standard_arcsec)
    assert all(term.evidence[0] in "AB" and term.explanation and term.remedy for term in budget.terms)


def test_a_hundredth_of_a_degree_of_the_site_is_35_arcsec():
    there = SiteUncertainty(position_m=1112.0)  # 0.01 deg
    site = Site(latitude_deg=0.0, longitude_deg=0.0, uncertainty=there)
    term = terms(replace(FACTS, site=site, mount=Mount()))["site position"]
    assert 1.959964 * term.de_arcsec == pytest.approx(36.0, abs=0.3)
    assert 1.959964 * term.ra_arcsec == pytest.approx(36.0, abs=0.3)


@pytest.mark.parametrize("latitude_deg", [90.0, -90.0])
def test_at_a_pole_ten_metres_are_seconds_of_arc_and_no_turn_of_the_sky(latitude_deg):
    site = Site(latitude_deg=latitude_deg, longitude_deg=0.0)
    term = terms(replace(FACTS, site=site))["site position"]
    assert 0.1 < math.hypot(term.ra_arcsec, term.de_arcsec) < 60.0


def test_a_first_byte_is_read_a_millisecond_and_half_of_its_ten_bits_late():
    late = terms(replace(FACTS, baudrate=9600))["time stamp"]
    assert late.standard == pytest.approx((0.001 + 5 / 9600) / math.sqrt(3))
    assert late.ra_arcsec < EARTH_RATE_ARCSEC_PER_S * late.standard


def test_a_clock_within_a_bound_is_off_by_the_bound_over_root_three():
    clock = terms(replace(FACTS, clock_error_s=2.0))["clock"]
    assert clock.standard == pytest.approx(2 / math.sqrt(3))
    turned = EARTH_RATE_ARCSEC_PER_S * clock.standard
    assert math.hypot(clock.ra_arcsec, clock.roll_arcsec) == pytest.approx(turned)  # by cosine and sine of DE
    assert clock.de_arcsec == 0.0


def test_what_no_model_takes_out_is_told_from_what_is_corrected():
    still = terms(replace(FACTS, duration_s=60.0))
    assert {name for name, term in still.items() if not term.corrected} == {
        *("mount azimuth", "mount altitude", "mount roll", "clock"),
        *("deflection of the vertical", "parallax", "blends", "proper motion"),
    }


@pytest.mark.parametrize(("seconds", "freedom"), [(60, 599), (139, 599), (140, 7), (200, 10)])
def test_a_fit_has_the_freedom_of_its_blocks_of_20_s_or_of_the_frames_of_few(seconds, freedom):
    covariance = ((4.0, 0.0, 0.0), (0.0, 4.0, 0.0), (0.0, 0.0, 400.0))
    fit = Alignment(LEANING, covariance, (5.0, 5.0, 50.0), 600, 0, START_NS, START_NS + seconds * 10**9)
    fitted = terms(replace(FACTS, alignment=fit))["fitted mount"]
    assert fitted.degrees_of_freedom == freedom
    assert fitted.distribution is STUDENT


def test_a_session_is_judged_at_its_middle_over_its_whole_length():
    made = session(61, step_s=2.0)
    facts = session_facts(made, clock_error_s=0.5)
    assert facts.utc_ns == START_NS + 60 * 10**9
    assert facts.duration_s == 120.0
    assert (facts.clock_error_s, facts.baudrate) == (0.5, made.station.port.baudrate)
    assert session_facts(session(0), clock_error_s=0.5).earth_orientation is None


def test_a_stated_mount_leaves_its_level_and_at_the_zenith_nothing_by_its_azimuth():
    stated = MountUncertainty(azimuth_arcsec=30.0, altitude_arcsec=20.0, roll_arcsec=60.0)
    found = terms(replace(FACTS, mount=Mount(uncertainty=stated)))
    level = found["mount altitude"]
    assert (level.ra_arcsec, level.de_arcsec) == pytest.approx((10.204, 10.204), abs=0.01)
    assert math.hypot(found["mount azimuth"].ra_arcsec, found["mount azimuth"].de_arcsec) < 1e-6
    assert found["mount roll"].roll_arcsec == pytest.approx(30.61, abs=0.01)


def test_pressure_that_follows_from_the_height_is_known_to_20_hpa_instead_of_3():
    high = replace(STATION.site, height_m=2700.0, pressure_hpa=None)
    assert high.air_pressure_hpa == pytest.approx(728.0, abs=1.0)  # ISO 2533, table: 728.0 at 2700 m
    entered = replace(high, pressure_hpa=728.0)
    known, unknown = (terms(replace(FACTS, site=site))["refraction: pressure"] for site in (entered, high))
    assert unknown.de_arcsec == pytest.approx(known.de_arcsec * 20 / 3, rel=0.01)
    assert known.evidence.startswith("B: as entered")
    assert unknown.evidence.startswith("B: not entered: the standard atmosphere's")
    shift = math.hypot(known.ra_arcsec, known.de_arcsec)
    assert shift == pytest.approx(57.0 * 1.53 / 1013, rel=0.1)  # refraction at 45 deg goes with the pressure
    assert "site height" in terms(FACTS)
    assert terms(FACTS)["site height"].de_arcsec < 1e-6 < terms(replace(FACTS, site=high))["site height"].de_arcsec


def test_an_unknown_clock_leaves_ra_and_roll_open_but_not_de():
    axes = truth_budget(replace(FACTS, clock_error_s=math.inf)).axes
    assert [axes[axis].known for axis in ("d_ra_cosde", "d_de", "d_roll")] == [False, True, False]
    assert axes["d_ra_cosde"].expanded_arcsec == math.inf


def test_a_clock_bound_dominates_with_the_k_of_a_rectangle():
    found = truth_budget(replace(FACTS, clock_error_s=20.0)).axes["d_ra_cosde"]
    assert found.k == pytest.approx(1.65, abs=0.01)


def test_a_fitted_mount_takes_up_what_is_constant_in_the_horizon_frame():
    covariance = ((4.0, 0.0, 0.0), (0.0, 4.0, 0.0), (0.0, 0.0, 400.0))
    fit = Alignment(LEANING, covariance, (5.0, 5.0, 50.0), 600, 0, START_NS, START_NS + 60_000_000_000)
    budget = truth_budget(replace(FACTS, alignment=fit))
    absorbed = {term.name for term in budget.terms if term.absorbed}
    assert {"site position", "deflection of the vertical", "UT1", "time stamp", "refraction: pressure"} <= absorbed
    found = {term.name: term for term in budget.terms}
    assert (found["fitted mount"].ra_arcsec, found["fitted mount"].roll_arcsec) == pytest.approx((2.0, 20.0), abs=0.01)
    assert "clock" not in absorbed
    assert "mount azimuth" not in found


def test_predictions_that_end_and_leap_seconds_that_are_not_announced_are_terms():
    last_ns = from_text("2031-01-01T00:00:00Z")
    table = EarthOrientation.from_disk(last_ns)
    found = terms(replace(FACTS, earth_orientation=table, utc_ns=last_ns))
    now = table.at(last_ns)
    cos_de = found["UT1"].ra_arcsec / (EARTH_RATE_ARCSEC_PER_S * now.ut1_error_s / math.sqrt(3))
    assert 0.5 < cos_de <= 1.0
    assert found["UT1"].distribution is RECTANGULAR
    assert now.ut1_error_s + now.leap_error_s == pytest.approx(0.9 + abs(now.ut1_minus_utc_s), abs=1e-6)
    soon_ns = from_text("2027-07-02T00:00:00Z")
    soon = terms(replace(FACTS, earth_orientation=EarthOrientation.from_disk(soon_ns), utc_ns=soon_ns))
    assert soon["leap seconds"].standard == pytest.approx(1 / math.sqrt(3), abs=0.1)
    assert "leap seconds" not in terms(FACTS)


def test_the_budget_holds_the_error_of_sites_and_mounts_that_are_drawn():
    random = np.random.default_rng(5)
    quiet = SiteUncertainty(position_m=400.0, vertical_arcsec=0.0)
    mount = replace(LEANING, uncertainty=MountUncertainty(azimuth_arcsec=20, altitude_arcsec=0.0, roll_arcsec=0))
    facts = replace(FACTS, site=replace(STATION.site, uncertainty=quiet), mount=mount, clock_error_s=0.5)
    axes = truth_budget(facts).axes
    inside = []
    for _ in range(300):
        north, east = np.degrees(random.normal(0, 400 / 1.96, 2) / 6_371_000)
        site = replace(facts.site, latitude_deg=facts.site.latitude_deg + north, longitude_deg=106.7 + east)
        turned = replace(mount, azimuth_deg=mount.azimuth_deg + random.normal(0, 20 / 1.96) / 3600)
        late_ns = round(random.uniform(-0.5, 0.5) * 1e9)
        true = SiderealTruth(site, TABLE).attitude_true(START_NS + late_ns, turned)
        error = attitude_error(true, SiderealTruth(facts.site, TABLE).attitude_true(START_NS, mount))
        inside.append(abs(error.d_ra_cosde_arcsec) <= axes["d_ra_cosde"].expanded_arcsec)
    assert 0.91 <= np.mean(inside) <= 0.985


# What is said of it


def part(name, arcsec, remedy="", *, de_arcsec=None):
    return Term(name, arcsec, "arcsec", arcsec, arcsec if de_arcsec is None else de_arcsec, 0.0, "B", "", remedy)


def budget_of(*parts, own=0.0):
    """Of normal errors; the sensor's own answers have a term more."""
    own_part = part("own choice of stars", own, "point the sensor higher")
    axes, own_axes = ({axis.key: combined(some, axis) for axis in AXES} for some in (parts, (*parts, own_part)))
    return TruthUncertaintyBudget((*parts, own_part), axes, own_axes)


@pytest.mark.parametrize(
    ("parts", "whole"),
    [
        (
            [part("clock", 10.0, "set it")],
            "19.6 arcsec only, because of clock (19.6 arcsec); a third of the limit is 2 arcsec; set it",
        ),
        ([part("clock", 10.0)], "19.6 arcsec only, because of clock (19.6 arcsec); a third of the limit is 2 arcsec"),
        # 3 and 4 make 5: both are more than half of it, and the greater comes first, with its remedy.
        (
            [part("clock", 3.0, "set it"), part("mount", 4.0, "fit it")],
            "9.8 arcsec only, because of mount (7.8 arcsec) and clock (5.9 arcsec); a third of the limit is 2 arcsec; "
            "fit it",
        ),
        # 4 of 9.85 is less than half, though more than a third.
        (
            [part("clock", 9.0, "set it"), part("mount", 4.0, "fit it")],
            "19.3 arcsec only, because of clock (17.6 arcsec); a third of the limit is 2 arcsec; set it",
        ),
        # Of five that are equal none is half of the root of their squares, of four each is.
        (
            [part(name, 1.0, "do it") for name in "abcde"],
            "4.4 arcsec only, because of all terms together; a third of the limit is 2 arcsec",
        ),
    ],
)  # fmt: skip
def test_a_complaint_names_what_is_half_of_the_whole_or_more_the_greatest_first(parts, whole):
    said = budget_of(*parts).complaint(D_RA_COSDE, 6.0, 3.0)
    assert said == f"dRA*: truth is known to {whole}"


def test_a_term_of_unknown_size_is_the_reason_why_nothing_can_be_judged():
    said = budget_of(part("clock", math.inf, "set it"), part("mount", 9.0, "fit it")).complaint(D_RA_COSDE, 6.0, 3.0)
    assert said == "dRA*: it cannot be judged, because the error of the clock is not known; set it"


@pytest.mark.parametrize(("axis", "arcsec"), [(D_RA_COSDE, 2.0), (D_DE, 5.0)])
@pytest.mark.parametrize("share", [3.0, 4.0])
def test_a_complaint_is_made_beyond_the_share_of_a_limit_of_each_axis(axis, arcsec, share):
    budget = budget_of(part("clock", 2.0, de_arcsec=5.0))
    most = 1.959963984540054 * arcsec * share
    assert budget.complaint(axis, most * (1 + 1e-12), share) is None
    assert budget.complaint(axis, most * (1 - 1e-6), share) is not None
    assert budget.complaint(D_ROLL, 1e-9, share) is None
    assert (budget.ra_arcsec, budget.de_arcsec) == pytest.approx((1.96 * 2.0, 1.96 * 5.0), rel=1e-4)


def test_the_sensors_choice_of_stars_is_complained_of_with_its_own_answers_alone():
    budget = budget_of(part("clock", 3.0, "set it"), own=4.0)
    assert budget.complaint(D_DE, 6.0, 3.0) == (
        "dDE: truth is known to 5.9 arcsec only, because of clock (5.9 arcsec); a third of the limit is 2 arcsec; "
        "set it"
    )
    assert budget.complaint(D_DE, 6.0, 3.0, own=True) == (
        "the sensor's dDE: truth is known to 9.8 arcsec only, because of own choice of stars (7.8 arcsec) and clock "
        "(5.9 arcsec); a third of the limit is 2 arcsec; point the sensor higher"
    )
    assert budget.complaint(D_DE, 18.0, 3.0) is None
    assert budget.complaint(D_DE, 18.0, 3.0, own=True) is not None


def test_without_earth_orientation_one_unknown_term_leaves_all_open():
    budget = truth_budget(replace(FACTS, earth_orientation=None))
    (term,) = budget.terms
    assert (term.name, term.standard) == ("sidereal truth", math.inf)
    for axes in (budget.axes, budget.own_axes):
        assert [(axis.known, axis.expanded_arcsec) for axis in axes.values()] == [(False, math.inf)] * 3


def test_a_session_without_frames_has_no_instant_and_no_length_and_sends_no_answers():
    facts = session_facts(session(0), clock_error_s=0.5)
    assert (facts.utc_ns, facts.duration_s, facts.own_stars_arcsec) == (0, 0.0, 0.0)
    assert facts.site is STATION.site
    assert facts.mount is STATION.mount
    assert facts.alignment is None


def test_facts_that_are_not_given_are_those_of_a_usual_link_and_a_short_session():
    assert (FACTS.baudrate, FACTS.duration_s, FACTS.own_stars_arcsec) == (115_200, 0.0, 0.0)
    assert FACTS.alignment is None
    assert FACTS.stars.stars == 10.0
