"""Is the true error inside U95? Random sessions with errors drawn from the budget's own stated distributions.

    python benchmarks/truth_budget.py [--sessions 500] [--seed 1]

Each session has a random site, mount, instant and air, and a sky that differs from what the station file says: the
true site, vertical, mount, air, clock, time stamp and star places are drawn, and the error that a faultless sensor
would be reported with is computed from the drawn values as a whole, not term by term. The expanded uncertainty is that
of ``gse.statistics.truth_budget``, as in a report.
"""

import argparse
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gse.station.results import attitude_error
from gse.statistics.star_terms import PARALLAX_ARCSEC, FieldOfStars, star_terms
from gse.statistics.truth_budget import SessionFacts, truth_budget
from gse.statistics.uncertainty import TO_STANDARD
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor
from gse.values.attitude import Attitude
from gse.values.axis import AXES
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount, MountUncertainty
from gse.values.site import Site, SiteUncertainty

EARTH_M = 6_371_000.0
TIME_STAMP_S, BITS_PER_BYTE = 0.001, 10


@dataclass(frozen=True, slots=True)
class Drawn:
    """One session: what the station believes, and the error in arcsec that it would report of a faultless sensor."""

    facts: SessionFacts
    errors: tuple[float, float, float]


def drawn(random: np.random.Generator) -> Drawn:
    """A session at random, with its errors."""
    site, mount = random_site(random), random_mount(random)
    utc_ns = int(random.integers(from_text("2020-01-01T00:00:00Z"), from_text("2027-10-01T00:00:00Z")))
    table = EarthOrientation.from_disk(utc_ns)
    stars = FieldOfStars(stars=float(random.integers(6, 20)), at_rest=float(random.uniform(0, 0.3)))
    clock_s = float(10 ** random.uniform(-4, 0))
    facts = SessionFacts(site, mount, table, utc_ns, clock_s, stars, baudrate=int(random.choice([9600, 115_200])))
    measured = turned(seen(random, facts), stars_error(random, facts))
    error = attitude_error(measured, SiderealTruth(site, table).attitude_true(utc_ns, mount))
    return Drawn(facts, (error.d_ra_cosde_arcsec, error.d_de_arcsec, error.d_roll_arcsec))


def random_site(random: np.random.Generator) -> Site:
    """Anywhere on the globe, its pressure and temperature entered in half of the sessions."""
    height_m = float(random.uniform(0, 4000))
    nominal = Site(
        latitude_deg=math.degrees(math.asin(random.uniform(-0.998, 0.998))), longitude_deg=0, height_m=height_m
    )
    entered = bool(random.integers(2))
    uncertainty = SiteUncertainty(
        position_m=float(10 ** random.uniform(0.5, 3)), vertical_arcsec=float(random.uniform(1, 20))
    )
    return replace(
        nominal,
        longitude_deg=float(random.uniform(-180, 180)),
        pressure_hpa=nominal.air_pressure_hpa + float(random.normal(0, 8)) if entered else None,
        temperature_c=float(random.uniform(-10, 30)) if entered else None,
        uncertainty=uncertainty,
    )


def random_mount(random: np.random.Generator) -> Mount:
    """Altitudes from 20 to 90 deg, angles known to some or to many arcsec."""
    azimuth, altitude, roll = (float(random.uniform(1, 20)) for _ in range(3))
    return Mount(
        azimuth_deg=float(random.uniform(0, 360)),
        altitude_deg=float(random.uniform(20, 90)),
        roll_deg=float(random.uniform(0, 360)),
        uncertainty=MountUncertainty(azimuth_arcsec=azimuth, altitude_arcsec=altitude, roll_arcsec=roll),
    )


