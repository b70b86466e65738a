"""gse align, gse calibrate and gse compare, on simulated sessions."""

import json
from pathlib import Path

import pytest
from skies.known_nights import session

from gse.cli import compare
from gse.config.choice import with_values
from gse.config.station import read_station
from gse.simulator.scenario import load_scenario
from gse.verdict.session_comparison import session_comparison


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("sessions")


def simulated(gse, folder, scenario, *options):
    """A session of 45 panoramas, made once."""
    path = folder / f"{scenario}.mcap"
    if not path.exists():
        options = options or ("--seconds", 600, "--rate-hz", 0.075)
        assert gse("simulate", "--scenario", scenario, "--file", path, *options).code == 0
    return path


def test_align_finds_the_mount_that_was_simulated_and_writes_it(gse, folder, tmp_path):
    session = simulated(gse, folder, "inclined")
    written = tmp_path / "aligned.yaml"
    report = json.loads(gse("align", session, "--json", "--write", written).out)
    assert report["schema"] == "gse.alignment/1"
    assert report["azimuth_deg"] == pytest.approx(140, abs=2 / 3600)
    assert report["altitude_deg"] == pytest.approx(45, abs=2 / 3600)
    assert report["roll_deg"] == pytest.approx(30, abs=30 / 3600)
    assert report["frames"] + report["rejected"] == 45
    station, _ = read_station(written)
    assert station.mount.altitude_deg == report["altitude_deg"]
    assert station.mount.align is None
    assert station.mount.uncertainty.fitted
    sigma = report["sigma_arcsec"]["altitude"]
    assert station.mount.uncertainty.altitude_arcsec == pytest.approx(1.96 * sigma, abs=0.02)


def test_align_says_what_it_found_in_words(gse, folder):
    out = gse("align", simulated(gse, folder, "inclined")).out
    assert "altitude" in out
    assert "even against odd minutes" in out


def test_a_station_file_that_exists_is_not_overwritten(gse, folder, tmp_path):
    there = tmp_path / "there.yaml"
    there.write_text("mine")
    done = gse("align", simulated(gse, folder, "inclined"), "--write", there)
    assert done.code == 2
    assert "exists already" in done.err
    assert there.read_text() == "mine"


def test_calibrate_finds_a_lens_that_is_one_percent_longer_and_replay_then_passes(gse, folder, tmp_path):
    session = simulated(gse, folder, "wrong-focal-length")
    written = tmp_path / "calibrated.yaml"
    report = json.loads(gse("calibrate", session, "--json", "--write", written).out)
    assert report["schema"] == "gse.calibration/1"
    assert report["identified_after"] == report["panoramas"] == 45
    assert report["focal_length_px"] == pytest.approx(4211.6, abs=6 * report["sigma"]["focal_length_px"])
    assert report["before"]["rms_px"] > 0
    assert sum(cell[2] for row in report["residual_map_px"] for cell in row) > 400
    replayed = gse("replay", session, "--station", written, "--out", tmp_path / "replayed", "--json")
    rows = {row["name"]: row["outcome"] for row in json.loads(replayed.out)["measurements"]}
    assert rows["mean |dRA*|"] == rows["mean |dDE|"] == "PASS"  # 45 frames decide nothing of availability


def test_the_camera_does_not_depend_on_the_identifier_under_test(gse, folder, tmp_path):
    session, robust = simulated(gse, folder, "inclined"), tmp_path / "robust.yaml"
    gse("align", session, "--write", robust)
    robust.write_text(with_values(robust.read_text(), "identifier", {"algorithm": "robust"}))
    reports = [gse("calibrate", session, "--json", *given).out for given in ((), ("--station", robust))]
    assert json.loads(reports[0])["identified_after"] == 45
    assert reports[0] == reports[1]


def test_calibrate_names_the_hot_pixels(gse, folder):
    done = gse("calibrate", simulated(gse, folder, "hot-pixels", "--seconds", 300, "--rate-hz", 0.2))
    (line,) = [line for line in done.out.splitlines() if line.startswith("hot pixels")]
    assert line.count("(") == 12


