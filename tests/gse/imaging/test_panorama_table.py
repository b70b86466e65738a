"""Panorama tables are read as the paper stores them, and refused in words."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gse.errors import TableError
from gse.imaging.panorama_table import read_panorama_table


def table(folder: Path, text: str | bytes) -> Path:
    path = folder / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    ["y,x,index\n10,20,300\n11,21,200\n", "10 20 300\n11 21 200\n", "# sky\n10, 20, 300 # bright\n\n11;21\t200\n"],
)
def test_commas_blanks_comments_and_a_header_are_read(tmp_path: Path, text: str) -> None:
    xy_px, index = read_panorama_table(table(tmp_path, text))
    assert xy_px.tolist() == [[20, 10], [21, 11]]
    assert index.tolist() == [300, 200]


def test_objects_come_brightest_first(tmp_path: Path) -> None:
    _, index = read_panorama_table(table(tmp_path, "1 1 5\n2 2 9\n3 3 7\n"))
    assert index.tolist() == [9, 7, 5]


def test_the_zeros_of_a_padded_table_are_no_objects(tmp_path: Path) -> None:
    xy_px, index = read_panorama_table(table(tmp_path, "1 2 5\n0 0 7\n0 0 0\n" + "0,0,0\n" * 40))
    assert xy_px.tolist() == [[0, 0], [2, 1]]
    assert index.tolist() == [7, 5]


def test_a_further_column_is_not_looked_at(tmp_path: Path) -> None:
    xy_px, _ = read_panorama_table(table(tmp_path, "y,x,index,flux\n1.25,2.5,3,anything\n"))
    assert xy_px.tolist() == [[2.5, 1.25]]


@pytest.mark.parametrize("text", ["1 2\n", "one two three\n", "1 2 nan\n", "1 inf 3\n", "1 1 1\ny,x,index\n"])
def test_what_is_no_object_is_named_with_its_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(TableError, match=r"line [12]: "):
        read_panorama_table(table(tmp_path, text))


def test_thirty_one_objects_are_one_too_many(tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"line 31.*30"):
        read_panorama_table(table(tmp_path, "1 1 1\n" * 31))


def test_an_empty_table_is_an_empty_panorama(tmp_path: Path) -> None:
    xy_px, index = read_panorama_table(table(tmp_path, ""))
    assert xy_px.shape == (0, 2)
    assert index.shape == (0,)


@given(data=st.binary(max_size=300))
def test_any_bytes_are_a_table_or_refused(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = table(tmp_path_factory.mktemp("tables"), data)
    try:
        xy_px, index = read_panorama_table(path)
    except TableError:
        return
    assert np.isfinite(xy_px).all()
    assert len(index) <= 30
