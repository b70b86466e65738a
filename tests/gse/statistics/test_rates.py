"""Rates that a sensor states, against those by which the sky itself is seen to turn."""

from dataclasses import replace

import numpy as np
import pytest
from devices.items_sensor import LINES
from skies.synthetic_night import START_NS, synthetic_night

from gse.report.page import report_html
from gse.report.provenance import ResultKey, provenance
from gse.report.sessions_table import sessions_table
from gse.report.summary import summarise
from gse.station.housekeeping import ITEM, Housekeeping
from gse.station.session_data import SessionData
from gse.statistics.decision import Outcome
from gse.statistics.session_statistics import rate_errors
from gse.truth import EarthOrientation, SiderealTruth, horizon_to_sensor
from gse.values.mount import MountUncertainty
from gse.verdict.assessment import judge
from protocols import parse_protocol

TEXT = (
    LINES
    + """\
messages:
  RATE:
    code: RATE
    direction: from sensor
    items:
      - {name: rate_x, type: decimal, unit: deg/s}
      - {name: rate_y, type: decimal, unit: deg/s}
      - {name: rate_z, type: decimal, unit: deg/s}
"""
)
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
    noise = np.random.default_rng(2).normal(size=(100, 1))
    noise = 2.0 * (noise - noise.mean()) / noise.std()
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
    table = sessions_table(session, assessment, ResultKey("a" * 64, "b" * 64, "c" * 64))
    assert [rate["values"] for rate in table["rates"].to_pylist()[0]] == [100, 100, 100]


@pytest.mark.parametrize(
    ("limits", "outcomes"),
    [
        ({"rate_bias_arcsec_per_s": 5.0, "rate_noise_arcsec_per_s": 3.0}, (Outcome.PASS, Outcome.PASS)),
        ({"rate_bias_arcsec_per_s": 3.0, "rate_noise_arcsec_per_s": 1.5}, (Outcome.FAIL, Outcome.FAIL)),
        ({"rate_bias_arcsec_per_s": 4.01, "rate_noise_arcsec_per_s": 2.001}, (Outcome.INCONCLUSIVE,) * 2),
    ],
)
def test_the_axis_with_the_largest_bias_and_noise_decides(limits, outcomes) -> None:
    session = session_with(np.array([1.0, -4.0, 2.0]))
    session.station = session.station.model_copy(update={"limits": replace(session.station.limits, **limits)})
    rows = {row.name: row for row in judge(session).rows}
    bias, noise = rows["rate bias"], rows["rate noise"]
    assert (bias.outcome, noise.outcome) == outcomes
    assert (bias.value, noise.value) == pytest.approx((4.0, 2.01), abs=0.01)


def test_a_mount_that_is_hardly_known_leaves_the_bias_open() -> None:
    session = session_with(np.zeros(3))
    limits = replace(session.station.limits, rate_bias_arcsec_per_s=1.0)
    mount = session.station.mount
    session.station = session.station.model_copy(
        update={"limits": limits, "mount": replace(mount, uncertainty=MountUncertainty(roll_arcsec=72_000.0))}
    )
    (row,) = (row for row in judge(session).rows if row.name == "rate bias")
    assert row.outcome is Outcome.INCONCLUSIVE
    assert row.truth_uncertainty == pytest.approx(15.04 * np.radians(20) / 1.96, rel=0.2)


def test_a_sensor_that_states_no_rates_has_none() -> None:
    session = synthetic_night(5)
    assert rate_errors(session) == ()
    assert "rates" not in summarise(session, judge(session))
