"""The truth budget: how large each effect is this night, whether it was corrected, and what remains."""

import math
from dataclasses import dataclass

from gse.config import Limits
from gse.night import Night

_ARCSEC_PER_S = 15.041


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
class TruthBudget:
    """All terms; ``ra_arcsec`` and ``de_arcsec`` are the plain sums of what remains: the terms are bounds."""

    terms: tuple[Term, ...]
    ra_arcsec: float
    de_arcsec: float

    def complaints(self, limits: Limits, share: float) -> list[str]:
        """One line per axis whose remains are above its limit / ``share``, with the largest term named."""
        lines = []
        for axis, total, limit, key in (
            ("dRA*", self.ra_arcsec, limits.d_ra_cosde_arcsec, "ra_arcsec"),
            ("dDE", self.de_arcsec, limits.d_de_arcsec, "de_arcsec"),
        ):
            if total * share > limit:
                largest = max(self.terms, key=lambda term: float(getattr(term, key)))
                lines.append(
                    f"truth is not good enough for {axis}: {largest.name} leaves "
                    f"{_text(float(getattr(largest, key)))} of {_text(total)}, the limit is {limit:g}; {largest.remark}"
                )
        return lines


def truth_budget(night: Night) -> TruthBudget:
    """The budget of a night."""
    terms = (_clock(night),)
    return TruthBudget(terms, sum(term.ra_arcsec for term in terms), sum(term.de_arcsec for term in terms))


def _clock(night: Night) -> Term:
    frames = night.frames.columns
    cos_de = math.cos(math.radians(float(frames["de_true_deg"][0]))) if len(frames) else 1.0
    cos_de = 1.0 if math.isnan(cos_de) else cos_de
    error_s = clock_error_s(night)
    remark = "state its error if you have measured it: --clock-error 0.1s"
    return Term("clock", math.inf, False, _ARCSEC_PER_S * cos_de * error_s, 0.0, remark)


def clock_error_s(night: Night) -> float:
    """Bound on the error of the host's clock over a session: inf where it is unknown or was unsynchronised."""
    if not night.clock or not all(reading.synchronised for reading in night.clock):
        return math.inf
    return max(abs(reading.offset_s) + reading.error_bound_s for reading in night.clock)


def _text(arcsec: float) -> str:
    return f"{arcsec:.1f} arcsec" if math.isfinite(arcsec) else "an unknown error"
