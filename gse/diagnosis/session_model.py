"""The errors of a session as models compete for them: angles over time, coordinates, axes, and what single stars keep.

An error is the small rotation between measured and true attitude, as shifts of the boresight along columns and rows and
as roll, in arcsec. The cosine transform's ordinates are nearly independent whatever the correlation of the errors
(Müller & Watson 2008, Econometrica 76, 979): slow causes show in the lowest, where slow noise shows too.
"""

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.competing_models import Fitted, Observed, Predictions
from gse.diagnosis.field_patterns import PARAMETERS, FieldOfErrors
from gse.diagnosis.turns import VERTICAL, level_axis
from gse.station.frame_columns import Columns
from gse.station.session_tables import residuals_of, xy_px_of
from gse.truth import horizon_to_sensor
from gse.values.axis import D_ROLL, OF_SENSOR
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.matrices import cholesky, inv, pinv, product, weighted_sums
from gse.values.mount import Mount
from gse.values.site import Site
from gse.values.star_influence import FrameFits, boresight_shifts

MOST_ORDINATES = 128
"""A step is known to a 250th of the session, a sinusoid of up to 60 cycles is seen."""
FEWEST_FRAMES = 20
_NEIGHBOURS, _LEAST_ANSWERED = 15, 0.5
_BLOCKS = 1024
MOST_INSTANTS = 8 * _BLOCKS
"""More than the transform can tell apart."""
_OUTLIER = 5.0

_ROWS_AT_ONCE = 1 << 14


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSeries:
    """Errors (M, 3) along columns, rows and about the boresight, in arcsec, at instants (M,) in s from the first."""

    rows: NDArray[np.int64]
    time_s: NDArray[np.float64]
    errors_arcsec: NDArray[np.float64]

    @property
    def duration_s(self) -> float:
        """From the first to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def ordinates(self) -> int:
        """How many of the transform are used."""
        return min(MOST_ORDINATES, len(self.time_s) // 2)

    def shortened(self) -> "ErrorSeries":
        """MOST_INSTANTS at most: means of neighbours, with the row of the first of each."""
        edges = np.linspace(0, len(self.rows), min(len(self.rows), MOST_INSTANTS) + 1).astype(np.int64)
        first, count = edges[:-1], np.diff(edges)
        time_s = np.add.reduceat(self.time_s, first) / count
        return ErrorSeries(self.rows[first], time_s, np.add.reduceat(self.errors_arcsec, first) / count[:, None])

    def cosines(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """The lowest ordinates (K, ...) of columns (M, ...), without the mean; white noise keeps its variance."""
        edges, basis = _basis(len(self.time_s), self.ordinates)
        sums = np.add.reduceat(columns, edges)
        return np.asarray(math.sqrt(2 / len(self.time_s)) * weighted_sums(basis, sums))

    def against_cosines(self, ordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Weights (M, ...) of a sum over the series that is the sum of ordinates (K, ...) times its cosines."""
        edges, basis = _basis(len(self.time_s), self.ordinates)
        blocks = math.sqrt(2 / len(self.time_s)) * weighted_sums(basis.T, ordinates)
        return np.asarray(np.repeat(blocks, np.diff(edges, append=len(self.time_s)), axis=0))


