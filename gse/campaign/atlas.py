"""The error atlas of one session: residuals of its stars by pixel phase, by place in the field, and focal length.

A least-squares fit of a polynomial of the field and of harmonics of the pixel phase to all residuals, along columns and
rows each, as in gse.statistics.spatial_errors; the covariance of the coefficients is clustered by star, since all
residuals of a star share its catalogue place. The radial part of the polynomial's first degree is the focal length.

A sensor that sends whole pixels has the error of rounding beside its own: ``without_rounding`` tells them apart.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtrc, fdtrc, ndtr, ndtri

from gse.values.matrices import cholesky, inv, pinv, product, solve
from gse.values.star_influence import attitude_operators

# Leave-one-out residuals: each star's, as if it had no part in the fit of its frame's attitude.
#
# A star pulls the attitude of its frame towards itself: its residual is smaller than its error, and its place on the
# pixel, which the attitude tells, follows its own error. With H, the share of its error that the fit takes over, the
# residual of the same star left out is (1 - H)^-1 times the one it has.

_ROWS_AT_ONCE = 1 << 13
"""Matrices of all stars of a session take 60 MB."""
_MOST = 0.8
"""A star with more of its frame's fit than this tells nothing of itself."""


def left_out(
    residuals_arcsec: NDArray[np.float64], field_deg: NDArray[np.float64], frame: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Residuals (N, 2) of stars at field angles (N, 2) without their own share, and which of them tell anything.

    ``frame`` (N,) are in order.
    """
    first = np.flatnonzero(np.diff(frame, prepend=-1))  # frames stay whole
    cuts = first[np.unique(np.searchsorted(first, np.arange(0, len(frame), _ROWS_AT_ONCE)).clip(max=len(first) - 1))]
    parts = [
        _left_out(residuals_arcsec[part], field_deg[part], frame[part])
        for part in (slice(*ends) for ends in pairwise([*cuts.tolist(), len(frame)]))
    ]
    freed, useful = (np.concatenate(of_parts) for of_parts in zip(*parts, strict=True))
    return freed, useful


def _left_out(
    residuals_arcsec: NDArray[np.float64], field_deg: NDArray[np.float64], frame: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    tangent = np.tan(np.radians(field_deg))
    directions = np.column_stack([tangent, np.ones(len(tangent))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    operators = attitude_operators(directions, frame)
    x, y, z = (part[:, None] for part in directions.T)
    share = np.stack([operators[:, 1] * z - operators[:, 2] * y, operators[:, 2] * x - operators[:, 0] * z], axis=1)
    useful = (np.trace(share, axis1=1, axis2=2) / 2 < _MOST) & (np.abs(operators).max(axis=(1, 2)) > 0)
    share[~useful] = 0.0
    freed = solve(np.eye(2) - share, residuals_arcsec[:, :, None])[:, :, 0]
    return np.asarray(freed), np.asarray(useful)


# Pixel phase error of a sensor that sends whole pixels: what is left of its residuals without the rounding.
#
# A star at the phase p (px, from -0.5 to 0.5) is put on the pixel round(p + e(p) + n), with the sensor's own error
# e = a sin(2 pi p) + b cos(2 pi p) and noise n. So the mean residual at a phase is the mean of that pixel less p: a saw
# tooth that the noise smooths and e bends. The noise follows, for a given e, from the mean square of the residuals;
# then their first two harmonics give a and b. The phases come from the attitude fitted to the other stars of the frame,
# whose error smooths the harmonics further.

SQUARES_UNCERTAINTY = 0.015
"""Relative standard uncertainty of the mean square, from outliers and stars of different noise."""
_GRID = 64
_PHASES = (np.arange(_GRID) + 0.5) / _GRID - 0.5
_PIXELS = np.arange(-4, 5)[:, None]
_WAVES = np.stack([wave(2 * math.pi * k * _PHASES) for k in (1, 2) for wave in (np.sin, np.cos)])
_LEAST_NOISE_PX2 = 0.02**2
_FITTED_ANGLES = 1.5
"""The three angles of a frame have the error of so many of its n stars' values along an axis, over n."""
_TURNS = 4


@dataclass(frozen=True, slots=True)
class Harmonics:
    """Amplitudes of sin and cos of one, two ... periods on a pixel, px, with their covariance."""

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]


