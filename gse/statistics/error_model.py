"""A model of a series of errors: white noise beside noise of exponential correlation.

Means over short blocks of the series are taken as a constant plus a slow part, whose correlation falls as exp(-t / tau)
(the process of Uhlenbeck & Ornstein 1930, Phys. Rev. 36, 823), plus white noise. The likelihood is exact, by a Kalman
filter over the blocks (Jones 1980, Technometrics 22, 389), so that a gap only lets the slow part forget more: the
blocks on both sides of it are pieces of one process. It is taken on a grid of tau and of the strength of the slow part;
constant, slope and scale are integrated out (flat priors, for the scale flat in its logarithm). What is left is a
weight for each cell of the grid. Averaged over the cells, the error of the mean, and of the slope, is a mixture of
Student t distributions: a session of a few correlation times cannot know its correlation, and gets wide bounds.

A drift, a swing, a slip or a step of the session is slow, too, and is followed by the slow part: its size is in the
scatter of the blocks, and what it leaves open is in the weights of long correlation times.

Nothing is drawn at random: where the distribution of a figure is needed, it is taken over evenly spread points
(Roberts 2018, "The unreasonable effectiveness of quasirandom sequences").
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from gse.process.jit import compiled, compiled_part
from gse.values.matrices import product

# A mixture of Student t distributions about zero: the error of an estimate whose scale is known by its likelihood.

_MAX_STEPS = 100
_ACCURACY = 1e-6


@dataclass(frozen=True, slots=True)
class MixedStudent:
    """A symmetric error about zero: weights and scales (G,) of Student t distributions, freedom of 2 at least."""

    weights: NDArray[np.float64]
    scales: NDArray[np.float64]
    freedom: int

    def half_width(self, probability: float) -> float:
        """The error that is not exceeded, sign counted, with this probability above 0.5."""
        quantile = float(stdtrit(self.freedom, probability))
        least, start = float(self.scales.min()) * quantile, float(product(self.weights, self.scales)) * quantile
        return _quantile(self.weights, self.scales, self.freedom, probability, least, start)

    @property
    def standard(self) -> float:
        """The standard error without the uncertainty of it: the weighted median of the scales."""
        order = np.argsort(self.scales)
        share = np.cumsum(self.weights[order])
        return float(self.scales[order][np.searchsorted(share, 0.5)])


@compiled
def _quantile(
    weights: NDArray[np.float64],
    scales: NDArray[np.float64],
    freedom: int,
    probability: float,
    least: float,
    start: float,
) -> float:
    """By Newton's steps. Above zero the distribution is concave: they end below from above, and stay below."""
    error = start
    peak = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2)) / math.sqrt(math.pi * freedom)
    for _ in range(_MAX_STEPS):
        cosines = 1 / np.sqrt(1 + (error / scales) ** 2 / freedom)
        inside = _half_inside(cosines, freedom)
        missing, density = probability - 0.5, 0.0
        for shape in range(len(scales)):
            missing -= weights[shape] * inside[shape]
            density += weights[shape] / scales[shape] * cosines[shape] ** (freedom + 1)
        step = missing / (peak * density)
        error = max(error + step, least)
        if abs(step) < _ACCURACY * error:
            break
    return error


@compiled_part
def _half_inside(cosines: NDArray[np.float64], freedom: int) -> NDArray[np.float64]:
    """P(0 < T < t) for cosine = 1 / sqrt(1 + t^2 / freedom): Abramowitz & Stegun, 26.7.3 (odd) and 26.7.4 (even).

    Term by term for all of them, which the processor does several at once.
    """
    sines = np.sqrt(1 - cosines**2)
    is_odd = freedom % 2
    squares = cosines**2
    terms = cosines.copy() if is_odd else np.ones(len(cosines))
    totals = np.zeros(len(cosines))
    for below in range(2 + is_odd, freedom + 1, 2):
        for shape in range(len(cosines)):
            totals[shape] += terms[shape]
            terms[shape] *= squares[shape] * (below - 1) / below
    return (np.arccos(cosines) + sines * totals) / math.pi if is_odd else sines * totals / 2


