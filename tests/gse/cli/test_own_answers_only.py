"""Commands on a session of a sensor that sends quaternions of its own and no panorama."""

import json
from dataclasses import replace

import pytest

from drivers.clock import ClockReading
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX, RecordedMessage
from gse.sessions.replay import replay_session
from gse.view.glance import Glance
from gse.view.live_state import LiveState

SCENARIO = """\
text: A sensor of quaternions only.
seconds: 12
rate_hz: 5
station: {protocol: attitude-quaternion}
attitude: {sends: true}
"""


@pytest.fixture
def session(gse, tmp_path):
    (tmp_path / "only.yaml").write_text(SCENARIO)
    path = tmp_path / "only.mcap"
    assert gse("simulate", "--scenario", tmp_path / "only.yaml", "--file", path).code == 0
    return path


def test_its_answers_are_no_panoramas_and_are_expected_of_nothing(gse, session, tmp_path):
    assert "60 answers of its own, no panoramas, 60 identified, 0 lost" in gse("why", session).out
    refused = gse("compare", session, "--with-sensor")
    assert refused.code == 2
    assert "--with-sensor: attitude-quaternion has no panoramas" in refused.err
    assert "has no report" not in gse("session", "info", session).err


def test_its_convention_is_found_in_a_raw_capture_too(gse, session, tmp_path):
    records = (record for record in read_capture(session) if isinstance(record, RecordedMessage) and record.topic == RX)
    (tmp_path / "raw.bin").write_bytes(b"".join(record.data for record in records))
    station = tmp_path / "station.yaml"
    station.write_text(gse("config", "show").out.replace("protocol: panorama-v1", "protocol: attitude-quaternion"))
    options = ("--station", station, "--start-utc", "2026-03-20T15:00:00Z", "--json")
    done = gse("conventions", tmp_path / "raw.bin", *options)
    assert done.code == 0
    assert json.loads(done.out)["named"]["scalar"] == "last"


def test_the_glance_page_has_its_errors_and_no_stars(session):
    pages = []

    def listeners(loop):
        live = LiveState(loop.session.station)
        pages.append(Glance(live))
        return [live]

    last_ns = int(replay_session(session, make_listeners=listeners).session.frames.columns["utc_ns"][-1])
    now = ClockReading(last_ns, 10**9, "ntp", True, 0.0, 0.01)
    pages[0].absorb(now)
    document = pages[0].document(now)
    assert document["word"]["text"] == "OK"
    assert [axis["subject"] for axis in document["axes"]] == ["sensor", "sensor"]
    assert (document["stars"]["seen"], document["stars"]["expected"], document["focus"]) == (None, None, None)
    silent = pages[0].document(replace(now, mono_ns=now.mono_ns + 12 * 10**9))["word"]
    assert (silent["text"], silent["detail"]) == ("NO ANSWER 12 s", "no ATTITUDE frame for 12 s")


def test_its_report_claims_nothing_of_stars_that_nobody_saw(gse, session, tmp_path):
    done = gse("replay", session, "--plots", "--verbose", "--out", tmp_path)
    (page,) = (path.read_text() for path in tmp_path.glob("*/report.html"))
    assert "Not seen: the sensor sends answers of its own and no panoramas" in page
    assert "Processing time, as the sensor states it" in page
    assert "Residuals of the stars" not in page
    assert "stars seen of those expected" not in page
    (report,) = (json.loads(path.read_text()) for path in tmp_path.glob("*/report.json"))
    assert report["sky"]["stretches"][0]["seen_share"] is None
    assert "sky: unknown 100 %" in done.out
