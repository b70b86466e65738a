"""Short simulated sessions, one an evening."""

from pathlib import Path

from drivers.mock_ports import sim_url
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import ConfigError
from gse.simulator.recording import record_simulation
from gse.truth import EarthOrientation
from gse.values.instant import from_text

FRAMES = 40


def make_session(path: Path, day: int, *, sensor: str = "LAPAN-like", **options) -> Path:
    """A simulated session of one evening in March 2026, at one panorama in 2 s."""
    return record_with(path, BUILT_IN_TEXT.replace("name: LAPAN-like", f'name: "{sensor}"'), day=day, **options)


def record_with(path: Path, text: str, *, day: int, seed: int = 1, frames: int = FRAMES, **options) -> Path:
    """The same with any station file; what is refused in it is simulated as the built-in one."""
    start = f"2026-03-{day:02d}T15:00:00Z"
    try:
        station = parse_station(text)
    except ConfigError:
        station = parse_station(BUILT_IN_TEXT)
    url = sim_url(scenario="clear-zenith", start=start, rate_hz="0.5", seed=str(seed), frames=str(frames), **options)
    port = station.port.model_copy(update={"url": url})
    orientation = EarthOrientation.from_disk(from_text(start)).to_json()
    record_simulation(path, station.model_copy(update={"port": port}), text, orientation)
    return path
