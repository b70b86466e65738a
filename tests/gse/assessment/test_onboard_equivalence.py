"""The sensor's own answers beside the onboard-equivalent ones."""

import pytest
from skies.known_nights import session

from gse.assessment.diagnosis import findings
from gse.assessment.statistics import statistics
from protocols import AttitudeMessage


def answer(made, first=0, until=None, *, off_arcsec=0.0, state="acquired"):
    rows = made.frames.columns
    for row in rows[first:until]:
        made.sensor_attitudes.append(
            int(row["utc_ns"]),
            AttitudeMessage(
                time_us=int(row["time_us"]),
                ra_deg=round(float(row["ra_deg"]), 6),
                de_deg=round(float(row["de_deg"]) + off_arcsec / 3600, 6),
                roll_deg=(float(row["roll_deg"]) + 360) % 360,
                frame_no=int(row["frame_no"]),
                state=state,
                latency_s=0.08,
            ),
        )


def test_a_sensor_that_answers_as_its_rebuilding_is_equivalent():
    made = session(100)
    answer(made)
    own = statistics(made).equivalence
    assert own.same
    assert (own.answers, own.both, own.only_sensor, own.only_station) == (100, 100, 0, 0)
    assert own.separation_arcsec.max < 0.01
    assert own.latency_ms.p50 == pytest.approx(80)
    assert findings(made, statistics(made)) == ()


def test_a_sensor_that_answers_otherwise_is_named():
    made = session(100)
    answer(made, until=50, off_arcsec=30.0)
    answer(made, 50, state="lost")
    own = statistics(made).equivalence
    assert not own.same
    assert (own.both, own.only_station) == (50, 50)
    assert own.separation_arcsec.p50 == pytest.approx(30, abs=0.01)
    assert "not the onboard-equivalent ones: of 100, 0 were answered only by the sensor and 50 only here" in "".join(
        map(str, findings(made, statistics(made)))
    )


def test_a_sensor_without_answers_of_its_own_is_not_compared():
    assert statistics(session(10)).equivalence is None
