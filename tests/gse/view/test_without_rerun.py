"""Where rerun is not installed, all but the view in rerun works; where it is, only a view loads it."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from devices.patience import PATIENCE_S

import gse
from gse.config.station import BUILT_IN_TEXT

ROOT = Path(gse.__file__).parents[1]
CLEAR = ROOT / "replays/golden/clear.mcap"
DRAWN_BY = ("rerun", "rerun_cli", "matplotlib")


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All installed packages but rerun, as links."""
    folder = tmp_path_factory.mktemp("site-packages")
    for package in Path(sysconfig.get_path("purelib")).iterdir():
        if not package.name.startswith("rerun"):
            (folder / package.name).symlink_to(package)
    return folder


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return Path(shutil.copy(CLEAR, tmp_path / "clear.mcap"))


def gse_without(packages: Path, *arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{packages}"}
    command = [sys.executable, "-S", "-m", "gse", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)


def test_a_session_with_a_view_says_what_is_missing_and_goes_on_to_its_verdict(packages: Path, tmp_path: Path) -> None:
    done = gse_without(packages, "run", "--port", "sim://?frames=30", "--view", "web", "--no-plots", cwd=tmp_path)
    assert "no view in rerun: rerun-sdk is not installed" in done.stderr
    assert "pip install 'rerun-sdk>=0.41,<0.42'" in done.stderr
    assert "live page: http://127.0.0.1:" in done.stderr
    assert "(rerun: " not in done.stderr
    assert "exit code 5: INCONCLUSIVE" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_page_at_a_glance_is_served_without_it(packages: Path, tmp_path: Path) -> None:
    code = """
import urllib.request
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.view.live import LiveView
from gse.view.live_state import LiveState
with LiveView(LiveState(parse_station(BUILT_IN_TEXT))) as view:
    print(urllib.request.urlopen(view.url).status, view.rerun_url or "no rerun")
"""
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{packages}"}
    done = subprocess.run([sys.executable, "-S", "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout == "200 no rerun\n"


def test_a_session_is_reported_but_not_viewed(packages: Path, session: Path, tmp_path: Path) -> None:
    assert gse_without(packages, "report", session, cwd=tmp_path).returncode == 0
    viewed = gse_without(packages, "view", session, "--save", "session.rrd", cwd=tmp_path)
    assert viewed.returncode == 2
    assert viewed.stderr.startswith("gse: rerun-sdk is not installed")
    station = tmp_path / "hopeless.yaml"  # no length of session passes, so that none is simulated
    station.write_text(f"{BUILT_IN_TEXT}limits: {{d_ra_cosde_arcsec: 1, d_de_arcsec: 1, d_roll_arcsec: 1}}\n")
    words = ("preflight", "--station", station, "--start-utc", "2026-03-20T15:00:00Z")
    checked = gse_without(packages, *words, cwd=tmp_path)
    assert "WARN  viewer     rerun-sdk is not installed" in checked.stdout


def test_neither_python_nor_ci_loads_what_draws(session: Path) -> None:
    shutil.copy(CLEAR.with_suffix(".report.json"), session.with_suffix(".report.json"))
    code = f"""
import sys
import gse
from gse.cli import cli
gse.judge("clear.mcap", anew=True)
gse.load("clear.mcap").frames
by_python = [name for name in {DRAWN_BY} if name in sys.modules]
cli.main(["ci", "."], standalone_mode=False)
print(by_python, [name for name in {DRAWN_BY} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=session.parent, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[] []", done.stderr
