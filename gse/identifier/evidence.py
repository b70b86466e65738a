"""Evidence for an attitude against chance: the factor by which it explains a panorama better than random objects.

The Bayes factor of "this attitude" against "all objects are random": under chance, objects are uniform over the field
and their brightness has nothing to do with their place. The factor is averaged over what is not known (direction of
the boresight over the whole sky, roll, noise, how deep the sensor sees, how many stars it misses and objects it makes
up), so its mean over random panoramas is at most 1, and by Markov's inequality a random panorama reaches a factor of x
with a probability of at most 1 / x. No count of hypotheses tried is needed: the search over the sky is paid by the
volume of the attitude's covariance in the volume of all rotations, 8 pi^2.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gse.identifier.robust_tables import SkyTables
from gse.identifier.verify import Attempt, Noise, Objects, grow, squared_residuals, with_noise
from gse.process.jit import compiled_part

CHANCE_OF_EVIDENCE = 0.05
"""A random panorama reaches a Bayes factor of x with a probability of at most this over x. Markov's inequality gives 1,
but the mean of the factor is made of many orders of magnitude: measured on random panoramas of 3 and 4 objects it is
0.004 to 0.01 for x from 0.01 to 100, with brightness known too, and less where objects are more."""

LOG_ACCEPTED = math.log(CHANCE_OF_EVIDENCE / 1e-3)
"""Evidence of an answer: a false match probability of 1e-3."""

LOG_UNAMBIGUOUS = math.log(100.0)
"""The best attitude must explain the panorama so many times better than any other."""

LOG_STRONG = math.log(1e5)
"""Evidence that ends a search: another attitude comes near it with a probability of 1e-3, and is worse even then."""

TRUSTED_SCALE_SIGMA = 2e-4
"""Spread of the scale of a camera that is calibrated, tried where the wider one leaves too little evidence."""

_MOST_OF_TRUST = 15.0
"""Evidence that the trusted scale cannot add: its prior is 12 times narrower, a factor of 2.5 in the logarithm."""

_ODD_BRIGHTNESS = 0.1
"""Share of stars whose brightness is any at all: variable stars, clouds, saturation."""

_ANY_MAGNITUDE = 0.4
"""Density of the magnitude of a random object, per magnitude: of one spread evenly over 2.5."""

_SEEN = 0.9
"""Share of the stars brighter than the panorama's limit that are seen."""

_BLUR = 0.5
"""The limit is blurred by this part of the errors of brightness (the width of an algebraic sigmoid, not a normal's)."""

_LIMIT_WITHIN = 0.02
"""The magnitude of the limit is found so well, which is a tenth of the least blur."""

_LEAST_COMPLETENESS = 4.0
"""The completeness of a field costs less than this for each matched star: it is not computed where it cannot matter."""

_SIGMA_FACTOR = 1.7


@compiled_part
def weigh(tables: SkyTables, objects: Objects, attempt: Attempt, noise: Noise) -> float:
    """Grow an attempt from the matches it comes with; the logarithm of its Bayes factor.

    Weak evidence is weighed once more with a camera that is trusted: fewer unknowns explain few stars better.
    """
    best, scale_sigma = -np.inf, noise.scale_sigma
    scales = 2 if scale_sigma > TRUSTED_SCALE_SIGMA else 1
    for _ in range(scales):
        assumed = with_noise(noise, noise.sigma, scale_sigma)
        matched = grow(tables, objects, attempt, assumed)
        if matched == 0:
            break
        best = max(best, _log_evidence(tables, objects, attempt, assumed, matched))
        if best > LOG_STRONG or best < LOG_ACCEPTED - _MOST_OF_TRUST:
            break
        scale_sigma = TRUSTED_SCALE_SIGMA
    return best - math.log(scales)


