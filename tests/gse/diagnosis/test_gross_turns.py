"""A turn that no single mistake explains: told about its axis, by hand."""

import math
import re
from dataclasses import replace

import pytest
from skies.astropy_attitudes import MOUNT, MUNICH, TABLE, attitudes

from gse.diagnosis.gross_causes import (
    CORRECT,
    SET_CLOCK,
    GrossHypothesis,
    _about_the_pole,
    _duration,
    _elsewhere,
    _moved,
    _of_latitude,
    angle_text,
    gross_cause,
    wrong_dates,
)
from gse.values.mount import Mount
from gse.values.site import Site

STATED = GrossHypothesis("", "", "", MUNICH, MOUNT)
SIDEREAL_DAY_S = 86_164.0905


def told(stated, *, site=MUNICH, clock_s=0.0, **true):
    """The cause where the mount is another than stated."""
    return gross_cause(attitudes(site, replace(stated, **true), clock_s), MUNICH, stated, TABLE).finding


@pytest.mark.parametrize(
    ("true", "size"),
    [
        ({"azimuth_deg": 140.0}, "its azimuth is off by +10.000 deg: the stars fit mount.azimuth_deg: 140.000"),
        ({"azimuth_deg": 350.0}, "its azimuth is off by -140.000 deg: the stars fit mount.azimuth_deg: 350.000"),
        ({"altitude_deg": 50.0}, "its altitude is off by -10.000 deg: the stars fit mount.altitude_deg: 50.000"),
        ({"roll_deg": 20.0}, "its roll is off by -5.000 deg: the stars fit mount.roll_deg: 20.000"),
    ],
)
def test_a_turn_about_one_axis_is_told_as_that_angle(true, size):
    found = told(MOUNT, **true)
    assert (found.cause, found.size, found.equals, found.is_gross) == ("mount", size, (), True)


def test_another_latitude_is_told_as_the_one_that_fits():
    found = told(MOUNT, site=replace(MUNICH, latitude_deg=53.2))
    assert (found.cause, found.equals, found.is_gross) == ("latitude", (), True)
    assert found.size == "the stars fit site.latitude_deg: 53.200, stated is 48.2"


@pytest.mark.parametrize("east_deg", [1.0, -1.0, 0.4, -7.3])
def test_another_longitude_is_a_clock_that_is_as_fast_and_no_date(east_deg):
    """A day turns the sky by 0.9856 deg: of one degree it leaves 52 arcsec, and a longitude nothing."""
    found = told(MOUNT, site=replace(MUNICH, longitude_deg=11.6 + east_deg))
    assert found.cause == "clock offset"
    assert f"longitude (the stars fit site.longitude_deg: {11.6 + east_deg:.4f})" in found.equals


@pytest.mark.parametrize(("aside_arcsec", "is_one"), [(15.0, True), (60.0, False)])
def test_an_angle_is_named_where_what_it_leaves_is_within_its_noise(aside_arcsec, is_one):
    """The stated mount is good to 10 arcsec, of 95 %, along each of its angles."""
    found = told(MOUNT, azimuth_deg=130.4, altitude_deg=60.0 + aside_arcsec / 3600)
    assert found.size.startswith("its azimuth is off by +0.400 deg") == is_one
    assert ("no single mistake explains it" in found.size) == (not is_one)


def test_axes_that_are_one_are_equals_of_each_other():
    """At the zenith the vertical is the boresight."""
    found = told(Mount(azimuth_deg=130.0, altitude_deg=90.0, roll_deg=25.0), azimuth_deg=150.0)
    assert found.size.startswith("its azimuth is off by +20.000 deg")
    (equal,) = found.equals
    assert equal.startswith("mount (its roll is off by +20.000 deg: the stars fit mount.roll_deg: 45.000")


