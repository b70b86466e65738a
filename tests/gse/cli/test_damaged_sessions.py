"""Sessions of which a part is missing, through the commands that read one: told, and exit code 3."""

import os
from pathlib import Path

import pytest
from devices.command_line import Gse

from gse.config.station import BUILT_IN_TEXT

MADE = ("simulate", "--scenario", "own-answers", "--seconds", 30, "--rate-hz", 1)
COMMANDS = (
    "compare {cut} {whole}",
    "compare {whole} {cut} {whole}",
    "report {whole} {cut} --out {new}",
    "calibrate {cut}",
    "align {cut}",
    "conventions {cut}",
    "view {cut} --save {new}",
    "session verify {cut}",
    "session trim {cut} --from 2026-03-20T15:00:03Z --out {new}",
    "session export {cut} --format csv --out {new}",
    "session export {cut} --format ndjson --out {new}",
    "session export {cut} --format raw --out {new}",
    "session export {cut} --format parquet --out {new}",
    "session export {cut} --format mcap --out {new}",
    "decode {cut}",
    "report {cut} --out {new}",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sessions")


@pytest.fixture
def whole(folder: Path, gse: Gse) -> Path:
    path = folder / "whole.mcap"
    if not path.exists():
        assert gse(*MADE, "--file", path).code == 0
    return path


@pytest.fixture
def cut(folder: Path, whole: Path) -> Path:
    """Without its end."""
    content = whole.read_bytes()
    (folder / "cut.mcap").write_bytes(content[: len(content) * 9 // 10])
    return folder / "cut.mcap"


@pytest.fixture
def head(folder: Path, whole: Path) -> Path:
    """Its first bytes alone, without its station file."""
    (folder / "head.mcap").write_bytes(whole.read_bytes()[:100])
    return folder / "head.mcap"


@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_made_of_a_damaged_session_says_so(command: str, whole: Path, cut: Path, tmp_path: Path, gse: Gse):
    done = gse(*command.format(whole=whole, cut=cut, new=tmp_path / "new").split())
    assert done.code == 3
    assert any(
        word in done.out + done.err for word in ("damaged or lost its end", "damaged or incomplete", "not closed")
    )


def test_of_the_same_panoramas_those_are_compared_that_both_sessions_have(whole: Path, cut: Path, gse: Gse) -> None:
    """Both have the same errors: nothing differs, though one of them is shorter."""
    lines = gse("compare", whole, cut).out.splitlines()
    assert "the same panoramas in both" in lines
    for name in ("mean |dRA*|", "mean |dDE|"):
        (row,) = [line for line in lines if line.startswith(name)]
        assert abs(float(row.split()[-3])) < 1e-9


def test_a_session_without_anything_to_compare_is_no_side_of_a_comparison(whole: Path, head: Path, gse: Gse) -> None:
    for sides in ((whole, head), (head, whole), (whole, whole, head)):
        done = gse("compare", *sides)
        assert (done.code, "has neither a panorama nor an answer" in done.err) == (2, True)


def test_a_session_without_its_head_is_not_called_simulated(head: Path, tmp_path: Path, gse: Gse) -> None:
    for again in range(2):  # the second time from kept results
        done = gse("report", head, "--out", tmp_path / str(again))
        assert (done.code, done.out.splitlines()[0]) == (3, "INCONCLUSIVE: LAPAN-like (onboard), no frame came")


def test_the_camera_of_a_session_without_its_head_can_be_fitted_with_a_station_file(
    head: Path, tmp_path: Path, gse: Gse
) -> None:
    assert "give one by --station" in gse("calibrate", head).err
    (tmp_path / "station.yaml").write_text(BUILT_IN_TEXT + "limits: {availability: 0.9}\n")
    assert "the session holds no panorama" in gse("calibrate", head, "--station", tmp_path / "station.yaml").err


def test_a_station_file_comes_from_a_shells_pipe_and_is_read_once(whole: Path, tmp_path: Path, gse: Gse) -> None:
    reading, writing = os.pipe()
    os.write(writing, BUILT_IN_TEXT.replace("rooftop", "piped").encode())
    os.close(writing)
    done = gse("report", whole, "--station", f"/dev/fd/{reading}", "--out", tmp_path / "report")
    os.close(reading)
    assert done.code in (0, 1, 5)
    assert "piped" in (tmp_path / "report" / "report.json").read_text()
