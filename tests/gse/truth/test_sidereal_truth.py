"""Sidereal truth: Earth orientation, mount convention, refraction, and what happens outside the tables."""

from dataclasses import replace

import erfa
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gse.errors import TruthError, UsageError
from gse.truth import CORRECTIONS, EarthOrientation, Refraction, SiderealTruth, horizon_to_sensor, mount_of
from gse.values.instant import NS_PER_DAY, NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.site import Site

ARCSEC = np.pi / 180 / 3600
NOW_NS = from_text("2026-03-20T18:30:00Z")
ROOF = Site(latitude_deg=-6.53, longitude_deg=106.7, height_m=250, pressure_hpa=985, temperature_c=25)
directions = st.floats(-1, 1)


@pytest.fixture(scope="module")
def table():
    return EarthOrientation.from_disk(NOW_NS)


def test_a_frozen_table_comes_back_equal_from_json(table):
    assert EarthOrientation.from_json(table.to_json()) == table


@pytest.mark.parametrize("text", ["", "[]", "{}", "nonsense", '{"schema": 3}', "[" * 100_000])
def test_a_text_that_is_no_table_is_refused(text):
    with pytest.raises(TruthError):
        EarthOrientation.from_json(text)


def test_ut1_goes_on_steadily_over_a_leap_second():
    midnight = from_text("2017-01-01T00:00:00Z")
    before, after = (EarthOrientation.from_disk(midnight).at(midnight + shift) for shift in (-1, 0))
    assert after.ut1_minus_utc_s - before.ut1_minus_utc_s == pytest.approx(1.0, abs=1e-6)


def test_the_sky_turns_by_two_seconds_over_a_leap_second():
    midnight = from_text("2017-01-01T00:00:00Z")
    truth = SiderealTruth(ROOF, EarthOrientation.from_disk(midnight))
    before, after = (truth.icrs_to_horizon(midnight + shift * NS_PER_S) for shift in (-1, 0))
    turned = np.arccos((np.trace(after @ before.T) - 1) / 2)
    assert turned == pytest.approx(2 * 15.041067 * ARCSEC, rel=1e-4)


@pytest.mark.parametrize("instant", ["2026-01-03T17:00:00Z", "2025-07-03T20:00:00Z"], ids=["perihelion", "aphelion"])
def test_stars_near_the_sun_are_where_erfa_has_them_for_astrometry(instant):
    """Against the whole path of SOFA's astrometry, apci13 and atciqz, from 2 to 90 deg from the Sun."""
    utc_ns = from_text(instant)
    table = EarthOrientation.from_disk(utc_ns)
    tt = 2_440_587.5 + utc_ns // NS_PER_DAY, (utc_ns % NS_PER_DAY / NS_PER_S + 37 + 32.184) / 86_400
    sun = -erfa.epv00(*tt)[0]["p"]
    away = np.cross(sun, [0.1, 0.7, 0.7])
    sun, away = sun / np.linalg.norm(sun), away / np.linalg.norm(away)
    angles = np.radians([2.0, 5.0, 20.0, 45.0, 90.0])[:, None]
    stars = np.cos(angles) * sun + np.sin(angles) * away
    astrometry, _ = erfa.apci13(*tt)
    expected = erfa.s2c(*erfa.atciqz(*erfa.c2s(stars), astrometry)) @ astrometry["bpn"]
    seen = SiderealTruth(ROOF, table, {"diurnal aberration"}).apparent(stars, utc_ns)
    assert np.linalg.norm(seen - expected, axis=1).max() < 0.001 * ARCSEC


def test_an_answer_does_not_depend_on_what_was_asked_before(table):
    fresh, used = SiderealTruth(ROOF, table), SiderealTruth(ROOF, table)
    for second in range(-4000, 4000, 137):
        used.icrs_to_horizon(NOW_NS + second * NS_PER_S)
    assert (fresh.icrs_to_horizon(NOW_NS) == used.icrs_to_horizon(NOW_NS)).all()