def test_two_mistakes_are_told_with_the_angles_that_fit_and_the_stated_ones():
    found = told(MOUNT, azimuth_deg=10.0, altitude_deg=50.0, roll_deg=77.0)
    assert found.size.endswith(
        "deg from where the station file says: the stars fit azimuth 10.00, altitude 50.00, roll 77.00 deg, stated are "
        "130, 60, 25 deg; no single mistake explains it"
    )
    assert (found.cause, found.is_gross) == ("mount", True)
    assert found.equals == ("two mistakes at once of site, clock and mount",)


@pytest.mark.parametrize(("latitude_deg", "longitude_deg"), [(46.9, 9.5), (61.0, -15.0)])
def test_another_place_is_told_to_an_arcminute_with_the_stated_one(latitude_deg, longitude_deg):
    found = told(MOUNT, site=replace(MUNICH, latitude_deg=latitude_deg, longitude_deg=longitude_deg))
    said = re.fullmatch(
        r"the stars fit site\.latitude_deg: ([-\d.]+) and longitude_deg: ([-\d.]+), stated are 48\.2 and 11\.6",
        found.size,
    )
    assert [float(one) for one in said.groups()] == pytest.approx([latitude_deg, longitude_deg], abs=0.005)
    assert (found.cause, found.equals, found.next_step, found.is_gross) == (
        "site", ("a mount whose base is not level",), CORRECT, True
    )  # fmt: skip


@pytest.mark.parametrize(
    ("longitude_deg", "east_deg", "found_deg"),
    [
        (11.6, 0.01, 11.61),
        (179.995, 0.01, -179.995),
        (-179.995, -0.01, 179.995),
        (200.0, 0.0, -160.0),
        (-20.0, 5.0, -15.0),
    ],
)
def test_a_place_that_is_moved_stays_within_half_a_turn_of_greenwich(longitude_deg, east_deg, found_deg):
    under = replace(STATED, site=Site(latitude_deg=10.0, longitude_deg=longitude_deg))
    moved = _moved(under, 0.5, east_deg)
    assert moved.site.longitude_deg == pytest.approx(found_deg)
    assert moved.site.latitude_deg == 10.5
    assert moved.mount is MOUNT


@pytest.mark.parametrize("clock_s", [5000.0, -5000.0])
def test_a_clock_is_told_to_a_tenth_of_a_second_though_air_is_first_taken_off_about_a_wrong_zenith(clock_s):
    fast = told(MOUNT, clock_s=clock_s)
    assert fast.size == _about_the_pole(clock_s, MUNICH).size


@pytest.mark.parametrize(
    ("fast_s", "size", "fits_deg"),
    [
        (59.994, "the host's clock is 59.99 s fast", 11.3493),
        (0.5, "the host's clock is 0.50 s fast", 11.5979),
        (-0.5, "the host's clock is 0.50 s slow", 11.6021),
        (0.0, "the host's clock is 0.00 s slow", 11.6),
        (-60.0, "the host's clock is 0 h 1 min 0 s slow", 11.8507),
        (-3661.4, "the host's clock is 1 h 1 min 1 s slow", 26.8976),
        (43200.0, "the host's clock is 12 h 0 min 0 s fast", -168.8928),
    ],
)
def test_a_fast_clock_is_told_with_the_longitude_that_fits(fast_s, size, fits_deg):
    """By hand: 360.9856 deg in a day of 86400 s."""
    found = _about_the_pole(fast_s, MUNICH)
    assert (found.cause, found.size, found.next_step, found.is_gross) == ("clock offset", size, SET_CLOCK, True)
    assert found.equals[0].startswith("longitude (the stars fit site.longitude_deg: ")
    assert float(re.search(r"-?\d+\.\d{4}", found.equals[0])[0]) == pytest.approx(fits_deg, abs=1e-4)
    assert found.equals[1] == "a mount turned about the pole"
    assert found.equals[2:] == tuple(wrong_dates(fast_s))


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0.00 s"), (59.99, "59.99 s"), (60.0, "0 h 1 min 0 s"), (61.4, "0 h 1 min 1 s"), (3599.0, "0 h 59 min 59 s"),
     (3600.0, "1 h 0 min 0 s"), (36_061.0, "10 h 1 min 1 s")],
)  # fmt: skip
def test_a_time_is_told_in_seconds_or_hours_and_minutes(seconds, text):
    assert _duration(seconds) == text


