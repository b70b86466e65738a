"""Sky conditions: clouded against clear frames, on simulated cloud and on ten real frames.

    python benchmarks/sky.py

Each simulated session is clear for a minute, then under cloud for a minute. The score of a frame is the share of the
expected stars that it shows, times the transparency of its stars. A frame counts as clouded where the mean extinction
over the detector is 1 mag or more.
"""

import json
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.link import SerialLink
from drivers.urlhandlers.protocol_sim import register
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.recording.session_format import RecordedTimings
from gse.sessions.replay import replay_session
from gse.simulator import device_factory
from gse.simulator.scenario import Scenario, parse_scenario
from gse.simulator.scene import SimulatedScene
from gse.station.columns import SKY_CONDITIONS
from gse.station.loop import StationLoop
from gse.station.results import SkyCondition
from gse.station.setup import set_up
from gse.statistics.sky_summary import seen_share
from gse.values.instant import NS_PER_S

LOWELL = Path(__file__).parents[1] / "replays" / "lowell"
SITES = (
    ("zenith, 6.5 S", "{}"),
    ("45 deg, 52 N", "{site: {latitude_deg: 52.2, longitude_deg: 4.4}, mount: {altitude_deg: 45, azimuth_deg: 120}}"),
    ("60 deg, 44 S", "{site: {latitude_deg: -44.0, longitude_deg: 170.5}, mount: {altitude_deg: 60, azimuth_deg: 0}}"),
)
STARTS = ("2026-03-20T15:00:00Z", "2026-03-20T23:00:00Z", "2026-07-01T10:00:00Z")
CLOUDS = ((1.0, 1.0), (1.5, 1.0), (2.0, 1.0), (3.0, 0.6))
"""Magnitudes and cover."""
RATE_HZ, HALF_S = 2, 60
CLOUDED_MAG = 1.0


def main() -> None:
    """Print the tables."""
    print(f"{'site':16}{'mag':>5}{'cover':>7}{'frames':>8}{'AUC':>8}{'clouded told':>14}{'clear told':>12}")
    scores, labels = [], []
    for (name, station), start in zip(SITES, STARTS, strict=True):
        for magnitudes, cover in CLOUDS:
            score, label, told = _session(station, start, magnitudes, cover)
            scores.append(score), labels.append(label)
            hit, right = told[label].mean(), (~told[~label]).mean()
            print(
                f"{name:16}{magnitudes:5.1f}{cover:7.1f}{len(label):8}{auc(score, label):8.3f}"
                f"{100 * hit:12.1f} %{100 * right:10.1f} %"
            )
    print(f"{'all':16}{'':12}{sum(map(len, labels)):8}{auc(np.concatenate(scores), np.concatenate(labels)):8.3f}")
    print("\nten real frames: label (cells of 33 with cloud), condition, stars seen of those expected")
    for frame, facts in json.loads((LOWELL / "frames.json").read_text()).items():
        (row,) = replay_session(LOWELL / f"{frame}.mcap").session.frames.columns.rows()
        condition, label = SKY_CONDITIONS[row["sky_condition"]], facts["clouded_cells_of_33"]
        print(f"{frame}  {label:3}  {condition:10} {row['stars_seen']:3} of {row['stars_expected']:.0f}")


def auc(score: NDArray[np.float64], clouded: NDArray[np.bool_]) -> float:
    """The probability that a clear frame scores higher than a clouded one (ties count half)."""
    clear, cloud = score[~clouded], score[clouded]
    if not len(clear) or not len(cloud):
        return float("nan")
    return float(((clear[:, None] > cloud).mean() + (clear[:, None] >= cloud).mean()) / 2)


def _session(
    station_text: str, start: str, magnitudes: float, cover: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Score and label of each frame, and whether the station told a cloud; none of frames in between."""
    text = (
        f"text: cloud\nstart: '{start}'\nseconds: {2 * HALF_S}\nrate_hz: {RATE_HZ}\nstation: {station_text}\n"
        f"air:\n  cloud_magnitudes: [[0, 0], [{HALF_S}, 0], [{HALF_S + 0.1}, {magnitudes}]]\n  cloud_cover: {cover}\n"
    )
    scenario = parse_scenario(text, "benchmark")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cloud.yaml"
        path.write_text(text)
        frames = _run(scenario, path)
    extinction_mag = _extinction(scenario, frames["utc_ns"])
    zero_point = frames["zero_point_mag"].astype(np.float64)
    fade_mag = np.nanpercentile(zero_point, 95) - zero_point
    score = np.nan_to_num(seen_share(frames)) * 10 ** (-0.4 * np.clip(np.nan_to_num(fade_mag, nan=20), 0, 20))
    told = np.isin(frames["sky_condition"], [SKY_CONDITIONS.index(item) for item in _CLOUDED])
    kept = (extinction_mag >= CLOUDED_MAG) | (extinction_mag == 0)
    return score[kept], extinction_mag[kept] >= CLOUDED_MAG, told[kept]


_CLOUDED = (SkyCondition.CLOUDED, SkyCondition.NO_STARS)


def _run(scenario: Scenario, path: Path) -> NDArray[np.void]:
    text = scenario.station_text(BUILT_IN_TEXT)
    station = parse_station(text)
    register(device_factory(parse_station(BUILT_IN_TEXT)))
    with SerialLink(f"sim://?scenario={path}") as link:
        session = StationLoop(set_up(station, text), recorded=RecordedTimings()).run(link)
    return session.frames.columns.rows()


def _extinction(scenario: Scenario, utc_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean extinction over the detector at each instant."""
    scene = SimulatedScene(scenario.device_for(parse_station(BUILT_IN_TEXT)), scenario, np.random.default_rng(0))
    steps = np.linspace(0, scene.camera.columns - 1, 9)
    xy_px = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    seconds = (utc_ns - scenario.start_utc_ns) / NS_PER_S
    return np.array([float(scene.cloud_magnitudes(xy_px, second).mean()) for second in seconds])


if __name__ == "__main__":
    main()
