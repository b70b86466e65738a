"""Each term of the budget of truth by hand: how far it turns the sky, by geometry and by ERFA's refraction."""

import math
from dataclasses import replace
from functools import cache

import erfa
import numpy as np
import pytest
from skies.known_nights import START_NS, STATION, TABLE

from gse.statistics.budget_terms import ChangedTruth, _other_humidity, fitted_mount
from gse.statistics.truth_budget import SessionFacts, truth_budget
from gse.statistics.uncertainty import Distribution
from gse.truth import Alignment, EarthOrientation
from gse.values.instant import from_text
from gse.values.mount import Mount
from gse.values.site import Site, SiteUncertainty
from protocols.description import TimeDescription

NORMAL, RECTANGULAR, STUDENT = Distribution.NORMAL, Distribution.RECTANGULAR, Distribution.STUDENT
LEANING = Mount(azimuth_deg=40.0, altitude_deg=45.0, roll_deg=10.0)
TEN = 10 / 1.959964
"""The standard uncertainty of 10 with 95 %."""
COVARIANCE = ((4.0, 3.0, 0.0), (3.0, 9.0, 0.0), (0.0, 0.0, 400.0))
FIT = Alignment(LEANING, COVARIANCE, (2.0, 3.0, 20.0), 600, 0, START_NS, START_NS + 60 * 10**9)
FACTS = SessionFacts(
    STATION.site,
    LEANING,
    TABLE,
    START_NS,
    0.01,
    duration_s=1800.0,
    own_stars_arcsec=0.2,
)


def terms(facts=FACTS):
    return {term.name: term for term in truth_budget(facts).terms}


@cache
def stated():
    return terms()


@cache
def fitted():
    return terms(replace(FACTS, alignment=FIT))


def turned(term):
    """The whole turn of the sky, about whatever axis."""
    return math.hypot(term.ra_arcsec, term.de_arcsec, term.roll_arcsec)


def across(term):
    return math.hypot(term.ra_arcsec, term.de_arcsec)


KINDS = {
    "precession": ("arcsec", NORMAL),
    "nutation": ("arcsec", NORMAL),
    "annual aberration": ("arcsec", NORMAL),
    "diurnal aberration": ("arcsec", NORMAL),
    "light deflection": ("arcsec", NORMAL),
    "UT1": ("s", NORMAL),
    "polar motion": ("arcsec", NORMAL),
    "site position": ("m", NORMAL),
    "site height": ("m", NORMAL),
    "deflection of the vertical": ("arcsec", NORMAL),
    "refraction: pressure": ("hPa", NORMAL),
    "refraction: temperature": ("K", NORMAL),
    "refraction: humidity": ("", NORMAL),
    "refraction: model": ("of it", RECTANGULAR),
    "time stamp": ("s", RECTANGULAR),
    "mount azimuth": ("arcsec", NORMAL),
    "mount altitude": ("arcsec", NORMAL),
    "mount roll": ("arcsec", NORMAL),
    "clock": ("s", RECTANGULAR),
    "proper motion": ("arcsec per star", NORMAL),
    "parallax": ("arcsec per star", NORMAL),
    "blends": ("arcsec per star", NORMAL),
    "own choice of stars": ("arcsec", NORMAL),
}


def test_the_terms_of_a_stated_mount_have_their_units_and_distributions():
    assert {name: (term.unit, term.distribution) for name, term in stated().items()} == KINDS
    assert not any(term.evidence.startswith("A") for term in stated().values())
    assert all(math.isinf(term.degrees_of_freedom) for term in stated().values())
    assert not any(term.absorbed for term in stated().values())


def test_a_fitted_mount_takes_the_place_of_its_three_angles_and_takes_up_what_stays():
    assert set(stated()) - set(fitted()) == {"mount azimuth", "mount altitude", "mount roll"}
    assert (fitted()["fitted mount"].unit, fitted()["fitted mount"].distribution) == ("arcsec", STUDENT)
    absorbed = {name for name, term in fitted().items() if term.absorbed}
    names = list(KINDS)
    assert absorbed == set(names[names.index("UT1") : names.index("time stamp") + 1])
    assert all(turned(fitted()[name]) == 0 for name in absorbed)


