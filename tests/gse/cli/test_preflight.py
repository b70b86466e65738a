"""gse preflight and gse ports: what is wrong before the night, and what to do about it."""

import json
import os
import subprocess
import sys
import threading
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from gse.cli.config import command as config
from gse.cli.ports import command as ports
from gse.cli.preflight import command as preflight
from gse.config.station import BUILT_IN_TEXT
from gse.inspection.preflight import _tightest
from gse.values.limits import Limits
from protocols import StatusMessage, load_protocol

NIGHT = "2026-03-20T15:00:00Z"
"""Within the installed tables, whatever the host's date."""


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


def checked(*arguments: object) -> tuple[dict[str, dict[str, Any]], int]:
    result = CliRunner().invoke(preflight, [*map(str, arguments), "--json"])
    document = json.loads(result.stdout)
    assert document["schema"] == "gse.preflight/1"
    assert document["ready"] == (result.exit_code == 0)
    found = {check["name"]: check for check in document["checks"]}
    assert all(check["advice"] for check in found.values() if check["outcome"] != "OK")
    return found, result.exit_code


def test_a_simulated_night_is_ready(tmp_path: Path) -> None:
    found, exit_code = checked("--out", tmp_path, "--start-utc", NIGHT)
    technical = ["station", "protocol", "air", "port", "clock", "disk", "cache", "earth", "catalogue"]
    sky = ["field", "mount", "baud rate", "night", "Sun", "Moon", "stars", "length"]
    assert list(found) == [*technical, *sky, "viewer"]
    assert {check["outcome"] for check in found.values()} == {"OK"}
    assert exit_code == 0
    assert "UT1" in found["earth"]["text"]
    assert "482176 stars" in found["catalogue"]["text"]


@pytest.mark.parametrize(
    ("sent", "outcome", "words"),
    [(b"", "WARN", "no bytes came"), (b"noise" * 20, "FAIL", "100 bytes"), (None, "OK", "valid frames come")],
)
def test_the_port_is_listened_to(
    tmp_path: Path, terminal: tuple[int, str], sent: bytes | None, outcome: str, words: str
) -> None:
    protocol = load_protocol("panorama-v1")
    status = StatusMessage(temperature_c=20.0, supply_v=5.0, mode="standby", firmware=(1, 2, 0))
    frames = b"".join(protocol.encode(status, number) for number in range(20))
    master, name = terminal
    threading.Timer(0.5, os.write, (master, frames if sent is None else sent)).start()
    found, _ = checked("--port", name, "--out", tmp_path)
    assert found["port"]["outcome"] == outcome
    assert words in found["port"]["text"]
    assert found["clock"]["outcome"] in ("OK", "WARN", "FAIL")
    assert "arcsec of RA" in found["clock"]["text"]


def test_what_would_spoil_the_night_is_a_failure_with_advice(tmp_path: Path) -> None:
    found, exit_code = checked("--port", "/dev/ttyNOWHERE", "--hours", 999, "--out", tmp_path)
    assert found["port"]["outcome"] == "FAIL"
    assert "there is no port" in found["port"]["text"]
    assert exit_code == 1
    station = tmp_path / "station.yaml"
    station.write_text(BUILT_IN_TEXT.replace("latitude_deg: -6.53", "latitude_deg: 95"))
    found, exit_code = checked("--station", station)
    assert (list(found), exit_code) == (["station"], 1)
    assert "latitude_deg" in found["station"]["text"]
    station.write_text(BUILT_IN_TEXT + "protocol: nothing-like-it\ncatalog: nowhere.dat\n")
    found, exit_code = checked("--station", station, "--out", tmp_path)
    assert [found[name]["outcome"] for name in ("protocol", "catalogue")] == ["FAIL", "FAIL"]
    assert exit_code == 1


def test_a_full_disk_is_seen_before_the_night(tmp_path: Path) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(BUILT_IN_TEXT.replace("url: sim://", "url: sim://\n  baudrate: 8000000"))
    found, _ = checked("--station", station, "--hours", 1000, "--out", tmp_path / "new" / "folder")
    assert found["disk"]["outcome"] == "FAIL"
    assert "need at most 7200.0 GB" in found["disk"]["text"]


def test_the_text_names_each_check_and_its_outcome(tmp_path: Path) -> None:
    text = CliRunner().invoke(preflight, ["--out", str(tmp_path), "--start-utc", NIGHT]).stdout
    assert text.count("OK ") == 18


def test_a_pressure_that_is_not_that_of_the_height_is_doubted_with_a_number(tmp_path: Path) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(BUILT_IN_TEXT.replace("height_m: 250", "height_m: 2700"))
    found, exit_code = checked("--station", station, "--out", tmp_path)
    assert (found["air"]["outcome"], exit_code) == ("WARN", 0)
    assert "985, but the standard atmosphere has 728 hPa at 2700 m" in found["air"]["text"]
    result = CliRunner().invoke(config, ["check", str(station)])
    assert result.exit_code == 0
    assert "doubtful: site.pressure_hpa is 985" in result.stderr
    station.write_text(BUILT_IN_TEXT.replace("height_m: 250", "height_m: 2700").replace("  pressure_hpa: 985\n", ""))
    found, _ = checked("--station", station, "--out", tmp_path)
    assert found["air"]["outcome"] == "OK"
    assert "728 hPa, the standard atmosphere's at 2700 m, within 20 hPa" in found["air"]["text"]
    shown = json.loads(CliRunner().invoke(config, ["show", str(station), "--json"]).stdout)
    assert shown["site"]["pressure_hpa"] == pytest.approx(728.0, abs=1)


def test_ports_says_what_there_is(tmp_path: Path) -> None:
    document = json.loads(CliRunner().invoke(ports, ["--json"]).stdout)
    assert document["schema"] == "gse.ports/1"
    for port in document["ports"]:
        assert {"device", "description", "serial_number", "holders", "line", "accessible"} <= set(port)
    result = CliRunner().invoke(ports, [])
    assert result.exit_code == 0
    assert result.output.count("\n") == max(1, len(document["ports"]))


def test_a_user_without_a_folder_for_machine_code_is_told_that_each_start_will_compile(tmp_path: Path) -> None:
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME"), os.devnull) | {"NUMBA_CACHE_DIR": "", "PYTHONWARNINGS": ""}
    station = tmp_path / "hopeless.yaml"  # no length of session passes, so that none is simulated
    station.write_text(f"{BUILT_IN_TEXT}limits: {{d_ra_cosde_arcsec: 1, d_de_arcsec: 1, d_roll_arcsec: 1}}\n")
    command = [sys.executable, "-m", "gse", "preflight", "--station", station, "--start-utc", NIGHT, "--json"]
    done = subprocess.run(command, cwd=tmp_path, env=os.environ | nowhere, capture_output=True, text=True)
    (cache,) = (check for check in json.loads(done.stdout)["checks"] if check["name"] == "cache")
    assert (cache["outcome"], done.returncode) == ("WARN", 0)
    assert "/dev/null/gse/machine-code" in cache["text"]
    assert "NUMBA_CACHE_DIR" in cache["advice"]
    assert done.stderr.count("each start compiles anew") == 1


@pytest.mark.parametrize(("d_ra_arcsec", "d_de_arcsec"), [(30.0, 60.0), (60.0, 30.0)])
def test_a_clock_is_held_against_the_tighter_of_the_two_limits(d_ra_arcsec, d_de_arcsec):
    assert _tightest(Limits(d_ra_cosde_arcsec=d_ra_arcsec, d_de_arcsec=d_de_arcsec)) == 30.0
