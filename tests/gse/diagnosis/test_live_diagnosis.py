"""When a running session is looked at for causes, by the instants at which they are announced."""

import threading
from dataclasses import fields

import numpy as np
import pytest
from devices.patience import PATIENCE_S
from skies.known_nights import START_NS, session
from skies.one_by_one import Made, results_of

from gse.diagnosis.diagnosis import LiveDiagnosis
from gse.station.events import FindingEvent
from gse.station.results import Status
from gse.station.session_data import SessionData
from gse.values.instant import NS_PER_S
from gse.values.panorama import Panorama


def announced_after_s(times_s, fails_from_s=0.0):
    """The instants of findings in a session of panoramas at these times, of which none is identified any more."""
    made, told = session(60), []
    listener = LiveDiagnosis(told.append)
    for at_s in times_s:
        if at_s >= fails_from_s:
            made.frames.columns["status"] = list(Status).index(Status.NO_MATCH)
        panorama = Panorama(START_NS + round(at_s * NS_PER_S), np.empty((0, 2)), np.empty(0))
        listener.on_results(results_of([Made(panorama, Status.NO_MATCH, "", "neighbour")]), made)
    assert all(isinstance(event, FindingEvent) and event.mono_ns == 0 for event in told)
    return [(event.utc_ns - START_NS) / NS_PER_S for event in told]


@pytest.mark.parametrize(
    ("times_s", "announced"),
    [([0, 5, 9.9], []), ([0, 9.9, 10, 11, 30], [10]), ([0, 12, 13], [12]), ([0], [])],
)
def test_the_first_look_is_ten_seconds_after_the_first_panorama_and_a_finding_is_announced_once(times_s, announced):
    assert announced_after_s(times_s) == announced


@pytest.mark.parametrize(
    ("times_s", "fails_from_s", "announced"),
    [
        ([0, 10, 11, 19.9], 11, []),
        ([0, 10, 19.9, 20], 11, [20]),
        ([0, 10, 20, 39.9, 40], 30, [40]),
        ([0, 90, 119.9, 120], 100, [120]),
    ],
)
def test_the_next_look_is_after_20_s_or_a_third_of_the_time_so_far(times_s, fails_from_s, announced):
    assert announced_after_s(times_s, fails_from_s=fails_from_s) == announced


def test_a_copy_is_looked_at_in_another_thread_while_the_session_goes_on_and_told_with_the_next_results():
    made, told, lookers, begin = session(60), [], [], threading.Event()
    made.frames.columns["status"] = list(Status).index(Status.NO_MATCH)

    class Copy(SessionData):
        @property
        def events(self):
            begin.wait(PATIENCE_S)
            lookers.append(threading.current_thread())
            return []

        @events.setter
        def events(self, given):
            pass

    listener = LiveDiagnosis(told.append, lambda taken: Copy(**{f.name: getattr(taken, f.name) for f in fields(taken)}))
    for at_s in (0, 10, 20, 30):
        panorama = Panorama(START_NS + round(at_s * NS_PER_S), np.empty((0, 2)), np.empty(0))
        results = results_of([Made(panorama, Status.NO_MATCH, "", "neighbour")])
        listener.on_results(results, made)
    assert told == []
    begin.set()
    listener._thread.join(PATIENCE_S)
    assert threading.current_thread() not in lookers
    listener.on_results(results, made)
    assert [(event.utc_ns - START_NS) / NS_PER_S for event in told] == [10]
