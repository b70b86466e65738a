"""A sensor before a star simulator: truth without a turning Earth."""

import itertools
import math

import numpy as np
import pytest

from drivers.chunk import Chunk
from drivers.clock import ClockReading
from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import ConfigError
from gse.report import summarise
from gse.station.loop import StationLoop
from gse.station.results import Verdict
from gse.station.setup import set_up
from gse.statistics.decision import Outcome
from gse.values.attitude import Attitude
from gse.values.instant import NS_PER_S, from_text
from gse.verdict.assessment import judge
from protocols import AttitudeMessage, PanoramaMessage

DAY_NS = from_text("2026-06-21T05:00:00Z")
"""High noon over the built-in site: a laboratory does not care."""
BYTE_NS = 10 * NS_PER_S // 115_200
STILL = "{ra_deg: 83.0, de_deg: -2.0, roll_deg: 25.0}"
MOVING = "{ra_deg: 83.0, de_deg: -2.0, roll_deg: 25.0, ra_rate_arcsec_per_s: 20.0, at: 2026-06-21T05:00:00Z}"
STARS = load_catalog(stars=4000)


def station_of(inertial):
    head, _, rest = BUILT_IN_TEXT.partition("mount:")
    text = f"{head}mount: {{inertial: {inertial}}}\nport:{rest.partition('port:')[2]}protocol: panorama-v1-subpixel\n"
    return parse_station(text), text


def session(inertial, *, count=320, rate=0.0, off_arcsec=0.0, own=False):
    """What a station makes of a scene that is ``off_arcsec`` north of the stated direction, and noise of 0.1 px."""
    station, text = station_of(inertial)
    setup = set_up(station, text, utc_ns=DAY_NS)
    loop = StationLoop(setup)
    loop.read_clock(ClockReading(DAY_NS, 0, "kernel PLL", True, 0.0, 0.01))
    random = np.random.default_rng(1)
    for number in range(count):
        utc_ns = DAY_NS + number * NS_PER_S // 4
        ra_deg, de_deg = 83.0 + rate * number / 4 / 3600, -2.0 + off_arcsec / 3600
        xy_px = setup.camera.pixels(STARS.icrs @ Attitude.from_angles(ra_deg, de_deg, 25.0).icrs_to_sensor.T)
        xy_px = xy_px[setup.camera.contains(xy_px)][:20]
        xy_px = np.clip(xy_px + random.normal(0, 0.1, xy_px.shape), 0, 1023)
        index = np.rint(np.linspace(4000, 200, len(xy_px)))
        messages = [PanoramaMessage(number * 250_000 + 10**6, number, 0.0, frozenset(), 20.0, xy_px, index)]
        if own:
            answer = np.array([ra_deg, de_deg, 25.0]) + random.normal(0, 2 / 3600, 3)
            messages.append(AttitudeMessage(number * 250_000 + 10**6, *answer, number, 20, "acquired", 0.03))
        numbers = itertools.count(number * len(messages))
        data = b"".join(setup.protocol.encode(message, next(numbers)) for message in messages)
        loop.take([Chunk(utc_ns + BYTE_NS, utc_ns + BYTE_NS - DAY_NS + NS_PER_S, data)])
    loop.finish()
    return loop.session


def test_a_still_scene_passes_by_day_and_its_budget_has_no_term_of_the_sky():
    made = session(STILL, own=True)
    assessment = judge(made)
    assert assessment.verdict is Verdict.PASS, assessment.reasons
    assert {term.name for term in assessment.budget.terms} == {"shown direction", "shown roll"}
    for subject in assessment.statistics.subjects.values():
        assert abs(subject.axes["d_ra_cosde"].bias_arcsec) < 0.5
        assert abs(subject.axes["d_de"].bias_arcsec) < 0.5
        assert math.isnan(subject.earth_rate.expected_arcsec_per_s)  # no Earth turns before it
    assert assessment.budget.axes["d_de"].expanded_arcsec == pytest.approx(10, abs=1.5)
    report = summarise(made, assessment)
    assert report["session"]["mount"]["inertial"]["ra_deg"] == 83.0
    assert not report["findings"]
    assert "planet" not in str(made.events)


def test_a_scene_that_moves_is_followed_at_its_stated_rate():
    assessment = judge(session(MOVING, rate=20.0))
    assert assessment.verdict is Verdict.PASS, assessment.reasons
    assert abs(assessment.statistics.onboard.axes["d_ra_cosde"].drift_arcsec_per_h) < 60
    clock = next(term for term in assessment.budget.terms if term.name == "clock")
    assert clock.ra_arcsec == pytest.approx(20 * 0.01 / 3**0.5, rel=0.01)


def test_a_direction_that_is_another_than_stated_fails():
    assessment = judge(session(STILL, off_arcsec=120.0))
    rows = {row.name: row for row in assessment.rows}
    assert rows["mean |dDE|"].outcome is Outcome.FAIL
    assert rows["mean |dDE|"].value == pytest.approx(120, abs=0.5)
    assert rows["mean |dRA*|"].outcome is Outcome.PASS


@pytest.mark.parametrize(
    ("inertial", "words"),
    [
        ("{ra_deg: 83.0}", "mount.inertial.de_deg is missing"),
        ("{ra_deg: 400, de_deg: 0}", "mount.inertial.ra_deg is 400"),
        ("{ra_deg: 1, de_deg: 0, ra_rate_arcsec_per_s: 15}", "a rate without the instant of the angles"),
        ("{ra_deg: 1, de_deg: 0, at: noon}", "'noon' is not a UTC instant"),
        ("{ra_deg: 1, de_deg: 0, at: 2026-06-21T05:00:00}", "is not a UTC instant"),
        ("{ra_deg: 1, de_deg: 0}, azimuth_deg: 10", "inertial stands alone"),
        ("{ra_deg: 1, de_deg: 0}, align: first 60 s", "inertial stands alone"),
        ("{ra_deg: 1, de_deg: 0, dec_deg: 1}", "unknown key mount.inertial.dec_deg; did you mean de_deg?"),
    ],
)
def test_a_direction_that_is_none_is_named_with_its_line(inertial, words):
    with pytest.raises(ConfigError, match="line") as refused:
        station_of(inertial)
    assert words in str(refused.value)