@pytest.mark.parametrize(
    ("name", "standard", "arcsec"),
    [
        ("precession", 0.0005, 0.0005 * math.sqrt(3)),
        ("light deflection", 0.0005, 0.0005 * math.sqrt(3)),
        # The pole may be off in x and in y: two turns.
        ("polar motion", 0.0005, 0.0005 * math.sqrt(2)),
        # 10 m to the north, and to the east about the pole, at 6.53 deg of latitude.
        ("site position", TEN, TEN / 6_371_000 * 206_265 * math.hypot(1, 1 / math.cos(math.radians(6.53)))),
        ("site height", 2 * TEN, 0.0),
        # Along and across.
        ("deflection of the vertical", TEN, TEN * math.sqrt(2)),
        ("mount altitude", TEN, TEN * math.sqrt(2)),
        ("mount azimuth", TEN, TEN),
        ("mount roll", TEN, TEN),
        ("clock", 0.01 / math.sqrt(3), 15.041067 * 0.01 / math.sqrt(3)),
        ("time stamp", (0.001 + 5 / 115_200) / math.sqrt(3), 15.041067 * (0.001 + 5 / 115_200) / math.sqrt(3)),
        ("parallax", 0.017, None),
        ("own choice of stars", 0.2, None),
    ],
)
def test_each_term_turns_the_sky_by_what_its_size_says(name, standard, arcsec):
    assert stated()[name].standard == pytest.approx(standard, rel=1e-5)
    assert arcsec is None or turned(stated()[name]) == pytest.approx(arcsec, rel=2e-3, abs=1e-6)


@pytest.mark.parametrize("name", ["mount azimuth", "mount altitude", "deflection of the vertical"])
def test_at_45_deg_of_altitude_a_level_moves_more_than_an_azimuth(name):
    """About the vertical by the cosine of the altitude; about two level axes by 1 and its sine."""
    expected = TEN * (math.sqrt(0.5) if name == "mount azimuth" else math.sqrt(1.5))
    assert across(stated()[name]) == pytest.approx(expected, rel=2e-3)


def test_a_mount_that_turns_about_its_boresight_moves_nothing_else():
    assert across(stated()["mount roll"]) == pytest.approx(0.0, abs=1e-6)


def bend_arcsec(pressure_hpa, temperature_c, humidity):
    """ERFA's at 45 deg and 0.6 um, where both tangents are 1."""
    return sum(erfa.refco(pressure_hpa, temperature_c, humidity, 0.6)) * 206_264.8


@pytest.mark.parametrize(
    ("name", "standard", "changed"),
    [
        ("pressure", 0.3 * TEN, (985.0 + 0.3 * TEN, 25.0, 0.8)),
        ("temperature", 0.3 * TEN, (985.0, 25.0 + 0.3 * TEN, 0.8)),
        ("humidity", 0.02 * TEN, (985.0, 25.0, 0.8 + 0.02 * TEN)),
    ],
)
def test_air_bends_by_as_much_as_erfa_says(name, standard, changed):
    term = stated()[f"refraction: {name}"]
    assert term.standard == pytest.approx(standard, rel=1e-5)
    assert across(term) == pytest.approx(abs(bend_arcsec(*changed) - bend_arcsec(985.0, 25.0, 0.8)), rel=1e-3)
    assert term.evidence.startswith("B: as entered; known to the default, ")


def test_the_colour_of_stars_is_half_a_percent_of_the_refraction():
    term, whole = stated()["refraction: model"], bend_arcsec(985.0, 25.0, 0.8)
    assert term.size_arcsec == pytest.approx(whole, rel=1e-3)
    assert across(term) == pytest.approx(0.005 / math.sqrt(3) * whole, rel=1e-4)


def test_air_that_is_not_entered_is_told_as_the_standard_atmospheres():
    bare = replace(STATION.site, pressure_hpa=None, temperature_c=None)
    found = terms(replace(FACTS, site=bare))
    for name in ("pressure", "temperature"):
        assert "not entered: the standard atmosphere's" in found[f"refraction: {name}"].evidence
    assert found["refraction: pressure"].standard == pytest.approx(2 * TEN, rel=1e-5)
    assert found["refraction: temperature"].standard == pytest.approx(1.5 * TEN, rel=1e-5)


