import json

import pytest
from click.testing import CliRunner

from gse.cli.catalog import command

STATION = """\
version: 1
sensor: {rows: 256, columns: 256, focal_length_px: 300}
site: {latitude_deg: -6.5, longitude_deg: 106.7}
"""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def info(*arguments):
    result = CliRunner().invoke(command, ["info", *arguments], catch_exceptions=False)
    assert result.exit_code == 0
    return result.stdout


def test_the_built_in_station_works_with_gaia_and_says_whose_it_is():
    facts = json.loads(info("--json"))
    assert facts["schema"] == "gse.catalog/1"
    assert (facts["source"]["stars"], facts["source"]["epoch_jyear"]) == (482_176, 2016.0)
    assert "Gaia" in facts["source"]["credit"]
    assert "CC BY-SA 3.0 IGO" in facts["source"]["licence"]
    assert facts["mission_catalog"]["stars"] == 4200
    assert 250_000 < facts["pair_table"]["pairs"] < 300_000
    assert facts["pair_table"]["cached"]
    assert facts["pair_table"]["build_s"] > 0


def test_a_station_is_told_of_in_text(tmp_path):
    path = tmp_path / "station.yaml"
    path.write_text(STATION)
    text = info("--station", str(path))
    assert "Gaia DR3" in text
    assert "1500" in text
    assert "licence" in text


def test_the_robust_identifier_has_tables_of_its_own(tmp_path):
    path = tmp_path / "station.yaml"
    path.write_text(STATION + "identifier: {algorithm: robust}\n")
    facts = json.loads(info("--station", str(path), "--json"))
    assert facts["mission_catalog"]["identifier"] == "robust"
    assert facts["pair_table"] is None


def test_the_coverage_says_how_many_fields_have_too_few_stars_and_what_thinning_does():
    facts = json.loads(info("--json", "--fewer-than", "14"))["coverage"]
    assert (facts["fewer_than"], facts["faintest_magnitude"]) == (14, 5.57)
    assert 0.15 < facts["share"] <= facts["thinned_share"] < 1
    assert facts["thinned_stars"] < facts["thinned_of"] == 4200
    assert (len(facts["map"]), {len(row) for row in facts["map"]}) == (12, {24})
    brighter = json.loads(info("--json", "--fewer-than", "14", "--magnitude", "5"))["coverage"]
    assert brighter["share"] > facts["share"]
    assert brighter["faintest_magnitude"] <= 5


def test_the_map_of_coverage_is_drawn_and_too_bright_a_limit_is_refused():
    lines = info("--magnitude", "4").splitlines()
    rows = [line.split("deg  ")[1] for line in lines if line.startswith("  DE ")]
    assert {len(row) for row in rows} == {24}
    assert set("".join(rows)) <= set(".123456789#")
    assert "#" in "".join(rows)
    refused = CliRunner().invoke(command, ["info", "--magnitude", "-3"])
    assert "no star is brighter than -3 mag; the brightest has -1.11 mag" in str(refused.exception)
