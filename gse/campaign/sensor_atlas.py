"""The error atlas of a sensor: those of its sessions together, nights as the sample where there are enough.

Sessions are read one after the other, so that memory does not grow with their number.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gse.campaign.atlas import CELLS, SessionAtlas, sigmas_of, sigmas_of_place
from gse.campaign.atlas_table import SessionErrors, atlas_schema, errors_of
from gse.campaign.dataset import AGAIN, ATLAS, Committed, DataSet
from gse.campaign.nights import Session
from gse.campaign.star_places import NamedStar, StarOffsets, named_stars
from gse.campaign.storage import StorageError
from gse.values.matrices import inv, product, solve

MIN_NIGHTS = 10
"""From so many sessions on the scatter between them is the error of a mean, below it the errors of each."""


@dataclass(frozen=True, slots=True)
class Harmonic:
    """Pixel phase error along one axis: amplitude and its standard error in px, and its significance."""

    axis: str
    amplitude_px: float
    error_px: float
    sigmas: float


@dataclass(frozen=True, slots=True)
class SensorAtlas:
    """What the stars of a sensor's sessions show.

    ``field_arcsec`` (CELLS, CELLS, 2) and ``field_sigmas`` (CELLS, CELLS) are the mean residuals over the detector and
    their significance, rows downwards; ``curves_px`` (2, PHASE_BINS) the mean residuals over the pixel phase along
    columns and rows, with errors ``curve_errors_px``. ``scale`` is the relative error of the focal length by night.
    """

    sessions: int
    residuals: int
    phase: tuple[Harmonic, ...]
    curves_px: NDArray[np.float64]
    curve_errors_px: NDArray[np.float64]
    field_arcsec: NDArray[np.float64]
    field_sigmas: NDArray[np.float64]
    scale: dict[str, float]
    stars: tuple[NamedStar, ...]
    names: dict[int, str]


def sensor_atlas(
    dataset: DataSet, sessions: Iterable[Session], each: Callable[[], None] = lambda: None
) -> SensorAtlas | None:
    """The atlas of the sessions of one sensor; None where none has enough stars."""
    atlases: list[SessionAtlas] = []
    offsets: list[StarOffsets] = []
    names: dict[int, str] = {}
    scale: dict[str, float] = {}
    for session in sessions:
        each()
        errors = _errors(dataset, session)
        if errors is not None:
            atlases.append(errors.atlas)
            offsets.append(errors.offsets)
            names |= zip(errors.offsets.star.tolist(), errors.names, strict=True)
            scale[session.night] = errors.atlas.scale
    if not atlases:
        return None
    curves, curve_errors = _mean_of(
        [np.stack([one.curve_px for one in atlas.phase]) for atlas in atlases],
        [np.stack([one.curve_error_px for one in atlas.phase]) for atlas in atlases],
    )
    field, field_sigmas = _field(atlases)
    return SensorAtlas(
        len(atlases),
        sum(atlas.residuals for atlas in atlases),
        tuple(_harmonic(axis, atlases, place) for place, axis in enumerate(("columns", "rows"))),
        curves,
        curve_errors,
        field,
        field_sigmas,
        scale,
        tuple(named_stars(offsets)),
        names,
    )


def _errors(dataset: DataSet, session: Session) -> SessionErrors | None:
    path = Committed(str(session.row["sensor"]), session.night, str(session.row["key"])).path(ATLAS)
    table = dataset.read(path)
    if table is None or not table.schema.equals(atlas_schema()):
        raise StorageError(f"{dataset.url}/{path} is missing or damaged; {AGAIN}", dataset.url)
    return errors_of(table)


def _harmonic(axis: str, atlases: list[SessionAtlas], place: int) -> Harmonic:
    values = np.array([atlas.phase[place].harmonic_px for atlas in atlases])
    n, mean = len(values), values.mean(axis=0)
    covariance = np.mean([atlas.phase[place].covariance_px2 for atlas in atlases], axis=0) / n
    if n >= MIN_NIGHTS:
        covariance = np.maximum(1, _stretch(values, covariance * n)) * covariance
    chi2 = float(product(mean, solve(covariance + 1e-12 * np.eye(2), mean)))
    amplitude = float(np.hypot(*mean))
    along = mean / amplitude if amplitude > 0 else np.array([1.0, 0.0])
    return Harmonic(axis, amplitude, math.sqrt(float(product(along, covariance, along))), sigmas_of(chi2, 2))


def _stretch(values: NDArray[np.float64], within: NDArray[np.float64]) -> float:
    """How much larger the variance between nights is than their own errors say."""
    apart = values - values.mean(axis=0)
    chi2 = float(np.einsum("ni,ij,nj->", apart, inv(within + 1e-12 * np.eye(2)), apart))
    return chi2 / float(values.shape[1] * (len(values) - 1))


def _mean_of(
    values: list[NDArray[np.float64]], errors: list[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The mean over sessions and its standard error: from their scatter where there are enough of them."""
    n = len(values)
    error = np.sqrt(np.mean(np.square(errors), axis=0) / n)
    if n >= MIN_NIGHTS:
        error = np.maximum(error, np.std(values, axis=0, ddof=1) / math.sqrt(n))
    return np.mean(values, axis=0), error


def _field(atlases: list[SessionAtlas]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean residual of each cell over the sessions that have it, and its significance."""
    field, sigmas = np.full((CELLS, CELLS, 2), np.nan), np.full((CELLS, CELLS), np.nan)
    for row in range(CELLS):
        for column in range(CELLS):
            known = [atlas for atlas in atlases if math.isfinite(atlas.field_error_arcsec[row, column])]
            if known:
                mean, error = _mean_of(
                    [atlas.field_arcsec[row, column] for atlas in known],
                    [np.full(2, atlas.field_error_arcsec[row, column]) for atlas in known],
                )
                field[row, column] = mean
                several = (
                    len(known) if len(known) >= MIN_NIGHTS else sum(int(a.field_stars[row, column]) for a in known)
                )
                sigmas[row, column] = sigmas_of_place(float(((mean / error) ** 2).sum()), several)
    return field, sigmas
