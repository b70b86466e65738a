"""Parameters that a station file states are read back without anybody asking."""

import json

import pytest
import yaml

from protocols import load_protocol

STATION = """\
version: 1
sensor: {name: ST-1, rows: 1024, columns: 1024, focal_length_px: 4170}
site: {name: roof, latitude_deg: -6.53, longitude_deg: 106.7, height_m: 250}
port: {url: "sim://?scenario=night.yaml"}
protocol: parameters.yaml
"""


def described():
    description = yaml.safe_load(load_protocol("panorama-v1").text)
    item = {"name": "threshold_counts", "type": "u16"}
    description["messages"]["PARAMETERS"] = {"code": 0x16, "direction": "from sensor", "items": [item]}
    description["commands"] = {"READ_PARAMETERS": {"code": 0x91, "answer": "PARAMETERS"}}
    return yaml.safe_dump(description | {"parameters": "READ_PARAMETERS"}, sort_keys=False)


@pytest.mark.parametrize("stated", [True, False])
def test_parameters_are_read_back_where_they_are_stated(gse, tmp_path, monkeypatch, stated):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "parameters.yaml").write_text(described())
    (tmp_path / "night.yaml").write_text("text: a short night\nseconds: 8\n")
    test = "test: {parameters: {threshold_counts: 0}}\n" if stated else ""
    (tmp_path / "station.yaml").write_text(STATION + test)
    gse("run", "station.yaml", "--out", tmp_path / "out", "--no-plots")
    (folder,) = (tmp_path / "out").iterdir()
    parameters = json.loads((folder / "report.json").read_text())["parameters"]
    assert parameters["values"] == ({"threshold_counts": 0} if stated else {})
    assert parameters["differences"] == []
