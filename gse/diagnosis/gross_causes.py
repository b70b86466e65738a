"""Gross causes: mistakes of the set-up that turn the sky by degrees, each tried by itself.

The raw attitudes of some frames know nothing of site, clock and mount. Under each hypothesis (a sign, two values
exchanged, a time zone, a quarter turn) they are corrected anew for aberration and refraction and compared with where
the mount would have looked. A hypothesis is named where it takes away nearly all of the error: no free parameter helps
it, so that a hit by chance is a matter of one in a thousand. Where none does, the turn about the pole, the vertical, a
level axis or the boresight is named with its size.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.gross_hypotheses import SAME_DEG, Hypothesis, of_clock, of_mount, of_site
from gse.diagnosis.gross_turns import angle_text, refined_s, turned
from gse.diagnosis.raw_attitudes import RawAttitudes, central, error_deg_of, errors_arcsec, mount_under
from gse.diagnosis.turns import about, pole
from gse.finding import Finding
from gse.matrices import product
from gse.mount import Mount
from gse.site import Site
from gse.truth import EarthOrientation, horizon_to_sensor, small_rotations

GROSS_DEG = 0.3
"""Smaller errors are left to gse.diagnosis.fine_causes: a mount that is set by hand is off by as much."""
_HIT_SHARE = 0.2
"""A hypothesis must leave less of the error than this."""
_MAJORITY = 0.6
"""Of the frames that are looked at: false answers are few."""
_STEADY_DEG = 0.2
"""A mount that is fixed on the ground, though wrongly described, holds still within this."""


@dataclass(frozen=True, slots=True, eq=False)
class GrossCause:
    """A finding, and the errors (M, 3) of some frames that are left without it: columns, rows, roll, in arcsec.

    None are where the cause may be the sensor's.
    """

    finding: Finding
    left_arcsec: NDArray[np.float64]


def gross_cause(raw: RawAttitudes, site: Site, mount: Mount, orientation: EarthOrientation) -> GrossCause | None:
    """The gross cause of a session on a stated site and mount; None where nothing is gross."""
    stated = Hypothesis("", "", "", site, mount)
    measured = mount_under(raw, stated, orientation)
    apart_deg = np.degrees(np.linalg.norm(small_rotations(measured, measured[central(measured)]), axis=1))
    steady = apart_deg < _STEADY_DEG
    if steady.mean() < _MAJORITY:
        return _follows_the_sky(raw, float(apart_deg.max()))
    whole, whole_measured = raw.taken(np.flatnonzero(steady)), measured[steady]
    raw, measured = raw.some(steady), measured[steady][:1]
    error_deg = error_deg_of(measured, mount)
    if error_deg < GROSS_DEG:
        return None
    turn = product(horizon_to_sensor(mount).T, measured[0])
    fast_s = refined_s(raw, stated, about(pole(site), turn)[0], orientation)
    tried = [*of_site(site, mount), *of_mount(site, mount), *of_clock(stated, fast_s)]
    left = [(error_deg_of(mount_under(raw, one, orientation), one.mount), one) for one in tried]
    hits = sorted(
        (item for item in left if item[0] < max(_HIT_SHARE * error_deg, SAME_DEG) and item[0] < GROSS_DEG),
        key=lambda item: item[0],
    )
    if not hits:
        return GrossCause(turned(raw, stated, turn, orientation), _scatter_arcsec(whole_measured))
    equal = [one for remaining, one in hits if remaining <= hits[0][0] + SAME_DEG]
    best = min(equal, key=tried.index)
    finding = Finding(
        best.cause,
        f"{best.size}; that explains {angle_text(error_deg)}, all but {angle_text(hits[0][0])}",
        tuple(f"{one.cause} ({one.size})" for one in equal if one is not best),
        best.next_step,
        is_gross=True,
    )
    return GrossCause(finding, errors_arcsec(mount_under(whole, best, orientation), horizon_to_sensor(best.mount)))


def left_with(
    raw: RawAttitudes, site: Site, mount: Mount, orientation: EarthOrientation, fast_s: float
) -> NDArray[np.float64]:
    """The errors (M, 3) that are left at a site when the host's clock is so fast: columns, rows, roll, in arcsec."""
    under = Hypothesis("", "", "", site, mount, fast_s)
    return errors_arcsec(mount_under(raw, under, orientation), horizon_to_sensor(mount))


def _scatter_arcsec(measured: NDArray[np.float64]) -> NDArray[np.float64]:
    """About the mount that fits the frames best."""
    off = errors_arcsec(measured, measured[central(measured)])
    return np.asarray(off - off.mean(axis=0))


def _follows_the_sky(raw: RawAttitudes, apart_deg: float) -> GrossCause | None:
    """A mount that is driven, or answers that stand still; any other move is left to gse.diagnosis.fine_causes."""
    at = central(raw.icrs_to_sensor)
    on_sky = np.degrees(np.linalg.norm(small_rotations(raw.icrs_to_sensor, raw.icrs_to_sensor[at]), axis=1))
    if float(np.median(on_sky)) > _HIT_SHARE * apart_deg:
        return None
    finding = Finding(
        "mount follows the sky",
        f"the sensor sees the same stars all the time, while the ground turned by {angle_text(apart_deg)}",
        ("answers of the sensor that stand still",),
        "stop the drive of the mount: a test needs a mount that is fixed to the ground",
        is_gross=True,
    )
    return GrossCause(finding, np.zeros((0, 3)))