def test_saturated_air_is_only_drier():
    wet = terms(replace(FACTS, site=replace(STATION.site, relative_humidity=0.95)))["refraction: humidity"]
    drier = bend_arcsec(985.0, 25.0, 0.95 - 0.02 * TEN) - bend_arcsec(985.0, 25.0, 0.95)
    assert across(wet) == pytest.approx(abs(drier), rel=0.01)


def test_where_there_is_no_air_it_bends_nothing():
    assert not any("refraction" in name for name in terms(replace(FACTS, site=replace(STATION.site, pressure_hpa=0.0))))


def standard_hpa(height_m):
    """The standard atmosphere of ISO 2533: 288.15 K at sea level, 6.5 K less in each kilometre."""
    return 1013.25 * (1 - 0.0065 * height_m / 288.15) ** 5.25588


@pytest.mark.parametrize(("height_m", "step_m"), [(20.0, 2 * TEN), (1000.0, 100.0)])
def test_a_height_tells_by_the_pressure_that_follows_from_it_alone(height_m, step_m):
    """20 m are 2.4 hPa; more than 100 m are scaled."""
    known = SiteUncertainty(height_m=height_m)
    low = Site(latitude_deg=48.0, longitude_deg=11.0, height_m=0.0, temperature_c=15.0, uncertainty=known)
    term = terms(replace(FACTS, site=low))["site height"]
    lower = bend_arcsec(standard_hpa(0.0), 15.0, 0.5) - bend_arcsec(standard_hpa(step_m), 15.0, 0.5)
    assert across(term) == pytest.approx(lower * height_m / 1.959964 / step_m, rel=2e-4)


def test_a_site_that_is_known_to_kilometres_turns_the_sky_in_proportion():
    """The step of the difference is an arcminute at most; what follows is scaled."""
    vague = replace(STATION.site, uncertainty=SiteUncertainty(position_m=100_000.0, vertical_arcsec=3000.0))
    found = terms(replace(FACTS, site=vague))
    assert turned(found["site position"]) == pytest.approx(10_000 * turned(stated()["site position"]), rel=2e-3)
    assert turned(found["deflection of the vertical"]) == pytest.approx(300 * TEN * math.sqrt(2), rel=2e-3)
    vaguer = replace(STATION.site, uncertainty=SiteUncertainty(position_m=1e6))
    assert turned(terms(replace(FACTS, site=vaguer))["site position"]) == pytest.approx(
        10 * turned(found["site position"]), rel=1e-9
    )


def test_corrections_are_told_with_their_size():
    sizes = {name: stated()[name].size_arcsec for name in ("precession", "annual aberration", "UT1", "polar motion")}
    now = TABLE.at(START_NS)
    assert 15 < sizes["annual aberration"] < 20.6
    assert 500 < sizes["precession"] < 1320  # 26.2 years
    assert sizes["UT1"] == pytest.approx(15.041 * now.ut1_minus_utc_s * math.cos(math.radians(27.33)), rel=0.01)
    assert sizes["polar motion"] < math.hypot(now.x_pole_rad, now.y_pole_rad) * 206_265
    assert stated()["site position"].size_arcsec == pytest.approx(690 * math.sin(2 * math.radians(6.53)), rel=0.15)
    assert math.isnan(stated()["clock"].size_arcsec)


def test_what_the_tables_do_not_know_is_within_bounds_past_their_end():
    late_ns = from_text("2031-01-01T00:00:00Z")
    table = EarthOrientation.from_disk(late_ns)
    found, now = terms(replace(FACTS, earth_orientation=table, utc_ns=late_ns)), table.at(late_ns)
    assert found["UT1"].standard == pytest.approx(now.ut1_error_s / math.sqrt(3))
    assert found["polar motion"].standard == pytest.approx(now.pole_error_arcsec / math.sqrt(3))
    assert turned(found["polar motion"]) == pytest.approx(found["polar motion"].standard * math.sqrt(2), rel=2e-3)
    assert (found["UT1"].distribution, found["polar motion"].distribution) == (RECTANGULAR, RECTANGULAR)
    assert turned(found["UT1"]) == pytest.approx(15.041067 * found["UT1"].standard, rel=1e-4)
    leap = found.get("leap seconds")
    assert leap is None or turned(leap) == pytest.approx(15.041067 * leap.standard, rel=1e-4)


