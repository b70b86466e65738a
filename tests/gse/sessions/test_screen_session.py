"""A sensor before a screen, rehearsed: what was shown is recorded, is the truth, and replays to the byte."""

import json
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from click.testing import CliRunner

from gse.cli import cli
from gse.config.station import parse_station
from gse.errors import ConfigError, UsageError
from gse.recording.session_format import SCREEN_TOPIC
from gse.sessions.replay import replay_session
from gse.station.exclusions import Cause
from gse.statistics.decision import Outcome
from gse.statistics.excuses import left_out
from gse.verdict.assessment import judge

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


def test_a_report_says_that_it_is_of_a_star_simulator_and_what_that_cannot_test(folder):
    (line,) = [one for one in json.loads((folder / "report.json").read_text())["not_tested"] if "simulator" in one]
    assert line.startswith("star simulator: absolute pointing, site and clock; refraction and aberration; the colours")
    assert "<strong>star simulator</strong> that shows RA 83.0°" in (folder / "report.html").read_text()


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
        "the scene changed from RA 359.90 DE 60.00 deg to RA 10.00 DE 89.90 deg turning at 1.02 deg/s",
    ]
    utc_ns = session.frames.columns["utc_ns"]
    over = [int(((utc_ns >= item.from_ns) & (utc_ns < item.until_ns)).sum()) for item in changes]
    assert over == [1, 1]  # 50 ms of exposure each 100 ms, and changes 30 ms after a frame began
    assert np.isfinite(session.frames.columns["ra_true_deg"]).all()


@pytest.fixture(scope="module")
def rates(tmp_path_factory):
    """The session of a table of rates whose limit is 0.5 deg/s, rehearsed."""
    out = tmp_path_factory.mktemp("rates")
    (out / "lab.yaml").write_text(STATION + "limits: {slew_deg_per_s: 0.5}\n")
    command = ["run", str(out / "lab.yaml"), "--port", "sim://?rate_hz=6", "--rates", "0,0.5,3deg/s", "--no-plots"]
    ran = CliRunner().invoke(cli, [*command, "--out", str(out / "sessions")])
    assert ran.exit_code == 0, ran.output
    (session,) = (out / "sessions").iterdir()
    return session


def test_each_rate_is_judged_by_its_own_frames(rates):
    report = json.loads((rates / "report.json").read_text())
    assert [(step["rate_deg_per_s"], step["outcome"]) for step in report["slew"]] == [
        (0.0, "PASS"),
        (0.5, "PASS"),
        (3.0, "FAIL"),
    ]
    still, half, fast = report["slew"]
    assert still["available"] == half["available"] == 1
    assert fast["available"] < 0.5
    assert still["noise_cross_x_arcsec"] < half["noise_cross_x_arcsec"] < fast["noise_cross_x_arcsec"]


def test_the_highest_rate_that_keeps_its_limits_is_a_row_and_faster_frames_count_for_nothing_else(rates):
    report = json.loads((rates / "report.json").read_text())
    (row,) = [row for row in report["measurements"] if row["name"] == "slew rate"]
    assert (row["value"], row["limit"], row["outcome"]) == (0.5, 0.5, "PASS")
    assert report["verdict"] == "PASS"
    (faster,) = [one for one in report["exclusions"] if one["cause"] == "faster than asked"]
    assert faster["reason"] == "the scene turned at 3 deg/s, limits.slew_deg_per_s is 0.5"
    assert faster["frames"] == 360


@pytest.mark.parametrize(
    ("limit", "outcome", "words"),
    [
        (2.0, Outcome.INCONCLUSIVE, "0.5 deg/s is shown; add a step at the limit of 2 to --rates"),
        (3.0, Outcome.FAIL, "at 3 deg/s, onboard availability:"),
    ],
)
def test_a_limit_above_the_highest_rate_that_keeps_is_not_reached(rates, limit, outcome, words):
    session = replay_session(rates).session
    limits = replace(session.station.limits, slew_deg_per_s=limit)
    session.station = session.station.model_copy(update={"limits": limits})
    (row,) = [row for row in judge(session).rows if row.name == "slew rate"]
    assert row.outcome is outcome
    assert words in row.reason


def test_a_limit_of_the_rate_without_a_scene_that_turns_is_named_as_not_tested(folder):
    session = replay_session(folder).session
    limits = replace(session.station.limits, slew_deg_per_s=0.5)
    session.station = session.station.model_copy(update={"limits": limits})
    session.shown = session.shown.only(lambda item: item.rate_deg_per_s == 0)
    (line,) = {line for line in judge(session).not_tested if line.startswith("onboard slew rate")}
    assert "gse run --rates 0,0.5deg/s" in line


REAL = "{focal_length_mm: 501, gamma: 2.5, latency_ms: 35, to_sensor: {x_deg: 1.02, y_deg: -0.53, roll_deg: 20.4}}"


STILL = """\
text: three fields at rest
rate_hz: 5
scene:
  steps:
    - {ra_deg: 83, de_deg: -2, for_s: 10}
    - {ra_deg: 310, de_deg: 40, for_s: 10}
    - {ra_deg: 30, de_deg: 60, for_s: 10}
"""


