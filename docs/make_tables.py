"""Writes docs/tables.md, the columns of the tables of results, from the schemas themselves.

python docs/make_tables.py
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from gse.campaign.sensor_atlas import atlas_schema
from gse.report.parquet import SCHEMA_VERSION
from gse.report.sessions_table import sessions_schema
from gse.report.tables import frames_schema, housekeeping_schema, names_schema, stars_schema
from gse.station.columns import COLUMNS, OWN_COLUMNS, Column
from gse.station.results import Subject

HEAD = f"""\
# Tables of results

The results of judged sessions as [Arrow](https://arrow.apache.org) tables, in [Parquet](https://parquet.apache.org)
files that pandas, polars and DuckDB read as they lie. This page is made by `docs/make_tables.py`.

| table | one row per | schema |
|---|---|---|
| sessions | session: verdict, every figure with its interval, conditions, hashes | `gse.sessions/{SCHEMA_VERSION}` |
| frames | panorama: time, answers of each subject, errors, sky | `gse.frames/{SCHEMA_VERSION}` |
| stars | matched star and frame: residual, pixel phase, field position, temperature | `gse.stars/{SCHEMA_VERSION}` |
| housekeeping | value of an item of the sensor's housekeeping, with its colour | `gse.housekeeping/{SCHEMA_VERSION}` |
| names | star that the sensor names (`STARS`), with what the station finds there | `gse.names/{SCHEMA_VERSION}` |
| atlas (of a campaign alone) | session with enough stars: its part of the error atlas | `gse.atlas/{SCHEMA_VERSION}` |

* `key` joins the tables: the SHA-256 of what the results follow from, which are the session's bytes
  (`session_sha256`), the station file in force (`station_sha256`) and the software (`software_sha256`: its source and
  the packages that numbers depend on). Same key, same results. `frame` counts the panoramas of a session from 0 and
  joins stars with frames.
* A name ends with its unit. The metadata of each column repeat the `unit` and name the `subject`: `onboard` is the
  identifier under test, `sensor` the answers that the sensor itself sends. The metadata of a table name its `schema`.
* What is unknown, or not bounded, is null, never NaN or 0. Instants are UTC, to the nanosecond.
* The version of the schema grows where a column goes or changes its name, type or meaning, not for a new column.
* Intervals: `low` and `high` hold the true value between them with 95 %; the true value is above `lower` with 95 %, and
  below `upper` with 95 %. `n_eff` is the number of independent frames that the session is worth.
  [Metrics](metrics.md) and [Uncertainty](uncertainty.md) explain the figures.
* Stars are thinned: a session keeps at most 250,000 of them. All matched stars of a frame are kept, or none: of every
  frame first, of every second, fourth, ... frame as soon as there are more. `phase_x_px`, `phase_y_px` are where the
  attitude of the frame expects the star on its pixel, from -0.5 to 0.5 about the centre; `field_x_deg`, `field_y_deg`
  angles from the boresight along columns and rows.
* Housekeeping: `utc` is the host's, when the frame was complete; `value` is in `unit`, of words and bits it is the
  number on the wire beside its `word`. `colour` is that of the item's limits, null without any.
* Names: `utc` is that of the panorama, `list` counts the lists of a session from 1, `object` is the place in the
  panorama, `number` what the sensor calls the star; `star` and `star_id` are what the station finds there, null where
  it finds none. `wrong` is null where nothing is known of the number. The first 1,000,000 names are kept.
* `night` is the date of the evening on which the session's night began, in the mean time of the site's longitude.
* A session that could not be judged has a row in sessions: `source`, `error`, and nulls.
* Atlas: `phase` has the pixel phase error along columns and rows: the first harmonic (sine, cosine), its covariance
  by rows, and the mean residual with its standard error over 20 parts of a pixel; `field_*` are of 8 x 8 cells of the
  detector, row by row; `scale` is the relative error of the focal length; `offsets` are those of the stars from their
  catalogue places.
"""
AXES = ("d_ra_cosde", "d_de", "d_roll", "cross_x", "cross_y", "half_cone_95")
_SUBJECT = re.compile(r"^(onboard|sensor)_")
_AXIS = re.compile(rf"_({'|'.join(AXES)})_(?!star_)")
"""Figures of single stars are the onboard subject's alone."""


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    schemas = {"sessions": sessions_schema, "frames": frames_schema, "stars": stars_schema, "atlas": atlas_schema}
    schemas |= {"housekeeping": housekeeping_schema, "names": names_schema}
    for name, schema in schemas.items():
        if name == "frames":
            parts += ["\n## frames\n\n| column | type | unit | meaning |\n|---|---|---|---|\n", *_frame_lines()]
            continue
        parts.append(f"\n## {name}\n\n| column | type | unit |\n|---|---|---|\n")
        parts += dict.fromkeys(_lines(schema(), is_figures=name == "sessions"))
        if name == "sessions":
            parts.append(
                f"\nSUBJECT is `onboard` or `sensor`, AXIS one of {', '.join(f'`{axis}`' for axis in AXES)}.\n"
            )
    return "".join(parts)


def _lines(schema: pa.Schema, *, is_figures: bool) -> Iterator[str]:
    """A line per column; figures of all subjects and axes have one line together."""
    for field in schema:
        name = field.name
        if is_figures:
            name = _AXIS.sub("_AXIS_", _SUBJECT.sub("SUBJECT_", name)) if _AXIS.search(name) else name
        yield f"| `{name}` | {_kind(field.type)} | {field.metadata[b'unit'].decode()} |\n"


def _frame_lines() -> Iterator[str]:
    """A line per column of the frames, with what it says; words are listed."""
    says = {
        "key": "joins the tables",
        "frame": "number of the frame in its session, from 0",
        "expected": "whether an answer was expected",
        "excluded": "whether the statistics leave the frame out",
    }
    for subject in Subject:
        says[f"{subject}_false"] = "whether the answer is false"
        says[f"{subject}_used"] = "whether the statistics of errors use the answer"
        says |= {column.name_of(subject): _says(column) for column in COLUMNS}
    says |= {f"{Subject.SENSOR}_{column.name}": column.says for column in OWN_COLUMNS}
    for line, field in zip(_lines(frames_schema(), is_figures=False), frames_schema(), strict=True):
        yield f"{line.rstrip()} {says[field.name]} |\n"


def _says(column: Column) -> str:
    words = ", ".join(f"`{word.value}`" for word in column.words)
    return f"{column.says}: {words}" if words else column.says


def _kind(kind: pa.DataType) -> str:
    if pa.types.is_dictionary(kind):
        return _kind(kind.value_type)
    if pa.types.is_list(kind):
        return f"list of {_kind(kind.value_type)}"
    if pa.types.is_struct(kind):
        return "{" + ", ".join(f"{field.name}: {_kind(field.type)}" for field in kind) + "}"
    return str(kind)


if __name__ == "__main__":
    Path(__file__).with_name("tables.md").write_text(page(), encoding="utf-8")
