"""The main job from the command line: a session is run, recorded, judged and replayed to the same report."""

import csv
import itertools
import json
import re
import shutil
from pathlib import Path

import pytest
from devices.command_line import Gse

from drivers.chunk import Chunk
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX, Attachment, RecordedMessage
from drivers.session_file.writer import CaptureWriter
from gse.config.station import BUILT_IN_TEXT

NIGHT_SKY = Path(__file__).parents[3] / "replays" / "night-sky"
REAL_SKY = Path(__file__).parents[3] / "benchmarks" / "real-sky"
REPORTS = ("report.json", "report.html", "frames.csv", "junit.xml")
ONE_PANORAMA = re.compile(r" frame \d+:")


def patient_station(folder: Path) -> Path:
    """The built-in station: neither the pace of a busy host nor the length of a short session is under test."""
    path = folder / "station.yaml"
    path.write_text(BUILT_IN_TEXT + "limits: {identification_ms: 60000, decision: simple}\n")
    return path


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a simulated session of 12 s."""
    from gse.cli import main

    out = tmp_path_factory.mktemp("night")
    station = patient_station(tmp_path_factory.mktemp("station"))
    with pytest.raises(SystemExit) as ended:
        main(["run", "--station", str(station), "--port", "sim://?frames=120", "--out", str(out)])
    assert not ended.value.code
    (folder,) = out.iterdir()
    return folder


@pytest.fixture(scope="module")
def plain(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the session's report without plots, which take a second to draw."""
    from gse.cli import main

    out = tmp_path_factory.mktemp("plain") / "report"
    with pytest.raises(SystemExit) as ended:
        main(["report", str(session), "--no-plots", "--out", str(out)])
    assert not ended.value.code
    return out


def only_folder(out: Path) -> Path:
    (folder,) = out.iterdir()
    return folder


def test_a_scenario_changes_the_station_that_it_is_run_on_as_well(gse: Gse, tmp_path: Path) -> None:
    out = tmp_path / "out"
    url = "sim://?scenario=inclined&rate_hz=2&frames=60"
    assert gse("run", "--station", patient_station(tmp_path), "--port", url, "--out", out).code == 0
    folder = only_folder(out)
    assert gse("replay", folder / "session.mcap", "--no-plots", "--out", tmp_path / "again").code == 0
    assert "</svg>" not in (only_folder(tmp_path / "again") / "report.html").read_text()


