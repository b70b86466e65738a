"""A turn that no single mistake explains: told about its axis, by hand."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
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
    refined_s,
    turned,
    wrong_dates,
)
from gse.values.mount import Mount
from gse.values.site import Site

EAST, NORTH, UP = np.eye(3)
STATED = GrossHypothesis("", "", "", MUNICH, MOUNT)
SIDEREAL_DAY_S = 86_164.0905
BORESIGHT = np.array([math.sin(math.radians(130)) / 2, math.cos(math.radians(130)) / 2, math.sin(math.radians(60))])
ASIDE = np.array([math.cos(math.radians(130)), -math.sin(math.radians(130)), 0.0])
"""Of the mount, in the horizon frame: where it looks, and the level direction to the right of it."""


def turn_of(axis, degrees, tilt_deg=0.0, tilt_axis=NORTH):
    """A turn of the horizon frame about an axis after a tilt across it."""
    across = tilt_axis - (tilt_axis @ axis) * axis
    tilt = Rotation.from_rotvec(math.radians(tilt_deg) * across / np.linalg.norm(across))
    return (tilt * Rotation.from_rotvec(math.radians(degrees) * np.asarray(axis))).as_matrix()


def told(axis, degrees, tilt_deg=0.0):
    return turned(attitudes(MUNICH, MOUNT), STATED, turn_of(axis, degrees, tilt_deg), TABLE)


@pytest.mark.parametrize(
    ("axis", "degrees", "cause", "size"),
    [
        (UP, 10.0, "mount", "its azimuth is off by +10.000 deg: the stars fit mount.azimuth_deg: 140.000"),
        (UP, -140.0, "mount", "its azimuth is off by -140.000 deg: the stars fit mount.azimuth_deg: 350.000"),
        (ASIDE, 10.0, "mount", "its altitude is off by -10.000 deg: the stars fit mount.altitude_deg: 50.000"),
        (BORESIGHT, -5.0, "mount", "its roll is off by -5.000 deg: the stars fit mount.roll_deg: 20.000"),
        (EAST, 5.0, "latitude", "the stars fit site.latitude_deg: 53.200, stated is 48.2"),
    ],
)
def test_a_turn_about_one_axis_is_told_as_that_angle(axis, degrees, cause, size):
    found = told(axis, degrees)
    assert (found.cause, found.size, found.equals, found.is_gross) == (cause, size, (), True)


@pytest.mark.parametrize(
    ("degrees", "tilt_deg", "is_one"),
    [(10.0, 0.49, True), (10.0, 0.51, False), (0.3, 0.019, True), (0.3, 0.021, False), (0.3, 0.016, True)],
)
def test_a_twentieth_of_a_turn_or_an_arcminute_and_a_fifth_may_be_left_across(degrees, tilt_deg, is_one):
    found = told(UP, degrees, tilt_deg)
    assert found.size.startswith(f"its azimuth is off by +{degrees:.3f} deg") == is_one


def test_axes_that_are_one_are_equals_of_each_other():
    """At the zenith the vertical is the boresight; and before the pole the clock turns it too."""
    zenith = Mount(azimuth_deg=130.0, altitude_deg=90.0, roll_deg=25.0)
    found = turned(attitudes(MUNICH, zenith), replace(STATED, mount=zenith), turn_of(UP, 20.0), TABLE)
    assert found.size.startswith("its azimuth is off by +20.000 deg")
    (equal,) = found.equals
    assert equal.startswith("mount (its roll is off by +20.000 deg: the stars fit mount.roll_deg: 45.000")


def test_two_mistakes_are_told_with_the_angles_that_fit_and_the_stated_ones():
    """At the mount's own place the answers fit the stated site, so that no other one explains a tilt of the frame."""
    raw = attitudes(MUNICH, replace(MOUNT, azimuth_deg=10.0, altitude_deg=50.0, roll_deg=77.0))
    turn = turn_of(UP, 20.0, 10.0)
    found = turned(raw, STATED, turn, TABLE)
    degrees = math.degrees(Rotation.from_matrix(turn).magnitude())
    boresight = BORESIGHT @ turn
    azimuth_deg, altitude_deg = (
        math.degrees(math.atan2(boresight[0], boresight[1])),
        math.degrees(math.asin(boresight[2])),
    )
    assert found.size.startswith(
        f"it looks {degrees:.2f} deg from where the station file says: the stars fit azimuth {azimuth_deg:.2f}, "
        f"altitude {altitude_deg:.2f}, roll "
    )
    assert found.size.endswith("stated are 130, 60, 25 deg; no single mistake explains it")
    assert (found.cause, found.equals, found.is_gross) == (
        "mount",
        ("two mistakes at once of site, clock and mount",),
        True,
    )


