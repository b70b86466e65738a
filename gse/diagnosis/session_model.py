"""The errors of a session as models compete for them: coordinates, axes, and what single stars keep."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.diagnosis.competing_models import Fitted, Observed, Predictions
from gse.diagnosis.error_series import ErrorSeries
from gse.diagnosis.field_patterns import PARAMETERS, FieldOfErrors
from gse.diagnosis.turns import VERTICAL, level_axis
from gse.truth import horizon_to_sensor
from gse.values.matrices import cholesky, inv, pinv, product
from gse.values.mount import Mount
from gse.values.site import Site
from gse.values.star_influence import boresight_shifts

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