def often_answered(used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The used (M,) frames among whose neighbours at least half are used; all of them where most would be left out.

    An identifier that answers few frames answers those whose stars err alike, which looks like a drift as they get few.
    """
    total = np.concatenate([[0], np.cumsum(used)])
    place = np.arange(len(used))
    first, last = np.maximum(place - _NEIGHBOURS, 0), np.minimum(place + _NEIGHBOURS + 1, len(used))
    kept = used & (total[last] - total[first] >= _LEAST_ANSWERED * (last - first))
    return kept if 2 * kept.sum() >= used.sum() else used


def error_series(frames: Columns, used: NDArray[np.bool_]) -> ErrorSeries | None:
    """Of the used (M,) rows of FRAME that have a roll, in the order of time; None of too few."""
    rows = np.flatnonzero(used & np.isfinite(frames[D_ROLL.column]))
    rows = rows[np.argsort(frames["utc_ns"][rows], kind="stable")]
    if len(rows) < FEWEST_FRAMES:
        return None
    utc_ns = frames["utc_ns"][rows]
    x, y, roll = (frames[axis.column][rows] / ARCSEC_PER_RAD for axis in OF_SENSOR)
    turns = _rotation_vectors(x, y, roll) * ARCSEC_PER_RAD
    return ErrorSeries(rows, (utc_ns - utc_ns[0]) / 1e9, boresight_shifts(turns))


def with_left_out(series: ErrorSeries, matches: NDArray[np.void], camera: Camera) -> ErrorSeries:
    """The errors as they are with the stars (rows of MATCH) that answers left out; between frames without rows linear.

    Those that an identifier names are chosen by their distances, which biases them (gse.station.shown_stars).
    """
    matches = matches.compress(np.isin(matches["frame"], series.rows))
    residuals = residuals_of(matches)
    length = np.hypot(*residuals.T)
    sound = matches["named"] | (length <= _OUTLIER * np.median(length)) if len(matches) else matches["named"]
    if sound.sum() == (matches["named"] & sound).sum():
        return series
    matches, residuals = matches.compress(sound), residuals.compress(sound, axis=0)
    xy_px = xy_px_of(matches)
    fits = FrameFits.from_directions(camera.directions(xy_px), matches["frame"])
    shifts = boresight_shifts(fits.turns(residuals))
    more = np.column_stack([np.interp(series.rows, fits.numbers, shift) for shift in shifts.T])
    return replace(series, errors_arcsec=series.errors_arcsec + more)


def _rotation_vectors(x: NDArray[np.float64], y: NDArray[np.float64], roll: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotations (M, 3) that gse.station.results describes: first the boresight, then about it."""
    vectors = np.empty((len(x), 3))
    for first in range(0, len(x), _ROWS_AT_ONCE):  # all at once would take four times the memory of the vectors
        part = slice(first, first + _ROWS_AT_ONCE)
        vectors[part] = _across_then_about(x[part], y[part], roll[part])
    return vectors


def _across_then_about(
    x: NDArray[np.float64], y: NDArray[np.float64], roll: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rotation vectors (M, 3) of the products of quaternions: of (y, -x, 0), then of (0, 0, roll)."""
    across = np.hypot(x, y)
    cos_across, sin_per_angle = np.cos(across / 2), np.sinc(across / (2 * math.pi)) / 2
    cos, sin = np.cos(roll / 2), np.sin(roll / 2)
    axis = np.column_stack([sin_per_angle * (cos * y + sin * x), sin_per_angle * (sin * y - cos * x), sin * cos_across])
    length, real = np.linalg.norm(axis, axis=1), cos * cos_across
    angle = 2 * np.copysign(np.arctan2(length, np.abs(real)), real)
    return np.asarray(axis * np.divide(angle, length, out=np.full_like(length, 2.0), where=length > 0)[:, None])


@functools.lru_cache(maxsize=4)
def _basis(n: int, ordinates: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """First rows (B,) of blocks, and cosines (B, K) at their middles."""
    edges = np.linspace(0, n, min(n, _BLOCKS) + 1).astype(np.int64)
    middle = (edges[:-1] + edges[1:]) / (2 * n)
    basis = np.cos(math.pi * np.arange(1, ordinates + 1)[:, None] * middle)
    return edges[:-1], np.ascontiguousarray(basis.T)


FLOOR_ARCSEC = np.array([0.3, 0.3, 1.0])
"""What the models of air and stars leave open, along columns, rows and about the boresight."""
_OF_CHANGES = 1 / 6
"""As much of it changes in a session: 23 clean ones of half an hour to two hours, by centroids, show 0.05 arcsec."""
_UNTESTED_ARCSEC2 = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class SessionModel:
    """Errors and field of a session with the geometry that the causes need.

    ``mount`` is the one in force; ``is_fitted`` where it was fitted on the same sky, so that constant errors tell
    nothing. ``pixel_arcsec`` is by how much the boresight moves where all stars lie a pixel further along x and y.
    """

    series: ErrorSeries
    field: FieldOfErrors | None
    site: Site
    mount: Mount
    is_fitted: bool
    decorrelate: NDArray[np.float64]
    pixel_arcsec: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def from_series(
        cls,
        series: ErrorSeries,
        field: FieldOfErrors | None,
        site: Site,
        mount: Mount,
        *,
        is_fitted: bool,
        pixel_arcsec: tuple[float, float] = (0.0, 0.0),
    ) -> "SessionModel":
        """With the coordinates in which the upper half of the ordinates is independent and of variance one."""
        cosines = series.cosines(series.errors_arcsec)
        upper = cosines[len(cosines) // 2 :]
        covariance = product(upper.T, upper) / len(upper)
        covariance += np.diag(1e-6 + 1e-6 * np.diag(covariance))
        return cls(series, field, site, mount, is_fitted, inv(cholesky(covariance)), pixel_arcsec)

    def observed(self) -> Observed:
        """What the models compete for."""
        errors = product(self.series.errors_arcsec, self.decorrelate.T)
        lasting = np.diag(FLOOR_ARCSEC**2)
        lasting += self._by_stars(np.broadcast_to(np.eye(3) / len(errors), (len(errors), 3, 3)))
        if self.is_fitted:
            lasting = np.eye(3) * _UNTESTED_ARCSEC2
        field = self.field
        return Observed(
            len(errors),
            errors.mean(axis=0),
            product(self.decorrelate, lasting, self.decorrelate.T),
            self.series.cosines(errors),
            field.normal if field else np.eye(len(PARAMETERS)),
            field.right if field else np.zeros(len(PARAMETERS)),
            field.freedom if field else 0.0,
        )

    @property
    def stars_freedom(self) -> float:
        """Degrees of freedom of what single stars keep."""
        return self.field.stars.freedom if self.field else 1.0

    def left_open(self, columns: Predictions, fit: Fitted, count: int) -> NDArray[np.float64]:
        """Covariance of the last coefficients, of changes over time, by what single stars keep and models leave open.

        Neither is in the covariance of the fit, which knows how the errors scatter from one frame to the next.
        """
        pulls = np.einsum("kap,ka,pq->kaq", columns.cosines, fit.precision, fit.covariance[:, -count:])
        weights = np.einsum("map,ai->mpi", self.series.against_cosines(pulls), self.decorrelate)
        course = np.einsum("ij,kjp->kip", inv(self.decorrelate), columns.cosines[:, :, -count:])
        floor = np.einsum("kip,kiq,i->pq", course, course, (_OF_CHANGES * FLOOR_ARCSEC) ** -2.0)
        open_arcsec2 = len(self.series.time_s) * pinv(floor)
        return np.asarray(self._by_stars(weights) + open_arcsec2)

    def _by_stars(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance (P, P) of sums of the errors with weights (M, P, 3), by what single stars keep; zero without."""
        if self.field is None:
            return np.zeros((weights.shape[1], weights.shape[1]))
        stars, series = self.field.stars, self.series
        flat = weights.reshape(len(weights), -1)
        at = np.column_stack([np.interp(stars.frames, series.rows, part) for part in flat.T])
        scale = len(series.rows) / len(np.unique(stars.frames))
        return stars.covariance_arcsec2(scale * at.reshape(len(at), *weights.shape[1:]))

    def columns(self, *series_arcsec: NDArray[np.float64], field: NDArray[np.float64] | None = None) -> Predictions:
        """Columns of errors (M, 3) each, with the parameters (F, P) of the field."""
        means = np.stack([one.mean(axis=0) for one in series_arcsec], axis=1)
        ordinates = np.stack([self.series.cosines(one) for one in series_arcsec], axis=2)
        cosines = np.einsum("ij,kjp->kip", self.decorrelate, ordinates)
        none = np.zeros((len(PARAMETERS), len(series_arcsec)))
        return Predictions(product(self.decorrelate, means), cosines, none if field is None else field)

    def shift(self, axis_horizon: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shifts (3,) of the error where the measured mount is turned by 1 about an axis of the horizon frame."""
        return np.asarray(boresight_shifts(product(horizon_to_sensor(self.mount), axis_horizon)[None])[0])

    def along(self, axis_horizon: NDArray[np.float64], over_time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Errors (M, 3) of turns (M,) about an axis."""
        return over_time[:, None] * self.shift(axis_horizon)

    def axes(self) -> dict[str, NDArray[np.float64]]:
        """The axes of the horizon frame about which the three angles of the mount grow."""
        boresight = horizon_to_sensor(self.mount)[2]
        return {"azimuth": VERTICAL, "altitude": -level_axis(self.mount), "roll": boresight}
