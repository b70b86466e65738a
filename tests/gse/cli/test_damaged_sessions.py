"""Sessions of which a part is missing, through the commands that read one: told, and exit code 3."""

import os
from pathlib import Path

import pytest
from devices.command_line import Gse

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.sessions.status_file import StatusFile, read_status
from gse.station.events import Notes
from gse.view.live_state import LiveState

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


def test_a_session_that_is_being_recorded_is_not_called_damaged_until_its_process_ends(
    gse: Gse, cut: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "20260320T150000Z-sensor"
    folder.mkdir()
    (folder / "session.mcap").write_bytes(cut.read_bytes())
    status = StatusFile(folder, LiveState(parse_station(BUILT_IN_TEXT)), Notes())
    while read_status(folder) is None:
        pass
    try:
        for command in (("report", "--no-plots"), ("why",), ("view", "--out", tmp_path / "so far.rrd")):
            done = gse(command[0], folder, *command[1:])
            assert done.code in (0, 5)
            assert "is being recorded: this covers what there is so far" in done.err
            assert "damaged" not in done.out + done.err
            assert command[0] == "view" or ", so far (SIMULATED): LAPAN-like" in done.out
        assert "damaged" not in (folder / "report" / "report.html").read_text()
    finally:
        status.close(130)
    done = gse("report", folder, "--no-plots")
    assert done.code == 3
    assert "the session is damaged or lost its end" in done.err
    assert "so far" not in done.out


@pytest.mark.parametrize("options", [(), ("--start-utc", "2026-03-20T18:30:00Z")])
def test_junk_is_named_as_junk_and_leaves_no_folder(gse: Gse, tmp_path: Path, monkeypatch, options) -> None:
    monkeypatch.chdir(tmp_path)
    junk = tmp_path / "junk.bin"
    junk.write_bytes(bytes(range(250)) * 12)
    for command in ("replay", "report"):
        done = gse(command, "junk.bin", *options)
        assert done.code == 2
        assert done.err.endswith(
            "gse: junk.bin: 3,000 bytes, no valid frame of panorama-v1; find the protocol: gse decode --try junk.bin\n"
        )
    assert list(tmp_path.iterdir()) == [junk]


def test_a_description_of_a_protocol_is_checked_before_a_station_file_names_it(gse: Gse, tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("name: x\nbad: 1\n")
    done = gse("config", "init", tmp_path / "roof.yaml", "--yes", "--protocol", "bad.yaml")
    assert done.code == 2
    assert "bad.yaml, line 2: bad: unknown key" in done.err
    assert not (tmp_path / "roof.yaml").exists()