def test_between_two_cells_the_sky_does_not_jump(table):
    truth = SiderealTruth(ROOF, table)
    edge = NOW_NS - NOW_NS % (300 * NS_PER_S)
    before, after = truth.icrs_to_horizon(edge - 1), truth.icrs_to_horizon(edge)
    assert np.abs(after - before).max() < 0.001 * ARCSEC
    star = np.array([[0.0, -0.6, -0.8]])
    assert np.abs(truth.apparent(star, edge) - truth.apparent(star, edge - 1)).max() < 0.002 * ARCSEC


@given(st.floats(0, 360), st.floats(-90, 90), st.floats(0, 360))
def test_a_mount_comes_back_from_its_rotation(azimuth, altitude, roll):
    rotation = horizon_to_sensor(Mount(azimuth_deg=azimuth, altitude_deg=altitude, roll_deg=roll))
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) > 0
    assert np.abs(horizon_to_sensor(mount_of(rotation)) - rotation).max() < 0.03 * ARCSEC


def test_without_air_there_is_no_refraction():
    space = Refraction.at(replace(ROOF, pressure_hpa=0.0))
    assert (space.a_rad, space.b_rad) == (0, 0)


@given(directions, directions, directions)
def test_refraction_is_removed_away_from_the_zenith_and_in_its_plane(x, y, z):
    length = np.sqrt(x * x + y * y + z * z)
    if length < 1e-3:
        return
    seen, zenith = np.array([x, y, z]) / length, np.array([0.0, 0.0, 1.0])
    (before,) = Refraction.at(ROOF).removed(seen[None], zenith)
    assert np.linalg.norm(before) == pytest.approx(1, abs=1e-12)
    assert before[2] <= seen[2] + 1e-15
    assert abs(before[0] * seen[1] - before[1] * seen[0]) < 1e-12


@pytest.mark.parametrize(
    ("name", "least_arcsec", "most_arcsec"),
    [
        # The sizes that a rooftop near the zenith sees in this year.
        ("precession", 1141, 1370),
        ("nutation", 1, 20),
        ("UT1", 0.001, 13.5),
        ("polar motion", 0.01, 0.6),
        ("geodetic latitude", 155, 157),
        ("annual aberration", 0.6, 20.6),
        ("diurnal aberration", 0.3, 0.33),
        ("light deflection", 1e-4, 0.1),
        ("refraction", 50, 60),
    ],
)
def test_each_correction_left_out_shows_its_own_size(table, name, least_arcsec, most_arcsec):
    full, without = SiderealTruth(ROOF, table), SiderealTruth(ROOF, table, {name})
    altitude = 45 if name == "refraction" else 88
    sensor = horizon_to_sensor(Mount(azimuth_deg=60, altitude_deg=altitude))
    boresight = np.array([[0.0, 0.0, 1.0]])

    def star_icrs(truth):
        """Where the star that is seen on the boresight would stand in ICRS axes, to first order."""
        direction = truth.unrefracted(boresight, sensor[:, 2]) @ sensor @ truth.icrs_to_horizon(NOW_NS)
        return direction - (truth.apparent(direction, NOW_NS) - direction)

    size = np.linalg.norm(star_icrs(without) - star_icrs(full)) / ARCSEC
    assert least_arcsec < size < most_arcsec


def test_an_unknown_correction_is_refused_by_name(table):
    with pytest.raises(UsageError, match="known are: precession"):
        SiderealTruth(ROOF, table, {"luck"})
    assert len(CORRECTIONS) == len(set(CORRECTIONS))


def pole_distance_arcsec(table, omit):
    """How far the pole of the ICRS stands from the axis of the Earth over the roof."""
    truth = SiderealTruth(ROOF, table, {*omit, "polar motion"})
    latitude = np.radians(ROOF.latitude_deg)
    axis = np.array([0.0, np.cos(latitude), np.sin(latitude)])
    return np.linalg.norm(truth.icrs_to_horizon(NOW_NS)[:, 2] - axis) / ARCSEC