@pytest.mark.parametrize("fast_s", [471.819, -471.819, 700.0, 20_000.0, -43_000.0, 86_400 - SIDEREAL_DAY_S, 0.0])
def test_dates_that_turn_the_sky_as_a_clock_does_are_those_within_four_seconds_of_it(fast_s):
    """Two days turn it by 471.819 s; one day is a cause of its own."""
    by_hand = set()
    for days in range(2, 367):
        for off, side in ((days, "ahead"), (-days, "behind")):
            apart_s = (86_400 * off - fast_s) % SIDEREAL_DAY_S
            if min(apart_s, SIDEREAL_DAY_S - apart_s) < 4.0:
                by_hand.add(f"a date that is {days} days {side}")
    assert set(wrong_dates(fast_s)) == by_hand


@pytest.mark.parametrize(
    ("days", "late_s", "is_told"),
    [(2, 3.99, True), (2, -3.99, True), (2, 4.01, False), (2, -4.01, False), (183, 0, True), (184, 0, True),
     (366, 0, True), (1, 0, False), (367, 0, False)],
)  # fmt: skip
@pytest.mark.parametrize("side", ["ahead", "behind"])
def test_a_date_is_off_by_up_to_a_year(days, late_s, is_told, side):
    turned_s = (86_400 - SIDEREAL_DAY_S) * days * (1 if side == "ahead" else -1)
    assert (f"a date that is {days} days {side}" in list(wrong_dates(turned_s + late_s))) == is_told


def test_a_latitude_is_told_with_the_stated_one():
    found = _of_latitude(replace(MUNICH, latitude_deg=-6.5), -8.75)
    assert (found.cause, found.size) == ("latitude", "the stars fit site.latitude_deg: -8.750, stated is -6.5")
    assert (found.equals, found.next_step, found.is_gross) == ((), CORRECT, True)


@pytest.mark.parametrize(
    ("angle_deg", "text"),
    [(12.345, "12.35 deg"), (0.1, "0.10 deg"), (0.09985, "359 arcsec"), (0.09988, "360 arcsec"), (0.05, "180 arcsec")],
)
def test_an_angle_below_a_tenth_of_a_degree_is_told_in_arcseconds(angle_deg, text):
    assert angle_text(angle_deg) == text


@pytest.mark.parametrize(
    ("stated_deg", "true_deg"),
    [((48.2, 11.6), (46.9, 9.5)), ((48.2, 11.6), (50.0, -3.0)), ((89.0, 11.6), (89.5, 11.6))],
)
def test_another_place_is_found_by_what_all_three_angles_say(stated_deg, true_deg):
    stated, true = (replace(MUNICH, latitude_deg=one[0], longitude_deg=one[1]) for one in (stated_deg, true_deg))
    found = _elsewhere(attitudes(true, MOUNT), replace(STATED, site=stated), TABLE)
    assert (found.cause, found.next_step) == ("site", CORRECT)
    assert found.site.latitude_deg == pytest.approx(true_deg[0], abs=0.003)
    assert found.site.longitude_deg == pytest.approx(true_deg[1], abs=0.003 / math.cos(math.radians(true_deg[0])))


def test_no_place_is_looked_for_at_the_very_pole():
    """North of 89.9 deg a longitude says next to nothing."""
    stated, true = (replace(MUNICH, latitude_deg=latitude) for latitude in (89.0, 89.95))
    assert _elsewhere(attitudes(true, MOUNT), replace(STATED, site=stated), TABLE).site.latitude_deg < 89.9