def without_rounding(found: Harmonics, square_px2: float, stars_per_frame: float) -> Harmonics:
    """The sensor's own first harmonic, from the first two of its residuals and their mean square."""
    weights = cholesky(inv(found.covariance + 1e-8 * np.eye(len(found.covariance)))).T

    def misfit(wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        expected = _expected(wanted[0], wanted[1], square_px2 * (1 + wanted[2]), stars_per_frame)
        return np.append(product(weights, found.values - expected), wanted[2] / SQUARES_UNCERTAINTY)

    best = least_squares(misfit, [0.0, 0.0, 0.0], bounds=([-0.5, -0.5, -0.2], [0.5, 0.5, 0.2]))
    jacobian = np.asarray(best.jac)
    covariance = pinv(product(jacobian.T, jacobian))
    stretched = max(2 * best.cost / (len(best.fun) - 3), 1.0)  # a model that does not fit says less
    return Harmonics(best.x[:2], covariance[:2, :2] * stretched)


def _expected(sine: float, cosine: float, square_px2: float, stars_per_frame: float) -> NDArray[np.float64]:
    """First two harmonics of the mean residual, as observed, px."""
    attitude_px2 = _FITTED_ANGLES * square_px2 / (stars_per_frame + _FITTED_ANGLES)
    before = _PHASES + sine * _WAVES[0] + cosine * _WAVES[1]
    smoothing = np.exp(-2 * math.pi**2 * attitude_px2 * np.array([1, 1, 4, 4]))
    return np.asarray(2 * product(_WAVES, _mean_residual(before, square_px2 - attitude_px2)) / _GRID * smoothing)


def _mean_residual(before: NDArray[np.float64], square_px2: float) -> NDArray[np.float64]:
    """Mean residual at each phase of stars whose residuals have this mean square."""
    noise_px2 = max(square_px2 - 1 / 12, _LEAST_NOISE_PX2)
    for _ in range(_TURNS):
        noise_px = math.sqrt(noise_px2)
        share = ndtr((_PIXELS + 0.5 - before) / noise_px) - ndtr((_PIXELS - 0.5 - before) / noise_px)
        square = float((((_PIXELS - _PHASES) ** 2) * share).sum(axis=0).mean())
        noise_px2 = max(noise_px2 + square_px2 - square, _LEAST_NOISE_PX2)
    return np.asarray((_PIXELS * share).sum(axis=0) - _PHASES)


DEGREE = 3
HARMONICS = 2
MIN_STARS = 20
MIN_RESIDUALS = 200
CELLS = 8
"""The map of the field has so many cells along each axis."""
PHASE_BINS = 20
_TINY = 1e-300
_TERMS = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]


@dataclass(frozen=True, slots=True)
class PhaseError:
    """Pixel phase error along one axis: first harmonic (sin, cos) in px with its covariance (2, 2), free of rounding.

    ``curve_px`` and ``curve_error_px`` (PHASE_BINS,) are means of the residuals, rounding included, over the phase from
    -0.5 to 0.5.
    """

    harmonic_px: NDArray[np.float64]
    covariance_px2: NDArray[np.float64]
    curve_px: NDArray[np.float64]
    curve_error_px: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SessionAtlas:
    """The atlas of a session; ``field_arcsec`` (CELLS, CELLS, 2) has the mean residual of each cell, NaN of none.

    ``field_error_arcsec`` (CELLS, CELLS) is its standard error, stars as the sample, ``field_stars`` of them;
    ``field_sigmas`` says how significant the polynomial of the field is, the focal length left out. ``scale`` is the
    relative error of the focal length and its standard error: a positive one asks for a longer one.
    """

    residuals: int
    stars: int
    phase: tuple[PhaseError, PhaseError]
    field_arcsec: NDArray[np.float64]
    field_error_arcsec: NDArray[np.float64]
    field_stars: NDArray[np.int64]
    field_sigmas: float
    scale: float
    scale_error: float


