"""Commands that write a file onto a full disk: it is told, and no half of a file is left."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from devices.command_line import Gse
from devices.full_disk import full_disk
from PIL import Image

from gse.cli.simulate import command as simulate
from gse.config.station import BUILT_IN_TEXT

WRITING = {
    "config init": "config init {new}",
    "extract": "extract {image} --out {new}",
    "session recover": "session recover {session} --out {new}",
    "session trim": "session trim {session} --from 2026-03-20T15:00:01Z --out {new}",
    "session export csv": "session export {session} --format csv --out {new}",
    "session export raw": "session export {session} --format raw --out {new}",
    "session export ndjson": "session export {session} --format ndjson --out {new}",
    "session export mcap": "session export {session} --format mcap --out {new}",
    "session export parquet": "session export {session} --format parquet --out {new}",
    "catalog export": "catalog export --list {new}",
    "why": "why {session} --bundle {new}",
}


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("given")
    simulate.main(["--seconds", "4", "--file", str(folder / "session.mcap")], standalone_mode=False)
    (folder / "station.yaml").write_text(BUILT_IN_TEXT)
    lights = np.zeros((64, 64), dtype=np.uint8)
    lights[5::6, 5::6] = 200
    Image.fromarray(lights).save(folder / "image.png")
    return folder


@pytest.mark.parametrize("name", WRITING)
def test_no_half_of_a_file_is_left(name: str, given: Path, tmp_path: Path, gse: Gse) -> None:
    new = tmp_path / "new"
    places = {"new": new, "session": given / "session.mcap", "image": given / "image.png"}
    command = [word.format(**places) for word in WRITING[name].split()]
    with full_disk(20):
        done = gse(*command)
    assert done.code in (2, 3)
    assert "File too large" in done.err
    assert [*tmp_path.iterdir()] == []
    assert gse(*command).code in (0, 5)
    assert new.exists()


def test_a_report_that_found_no_room_names_a_next_step_that_works(given: Path, tmp_path: Path, gse: Gse) -> None:
    with full_disk(20_000):  # the report has more
        done = gse("replay", given / "session.mcap", "--out", tmp_path / "new")
    assert done.code == 3
    assert "make room and repeat this command" in done.err
    assert [*(tmp_path / "new").rglob("report.*"), *(tmp_path / "new").rglob("junit.xml")] == []


def test_a_simulation_that_the_disk_does_not_take_whole_is_told(tmp_path: Path, gse: Gse) -> None:
    with full_disk(10_000):
        done = gse("simulate", "--seconds", "60", "--file", tmp_path / "session.mcap")
    assert done.code == 3
    assert "are not in" in done.err


def test_the_expected_report_of_before_stays(given: Path, tmp_path: Path, gse: Gse) -> None:
    shutil.copy(given / "session.mcap", tmp_path)
    expected = tmp_path / "session.report.json"
    expected.write_text("{}")
    with full_disk(1000):
        done = gse("ci", tmp_path, "--update")
    assert done.code in (1, 2)
    assert expected.read_text() == "{}"
    assert {path.name for path in tmp_path.iterdir()} == {"session.mcap", "session.report.json"}
