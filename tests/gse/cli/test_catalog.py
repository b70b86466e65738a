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