@dataclass(frozen=True, slots=True)
class AtlasResiduals:
    """Residuals of a session as columns: of the places (N, 2) along columns and rows, and numbers of stars and frames.

    ``size_px`` is the detector's (columns, rows), ``pixel_arcsec`` the angle of a pixel in its middle.
    """

    residuals_arcsec: NDArray[np.float64]
    xy_px: NDArray[np.float64]
    phase_px: NDArray[np.float64]
    field_deg: NDArray[np.float64]
    star: NDArray[np.int64]
    frame: NDArray[np.int64]
    size_px: tuple[int, int]
    pixel_arcsec: float

    @property
    def whole_pixels(self) -> bool:
        """Whether the sensor sends whole pixels."""
        return bool(np.all(self.xy_px == np.round(self.xy_px)))

    def without_own_share(self) -> tuple["AtlasResiduals", NDArray[np.bool_]]:
        """The stars as if each had been left out of the fit of its frame, and which (N,) they are.

        Those that are most of their frame's fit are dropped.
        """
        freed, useful = left_out(self.residuals_arcsec, self.field_deg, self.frame)
        phase = self.phase_px + (self.residuals_arcsec - freed) / self.pixel_arcsec
        whole = replace(self, residuals_arcsec=freed, phase_px=phase - np.floor(phase + 0.5))
        return whole.some(useful), useful

    def some(self, mask: NDArray[np.bool_]) -> "AtlasResiduals":
        """Those of a mask (N,)."""
        return AtlasResiduals(
            self.residuals_arcsec[mask],
            self.xy_px[mask],
            self.phase_px[mask],
            self.field_deg[mask],
            self.star[mask],
            self.frame[mask],
            self.size_px,
            self.pixel_arcsec,
        )


def session_atlas(of: AtlasResiduals) -> tuple[SessionAtlas, NDArray[np.float64]] | None:
    """The atlas of a session, of residuals without their own share, and what it fits to them (N, 2), arcsec.

    None of too few stars.
    """
    _, star = np.unique(of.star, return_inverse=True)
    stars = int(star.max()) + 1 if len(star) else 0
    if stars < MIN_STARS or len(star) < MIN_RESIDUALS:
        return None
    x, y = (2 * px / size - 1 for px, size in zip(of.xy_px.T, of.size_px, strict=True))
    field = np.column_stack([x**i * y**j for i, j in _TERMS])
    fits = [
        _AtlasFit.fitted(field, phase, residual, star)
        for phase, residual in zip(of.phase_px.T, of.residuals_arcsec.T, strict=True)
    ]
    per_frame = len(star) / len(np.unique(of.frame))
    phases = [_phase_error(fit, phase, of, per_frame) for fit, phase in zip(fits, of.phase_px.T, strict=True)]
    scale, scale_error = _scale(fits, of)
    cells, errors, cell_stars = _map(x, y, fits, star, stars)
    atlas = SessionAtlas(
        len(star),
        stars,
        (phases[0], phases[1]),
        cells,
        errors,
        cell_stars,
        _field_sigmas(fits),
        scale,
        scale_error,
    )
    return atlas, of.residuals_arcsec - np.column_stack([fit.left for fit in fits])


def sigmas_of(chi2: float, freedom: int) -> float:
    """Significance as that of a normal deviate, two-sided, of a sum of squares; 0 where it says nothing."""
    if not chi2 > 0 or freedom < 1:
        return 0.0
    return _as_sigmas(float(chdtrc(freedom, chi2)))


def sigmas_of_place(chi2: float, independent: float) -> float:
    """Significance of a mean in two axes whose variance is known from ``independent`` values: Hotelling's test."""
    if not chi2 > 0 or independent < 2:
        return 0.0
    return _as_sigmas(float(fdtrc(2, 2 * (independent - 1), chi2 / 2)))


def _as_sigmas(chance: float) -> float:
    return max(-float(ndtri(max(chance, _TINY) / 2)), 0.0)


@dataclass(frozen=True, slots=True)
class _AtlasFit:
    """Coefficients of field and phase of one axis with their clustered covariance, and residuals freed of each."""

    field: NDArray[np.float64]
    field_covariance: NDArray[np.float64]
    phase: NDArray[np.float64]
    phase_covariance: NDArray[np.float64]
    without_phase: NDArray[np.float64]
    without_field: NDArray[np.float64]
    left: NDArray[np.float64]

    @classmethod
    def fitted(
        cls,
        field: NDArray[np.float64],
        phase_px: NDArray[np.float64],
        residual: NDArray[np.float64],
        star: NDArray[np.int64],
    ) -> "_AtlasFit":
        angle = 2 * math.pi * phase_px
        waves = np.column_stack([wave(k * angle) for k in range(1, HARMONICS + 1) for wave in (np.sin, np.cos)])
        basis = np.hstack([field, waves])
        inverse = pinv(product(basis.T, basis))
        fit = product(inverse, product(basis.T, residual))
        left = residual - product(basis, fit)
        scores = np.stack([np.bincount(star, weights=part * left) for part in basis.T], axis=1)
        stars, of_field = len(scores), field.shape[1]
        few = stars / max(stars - basis.shape[1], 1)
        covariance = product(few * inverse, product(scores.T, scores), inverse)
        return cls(
            fit[:of_field],
            covariance[:of_field, :of_field],
            fit[of_field:],
            covariance[of_field:, of_field:],
            residual - product(waves, fit[of_field:]),
            residual - product(field, fit[:of_field]),
            left,
        )