def test_compare_one_session_under_two_identifiers(gse, folder):
    done = gse("compare", simulated(gse, folder, "inclined"), "--identifier", "robust", "--json")
    report = json.loads(done.out)
    assert report["schema"] == "gse.compare/1"
    assert report["paired"] is True
    assert done.code == (1 if report["regression"] else 0)
    names = [row["name"] for row in report["rows"]]
    assert names[:3] == ["mean |dRA*|", "NEA dRA*", "bias dRA*"]


def test_compare_ends_with_1_where_a_station_file_makes_it_worse(gse, folder, tmp_path):
    session = simulated(gse, folder, "inclined")
    worse = tmp_path / "worse.yaml"
    gse("align", session, "--write", worse)
    text = worse.read_text().replace("altitude_deg: 4", "altitude_deg: 4", 1)
    station, _ = read_station(worse)
    worse.write_text(text.replace(str(station.mount.altitude_deg), str(station.mount.altitude_deg + 0.01)))
    done = gse("compare", session, "--station", worse)
    assert done.code == 1
    assert done.out.startswith("REGRESSION in mean |d")


def test_compare_with_a_session_of_which_no_answer_counts_decides_nothing(gse, folder):
    night, day = simulated(gse, folder, "inclined"), simulated(gse, folder, "daylight")
    done = gse("compare", night, day)
    assert done.code == 5
    assert done.out.startswith("INCONCLUSIVE: nothing can be compared")
    assert json.loads(gse("compare", night, day, "--json").out)["regression"] is None
    many = gse("compare", night, day, night)
    assert many.code == 5
    assert "INCONCLUSIVE: nothing can be compared" in many.out
    assert many.out.splitlines()[-1].endswith("no regression")


def test_compare_of_one_session_with_itself_asks_for_another(gse, folder):
    done = gse("compare", simulated(gse, folder, "inclined"))
    assert done.code == 2
    assert "give a second session" in done.err


@pytest.mark.parametrize("command", ["align", "calibrate", "compare"])
def test_a_missing_session_is_one_line_and_no_traceback(gse, tmp_path, command):
    arguments = (command, tmp_path / "none.mcap", *([tmp_path / "other.mcap"] if command == "compare" else []))
    done = gse(*arguments)
    assert done.code == 2
    assert "none.mcap" in done.err
    assert len(done.err.strip().splitlines()) <= 2


@pytest.mark.parametrize("command", ["align", "calibrate"])
def test_a_foreign_file_is_refused(gse, tmp_path, command):
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(b"this is not a session" * 10)
    done = gse(command, foreign)
    assert done.code == 2
    assert len(done.err.strip().splitlines()) <= 2


def test_what_is_left_out_and_a_stated_clock_stand_in_the_report(gse, folder, tmp_path):
    session = simulated(gse, folder, "inclined")
    stretch = f"{load_scenario('inclined').start}/2100-01-01T00:00:00Z=dew on the lens"
    done = gse("replay", session, "--leave-out", stretch, "--clock-error", "0.1s", "--json", "--out", tmp_path)
    report = json.loads(done.out)
    assert report["exclusions"][0]["reason"] == "dew on the lens"
    assert report["exclusions"][0]["frames"] == 45
    assert report["clock"]["stated"] is True
    assert report["verdict"] == "INCONCLUSIVE"


@pytest.mark.parametrize("command", ["run", "replay", "report"])
def test_a_clock_error_without_unit_is_refused_before_anything_is_done(gse, tmp_path, command):
    arguments = () if command == "run" else (tmp_path / "none.mcap",)
    done = gse(command, *arguments, "--clock-error", "0.1", "--out", tmp_path / "sessions")
    assert done.code == 2
    assert "expected for example 0.1s" in done.err
    assert not (tmp_path / "sessions").exists()


