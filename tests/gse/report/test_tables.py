"""Tables of judged sessions: true to the session, readable by others, with units in names and metadata."""

import sys
from dataclasses import fields
from datetime import date
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from skies.own_answers import with_answers
from skies.synthetic_night import small_catalog, synthetic_night

from gse.report.parquet import joined, write_parquet
from gse.report.provenance import ResultKey
from gse.report.sessions_table import failed_session, night_of, session_tables, sessions_schema
from gse.report.tables import frames_parts, frames_schema, stars_parts, stars_schema
from gse.station.columns import COLUMNS
from gse.station.own_answers import sensor_answers
from gse.station.results import Subject
from gse.station.session_tables import MATCH
from gse.values.instant import from_text
from gse.verdict.assessment import judge

KEY = ResultKey("a" * 64, "b" * 64, "c" * 64)
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def session():
    made = synthetic_night(700)
    made.stars = small_catalog().listed
    return made


@pytest.fixture(scope="module")
def assessment(session):
    return judge(session)


@pytest.fixture(scope="module")
def tables(session, assessment):
    return session_tables(session, assessment, KEY, source="night-1")


def test_the_tables_have_their_schemas_with_and_without_a_session(tables) -> None:
    assert tables.sessions.schema.equals(sessions_schema(), check_metadata=True)
    assert tables.frames.schema.equals(frames_schema(), check_metadata=True)
    assert tables.stars.schema.equals(stars_schema(), check_metadata=True)
    assert failed_session("night-2", "no such file").schema.equals(sessions_schema(), check_metadata=True)
    assert [schema.metadata[b"schema"].decode() for schema in (sessions_schema(), frames_schema(), stars_schema())] == [
        "gse.sessions/1",
        "gse.frames/1",
        "gse.stars/1",
    ]


def test_no_two_columns_have_one_name() -> None:
    for schema in (sessions_schema(), frames_schema(), stars_schema()):
        assert len(set(schema.names)) == len(schema.names)


def test_each_column_of_the_frame_table_is_a_column_with_its_values(session, tables) -> None:
    frames = session.frames.columns
    for declared in COLUMNS:
        name, column = declared.name, tables.frames[declared.name_of(Subject.ONBOARD)]
        if declared.words:
            assert column.to_pylist() == [declared.words[place].value for place in frames[name].tolist()]
        elif name.endswith("utc_ns"):
            np.testing.assert_array_equal(column.cast(pa.int64()).to_numpy(), frames[name])
        else:
            unknown = np.isnan(frames[name]) if frames[name].dtype.kind == "f" else np.zeros(len(frames), bool)
            np.testing.assert_array_equal(np.array(column.is_null()), unknown)
            np.testing.assert_array_equal(column.to_numpy()[~unknown], frames[name][~unknown])


def test_each_column_of_the_sensors_own_answers_has_the_type_of_its_array(session) -> None:
    frames = session.frames.columns
    angles = np.column_stack([frames[name] for name in ("ra_deg", "de_deg", "roll_deg")])
    answered = with_answers(session, angles, frames["matched"])
    own = sensor_answers(answered)
    for column in fields(own):
        kind = pa.from_numpy_dtype(getattr(own, column.name).dtype)
        assert frames_schema().field(f"sensor_{column.name}").type == kind, column.name


@pytest.mark.parametrize("rows_at_once", [60, 99, 100, 700, 701])
def test_a_long_table_is_made_and_written_in_parts(session, assessment, tables, tmp_path, rows_at_once) -> None:
    of_frames = frames_parts(session, assessment.statistics, KEY.text, rows_at_once=rows_at_once)
    of_stars = stars_parts(session, KEY.text, rows_at_once=rows_at_once)
    for parts, whole in ((list(of_frames), tables.frames), (list(of_stars), tables.stars)):
        assert max(part.num_rows for part in parts) <= rows_at_once
        write_parquet(parts, tmp_path / "parts.parquet")
        assert plain(pq.read_table(tmp_path / "parts.parquet")).equals(plain(whole))


def plain(table: pa.Table) -> pa.Table:
    """A table with words in the place of dictionaries: each part has its own."""
    arrays = [column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column for column in table.columns]
    return pa.table(arrays, names=table.column_names)


