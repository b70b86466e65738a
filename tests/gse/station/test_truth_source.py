"""Where the truth of an instant comes from: frozen, at hand, sought anew, or nowhere."""

import numpy as np
import pytest

from gse.station.loop import TruthSource
from gse.truth import EarthOrientation
from gse.values.instant import NS_PER_DAY, NS_PER_S, from_text
from gse.values.mount import InertialDirection
from gse.values.site import Site

SITE = Site(latitude_deg=48.0, longitude_deg=11.0)
NOW_NS = from_text("2026-03-20T18:30:00Z")
OTHER_NS = NOW_NS - 3000 * NS_PER_DAY
BEFORE_NS = from_text("1971-06-01T00:00:00Z")


def test_truth_is_sought_for_the_date_and_kept_while_it_reaches():
    source = TruthSource(SITE, None, None, None)
    assert not source.reaches(NOW_NS)
    truth, event = source.at(NOW_NS)
    assert truth is not None
    assert event is None
    at_hand = source.orientation
    assert source.reaches(NOW_NS + 60 * NS_PER_S)
    source.at(NOW_NS + 60 * NS_PER_S)
    assert source.orientation is at_hand


def test_after_a_step_beyond_its_reach_it_is_sought_again():
    source = TruthSource(SITE, None, None, None)
    source.at(NOW_NS)
    assert not source.reaches(OTHER_NS)
    _, event = source.at(OTHER_NS)
    assert event is None
    assert source.reaches(OTHER_NS)
    assert source.orientation == EarthOrientation.from_disk(OTHER_NS)


def test_a_frozen_orientation_stays_and_says_where_it_does_not_reach():
    frozen = EarthOrientation.from_disk(NOW_NS)
    source = TruthSource(SITE, None, frozen, None)
    truth, event = source.at(OTHER_NS)
    assert truth is not None
    assert event.kind == "EARTH_ORIENTATION"
    assert (event.utc_ns, event.mono_ns) == (OTHER_NS, 0)
    assert source.orientation is frozen


def test_a_date_before_the_tables_has_no_truth_and_an_event():
    source = TruthSource(SITE, None, None, None)
    truth, event = source.at(BEFORE_NS)
    assert truth is None
    assert (event.kind, event.utc_ns, event.mono_ns) == ("NO_TRUTH", BEFORE_NS, 0)
    assert "1971-06-01" in event.text
    assert not source.reaches(BEFORE_NS)


@pytest.mark.parametrize("utc_ns", [NOW_NS, BEFORE_NS])
def test_a_star_simulator_needs_no_earth(utc_ns):
    shown = InertialDirection(ra_deg=83.0, de_deg=-2.0, roll_deg=25.0)
    truth, event = TruthSource(SITE, shown, None, None).at(utc_ns)
    assert event is None
    assert truth.icrs_to_horizon(utc_ns)[2] == pytest.approx(
        [
            np.cos(np.radians(-2)) * np.cos(np.radians(83)),
            np.cos(np.radians(-2)) * np.sin(np.radians(83)),
            np.sin(np.radians(-2)),
        ]
    )


def test_before_all_tables_the_orientation_at_hand_does_not_reach():
    source = TruthSource(SITE, None, None, None)
    source.at(NOW_NS)
    assert source.reaches(NOW_NS) is True
    assert source.reaches(BEFORE_NS) is False


LATER_NS = from_text("2250-01-01T00:00:00Z")
"""Beyond all tables: the Earth's turn is only known to some seconds."""


def test_beyond_all_tables_the_orientation_at_hand_stays_and_without_one_the_last_is_taken():
    source = TruthSource(SITE, None, None, None)
    source.at(NOW_NS)
    at_hand = source.orientation
    truth, event = source.at(LATER_NS)
    assert source.orientation is at_hand
    assert truth.earth_orientation is at_hand
    assert (event.kind, event.utc_ns) == ("EARTH_ORIENTATION", LATER_NS)
    first = TruthSource(SITE, None, None, None)
    truth, event = first.at(LATER_NS)
    assert event.kind == "EARTH_ORIENTATION"
    assert truth.earth_orientation is first.orientation is not None
    assert first.orientation is not at_hand
