"""The Python interface, and the page of its documentation, which runs line by line."""

import doctest
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas
import pyarrow as pa
import pytest

import gse
from gse.errors import UsageError
from gse.imaging.panorama_table import read_panorama_table
from gse.report.parquet import write_parquet
from gse.report.sessions_table import sessions_schema
from gse.report.tables import frames_schema, stars_schema

ROOT = Path(__file__).parents[2]
STATION = ROOT / "replays/night-sky/rooftop-alt60-azi45.yaml"
TABLE = ROOT / "benchmarks/real-sky/tables/rooftop-alt60-azi45.csv"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("api") / "clear.mcap"
    shutil.copy(ROOT / "replays" / "golden" / "clear.mcap", path)
    return path


def test_the_page_on_python_runs_line_by_line(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(session.parent)
    done = doctest.testfile(str(ROOT / "docs" / "python.md"), module_relative=False)
    assert done.attempted > 15
    assert done.failed == 0


def with_key(table: pa.Table, key: str) -> pa.Table:
    place = table.column_names.index("key")
    keys = pa.array([key] * len(table)).cast(table.schema.field("key").type)
    return table.set_column(place, table.schema.field("key"), keys)


def test_a_data_set_of_many_sessions_is_loaded_like_one(session: Path, tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    from gse.campaign.dataset import Committed, DataSet, without_place

    one = gse.load(session)
    dataset = DataSet.at(str(tmp_path / "nights"), create=True)
    for number, night in enumerate(("2026-03-20", "2026-03-21", "unfinished")):
        place = Committed("LAPAN-like", night, str(number) * 64)
        for name in ("stars", "frames", "sessions")[: 2 if night == "unfinished" else 3]:
            write_parquet([without_place(with_key(getattr(one, name), place.key))], tmp_path / name)
            dataset.put(place, name, tmp_path / name)
    many = gse.load(tmp_path / "nights")
    assert many.frames.num_rows == 2 * one.frames.num_rows
    assert set(many.frames.column("night").to_pylist()) == {"2026-03-20", "2026-03-21"}
    assert many.sessions.column("verdict").to_pylist() == ["PASS", "PASS"]


def test_the_tables_have_the_documented_columns(session: Path) -> None:
    results = gse.load(session)
    for table, schema in (
        (results.sessions, sessions_schema()),
        (results.frames, frames_schema()),
        (results.stars, stars_schema()),
    ):
        assert table.schema.equals(schema, check_metadata=True)


def test_what_is_no_session_or_panorama_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no session")
    with pytest.raises(UsageError, match="no valid frame"):
        gse.load(tmp_path / "notes.txt")
    with pytest.raises(UsageError, match="is not on this host"):
        gse.load("s3://nights/dataset")
    (tmp_path / "dataset.json").write_text('{"schema": "gse.dataset/999"}')
    with pytest.raises(UsageError, match="another version"):
        gse.load(tmp_path)
    (tmp_path / "dataset.json").write_text('{"schema": "gse.dataset/1"}')
    with pytest.raises(UsageError, match="there is no session in"):
        _ = gse.load(tmp_path).frames


@pytest.mark.parametrize(
    ("panorama", "word"),
    [
        ((np.zeros((2, 2)), np.ones(3)), r"\(2, 2\) and brightness \(3,\) came"),
        ((np.zeros((2, 6)), np.ones(6)), r"\(2, 6\) and brightness \(6,\) came"),
        ((np.zeros(6), np.ones(3)), "expected pixels"),
        ((np.full((2, 2), np.nan), np.ones(2)), "not finite"),
        ((np.zeros((2, 2)), [1.0, 2.0]), "brightest object first"),
        ((np.zeros((2, 2)), [-3.0, -4.0]), "is negative"),
        (([[1.0, 2.0], [3.0]], [1.0, 1.0]), "this is not a panorama"),
        (None, "this is not a panorama"),
        (np.array([["a", "b", "c"]], dtype=object), "this is not a panorama"),
        (np.array([[1.0, 2.0, 10**400]], dtype=object), "this is not a panorama"),
        (np.ones((4, 3)) + 1j, "complex or masked"),
        (np.ma.masked_less(np.ones((4, 3)), 2.0), "complex or masked"),
    ],
)
def test_arrays_that_are_no_panorama_are_refused_and_not_reshaped(panorama, word) -> None:
    with pytest.raises(UsageError, match=word):
        gse.identify(panorama)


def test_gse_alone_imports_nothing_heavy() -> None:
    code = "import sys, gse; print([name for name in ('numpy', 'pyarrow', 'click') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    with pytest.raises(AttributeError, match="no attribute 'jugde'"):
        _ = gse.jugde  # type: ignore[attr-defined]
    assert dir(gse) == ["identify", "judge", "load", "session"]


def test_a_verdict_is_five_lines_and_a_table_in_a_notebook(session) -> None:
    verdict = gse.judge(session)
    lines = repr(verdict).splitlines()
    assert len(lines) <= 5
    assert all(len(line) <= 110 for line in lines)
    assert lines[0].startswith(f"<gse verdict: {verdict.word} (SIMULATED), ")
    html = verdict._repr_html_()
    assert html.count("<tr>") == 1 + len(verdict.rows)
    assert "mean |dRA*|" in html


@pytest.mark.parametrize("kind", ["data frame", "table", "array"])
def test_a_panorama_may_be_a_data_frame_a_table_or_an_array_in_any_order(kind) -> None:
    xy_px, brightness = read_panorama_table(TABLE)
    rows = np.column_stack([xy_px, brightness])[::-1]
    columns = dict(zip(("x_px", "y_px", "brightness"), rows.T, strict=True))
    given = {"data frame": pandas.DataFrame(columns), "table": pa.table(columns), "array": rows}[kind]
    expected, found = (gse.identify(one, station=STATION) for one in (TABLE, given))
    assert found.attitude.ra_deg == pytest.approx(expected.attitude.ra_deg, abs=1e-9)


def test_a_table_without_its_columns_is_told_which_it_has() -> None:
    with pytest.raises(UsageError, match="no column x_px or x; it has a, b"):
        gse.identify(pandas.DataFrame({"a": [1.0], "b": [2.0]}))


def test_each_cell_of_the_notebook_runs_and_shows_what_stands_there() -> None:
    """python docs/make_notebook.py writes it; digits and pictures may differ between machines."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import make_notebook
    finally:
        sys.path.pop(0)
    written = json.loads((ROOT / "docs" / "notebook.ipynb").read_text(encoding="utf-8"))
    assert len(written["cells"]) > 5
    for kept, made in zip(written["cells"], make_notebook.notebook()["cells"], strict=True):
        assert kept["source"] == made["source"]
        assert [set(one.get("data", ())) for one in kept.get("outputs", ())] == [
            set(one.get("data", ())) for one in made.get("outputs", ())
        ]
