"""Sessions and station files of earlier versions, which every later version must read."""

import json
from pathlib import Path

import pytest
from skies.short_nights import record_with

from gse.config.choice import change_to
from gse.config.station import BUILT_IN_TEXT, parse_recorded, parse_station, read_station
from gse.errors import ConfigError
from gse.report.why import blurred_station
from gse.sessions.replay import replay_session
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import StationKind
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


TO_BASE_60 = BUILT_IN_TEXT.replace("106.70", "1:46.70").replace("rows: 1024", "rows: 02000")
FOLDED = BUILT_IN_TEXT.replace("  columns: 1024", "  columns: 1024\n  radial_distortion: [-0.3, 0]")
TWICE = BUILT_IN_TEXT + "port:\n  url: sim://?rate_hz=5\n"


def old(tmp_path: Path, text: str) -> Path:
    """A session whose station file was recorded before such a text was refused."""
    with pytest.raises(ConfigError):
        parse_station(text)
    return record_with(tmp_path / "old.mcap", text, day=20, frames=10)


def test_a_recorded_number_to_base_60_is_read_as_it_was_then(tmp_path: Path) -> None:
    session = replay_session(old(tmp_path, TO_BASE_60)).session
    today = replay_session(record_with(tmp_path / "new.mcap", BUILT_IN_TEXT, day=20, frames=10)).session
    assert (session.station.site.longitude_deg, session.station.sensor.rows) == (106.70, 1024)
    assert (session.frames.columns["d_de_arcsec"] == today.frames.columns["d_de_arcsec"]).all()
    told = [event for event in session.events if event.kind == StationKind.OLD_STATION]
    assert len(told) == 1
    assert "line 11: site.longitude_deg is '1:46.70'" in told[0].text
    assert not [event for event in today.events if event.kind == StationKind.OLD_STATION]


@pytest.mark.parametrize("text", [TO_BASE_60, FOLDED, TWICE], ids=["base 60", "folded", "twice"])
def test_a_recorded_file_that_is_refused_today_is_judged_reported_and_shared(gse, tmp_path: Path, text: str) -> None:
    path = old(tmp_path, text)
    with_robust = replay_session(path, station=change_to(None, "robust"))
    assert with_robust.session.station.identifier.algorithm == "robust"
    for session in (with_robust.session, replay_session(path).session):
        assert [event.kind for event in session.events].count(StationKind.OLD_STATION) == 1
    site = parse_recorded(blurred_station(text)).site
    assert (site.latitude_deg, site.longitude_deg) == (-7, 107)
    # A lens that folds finds none of these stars: nothing can be fitted with it.
    for command in ("why",) if text is FOLDED else ("why", "calibrate", "align"):
        assert gse(command, path).code not in (2, 70)


def test_a_recorded_text_that_never_was_a_station_file_is_refused_with_the_words_of_today() -> None:
    with pytest.raises(ConfigError, match="unknown key size"):
        parse_recorded(FOLDED + "size: 3\n")