# Blocks of a series, and the likelihood of their means.

BLOCKS = 240
"""Most blocks: the shortest correlation time that is told from white noise is a two-hundredth of the session."""
_TAUS = np.geomspace(1 / 200, 15.0, 16)
"""Correlation times, in the length of the session. Longer ones look like one another."""
SESSION = 1.0
"""The correlation time of the slowest part that enters U: of what is slower, the session shows no more."""
_ROUGHNESSES = np.geomspace(1e-4, 1e3, 11)
"""Variances of the slow part's change from block to block, in that of the white noise of a block."""
_WHITE_PRIOR = 0.5
_TAU_POWER, _BEYOND_POWER = -0.75, 0.5
"""The prior of a correlation time goes as its power: half way between even in tau's logarithm, and in 1 / tau."""
_SHOWN = 10.0
"""A part that is slower than the session is not supposed where its change in the session would be hidden by the white
noise: least variance of that change, in that of a block."""
_FLOOR = 1e-2
"""Least variance of the blocks, in that which white noise of the scatter within them would leave: a pattern may cancel
in each block."""
_ROUNDING = 1e-12
_NEGLIGIBLE = 1e-9
"""Cells of less weight, in that of the likeliest, are left out."""
_POINTS = 600
_PLASTIC = 1.1673039782614187
"""The root of x^5 = x + 1: its negative powers spread points evenly in four dimensions."""


@dataclass(frozen=True, slots=True)
class _ModelGrid:
    """The grid: correlation times, strengths and logarithms of the prior (G,). The first cell is white noise alone."""

    taus: NDArray[np.float64]
    strengths: NDArray[np.float64]
    log_prior: NDArray[np.float64]