def test_a_run_ends_with_the_verdict_and_the_paths(gse: Gse, tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ("--port", "sim://?frames=60", "--no-plots", "--out", out)
    done = gse("run", "--station", patient_station(tmp_path), *options)
    folder = only_folder(out)
    assert done.code == 0
    assert done.out.split()[0] == "PASS"
    assert str(folder / "session.mcap") in done.err
    assert str(folder / "report.html") in done.err
    page = (folder / "report.html").read_text()
    assert "sim://?frames=60" in page
    assert "</svg>" not in page


def test_a_replay_keeps_the_identifier_that_the_run_was_told_to_use(gse: Gse, tmp_path: Path) -> None:
    station = patient_station(tmp_path)
    gse("run", "--station", station, "--port", "sim://?frames=60", "--identifier", "robust", "--out", tmp_path / "out")
    folder = only_folder(tmp_path / "out")
    gse("replay", folder / "session.mcap", "--out", tmp_path / "again")
    again = only_folder(tmp_path / "again")
    assert json.loads((again / "report.json").read_text())["session"]["identifier"]["algorithm"] == "robust"
    for name in REPORTS:
        assert (again / name).read_bytes() == (folder / name).read_bytes(), name


def test_replays_give_the_report_of_the_run_to_the_byte_each_in_a_folder_of_its_own(
    gse: Gse, session: Path, plain: Path, tmp_path: Path
) -> None:
    """The one at full speed with plots, the other without."""
    copy = Path(shutil.copy(session / "session.mcap", tmp_path))
    for options in (("--plots",), ("--speed", "60")):
        assert gse("replay", copy, *options, "--out", tmp_path / "out").code == 0
    folders = sorted((tmp_path / "out").iterdir(), key=lambda folder: "</svg>" in (folder / "report.html").read_text())
    assert len(folders) == 2
    assert "</svg>" in (session / "report.html").read_text()
    for (folder, of), name in itertools.product(zip(folders, (plain, session), strict=True), REPORTS):
        assert (folder / name).read_bytes() == (of / name).read_bytes(), name
    assert copy.read_bytes() == (session / "session.mcap").read_bytes()


def test_a_session_whose_chunks_are_cut_to_single_bytes_gives_the_same_report(
    gse: Gse, session: Path, plain: Path, tmp_path: Path
) -> None:
    with CaptureWriter(tmp_path / "cut.mcap") as writer:
        for record in read_capture(session / "session.mcap"):
            if isinstance(record, Attachment):
                writer.attach(record.name, record.media_type, record.data)
            elif isinstance(record, RecordedMessage) and record.topic == RX:
                for byte in record.data:
                    writer.rx(Chunk(record.utc_ns, record.mono_ns, bytes([byte])))
            elif isinstance(record, RecordedMessage):
                writer.write(record)
    assert gse("replay", tmp_path / "cut.mcap", "--out", tmp_path / "out").code == 0
    again = only_folder(tmp_path / "out")
    for name in REPORTS:
        assert (again / name).read_bytes() == (plain / name).read_bytes(), name


def test_a_session_without_its_station_file_neither_passes_nor_fails(gse: Gse, session: Path, tmp_path: Path) -> None:
    with CaptureWriter(tmp_path / "bare.mcap") as writer:
        for record in read_capture(session / "session.mcap"):
            if isinstance(record, RecordedMessage):
                writer.write(record)
    done = gse("replay", tmp_path / "bare.mcap", "--out", tmp_path / "out")
    lines = done.out.splitlines()
    assert done.code == 5
    assert lines[0].startswith("INCONCLUSIVE (SIMULATED): LAPAN-like (onboard), ")
    assert "cause: station file: the session has no station file, so the built-in station is used" in done.out


def test_frames_are_one_json_object_a_line(gse: Gse, session: Path, tmp_path: Path) -> None:
    done = gse("replay", session / "session.mcap", "--json-frames", "--json", "--out", tmp_path)
    *frames, report = [json.loads(line) for line in done.out.splitlines()]
    assert len(frames) == 120
    assert {frame["schema"] for frame in frames} == {"gse.frame/1"}
    assert frames[0]["utc"].endswith("Z")
    assert frames[0]["matches"][0]["residual_arcsec"] < 60
    assert report["schema"] == "gse.report/1"


def test_a_truncated_session_is_replayed_and_says_that_data_are_missing(
    gse: Gse, session: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.mcap"
    data = (session / "session.mcap").read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    done = gse("replay", cut, "--out", tmp_path / "out")
    assert done.code == 3
    assert "recover" in done.err or "truncated" in done.err


def test_a_raw_capture_takes_its_time_from_the_sensor_and_the_start_given(
    gse: Gse, session: Path, tmp_path: Path
) -> None:
    raw = tmp_path / "raw.bin"
    rx = [record for record in read_capture(session / "session.mcap") if isinstance(record, RecordedMessage)]
    raw.write_bytes(b"".join(record.data for record in rx if record.topic == RX))
    with (session / "frames.csv").open(encoding="utf-8") as table:
        start = next(csv.DictReader(table))["utc"]
    done = gse("replay", raw, "--start-utc", start, "--json-frames", "--clock-error", "1ms", "--out", tmp_path)
    lines = [json.loads(line) for line in done.out.splitlines() if line.startswith("{")]
    assert lines[0]["utc"] == start
    assert abs(lines[-1]["d_ra_cosde_arcsec"]) < 60
    assert "SIMULATED" not in done.out  # nobody knows where these bytes are from


def test_a_raw_capture_without_a_start_is_asked_for_it(gse: Gse, tmp_path: Path) -> None:
    raw = tmp_path / "raw.bin"
    clear = NIGHT_SKY.parent / "golden" / "clear.mcap"
    assert gse("session", "export", clear, "--format", "raw", "--out", raw).code == 0
    done = gse("replay", raw)
    assert done.code == 2
    assert "--start-utc" in done.err


@pytest.mark.parametrize("identifier", ["neighbour", "pivot", "match-group", "robust"])
def test_each_identifier_names_the_stars_of_a_real_panorama(gse: Gse, identifier: str) -> None:
    name = "rooftop-alt60-azi45"
    table, station = REAL_SKY / "tables" / f"{name}.csv", NIGHT_SKY / f"{name}.yaml"
    done = gse("identify", table, "--station", station, "--identifier", identifier, "--json")
    frame = json.loads(done.out)
    assert done.code == 0
    assert frame["ra_deg"] == pytest.approx(314.69368, abs=0.02)
    assert frame["de_deg"] == pytest.approx(64.22432, abs=0.01)
    assert frame["utc"] is None


@pytest.mark.parametrize("text", ["", "5 5 100\n", "5 5 100\n800 900 90\n", "1 1 7\n" * 30])
def test_too_little_sky_is_not_identified_and_exits_with_1(gse: Gse, tmp_path: Path, text: str) -> None:
    (tmp_path / "table.csv").write_text(text)
    done = gse("identify", tmp_path / "table.csv")
    assert done.code == 1
    assert done.out.split(":")[0] in {"TOO_FEW", "NO_MATCH", "SENSOR_FAULT"}


def test_all_equal_index_values_are_identified_all_the_same(gse: Gse, tmp_path: Path) -> None:
    name = "rooftop-alt60-azi45"
    rows = (REAL_SKY / "tables" / f"{name}.csv").read_text().splitlines()[1:]
    (tmp_path / "table.csv").write_text("\n".join(",".join(row.split(",")[:2]) + ",100" for row in rows))
    done = gse("identify", tmp_path / "table.csv", "--station", NIGHT_SKY / f"{name}.yaml")
    assert done.code in {0, 1}


def test_an_index_over_the_maximum_is_a_sensor_fault(gse: Gse, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("1 1 5000\n2 200 100\n300 3 90\n")
    done = gse("identify", tmp_path / "table.csv")
    assert done.code == 1
    assert "5000" in done.out
    assert "4096" in done.out


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["run", "--port", "/dev/ttyNONE"], 4, "/dev/ttyNONE"),
        (["run", "--port", "nonsense://x"], 2, "nonsense"),
        (["run", "--port", "sim://?frames=none"], 2, "frames"),
        (["run", "--port", "replay://absent.mcap"], 2, "absent.mcap"),
        (["run", "--station", "absent.yaml"], 2, "gse config init"),
        (["run", "--http-port", "8420"], 2, "add --view web"),
        (["replay", "absent.mcap", "--bind", "0.0.0.0", "--view", "native"], 2, "add --view web"),
        (["replay", "absent.mcap"], 2, "absent.mcap"),
        (["replay", __file__], 2, "no valid frame of panorama-v1; find the protocol: gse decode --try"),
        (["calibrate", __file__], 2, "no valid frame of panorama-v1; find the protocol: gse decode --try"),
        (["identify", "absent.csv"], 2, "absent.csv"),
        (["nonsense"], 2, "nonsense"),
    ],
)
def test_what_cannot_work_is_said_in_a_line_or_two_with_its_exit_code(
    gse: Gse, tmp_path: Path, arguments: list[str], code: int, words: str
) -> None:
    out = ["--out", str(tmp_path)] if arguments[0] in ("run", "replay") else []
    done = gse(*arguments, *out)
    assert done.code == code
    assert words in done.err
    assert list(tmp_path.iterdir()) == []


def test_an_empty_or_a_foreign_session_is_refused(gse: Gse, tmp_path: Path) -> None:
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "foreign.mcap").write_bytes(b"PK\x03\x04 not a session")
    for name in ("empty.mcap", "foreign.mcap"):
        done = gse("replay", tmp_path / name, "--out", tmp_path / "out")
        assert done.code == 2
        assert name in done.err
