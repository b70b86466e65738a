"""The error atlas of a sensor: those of its sessions together, nights as the sample where there are enough.

Sessions are read one after the other, so that memory does not grow with their number.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gse.campaign.atlas import CELLS, Residuals, SessionAtlas, session_atlas, sigmas_of, sigmas_of_place
from gse.campaign.dataset import FRAMES, STARS, Committed, DataSet
from gse.campaign.nights import Session
from gse.campaign.star_places import NamedStar, StarOffsets, named_stars, star_offsets, to_sky
from gse.constants import ARCSEC_PER_RAD

MIN_NIGHTS = 10
"""From so many sessions on the scatter between them is the error of a mean, below it the errors of each."""
_STARS_COLUMNS = (
    *("frame", "utc", "star", "star_id", "x_px", "y_px", "residual_x_arcsec", "residual_y_arcsec"),
    *("phase_x_px", "phase_y_px", "field_x_deg", "field_y_deg"),
)
_BORESIGHT = ("onboard_ra_deg", "onboard_de_deg", "onboard_roll_deg")


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
        for night, atlas, of_stars, named in _of_session(dataset, session):
            atlases.append(atlas)
            offsets.append(of_stars)
            names |= named
            scale[night] = atlas.scale
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


def _of_session(dataset: DataSet, session: Session) -> Iterator[tuple[str, SessionAtlas, StarOffsets, dict[int, str]]]:
    """Nothing, or the atlas of a session with the offsets and names of its stars."""
    place = Committed(str(session.row["sensor"]), session.night, str(session.row["key"]))
    stars = dataset.read(place.path(STARS), _STARS_COLUMNS)
    frames = dataset.read(place.path(FRAMES), _BORESIGHT)
    if stars is None or frames is None or not len(stars):
        return
    columns = {name: stars[name].to_numpy() for name in _STARS_COLUMNS if name not in ("star", "utc")}
    of = Residuals(
        _pair(columns, "residual_x_arcsec", "residual_y_arcsec"),
        _pair(columns, "x_px", "y_px"),
        _pair(columns, "phase_x_px", "phase_y_px"),
        _pair(columns, "field_x_deg", "field_y_deg"),
        columns["star_id"].astype(np.int64),
        columns["frame"].astype(np.int64),
        (int(session.row["camera_columns"]), int(session.row["camera_rows"])),
        ARCSEC_PER_RAD / float(session.row["camera_focal_length_px"]),
    )
    freed, useful = of.without_own_share()
    atlas = session_atlas(freed)
    if atlas is None:
        return
    utc_ns = stars["utc"].cast("int64").to_numpy()[useful]
    boresight_deg = np.column_stack([frames[name].to_numpy() for name in _BORESIGHT])[freed.frame]
    known = np.isfinite(boresight_deg).all(axis=1)
    # Those of the fitted attitude: star_offsets frees them of the shares of other stars itself.
    left_arcsec = of.residuals_arcsec[useful] - atlas.fitted_arcsec
    sky = to_sky(left_arcsec[known], freed.field_deg[known], boresight_deg[known])
    rows, first = np.unique(of.star, return_index=True)
    texts = stars["star"].take(first).to_pylist()
    yield (
        session.night,
        replace(atlas, fitted_arcsec=np.empty((0, 2))),  # 1 MB in 20 min, which nobody asks for again
        star_offsets(sky, freed.star[known], freed.frame[known], utc_ns[known]),
        {int(row): str(text) for row, text in zip(rows, texts, strict=True)},
    )


def _pair(columns: dict[str, NDArray[np.float32]], x: str, y: str) -> NDArray[np.float64]:
    return np.column_stack([columns[x], columns[y]]).astype(np.float64)


def _harmonic(axis: str, atlases: list[SessionAtlas], place: int) -> Harmonic:
    values = np.array([atlas.phase[place].harmonic_px for atlas in atlases])
    n, mean = len(values), values.mean(axis=0)
    covariance = np.mean([atlas.phase[place].covariance_px2 for atlas in atlases], axis=0) / n
    if n >= MIN_NIGHTS:
        covariance = np.maximum(1, _stretch(values, covariance * n)) * covariance
    chi2 = float(mean @ np.linalg.solve(covariance + 1e-12 * np.eye(2), mean))
    amplitude = float(np.hypot(*mean))
    along = mean / amplitude if amplitude > 0 else np.array([1.0, 0.0])
    return Harmonic(axis, amplitude, math.sqrt(float(along @ covariance @ along)), sigmas_of(chi2, 2))


def _stretch(values: NDArray[np.float64], within: NDArray[np.float64]) -> float:
    """How much larger the variance between nights is than their own errors say."""
    apart = values - values.mean(axis=0)
    chi2 = float(np.einsum("ni,ij,nj->", apart, np.linalg.inv(within + 1e-12 * np.eye(2)), apart))
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
