"""The truth budget: how large each effect is this night, whether it was corrected, and what remains.

Sizes are found by leaving each correction out of the truth of this night and direction. What remains are bounds, so
that they are added plainly.
"""

import math
from dataclasses import dataclass

import numpy as np

from gse.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S, J2000_NS
from gse.instant import NS_PER_DAY
from gse.mount import Mount
from gse.site import Site
from gse.station.attitude_error import compare
from gse.truth.alignment import Alignment
from gse.truth.orientation import EarthOrientation
from gse.truth.sidereal import SiderealTruth

_MODEL_ARCSEC = 0.001
"""What a rigorous correction leaves: the celestial pole offsets (0.0005) and the cells of 300 s (0.0006)."""
_POLE_ERROR_ARCSEC = {"measured": 0.0005, "predicted": 0.02, "past the end": 0.6}
"""IERS Bulletin A, section predictions, up to a year; the whole of polar motion past the end."""
_VERTICAL_ARCSEC = 10.0
"""Deflection of the vertical in hills (GRAVSOFT and EGM2008 maps: below 10 arcsec but for high mountains)."""
_AIR_SHARE = 0.02
"""Refraction left by 5 hPa, 5 K and a model of the mean atmosphere."""
_PROPER_MOTION_ARCSEC_PER_YEAR = 0.26
"""Largest mean over a field of the brightest stars; typically 0.06."""
_PARALLAX_ARCSEC = 0.1
"""Mean over a field; the nearest star has 0.75."""
_JULIAN_YEAR_NS = 365.25 * NS_PER_DAY


@dataclass(frozen=True, slots=True)
class Term:
    """One effect: its size before correction, and what may remain of it in dRA* and dDE, in arcsec (inf: unknown)."""

    name: str
    size_arcsec: float
    corrected: bool
    ra_arcsec: float
    de_arcsec: float
    remark: str = ""


@dataclass(frozen=True, slots=True)
class TruthUncertaintyBudget:
    """All terms of a night; NaN sizes are not known."""

    terms: tuple[Term, ...]

    @property
    def ra_arcsec(self) -> float:
        """The sum of what remains in dRA*."""
        return sum(term.ra_arcsec for term in self.terms)

    @property
    def de_arcsec(self) -> float:
        """The sum of what remains in dDE."""
        return sum(term.de_arcsec for term in self.terms)

    def complaint(self, axis: str, limit_arcsec: float, share: float) -> str | None:
        """One line where what remains is above a limit / ``share``, with the terms that make most of it, else None."""
        remains = {term: term.ra_arcsec if axis == "dRA*" else term.de_arcsec for term in self.terms}
        total = sum(remains.values())
        if total * share <= limit_arcsec:
            return None
        large = sorted((term for term in remains if remains[term] >= total / 4), key=remains.__getitem__, reverse=True)
        parts = " and ".join(f"{term.name} leaves {_amount(remains[term])}" for term in large)
        whole = f" of {total:.1f} arcsec" if math.isfinite(total) else ""
        remark = f"; {large[0].remark}" if large[0].remark else ""
        allowed = f"a third of the limit is {limit_arcsec / share:.3g} arcsec"
        return f"truth is not good enough for {axis}: {parts}{whole}, and {allowed}{remark}"


def _amount(arcsec: float) -> str:
    return f"{arcsec:.1f}" if math.isfinite(arcsec) else "an unknown error"


@dataclass(frozen=True, slots=True)
class SessionFacts:
    """What the budget is made from; ``alignment`` where the mount was fitted on other frames of the session."""

    site: Site
    mount: Mount
    earth_orientation: EarthOrientation | None
    utc_ns: int
    clock_error_s: float
    catalog_epoch_jyear: float
    proper_motions: bool = False
    alignment: Alignment | None = None


def truth_budget(facts: SessionFacts) -> TruthUncertaintyBudget:
    """The budget of a night; without Earth orientation there is no truth, and one unknown term says so."""
    if facts.earth_orientation is None:
        remark = "see the events for why"
        return TruthUncertaintyBudget((Term("sidereal truth", math.inf, False, math.inf, math.inf, remark),))
    truth = SiderealTruth(facts.site, facts.earth_orientation)
    attitude = truth.attitude_true(facts.utc_ns, facts.mount)
    cos_de = math.cos(math.radians(attitude.de_deg))
    return TruthUncertaintyBudget(
        (
            *_frame_terms(facts, truth, cos_de),
            *_star_terms(facts, truth),
            _refraction(facts, truth),
            *_catalog_terms(facts),
            *_mount_terms(facts),
            _clock(facts, cos_de),
        )
    )


