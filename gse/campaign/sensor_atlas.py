"""The error atlas of a sensor: those of its sessions together, nights as the sample where there are enough.

Sessions are read one after the other, so that memory does not grow with their number.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gse.campaign.atlas import (
    CELLS,
    PHASE_BINS,
    AtlasResiduals,
    PhaseError,
    SessionAtlas,
    session_atlas,
    sigmas_of,
    sigmas_of_place,
)
from gse.campaign.dataset import AGAIN, ATLAS, Committed, DataSet
from gse.campaign.nights import Session
from gse.campaign.star_places import NamedStar, StarOffsets, named_stars, star_offsets, to_sky
from gse.campaign.storage import StorageError
from gse.report.parquet import field, schema
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from gse.values.matrices import inv, product, solve

# The table of atlases: one row per session with what the error atlas of a sensor is added up from.
#
# The worker that judged a session makes it of the session's tables of stars and frames, so that a report reads some
# 20 kB of each session instead of a million numbers. A session with too few stars has no row.

STARS_COLUMNS = (
    *("frame", "utc", "star", "star_id", "x_px", "y_px", "residual_x_arcsec", "residual_y_arcsec"),
    *("phase_x_px", "phase_y_px", "field_x_deg", "field_y_deg"),
)
BORESIGHT_COLUMNS = ("onboard_ra_deg", "onboard_de_deg", "onboard_roll_deg")
"""What is read of the tables of stars and frames."""

_NUMBERS, _COUNT = pa.list_(pa.float64()), pa.int64()
_OF_PHASE = ("harmonic_px", "covariance_px2", "curve_px", "curve_error_px")
_SHAPES = {"harmonic_px": 2, "covariance_px2": (2, 2), "curve_px": PHASE_BINS, "curve_error_px": PHASE_BINS}
_OF_FIELD = ("field_arcsec", "field_error_arcsec")
_OF_OFFSETS = ("east_arcsec", "north_arcsec", "variance_arcsec2")
_PLAIN = ("residuals", "stars", "field_sigmas", "scale", "scale_error")


@dataclass(frozen=True, slots=True, eq=False)
class SessionErrors:
    """What the stars of one session show: its atlas, and the offsets of its stars with their names."""

    atlas: SessionAtlas
    offsets: StarOffsets
    names: tuple[str, ...]


def atlas_schema() -> pa.Schema:
    """The schema of the table of atlases; lists have the rows of the detector, or of a matrix, one after the other."""
    phase = pa.struct([field(name, _NUMBERS) for name in _OF_PHASE])
    offset = pa.struct(
        [
            field("star_id", _COUNT),
            field("star", pa.string()),
            *(field(name, pa.float64()) for name in _OF_OFFSETS),
            *(field(name, _COUNT) for name in ("residuals", "minutes")),
        ]
    )
    kinds = [
        *(("key", pa.string()), ("residuals", _COUNT), ("stars", _COUNT), ("phase", pa.list_(phase))),
        *((name, _NUMBERS) for name in _OF_FIELD),
        ("field_stars", pa.list_(_COUNT)),
        *((name, pa.float64()) for name in ("field_sigmas", "scale", "scale_error")),
        ("offsets", pa.list_(offset)),
    ]
    return schema("atlas", [field(name, kind) for name, kind in kinds])


def session_errors(stars: pa.Table, frames: pa.Table, camera: Camera) -> SessionErrors | None:
    """The errors of a session from its tables of stars and frames, at least those with stars; None of too few."""
    if not len(stars):
        return None
    columns = {name: stars[name].to_numpy() for name in STARS_COLUMNS if name not in ("star", "utc")}
    of = AtlasResiduals(
        _pair(columns, "residual_x_arcsec", "residual_y_arcsec"),
        _pair(columns, "x_px", "y_px"),
        _pair(columns, "phase_x_px", "phase_y_px"),
        _pair(columns, "field_x_deg", "field_y_deg"),
        columns["star_id"].astype(np.int64),
        columns["frame"].astype(np.int64),
        (camera.columns, camera.rows),
        ARCSEC_PER_RAD / camera.focal_length_px,
    )
    freed, useful = of.without_own_share()
    found = session_atlas(freed)
    if found is None:
        return None
    atlas, fitted_arcsec = found
    utc_ns = stars["utc"].cast("int64").to_numpy()[useful]
    row = np.searchsorted(frames["frame"].to_numpy(), freed.frame)
    boresight_deg = np.column_stack([frames[name].to_numpy()[row] for name in BORESIGHT_COLUMNS])
    known = np.isfinite(boresight_deg).all(axis=1)
    # Those of the fitted attitude: star_offsets frees them of the shares of other stars itself.
    left_arcsec = of.residuals_arcsec[useful] - fitted_arcsec
    sky = to_sky(left_arcsec[known], freed.field_deg[known], boresight_deg[known])
    offsets = star_offsets(sky, freed.star[known], freed.frame[known], utc_ns[known])
    rows, first = np.unique(of.star, return_index=True)
    names = dict(zip(rows.tolist(), stars["star"].take(first).to_pylist(), strict=True))
    return SessionErrors(atlas, offsets, tuple(str(names[star]) for star in offsets.star.tolist()))


def atlas_table(errors: SessionErrors | None, key: str) -> pa.Table:
    """The row of a session, or none."""
    if errors is None:
        return atlas_schema().empty_table()
    atlas = errors.atlas
    row = {
        "key": key,
        **{name: getattr(atlas, name) for name in _PLAIN},
        "phase": [{name: _flat(getattr(one, name)) for name in _OF_PHASE} for one in atlas.phase],
        **{name: _flat(getattr(atlas, name)) for name in _OF_FIELD},
        "field_stars": atlas.field_stars.ravel().tolist(),
    }
    whole = atlas_schema()
    offsets = pa.StructArray.from_arrays(_offset_columns(errors), fields=list(whole.field("offsets").type.value_type))
    listed = pa.ListArray.from_arrays(pa.array([0, len(offsets)], pa.int32()), offsets)
    return pa.Table.from_pylist([row], whole).set_column(len(whole) - 1, whole.field("offsets"), listed)


def _offset_columns(errors: SessionErrors) -> list[pa.Array]:
    of = errors.offsets
    numbers = [pa.array(getattr(of, name), mask=~np.isfinite(getattr(of, name))) for name in _OF_OFFSETS]
    return [
        pa.array(of.star),
        pa.array(errors.names, pa.string()),
        *numbers,
        pa.array(of.residuals),
        pa.array(of.minutes),
    ]


def errors_of(table: pa.Table) -> SessionErrors | None:
    """What a table of one session holds; None where it has no row."""
    if not len(table):
        return None
    (row,) = table.drop_columns("offsets").to_pylist()
    x, y = (PhaseError(*(_array(one[name]).reshape(_SHAPES[name]) for name in _OF_PHASE)) for one in row["phase"])
    atlas = SessionAtlas(
        row["residuals"],
        row["stars"],
        (x, y),
        _array(row["field_arcsec"]).reshape(CELLS, CELLS, 2),
        _array(row["field_error_arcsec"]).reshape(CELLS, CELLS),
        np.array(row["field_stars"], dtype=np.int64).reshape(CELLS, CELLS),
        row["field_sigmas"],
        row["scale"],
        row["scale_error"],
    )
    listed = table["offsets"].combine_chunks().values
    columns = {of.name: listed.field(of.name) for of in listed.type}
    names = columns.pop("star").to_pylist()
    numbers = {name: of.to_numpy(zero_copy_only=False) for name, of in columns.items()}
    return SessionErrors(atlas, StarOffsets(star=numbers.pop("star_id"), **numbers), tuple(names))


def _flat(values: NDArray[np.float64]) -> list[float | None]:
    """All numbers, null where one is unknown."""
    return [value if math.isfinite(value) else None for value in values.ravel().tolist()]


def _array(values: list[float | None]) -> NDArray[np.float64]:
    return np.array(values, dtype=np.float64)


def _pair(columns: dict[str, NDArray[np.float32]], x: str, y: str) -> NDArray[np.float64]:
    return np.column_stack([columns[x], columns[y]]).astype(np.float64)


# The sensor: the atlases of its sessions, added up.

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