@compiled_part
def _log_evidence(tables: SkyTables, objects: Objects, attempt: Attempt, noise: Noise, matched: int) -> float:
    """Logarithm of the Bayes factor of an attempt that has grown."""
    fields = len(attempt.rows)
    object_of, star_magnitude = np.empty(fields, dtype=np.int64), np.empty(fields)
    for f in range(fields):
        object_of[f] = -1
        star_magnitude[f] = tables.magnitude[attempt.rows[f]]
    for i in range(len(objects.uv)):
        if attempt.star_of[i] >= 0:
            object_of[attempt.star_of[i]] = i
    value = _log_geometry(matched, squared_residuals(tables, objects, attempt), attempt, noise, tables.field[5])
    value += _log_labels(star_magnitude, object_of, objects.magnitude, noise)
    lower_bound = value - _LEAST_COMPLETENESS * matched
    if lower_bound > 2.0 * LOG_STRONG:
        return lower_bound
    least_limit = -np.inf
    if not math.isnan(noise.zero_point):
        for magnitude in objects.magnitude:
            least_limit = max(least_limit, noise.zero_point + magnitude)
    return value + _log_completeness(
        star_magnitude, object_of, len(objects.uv), _BLUR * noise.magnitude_sigma, least_limit
    )


@compiled_part
def _log_geometry(matched: int, squares: float, attempt: Attempt, noise: Noise, area: float) -> float:
    """Logarithm of the geometric part of the Bayes factor, by Laplace's approximation around the fit.

    ``squares`` is the sum of squared residuals, ``area`` the field's on the tangent plane.
    """
    volume = 0.5 * _log_determinant(attempt.covariance) + 2.0 * math.log(2.0 * math.pi) - math.log(8.0 * math.pi**2)
    off = (attempt.scale[0] - 1.0) / noise.scale_sigma
    volume -= 0.5 * math.log(2.0 * math.pi) + math.log(noise.scale_sigma) + 0.5 * off * off
    best = -np.inf
    sigma = noise.smallest_sigma
    for _ in range(noise.sigma_steps):
        # Three angles shrink with the noise, the scale too unless its prior holds it: the smaller volume is taken.
        shrink = math.log(sigma / noise.sigma)
        shrink *= 4.0 if shrink < 0.0 else 3.0
        fit = matched * math.log(area / (2.0 * math.pi * sigma * sigma)) - squares / (2.0 * sigma * sigma)
        best = max(best, fit + volume + shrink)
        sigma *= _SIGMA_FACTOR
    return best - math.log(noise.sigma_steps)


@compiled_part
def _log_determinant(symmetric: NDArray[np.float64]) -> float:
    """Of a positive definite matrix (4, 4)."""
    a = np.empty((4, 4))
    for j in range(4):
        for k in range(4):
            a[j, k] = symmetric[j, k]
    total = 0.0
    for j in range(4):
        total += math.log(max(a[j, j], 1e-300))
        for i in range(j + 1, 4):
            factor = a[i, j] / a[j, j]
            for k in range(j + 1, 4):
                a[i, k] -= factor * a[j, k]
    return total


@compiled_part
def _log_labels(
    star_magnitude: NDArray[np.float64], object_of: NDArray[np.int64], magnitude: NDArray[np.float64], noise: Noise
) -> float:
    """Logarithm of how much better the brightness of the matched stars fits them than any objects of the panorama.

    ``object_of`` (F,) is the object of each star of the field or -1, ``magnitude`` (N,) that of the objects on the
    sensor's scale. That just these objects, among n, are the stars costs 1 / n, 1 / (n - 1), ...; then each star's
    brightness speaks for its object, against the others' where the zero point is not known, or against a magnitude that
    could be any.
    """
    n = len(magnitude)
    zero = noise.zero_point
    known = not math.isnan(zero)
    if not known:
        zero = _zero_point(star_magnitude, object_of, magnitude)
    free = np.empty(n, dtype=np.bool_)
    brightest = np.inf
    for i in range(n):
        free[i] = True
        brightest = min(brightest, magnitude[i])
    odd = _ODD_BRIGHTNESS * _ANY_MAGNITUDE * noise.magnitude_sigma
    total, left = 0.0, n
    for f in range(len(object_of)):
        if object_of[f] < 0:
            continue
        likelihoods, own = 0.0, 0.0
        for i in range(n):
            if free[i] and (i == object_of[f] or not known):
                error = zero + magnitude[i] - star_magnitude[f]
                if magnitude[i] == brightest and error > 0.0:
                    error = 0.0  # It may be saturated.
                likelihood = _likelihood(error / noise.magnitude_sigma) + odd
                likelihoods += likelihood
                own = likelihood if i == object_of[f] else own
        if known:
            likelihoods = left * _ANY_MAGNITUDE * noise.magnitude_sigma
        total += math.log(own / likelihoods)
        free[object_of[f]] = False
        left -= 1
    return total


