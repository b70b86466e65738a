"""``gse config init``: questions on a terminal, a commented station file that is right as it is written."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from gse.cli import main
from gse.cli.config import Draft, draft_text
from gse.config.station import parse_station, read_station
from gse.errors import ConfigError
from gse.values.mount import MountUncertainty

GSE = str(Path(sys.executable).with_name("gse"))


def run(*arguments: object) -> int:
    """The exit code of ``gse config init``."""
    with pytest.raises(SystemExit) as done:
        main(["config", "init", *map(str, arguments)])
    assert isinstance(done.value.code, int)
    return done.value.code


def typed(folder: Path, answers: list[str]) -> int:
    """The exit code after these lines were typed at a terminal."""
    ours, theirs = pty.openpty()
    with subprocess.Popen([GSE, "config", "init"], cwd=folder, stdin=theirs, stderr=subprocess.DEVNULL) as process:
        os.write(ours, "".join(f"{answer}\n" for answer in answers).encode())
        code = process.wait()
    os.close(ours)
    os.close(theirs)
    return code


def test_the_answers_typed_at_a_terminal_are_in_the_file(tmp_path):
    answers = ["ST-7", "960", "1280", "20", "Bandung, roof", "-6.9", "107.6", "750", "/dev/ttyUSB9", "", "", "n"]
    assert typed(tmp_path, answers) == 0
    station, _ = read_station(tmp_path / "station.yaml")
    camera = station.sensor.camera()
    assert (station.sensor.name, camera.rows, camera.columns) == ("ST-7", 960, 1280)
    assert camera.focal_length_px == pytest.approx(640 / 0.17632698, abs=1e-3)  # tan 10 deg
    assert (station.site.name, station.site.latitude_deg, station.site.height_m) == ("Bandung, roof", -6.9, 750)
    assert (station.port.url, station.port.baudrate, station.protocol) == ("/dev/ttyUSB9", 115200, "panorama-v1")
    assert station.mount.align == "first 60 s"


def test_a_value_that_cannot_be_is_asked_again(tmp_path):
    answers = ["", "", "", "", "", "95", "south", "-33.9", "", "", "", "", "n", "panorama-slip", "y", "180", "45", "0"]
    assert typed(tmp_path, answers) == 0
    station, _ = read_station(tmp_path / "station.yaml")
    assert station.protocol == "panorama-slip"
    assert station.site.latitude_deg == -33.9
    assert (station.mount.azimuth_deg, station.mount.altitude_deg, station.mount.align) == (180, 45, None)


def test_a_new_station_file_vouches_for_nothing():
    station = parse_station(draft_text(Draft()))
    assert "\n  uncertainty:" not in draft_text(Draft())
    assert station.mount.uncertainty == MountUncertainty()
    uncommented = draft_text(Draft()).replace("  # uncertainty:", "  uncertainty:")
    assert parse_station(uncommented).mount.uncertainty.altitude_arcsec == 4


def test_options_answer_the_questions(tmp_path, capsys):
    path = tmp_path / "a b.yaml"
    assert run(path, "--yes", "--latitude-deg", -33.9, "--name", "ST-2", "--port", "/dev/ttyUSB0") == 0
    station, _ = read_station(path)
    assert (station.site.latitude_deg, station.sensor.name, station.port.url) == (-33.9, "ST-2", "/dev/ttyUSB0")
    assert f"gse preflight --station '{path}'" in capsys.readouterr().err


def test_a_file_that_is_there_is_not_touched(tmp_path, capsys):
    path = tmp_path / "station.yaml"
    path.write_text("mine")
    assert run(path, "--yes") == 2
    assert path.read_text() == "mine"
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["!tag", "a: b # c", 'say "hello" \\ and go', "x" * 100, ""])
def test_any_text_is_written_so_that_it_is_read_back_or_refused(name):
    text = draft_text(Draft(site=name)) if name else draft_text(Draft(site="-"))
    assert parse_station(text).site.name == (name or "-")
    with pytest.raises(ConfigError, match=r"sensor\.name"):
        draft_text(Draft(name=name))