@functools.lru_cache(maxsize=16)
def _cells(blocks: int) -> _ModelGrid:
    taus, roughnesses = np.repeat(_TAUS, len(_ROUGHNESSES)), np.tile(_ROUGHNESSES, len(_TAUS))
    prior = np.minimum(taus, SESSION) ** _TAU_POWER * np.maximum(taus, SESSION) ** _BEYOND_POWER
    prior *= (1 - _WHITE_PRIOR) / prior[taus <= SESSION].sum()
    kept = (taus <= SESSION) | (roughnesses * blocks >= _SHOWN)
    taus, roughnesses, prior = np.append(SESSION, taus[kept]), np.append(0.0, roughnesses[kept]), prior[kept]
    strengths = roughnesses / -2 / np.expm1(-1 / (blocks * taus))
    return _ModelGrid(taus, strengths, np.log(np.append(_WHITE_PRIOR, prior)))


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """The cells (G,) of the grid for one series.

    ``log_weights`` are the logarithms of their weights with a constant, and ``log_sloped`` with a slope as well;
    ``means`` the estimates of the constant, ``variances`` of the white noise of a block, ``of_mean`` and ``of_slope``
    the variances of constant and slope in it, ``blocks`` the number of blocks.
    ``slopes`` are estimates of the slope. ``within`` is the sum of squares of the values about their blocks' means,
    with ``freedom_within``.
    """

    log_weights: NDArray[np.float64]
    log_sloped: NDArray[np.float64]
    means: NDArray[np.float64]
    slopes: NDArray[np.float64]
    variances: NDArray[np.float64]
    sloped_variances: NDArray[np.float64]
    of_mean: NDArray[np.float64]
    of_slope: NDArray[np.float64]
    blocks: int
    frames: int
    within: float

    def weights(self, longest: float = math.inf) -> NDArray[np.float64]:
        """Of the cells, of correlation times up to ``longest``."""
        return _normalised(self.log_weights, self.blocks, longest)

    def mean_error(self, longest: float = math.inf) -> MixedStudent:
        """The error of the mean."""
        return _mixed(self.weights(longest), self.variances * self.of_mean, self.blocks - 1)

    def slope_error(self, longest: float = math.inf) -> MixedStudent:
        """The error of the slope, per second."""
        weights = _normalised(self.log_sloped, self.blocks, longest)
        return _mixed(weights, self.sloped_variances * self.of_slope, self.blocks - 2)

    def points(self, longest: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Constants and standard deviations (P,) of single values, evenly spread over what the series leaves open."""
        cell, normal, first, second = _points()
        reached = np.cumsum(self.weights(longest))
        cells = np.searchsorted(reached, cell * reached[-1])
        variances = self.variances[cells] / _chi_square(first, self.blocks - 1)
        means = self.means[cells] + normal * np.sqrt(variances * self.of_mean[cells])
        freedom = (self.frames - self.blocks) / max(self._frames_per_value / 2, 1.0)  # squares forget twice as fast
        within = self.within / self.frames / _chi_square(second, freedom) if freedom else 0.0
        return means, np.sqrt(variances * (1 + _cells(self.blocks).strengths[cells]) + within)

    @property
    def _frames_per_value(self) -> float:
        """Frames that one independent value takes within a block, by what they leave in its mean."""
        if not self.within:
            return 1.0
        of_mean = float((self.weights(SESSION) * self.variances).sum())
        return max(of_mean * self.frames / self.blocks / (self.within / self.frames), 1.0)

    @property
    def shape_number(self) -> float:
        """The number of independent values that would show the shape of the distribution as well.

        Where mean and variance are taken as they are seen, what is left of a share of values has the fourth power of
        the correlation, or less.
        """
        cells = _cells(self.blocks)
        slow = self.variances * cells.strengths
        share = slow / (slow + self.variances + self.within / self.frames)
        slowly = float((self.weights(SESSION) * share**4 * cells.taus / 2).sum())
        return 1 / (max(self._frames_per_value / 4, 1.0) / self.frames + slowly)


def _mixed(weights: NDArray[np.float64], variances: NDArray[np.float64], freedom: int) -> MixedStudent:
    kept = weights > 0
    return MixedStudent(weights[kept], np.sqrt(variances[kept]), freedom)


def _normalised(log_weights: NDArray[np.float64], blocks: int, longest: float) -> NDArray[np.float64]:
    weights = np.exp(log_weights - log_weights.max())
    weights[_cells(blocks).taus > longest] = 0.0
    weights[weights < _NEGLIGIBLE * weights.max()] = 0.0
    return np.asarray(weights / weights.sum())


@functools.cache
def _points() -> NDArray[np.float64]:
    """Evenly spread points: places between 0 and 1 (P,), and three normal quantities."""
    places = (0.5 + np.arange(1, _POINTS + 1) * (_PLASTIC ** -np.arange(1.0, 5.0))[:, None]) % 1
    return np.vstack([places[:1], ndtri(places[1:])])


def _chi_square(normal: NDArray[np.float64], freedom: float) -> NDArray[np.float64]:
    """Chi square over its freedom, by that of Wilson and Hilferty (1931, PNAS 17, 684)."""
    spread = 2 / (9 * freedom)
    return np.maximum(1 - spread + normal * math.sqrt(spread), _LEAST_ROOT) ** 3


_LEAST_ROOT = 0.05


def error_model(values: NDArray[np.float64], time_s: NDArray[np.float64] | None = None) -> ErrorModel:
    """Of values (M,), not all the same, M > 8, at instants (M,) in order, by default evenly spaced."""
    first, middles, length = _blocks(np.arange(len(values), dtype=np.float64) if time_s is None else time_s)
    counts = np.diff(first, append=len(values))
    centre = values.mean()
    sums = np.add.reduceat(values - centre, first)
    means = sums / counts
    within = max(float(np.square(values - centre).sum() - (sums * means).sum()), 0.0)
    of_white = counts.mean() / counts
    cells = _cells(len(first))
    found = _filtered(means, middles, of_white, cells.taus, cells.strengths)
    n = len(first)
    (yy, y1, yt, ones, one_t, tt), log_det = found[:6], found[6]
    least = np.maximum(_FLOOR * within / len(values) / counts.mean() * (n - 1), _ROUNDING * yy)
    squares = np.maximum(yy - y1**2 / ones, least)
    of_both = ones * tt - one_t**2
    slopes = (ones * yt - one_t * y1) / of_both
    sloped = np.maximum(yy - y1**2 / ones - slopes**2 * of_both / ones, least)
    prior = cells.log_prior - 0.5 * log_det
    # A slope hides long correlation: for its error all correlation times are as likely.
    even = -_TAU_POWER * np.log(np.minimum(cells.taus, SESSION))
    return ErrorModel(
        log_weights=prior - 0.5 * np.log(ones) - 0.5 * (n - 1) * np.log(squares),
        log_sloped=prior + even - 0.5 * np.log(of_both) - 0.5 * (n - 2) * np.log(sloped),
        means=y1 / ones + centre,
        slopes=slopes / length,
        variances=squares / (n - 1),
        sloped_variances=sloped / (n - 2),
        of_mean=1 / ones,
        of_slope=ones / of_both / length**2,
        blocks=n,
        frames=len(values),
        within=within,
    )


def _blocks(time_s: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64], float]:
    """First rows (B,) of the blocks, their middles (B,) in the length of the session, and it, its gaps not counted."""
    steps = np.diff(time_s)
    usual = float(np.percentile(steps, _USUAL)) or float(steps.mean())
    between = np.minimum(steps, _GAP_STEPS * usual)
    covered = float(between.sum() + between.mean())
    if len(time_s) <= BLOCKS:
        return np.arange(len(time_s)), (time_s - time_s[0]) / covered, covered
    block = np.floor((time_s - time_s[0] + between.mean() / 2) * (BLOCKS / covered))
    first = np.flatnonzero(np.diff(block, prepend=-1.0))
    last = np.append(first[1:], len(time_s)) - 1
    return first, (time_s[first] + time_s[last] - 2 * time_s[0]) / (2 * covered), covered


_USUAL, _GAP_STEPS = 95.0, 5.0
"""The percentile of the times between two values that is a usual one, though they come in bursts; and how many of these
are covered by two values at most: the rest is a gap."""


_SMALL = 1e-100
"""A product of weights below this, or above its inverse, is taken to its logarithm: seldom, which saves time."""


@compiled
def _filtered(
    means: NDArray[np.float64],
    middles: NDArray[np.float64],
    of_white: NDArray[np.float64],
    taus: NDArray[np.float64],
    strengths: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Products (6, G) of the whitened means (y), ones and middles (t), and the logarithm of the determinant, in rows.

    yy, y1, yt, 11, 1t, tt. The middles are counted from half of the session, so that ones and t are nearly independent.
    Cells stand in the inner loops, each with few arrays: so the processor takes several at once.
    """
    cells = len(taus)
    found, expected, new = np.zeros((7, cells)), np.zeros((3, cells)), np.zeros((3, cells))
    variance, kept, weight, gain = strengths.copy(), np.zeros(cells), np.zeros(cells), np.zeros(cells)
    factor, step = np.ones(cells), -1.0
    for block in range(len(means)):
        if block:
            further = middles[block] - middles[block - 1]
            if further != step:
                kept, step = np.exp(-further / taus), further
            variance = strengths + kept * kept * (variance - strengths)
        for cell in range(cells):
            weight[cell] = 1 / (variance[cell] + of_white[block])
            gain[cell] = variance[cell] * weight[cell]
            variance[cell] = gain[cell] * of_white[block]
            factor[cell] *= weight[cell]
        for cell in range(cells):
            if factor[cell] < _SMALL or factor[cell] > 1 / _SMALL:
                found[6, cell] -= math.log(factor[cell])
                factor[cell] = 1.0
        for column, value in enumerate((means[block], 1.0, middles[block] - 0.5)):
            for cell in range(cells):
                before = kept[cell] * expected[column, cell]
                new[column, cell] = value - before
                expected[column, cell] = before + gain[cell] * new[column, cell]
        row = 0
        for one in range(3):
            for other in range(one, 3):
                for cell in range(cells):
                    found[row, cell] += weight[cell] * new[one, cell] * new[other, cell]
                row += 1
    found[6] -= np.log(factor)
    return found
