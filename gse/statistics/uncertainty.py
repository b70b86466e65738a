"""Uncertainty the way of the GUM: terms with their evidence, combined and expanded.

Standard uncertainties combine as the root of the sum of their squares (JCGM 100, 5.1). The expanded uncertainty is the
half-width that holds the sum of all terms with 95 %: it is taken from the distribution of the sum (JCGM 101), here by
numerical convolution instead of draws, so that one large rectangular term gives k 1.65 and not 1.96, and the same input
gives the same bytes. All terms are symmetric about 0.
"""

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, stdtr

from gse.values.axis import AXES, Axis

COVERAGE = 0.95
TO_STANDARD = 1 / 1.959964
"""From the half-width of a 95 % interval to a standard uncertainty, of a normal distribution."""
_HALF_GRID = 2048
_NORMAL_REACH, _STUDENT_REACH = 7.0, 40.0
"""In standard uncertainties: beyond lies 1e-11 of a normal distribution, 0.001 of Student's of 2 degrees of freedom."""


class Distribution(StrEnum):
    """What is known of an error: a normal one, no more than its bounds, or the mean of a few readings."""

    NORMAL = "normal"
    RECTANGULAR = "rectangular"
    STUDENT = "t"


@dataclass(frozen=True, slots=True)
class Term:
    """One input of the truth: how well it is known, and what that leaves open in dRA*, dDE and roll.

    It has the standard uncertainty ``standard`` in ``unit``; ``ra_arcsec``, ``de_arcsec`` and ``roll_arcsec``
    are the standard uncertainties that follow (inf: unknown), so that their quotients with ``standard`` are the
    sensitivities. ``size_arcsec`` is the whole effect before correction (NaN: not known), ``evidence`` begins with the
    GUM's type A or B. ``common`` errors are the same in all frames, others change with the stars in the field.
    ``absorbed`` terms are part of a mount that was fitted on the same sky: they leave nothing. ``explanation`` says in
    a line why the number is that, ``remedy`` what would make it smaller.
    """

    name: str
    standard: float
    unit: str
    ra_arcsec: float
    de_arcsec: float
    roll_arcsec: float
    evidence: str
    explanation: str
    remedy: str
    distribution: Distribution = Distribution.NORMAL
    degrees_of_freedom: float = math.inf
    size_arcsec: float = math.nan
    corrected: bool = True
    common: bool = True
    absorbed: bool = False

    def of(self, axis: Axis) -> float:
        """The standard uncertainty on an axis of AXES."""
        return (self.ra_arcsec, self.de_arcsec, self.roll_arcsec)[AXES.index(axis)]


@dataclass(frozen=True, slots=True)
class AxisUncertainty:
    """What all terms together leave open on one axis, in arcsec; ``known`` is false where a term is unknown (inf).

    ``standard`` is the combined standard uncertainty, of which ``common`` is the same in all frames and ``varying``
    changes with the field. ``expanded`` is the half-width U that holds the truth with 95 %, ``k`` = U / standard, and
    ``one_sided`` the bound that the truth exceeds with 5 %.
    """

    standard_arcsec: float
    common_arcsec: float
    varying_arcsec: float
    expanded_arcsec: float
    k: float
    one_sided_arcsec: float
    known: bool


def combined(terms: Iterable[Term], axis: Axis) -> AxisUncertainty:
    """The terms on one axis, combined and expanded."""
    terms = [term for term in terms if term.of(axis) > 0]
    common = math.hypot(*(term.of(axis) for term in terms if term.common))
    varying = math.hypot(*(term.of(axis) for term in terms if not term.common))
    standard = math.hypot(common, varying)
    if not math.isfinite(standard):
        return AxisUncertainty(math.inf, common, varying, math.inf, math.nan, math.inf, known=False)
    parts = tuple((term.of(axis), term.distribution, term.degrees_of_freedom) for term in terms)
    expanded, one_sided = half_width(parts, COVERAGE), half_width(parts, 2 * COVERAGE - 1)
    k = expanded / standard if standard else math.nan
    return AxisUncertainty(standard, common, varying, expanded, k, one_sided, known=True)


@functools.lru_cache(maxsize=64)
def half_width(parts: tuple[tuple[float, Distribution, float], ...], coverage: float) -> float:
    """The half-width that holds a sum of independent errors with probability ``coverage``.

    Each part is a standard uncertainty, its distribution and its degrees of freedom (of Student's distribution, whose
    scale the standard uncertainty then is).
    """
    normal = math.hypot(*(standard for standard, kind, _ in parts if kind is Distribution.NORMAL))
    others = [part for part in parts if part[1] is not Distribution.NORMAL]
    if not others:
        return normal * float(ndtri((1 + coverage) / 2))
    pieces = [(normal, Distribution.NORMAL, math.inf), *others] if normal else others
    step = sum(_reach(*piece) for piece in pieces) / _HALF_GRID
    # A distribution that is even has a real transform.
    spectra = [np.fft.rfft(np.fft.ifftshift(_masses(step, *piece))).real for piece in pieces]
    spectrum = np.prod(spectra, axis=0)
    masses = np.asarray(np.fft.fftshift(np.fft.irfft(spectrum, 4 * _HALF_GRID))[2 * _HALF_GRID :], dtype=np.float64)
    inside = 2 * np.cumsum(masses) - masses[0]  # within (place + 1/2) steps
    return float(np.interp(coverage * inside[-1], inside, (np.arange(len(inside)) + 0.5) * step))


def _reach(standard: float, kind: Distribution, freedom: float) -> float:
    if kind is Distribution.RECTANGULAR:
        return math.sqrt(3) * standard
    return standard * (_STUDENT_REACH if kind is Distribution.STUDENT and freedom < 30 else _NORMAL_REACH)


def _masses(step: float, standard: float, kind: Distribution, freedom: float) -> NDArray[np.float64]:
    """Probability in each of 4 x 2048 cells of width ``step`` about 0."""
    edges = (np.arange(4 * _HALF_GRID + 1) - 2 * _HALF_GRID - 0.5) * step / standard
    below: NDArray[np.floating]
    if kind is Distribution.RECTANGULAR:
        below = np.clip((edges / math.sqrt(3) + 1) / 2, 0, 1)
    elif kind is Distribution.STUDENT and math.isfinite(freedom):
        below = stdtr(freedom, edges)
    else:
        below = ndtr(edges)
    return np.asarray(np.diff(below), dtype=np.float64)
