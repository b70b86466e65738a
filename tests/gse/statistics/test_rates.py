"""Rates that a sensor states, against those by which the sky itself is seen to turn."""

import numpy as np
import pytest
from skies.synthetic_night import START_NS, synthetic_night

from gse.report.page import report_html
from gse.report.provenance import provenance
from gse.report.summary import summarise
from gse.station.item_table import ITEM, Housekeeping
from gse.station.session_data import SessionData
from gse.statistics.rates import rate_errors
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor
from gse.verdict.assessment import judge
from protocols import parse_protocol

TEXT = """
version: 1
name: rates
byte_order: little
framing: {kind: line, separator: ","}
header: [{name: type, type: word}]
checksum: {name: none}
messages:
  RATE:
    code: RATE
    direction: from sensor
    items:
      - {name: rate_x, type: decimal, unit: deg/s}
      - {name: rate_y, type: decimal, unit: deg/s}
      - {name: rate_z, type: decimal, unit: deg/s}
"""
PROTOCOL = parse_protocol(TEXT, "rates.yaml")
SECOND_NS = 10**9


def seen_arcsec_per_s(session: SessionData) -> np.ndarray:
    """The turn of the sensor in its own frame, by its attitude at two instants."""
    truth = SiderealTruth(session.station.site, EarthOrientation.from_disk(START_NS))
    mount = horizon_to_sensor(session.station.mount)
    before, after = (mount @ truth.icrs_to_horizon(START_NS + at) for at in (0, 10 * SECOND_NS))
    turn = after @ before.T  # I - [w x] dt
    axis = np.array([turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]]) / 2
    return np.degrees(axis) * 3600 / 10


def session_with(bias_arcsec_per_s: np.ndarray) -> SessionData:
    session = synthetic_night(20)
    session.housekeeping = Housekeeping(PROTOCOL.items)
    rows = np.zeros(3 * 100, ITEM)
    rows["utc_ns"] = START_NS + np.repeat(np.arange(100), 3) * SECOND_NS
    rows["item"] = np.tile([0, 1, 2], 100)
    noise = np.tile([-2.0, 2.0], 50)[:, None]
    rows["value"] = ((seen_arcsec_per_s(session) + bias_arcsec_per_s + noise) / 3600).ravel()
    session.housekeeping.extend(rows)
    return session


def test_bias_and_noise_are_those_that_were_put_in() -> None:
    bias = np.array([1.0, -4.0, 30.0])
    found = rate_errors(session_with(bias))
    assert [of.axis for of in found] == ["x", "y", "z"]
    assert [of.bias_arcsec_per_s for of in found] == pytest.approx(bias.tolist(), abs=0.001)
    assert [of.noise_arcsec_per_s for of in found] == pytest.approx([2.0 * np.sqrt(100 / 99)] * 3)


def test_the_report_has_a_table_of_the_rates() -> None:
    session = session_with(np.zeros(3))
    assessment = judge(session)
    report = summarise(session, assessment)
    assert [rate["values"] for rate in report["rates"]] == [100, 100, 100]
    page = report_html(session, assessment, report, provenance(session.versions, None), plots=False)
    assert "Rates that the sensor states" in page


def test_a_sensor_that_states_no_rates_has_none() -> None:
    session = synthetic_night(5)
    assert rate_errors(session) == ()
    assert "rates" not in summarise(session, judge(session))
