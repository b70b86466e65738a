from io import StringIO

import numpy as np
import pytest
from devices.command_line import runner

from gse.catalog import load_catalog, mission_catalog
from gse.catalog.flight import write_list, write_table
from gse.config.station import BUILT_IN_TEXT
from gse.errors import CatalogError
from gse.identifier.tables import field_diameter_rad, listed_neighbours, listed_pairs, pair_table
from gse.values.camera import Camera

CAMERA = Camera(1024, 1024, 4169.951, (511.5, 511.5))

THREE = """\
id,x,y,z,n,neighbours
7,1,0,0,2,9,10000,8,20001
8,0.999800006665778,0.019998666693333,0,1,7,20000
9,0.999950000416665,0,0.009999833334167,1,7,10000
"""
LIST = "id,ra_deg,de_deg,magnitude,epoch\n1,10,20,3.5,2016\n2,359.9,-89,4.5,2016\n"


@pytest.fixture(scope="module")
def stars():
    return mission_catalog(load_catalog(stars=1200), CAMERA, 300)


def read(tmp_path, text):
    path = tmp_path / "flight.csv"
    path.write_text(text)
    return load_catalog(str(path))


def test_the_table_is_read_as_it_was_written(stars, tmp_path):
    table = pair_table(stars, field_diameter_rad(CAMERA), tmp_path)
    out = StringIO()
    write_table(stars, listed_neighbours(table), out)
    again = read(tmp_path, out.getvalue())
    assert (again.ids.tolist(), again.icrs.tolist()) == (stars.ids.tolist(), stars.icrs.tolist())
    assert (again.epoch_jyear, again.designation) == (stars.epoch_jyear, "Gaia DR3")
    assert again.name(0) == "Sirius"
    for ours, theirs in zip(table, pair_table(again, 0.0), strict=True):
        assert np.array_equal(ours, theirs)


def test_the_list_is_read_as_it_was_written_to_a_thousandth_of_an_arcsec(stars, tmp_path):
    out = StringIO()
    write_list(stars, out)
    again = read(tmp_path, out.getvalue())
    assert again.ids.tolist() == stars.ids.tolist()
    assert np.abs(again.icrs - stars.icrs).max() < 5e-9
    assert again.neighbours is None


def test_a_flight_catalogue_keeps_its_order_and_nothing_is_chosen(tmp_path):
    catalog = read(tmp_path, "# epoch: 1991.25\n" + THREE)
    assert mission_catalog(catalog, CAMERA, 100) is catalog
    assert (catalog.ids.tolist(), catalog.epoch_jyear, catalog.name(1)) == ([7, 8, 9], 1991.25, "star 8")


def test_the_distances_are_those_of_the_table(tmp_path):
    table = listed_pairs(read(tmp_path, THREE).neighbours)
    assert table.neighbour_urad.tolist() == [10000, 20001, 20000, 10000]
    assert (table.neighbour.tolist(), table.first.tolist()) == ([2, 1, 0, 0], [0, 2, 3, 4])
    pairs = zip(table.brighter.tolist(), table.dimmer.tolist(), table.distance_urad.tolist(), strict=True)
    assert list(pairs) == [(0, 2, 10000), (0, 1, 20001)]


@pytest.mark.parametrize(
    ("sound", "old", "new", "line", "text"),
    [
        (THREE, "\n9,", "\n7,", 4, "star 7 is there twice; first in line 2"),
        (THREE, "9,10000", "6,10000", 2, "the neighbour 6 is not in the catalogue"),
        (THREE, "9,10000", "7,10000", 2, "the neighbour 7 is the star itself"),
        (THREE, "9,10000", "8,20000", 2, "a neighbour is there twice"),
        (
            THREE,
            "9,10000",
            "9,10100",
            2,
            "the distance to 9 is 10100 microradians; the places of the two stars are 10000 apart",
        ),
        (THREE, "9,10000", "9,1e4", 2, "a distance is '1e4': expected a whole number"),
        (THREE, "0,0,2,9", "0,0,3,9", 2, "n is 3: expected 6 fields after it, 4 came"),
        (THREE, "7,1,0", "7,1.1,0", 2, "expected a unit vector"),
        (THREE, "7,1,0", "7,nan,0", 2, "x is 'nan': expected a number"),
        (THREE, "7,1,0", "seven,1,0", 2, "id is 'seven': expected a whole number"),
        (THREE, "neighbours", "others", 1, "columns are id, x, y, z, n, others"),
        (THREE, "id,x,y", "# a remark\nid,x,why", 2, "columns are id, x, why"),
        (LIST, "\n2,", "\n1,", 3, "star 1 is there twice; first in line 2"),
        (LIST, "359.9", "400", 3, "RA 400, DE -89 deg: expected 0 to 360"),
        (LIST, "-89", "-91", 3, "and -90 to 90"),
        (LIST, "4.5,2016", "4.5,2015", 3, "epoch is 2015: expected 2016 as in the first line"),
        (LIST, "4.5,2016", "4.5", 3, "4 fields: expected 5"),
        (LIST, "4.5", "bright", 3, "magnitude is 'bright': expected a number"),
        (LIST, "epoch", "year", 1, "columns are"),
    ],
)
def test_a_damaged_table_or_list_is_named_with_file_and_line(tmp_path, sound, old, new, line, text):
    with pytest.raises(CatalogError) as error:
        read(tmp_path, sound.replace(old, new, 1))
    assert f"flight.csv, line {line}: " in str(error.value)
    assert text in str(error.value)


def test_an_empty_list_is_refused(tmp_path):
    with pytest.raises(CatalogError, match="holds no star"):
        read(tmp_path, LIST.splitlines()[0] + "\n")


def test_config_check_reads_the_catalogue_as_identify_does(tmp_path, capsys):
    gse = runner(capsys)
    (tmp_path / "flight.csv").write_text(THREE.replace("9,10000", "9,10100", 1))
    station = tmp_path / "station.yaml"
    station.write_text(f"{BUILT_IN_TEXT}catalog: flight.csv\n")
    done = gse("config", "check", station)
    assert (done.code, "flight.csv, line 2: the distance to 9" in done.err) == (2, True)


def test_export_writes_both_forms_of_the_mission_catalogue_and_a_session_uses_one(tmp_path, capsys):
    gse = runner(capsys)
    station = tmp_path / "station.yaml"
    station.write_text(f"{BUILT_IN_TEXT}identifier: {{catalog_stars: 200}}\n")
    table, plain = tmp_path / "table.csv", tmp_path / "list.csv"
    assert gse("catalog", "export", "--station", station, "--flight", table, "--list", plain).code == 0
    one, other = load_catalog(str(table)), load_catalog(str(plain))
    assert len(one) == 200
    assert one.ids.tolist() == other.ids.tolist()
    again = gse("catalog", "export", "--station", station, "--flight", table)
    assert (again.code, "exists already" in again.err) == (2, True)
    assert gse("catalog", "export").code == 2

    station.write_text(f"{BUILT_IN_TEXT}catalog: list.csv\n")
    ended = gse("run", "--port", "sim://?frames=3", "--station", station, "--out", tmp_path / "run")
    assert ended.err.splitlines()[-1].startswith("exit code 1: FAIL"), "the verdict of a session on a flight catalogue"
