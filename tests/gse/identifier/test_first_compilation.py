"""What another process compiles on the first run is what a session calls."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from devices.patience import PATIENCE_S

from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.identifier.checks import wahba_residual_rad
from gse.identifier.first_compilation import compile_attitudes, compile_robust, first_compilation, is_compiled
from gse.identifier.hypotheses import search_many
from gse.identifier.robust import RobustIdentifier, stars_looked_at
from gse.station.loop import StationLoop
from gse.station.setup import example_places, set_up
from gse.values.attitude import _solve, _solve_each
from gse.values.camera import Camera
from gse.values.panorama import Panorama


def test_the_other_process_compiles_for_the_types_of_a_session() -> None:
    compile_robust()
    compiled = set(search_many.signatures)
    camera = Camera(768, 1024, 4178.0, (511.5, 383.5))
    identifier = RobustIdentifier(camera, load_catalog("gaia", stars=stars_looked_at(camera)))
    xy_px = np.random.default_rng(1).uniform(0.0, 700.0, (5, 2))
    identifier.identify(camera.directions(xy_px), np.linspace(400.0, 100.0, 5))
    assert set(search_many.signatures) == compiled


def test_the_other_process_compiles_the_attitudes_for_the_types_of_a_session() -> None:
    compile_attitudes()
    functions = _solve, _solve_each, wahba_residual_rad
    compiled = [set(function.signatures) for function in functions]
    setup = set_up(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT)
    xy_px, brightness = example_places(setup.identifier.catalog, setup.camera)
    assert StationLoop(setup).observe(Panorama(0, xy_px, brightness)).attitude
    assert [set(function.signatures) for function in functions] == compiled


def test_no_process_is_started_once_the_code_is_on_disk() -> None:
    compile_robust()
    assert is_compiled()
    with first_compilation() as nothing:
        assert nothing.process is None


def test_the_other_process_ends_with_a_session_that_is_killed(tmp_path: Path) -> None:
    starts = "import gse.identifier.first_compilation as c; f = c.first_compilation(); print(f.process.pid); f.finish()"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    session = subprocess.Popen([sys.executable, "-c", starts], stdout=subprocess.PIPE, env=environment)
    assert session.stdout is not None
    other = int(session.stdout.readline())
    session.send_signal(signal.SIGKILL)
    session.communicate()
    end_s = time.monotonic() + PATIENCE_S
    while is_running(other):
        assert time.monotonic() < end_s, "it goes on"
        time.sleep(0.1)
    assert not [*tmp_path.rglob("*search_many*")], "it ended because it was done"


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
