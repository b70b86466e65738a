import json
import shutil
from pathlib import Path

import pytest
from devices.programs import program

from gse.cli.evaluate import table as evaluation_table
from gse.errors import TableError, UsageError
from gse.evaluation.panoramas import benchmark, read_set, table
from gse.values.identifier_options import IdentifierOptions

REAL_SKY = Path(__file__).parents[3] / "benchmarks" / "real-sky"
NAME = "rooftop-alt40-azi-135"


@pytest.fixture
def folder(tmp_path):
    """Three panoramas of one image of the real sky, with its truth."""
    (tmp_path / "tables").mkdir()
    for kind in ("", "-literal", "-subpixel"):
        shutil.copy(REAL_SKY / "tables" / f"{NAME}{kind}.csv", tmp_path / "tables")
    truth = json.loads((REAL_SKY / "truth.json").read_text())
    (tmp_path / "truth.json").write_text(json.dumps({NAME: truth[NAME]}))
    return tmp_path


def test_the_42_real_tables_of_the_repository_are_a_set():
    found = read_set(REAL_SKY)
    assert (found.name, len(found.cases)) == ("real-sky", 42)
    names = {case.name for case in found.cases}
    assert {f"{NAME}", f"{NAME}-literal", f"{NAME}-subpixel"} <= names


def test_built_in_and_external_identifiers_stand_in_one_table(folder, gse):
    truth = json.loads((folder / "truth.json").read_text())[NAME]
    body = f"""\
for line in sys.stdin:
    p = json.loads(line)
    if p["frame_no"] == 0: answer(p, ra_deg={truth["ra_deg"]}, de_deg={truth["de_deg"]} + 0.01, elapsed_us=3000)
    elif p["frame_no"] == 1: answer(p, ra_deg={truth["ra_deg"]}, de_deg={truth["de_deg"]} + 5)
    else: answer(p, ra_deg=400)
"""
    path = program(folder, body)
    options = ("--frames", 3, "--identifier", "neighbour", "--identifier", f"command:{path}")
    document = json.loads(gse("evaluate", "--panoramas", folder, *options, "--json").out)
    assert document["schema"] == "gse.benchmark/1"
    rows = {(row["set"], row["identifier"]): row for row in document["rows"]}
    assert len(rows) == 4
    ours = rows[folder.name, "neighbour"]
    assert ours["rates"]["right"]["count"] == ours["panoramas"] == 3
    assert ours["boresight_arcsec"]["max"] < 60
    theirs = rows[folder.name, "onboard"]
    assert {kind: rate["count"] for kind, rate in theirs["rates"].items()} == {
        "right": 1,
        "false": 1,
        "none": 1,
        "coarse": 0,
    }
    assert theirs["boresight_arcsec"]["max"] == pytest.approx(36, abs=0.1)
    assert (ours["failures"], theirs["failures"]) == ({}, {"NONSENSE": 1})
    assert "onboard failed: 2 NONSENSE; counted as none" in table(document["rows"])


def test_a_program_that_is_not_there_is_refused_before_the_others_work(folder):
    missing = IdentifierOptions(algorithm="external", command=("./none",), directory=str(folder))
    with pytest.raises(UsageError, match="there is no file"):
        next(benchmark([IdentifierOptions(), missing], [read_set(folder)], "gaia"))


def test_an_external_identifier_is_a_row_of_the_ordinary_evaluation_too(folder, gse):
    body = "    p = json.loads(line)\n    answer(p, elapsed_us=2000, ra_deg=400 if p['frame_no'] == 3 else 10)\n"
    path = program(folder, f"for line in sys.stdin:\n{body}")
    done = gse("evaluate", "--frames", 4, "--identifier", f"command:{path}", "--json")
    document = json.loads(done.out)
    (cell,) = document["cells"]
    assert (cell["identifier"], cell["frames_done"], cell["cpu_ms"]["median"]) == ("onboard", 4, 2.0)
    assert cell["rates"]["false"]["count"] == cell["frames_counted"] - 1
    assert cell["failures"] == {"NONSENSE": 1}
    assert cell["first_failure"] == "ra_deg is 400: expected a number from 0 to 360"
    assert "onboard failed: 1 NONSENSE; counted as none" in evaluation_table(document)


def test_an_external_identifier_has_the_time_of_the_station_and_its_own_clock_counts(folder, gse):
    """On a busy computer an answer comes late: the time that the program states is judged, or the station's."""
    truth = json.loads((folder / "truth.json").read_text())[NAME]
    right = f"ra_deg={truth['ra_deg']}, de_deg={truth['de_deg']}"
    body = f"""\
for line in sys.stdin:
    p = json.loads(line)
    time.sleep(0.3)
    own = {{"elapsed_us": 1000}} if p["frame_no"] == 1 else {{}}
    answer(p, {right}, **own)
"""
    path = program(folder, "import time\n" + body)
    (folder / "station.yaml").write_text(
        "version: 1\nsensor: {rows: 768, columns: 1024, focal_length_px: 5113.75}\n"
        "site: {latitude_deg: 0, longitude_deg: 0}\nidentifier: {timeout_ms: 5000}\n"
    )
    options = ("--panoramas", folder, "--frames", 1, "--identifier", f"command:{path}", "--json")
    for station, right_ones in (((), 2), (("--station", folder / "station.yaml"), 3)):
        rows = json.loads(gse("evaluate", *options, *station).out)["rows"]
        (of_set,) = (row for row in rows if row["set"] == folder.name)
        assert of_set["rates"]["right"]["count"] == right_ones  # the first answer is that of the start
        assert of_set["failures"].get("TIMEOUT", 0) == 3 - right_ones


@pytest.mark.parametrize(
    ("truth", "text"),
    [
        ("{", "is not JSON"),
        ("[]", "expected an object"),
        ('{"NAME": {"rows": 768}}', "expected rows, columns, focal_length_px, ra_deg, de_deg"),
        ('{"NAME": {"rows": 9, "columns": 9, "focal_length_px": NaN, "ra_deg": 1, "de_deg": 1}}', "not finite"),
        ('{"NAME": 3}', "expected rows"),
    ],
)
def test_a_damaged_truth_is_named(folder, truth, text):
    (folder / "truth.json").write_text(truth.replace("NAME", NAME))
    with pytest.raises(TableError) as error:
        read_set(folder)
    assert "truth.json" in str(error.value)
    assert text in str(error.value)


def test_a_folder_without_truth_is_refused(tmp_path, gse):
    with pytest.raises(UsageError, match="has no panorama with a truth"):
        read_set(tmp_path)
    assert gse("evaluate", "--panoramas", tmp_path / "none").code == 2
