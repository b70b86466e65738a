"""Tables with UTC as sessions: attitudes from orbit, and panoramas."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.statistics.smooth_path import left_of_path

ORBIT = "version: 1\nsubject: sensor\nsensor: {rows: 1024, columns: 1024, focal_length_px: 4169.9}\n"
FRAMES, STEP_S = 600, 0.5
NOISE_ARCSEC = (5.0, 5.0, 30.0)
FALSE = (3, 50, 51, 300, 420, 599)
ARCSEC = np.pi / 648_000


def utc(number: int) -> str:
    seconds, half = divmod(number, 2)
    return f"2026-03-20T18:{seconds // 60:02d}:{seconds % 60:02d}.{5 * half}Z"


def turns() -> Rotation:
    """From ICRS to a body that turns by 0.5 deg/s, its boresight (z) over both poles, by scipy."""
    rng = np.random.default_rng(4)
    course = Rotation.from_rotvec(np.outer(np.arange(FRAMES) * STEP_S, [0.0, np.radians(0.5), 0.0]))
    noise = Rotation.from_rotvec(rng.normal(size=(FRAMES, 3)) * NOISE_ARCSEC * ARCSEC)
    jumps = np.zeros((FRAMES, 3))
    jumps[list(FALSE), 0] = 400 * ARCSEC
    jumps[300, 0] = np.pi
    return Rotation.from_rotvec(jumps) * noise * course


def quaternions() -> np.ndarray:
    """The numbers of the table, scalar last, with signs that change as a sensor may send them."""
    signs = np.random.default_rng(5).choice([-1, 1], FRAMES)
    return turns().inv().as_quat() * signs[:, None]


def telemetry(path: Path, values: np.ndarray, names: str) -> Path:
    with path.open("w") as file:
        file.write(f"utc,valid,{names}\n")
        for number, row in enumerate(values):
            valid = int(not 100 <= number < 110)
            numbers = ",".join(f"{value:.9f}" for value in row) if valid else ",".join("nan" for _ in row)
            file.write(f"{utc(number)},{valid},{numbers}\n")
    return path


def angles() -> np.ndarray:
    """RA, DE and roll of the same: roll is the position angle of up (-y) from north through east."""
    body = turns().inv()
    boresight, up = body.apply([0.0, 0, 1]), body.apply([0.0, -1, 0])
    ra, de = np.arctan2(boresight[:, 1], boresight[:, 0]), np.arcsin(boresight[:, 2])
    east = np.column_stack([-np.sin(ra), np.cos(ra), np.zeros(FRAMES)])
    north = np.cross(boresight, east)
    roll = np.arctan2((up * east).sum(1), (up * north).sum(1))
    return np.degrees(np.column_stack([ra % (2 * np.pi), de, roll]))


@pytest.mark.parametrize("kind", ["quaternions", "angles"])
def test_telemetry_is_judged_by_a_smooth_path_and_never_passes(gse, tmp_path, kind):
    (tmp_path / "orbit.yaml").write_text(ORBIT)
    values, names = (quaternions(), "q1,q2,q3,q4") if kind == "quaternions" else (angles(), "ra_deg,de_deg,roll_deg")
    table = telemetry(tmp_path / "orbit.csv", values, names)
    assert gse("session", "import", table, "--station", tmp_path / "orbit.yaml").code == 0
    session = tmp_path / "orbit.mcap"
    done = gse("report", session, "--out", tmp_path / "report")
    assert (done.code, "no truth: the station file says subject: sensor" in done.out) == (5, True)
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert (report["session"]["site"], report["session"]["mount"]) == (None, None)
    with (tmp_path / "report" / "frames.csv").open() as file:
        assert [row["utc"][:21] for row in csv.DictReader(file)][:2] == [utc(0)[:21], utc(1)[:21]]
    rows = {row["name"]: row for row in report["measurements"]}
    assert rows["false answers"]["value"] == pytest.approx(len(FALSE) / (FRAMES - 10))
    assert rows["availability"]["value"] == pytest.approx((FRAMES - 10 - len(FALSE)) / FRAMES)
    assert rows["mean |dRA*|"]["outcome"] == "not tested"
    noise = [metric["value"] for metric in report["metrics"] if metric["name"] == "noise equivalent angle"]
    assert noise == pytest.approx(NOISE_ARCSEC, rel=0.12)
    assert "no truth" in gse("why", session, "--bundle", tmp_path / "b.zip").out
    assert "--station" in gse("conventions", session).err
    assert gse("compare", session, session).code == 0
    assert "without site" in gse("config", "check", tmp_path / "orbit.yaml").out


def test_a_pause_parts_the_path_and_a_steady_turn_leaves_nothing():
    times_s = np.concatenate([np.arange(20), 1000 + np.arange(20)]).astype(float)
    course = Rotation.from_rotvec(np.outer(times_s % 1000, np.radians([1.0, -2.0, 3.0])))
    away = Rotation.from_rotvec([[0.0, 0, 0]] * 20 + [[1.0, 1.0, 0]] * 20)
    left = left_of_path((times_s * 1e9).astype(np.int64), (away * course).as_quat())
    assert np.abs(left).max() < 1e-6


def test_a_table_of_panoramas_is_the_session_of_its_objects(gse, tmp_path):
    source = Path("benchmarks/real-sky/tables/rooftop-alt60-azi45.csv")
    lines = [line for line in source.read_text().splitlines() if line[:1].isdigit()]
    instants = [f"2026-03-20T18:00:0{number}.250Z" for number in range(3)]
    rows = [f"{at},{','.join(line.split(',')[:3])}" for at in instants for line in lines]
    (tmp_path / "night.csv").write_text("\n".join(["utc,y,x,index", *rows, "2026-03-20T18:00:04Z,0,0,0"]))
    station = Path("replays/night-sky/rooftop-alt60-azi45.yaml")
    assert gse("session", "import", tmp_path / "night.csv", "--station", station).code == 0
    out = gse("session", "export", tmp_path / "night.mcap", "--format", "csv").out
    found = list(csv.DictReader(out.splitlines()))
    assert len(found) == 3 * len(lines) + 1
    assert [(row["utc"], row["y_px"]) for row in (found[0], found[-1])] == [
        ("2026-03-20T18:00:00.250000Z", "244.00000"),
        ("2026-03-20T18:00:04.000000Z", ""),
    ]
    assert "4 panoramas, 3 identified, 0 lost" in gse("why", tmp_path / "night.mcap").out


HEAD = "utc,valid,q1,q2,q3,q4"
GOOD = "2026-03-20T18:00:00Z,1,0,0,0,1"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        (f"{HEAD}\n", "ends after its head"),
        ("utc,valid,q1,q2,q3\n", "line 1: utc,valid,q1,q2,q3 is no such head"),
        ("utc,q1,q2,q3,q4\n", "line 1: there is no column valid"),
        (f"{HEAD}\n{GOOD}\n2026-03-20T17:00:00Z,1,0,0,0,1\n", "line 3: 2026-03-20T17:00:00Z is before the row above"),
        (f"{HEAD}\n{GOOD}\n{GOOD}\n", "line 3: 2026-03-20T18:00:00Z stands on the line before"),
        (f"{HEAD}\n2026-03-20T18:00:00,1,0,0,0,1\n", "line 2: '2026-03-20T18:00:00' is not a UTC instant"),
        (f"{HEAD}\n2026-03-20T18:00:00Z,1,0,nan,0,1\n", "line 2: q2 is 'nan', expected a finite number, or valid 0"),
        (f"{HEAD}\n2026-03-20T18:00:00Z,1,0,0,0,0\n", "line 2: the quaternion has length 0"),
        (f"{HEAD}\n2026-03-20T18:00:00Z,1,0,1,0,0,0,1\n", "line 2: 8 columns, expected 6"),
        (f"{HEAD}\n{GOOD}".replace(",", ";").replace(";0;1", ";0,5;1"), "write the decimal point as 0.5"),
        (f"{HEAD}\n{GOOD}\n{'x' * 20_000}", "line 3: more than 10000 characters"),
        (f"{HEAD}\n2026-03-20T18:00:00Z,2,0,0,0,1\n", "line 2: valid is '2': expected 1 or 0"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_line_and_makes_no_session(gse, tmp_path, text, says):
    (tmp_path / "t.csv").write_text(text)
    done = gse("session", "import", tmp_path / "t.csv")
    assert done.code == 2
    assert says in " ".join(done.err.split())
    assert not (tmp_path / "t.mcap").exists()


def test_a_table_has_its_own_utc_and_a_capture_none(gse, tmp_path):
    (tmp_path / "t.csv").write_text(f"{HEAD}\n{GOOD}\n")
    assert "leave --start-utc out" in gse("session", "import", tmp_path / "t.csv", "--start-utc", utc(0)).err
    (tmp_path / "c.bin").write_bytes(b"\x00\x01")
    assert "give the UTC of its first panorama" in gse("session", "import", tmp_path / "c.bin").err
