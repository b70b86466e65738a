"""Level 2 of the LAPAN paper, eq 2-6: the largest group of matched objects that fit each other pairwise.

A candidate is an object with the star that it may be. Two candidates agree when they name different objects and
different stars, and the stars are as far apart as the objects. The agreements of a candidate are the bits of one 64-bit
word, hence the limit on their number.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gse.process.jit import compiled, compiled_part

MOST_CANDIDATES = 64
"""A true star of a mean field has some 25; of more, the most distant from the alpha star are excluded."""

_ROUNDING_RAD = 1e-6
"""A distance in whole microradians is within this of the exact one: only that near a limit is it worked out."""

_STAR_BITS = 24
_NONE = np.uint64(0)
_ONE = np.uint64(1)
_Row = int | np.uint64


@compiled_part
def candidate_of(row: int, star: int) -> np.uint32:
    """An object and the star that it may be in one word: a panorama has fewer objects than 256."""
    return np.uint32(row << _STAR_BITS | star)


@compiled
def object_of(candidate: np.uint32) -> np.uint64:
    """The object of a candidate."""
    return np.uint64(candidate >> np.uint32(_STAR_BITS))


@compiled
def star_of(candidate: np.uint32) -> np.uint64:
    """The star of a candidate."""
    return np.uint64(candidate & np.uint32((1 << _STAR_BITS) - 1))


class Separations(NamedTuple):
    """Cosine and sine (N, N) of the angle between each two of N objects."""

    cosine: NDArray[np.float64]
    sine: NDArray[np.float64]


@compiled
def separations(directions: NDArray[np.float64]) -> Separations:
    """The angles between each two of N directions (N, 3)."""
    cosine, sine = np.empty((len(directions), len(directions))), np.empty((len(directions), len(directions)))
    for i in range(len(directions)):
        for j in range(i, len(directions)):
            c, s = _cosine_sine(directions, i, j)
            cosine[i, j] = cosine[j, i] = c
            sine[i, j] = sine[j, i] = s
    return Separations(cosine, sine)


@compiled_part
def _cosine_sine(vectors: NDArray[np.float64], a: _Row, b: _Row) -> tuple[float, float]:
    ax, ay, az = vectors[a, 0], vectors[a, 1], vectors[a, 2]
    bx, by, bz = vectors[b, 0], vectors[b, 1], vectors[b, 2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return ax * bx + ay * by + az * bz, math.sqrt(x * x + y * y + z * z)


@compiled_part
def angle_urad(cosine: float, sine: float) -> float:
    """The angle in microradians."""
    return 1e6 * math.atan2(sine, cosine)


class Window(NamedTuple):
    """Limits on the cosine of two stars that fit two objects: outside ``far``..``near`` they do not fit, inside
    ``surely_far``..``surely_near`` they do, and between these their whole microradians decide."""

    far: float
    surely_far: float
    surely_near: float
    near: float


@compiled_part
def window(cosine: float, sine: float, tolerance_urad: float) -> Window:
    """The window of two objects with this cosine and sine of the angle between them."""
    # cos(d + t) and cos(d - t) by the sum formula, with cos t = 1 - t^2 / 2 and sin t = t: three multiplications for a
    # pair of objects, and then a pair of stars needs no angle, only its dot product. The margin covers what the series
    # leaves out and the rounding of the paper's table to whole microradians.
    t = 1e-6 * tolerance_urad
    far = cosine * (1.0 - 0.5 * t * t) - sine * t
    near = cosine * (1.0 - 0.5 * t * t) + sine * t
    margin = _ROUNDING_RAD * (sine + t) + t * t * t + 1e-12
    # Objects closer than two tolerances: the cosine is flat there and separates nothing, so whole microradians decide.
    if sine > 2.0 * t:
        return Window(far - margin, far + margin, near - margin, near + margin)
    return Window(far - margin, np.inf, np.inf, np.inf)


@compiled_part
def stars_fit(icrs: NDArray[np.float64], a: int, b: int, cosine: float, sine: float, tolerance_urad: float) -> bool:
    """Whether stars a and b, by their whole microradians, fit two objects: |d_stars - d_objects| < tolerance.

    ``cosine`` and ``sine`` are those of the angle between the objects.
    """
    dot = _dot(icrs, a, b)
    gate = window(cosine, sine, tolerance_urad)
    if dot < gate.far or dot > gate.near:
        return False
    return gate.surely_far < dot < gate.surely_near or _fits_exactly(icrs, a, b, cosine, sine, tolerance_urad)


@compiled_part
def _dot(vectors: NDArray[np.float64], a: _Row, b: _Row) -> float:
    ax, ay, az = vectors[a, 0], vectors[a, 1], vectors[a, 2]
    cosine: float = ax * vectors[b, 0] + ay * vectors[b, 1] + az * vectors[b, 2]
    return cosine


@compiled_part
def _fits_exactly(
    icrs: NDArray[np.float64], a: _Row, b: _Row, cosine: float, sine: float, tolerance_urad: float
) -> bool:
    whole = np.rint(angle_urad(*_cosine_sine(icrs, a, b)))
    return bool(abs(whole - angle_urad(cosine, sine)) < tolerance_urad)


@compiled_part
def windows(angles: Separations, tolerance_urad: float) -> NDArray[np.float64]:
    """The windows (4, N, N) of each two of N objects; nothing fits an object and itself."""
    count = len(angles.cosine)
    of_pairs = np.empty((4, count, count))
    for p in range(count):
        for q in range(p):
            gate = window(angles.cosine[p, q], angles.sine[p, q], tolerance_urad)
            for k in range(4):
                of_pairs[k, p, q] = of_pairs[k, q, p] = gate[k]
        of_pairs[:, p, p] = np.inf
    return of_pairs


@compiled_part
def agreements(
    candidates: NDArray[np.uint32],
    icrs: NDArray[np.float64],
    angles: Separations,
    gates: NDArray[np.float64],
    tolerance_urad: float,
) -> NDArray[np.uint64]:
    """For each of the candidates the bits of those that it agrees with; ``gates`` are the windows."""
    agrees = np.zeros(len(candidates), np.uint64)
    for i in range(len(candidates)):
        p, a = object_of(candidates[i]), star_of(candidates[i])
        for j in range(i):
            q, b = object_of(candidates[j]), star_of(candidates[j])
            dot = _dot(icrs, a, b)
            if dot < gates[0, p, q] or dot > gates[3, p, q] or a == b:
                continue
            if gates[1, p, q] < dot < gates[2, p, q] or _fits_exactly(
                icrs, a, b, angles.cosine[p, q], angles.sine[p, q], tolerance_urad
            ):
                agrees[i] |= _ONE << np.uint64(j)
                agrees[j] |= _ONE << np.uint64(i)
    return agrees


@compiled_part
def pigeonhole_bound(
    candidates: NDArray[np.uint32],
    row: np.uint64,
    count: int,
    icrs: NDArray[np.float64],
    gates: NDArray[np.float64],
    fewest: int,
) -> bool:
    """Whether no ``fewest`` of the first ``count`` candidates of a row can agree, which a few of their pairs may show.

    The candidates are dealt round to ``fewest`` - 1 hands. Of any ``fewest``, two are in one hand: where no two in any
    hand agree, there is no such group. A candidate of chance mostly ends here, after a tenth of its pairs. No branch
    on a pair, which no processor would predict.
    """
    # With fewest = 4, three hands: candidates 0, 3, 6 .. in the first, 1, 4, 7 .. in the second, 2, 5, 8 .. in the
    # third. Two of a hand are a multiple of three apart, so ``apart`` runs over 3, 6, 9 ..
    hands, some = np.uint64(max(fewest - 1, 1)), False
    for apart in range(hands, np.uint64(count), hands):
        for i in range(apart, np.uint64(count)):
            one, other = candidates[row, i], candidates[row, i - apart]
            p, q, a, b = object_of(one), object_of(other), star_of(one), star_of(other)
            dot = icrs[a, 0] * icrs[b, 0] + icrs[a, 1] * icrs[b, 1] + icrs[a, 2] * icrs[b, 2]
            some |= (gates[0, p, q] <= dot) & (dot <= gates[3, p, q])
        if some:
            return False
    return True


@compiled_part
def largest_group(agrees: NDArray[np.uint64], fewest: int) -> np.uint64:
    """The largest group found of candidates that all agree, as bits; 0 where none has ``fewest`` members.

    ``agrees`` (N,) are the bits of those that a candidate agrees with. From each candidate, those with most agreements
    first, the group grows by the one that keeps most others in play, the first of equals. Candidates that cannot be
    in a group larger than the largest so far are dropped.
    """
    # The largest clique of a graph with at most 64 nodes, by greed: to be exact would take a search without a bound,
    # and a true group stands out by far. Rows of bits make "agrees with all of these" one AND.
    best, size = _NONE, fewest - 1
    alive = _able(agrees, _all(len(agrees)), size + 1)
    untried = alive
    while untried != _NONE:
        seed = _most_agreements(agrees, untried, alive)
        untried &= ~(_ONE << np.uint64(seed))
        group = _grown(agrees, seed, alive)
        if bits(group) > size:
            best, size = group, bits(group)
            alive = _able(agrees, alive, size + 1)
            untried &= alive
    return best


@compiled_part
def no_group(agrees: NDArray[np.uint64], fewest: int) -> bool:
    """Whether it is proven that no ``fewest`` candidates agree: ``largest_group`` may miss one."""
    return bool(_able(agrees, _all(len(agrees)), fewest) == _NONE)


@compiled_part
def _all(count: int) -> np.uint64:
    return ~_NONE >> np.uint64(MOST_CANDIDATES - count) if count else _NONE


@compiled_part
def _able(agrees: NDArray[np.uint64], alive: np.uint64, fewest: int) -> np.uint64:
    """Those that can be in a group of ``fewest``: each agrees with enough others that can."""
    # To drop one may leave another with too few, so again until nothing changes: the k-core of the graph.
    before = _NONE
    while alive != before:
        before = alive
        for i in range(len(agrees)):
            if bits(agrees[i] & alive) + 1 < fewest:
                alive &= ~(_ONE << np.uint64(i))
    return alive


@compiled_part
def _grown(agrees: NDArray[np.uint64], seed: int, alive: np.uint64) -> np.uint64:
    group = _ONE << np.uint64(seed)
    able = agrees[seed] & alive
    while able != _NONE:
        member = _most_agreements(agrees, able, able)
        group |= _ONE << np.uint64(member)
        able &= agrees[member]
    return group


@compiled_part
def _most_agreements(agrees: NDArray[np.uint64], among: np.uint64, counted: np.uint64) -> int:
    """Of the candidates ``among``, the first of those that agree with most of ``counted``."""
    best, most = -1, -1
    for i in range(len(agrees)):
        if among & (_ONE << np.uint64(i)) != _NONE:
            degree = bits(agrees[i] & counted)
            if degree > most:
                best, most = i, degree
    return best


@compiled_part
def bits(word: np.uint64) -> int:
    """How many bits are set."""
    count = 0
    while word != _NONE:
        word &= word - _ONE
        count += 1
    return count