def test_precession_and_nutation_each_move_the_pole_by_what_erfa_says(table):
    tt = 2_461_120.0, 0.2716  # 2026-03-20T18:31:09 TT
    nutation = erfa.nut06a(*tt)
    obliquity = erfa.obl06(*tt)
    nutation_arcsec = np.hypot(nutation[0] * np.sin(obliquity), nutation[1]) / ARCSEC
    precession_arcsec = 20.0419 * 26.216  # theta of IAU 2006 per year, years since 2000
    assert pole_distance_arcsec(table, {"precession", "nutation"}) < 0.03  # the frame bias
    assert pole_distance_arcsec(table, {"precession"}) == pytest.approx(nutation_arcsec, abs=0.03)
    assert pole_distance_arcsec(table, {"nutation"}) == pytest.approx(precession_arcsec, abs=0.2)


def earth_of(table, utc_ns):
    """The instant as two-part TT and UT1, and the pole, by hand: 37 leap seconds and 32.184 s."""
    day, second, here = 2_440_587.5 + utc_ns // NS_PER_DAY, utc_ns % NS_PER_DAY / NS_PER_S, table.at(utc_ns)
    return (day, (second + 37 + 32.184) / 86_400), (day, (second + here.ut1_minus_utc_s) / 86_400), here


def axes_of(site):
    """East, north and up by what changes with the height of the ellipsoid."""
    low, high = (erfa.gd2gc(1, *np.radians([site.longitude_deg, site.latitude_deg]), height) for height in (0.0, 1e6))
    up = (high - low) / np.linalg.norm(high - low)
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    return np.array([east, np.cross(up, east), up])


MIDDLE_NS = from_text("2026-03-20T18:32:30Z")
"""Of 300 s, where the truth leaves nothing out."""


@pytest.mark.parametrize("omit", [set(), {"UT1"}, {"polar motion"}, {"UT1", "polar motion"}])
def test_in_the_middle_of_five_minutes_the_horizon_is_where_the_iau_2006_resolutions_have_it(table, omit):
    """By the celestial intermediate origin, while the truth goes by the equinox."""
    tt, ut1, here = earth_of(table, MIDDLE_NS)
    if "UT1" in omit:
        ut1 = ut1[0], MIDDLE_NS % NS_PER_DAY / NS_PER_DAY
    pole = (0.0, 0.0) if "polar motion" in omit else (here.x_pole_rad, here.y_pole_rad)
    expected = axes_of(ROOF) @ erfa.c2t06a(*tt, *ut1, *pole)
    assert np.abs(SiderealTruth(ROOF, table, omit).icrs_to_horizon(MIDDLE_NS) - expected).max() < 1e-11


def test_inside_five_minutes_the_earth_turns_by_its_rate_about_one_axis(table):
    truth = SiderealTruth(ROOF, table, {"polar motion"})
    axis = np.array([0.0, np.cos(np.radians(ROOF.latitude_deg)), np.sin(np.radians(ROOF.latitude_deg))])
    first = MIDDLE_NS - 150 * NS_PER_S
    instants = [first - 1, first, MIDDLE_NS + 40 * NS_PER_S, first + 300 * NS_PER_S - 1, first + 300 * NS_PER_S]
    before, begin, later, end, after = (truth.icrs_to_horizon(utc_ns) for utc_ns in instants)
    pole = axis @ begin
    for rotation in (later, end):
        assert np.abs(axis @ rotation - pole).max() < 1e-14
    for rotation in (before, after):
        assert np.abs(axis @ rotation - pole).max() > 1e-10  # 20 arcsec a year: 0.0002 in five minutes
    turned = np.array([np.cross(axis, row) for row in np.eye(3)])
    angle = 190 * 2 * np.pi * 1.00273781191135448 / 86_400
    expected = np.cos(angle) * np.eye(3) + np.sin(angle) * turned + (1 - np.cos(angle)) * np.outer(axis, axis)
    assert np.abs(later - expected @ begin).max() < 1e-12
    assert np.abs(truth.icrs_to_horizon_at(np.array(instants)) - [before, begin, later, end, after]).max() < 1e-15


