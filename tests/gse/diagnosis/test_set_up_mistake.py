"""When a mistake of the set-up explains a session, and which rows it excuses."""

from dataclasses import replace

import pytest
from skies.known_nights import START_NS, STATION, session, unanswered
from skies.one_by_one import add_frame

from drivers.chunk import LinkEvent
from gse.config.station import BUILT_IN_TEXT
from gse.diagnosis.set_up_mistake import camera_mistake, lost_station, mistake_of
from gse.station.columns import ANSWER_CHECKS, STATUSES
from gse.station.events import Finding
from gse.station.results import AnswerCheck, Status, Subject
from gse.station.session_data import SessionData
from gse.statistics.counted_frames import counted_frames
from gse.statistics.decision import Outcome, Row, share_of
from gse.statistics.excuses import Evidence, Mistaken, excused
from gse.verdict.requirements import requirement_of


def mistake_in(made, *causes):
    return camera_mistake(made, counted_frames(made), tuple(Finding(cause, "") for cause in causes))


def blind(*kinds):
    made = SessionData(STATION, BUILT_IN_TEXT, "panorama-v1")
    for number in range(20):
        add_frame(made.frames, unanswered(number))
    made.events = [LinkEvent(START_NS, 0, kind, "") for kind in kinds]
    return made


@pytest.mark.parametrize(
    ("cause", "kinds", "is_mistake"),
    [
        ("mirrored image", ("MIRRORED",), True),
        ("focal length", ("WRONG_CAMERA",), True),
        ("detector size", ("WRONG_DETECTOR",), True),
        ("focal length", ("MIRRORED",), False),  # found by the errors of a session, not by the camera watch
        ("mirrored image", (), False),
        ("clock offset", ("MIRRORED",), False),
    ],
)
def test_a_camera_stated_wrongly_is_one_where_nothing_was_identified(cause, kinds, is_mistake):
    found = mistake_in(blind(*kinds), cause)
    assert (found is not None and found.cause == cause) == is_mistake