def test_stars_stand_on_their_pixels_and_in_the_field(session, tables) -> None:
    matches, stars = session.frames.matches, tables.stars
    assert stars.num_rows == len(matches)
    for name in MATCH.names or ():
        column = stars["star_row" if name == "star" else name].to_numpy()
        np.testing.assert_array_equal(column, matches[name])
    assert stars["star_id"].to_numpy().tolist() == session.stars.ids[matches["star"]].tolist()
    assert stars["star"][0].as_py() == session.stars.name(int(matches["star"][0]))
    camera = session.station.sensor.camera()
    pixel_arcsec = np.degrees(1 / camera.focal_length_px) * 3600
    # further out a pixel is smaller than at the boresight
    near = np.hypot(stars["field_x_deg"].to_numpy(), stars["field_y_deg"].to_numpy()) < 5
    expected_px = matches["x_px"] - matches["residual_x_arcsec"] / pixel_arcsec
    phase = expected_px - np.round(expected_px)
    off = np.abs(stars["phase_x_px"].to_numpy() - phase)
    assert np.minimum(off, 1 - off)[near].max() < 5e-3
    tangent = (matches["x_px"] - camera.principal_point_px[0]) / camera.focal_length_px
    np.testing.assert_allclose(stars["field_x_deg"].to_numpy(), np.degrees(np.arctan(tangent)), atol=1e-4)


def test_the_row_of_a_session_gives_verdict_figures_and_hashes(session, assessment, tables) -> None:
    row = tables.sessions.to_pylist()[0]
    de = assessment.statistics.onboard.axes["d_de"]
    assert row["key"] == KEY.text
    assert row["session_sha256"] == "a" * 64
    assert row["verdict"] == assessment.verdict
    assert row["onboard_d_de_bias_arcsec"] == de.bias_arcsec
    assert row["onboard_d_de_bias_low_arcsec"] == de.bias_bounds_arcsec.low
    assert row["onboard_available"] == assessment.statistics.onboard.available.value
    assert row["sensor_d_de_bias_arcsec"] is None
    assert [item["outcome"] for item in row["measurements"]] == [item.outcome for item in assessment.rows]
    assert row["site_latitude_deg"] == session.station.site.latitude_deg
    assert row["exposure_max_s"] == session.frames.columns["exposure_s"].max()
    assert row["night"] == date(2026, 3, 20)


def test_the_row_of_a_session_that_could_not_be_judged_says_why() -> None:
    row = failed_session("night-2", "night-2 is empty").to_pylist()[0]
    assert row["source"] == "night-2"
    assert row["error"] == "night-2 is empty"
    assert {name for name, value in row.items() if value is not None} == {"source", "error"}


def test_units_and_subjects_survive_a_parquet_file(tables, tmp_path: Path) -> None:
    pq.write_table(tables.frames, tmp_path / "frames.parquet")
    read = pq.read_table(tmp_path / "frames.parquet")
    assert read.equals(tables.frames)
    assert read.schema.metadata[b"schema"] == b"gse.frames/1"
    field = read.schema.field("onboard_d_de_arcsec")
    assert (field.metadata[b"unit"], field.metadata[b"subject"]) == (b"arcsec", b"onboard")
    assert read.schema.field("utc").metadata[b"unit"] == b"UTC"


def test_a_night_has_the_date_of_its_evening_at_the_site() -> None:
    jakarta_deg, hawaii_deg = 106.7, -155.5
    assert night_of(from_text("2026-03-20T12:00:00Z"), jakarta_deg) == date(2026, 3, 20)
    assert night_of(from_text("2026-03-20T22:00:00Z"), jakarta_deg) == date(2026, 3, 20)
    assert night_of(from_text("2026-03-21T06:00:00Z"), hawaii_deg) == date(2026, 3, 20)
    assert night_of(from_text("2026-03-21T15:00:00Z"), hawaii_deg) == date(2026, 3, 20)


def test_a_name_has_its_unit_last() -> None:
    assert joined("onboard_time_ms", "p50") == "onboard_time_p50_ms"
    assert joined("onboard_time_ms", "n") == "onboard_time_n"
    assert joined("onboard_d_de", "nea_arcsec") == "onboard_d_de_nea_arcsec"
    assert joined("d_de_bias_bounds_arcsec", "low") == "d_de_bias_low_arcsec"
    assert joined("onboard_available", "value") == "onboard_available"


def test_the_documentation_lists_the_columns() -> None:
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import make_tables
    finally:
        sys.path.pop(0)
    text = (ROOT / "docs" / "tables.md").read_text(encoding="utf-8")
    assert text == make_tables.page(), "run: python docs/make_tables.py"
