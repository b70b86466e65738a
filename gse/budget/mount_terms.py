"""What the mount and the times of frames leave open in the truth.

docs/uncertainty.md has the reason of each number.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from gse.axis import AXES
from gse.budget.truth_sensitivity import LARGEST_STEP_ARCSEC, ChangedTruth, Vector, scaled, together
from gse.budget.uncertainty import TO_STANDARD, Distribution, Term
from gse.matrices import eigh
from gse.mount import Mount
from gse.truth import Alignment

STABILITY = "mount stability"
"""The name of its term."""

_TIME_STAMP_S = 0.001
"""An operating system wakes a reader within this much (Linux, an idle machine)."""
_BITS_PER_BYTE = 10
_BLOCK_S = 20.0
"""The fit's scatter is that of means over this much."""


def stated_mount(mount: Mount, at: ChangedTruth) -> list[Term]:
    """The altitude's uncertainty is that of the level, so that it holds across the boresight's azimuth too."""

    def changed(angle: str, by: float) -> Vector:
        return at.changed(mount=replace(mount, **{f"{angle}_deg": getattr(mount, f"{angle}_deg") + by / 3600}))

    terms = []
    for angle in ("azimuth", "altitude", "roll"):
        standard = getattr(mount.uncertainty, f"{angle}_arcsec") * TO_STANDARD
        vectors = [scaled(partial(changed, angle), standard, LARGEST_STEP_ARCSEC)]
        if angle == "altitude":
            vectors.append(scaled(partial(at.tilted, mount.azimuth_deg), standard, LARGEST_STEP_ARCSEC))
        terms.append(
            Term(
                f"mount {angle}",
                standard,
                "arcsec",
                *together(vectors),
                evidence="B: as stated in the station file, or 10 arcsec (95 %)",
                explanation="the level of the mount, along and across" if angle == "altitude" else "as surveyed",
                remedy=f"survey it better and state mount.uncertainty.{angle}_arcsec, or fit the mount",
                corrected=False,
            )
        )
    return terms


def fitted_mount(alignment: Alignment, at: ChangedTruth) -> Term:
    """Each principal direction of the fit's covariance is an error of its own."""
    covariance = np.array(alignment.covariance_arcsec2)
    known = bool(np.isfinite(covariance).all())
    vectors: list[Vector] = [(math.inf, math.inf, math.inf)]
    if known:
        values, directions = eigh(covariance)
        turns = np.sqrt(np.maximum(values, 0.0))[:, None] * directions.T
        vectors = [at.turned(turn) for turn in turns]
    blocks = int((alignment.until_ns - alignment.from_ns) / 1e9 / _BLOCK_S) + 1
    x, y, _ = alignment.sigma_arcsec
    return Term(
        "fitted mount",
        math.hypot(x, y),
        "arcsec",
        *together(vectors),
        evidence=f"A: scatter of means over 20 s of {alignment.n} frames",
        explanation="the mount was fitted on this sky: absolute pointing, site and clock are not tested",
        remedy="fit the mount on more frames",
        distribution=Distribution.STUDENT,
        degrees_of_freedom=float(max((blocks if blocks >= 8 else alignment.n) - 1, 1)),
    )


def stability(drift_arcsec_per_h: Mapping[str, float], duration_s: float, *, fitted: bool) -> Term:
    """A drift of the mount over the session: the sky cannot tell it from a drift of the sensor."""
    hours = duration_s / 3600
    # A stated mount was surveyed at some time; a fitted one is that of the session's beginning.
    reach = hours if fitted else hours / 2
    ra, de, roll = (_half_width(reach * drift_arcsec_per_h.get(axis.key, 0.0)) / math.sqrt(3) for axis in AXES)
    return Term(
        STABILITY,
        math.hypot(ra, de),
        "arcsec",
        ra,
        de,
        roll,
        evidence=f"A: drift of the residuals over {hours:.2f} h, the larger end of its 95 % interval",
        explanation="a mount that sags and a sensor that drifts look alike",
        remedy="let mount and sensor settle; measure longer",
        distribution=Distribution.RECTANGULAR,
        corrected=False,
    )


def _half_width(arcsec: float) -> float:
    """A drift that a session is too short for is judged by the sampling, not here."""
    return arcsec if math.isfinite(arcsec) else 0.0


def clock(error_s: float, at: ChangedTruth) -> Term:
    """A constant error is absorbed by a fitted mount, but nothing says that it is constant: the term stays whole."""
    standard = error_s / math.sqrt(3)
    ra, de, roll = at.about_the_pole(standard)
    return Term(
        "clock",
        standard,
        "s",
        ra,
        de,
        roll,
        evidence="B: the bound of the kernel's clock discipline, or as stated by --clock-error",
        explanation="the sky turns by 15 arcsec in a second",
        remedy="synchronise the clock, or state its error if it was measured: --clock-error 0.1s",
        distribution=Distribution.RECTANGULAR,
        corrected=False,
    )


def time_stamp(baudrate: int, at: ChangedTruth) -> Term:
    """How late the first byte of a frame may be read."""
    half_byte_s = _BITS_PER_BYTE / 2 / baudrate
    standard = (_TIME_STAMP_S + half_byte_s) / math.sqrt(3)
    return Term(
        "time stamp",
        standard,
        "s",
        *at.about_the_pole(standard),
        evidence=f"B: the first byte is read within 1 ms; half a byte at {baudrate} baud",
        explanation="mid-exposure is counted back from the first byte that is read",
        remedy="a faster baud rate; an idle machine",
        distribution=Distribution.RECTANGULAR,
    )