def test_the_errors_of_a_fit_hang_together_as_its_covariance_says():
    """Two angles across with a covariance: the same as its trace, about any axes."""
    term = fitted()["fitted mount"]
    assert across(term) == pytest.approx(math.sqrt(4.0 + 9.0), rel=1e-3)
    assert term.roll_arcsec == pytest.approx(20.0, rel=1e-3)
    assert term.standard == math.hypot(2.0, 3.0)
    assert term.ra_arcsec != pytest.approx(term.de_arcsec, rel=0.05)
    east = ChangedTruth(STATION.site, LEANING, TABLE, START_NS)
    of_x, of_y = (np.array(east.turned(np.array(turn)))[0] for turn in ([1.0, 0, 0], [0, 1.0, 0]))
    assert term.ra_arcsec == pytest.approx(math.sqrt(4 * of_x**2 + 9 * of_y**2 + 6 * of_x * of_y), rel=1e-3)


def test_a_fit_without_a_covariance_leaves_everything_open_and_one_that_rounds_below_zero_nothing():
    at = ChangedTruth(STATION.site, LEANING, TABLE, START_NS)
    unknown = replace(FIT, covariance_arcsec2=((math.nan,) * 3,) * 3, n=1)
    assert turned(fitted_mount(unknown, at)) == math.inf
    assert fitted_mount(replace(unknown, until_ns=START_NS), at).degrees_of_freedom == 1.0
    tiny = replace(FIT, covariance_arcsec2=((-1e-12, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert turned(fitted_mount(tiny, at)) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("seconds", "frames", "freedom"), [(139, 600, 599), (140, 600, 7), (400, 600, 20), (60, 2, 1), (60, 3, 2)]
)
def test_a_fit_has_the_freedom_of_its_means_over_twenty_seconds_or_of_the_frames_of_a_short_one(
    seconds, frames, freedom
):
    at = ChangedTruth(STATION.site, LEANING, TABLE, START_NS)
    fit = replace(FIT, n=frames, until_ns=START_NS + seconds * 10**9)
    assert fitted_mount(fit, at).degrees_of_freedom == freedom


def test_what_truth_does_not_correct_for_is_told_apart():
    """Of the sky all is corrected; where the mount was put, how the clock ran and what is left of stars is not."""
    open_terms = {"deflection of the vertical", "clock", "proper motion", "parallax", "blends"}
    angles = {"mount azimuth", "mount altitude", "mount roll"}
    assert {name for name, term in stated().items() if not term.corrected} == open_terms | angles
    assert {name for name, term in fitted().items() if not term.corrected} == open_terms


@pytest.mark.parametrize(("name", "turns"), [("azimuth", 1.0), ("altitude", math.sqrt(2)), ("roll", 1.0)])
def test_an_arcsecond_of_an_angle_of_the_mount_is_an_arcsecond_of_the_sky(name, turns):
    assert turned(stated()[f"mount {name}"]) == pytest.approx(TEN * turns, rel=2e-5)


@pytest.mark.parametrize(
    ("humidity", "by", "other"), [(0.5, 0.125, 0.625), (0.75, 0.25, 1.0), (0.875, 0.25, 0.625), (0.0, 0.25, 0.25)]
)
def test_air_is_as_much_wetter_unless_it_would_be_more_than_saturated(humidity, by, other):
    assert _other_humidity(replace(STATION.site, relative_humidity=humidity), by) == other


def test_at_the_zenith_the_air_bends_nothing_by_whatever_colour():
    model = terms(replace(FACTS, mount=Mount()))["refraction: model"]
    assert (model.ra_arcsec, model.de_arcsec, model.roll_arcsec, model.size_arcsec) == (0.0, 0.0, 0.0, 0.0)
    assert model.standard == pytest.approx(0.005 / math.sqrt(3))


def test_little_air_bends_little():
    thin = terms(replace(FACTS, site=replace(STATION.site, pressure_hpa=1.0)))
    assert thin["refraction: model"].size_arcsec == pytest.approx(bend_arcsec(1.0, 25.0, 0.8), rel=1e-3)


@pytest.mark.parametrize("latitude_deg", [90.0, -90.0, 89.9])
def test_near_a_pole_east_is_a_hundredfold_turn_of_azimuth_at_most(latitude_deg):
    """Ten metres turn a level by 0.165 arcsec, and 64 km from the pole a meridian by a hundred times as much."""
    polar = terms(replace(FACTS, site=replace(STATION.site, latitude_deg=latitude_deg)))["site position"]
    angle = TEN / 6_371_000 * 206_265
    assert turned(polar) == pytest.approx(angle * math.hypot(1, 100), rel=2e-3)


def test_each_model_leaves_half_a_milliarcsecond_on_each_axis():
    for name in ("precession", "nutation", "annual aberration", "diurnal aberration", "light deflection"):
        term = stated()[name]
        assert (term.standard, term.ra_arcsec, term.de_arcsec, term.roll_arcsec) == (0.0005,) * 4
        assert 0 < term.size_arcsec < 1400


def test_a_leap_second_that_is_not_announced_may_be_one():
    """Where the list of leap seconds ends before the session, and UT1 is measured all the same."""
    ended = replace(TABLE, leap_seconds=replace(TABLE.leap_seconds, known_until_mjd=60_000))
    term = terms(replace(FACTS, earth_orientation=ended))["leap seconds"]
    leap_s = ended.at(START_NS).leap_error_s
    assert 0.9 < leap_s <= 1.0
    assert term.standard == pytest.approx(leap_s / math.sqrt(3))
    assert (term.unit, term.distribution, term.corrected) == ("s", RECTANGULAR, True)
    assert turned(term) == pytest.approx(15.041067 * leap_s / math.sqrt(3), rel=1e-4)
    assert "leap seconds" not in stated()


def test_a_level_is_told_along_and_across():
    told = {angle: stated()[f"mount {angle}"].explanation for angle in ("azimuth", "altitude", "roll")}
    assert told == {
        "azimuth": "as surveyed", "altitude": "the level of the mount, along and across", "roll": "as surveyed"
    }  # fmt: skip


def test_the_delay_of_a_sensor_has_a_term_unless_none_is_possible() -> None:
    def standard_s(name: str, **time: object) -> float | None:
        budget = truth_budget(replace(FACTS, time=TimeDescription(**time)))
        return next((term.standard for term in budget.terms if term.name == name), None)

    assert standard_s("sensor delay") == pytest.approx(0.2 / math.sqrt(3))
    assert standard_s("sensor delay", delay_ms={"most": 50}) == pytest.approx(0.05 / math.sqrt(3))
    assert standard_s("sensor delay", delay_ms={"value": 85, "uncertainty": 10}) == pytest.approx(0.005, rel=0.03)
    assert standard_s("sensor delay", delay_ms={"value": 0, "uncertainty": 0}) is None
    assert standard_s("sensor clock", scale="gps", uncertainty_ms=0.1) == pytest.approx(5e-5, rel=0.03)
    assert standard_s("clock", scale="gps") is standard_s("time stamp", scale="gps") is None
    assert standard_s("poll", scale="host") is None


def test_passing_bytes_on_is_a_term_of_its_own_in_a_session_that_does():
    assert "passing on" not in stated()
    passing = terms(replace(FACTS, passing_s=0.004))["passing on"]
    # 4 ms, rectangular; the sky turns by 15.04 arcsec in a second.
    turn_arcsec = math.hypot(passing.ra_arcsec, passing.roll_arcsec)
    assert turn_arcsec == pytest.approx(0.004 / math.sqrt(3) * 15.041, rel=1e-4)
