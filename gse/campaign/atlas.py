"""The error atlas of one session: residuals of its stars by pixel phase, by place in the field, and focal length.

A least-squares fit of a polynomial of the field and of harmonics of the pixel phase to all residuals, along columns and
rows each, as in gse.statistics.spatial_errors; the covariance of the coefficients is clustered by star, since all
residuals of a star share its catalogue place. The radial part of the polynomial's first degree is the focal length.

A sensor that sends whole pixels has the error of rounding beside its own: gse.campaign.rounding tells them apart.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, ndtri

from gse.campaign.leverage import left_out
from gse.campaign.rounding import Harmonics, without_rounding
from gse.matrices import pinv, product

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
class Residuals:
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

    def without_own_share(self) -> tuple["Residuals", NDArray[np.bool_]]:
        """The stars as if each had been left out of the fit of its frame, and which (N,) they are.

        Those that are most of their frame's fit are dropped.
        """
        freed, useful = left_out(self.residuals_arcsec, self.field_deg, self.frame)
        phase = self.phase_px + (self.residuals_arcsec - freed) / self.pixel_arcsec
        whole = replace(self, residuals_arcsec=freed, phase_px=phase - np.floor(phase + 0.5))
        return whole.some(useful), useful

    def some(self, mask: NDArray[np.bool_]) -> "Residuals":
        """Those of a mask (N,)."""
        return Residuals(
            self.residuals_arcsec[mask],
            self.xy_px[mask],
            self.phase_px[mask],
            self.field_deg[mask],
            self.star[mask],
            self.frame[mask],
            self.size_px,
            self.pixel_arcsec,
        )


def session_atlas(of: Residuals) -> tuple[SessionAtlas, NDArray[np.float64]] | None:
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
        _Fit.of(field, phase, residual, star)
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
class _Fit:
    """Coefficients of field and phase of one axis with their clustered covariance, and residuals freed of each."""

    field: NDArray[np.float64]
    field_covariance: NDArray[np.float64]
    phase: NDArray[np.float64]
    phase_covariance: NDArray[np.float64]
    without_phase: NDArray[np.float64]
    without_field: NDArray[np.float64]
    left: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        field: NDArray[np.float64],
        phase_px: NDArray[np.float64],
        residual: NDArray[np.float64],
        star: NDArray[np.int64],
    ) -> "_Fit":
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


def _phase_error(fit: _Fit, phase_px: NDArray[np.float64], of: Residuals, per_frame: float) -> PhaseError:
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


def _scale(fits: list[_Fit], of: Residuals) -> tuple[float, float]:
    """Relative error of the focal length: the trace of the linear part of the residuals' field."""
    parts = []
    for fit, term, size in zip(fits, ((1, 0), (0, 1)), of.size_px, strict=True):
        at = _TERMS.index(term)
        per = size / 2 * of.pixel_arcsec
        parts.append((fit.field[at] / per, math.sqrt(max(fit.field_covariance[at, at], 0.0)) / per))
    return float(parts[0][0] + parts[1][0]) / 2, float(math.hypot(parts[0][1], parts[1][1])) / 2


def _field_sigmas(fits: list[_Fit]) -> float:
    """Of the polynomial's second and third degree along both axes."""
    wanted = [at for at, (i, j) in enumerate(_TERMS) if i + j >= 2]
    chi2 = 0.0
    for fit in fits:
        part = fit.field[wanted]
        chi2 += float(product(part, pinv(fit.field_covariance[np.ix_(wanted, wanted)]), part))
    return sigmas_of(chi2, 2 * len(wanted))


def _map(
    x: NDArray[np.float64], y: NDArray[np.float64], fits: list[_Fit], star: NDArray[np.int64], stars: int
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
