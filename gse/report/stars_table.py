"""The tables of stars and of names.

Stars: one row per matched star and frame, with residual, pixel phase, place in the field, temperature. Names: one row
per star that the sensor names (STARS messages), with what the station finds there.

Thinning: the rows are those that the frame table keeps (gse.station.session_tables). All matches of a frame are kept or
none: of every frame first, of every second, fourth, ... as soon as a session has more than MOST_MATCHES of them.
"""

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gse.catalog.stars import ListedStars
from gse.report.frames_table import KEY, instants, numbers, same_key, table_of
from gse.report.parquet import ROWS_AT_ONCE
from gse.report.table_columns import UTC, field, schema
from gse.station.session_data import SessionData
from gse.station.session_tables import MATCH, xy_px_of
from gse.station.star_names import judged_names
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD

_OF_MATCH = [name for name in MATCH.names or () if name not in ("frame", "star")]
_STAR = pa.dictionary(pa.int32(), pa.string())


def stars_schema() -> pa.Schema:
    """The schema of the table of stars."""
    kinds = [
        ("key", KEY),
        ("frame", pa.uint32()),
        ("utc", UTC),
        ("star", _STAR),
        ("star_id", pa.int64()),
        ("star_row", pa.int32()),
        ("magnitude_mag", pa.float32()),
        *((name, pa.from_numpy_dtype(MATCH[name])) for name in _OF_MATCH),
        *((name, pa.float32()) for name in ("phase_x_px", "phase_y_px", "field_x_deg", "field_y_deg")),
        ("temperature_c", pa.float32()),
    ]
    return schema("stars", [field(name, kind) for name, kind in kinds])


def names_schema() -> pa.Schema:
    """The schema of the table of names."""
    kinds = [
        ("key", KEY),
        ("utc", UTC),
        ("list", pa.uint32()),
        ("object", pa.uint16()),
        ("number", pa.int64()),
        ("star", _STAR),
        ("star_id", pa.int64()),
        ("wrong", pa.bool_()),
        ("residual_arcsec", pa.float32()),
    ]
    return schema("names", [field(name, kind) for name, kind in kinds])


def stars_table(session: SessionData, key: str) -> pa.Table:
    """The matches of a session; ``key`` is of the results.

    ``phase_*_px`` is the place of the star on its pixel, from -0.5 to 0.5 about the pixel's centre, where the attitude
    of the frame expects it: a sensor that sends whole pixels has no other. ``field_*_deg`` are angles from the
    boresight along columns and rows.
    """
    return _part(session, session.frames.matches, key)


def stars_parts(session: SessionData, key: str, *, rows_at_once: int = ROWS_AT_ONCE) -> Iterator[pa.Table]:
    """The same table in parts, at least one."""
    matches = session.frames.matches
    for first in range(0, max(len(matches), 1), rows_at_once):
        yield _part(session, matches[first : first + rows_at_once], key)


def _part(session: SessionData, matches: NDArray[np.void], key: str) -> pa.Table:
    frames, of_frame = session.frames.columns, matches["frame"]
    arrays = {
        "key": same_key(key, len(matches)),
        "frame": pa.array(np.ascontiguousarray(of_frame)),
        "utc": instants(frames["utc_ns"][of_frame]),
        "star_row": pa.array(np.ascontiguousarray(matches["star"])),
        "temperature_c": numbers(frames["temperature_c"][of_frame]),
        **_names(matches["star"], session.stars),
        **{name: numbers(np.ascontiguousarray(matches[name])) for name in _OF_MATCH},
        **_places(matches, session.station.sensor.camera()),
    }
    return table_of(arrays, stars_schema(), len(matches))


def _names(rows: NDArray[np.int32], stars: ListedStars | None) -> dict[str, pa.Array]:
    """Name, number and magnitude of catalogue rows (N,); null where the catalogue is not known."""
    if stars is None:
        kinds = {"star": _STAR, "star_id": pa.int64(), "magnitude_mag": pa.float32()}
        return {name: pa.nulls(len(rows), kind) for name, kind in kinds.items()}
    seen, places = np.unique(rows, return_inverse=True)
    names = pa.array([stars.name(row) for row in seen.tolist()], pa.string())
    return {
        "star": pa.DictionaryArray.from_arrays(pa.array(places.astype(np.int32)), names),
        "star_id": pa.array(stars.ids[seen][places]),
        "magnitude_mag": pa.array(stars.magnitude[seen][places].astype(np.float32)),
    }


def _places(matches: NDArray[np.void], camera: Camera) -> dict[str, pa.Array]:
    """Phase on the pixel and angles from the boresight of matches (N,)."""
    xy_px = xy_px_of(matches)
    directions_sensor = camera.directions(xy_px)
    field_deg = np.degrees(np.arctan2(directions_sensor[:, :2], directions_sensor[:, 2:]))
    residuals_arcsec = np.column_stack([matches["residual_x_arcsec"], matches["residual_y_arcsec"]])
    directions_sensor[:, :2] -= residuals_arcsec / ARCSEC_PER_RAD
    expected_px = camera.pixels(directions_sensor)
    phase_px = expected_px - np.floor(expected_px + 0.5)
    columns = {"phase_x_px": phase_px[:, 0], "phase_y_px": phase_px[:, 1]}
    columns |= {"field_x_deg": field_deg[:, 0], "field_y_deg": field_deg[:, 1]}
    return {name: numbers(values.astype(np.float32)) for name, values in columns.items()}


def names_table(session: SessionData, key: str) -> pa.Table:
    """The sensor's names by the instants of their panoramas; ``star`` and ``wrong`` are null where nobody knows."""
    return pa.concat_tables(names_parts(session, key), promote_options="none").unify_dictionaries()


def names_parts(session: SessionData, key: str) -> Iterator[pa.Table]:
    """The same table in parts, at least one."""
    rows, stars = session.star_names.rows, session.stars
    unknown = rows["star"] < 0
    is_known, is_wrong, _ = judged_names(rows, stars) if stars else (np.zeros(len(rows), dtype=np.bool_), unknown, True)
    order = np.argsort(rows["utc_ns"], kind="stable")
    for first in range(0, max(len(rows), 1), ROWS_AT_ONCE):
        some = order[first : first + ROWS_AT_ONCE]
        part, nameless = rows[some], unknown[some]
        found = _names(np.maximum(part["star"], 0), stars)
        arrays = {
            "key": same_key(key, len(part)),
            "utc": instants(np.ascontiguousarray(part["utc_ns"])),
            **{name: pa.array(np.ascontiguousarray(part[name])) for name in ("list", "object", "number")},
            **{name: pc.if_else(pa.array(nameless), None, found[name]) for name in ("star", "star_id")},
            "wrong": pa.array(is_wrong[some], mask=~is_known[some]),
            "residual_arcsec": numbers(np.ascontiguousarray(part["residual_arcsec"])),
        }
        yield table_of(arrays, names_schema(), len(part))
