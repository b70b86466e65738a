"""Compilation of all that judges a session, by a process of its own, before the first campaign on a computer.

A worker that compiles holds half as much memory again, and each worker would compile the same. All workers
of this computer find the code that it leaves on disk (gse.identifier.first_compilation).
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.identifier.first_compilation import FirstCompilation, end_with_parent, is_compiled
from gse.process.jit import machine_code_folder
from gse.sessions.replay import replay_session
from gse.simulator.recording import record_simulation
from gse.truth import EarthOrientation
from gse.verdict.assessment import judge

_FRAMES, _START_UTC_NS = 20, 1_774_018_800_000_000_000


def compile_first(tell: Callable[[str], None]) -> None:
    """Wait until the code is on disk; returns at once where it is, or cannot be kept."""
    if is_compiled() or machine_code_folder() is None:
        return
    tell("compiling the identifiers, once on this computer")
    with FirstCompilation("gse.campaign.first_compilation") as process:
        process.finish()


def judge_made_session() -> None:
    """Judge a simulated session of some frames as a worker does: the types are those of all sessions."""
    station = parse_station(BUILT_IN_TEXT)
    port = station.port.model_copy(update={"url": f"sim://?frames={_FRAMES}"})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.mcap"
        orientation = EarthOrientation.from_disk(_START_UTC_NS)
        record_simulation(path, station.model_copy(update={"port": port}), BUILT_IN_TEXT, orientation.to_json())
        judge(replay_session(path, threads=1).session)


if __name__ == "__main__":
    end_with_parent()
    judge_made_session()
