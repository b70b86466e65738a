import math

import numpy as np
from astropy import units as u
from astropy.coordinates import SkyCoord
from astropy.time import Time
from skyfield.named_stars import named_star_dict

from gse.catalog import StarCatalog, load_catalog
from gse.catalog.stars import star_name

OLDER_THAN_THE_IAU_LIST = {"Algenib", "Gienah", "Markab"}
"""Names that skyfield gives to other stars than the IAU does (alpha Per, epsilon Cyg, kappa Vel)."""


def test_names_agree_with_skyfield_where_both_have_them():
    ours = {star_name("HIP", number): number for number in set(named_star_dict.values())}
    shared = [name for name in named_star_dict if name in ours and name not in OLDER_THAN_THE_IAU_LIST]
    assert len(shared) >= 75
    assert all(ours[name] == named_star_dict[name] for name in shared)


def test_the_brightest_stars_of_gaia_have_names():
    catalog = load_catalog()
    assert [catalog.name(row) for row in range(5)] == ["Sirius", "Canopus", "Arcturus", "Rigil Kentaurus", "Betelgeuse"]
    assert sum(catalog.name(row).startswith("Gaia") for row in range(100)) <= 20


def test_a_star_without_a_name_has_its_number():
    assert star_name("HIP", 19) == "HIP 19"
    assert star_name("HR", 1) == "HR 1"
    assert star_name("Gaia DR3", 12345) == "Gaia DR3 12345"
    assert star_name("Gaia DR3", -19) == "HIP 19"


def test_proper_motion_against_astropy():
    ra, de, mu_ra, mu_de = 269.45, 89.2, -798.0, 1032.0
    star = SkyCoord(
        ra * u.deg,
        de * u.deg,
        pm_ra_cosdec=mu_ra * u.mas / u.yr,
        pm_dec=mu_de * u.mas / u.yr,
        distance=100 * u.pc,
        radial_velocity=0 * u.km / u.s,
        obstime=Time(1991.25, format="jyear", scale="tdb"),
    )
    expected = star.apply_space_motion(dt=34.75 * u.yr).cartesian.xyz.value
    east = np.array([-math.sin(math.radians(ra)), math.cos(math.radians(ra)), 0])
    icrs = star.cartesian.xyz.value / 100
    motion = math.radians(1 / 3.6e6) * (mu_ra * east + mu_de * np.cross(icrs, east))
    catalog = StarCatalog("one star", 1991.25, np.array([1]), icrs[None], np.array([5.0]), "HIP", motion[None])
    moved = catalog.at_epoch(2026.0).icrs[0]
    assert np.linalg.norm(moved - expected / np.linalg.norm(expected)) < math.radians(0.001 / 3600)