def test_no_instant_before_1972_has_a_rotation(table):
    truth = SiderealTruth(ROOF, table)
    for utc_ns in (0, 1):
        with pytest.raises(TruthError, match="no sidereal truth for 1970-01-01"):
            truth.icrs_to_horizon(utc_ns)


def test_the_sky_of_three_and_a_half_days_is_kept_at_most(table):
    truth = SiderealTruth(ROOF, table)
    truth.icrs_to_horizon(NOW_NS)
    (cell,) = truth._cells.values()
    truth._cells.update(dict.fromkeys(range(1022), cell))
    truth.icrs_to_horizon(NOW_NS + 300 * NS_PER_S)
    assert len(truth._cells) == 1024
    truth.icrs_to_horizon(NOW_NS + 600 * NS_PER_S)
    assert len(truth._cells) == 1


SKY = np.random.default_rng(11).normal(size=(50, 3))
STARS = SKY / np.linalg.norm(SKY, axis=1)[:, None]


@pytest.mark.parametrize("omit", [set(), {"annual aberration"}, {"diurnal aberration"}, {"light deflection"}])
def test_stars_are_moved_by_the_velocities_of_the_earth_and_of_the_site_and_by_the_sun(table, omit):
    """The site's velocity is that of ERFA's pvtob, in place of a speed towards the east."""
    tt, ut1, here = earth_of(table, MIDDLE_NS)
    heliocentric, barycentric = erfa.epv00(*tt)
    light_au_per_day = 299_792_458.0 * 86_400 / 149_597_870_700
    velocity_c = np.zeros(3) if "annual aberration" in omit else barycentric["v"] / light_au_per_day
    if "diurnal aberration" not in omit:
        place = *np.radians([ROOF.longitude_deg, ROOF.latitude_deg]), ROOF.height_m
        site = erfa.pvtob(*place, here.x_pole_rad, here.y_pole_rad, erfa.sp00(*tt), erfa.gst06a(*ut1, *tt))
        velocity_c = velocity_c + site["v"] @ erfa.pnm06a(*tt) / 299_792_458.0
    distance_au = np.linalg.norm(heliocentric["p"])
    bent = STARS if "light deflection" in omit else erfa.ldsun(STARS, heliocentric["p"] / distance_au, distance_au)
    expected = erfa.ab(bent, velocity_c, distance_au, np.sqrt(1 - velocity_c @ velocity_c))
    seen = SiderealTruth(ROOF, table, omit).apparent(STARS, MIDDLE_NS)
    assert np.linalg.norm(seen - expected, axis=1).max() < 1e-11


def test_stars_of_many_instants_are_each_moved_as_at_their_own(table):
    truth = SiderealTruth(ROOF, table)
    utc_ns = NOW_NS + np.array([0, 20_000, 40_000]) * NS_PER_S
    instant_of = np.arange(50) % 3
    together = truth.apparent_at(STARS, utc_ns, truth.icrs_to_horizon_at(utc_ns), instant_of)
    for number, instant in enumerate(utc_ns.tolist()):
        mine = instant_of == number
        assert np.abs(together[mine] - truth.apparent(STARS[mine], instant)).max() < 1e-15


def test_the_true_attitudes_of_many_instants_are_the_mount_times_the_horizon(table):
    truth = SiderealTruth(ROOF, table)
    mount = Mount(azimuth_deg=10.0, altitude_deg=50.0, roll_deg=20.0)
    rotations = truth.icrs_to_horizon_at(NOW_NS + np.arange(4) * NS_PER_S)
    attitudes = truth.attitudes_true(rotations, mount)
    assert attitudes.covariance_rad2.shape == (4, 3, 3)
    assert not attitudes.covariance_rad2.any()
    for found, rotation in zip(attitudes.icrs_to_sensor, rotations, strict=True):
        assert np.abs(found - horizon_to_sensor(mount) @ rotation).max() < 1e-15
    alone = truth.attitude_true(NOW_NS, mount)
    assert np.array_equal(alone.icrs_to_sensor, attitudes.icrs_to_sensor[0])
    assert np.array_equal(alone.covariance_rad2, np.zeros((3, 3)))
