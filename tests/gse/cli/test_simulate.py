"""gse simulate: whole sessions, the same bytes each time, that replay as what they are."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from drivers.errors import CaptureError, PortError
from drivers.session_file.reader import messages
from drivers.session_file.records import CLOCK, RX
from gse.cli.simulate import command
from gse.config.station import parse_station
from gse.errors import ConfigError
from gse.recording.session_format import read_recorded
from gse.sessions.replay import replay_session
from gse.simulator.scenario import scenario_names

SHORT = ["--rate-hz", "2", "--seconds", "3"]


def simulate(*arguments: str) -> Path:
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    return Path(result.stdout.strip())


def test_the_same_options_give_the_same_bytes(tmp_path: Path) -> None:
    first, second = (simulate(*SHORT, "--file", str(tmp_path / name)) for name in ("a.mcap", "b.mcap"))
    other = simulate(*SHORT, "--seed", "2", "--file", str(tmp_path / "c.mcap"))
    assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes() != other.read_bytes()


def test_a_session_holds_its_station_protocol_orientation_and_clock(tmp_path: Path) -> None:
    path = simulate(*SHORT, "--scenario", "inclined", "--out", str(tmp_path))
    assert path == tmp_path / "20260320T150000Z-LAPAN-like-inclined" / "session.mcap"
    recorded = read_recorded(path)
    assert set(recorded.attachments) == {"station.yaml", "protocol.yaml", "earth_orientation.json"}
    assert parse_station(recorded.attachments["station.yaml"]).mount.altitude_deg == 45
    assert sum(len(message.data) for message in messages(path, RX)) == 6 * 216
    assert [reading.source for reading in recorded.clock] == ["simulated"]
    assert len(list(messages(path, CLOCK))) == 1


def test_faults_are_in_the_session_as_the_cable_makes_them(tmp_path: Path) -> None:
    path = simulate(
        "--rate-hz", "2", "--seconds", "30", "--faults", "drop_frame:0.2", "--file", str(tmp_path / "f.mcap")
    )
    session = replay_session(path).session
    assert session.link.frames_lost > 3
    assert session.link.frames + session.link.frames_lost in range(55, 61)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        (["--scenario", "nowhere"], ConfigError, "expected one of clear-zenith"),
        (["--start-utc", "soon"], PortError, "2026-03-20T18:30:00Z"),
        (["--faults", "gremlins:1"], PortError, "gremlins"),
    ],
)
def test_wrong_options_leave_nothing_behind(
    arguments: list[str], error: type[Exception], words: str, tmp_path: Path
) -> None:
    result = CliRunner().invoke(command, [*arguments, "--out", str(tmp_path)])
    assert isinstance(result.exception, error)
    assert words in str(result.exception)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    result = CliRunner().invoke(command, [*SHORT, "--file", str(path)])
    assert isinstance(result.exception, CaptureError)
    assert path.read_text() == "mine"


def test_the_scenarios_are_listed_with_what_they_are() -> None:
    lines = CliRunner().invoke(command, ["--list"], catch_exceptions=False).stdout.splitlines()
    assert [line.split()[0] for line in lines] == scenario_names()
    assert all(len(line.split()) > 5 for line in lines)


def test_by_day_the_advice_names_what_the_command_has(tmp_path: Path) -> None:
    file = tmp_path / "day.mcap"
    told = CliRunner().invoke(command, ["--scenario", "daylight", "--seconds", "1", "--file", str(file)]).stderr
    words = " ".join(told.split())
    assert "the Sun is 84 deg up at this site" in words
    assert words.endswith("no stars; --start-utc chooses a night")
    assert set(re.findall("--[a-z-]+", words)) <= {word for option in command.params for word in option.opts}
