"""The errors of a session as models compete for them: coordinates, axes, and what single stars keep."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.assessment.competing_models import Columns, Observed
from gse.assessment.error_series import ErrorSeries
from gse.assessment.field_patterns import PARAMETERS, FieldOfErrors
from gse.assessment.turns import VERTICAL, level_axis
from gse.mount import Mount
from gse.site import Site
from gse.star_influence import boresight_shifts
from gse.truth import horizon_to_sensor

FLOOR_ARCSEC = np.array([0.3, 0.3, 1.0])
"""What the models of air and stars leave open, along columns, rows and about the boresight."""
_UNTESTED_ARCSEC2 = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class SessionModel:
    """Errors and field of a session with the geometry that the causes need.

    ``mount`` is the one in force; ``is_fitted`` where it was fitted on the same sky, so that constant errors tell
    nothing.
    """

    series: ErrorSeries
    field: FieldOfErrors | None
    site: Site
    mount: Mount
    is_fitted: bool
    decorrelate: NDArray[np.float64]

    @classmethod
    def of(
        cls, series: ErrorSeries, field: FieldOfErrors | None, site: Site, mount: Mount, *, is_fitted: bool
    ) -> "SessionModel":
        """With the coordinates in which the upper half of the ordinates is independent and of variance one."""
        cosines = series.cosines(series.errors_arcsec)
        upper = cosines[len(cosines) // 2 :]
        covariance = upper.T @ upper / len(upper)
        covariance += np.diag(1e-6 + 1e-6 * np.diag(covariance))
        return cls(series, field, site, mount, is_fitted, np.linalg.inv(np.linalg.cholesky(covariance)))

    def observed(self) -> Observed:
        """What the models compete for."""
        errors = self.series.errors_arcsec @ self.decorrelate.T
        lasting = np.diag(FLOOR_ARCSEC**2)
        if self.field is not None:
            lasting = lasting + self.lasting_arcsec2(np.full(len(errors), 1 / len(errors)))
        if self.is_fitted:
            lasting = np.eye(3) * _UNTESTED_ARCSEC2
        field = self.field
        return Observed(
            len(errors),
            errors.mean(axis=0),
            self.decorrelate @ lasting @ self.decorrelate.T,
            self.series.cosines(errors),
            field.normal if field else np.eye(len(PARAMETERS)),
            field.right if field else np.zeros(len(PARAMETERS)),
            field.freedom if field else 0.0,
        )

    def lasting_arcsec2(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance (3, 3) of the weighted (M,) sum of the errors, by what single stars keep; zero without stars."""
        if self.field is None:
            return np.zeros((3, 3))
        stars, of_frames = self.field.stars, self._of_frames(weights)
        return stars.lasting_arcsec2(of_frames) + stars.of_phases_arcsec2(of_frames)

    def _of_frames(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Weights of the series as those of the rows of the field's stars, with the same sum over frames."""
        assert self.field is not None
        stars = self.field.stars
        at = np.interp(stars.frames, self.series.rows, weights)
        return at * (len(self.series.rows) / len(np.unique(stars.frames)))

    def columns(self, *series_arcsec: NDArray[np.float64], field: NDArray[np.float64] | None = None) -> Columns:
        """Columns of errors (M, 3) each, with the parameters (F, P) of the field."""
        stacked = np.stack(series_arcsec, axis=2)
        turned = np.einsum("ij,mjp->mip", self.decorrelate, stacked)
        none = np.zeros((len(PARAMETERS), len(series_arcsec)))
        return Columns(turned.mean(axis=0), self.series.cosines(turned), none if field is None else field)

    def shift(self, axis_horizon: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shifts (3,) of the error where the measured mount is turned by 1 about an axis of the horizon frame."""
        return np.asarray(boresight_shifts((horizon_to_sensor(self.mount) @ axis_horizon)[None])[0])

    def along(self, axis_horizon: NDArray[np.float64], over_time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Errors (M, 3) of turns (M,) about an axis."""
        return over_time[:, None] * self.shift(axis_horizon)

    def axes(self) -> dict[str, NDArray[np.float64]]:
        """The axes of the horizon frame about which the three angles of the mount grow."""
        boresight = horizon_to_sensor(self.mount)[2]
        return {"azimuth": VERTICAL, "altitude": -level_axis(self.mount), "roll": boresight}
