"""How many events of a session are stored, and which."""

import pytest

from drivers.chunk import LinkEvent
from gse.recording.session_format import MOST_KINDS, OTHER
from gse.station.events import MOST_EVENTS, MOST_OF_A_KIND, EventLog
from gse.values.instant import LAST_NS


def event(kind, utc_ns=1):
    return LinkEvent(utc_ns, 0, kind, "what happened")


def test_the_first_thousand_events_of_a_kind_are_stored():
    log = EventLog()
    assert [log.accepts(event("LOST")) for _ in range(1002)] == [True] * MOST_OF_A_KIND + [False] * 2
    assert log.accepts(event("REOPENED"))


def test_twenty_thousand_events_are_stored_in_all():
    log = EventLog()
    stored = sum(log.accepts(event(str(kind))) for _ in range(1000) for kind in range(21))
    assert stored == MOST_EVENTS == 20_000


def test_a_kind_beyond_the_most_is_another_one_and_those_before_keep_their_names():
    log = EventLog()
    for kind in range(MOST_KINDS):
        assert log.bounded(event(str(kind))).kind == str(kind)
        log.accepts(event(str(kind)))
    assert log.bounded(event("one more")) == event(OTHER)
    assert log.bounded(event("0")) == event("0")


@pytest.mark.parametrize(("utc_ns", "stored_ns"), [(-1, 0), (0, 0), (5, 5), (LAST_NS, LAST_NS), (2**70, LAST_NS)])
def test_an_instant_that_no_recording_holds_is_the_nearest_that_it_does(utc_ns, stored_ns):
    assert EventLog().bounded(event("LOST", utc_ns)) == event("LOST", stored_ns)
