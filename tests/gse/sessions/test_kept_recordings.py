"""Sessions and station files of earlier versions, which every later version must read."""

import json
from pathlib import Path

import pytest

from gse.config.station import read_station
from gse.sessions.replay import replay_session
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.results import AnswerCheck, Status
from gse.values.mount import MountUncertainty

KEPT = Path(__file__).parents[3] / "replays" / "kept-0.1.0"
EXPECTED = json.loads((KEPT / "expected.json").read_text())
COUNTED = ("bytes_in", "bytes_discarded", "duplicates", "frames_lost", "sensor_resets", "reconnects")


@pytest.mark.parametrize("name", EXPECTED)
def test_a_session_of_0_1_0_replays_with_the_frames_and_bytes_that_it_had(name: str) -> None:
    session = replay_session(KEPT / f"{name}.mcap").session
    frames = session.frames.columns
    found = {
        "frames": len(frames),
        "identified": int((frames["status"] == STATUSES.index(Status.IDENTIFIED)).sum()),
        "correct": int((frames["answer_check"] == ANSWER_CHECKS.index(AnswerCheck.CORRECT)).sum()),
        **{count: getattr(session.link, count) for count in COUNTED},
        "raw_sha256": session.raw_sha256,
    }
    assert found == EXPECTED[name]
    assert session.earth_orientation is not None


@pytest.mark.parametrize("name", ["built-in", "every-key"])
def test_a_station_file_of_0_1_0_is_read_with_its_values(name: str) -> None:
    station, text = read_station(KEPT / f"{name}.yaml")
    assert station.mount.uncertainty == MountUncertainty()
    assert station.site.air_pressure_hpa == station.site.pressure_hpa
    if name == "every-key":
        assert station.mount.align_s == 60.0
        assert station.sensor.hot_pixels == ((10, 20), (1000, 3))
        assert (station.identifier.algorithm, station.identifier.min_fit) == ("pivot", 5)
        assert (station.limits.d_de_arcsec, station.port.baudrate) == (36.5, 921_600)
    else:
        assert "The built-in station" in text


def test_what_is_kept_is_small() -> None:
    assert sum(path.stat().st_size for path in KEPT.iterdir()) < 300_000
