"""The tables of a session: of its frames, its stars, the names that the sensor gives them, and its housekeeping.

Frames: one row per panorama, with time, the subjects' answers, their errors, and the sky. Its columns are those of
gse.station.columns; one that is added there is a column here. Answers begin with their subject. A sensor that sends no
panoramas is the subject of the frame table itself: then those of ``onboard`` are null.

Stars: one row per matched star and frame, with residual, pixel phase, place in the field, temperature. Names: one row
per star that the sensor names (STARS messages), with what the station finds there. Housekeeping: one row per value of
an item that the sensor sent, with its colour.

Thinning: the rows of stars are those that the frame table keeps (gse.station.session_tables). All matches of a frame
are kept or none: of every frame first, of every second, fourth, ... as soon as a session has more than MOST_MATCHES.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gse.catalog.stars import ListedStars
from gse.report.parquet import ROWS_AT_ONCE, UTC, field, schema
from gse.station.columns import COLUMNS, OWN_COLUMNS, STATUSES, Column
from gse.station.frame_columns import Columns
from gse.station.own_answers import SensorAnswers
from gse.station.results import Status, Subject
from gse.station.session_data import SessionData
from gse.station.session_tables import MATCH, xy_px_of
from gse.station.star_names import judged_names
from gse.statistics.session_statistics import Statistics
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD
from protocols import COLOURS

KEY = pa.dictionary(pa.int32(), pa.string())
"""The key in each row of frames and stars: stored once."""

_FEW_WORDS = pa.dictionary(pa.int8(), pa.string())
_COMMON = tuple(column for column in COLUMNS if not column.of_answer)
_OF_ANSWER = tuple(column for column in COLUMNS if column.of_answer)
_COUNTED = ("expected", "excluded")
_COUNTED_OF_SUBJECT = ("false", "used")
"""Masks of CountedFrames that are of the whole frame, and of the answers in the frame table."""


def frames_schema() -> pa.Schema:
    """The schema of the table of frames."""
    kinds = {"key": KEY, "frame": pa.uint32()}
    kinds |= {column.name_of(Subject.ONBOARD): _kind(column) for column in _COMMON}
    kinds |= dict.fromkeys(_COUNTED, pa.bool_())
    for subject in Subject:
        kinds |= {column.name_of(subject): _kind(column) for column in _OF_ANSWER}
        kinds |= {f"{subject}_{name}": pa.bool_() for name in _COUNTED_OF_SUBJECT}
    kinds |= {f"{Subject.SENSOR}_{column.name}": _kind(column) for column in OWN_COLUMNS}
    return schema("frames", [field(name, kind) for name, kind in kinds.items()])


def frames_parts(
    session: SessionData, stats: Statistics, key: str, *, rows_at_once: int = ROWS_AT_ONCE
) -> Iterator[pa.Table]:
    """The frames of a session as a table in parts, at least one: that of 8 h at 10 Hz takes 90 MB.

    ``key`` is of the results. What is unknown is null.
    """
    count = len(session.frames.columns)
    for first in range(0, max(count, 1), rows_at_once):
        yield _frames_part(session, stats, key, slice(first, min(first + rows_at_once, count)))


def _frames_part(session: SessionData, stats: Statistics, key: str, rows: slice) -> pa.Table:
    frames, counted = session.frames.columns[rows], stats.counted
    numbered = np.arange(rows.start, rows.stop, dtype=np.uint32)
    arrays = {"key": same_key(key, len(frames)), "frame": pa.array(numbered)}
    arrays |= {column.name_of(session.subject): arrow_column(column, frames[column.name]) for column in COLUMNS}
    arrays |= {name: pa.array(getattr(counted, name)[rows]) for name in _COUNTED}
    arrays |= {f"{session.subject}_{name}": pa.array(getattr(counted, name)[rows]) for name in _COUNTED_OF_SUBJECT}
    of_sensor = _own(frames) if session.subject is Subject.SENSOR else _beside_panoramas(stats.own, rows)
    arrays |= {f"{Subject.SENSOR}_{name}": numbers(values) for name, values in of_sensor.items()}
    return table_of(arrays, frames_schema(), len(frames))


def table_of(arrays: dict[str, pa.Array], like: pa.Schema, count: int) -> pa.Table:
    """The arrays as a table of ``count`` rows; a column of the schema that is not among them is null."""
    columns = [arrays[of.name].cast(of.type) if of.name in arrays else pa.nulls(count, of.type) for of in like]
    return pa.table(columns, schema=like)


def arrow_column(column: Column, values: NDArray[Any]) -> pa.Array:
    """Values of a column in Arrow: instants, words for their places, null for unknown numbers."""
    values = np.ascontiguousarray(values)
    if column.is_instant:
        return instants(values)
    if column.words:
        return pa.DictionaryArray.from_arrays(pa.array(values.astype(np.int8)), [word.value for word in column.words])
    return numbers(values)


def instants(utc_ns: NDArray[np.int64]) -> pa.Array:
    """UTC in nanoseconds as instants."""
    return pa.array(utc_ns, pa.int64()).cast(UTC)


def numbers(values: NDArray[Any]) -> pa.Array:
    """An array with null where a number is unknown."""
    return pa.array(values, mask=np.isnan(values)) if values.dtype.kind == "f" else pa.array(values)


def same_key(key: str, count: int) -> pa.Array:
    """The column of a key that all rows share."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, dtype=np.int32)), [key])


