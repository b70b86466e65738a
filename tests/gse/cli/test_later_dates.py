"""The station on days past the end of the Earth orientation tables, or before them: it says so, and goes on."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from devices.live_session import LiveSession
from devices.patience import PATIENCE_S
from devices.terminal import Terminal

from gse.cli import EXIT_INCONCLUSIVE
from gse.config.station import BUILT_IN_TEXT

# The library itself: the command ``faketime`` leaves a named semaphore behind wherever it is killed, and one of a later
# run that happens to get its process number ends at once.
FAKETIME = next(iter(sorted(Path("/usr/lib").glob("*/faketime/libfaketime.so.1"))), None)
pytestmark = pytest.mark.skipif(FAKETIME is None, reason="faketime is not installed")


def gse(*words: object) -> list[str]:
    return [sys.executable, "-m", "gse", *map(str, words)]


def at(offset: str) -> dict[str, str]:
    """The environment of a process whose clock is so far away.

    Python waits on the monotonic clock, which faketime does not shift without breaking its timeouts; told to correct
    them all the same, it lets each wait for another thread end at once, and the processor runs hot.
    """
    shifted = {"LD_PRELOAD": str(FAKETIME), "FAKETIME": offset, "DONT_FAKE_MONOTONIC": "1"}
    return {**os.environ, **shifted, "FAKETIME_FORCE_MONOTONIC_FIX": "0"}


def preflight_at(offset: str, *words: object) -> dict[str, str]:
    command = gse("preflight", "--json", *words)
    answer = subprocess.run(command, env=at(offset), capture_output=True, text=True, check=False)
    found: dict[str, str] = next(item for item in json.loads(answer.stdout)["checks"] if item["name"] == "earth")
    return found


@pytest.fixture
def midnight_station(tmp_path: Path) -> Path:
    """The built-in station where it is midnight now, so that the emulated sensor sees stars at any hour."""
    now = datetime.now(UTC)
    longitude_deg = (-15 * (now.hour + now.minute / 60) + 180) % 360 - 180
    path = tmp_path / "station.yaml"
    path.write_text(BUILT_IN_TEXT.replace("longitude_deg: 106.70", f"longitude_deg: {longitude_deg:.2f}"))
    return path


@contextlib.contextmanager
def emulated(offset: str, station: Path) -> Iterator[str]:
    """An emulated sensor on a pty, its sky that of the date; gives the port's name."""
    command = gse("emulate", "--pty", "--station", station)
    with subprocess.Popen(command, env=at(offset), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            port = process.stdout.readline().strip()
            assert port, "the emulated sensor has ended"
            yield port
        finally:
            process.terminate()


@pytest.fixture
def hopeless_station(tmp_path: Path) -> Path:
    """Its limits are too narrow for any length of session, so that none is simulated, which would take seconds."""
    path = tmp_path / "station.yaml"
    path.write_text(f"{BUILT_IN_TEXT}limits: {{d_ra_cosde_arcsec: 1, d_de_arcsec: 1, d_roll_arcsec: 1}}\n")
    return path


@pytest.mark.parametrize(("offset", "words"), [("+400d", "leap seconds"), ("+4y", "UT1 is only known to")])
def test_preflight_warns_past_the_end_of_the_tables(
    tmp_path: Path, hopeless_station: Path, offset: str, words: str
) -> None:
    found = preflight_at(offset, "--station", hopeless_station, "--out", tmp_path)
    assert found["outcome"] == "WARN"
    assert words in found["text"]
    assert "--earth-orientation" in found["advice"]


def test_a_session_in_four_years_is_recorded_and_its_truth_is_as_wide_as_it_is_unknown(
    tmp_path: Path, midnight_station: Path
) -> None:
    with emulated("+4y", midnight_station) as port:
        words = ("--station", midnight_station, "--port", port, "--clock-error", "1ms", "--json")
        command = gse("run", *words, "--no-plots", "--out", tmp_path / "out")
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with subprocess.Popen(command, env=at("+4y"), text=True, **pipes) as running:
            try:
                LiveSession(tmp_path / "out").await_frames(20)
            finally:
                running.terminate()
            out, err = running.communicate()
    report = json.loads(out)
    assert report["identification"]["statuses"]["IDENTIFIED"] > 10
    assert "EARTH_ORIENTATION" in err
    assert "outside the Earth orientation table" in err
    terms = {term["name"]: term for term in report["truth_budget"]["terms"]}
    assert 7 < terms["UT1"]["ra_arcsec"] < 13  # 0.9 s of a rectangle, and the held value
    assert report["truth_budget"]["axes"]["d_ra_cosde"]["expanded_arcsec"] > 15
    assert terms["UT1"]["de_arcsec"] < 0.01  # the Earth turns about the pole


def test_a_clock_that_falls_back_to_1970_in_a_session_lengthens_it_by_nothing(
    tmp_path: Path, midnight_station: Path
) -> None:
    terminal = Terminal(tmp_path / "tty")
    words = ("--station", midnight_station, "--port", terminal.path, "--duration", "5", "--no-plots")
    # Under a clock that went back faketime never ends a sleep; waiting for git may sleep, so none is found.
    in_april_1970 = f"-{(datetime.now(UTC) - datetime(1970, 4, 11, tzinfo=UTC)).days}d"
    environment = {**at(in_april_1970), "FAKETIME_START_AFTER_SECONDS": "5", "PATH": ""}
    with subprocess.Popen(gse("run", *words, "--out", tmp_path / "out"), env=environment) as running:
        try:
            assert running.wait(PATIENCE_S) == EXIT_INCONCLUSIVE
        finally:
            running.kill()
    terminal.unplug()
    status = LiveSession(tmp_path / "out").status()
    assert (status["state"], status["utc"][:4]) == ("ended", "1970")
