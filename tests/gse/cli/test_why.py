"""gse why, and what else is said of a session whose latitude has the wrong sign."""

import json
import re
import zipfile

import pytest

from drivers.chunk import LinkEvent
from gse.config.choice import with_values
from gse.diagnosis.diagnosis import LiveDiagnosis
from gse.sessions.replay import replay_session
from gse.station.events import FindingEvent

SCENARIO = """\
text: The latitude lacks its minus, and the clock is right.
station:
  site: {latitude_deg: 37.42, longitude_deg: -122.13, name: Back garden}
  mount: {azimuth_deg: 140, altitude_deg: 55, roll_deg: 10}
device:
  site: {latitude_deg: -37.42}
start: "2026-03-20T08:00:00Z"
seconds: 12
rate_hz: 5
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return tmp_path_factory.mktemp("wrong latitude")


@pytest.fixture
def session(gse, recorded):
    path = recorded / "session.mcap"
    if not path.exists():
        scenario = recorded / "scenario.yaml"
        scenario.write_text(SCENARIO)
        assert gse("simulate", "--scenario", scenario, "--file", path).code == 0
    return path


def test_why_names_the_cause_and_the_next_step_with_this_session(gse, session, tmp_path):
    bundle = tmp_path / "bundle.zip"
    done = gse("why", session, "--bundle", bundle)
    assert done.code == 0
    text = " ".join(done.out.split())
    assert text.startswith(
        "INCONCLUSIVE (SIMULATED): LAPAN-like (onboard), 60 frames in 12 s from 2026-03-20T08:00:00Z"
    )
    assert "cause: latitude sign: the stars fit site.latitude_deg: -37.42; that explains 74." in text
    assert text.count("latitude sign: the stars fit") == 1
    assert any(f"gse report {session} --station FILE" in line for line in done.out.splitlines())
    assert len(done.out.splitlines()) < 50
    held = zipfile.ZipFile(bundle)
    assert set(held.namelist()) == {
        "why.txt", "report.json", "station.yaml", "events.txt", "versions.json", "README.txt",
    }  # fmt: skip
    for name in held.namelist():
        text = held.read(name).decode()
        assert "37.42" not in text
        assert "122.13" not in text
        assert "Back garden" not in text
    report = json.loads(held.read("report.json"))
    assert report["session"]["site"]["latitude_deg"] == 37.0
    for body in ("sun", "moon"):  # how high they stand, with the time, is a place
        assert all(angle == round(angle) for angle in report["sky"][f"{body}_altitude_deg"])


def test_why_tells_when_the_sky_was_clear_again(gse, tmp_path):
    scenario, path = tmp_path / "scenario.yaml", tmp_path / "session.mcap"
    scenario.write_text(
        "text: A cloud.\nseconds: 45\nrate_hz: 2\nair: {cloud_magnitudes: [[10, 0], [11, 9], [24, 9], [25, 0]]}\n"
    )
    assert gse("simulate", "--scenario", scenario, "--file", path).code == 0
    text = " ".join(gse("why", path).out.split())
    (last,) = re.findall(r"CLEAR: [^(]*\(1 more, the last at 15:00:(\d\d)Z\)", text)
    assert 24 <= int(last) <= 35


def test_a_blurred_bundle_tells_no_instant_of_dawn_or_dusk(gse, tmp_path):
    """The line on the Earth where it is dawn moves by 0.02 deg in the 5 s in which it is told."""
    path = tmp_path / "session.mcap"
    assert gse("simulate", "--scenario", "twilight", "--seconds", 6600, "--rate-hz", 0.02, "--file", path).code == 0
    assert gse("why", path, "--bundle", tmp_path / "blurred.zip").code == 0
    assert gse("why", path, "--bundle", tmp_path / "plain.zip", "--with-site").code == 0
    of_the_sun = re.compile("(.*) (DAYLIGHT|DARK_NIGHT): ")

    def told(bundle, name):
        return zipfile.ZipFile(tmp_path / bundle).read(name).decode()

    assert any(not when[1].endswith("00:00.000Z") for when in of_the_sun.finditer(told("plain.zip", "events.txt")))
    whens = [when[1] for name in ("events.txt", "why.txt") for when in of_the_sun.finditer(told("blurred.zip", name))]
    assert whens
    assert all(when.endswith(("00:00.000Z", "00:00Z")) for when in whens)
    stretches = json.loads(told("blurred.zip", "report.json"))["sky"]["stretches"]
    assert {stretch[end][13:] for stretch in stretches for end in ("from", "until")} == {":00:00Z"}


def test_a_session_by_day_is_to_be_repeated_in_the_dark(gse, tmp_path):
    path = tmp_path / "session.mcap"
    assert gse("simulate", "--scenario", "daylight", "--seconds", 12, "--rate-hz", 2, "--file", path).code == 0
    following = gse("why", path).out.split("\nWhat next\n")[1]
    assert "when it is dark:\n    gse preflight --station FILE" in following
    assert "gse plan" not in following


def test_a_mistake_of_the_set_up_is_no_failure_of_the_sensor(gse, session, tmp_path):
    done = gse("report", session, "--out", tmp_path / "report", "--json")
    report = json.loads(done.out)
    assert done.code == 5
    assert report["verdict"] == "INCONCLUSIVE"
    assert report["reasons"][0].startswith("set-up: latitude sign: the stars fit site.latitude_deg: -37.42")
    failed = [row for row in report["measurements"] if row["name"].endswith("mean |dDE|")]
    assert [row["outcome"] for row in failed] == ["INCONCLUSIVE"]


def test_a_bundle_with_the_site_has_the_recording(gse, session, tmp_path):
    bundle = tmp_path / "bundle.zip"
    assert gse("why", session, "--bundle", bundle, "--with-site").code == 0
    held = zipfile.ZipFile(bundle)
    assert held.read("session.mcap") == session.read_bytes()
    assert "37.42" in held.read("station.yaml").decode()
    again = gse("why", session, "--bundle", bundle)
    assert again.code == 2
    assert "exists already" in again.err
    assert "--bundle FILE" in gse("why", session, "--with-site").err


def test_align_refuses_to_hide_a_gross_mistake(gse, session, tmp_path):
    written = tmp_path / "aligned.yaml"
    done = gse("align", session, "--write", written, "--json")
    assert done.code == 1
    assert not written.exists()
    assert json.loads(done.out)["gross"]["cause"] == "latitude sign"
    assert "nothing is written: the fit hides a gross difference from the stated set-up: latitude sign" in done.err
    assert gse("align", session, "--write", written, "--accept-gross").code == 0
    assert written.exists()


def test_a_mount_that_is_fitted_does_not_hide_it_in_the_report(gse, session, tmp_path):
    station = tmp_path / "station.yaml"
    recorded = replay_session(session).session
    station.write_text(with_values(recorded.station_text, "mount", {"align": "first 4 s"}))
    done = gse("report", session, "--station", station, "--out", tmp_path / "report", "--json")
    report = json.loads(done.out)
    assert report["verdict"] != "PASS"
    assert report["diagnosis"][0]["cause"] == "latitude sign"
    assert any("the fitted mount is 74." in reason for reason in report["reasons"])


def test_a_running_session_announces_it_within_thirty_seconds(session):
    told: list[LinkEvent] = []
    replay_session(session, make_listeners=lambda loop: [LiveDiagnosis(told.append)])
    (event,) = told
    assert isinstance(event, FindingEvent)
    assert event.finding.cause == "latitude sign"
    assert event.finding.is_gross