def _own(frames: Columns) -> dict[str, NDArray[Any]]:
    """What SensorAnswers says beside panoramas, of a frame table that holds the sensor's answers themselves."""
    arrival_ms = (frames["host_utc_ns"] - frames["utc_ns"]) / 1e6
    return {
        "sent": np.ones(len(frames), dtype=bool),
        "acquired": frames["status"] == STATUSES.index(Status.IDENTIFIED),
        "latency_ms": frames["elapsed_us"] / 1e3,
        "arrival_ms": np.where(frames["host_utc_ns"] > 0, arrival_ms, np.nan),
    }


def _beside_panoramas(own: SensorAnswers | None, rows: slice) -> dict[str, NDArray[Any]]:
    return {} if own is None else {column.name: getattr(own, column.name)[rows] for column in OWN_COLUMNS}


def _kind(column: Column) -> pa.DataType:
    if column.is_instant:
        return UTC
    return _FEW_WORDS if column.words else pa.from_numpy_dtype(np.dtype(column.dtype))


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


def stars_parts(session: SessionData, key: str, *, rows_at_once: int = ROWS_AT_ONCE) -> Iterator[pa.Table]:
    """The matches of a session as a table in parts, at least one; ``key`` is of the results.

    ``phase_*_px`` is the place of the star on its pixel, from -0.5 to 0.5 about the pixel's centre, where the attitude
    of the frame expects it: a sensor that sends whole pixels has no other. ``field_*_deg`` are angles from the
    boresight along columns and rows.
    """
    matches = session.frames.matches
    for first in range(0, max(len(matches), 1), rows_at_once):
        yield _stars_part(session, matches[first : first + rows_at_once], key)


def _stars_part(session: SessionData, matches: NDArray[np.void], key: str) -> pa.Table:
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


def names_parts(session: SessionData, key: str) -> Iterator[pa.Table]:
    """The sensor's names by the instants of their panoramas, as a table in parts, at least one.

    ``star`` and ``wrong`` are null where nobody knows.
    """
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


_WORD = pa.dictionary(pa.int32(), pa.string())


def housekeeping_schema() -> pa.Schema:
    """The schema of the table of housekeeping."""
    kinds = [("key", KEY), ("utc", UTC), ("item", _WORD), ("value", pa.float64()), ("word", _WORD), ("unit", _WORD)]
    return schema("housekeeping", [field(name, kind) for name, kind in [*kinds, ("colour", _WORD)]])


def housekeeping_parts(session: SessionData, key: str) -> Iterator[pa.Table]:
    """All values of housekeeping as a table in parts, at least one.

    ``value`` is in the ``unit`` of the item, of words and bits it is the number on the wire.
    """
    rows, items = session.housekeeping.rows, session.housekeeping.items
    names = pa.array([item.name for item in items], pa.string())
    units = pa.array([item.unit for item in items], pa.string())
    without_unit = np.array([not item.unit for item in items], dtype=np.bool_)
    for first in range(0, max(len(rows), 1), ROWS_AT_ONCE):
        part = rows[first : first + ROWS_AT_ONCE]
        item, value = np.asarray(part["item"]).astype(np.int32), np.array(part["value"])
        colour = np.asarray(part["colour"]).astype(np.int32)
        words: list[str | None] = [None] * len(value)
        for number in np.unique(item).tolist():
            if items[number].words or items[number].are_bits:
                for at in np.flatnonzero(item == number).tolist():
                    words[at] = str(items[number].value(float(value[at])))
        arrays = {
            "key": same_key(key, len(value)),
            "utc": instants(np.array(part["utc_ns"])),
            "item": pa.DictionaryArray.from_arrays(pa.array(item), names),
            "value": numbers(value),
            "word": pa.array(words, pa.string()).dictionary_encode(),
            "unit": pa.DictionaryArray.from_arrays(pa.array(item, mask=without_unit[item]), units),
            "colour": pa.DictionaryArray.from_arrays(pa.array(colour, mask=colour == 0), pa.array(COLOURS)),
        }
        yield table_of(arrays, housekeeping_schema(), len(value))
