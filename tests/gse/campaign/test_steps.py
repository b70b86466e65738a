"""Runs of procedures in a campaign: a table of their steps over many units."""

import json

import pytest
from devices.emulated_sensor import STATION

from gse.campaign.dataset import DataSet
from gse.campaign.engine import plan_campaign
from gse.campaign.judging import judge_source
from gse.campaign.sources import find_sources

pytest.importorskip("distributed")

STEPS = """\
version: 1
name: SS-TP-07
station: station.yaml
steps:
  - send: PING
  - check: {supply_v: [4.8, 5.2]}
cleanup:
  - power: off
"""


def test_the_steps_of_many_units_are_one_table(gse, tmp_path):
    for unit in ("FM-1", "FM-2"):
        (tmp_path / "station.yaml").write_text(STATION.replace("ST-1", unit))
        steps = STEPS if unit == "FM-1" else STEPS.replace("4.8, 5.2", "5.5, 6")
        (tmp_path / "test.yaml").write_text(steps)
        gse("procedure", "run", tmp_path / "test.yaml", "--out", tmp_path / "runs", "--no-plots")
    dataset = tmp_path / "dataset"
    campaign = plan_campaign(find_sources([str(tmp_path / "runs" / "*")]), DataSet.at(str(dataset), create=True))
    assert [judge_source(source, campaign.job).error for source in campaign.todo] == ["", ""]
    campaign.dataset.renew_index([])
    sql = "select sensor, number, outcome, procedure from steps order by all"
    rows = [json.loads(line) for line in gse("campaign", "query", dataset, sql, "--format", "json").out.splitlines()]
    assert [(row["sensor"], row["number"], row["outcome"]) for row in rows] == [
        ("FM-1", "1", "PASS"),
        ("FM-1", "2", "PASS"),
        ("FM-1", "cleanup 1", "PASS"),
        ("FM-2", "1", "PASS"),
        ("FM-2", "2", "FAIL"),
        ("FM-2", "cleanup 1", "PASS"),
    ]
    assert {row["procedure"] for row in rows} == {"SS-TP-07"}