@compiled_part
def _likelihood(error: float) -> float:
    """Of an error of brightness in sigmas: as a normal near the middle, with longer tails."""
    return 0.38 / (1.0 + 0.25 * error * error) ** 2


@compiled_part
def _zero_point(
    star_magnitude: NDArray[np.float64], object_of: NDArray[np.int64], magnitude: NDArray[np.float64]
) -> float:
    """The median difference of magnitude between stars and their objects."""
    differences = np.empty(len(magnitude))
    count = 0
    for f in range(len(object_of)):
        if object_of[f] >= 0:
            value = star_magnitude[f] - magnitude[object_of[f]]
            k = count
            while k > 0 and differences[k - 1] > value:
                differences[k] = differences[k - 1]
                k -= 1
            differences[k] = value
            count += 1
    return float(0.5 * (differences[count // 2] + differences[(count - 1) // 2]))


@compiled_part
def _log_completeness(
    star_magnitude: NDArray[np.float64], object_of: NDArray[np.int64], objects: int, blur: float, least_limit: float
) -> float:
    """Logarithm of the probability that the sensor sees just these stars of the field, and makes up the other objects.

    ``object_of`` (F,) is the object of each star of the field, brightest first, or -1. The number of
    stars among the objects is as likely any as another, but all of them stars is likeliest; given the number, stars are
    mostly seen down to the magnitude that lets one expect this number, and mostly not beyond, with a ``blur`` between.
    Where the zero point is known, this limit is no brighter than ``least_limit``, the faintest object, and a star that
    is seen has paid for its magnitude by its brightness already: an error made it bright enough. Minus infinity else.
    """
    matched = 0
    for f in range(len(object_of)):
        matched += object_of[f] >= 0
    limit = max(_limit_for(star_magnitude, matched, blur), least_limit)
    paid = least_limit > -np.inf
    likelihood, variance = 1.0, 0.0
    for f in range(len(object_of)):
        seen = _share_seen((limit - star_magnitude[f]) / blur)
        if object_of[f] < 0:
            likelihood *= 1.0 - seen
        else:
            likelihood *= _SEEN if paid else seen
        variance += seen * (1.0 - seen)
    value = math.log(likelihood) + 0.5 * math.log(1.0 + 2.0 * math.pi * variance)
    share = 0.5 + 0.5 / (objects + 1.0) if matched == objects else 0.5 / (objects + 1.0)
    return value + math.log(share)


@compiled_part
def _share_seen(above_limit: float) -> float:
    """How probably a star is seen that is brighter than the limit by so many times the blur."""
    return 0.02 + (_SEEN - 0.02) * 0.5 * (1.0 + above_limit / math.sqrt(1.0 + above_limit * above_limit))


@compiled_part
def _limit_for(star_magnitude: NDArray[np.float64], stars: int, blur: float) -> float:
    """The limiting magnitude at which as many stars of the field are expected to be seen.

    By Newton's steps, halved intervals where these lead out: the share seen is steep at the limit and flat elsewhere.
    """
    low, high = star_magnitude[0] - 4.0, star_magnitude[-1] + 4.0
    limit = star_magnitude[min(stars, len(star_magnitude) - 1)]
    for _ in range(10):
        missing, slope = float(stars), 0.0
        for f in range(len(star_magnitude)):
            above = (limit - star_magnitude[f]) / blur
            missing -= _share_seen(above)
            flat = 1.0 / math.sqrt(1.0 + above * above)
            slope += flat * flat * flat
        if missing > 0.0:
            low = limit
        else:
            high = limit
        step = missing * blur / (0.5 * (_SEEN - 0.02) * slope)
        limit += step
        if not low < limit < high:
            limit = 0.5 * (low + high)
        elif abs(step) < _LIMIT_WITHIN:
            break
    return float(limit)