@pytest.mark.parametrize(("check", "is_mistake"), [(AnswerCheck.UNKNOWN, True), (AnswerCheck.ABSENT, False)])
def test_without_a_star_for_the_reference_identifier_either_nothing_tells_sky_and_station_from_the_sensor(
    check, is_mistake
):
    made = blind()
    made.frames.columns["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    made.frames.columns["answer_check"][3] = ANSWER_CHECKS.index(check)
    assert (mistake_in(made, "nothing identified") is not None) == is_mistake


EXTERNAL = replace(STATION.identifier, algorithm="external", command=("./onboard",))


@pytest.mark.parametrize(("known", "is_mistake"), [(0, True), (9, True), (10, False), (20, False)])
@pytest.mark.parametrize("check", [AnswerCheck.ABSENT, AnswerCheck.CORRECT])
def test_no_camera_excuses_an_external_program_where_the_reference_answers_with_the_one_that_is_stated(
    known, is_mistake, check
):
    made = session(20)
    made.events = [LinkEvent(START_NS, 0, "WRONG_CAMERA", "")]
    made.frames.columns["status"] = STATUSES.index(Status.NO_MATCH)
    made.frames.columns["objects"] = 20
    made.station = STATION.model_copy(update={"identifier": EXTERNAL})
    made.frames.columns["answer_check"] = ANSWER_CHECKS.index(AnswerCheck.UNKNOWN)
    made.frames.columns["answer_check"][:known] = ANSWER_CHECKS.index(check)
    assert (mistake_in(made, "focal length") is not None) == is_mistake
    made.station = STATION
    assert mistake_in(made, "focal length") is not None  # which a built-in one answers with


@pytest.mark.parametrize(("check", "is_mistake"), [(AnswerCheck.UNKNOWN, True), (AnswerCheck.CORRECT, False)])
def test_nor_do_stars_out_of_place_that_the_reference_knows(check, is_mistake):
    made = partly_seen(20)
    made.station = STATION.model_copy(update={"identifier": EXTERNAL})
    made.frames.columns["answer_check"] = ANSWER_CHECKS.index(check)
    assert (mistake_in(made, "distortion") is not None) == is_mistake


def test_a_camera_under_which_one_panorama_was_identified_is_none():
    made = session(1)
    made.events = [LinkEvent(START_NS, 0, "MIRRORED", "")]
    assert mistake_in(made, "mirrored image") is None


def row(name, unit, outcome=Outcome.FAIL, subject=Subject.ONBOARD):
    return Row(subject, name, 1.0, unit, 0.5, outcome, "it is too much")


def excused_by(cause, judged, is_kept=True):
    kept = frozenset({(judged.subject, judged.name)}) if is_kept else frozenset()
    available = {subject: share_of(0, 1) for subject in Subject}
    evidence = Evidence(session(1), available, (mistake_of(Finding(cause, "")),), kept)
    return excused(judged, requirement_of(judged).claim, evidence)


@pytest.mark.parametrize(
    ("cause", "judged", "is_excused"),
    [
        ("azimuth from south", row("mean |dDE|", "arcsec"), True),
        ("azimuth from south", row("mean |dDE|", "arcsec", subject=Subject.SENSOR), True),
        ("azimuth from south", row("mean |dDE|", "arcsec", Outcome.PASS), False),
        ("azimuth from south", row("availability", ""), True),  # answers that the turn alone makes false
        ("azimuth from south", row("identification time on this host, 99 %", "ms"), False),
        ("mirrored image", row("availability", ""), True),
        ("nothing identified", row("availability", ""), True),
        ("nothing identified", row("availability", "", subject=Subject.SENSOR), False),
        ("mirrored image", row("availability", "", subject=Subject.SENSOR), False),
        ("detector size", row("availability", ""), True),
        ("mirrored image", row("false answers", ""), True),
        ("focal length", row("mean |dDE|", "arcsec"), True),
        ("focal length", row("mean |dDE|", "arcsec", subject=Subject.SENSOR), False),
        ("focal length", row("identification time on this host, 99 %", "ms"), False),
    ],
)
def test_a_row_is_excused_where_the_mistake_made_it_fail(cause, judged, is_excused):
    found = excused_by(cause, judged)
    assert found.outcome is (Outcome.INCONCLUSIVE if is_excused else judged.outcome)
    assert found.reason == (f"it is too much: by the set-up ({cause})" if is_excused else "it is too much")


def test_a_mistake_of_place_and_an_obstruction_excuse_each_their_rows():
    turned, absent = row("mean |dDE|", "arcsec"), row("availability", "")
    mistakes = tuple(mistake_of(Finding(cause, "")) for cause in ("mount", "obstruction"))
    available = {subject: share_of(0, 1) for subject in Subject}
    evidence = Evidence(session(1), available, mistakes, frozenset({(turned.subject, turned.name)}))
    reasons = [excused(judged, requirement_of(judged).claim, evidence).reason for judged in (turned, absent)]
    assert reasons == ["it is too much: by the set-up (mount)", "it is too much: by the set-up (obstruction)"]


def partly_seen(identified, *, unmatched=13):
    """Of twenty frames so many are identified, each with twelve stars and objects that are none."""
    made = session(20)
    frames = made.frames.columns
    frames["status"][identified:] = STATUSES.index(Status.NO_MATCH)
    frames["matched"], frames["false_objects"] = 12, unmatched
    return made


@pytest.mark.parametrize("identified", [1, 20])
@pytest.mark.parametrize(
    ("causes", "unmatched", "mistake"),
    [
        (["distortion"], 13, "distortion"),
        (["mount", "principal point", "focal length"], 13, "principal point"),
        (["focal length"], 3, None),
        (["mount"], 13, None),
        ([], 13, None),
    ],
)
def test_a_camera_of_which_stars_fall_out_is_the_mistake_and_the_first_of_them(identified, causes, unmatched, mistake):
    made = partly_seen(identified, unmatched=unmatched)
    found = mistake_in(made, *causes)
    assert (found.cause if found else None) == mistake


def test_a_mistake_of_place_excuses_no_row_that_fails_without_it_too():
    judged = row("mean |dDE|", "arcsec")
    assert excused_by("azimuth from south", judged, is_kept=False) is judged


@pytest.mark.parametrize(("is_turn", "of"), [(False, Mistaken.CAMERA), (True, Mistaken.PLACE)])
def test_a_principal_point_that_only_turns_the_sky_excuses_what_a_turn_does(is_turn, of):
    assert mistake_of(Finding("principal point", ""), is_turn=is_turn).of is of
    assert mistake_of(Finding("detector size", ""), is_turn=is_turn).of is Mistaken.CAMERA


def test_a_session_that_lost_its_station_file_says_so():
    made = session(1)
    made.events = [LinkEvent(START_NS, 0, "NOTE", "a note"), LinkEvent(START_NS, 0, "NO_STATION", "it is gone")]
    found = lost_station(made)
    assert (found.cause, found.size, found.equals) == ("station file", "it is gone", ())
    assert found.next_step == "give the right one: gse report SESSION --station FILE"
    assert lost_station(session(1)) is None


@pytest.mark.parametrize(
    ("cause", "judged", "is_excused"),
    [
        ("station file", row("identification time on this host, 99 %", "ms"), True),
        ("station file", row("availability", "", subject=Subject.SENSOR), True),
        ("station file", row("availability", "", Outcome.PASS), False),
        ("distortion", row("availability", ""), True),
        ("distortion", row("mean |dDE|", "arcsec", subject=Subject.SENSOR), False),
        ("principal point", row("false answers", ""), True),
        ("refraction", row("mean |dDE|", "arcsec", subject=Subject.SENSOR), True),
        ("clock set to TAI", row("false answers", ""), True),
        ("clock set to TAI", row("availability", ""), True),
    ],
)
def test_a_lost_station_file_excuses_every_row_and_a_camera_those_of_the_identifier(cause, judged, is_excused):
    assert (excused_by(cause, judged).outcome is Outcome.INCONCLUSIVE) is is_excused