def seen(random: np.random.Generator, facts: SessionFacts) -> Attitude:
    """What a faultless sensor measures: the true sky at the true instant, un-refracted by the air that is believed."""
    site, mount, table = facts.site, facts.mount, facts.earth_orientation
    assert table is not None
    true_site = moved(random, site)
    late_s = random.uniform(-1, 1) * facts.clock_error_s
    late_s += random.uniform(-1, 1) * (TIME_STAMP_S + BITS_PER_BYTE / 2 / facts.baudrate)
    here = table.at(facts.utc_ns)
    late_s += random.normal(0, here.ut1_error_s)
    if here.leap_error_s:
        late_s += random.uniform(-1, 1) * here.leap_error_s
    true_ns = facts.utc_ns + round(late_s * NS_PER_S)
    truth = SiderealTruth(true_site, table)
    believed = SiderealTruth(site, table)
    zenith = math.radians(90 - mount.altitude_deg)
    bend = truth.refraction.bend_rad(zenith) * (1 + random.uniform(-1, 1) * 0.005) - believed.refraction.bend_rad(
        zenith
    )
    u = mount.uncertainty
    true_mount = replace(
        mount,
        azimuth_deg=mount.azimuth_deg + normal(random, u.azimuth_arcsec) / 3600,
        altitude_deg=mount.altitude_deg + normal(random, u.altitude_arcsec) / 3600 + math.degrees(bend),
        roll_deg=mount.roll_deg + normal(random, u.roll_arcsec) / 3600,
    )
    azimuth = math.radians(mount.azimuth_deg)
    level = normal(random, u.altitude_arcsec) * np.array([math.sin(azimuth), math.cos(azimuth), 0.0])
    vertical = [normal(random, site.uncertainty.vertical_arcsec) for _ in range(2)]
    tilt = Rotation.from_rotvec(np.add(level, [*vertical, 0.0]) * ARCSEC_RAD).as_matrix()
    return Attitude(horizon_to_sensor(true_mount) @ tilt @ truth.icrs_to_horizon(true_ns), np.zeros((3, 3)))


def moved(random: np.random.Generator, site: Site) -> Site:
    """The true site, with its true air."""
    u, cosine = site.uncertainty, math.cos(math.radians(site.latitude_deg))
    north_m, east_m = (normal(random, u.position_m) for _ in range(2))
    height_m = site.height_m + normal(random, u.height_m)
    higher = replace(site, height_m=height_m)
    humidity = site.relative_humidity + normal(random, u.relative_humidity)
    return replace(
        higher,
        latitude_deg=site.latitude_deg + math.degrees(north_m / EARTH_M),
        longitude_deg=site.longitude_deg + math.degrees(east_m / EARTH_M / cosine),
        pressure_hpa=higher.air_pressure_hpa + normal(random, site.pressure_uncertainty_hpa),
        temperature_c=site.air_temperature_c + normal(random, site.temperature_uncertainty_c),
        relative_humidity=min(max(humidity, 0.0), 1.0),
    )


def stars_error(random: np.random.Generator, facts: SessionFacts) -> np.ndarray:
    """The rotation vector, in the sensor frame, of a fix to stars that stand elsewhere than the catalogue says."""
    field = facts.stars
    each = {term.name: term.standard for term in star_terms(field, facts.utc_ns, 0.0)}
    count = round(field.stars)
    places = random.uniform(-0.5, 0.5, (count, 2)) * field.width_rad
    off = random.normal(0, math.hypot(each["proper motion"], PARALLAX_ARCSEC, each["blends"]), (count, 2)) * ARCSEC_RAD
    directions = np.column_stack([places, np.ones(count)])
    shifted = directions + np.column_stack([off, np.zeros(count)])
    turn, _ = Rotation.align_vectors(unit(directions), unit(shifted))
    return turn.as_rotvec() * ARCSEC_PER_RAD


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def turned(attitude: Attitude, rotation_arcsec: np.ndarray) -> Attitude:
    turn = Rotation.from_rotvec(rotation_arcsec * ARCSEC_RAD).as_matrix()
    return Attitude(turn @ attitude.icrs_to_sensor, np.zeros((3, 3)))


def normal(random: np.random.Generator, half_width_95: float) -> float:
    return float(random.normal(0, half_width_95 * TO_STANDARD))


def main() -> None:
    """Draw the sessions and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    random = np.random.default_rng(options.seed)
    inside, k, width = [], [], []
    for _ in range(options.sessions):
        one = drawn(random)
        axes = truth_budget(one.facts).axes
        known = [axes[axis.key] for axis in AXES]
        inside.append([abs(error) <= of.expanded_arcsec for of, error in zip(known, one.errors, strict=True)])
        k.append([of.k for of in known])
        width.append([of.expanded_arcsec for of in known])
    print(f"{options.sessions} sessions, seed {options.seed}; the true error is inside U95 (to reach: 93 to 97 %)")
    print("| axis | inside U95 | U95, median (arcsec) | k, smallest to greatest |")
    print("|---|---|---|---|")
    for place, axis in enumerate(AXES):
        share, values = np.mean([row[place] for row in inside]), [row[place] for row in k]
        middle = np.median([row[place] for row in width])
        print(f"| {axis.key} | {share:.1%} | {middle:.1f} | {min(values):.2f} to {max(values):.2f} |")


if __name__ == "__main__":
    main()
