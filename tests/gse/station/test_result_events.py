"""Events that results bring, each at its place among them: of the camera, a mirrored image, the sky, a program."""

from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, STATION
from skies.one_by_one import Made, add_frame, results_of

from drivers.chunk import LinkEvent
from gse.config.station import BUILT_IN_TEXT
from gse.external.answers import ExternalAnswer, Failure, FailureKind
from gse.external.identifier import ExternalCounts, Given
from gse.identifier import Answers, Identification, Reason, Unidentified
from gse.station.loop import ResultEvents
from gse.station.results import Status
from gse.station.session_data import SessionData
from gse.values.attitude import Attitude
from gse.values.instant import NS_PER_S
from gse.values.mount import InertialDirection, Mount
from gse.values.panorama import Panorama
from gse.verdict.assessment import _unknown_stars

FOUND = Identification(np.arange(0), np.arange(0), 1e-9)


ANSWER = ExternalAnswer(
    {}, Attitude.from_angles(1.0, 2.0, 3.0), True, "IDENTIFIED", "", np.arange(0), np.arange(0), None
)
"""One that names no star."""


class Camera:
    """A watch that has something to say of one result, and at the end."""

    def __init__(self, at=None, end=""):
        self._at, self._end = at, end

    def look(self, results):
        return [] if self._at is None else [(self._at, ("WRONG_CAMERA", "the focal length is another one"))]

    def finish(self):
        return ("WRONG_CAMERA", self._end) if self._end else None


class Sky:
    """A watch that has something to say at some rows, and at the end."""

    def __init__(self, *rows):
        self._rows = rows

    def take(self, frames, first):
        return [(row, [event("CLEAR"), event("CLOUDED")]) for row in self._rows if row >= first]

    def finish(self, frames):
        return [event("NO_STARS")]


def event(kind):
    return LinkEvent(START_NS, 0, kind, "")


def stored(count, session, *, reasons=(), failed=None):
    """Results of ``count`` panoramas, stored after those that the session has; none is answered for ``reasons``."""
    first, made = len(session.frames), []
    for number in range(first, first + count):
        panorama = Panorama(START_NS + number * NS_PER_S, np.empty((0, 2)), np.empty(0), number)
        made.append(Made(panorama, Status.NO_MATCH, "", "neighbour"))
        if failed is not None:
            fault = Failure(FailureKind.CRASH, "it ended") if number - first == failed else None
            made[-1] = replace(made[-1], given=Given(fault or ANSWER, 1.0))
        add_frame(session.frames, made[-1])
    answers = [dict(reasons).get(place, FOUND) for place in range(count)]
    return replace(results_of(made), answers=Answers.from_answers(answers))


@pytest.fixture
def session():
    return SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")


def test_events_stand_before_the_results_that_bring_them_in_their_order(session):
    stored(4, session)
    mirrored = Unidentified(Reason.MIRRORED, "once flipped, it fits")
    results = stored(5, session, reasons={3: mirrored, 2: Unidentified(Reason.NO_MATCH, "")}.items())
    found = ResultEvents(Sky(1, 4, 8), Camera(at=2)).brought_by(results, session, 4)
    assert [(place, one.kind) for place, one in found] == [
        (0, "CLEAR"),
        (0, "CLOUDED"),
        (2, "WRONG_CAMERA"),
        (3, "MIRRORED"),
        (4, "CLEAR"),
        (4, "CLOUDED"),
    ]
    assert [(one.utc_ns - START_NS) / NS_PER_S for _, one in found[2:4]] == [6.0, 7.0]
    assert [one.mono_ns for _, one in found] == [0] * 6
    assert [one.text for _, one in found[2:4]] == ["the focal length is another one", "once flipped, it fits"]


def test_failures_of_a_program_are_counted_and_told_with_their_frame(session):
    stored(2, session)
    results = stored(3, session, failed=1)
    ((place, told),) = ResultEvents(Sky(), Camera()).brought_by(results, session, 2)
    assert (place, told.kind, told.utc_ns) == (1, "IDENTIFIER_FAULT", START_NS + 3 * NS_PER_S)
    assert (told.text, told.mono_ns) == ("CRASH at frame 3: it ended", 0)
    assert (session.external_counts.answers, session.external_counts.failures["CRASH"]) == (2, 1)


def test_star_numbers_that_are_in_no_catalogue_are_counted_among_all_that_an_answer_gave():
    counts = ExternalCounts()
    counts.count(Given(replace(ANSWER, objects=np.arange(30), star_ids=np.arange(30))), 8)
    counts.count(Given(ANSWER), 0)
    assert (counts.stars_named, counts.stars_unknown, counts.answers) == (30, 22, 2)
    said = "22 of the 30 star numbers of its answers are in no catalogue"
    assert [said in line for line in _unknown_stars(counts)] == [True]
    assert list(_unknown_stars(ExternalCounts(stars_named=30))) == []


def test_a_program_that_is_given_up_is_told_once_with_the_first_frame_without_an_answer(session):
    given_up = Given(Failure(FailureKind.GIVEN_UP, "it failed too often"), 1.0)
    results = stored(3, session, failed=0)
    results = replace(results, given=dict.fromkeys(range(3), given_up))
    ((place, told),) = ResultEvents(Sky(), Camera()).brought_by(results, session, 0)
    assert (place, told.kind) == (0, "IDENTIFIER_GIVEN_UP")
    assert told.text == "no answer from frame 0 on: it failed too often"
    assert session.external_counts.failures["GIVEN_UP"] == 3
    more = stored(2, session, failed=0)
    more = replace(more, given=dict.fromkeys(range(2), given_up))
    assert list(ResultEvents(Sky(), Camera()).brought_by(more, session, 3)) == []


@pytest.mark.parametrize(("end", "kinds"), [("", ["NO_STARS"]), ("it is wrong", ["WRONG_CAMERA", "NO_STARS"])])
def test_at_the_end_the_camera_and_the_sky_have_their_say(session, end, kinds):
    stored(3, session)
    told = ResultEvents(Sky(), Camera(end=end)).finish(session)
    assert [one.kind for one in told] == kinds
    assert [(one.utc_ns, one.mono_ns, one.text) for one in told if one.kind == "WRONG_CAMERA"] == (
        [(START_NS + 2 * NS_PER_S, 0, end)] if end else []
    )


def test_before_a_star_simulator_there_is_no_sky(session):
    mount = Mount(inertial=InertialDirection(ra_deg=83.0, de_deg=0.0))
    shown = STATION.model_copy(update={"mount": mount})
    simulated = SessionData(shown, BUILT_IN_TEXT, "panorama-v1")
    for of, places in ((session, [0, 0]), (simulated, [])):
        results = stored(2, of)
        assert [place for place, _ in ResultEvents(Sky(0), Camera()).brought_by(results, of, 0)] == places
        assert len(ResultEvents(Sky(), Camera()).finish(of)) == len(places) // 2
