"""Housekeeping in report, rows of the verdict, tables and kept results."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from devices.items_sensor import ITEMS, ITEMS_TEXT
from skies.synthetic_night import synthetic_night

from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import UsageError
from gse.report.page import report_html
from gse.report.parquet import write_parquet
from gse.report.provenance import provenance
from gse.report.summary import summarise
from gse.report.tables import housekeeping_parts
from gse.sessions.kept_results import KeptContext
from gse.station.housekeeping import ITEM, Housekeeping, parameter_differences
from gse.station.session_data import SessionData
from gse.station.setup import addressed
from gse.statistics.decision import Outcome
from gse.values.limits import Limits
from gse.verdict.assessment import judge
from gse.verdict.obstacles import obstacles
from protocols import DescriptionError, parse_protocol


def session_with(volts: list[float], **limits: object) -> SessionData:
    """A good night whose sensor sends HEALTH with these supply voltages, one a second."""
    session = synthetic_night(1)
    session.housekeeping = Housekeeping(ITEMS.items)
    rows = np.zeros(2 * len(volts), ITEM)
    rows["utc_ns"] = np.repeat(int(session.frames.columns["utc_ns"][0]) + np.arange(len(volts)) * 10**9, 2)
    rows["item"] = np.tile([list(ITEMS.items).index("supply_v"), list(ITEMS.items).index("mode")], len(volts))
    rows["value"] = np.ravel([(value, 3) for value in volts])
    rows["colour"] = np.ravel([(ITEMS.items["supply_v"].colour(value), 0) for value in volts])
    session.housekeeping.extend(rows)
    session.station = session.station.model_copy(update={"limits": replace(session.station.limits, items=limits)})
    return session


@pytest.mark.parametrize(
    ("limits", "outcomes"),
    [
        ({"supply_v": (4.9, 5.2)}, {"supply_v, lowest": "PASS", "supply_v, highest": "PASS"}),
        ({"supply_v": (4.9, 5.05)}, {"supply_v, lowest": "PASS", "supply_v, highest": "FAIL"}),
        ({"supply_v": (None, 5.05)}, {"supply_v, highest": "FAIL"}),
        ({"detector_degc": (None, 60.0)}, {"detector_degc, highest": "INCONCLUSIVE"}),
        ({}, {}),
    ],
    ids=str,
)
def test_limits_of_items_are_rows_of_the_verdict(limits: dict[str, object], outcomes: dict[str, str]) -> None:
    rows = judge(session_with([5.0, 4.95, 5.1], **limits)).rows
    assert {row.name: row.outcome.value for row in rows if row.name.endswith(("lowest", "highest"))} == outcomes


def test_a_row_of_an_item_says_its_worst_value_and_decides_the_session() -> None:
    assessment = judge(session_with([5.0, 4.95, 5.3], supply_v=(4.9, 5.2)))
    row = next(row for row in assessment.rows if row.name == "supply_v, highest")
    assert row.outcome is Outcome.FAIL
    assert (row.name, row.value, row.unit, row.limit) == ("supply_v, highest", 5.3, "V", 5.2)
    assert assessment.verdict == "FAIL"
    assert "supply_v is 5.3 V, its highest value, the limit is 5.2 V" in assessment.reasons


def test_the_report_lists_the_items_and_draws_them() -> None:
    session = session_with([5.0, 4.95, 5.3])
    assessment = judge(session)
    report = summarise(session, assessment)
    assert report["housekeeping"] == [
        {
            "item": "mode",
            "message": "HEALTH",
            "unit": "",
            "values": 3,
            "first": "tracking",
            "last": "tracking",
            "yellow": None,
            "red": None,
            "values_green": 0,
            "values_yellow": 0,
            "values_red": 0,
        },
        {
            "item": "supply_v",
            "message": "HEALTH",
            "unit": "V",
            "values": 3,
            "first": 5.0,
            "lowest": 4.95,
            "highest": 5.3,
            "last": 5.3,
            "yellow": [4.9, 5.1],
            "red": [4.75, 5.25],
            "values_green": 2,
            "values_yellow": 0,
            "values_red": 1,
        },
    ]
    page = report_html(session, assessment, report, provenance(session.versions, None), plots=True)
    assert "<th>supply_v, V</th>" in page
    assert "Items of the sensor&#39;s housekeeping against time" in page


def test_the_table_of_housekeeping_has_each_value_with_its_colour(tmp_path: Path) -> None:
    path = tmp_path / "housekeeping.parquet"
    write_parquet(housekeeping_parts(session_with([5.0, 5.3]), "0" * 64), path)
    rows = pq.read_table(path).drop_columns(["key", "utc"]).to_pylist()
    assert rows == [
        {"item": "supply_v", "value": 5.0, "word": None, "unit": "V", "colour": "green"},
        {"item": "mode", "value": 3.0, "word": "tracking", "unit": None, "colour": None},
        {"item": "supply_v", "value": 5.3, "word": None, "unit": "V", "colour": "red"},
        {"item": "mode", "value": 3.0, "word": "tracking", "unit": None, "colour": None},
    ]


def test_kept_results_give_the_same_items_again() -> None:
    session = session_with([5.0, 5.3])
    context = KeptContext.model_validate_json(KeptContext.from_session(session).model_dump_json())
    assert context.items == {item.name: item for item in session.housekeeping.items}
    assert context.item_summaries == session.housekeeping.summaries


def test_limits_of_an_item_that_is_not_there_are_refused() -> None:
    station = parse_station(BUILT_IN_TEXT + "\nlimits: {items: {suply_v: [4.8, 5.2]}}\n")
    with pytest.raises(UsageError, match=r"limits.items of the station file: no item 'suply_v'; did you mean\b"):
        addressed(ITEMS, station)


@pytest.mark.parametrize(("ends", "said"), [("[5, 4]", "swap them"), ("[null, null]", "both ends are open")])
def test_limits_of_an_item_that_cannot_be_are_refused(ends: str, said: str) -> None:
    with pytest.raises(Exception, match=said):
        parse_station(BUILT_IN_TEXT + f"\nlimits: {{items: {{supply_v: {ends}}}}}\n")
    assert Limits().items == {}


PARAMETERS = parse_protocol(
    ITEMS_TEXT.replace("  HEALTH_REQUEST:", "  READ:").replace("commands:\n", "parameters: READ\ncommands:\n", 1),
    "p.yaml",
)
HASHED = hashlib.sha256(b"mode tracking\nsupply_v 5.0 V\n").hexdigest()


def with_parameters(volts: list[float], **test: object) -> SessionData:
    session = session_with(volts)
    rows, summaries = session.housekeeping.rows.rows(), session.housekeeping.summaries
    session.housekeeping = Housekeeping.restored(PARAMETERS.items, PARAMETERS.parameters, summaries, 1, rows)
    session.station = session.station.model_copy(
        update={"test": session.station.test.model_copy(update=test)}  # as a station file states it
    )
    return session


@pytest.mark.parametrize(
    ("volts", "test", "said"),
    [
        ([5.0], {"parameters_sha256": HASHED.upper()}, []),
        ([5.0], {"parameters": {"supply_v": 5.0, "mode": "tracking"}}, []),
        ([5.0], {"parameters_sha256": "0" * 64}, [f"the SHA-256 of the parameters is {HASHED}"]),
        ([5.0], {"parameters": {"supply_v": 4.0}}, ["the parameter supply_v is 5, test.parameters states 4"]),
        ([5.0], {"parameters": {"gain": 4.0}}, ["the parameter gain is missing"]),
        ([4.9, 5.0], {}, ["the parameter supply_v changed in the session, from 4.9 to 5"]),
    ],
    ids=lambda of: str(of)[:40],
)
def test_parameters_that_are_not_those_stated_forbid_a_pass(
    volts: list[float], test: dict[str, object], said: list[str]
) -> None:
    session = with_parameters(volts, **test)
    found = list(parameter_differences(session.housekeeping, session.station.test))
    assert len(found) == len(said)
    assert all(line.startswith(words) for line, words in zip(found, said, strict=True))
    assert set(found) <= set(obstacles(session, judge(session).statistics, ()))
    assert summarise(session, judge(session))["parameters"]["sha256"] == HASHED


def test_parameters_that_never_came_forbid_a_pass_where_they_are_stated() -> None:
    session = with_parameters([5.0], parameters_sha256=HASHED)
    session.housekeeping = Housekeeping(PARAMETERS.items, PARAMETERS.parameters)
    assert "never came" in next(parameter_differences(session.housekeeping, session.station.test))


def test_a_command_that_reads_no_parameters_back_is_refused() -> None:
    text = ITEMS_TEXT.replace("commands:\n", "parameters: STOP\ncommands:\n", 1)
    with pytest.raises(DescriptionError, match="parameters: the answer to STOP is no message with items"):
        parse_protocol(text, "p.yaml")