def _frame_terms(facts: SessionFacts, truth: SiderealTruth, cos_de: float) -> list[Term]:
    here = truth.earth_orientation.at(facts.utc_ns)
    pole = _POLE_ERROR_ARCSEC[here.kind] + _MODEL_ARCSEC
    ut1 = EARTH_RATE_ARCSEC_PER_S * cos_de * here.ut1_error_s + _MODEL_ARCSEC
    remains = {
        "precession": (_MODEL_ARCSEC, _MODEL_ARCSEC, ""),
        "nutation": (_MODEL_ARCSEC, _MODEL_ARCSEC, ""),
        "UT1": (ut1, 0.0, f"UT1 is {here.kind}; update it with: pip install -U astropy-iers-data"),
        "polar motion": (pole, pole, f"the pole is {here.kind}"),
        "geodetic latitude": (0.0, 0.0, ""),
    }
    full = truth.attitude_true(facts.utc_ns, facts.mount)
    terms = []
    for name, (ra, de, remark) in remains.items():
        without = SiderealTruth(facts.site, truth.earth_orientation, {name}).attitude_true(facts.utc_ns, facts.mount)
        error = compare(without, full)
        terms.append(Term(name, math.hypot(error.d_ra_cosde_arcsec, error.d_de_arcsec), True, ra, de, remark))
    return terms


def _star_terms(facts: SessionFacts, truth: SiderealTruth) -> list[Term]:
    star = truth.attitude_true(facts.utc_ns, facts.mount).boresight_icrs[None]
    seen = truth.apparent(star, facts.utc_ns)
    terms = []
    for name in ("annual aberration", "diurnal aberration", "light deflection"):
        without = SiderealTruth(facts.site, truth.earth_orientation, {name}).apparent(star, facts.utc_ns)
        size = float(np.linalg.norm(without - seen)) * ARCSEC_PER_RAD
        terms.append(Term(name, size, True, _MODEL_ARCSEC, _MODEL_ARCSEC))
    return terms


def _refraction(facts: SessionFacts, truth: SiderealTruth) -> Term:
    zenith_distance = math.radians(90 - facts.mount.altitude_deg)
    size = truth.refraction.bend_rad(zenith_distance) * ARCSEC_PER_RAD
    remains = _AIR_SHARE * size
    return Term("refraction", size, True, remains, remains, "measure pressure and temperature at the mount")


def _catalog_terms(facts: SessionFacts) -> list[Term]:
    years = abs(2000 + (facts.utc_ns - J2000_NS) / _JULIAN_YEAR_NS - facts.catalog_epoch_jyear)
    moved = _PROPER_MOTION_ARCSEC_PER_YEAR * years
    remains = 0.02 * moved if facts.proper_motions else moved
    remark = f"{years:.0f} years from the catalogue's epoch; use a catalogue with proper motions"
    return [
        Term("proper motion", moved, facts.proper_motions, remains, remains, "" if facts.proper_motions else remark),
        Term("parallax", _PARALLAX_ARCSEC, False, _PARALLAX_ARCSEC, _PARALLAX_ARCSEC),
    ]


def _mount_terms(facts: SessionFacts) -> list[Term]:
    """A fitted mount has the deflection of the vertical in it; a stated one has not."""
    if facts.alignment is None:
        remark = "fit the mount with: mount: {align: first 60 s}"
        return [Term("deflection of the vertical", math.nan, False, _VERTICAL_ARCSEC, _VERTICAL_ARCSEC, remark)]
    x, y, _ = facts.alignment.sigma_arcsec
    remains = 3 * math.hypot(x, y)
    remains = remains if math.isfinite(remains) else math.inf
    return [
        Term("deflection of the vertical", math.nan, True, 0.0, 0.0, "absorbed by the alignment"),
        Term("alignment", math.nan, True, remains, remains, "fit the mount on more frames"),
    ]


def _clock(facts: SessionFacts, cos_de: float) -> Term:
    """A constant clock error cannot be told from the mount's hour angle, so that an alignment absorbs it too."""
    size = EARTH_RATE_ARCSEC_PER_S * cos_de * facts.clock_error_s
    remark = "synchronise the clock, or state its error if it was measured: --clock-error 0.1s"
    return Term("clock", size, False, size, 0.0, remark)
