"""What a star simulator or a screen leaves open in the truth: no Earth, no air, no site.

docs/uncertainty.md has the reason of each number.
"""

import math
from collections.abc import Iterator, Mapping

from gse.budget.mount_terms import stability
from gse.budget.uncertainty import TO_STANDARD, Distribution, Term
from gse.mount import InertialDirection


def inertial_terms(
    shown: InertialDirection, clock_error_s: float, drift_arcsec_per_h: Mapping[str, float] | None, duration_s: float
) -> Iterator[Term]:
    """The stated direction, the time where it moves, and its stability over the session."""
    across, roll = shown.uncertainty.across_arcsec * TO_STANDARD, shown.uncertainty.roll_arcsec * TO_STANDARD
    evidence = "B: as stated in the station file, or 10 arcsec (95 %)"
    remedy = "measure it better and state mount.inertial.uncertainty"
    for name, standard, vector in (
        ("shown direction", across, (across, across, 0.0)),
        ("shown roll", roll, (0.0, 0.0, roll)),
    ):
        yield Term(
            name,
            standard,
            "arcsec",
            *vector,
            evidence=evidence,
            explanation="where star simulator and sensor stand to each other",
            remedy=remedy,
            corrected=False,
        )
    if any(shown.rates_arcsec_per_s):
        yield _time(shown, clock_error_s)
    if drift_arcsec_per_h is not None:
        yield stability(drift_arcsec_per_h, duration_s, fitted=False)


def _time(shown: InertialDirection, clock_error_s: float) -> Term:
    """A scene that moves is somewhere else where the clock is off."""
    standard = clock_error_s / math.sqrt(3)
    ra, de, roll = (abs(rate) * standard if rate else 0.0 for rate in shown.rates_arcsec_per_s)
    ra *= math.cos(math.radians(shown.de_deg)) if ra else 1.0
    return Term(
        "clock",
        standard,
        "s",
        ra,
        de,
        roll,
        evidence="B: the bound of the kernel's clock discipline, or as stated by --clock-error",
        explanation="the shown scene moves at the stated rate",
        remedy="synchronise the clock with that of the scene, or state its error: --clock-error 0.1s",
        distribution=Distribution.RECTANGULAR,
        corrected=False,
    )
