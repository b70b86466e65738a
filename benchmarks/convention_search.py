"""Conventions named from 60 s of sky: how often right, not told apart, or wrong, over random draws.

Each draw is a sensor on the built-in site that looks anywhere above 30 deg of altitude, at any time of thirty years,
with a convention, noise and a body frame of its own. Run: python benchmarks/convention_search.py [DRAWS]
"""

import sys
from collections import Counter

import numpy as np
from scipy.spatial.transform import Rotation

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.station.own_answers import OwnAnswerTruth
from gse.statistics.sensor_convention import SentAnswers, search_convention
from gse.truth import EarthOrientation, SiderealTruth
from gse.truth.frames import icrs_to_frame
from gse.values.attitude_convention import AttitudeConvention, proper_axes, state_angles, state_quaternions
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount

FIRST_NS, LAST_NS = from_text("2010-01-01T00:00:00Z"), from_text("2026-01-01T00:00:00Z")
ANSWERS = 60
BODY_ARCSEC = (0.0, 0.0, 3.0, 20.0)
"""How far the body frame is turned on the detector, one of these, in a random direction."""


def random_convention(random: np.random.Generator) -> AttitudeConvention:
    """Any of the discrete conventions."""
    axes = list(proper_axes())
    pick = lambda values: values[random.integers(len(values))]  # noqa: E731
    return AttitudeConvention(
        scalar=pick(("first", "last")),
        conjugate=bool(random.integers(2)),
        body_axes=pick(axes),
        reference_axes=pick(axes),
        frame=pick(("ICRS", "J2000", "date", "B1950")),
        ra_unit=pick(("deg", "h")),
        roll_through=pick(("east", "west")),
        roll_zero_deg=pick((0, 90, 180, 270)),
        aberration=pick(("corrected", "not corrected")),
    )


def draw(random: np.random.Generator, orientation: EarthOrientation) -> tuple[AttitudeConvention, SentAnswers, float]:
    """A convention, 60 s of its answers, and how far the body frame is turned."""
    convention = random_convention(random)
    start_ns = int(random.integers(FIRST_NS, LAST_NS))
    utc_ns = start_ns + np.arange(ANSWERS) * NS_PER_S
    mount = Mount(
        azimuth_deg=random.uniform(0, 360), altitude_deg=random.uniform(30, 90), roll_deg=random.uniform(0, 360)
    )
    truth = SiderealTruth(parse_station(BUILT_IN_TEXT).site, orientation)
    left_in, taken_out = (OwnAnswerTruth(truth, mount, corrected).expected(utc_ns) for corrected in (False, True))
    noise_arcsec = random.uniform(1, 15) * np.array([1, 1, 8])
    body_arcsec = BODY_ARCSEC[random.integers(len(BODY_ARCSEC))]
    axis = random.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * body_arcsec * ARCSEC_RAD).as_matrix()
    noise = Rotation.from_rotvec(random.normal(size=(ANSWERS, 3)) * noise_arcsec * ARCSEC_RAD).as_matrix()
    answered = noise @ turn @ (taken_out if convention.aberration == "corrected" else left_in)
    stated = answered @ icrs_to_frame(convention.frame, utc_ns).transpose(0, 2, 1)
    state = state_quaternions if random.integers(2) else state_angles
    return convention, SentAnswers(utc_ns, state(stated, convention), left_in, taken_out, 1.0), body_arcsec


def outcome(convention: AttitudeConvention, evidence: SentAnswers, body_arcsec: float) -> tuple[str, str]:
    """The word on the convention, and the word on aberration."""
    found = search_convention(evidence)
    if found is None or not found.fits:
        return "none", "not told"
    if not found.includes(convention):
        return "WRONG", "not told"
    aberration = "not told" if found.aberration == "not told" else "right"
    if found.aberration not in ("not told", convention.aberration):
        aberration = "as a turned body" if body_arcsec else "WRONG"
    return "named" if len(found.fits) == 1 else f"not told apart ({len(found.fits)})", aberration


def main(draws: int) -> None:
    """Print the table."""
    random = np.random.default_rng(17)
    orientation = EarthOrientation.from_disk(FIRST_NS)
    words, aberrations = Counter(), Counter()
    for _ in range(draws):
        one, other = outcome(*draw(random, orientation))
        words[one] += 1
        aberrations[other] += 1
    for title, counts in (("convention", words), ("aberration", aberrations)):
        print(f"| {title} | draws |\n|---|---|")
        print("\n".join(f"| {word} | {count} |" for word, count in sorted(counts.items())), end="\n\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
