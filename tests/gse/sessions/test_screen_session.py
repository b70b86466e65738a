"""A sensor before a screen, rehearsed: what was shown is recorded, is the truth, and replays to the byte."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from gse.cli import cli
from gse.config.station import parse_station
from gse.errors import ConfigError
from gse.recording.session_format import SCREEN_TOPIC
from gse.sessions.replay import replay_session
from gse.station.exclusions import Cause
from gse.statistics.excuses import left_out

STATION = """\
version: 1
sensor: {name: lab, rows: 1024, columns: 1024, focal_length_px: 4170}
site: {name: lab, latitude_deg: 48, longitude_deg: 11, height_m: 500}
mount: {inertial: {ra_deg: 83, de_deg: -2}}
screen:
  pixel_pitch_mm: 0.1
  columns: 2560
  rows: 1440
  focal_length_mm: 500
  to_sensor: {x_deg: 1, y_deg: -0.5, roll_deg: 20}
protocol: panorama-v1-subpixel
"""
SCENES = """\
text: three scenes
start: 2026-06-21T05:00:00Z
attitude: {sends: true}
scene:
  steps:
    - {ra_deg: 83, de_deg: -2, for_s: 20.03}
    - {ra_deg: 359.9, de_deg: 60, roll_deg: 170, for_s: 20}
    - {ra_deg: 10, de_deg: 89.9, turn_deg_per_s: [0.1, 0.2, 1], for_s: 20}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("screen")
    (out / "lab.yaml").write_text(STATION)
    (out / "scenes.yaml").write_text(SCENES)
    port = f"sim://?scenario={out}/scenes.yaml"
    command = ["run", "--station", str(out / "lab.yaml"), "--port", port, "--no-plots", "--out", str(out / "sessions")]
    ran = CliRunner().invoke(cli, command)
    assert ran.exit_code == 0, ran.output
    (session,) = (out / "sessions").iterdir()
    return session


def test_each_scene_is_truth_while_it_stood_on_the_screen(folder):
    report = json.loads((folder / "report.json").read_text())
    rows = {(row["subject"], row["name"]): row["value"] for row in report["measurements"]}
    for subject in ("onboard", "sensor"):
        assert rows[subject, "95 % of |dRA*|"] < 10
        assert rows[subject, "95 % of |dDE|"] < 10
        assert rows[subject, "false answers"] == 0


def test_the_budget_has_the_terms_of_a_screen_and_none_of_the_sky(folder):
    budget = json.loads((folder / "report.json").read_text())["truth_budget"]
    terms = {term["name"]: term for term in budget["terms"]}
    assert set(terms) == {"screen direction", "screen roll", "pixel grid", "screen time"}
    assert terms["screen time"]["ra_arcsec"] == 0  # sim:// draws at the instant itself
    assert terms["screen direction"]["ra_arcsec"] == pytest.approx(10 / 1.96, abs=0.01)
    assert terms["pixel grid"]["de_arcsec"] == pytest.approx(0.005 * 206264.8 * 0.1 / 500, abs=0.001)


def test_what_was_shown_is_recorded_and_a_replay_gives_the_same_report(folder, tmp_path):
    replayed = CliRunner().invoke(cli, ["replay", str(folder), "--no-plots", "--out", str(tmp_path)])
    assert replayed.exit_code == 0, replayed.output
    (again,) = tmp_path.iterdir()
    assert (again / "report.json").read_bytes() == (folder / "report.json").read_bytes()
    exported = CliRunner().invoke(cli, ["session", "info", str(folder), "--json"])
    assert json.loads(exported.stdout)["messages"][SCREEN_TOPIC] == 3


def test_an_exposure_over_a_change_of_scene_is_left_out_by_name(folder):
    session = replay_session(folder).session
    before, *changes = [item for item in left_out(session) if item.cause is Cause.SCENE_CHANGE]
    assert (before.reason, before.until_ns) == ("nothing was shown yet", session.shown.shown[0].from_ns)
    assert [item.reason for item in changes] == [
        "the scene changed from RA 83.00 DE -2.00 deg to RA 359.90 DE 60.00 deg",
        "the scene changed from RA 359.90 DE 60.00 deg to RA 10.00 DE 89.90 deg",
    ]
    utc_ns = session.frames.columns["utc_ns"]
    over = [int(((utc_ns >= item.from_ns) & (utc_ns < item.until_ns)).sum()) for item in changes]
    assert over == [1, 1]  # 50 ms of exposure each 100 ms, and changes 30 ms after a frame began
    assert np.isfinite(session.frames.columns["ra_true_deg"]).all()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mount: {inertial: {ra_deg: 83, de_deg: -2}}", "mount: {altitude_deg: 60}", "expected mount: {inertial"),
        ("focal_length_mm: 500", "focal_length_mm: 500\n  distance_mm: 800", "expected one of focal_length_mm"),
        ("pixel_pitch_mm: 0.1", "pixel_pitch_mm: 0", "screen.pixel_pitch_mm is 0"),
    ],
)
def test_a_screen_that_cannot_be_is_named_with_its_line(old, new, words):
    with pytest.raises(ConfigError, match="line") as refused:
        parse_station(STATION.replace(old, new), "lab.yaml")
    assert words in str(refused.value)