def test_a_clock_error_that_was_stated_live_is_in_the_session(gse, tmp_path):
    live = gse("run", "--duration", 2, "--clock-error", "20ms", "--json", "--out", tmp_path / "live")
    (session,) = (tmp_path / "live").glob("*/session.mcap")
    replayed = gse("replay", session, "--json", "--out", tmp_path / "replayed")
    assert json.loads(live.out)["clock"]["error_bound_s"] == 0.02
    assert json.loads(replayed.out)["clock"] == json.loads(live.out)["clock"]


def test_a_raw_capture_gives_the_same_report_each_time_without_times_of_this_host(gse, folder, tmp_path):
    session = simulated(gse, folder, "inclined")
    capture = tmp_path / "capture.bin"
    gse("session", "export", session, "--format", "raw", "--out", capture)
    station = tmp_path / "station.yaml"
    station.write_text(load_scenario("inclined").station_text())
    given = (capture, "--station", station, "--start-utc", load_scenario("inclined").start)
    for name in "ab":
        gse("replay", *given, "--out", tmp_path / name)
    one, two = (next((tmp_path / name).glob("*/report.json")).read_text() for name in "ab")
    assert one == two
    assert json.loads(one)["identification"]["subjects"]["onboard"]["time_ms"]["n"] == 0
    assert json.loads(next((tmp_path / "a").glob("*/timing.json")).read_text())["frames"] == 45
    aligned = json.loads(gse("align", *given, "--json").out)
    assert aligned["altitude_deg"] == pytest.approx(45, abs=0.01)
    calibrated = json.loads(gse("calibrate", *given, "--json").out)
    assert calibrated["identified_after"] == 45
    compared = gse("compare", capture, *given, "--json")
    assert json.loads(compared.out)["paired"] is True


@pytest.mark.parametrize("command", ["align", "calibrate"])
def test_a_raw_capture_without_its_start_says_what_is_missing(gse, tmp_path, command):
    raw = tmp_path / "capture.bin"
    recorded = Path(__file__).parents[3] / "replays" / "golden" / "clear.mcap"
    assert gse("session", "export", recorded, "--format", "raw", "--out", raw).code == 0
    done = gse(command, raw)
    assert done.code == 2
    assert "--start-utc" in done.err


def test_more_than_two_sessions_have_a_row_each_and_are_compared_with_the_first():
    made = [session(300, noise=noise, seed=seed) for seed, noise in enumerate((2.0, 2.0, 9.0))]
    paths = [Path("one.mcap"), Path("two.mcap"), Path("noisy.mcap")]
    document = compare._document_of_many(paths, made, [session_comparison(made[0], other) for other in made[1:]])
    names = [row["name"] for row in document["table_4_1"]["rows"][:3]]
    assert names == [f"LAPAN-like {path.name}, onboard" for path in paths]
    assert [item["regression"] for item in document["comparisons"]] == [False, True]
    lines = "\n".join(compare._lines_of_many(document))
    assert "LAPAN-like noisy.mcap against LAPAN-like one.mcap: REGRESSION in mean |dRA*|" in lines
    assert "Star Sensor 1 of the paper" in lines


@pytest.mark.parametrize(
    ("value", "text"), [(11.1, "11.1"), (2414.0, "2414"), (-1396.4, "-1396"), (-2.4e6, "-2.4e+06")]
)
def test_figures_in_columns_do_not_run_together(value: float, text: str) -> None:
    shown = compare._figure(value, "7.3g")
    assert shown.split() == [text]
    assert shown.startswith(" ")


def test_a_plan_says_one_length_for_each_row_and_status_the_verdict_of_the_report(gse, tmp_path):
    scenario = tmp_path / "slip.yaml"
    scenario.write_text("text: The mount slips.\nmotion: {slips: [[40, 150, -90, 0]]}\n")
    assert gse("run", "--port", f"sim://?frames=1200&scenario={scenario}", "--no-plots", "--out", tmp_path).code == 5
    (session,) = tmp_path.glob("2*")
    told = gse("plan", session).out
    assert "slip of the mount" in told
    assert f"gse report {session} --leave-out" in told
    assert "would have decided" not in told
    assert told.count("onboard mean |dRA*|") == 1
    assert "Z, INCONCLUSIVE (SIMULATED), exit code 5" in gse("status", session).out