@pytest.mark.parametrize(("latitude_deg", "longitude_deg"), [(46.9, 9.5), (61.0, -15.0)])
def test_another_place_is_told_to_an_arcminute_with_the_stated_one(latitude_deg, longitude_deg):
    raw = attitudes(replace(MUNICH, latitude_deg=latitude_deg, longitude_deg=longitude_deg), MOUNT)
    found = turned(raw, STATED, turn_of(UP, 20.0, 10.0), TABLE)
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
def test_a_clock_is_refined_to_a_tenth_of_a_second_from_half_a_minute_off(clock_s):
    """The Earth turns by 7.2921e-5 rad in a second; air, taken off about a wrong zenith, makes the rest."""
    raw = attitudes(MUNICH, MOUNT, clock_s)
    assert refined_s(raw, STATED, (clock_s + 30.0) * 7.292115e-5, TABLE) == pytest.approx(clock_s, abs=0.1)


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
    """Two days turn it by 471.819 s; one day is a cause of its own, and the other half of a year is the first one."""
    by_hand = set()
    for days in (*range(2, 184), 365, 366):
        for off, side in ((days, "ahead"), (-days, "behind")):
            apart_s = (86_400 * off - fast_s) % SIDEREAL_DAY_S
            if min(apart_s, SIDEREAL_DAY_S - apart_s) < 4.0:
                by_hand.add(f"a date that is {days} days {side}")
    assert set(wrong_dates(fast_s)) == by_hand


@pytest.mark.parametrize(
    ("days", "late_s", "is_told"),
    [(2, 3.99, True), (2, -3.99, True), (2, 4.01, False), (2, -4.01, False), (183, 0, True), (365, 0, True),
     (366, 0, True), (1, 0, False), (184, 0, False), (364, 0, False), (367, 0, False)],
)  # fmt: skip
@pytest.mark.parametrize("side", ["ahead", "behind"])
def test_a_date_is_off_by_up_to_half_a_year_or_by_a_whole_one(days, late_s, is_told, side):
    turned_s = (86_400 - SIDEREAL_DAY_S) * days * (1 if side == "ahead" else -1)
    assert (f"a date that is {days} days {side}" in list(wrong_dates(turned_s + late_s))) == is_told


def test_a_latitude_grows_with_the_turn_about_east():
    found = _of_latitude(replace(MUNICH, latitude_deg=-6.5), math.radians(-2.25))
    assert (found.cause, found.size) == ("latitude", "the stars fit site.latitude_deg: -8.750, stated is -6.5")
    assert (found.equals, found.next_step, found.is_gross) == ((), CORRECT, True)


@pytest.mark.parametrize(
    ("angle_deg", "text"),
    [(12.345, "12.35 deg"), (0.1, "0.10 deg"), (0.09985, "359 arcsec"), (0.09988, "360 arcsec"), (0.05, "180 arcsec")],
)
def test_an_angle_below_a_tenth_of_a_degree_is_told_in_arcseconds(angle_deg, text):
    assert angle_text(angle_deg) == text


@pytest.mark.parametrize(
    ("stated_deg", "true_deg", "is_found"),
    [((48.2, 11.6), (46.9, 9.5), True), ((48.2, 11.6), (50.0, -3.0), True), ((89.0, 11.6), (89.5, 11.6), True),
     ((89.0, 11.6), (89.95, 11.6), False)],
)  # fmt: skip
def test_another_place_is_found_by_what_all_three_angles_say_but_for_the_very_pole(stated_deg, true_deg, is_found):
    """North of 89.9 deg a longitude says next to nothing: no place is looked for there."""
    stated, true = (replace(MUNICH, latitude_deg=one[0], longitude_deg=one[1]) for one in (stated_deg, true_deg))
    found = _elsewhere(attitudes(true, MOUNT), replace(STATED, site=stated), TABLE)
    assert (found is not None) is is_found
    if found is not None:
        assert (found.cause, found.is_gross, found.next_step) == ("site", True, CORRECT)
        fits = re.fullmatch(
            r"the stars fit site.latitude_deg: ([\d.-]+) and longitude_deg: ([\d.-]+), stated are (\S+) and (\S+)",
            found.size,
        )
        latitude_deg, longitude_deg, *told = map(float, fits.groups())
        assert tuple(told) == stated_deg
        assert latitude_deg == pytest.approx(true_deg[0], abs=0.003)
        assert longitude_deg == pytest.approx(true_deg[1], abs=0.003 / math.cos(math.radians(true_deg[0])))