SLOW = STILL.replace("rate_hz: 5", "rate_hz: 1")
"""Of a mirrored image each frame is searched in vain."""


def rehearsed(folder, station, device, scene=None, rate_hz=3):
    """The session before a screen that differs from the stated one, and its exit code; of the scene screen-fit."""
    fit = (files("gse.simulator") / "scenarios" / "screen-fit.yaml").read_text() + f"rate_hz: {rate_hz}\n"
    (folder / "fit.yaml").write_text(f"{scene or fit}device: {device}\n")
    port = f"sim://?scenario={folder}/fit.yaml"
    before = set(folder.glob("sessions/*"))
    ran = CliRunner().invoke(
        cli, ["run", str(station), "--port", port, "--no-plots", "--out", str(folder / "sessions")]
    )
    (session,) = set(folder.glob("sessions/*")) - before
    return session, ran.exit_code


@pytest.mark.parametrize(
    ("device", "cause", "words"),
    [
        (
            "{screen: {pixel_pitch_mm: 0.1005}}",
            "focal length",
            "% larger than stated: screen.pixel_pitch_mm is 0.1005 instead of 0.1",
        ),
        (
            "{screen: {pixel_pitch_mm: 0.11}}",
            "focal length",
            "or the picture on the screen is about 10.00 % larger than stated",
        ),
        ("{screen: {gamma: 1.8}}", "gamma of the screen", "as on a panel of gamma 1.7"),
    ],
    ids=["pixel pitch", "zoom of 110 %", "night light"],
)
def test_a_screen_that_is_not_as_stated_is_named_in_words(tmp_path, device, cause, words):
    (tmp_path / "lab.yaml").write_text(STATION)
    session, _ = rehearsed(tmp_path, tmp_path / "lab.yaml", device, STILL)
    report = json.loads((session / "report.json").read_text())
    assert [one["cause"] for one in report["diagnosis"]] == [cause]
    assert words in report["diagnosis"][0]["size"]
    if report["verdict"] != "PASS":
        assert any(words in reason for reason in report["reasons"])


def test_a_screen_that_is_as_stated_has_no_finding(folder):
    assert json.loads((folder / "report.json").read_text())["diagnosis"] == []


def test_a_fitted_screen_is_written_and_the_next_session_is_judged_relative_to_it(tmp_path):
    (tmp_path / "lab.yaml").write_text(STATION)
    session, code = rehearsed(tmp_path, tmp_path / "lab.yaml", f"{{screen: {REAL}}}", rate_hz=1)
    assert code != 0
    fitted = tmp_path / "fitted.yaml"
    fit = CliRunner().invoke(cli, ["align", str(session), "--write", str(fitted), "--json"])
    assert fit.exit_code == 0, fit.output
    report = json.loads(fit.stdout)
    assert report["schema"] == "gse.screen-fit/1"
    assert report["focal_length_mm"] == pytest.approx(501, abs=2 * report["uncertainty"]["away_mm"])
    session, code = rehearsed(tmp_path, fitted, f"{{screen: {REAL}}}")
    report = json.loads((session / "report.json").read_text())
    assert (code, report["word"]) == (0, "PASS, relative")
    assert report["reasons"] == ["relative to a fitted screen: absolute pointing not tested"]
    assert {term["name"]: term["ra_arcsec"] for term in report["truth_budget"]["terms"]}["screen scale"] > 0


def test_a_mirrored_monitor_is_named_in_words_and_instead_of_a_fit(tmp_path):
    (tmp_path / "lab.yaml").write_text(STATION)
    session, code = rehearsed(tmp_path, tmp_path / "lab.yaml", "{sensor: {mirrored: true}}", SLOW)
    assert code != 0
    (found,) = json.loads((session / "report.json").read_text())["diagnosis"]
    assert found["cause"] == "mirrored image"
    assert "the monitor is mirrored" in found["size"]
    refused = CliRunner().invoke(cli, ["align", str(session)]).exception
    assert isinstance(refused, UsageError)
    assert "switch the mirroring of the monitor off" in str(refused)


@pytest.mark.parametrize(
    ("text", "words"),
    [("0,fast", "expected rates from 0 to 10 deg/s"), ("0,20deg/s", "expected rates from 0 to 10 deg/s")],
)
def test_rates_that_are_none_are_refused_with_an_example(tmp_path, text, words):
    (tmp_path / "lab.yaml").write_text(STATION)
    command = ["run", str(tmp_path / "lab.yaml"), "--port", "sim://", "--rates", text, "--out", str(tmp_path)]
    refused = CliRunner().invoke(cli, command).exception
    assert isinstance(refused, UsageError)
    assert words in str(refused)


def test_rates_need_a_sky_that_can_turn(tmp_path):
    refused = CliRunner().invoke(cli, ["run", "--rates", "0,1deg/s", "--out", str(tmp_path)]).exception
    assert isinstance(refused, UsageError)
    assert "the station file has no mount.inertial" in str(refused)


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