def _phase_error(fit: _AtlasFit, phase_px: NDArray[np.float64], of: AtlasResiduals, per_frame: float) -> PhaseError:
    scale = of.pixel_arcsec
    harmonics = Harmonics(fit.phase / scale, fit.phase_covariance / scale**2)
    if of.whole_pixels:
        found = without_rounding(harmonics, float((fit.without_field**2).mean()) / scale**2, per_frame)
    else:
        found = Harmonics(harmonics.values[:2], harmonics.covariance[:2, :2])
    bins = np.clip(((phase_px + 0.5) * PHASE_BINS).astype(np.int64), 0, PHASE_BINS - 1)
    count = np.maximum(np.bincount(bins, minlength=PHASE_BINS), 1)
    curve = np.bincount(bins, weights=fit.without_field, minlength=PHASE_BINS) / count
    spread = math.sqrt(float((fit.left**2).mean()))
    return PhaseError(found.values, found.covariance, curve / scale, spread / np.sqrt(count) / scale)


def _scale(fits: list[_AtlasFit], of: AtlasResiduals) -> tuple[float, float]:
    """Relative error of the focal length: the trace of the linear part of the residuals' field."""
    parts = []
    for fit, term, size in zip(fits, ((1, 0), (0, 1)), of.size_px, strict=True):
        at = _TERMS.index(term)
        per = size / 2 * of.pixel_arcsec
        parts.append((fit.field[at] / per, math.sqrt(max(fit.field_covariance[at, at], 0.0)) / per))
    return float(parts[0][0] + parts[1][0]) / 2, float(math.hypot(parts[0][1], parts[1][1])) / 2


def _field_sigmas(fits: list[_AtlasFit]) -> float:
    """Of the polynomial's second and third degree along both axes."""
    wanted = [at for at, (i, j) in enumerate(_TERMS) if i + j >= 2]
    chi2 = 0.0
    for fit in fits:
        part = fit.field[wanted]
        chi2 += float(product(part, pinv(fit.field_covariance[np.ix_(wanted, wanted)]), part))
    return sigmas_of(chi2, 2 * len(wanted))


def _map(
    x: NDArray[np.float64], y: NDArray[np.float64], fits: list[_AtlasFit], star: NDArray[np.int64], stars: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Mean residual of each cell, its standard error and its stars: each star's mean in the cell is one value."""
    column, row = (np.clip(((at + 1) / 2 * CELLS).astype(np.int64), 0, CELLS - 1) for at in (x, y))
    cell = row * CELLS + column
    pair, place = np.unique(cell * stars + star, return_inverse=True)
    of_pair = np.bincount(place)
    means = np.stack([np.bincount(place, weights=fit.without_phase) / of_pair for fit in fits], axis=1)
    cells = pair // stars
    weight = np.bincount(cells, weights=of_pair, minlength=CELLS**2)
    known = weight > 0
    mean = np.full((CELLS**2, 2), np.nan)
    error = np.full(CELLS**2, np.nan)
    for axis in (0, 1):
        total = np.bincount(cells, weights=of_pair * means[:, axis], minlength=CELLS**2)
        mean[known, axis] = total[known] / weight[known]
    apart2 = ((means - mean[cells]) ** 2).sum(axis=1) / 2
    squares = np.bincount(cells, weights=of_pair**2 * apart2, minlength=CELLS**2)
    several = np.bincount(cells, minlength=CELLS**2)
    enough = several > 2
    error[enough] = np.sqrt(squares[enough]) / weight[enough] * np.sqrt(several[enough] / (several[enough] - 1))
    return mean.reshape(CELLS, CELLS, 2), error.reshape(CELLS, CELLS), several.reshape(CELLS, CELLS)
