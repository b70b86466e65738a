"""The glance page's facts: the big word, the errors of ten minutes, the turn of the mount, dawn, focus."""

import math
from dataclasses import replace

import numpy as np
import pytest
from astropy.coordinates import AltAz, EarthLocation, get_sun
from astropy.time import Time
from astropy.utils import iers
from hypothesis import given
from hypothesis import strategies as st
from skies.one_by_one import Made, result_of, results_of
from skies.synthetic_night import START_NS, synthetic_frames, synthetic_night

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading
from gse.station.events import StationKind
from gse.station.frame_results import FrameResult
from gse.station.results import Status
from gse.station.sky_condition import SUN_LIMIT_DEG
from gse.truth import horizon_to_sensor
from gse.values.attitude import Attitude
from gse.values.instant import NS_PER_S
from gse.values.mount import Mount
from gse.values.panorama import Panorama
from gse.view.blueprint import _reach
from gse.view.glance import Glance, NextDawn, focus_of, mount_turn, next_dawn_ns
from gse.view.glance_word import Facts, Level, Phase, word_of
from gse.view.live_state import EventLines, LiveState

ON = Facts(link="streaming", port="/dev/ttyUSB0", frames=100, objects=28, answered=True)


@pytest.mark.parametrize(
    ("facts", "text", "level"),
    [
        (Facts(port="/dev/ttyUSB0"), "WAITING", Level.IDLE),
        (replace(ON, answered=False, since_answer_s=3.0), "ACQUIRING", Level.IDLE),
        (replace(ON, answered=False, since_answer_s=12.0), "NO ANSWER 12 s", Level.BAD),
        (ON, "OK", Level.GOOD),
        (replace(ON, since_answer_s=12.0), "NO ANSWER 12 s", Level.BAD),
        (replace(ON, since_answer_s=119.0), "NO ANSWER 119 s", Level.BAD),
        (replace(ON, since_answer_s=120.0), "NO ANSWER 2 min", Level.BAD),
        (replace(ON, since_answer_s=400.0), "NO ANSWER 6 min", Level.BAD),
        (replace(ON, since_answer_s=7199.0), "NO ANSWER 119 min", Level.BAD),
        (replace(ON, since_answer_s=7200.0), "NO ANSWER 2 h", Level.BAD),
        (replace(ON, objects=None, since_answer_s=12.0), "NO ANSWER 12 s", Level.BAD),
        (replace(ON, since_answer_s=12.0, sky="CLOUD"), "CLOUD", Level.WARN),
        (replace(ON, since_answer_s=12.0, sky="DAYLIGHT"), "DAYLIGHT", Level.WARN),
        (replace(ON, link="no port", since_answer_s=12.0, sky="CLOUD"), "LINK LOST", Level.BAD),
        (replace(ON, link="silent"), "LINK LOST", Level.BAD),
        (replace(ON, since_answer_s=12.0, stands_still_for="step 2: Cap off."), "WAITING FOR YOU", Level.WARN),
        (replace(ON, phase=Phase.JUDGING, stands_still_for="step 2: Cap off."), "JUDGING", Level.IDLE),
        (replace(ON, aligning_s=40.0), "ACQUIRING", Level.IDLE),
        (replace(ON, outside=("mean |dDE| 70.0 arcsec (limit 60)",)), "OUTSIDE", Level.BAD),
        (replace(ON, phase=Phase.JUDGING, link="closed"), "JUDGING", Level.IDLE),
        (replace(ON, phase=Phase.ENDED, verdict="PASS", link="no port"), "DONE: PASS", Level.GOOD),
        (replace(ON, phase=Phase.ENDED, verdict="PASS, relative (SIMULATED)"), "DONE: PASS", Level.GOOD),
        (replace(ON, phase=Phase.ENDED, verdict="FAIL (SIMULATED)"), "DONE: FAIL", Level.BAD),
        (replace(ON, phase=Phase.ENDED, verdict="FAIL"), "DONE: FAIL", Level.BAD),
        (replace(ON, phase=Phase.ENDED, verdict="INCONCLUSIVE"), "DONE: INCONCLUSIVE", Level.WARN),
        (replace(ON, phase=Phase.ENDED), "ENDED", Level.WARN),
    ],
)
def test_the_word_says_what_is_most_wrong(facts: Facts, text: str, level: Level) -> None:
    word = word_of(facts)
    assert (word.text, word.level) == (text, level)


def test_a_panorama_that_does_not_come_is_told_from_one_without_an_answer() -> None:
    silent = replace(ON, since_answer_s=12.0, objects=1)
    assert word_of(silent).detail == "1 object"
    assert word_of(replace(silent, since_frame_s=12.0)).detail == "no panorama for 12 s"


def test_the_word_for_a_limit_names_it() -> None:
    assert word_of(replace(ON, outside=("mean |dDE| 70.0 arcsec (limit 60)",))).detail.endswith(
        "70.0 arcsec (limit 60)"
    )


def test_a_verdict_on_a_simulated_sky_says_so_below_the_word() -> None:
    ended = replace(ON, phase=Phase.ENDED, verdict="PASS, relative (SIMULATED)", reasons=("every limit is kept",))
    assert word_of(ended).detail == "PASS, relative (SIMULATED): every limit is kept"
    assert word_of(replace(ended, verdict="PASS")).detail == "every limit is kept"


@pytest.mark.parametrize(
    ("facts", "is_said"),
    [
        (Facts(link="syncing", cause="wrong baud rate"), True),
        (replace(ON, answered=False, since_answer_s=12.0, cause="the image is mirrored"), True),
        (replace(ON, since_answer_s=12.0, cause="the image is mirrored"), False),
        (replace(ON, outside=("mean |dDE| 70.0 arcsec (limit 60)",), cause="mount: it looks elsewhere"), True),
    ],
)
def test_the_line_below_the_word_says_the_cause_that_the_station_found(facts: Facts, is_said: bool) -> None:
    assert (facts.cause in word_of(facts).detail) is is_said


def clock_at(seconds: float) -> ClockReading:
    return ClockReading(START_NS + round(seconds * NS_PER_S), round(seconds * NS_PER_S), "test", True, 0.0, 0.001)


def test_a_session_at_a_glance_from_the_first_byte_to_the_verdict() -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    glance = Glance(live)

    def word(seconds: float) -> str:
        glance.absorb(clock_at(seconds))
        return glance.document(clock_at(seconds))["word"]["text"]

    assert word(0) == "WAITING"
    assert glance.document(clock_at(0))["since_answer_s"] is None
    live.on_event(LinkEvent(START_NS, 0, LinkKind.STREAMING, "valid frames come"))
    for frame in synthetic_frames(40, trouble=False):
        live.on_results(results_of([frame]), session)
    assert word(4) == "OK"
    document = glance.document(clock_at(4))
    assert document["frames"] == 40
    assert document["stars"]["objects"] == len(frame.panorama.brightness)
    assert document["axes"][0]["name"] == "dRA*"
    assert not document["axes"][0]["outside"]
    assert word(10) == "NO ANSWER 6 s"
    for kind in (LinkKind.LOST, LinkKind.NO_PORT):
        live.on_event(LinkEvent(START_NS, 0, kind, "the port is gone"))
    assert word(11) == "LINK LOST"
    assert sum("is gone" in line for line in glance.document(clock_at(11))["events"]) == 1
    glance.enter_judging()
    assert word(12) == "JUDGING"
    glance.conclude("PASS", ())
    assert word(13) == "DONE: PASS"
    assert glance.document(clock_at(13))["forecast"] == "PASS"
    assert glance.document(clock_at(13))["ended"]


def test_a_session_without_an_answer_has_no_last_one_to_its_end() -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    glance = Glance(live)
    for frame in synthetic_frames(40, trouble=False):
        live.on_results(results_of([replace(frame, status=Status.TOO_FEW, attitude=None)]), session)
    glance.absorb(clock_at(4))
    assert glance.document(clock_at(4))["since_answer_s"] is None
    glance.conclude("INCONCLUSIVE", ())
    assert glance.document(clock_at(5))["since_answer_s"] is None


@pytest.mark.parametrize(("url", "text"), [("sim://", "WAITING FOR YOU"), ("/dev/ttyUSB0", "WAITING")])
def test_a_question_stops_the_time_of_a_simulation_only(url: str, text: str) -> None:
    station = synthetic_night(20).station
    live = LiveState(station.model_copy(update={"port": station.port.model_copy(update={"url": url})}))
    live.question = "step 2: Take the cap off. [Enter when it is done, no if it cannot be]"
    word = Glance(live).document(clock_at(4))["word"]
    assert word["text"] == text
    assert word["detail"].endswith("answers step 2" if url == "sim://" else url)


def test_the_last_page_has_the_time_from_the_last_answer_to_the_last_frame() -> None:
    session = synthetic_night(20)
    live = LiveState(session.station)
    glance = Glance(live)
    for number, frame in enumerate(synthetic_frames(40, trouble=False)):
        lacks = {} if number <= 30 else {"status": Status.TOO_FEW, "attitude": None}
        live.on_results(results_of([replace(frame, **lacks)]), session)
    glance.absorb(clock_at(4))
    glance.conclude("INCONCLUSIVE", ())
    assert glance.document(clock_at(60))["since_answer_s"] == 0.9


DIRECTIONS = st.floats(0, 360, exclude_max=True)


@given(DIRECTIONS, st.floats(5, 75), DIRECTIONS, st.floats(-3, 3), st.floats(-3, 3), st.floats(-20, 20))
def test_a_mount_that_follows_the_arrow_looks_where_the_station_file_says(
    azimuth: float, altitude: float, roll: float, right: float, up: float, clockwise: float
) -> None:
    stated = Mount(azimuth_deg=azimuth, altitude_deg=altitude, roll_deg=roll)
    # Turned away along the horizon, then in altitude, then about the boresight: the arrow must point back.
    looks = Mount(
        azimuth_deg=azimuth - right / math.cos(math.radians(altitude)),
        altitude_deg=altitude - up,
        roll_deg=roll + clockwise,
    )
    turn = mount_turn(looking(looks, stated), stated, stated)
    assert turn is not None
    bends_deg = 0.35 + abs(right * math.tan(math.radians(altitude)))  # a parallel of altitude is no great circle
    assert turn.across.angle_deg == pytest.approx(right, abs=0.35)
    assert turn.up.angle_deg == pytest.approx(up, abs=bends_deg)
    assert turn.roll.angle_deg == pytest.approx(clockwise, abs=1.0 + bends_deg)


def looking(looks: Mount, true: Mount) -> FrameResult:
    """A result of a sensor that looks along ``looks``, with horizon axes for ICRS."""
    exact = np.zeros((3, 3))
    made = Made(
        Panorama(0, np.zeros((0, 2)), np.zeros(0)),
        Status.IDENTIFIED,
        "",
        "neighbour",
        attitude_geometric=Attitude(horizon_to_sensor(looks), exact),
        attitude_true=Attitude(horizon_to_sensor(true), exact),
    )
    return result_of(made)


def test_the_turn_is_told_in_the_words_of_one_who_stands_behind_the_sensor() -> None:
    south = Mount(azimuth_deg=180.0, altitude_deg=45.0)
    turn = mount_turn(looking(replace(south, azimuth_deg=181.0, altitude_deg=44.0), south), south, south)
    assert str(turn).startswith("0.707 deg left (to the east), 1.0")
    assert " deg up" in str(turn)
    zenith = Mount()
    turn = mount_turn(looking(Mount(azimuth_deg=90.0, altitude_deg=89.0, roll_deg=270.0), zenith), zenith, zenith)
    assert str(turn).startswith("1.00 deg west, 0.000 deg")


@pytest.mark.parametrize("latitude_deg", [-6.53, 48.0])
def test_dawn_is_where_astropy_has_the_sun_at_nautical_twilight(latitude_deg: float) -> None:
    site = replace(synthetic_night(1).station.site, latitude_deg=latitude_deg)
    dawn_ns = next_dawn_ns(site, START_NS)
    assert dawn_ns is not None
    with iers.conf.set_temp("auto_download", False):
        when = Time(dawn_ns / NS_PER_S, format="unix")
        place = EarthLocation.from_geodetic(site.longitude_deg, latitude_deg, site.height_m)
        sun = get_sun(when).transform_to(AltAz(obstime=when, location=place))
    assert sun.alt.deg == pytest.approx(SUN_LIMIT_DEG, abs=0.05)
    assert START_NS < dawn_ns < START_NS + 24 * 3600 * NS_PER_S


def test_there_is_no_dawn_in_polar_night() -> None:
    site = replace(synthetic_night(1).station.site, latitude_deg=85.0)
    winter_ns = START_NS - 90 * 86_400 * NS_PER_S
    assert next_dawn_ns(site, winter_ns) is None
    assert NextDawn(site).minutes(winter_ns) is None


def test_the_minutes_to_dawn_fall_and_are_those_to_the_next_one_after_it() -> None:
    site = synthetic_night(1).station.site
    dawn_ns, night_ns = next_dawn_ns(site, START_NS), 24 * 3600 * NS_PER_S
    assert dawn_ns is not None
    dawn = NextDawn(site)
    at_start = dawn.minutes(START_NS)
    assert at_start == (dawn_ns - START_NS) // (60 * NS_PER_S)
    assert dawn.minutes(START_NS + 600 * NS_PER_S) == at_start - 10
    assert dawn.minutes(dawn_ns + 60 * NS_PER_S) == 0  # it is bright
    assert dawn.minutes(START_NS + night_ns) == pytest.approx(at_start, abs=3)


def test_the_page_gets_angles_and_the_directions_of_positive_ones() -> None:
    stated = Mount(altitude_deg=40.0)
    turn = mount_turn(looking(replace(stated, altitude_deg=39.0), stated), stated, stated)
    assert turn is not None
    document = turn.document()
    assert (document["up_deg"], document["up"]) == (pytest.approx(1.0, abs=1e-4), "up")
    assert document["text"] == str(turn)


def test_the_histogram_counts_every_object() -> None:
    panorama = Panorama(0, np.zeros((5, 2)), np.array([4096.0, 4000.0, 60.0, 1.0, 0.0]))
    found = focus_of(panorama, 4096)
    assert found["objects"] == 5
    assert sum(found["histogram"]) == 5
    assert found["histogram"][0] == 2
    assert found["histogram"][-1] == 2


def test_repeated_events_are_one_line_with_a_count_and_each_note_is_its_own() -> None:
    lines = EventLines(frozenset({StationKind.NOTE}))
    for second in range(3):
        lines.add(LinkEvent(START_NS + second * NS_PER_S, 0, LinkKind.LOST, f"loss {second}"))
        lines.add(LinkEvent(START_NS + second * NS_PER_S, 0, StationKind.NOTE, f"note {second}"))
    assert [str(line) for line in lines.latest(9)] == [
        "18:30:02 NOTE: note 2",
        "18:30:02 LOST (3 x): loss 2",
        "18:30:01 NOTE: note 1",
        "18:30:00 NOTE: note 0",
    ]


@pytest.mark.parametrize("limit", [1.0, 5.0, 12.0, 20.0, 30.0, 60.0, 100.0, 600.0])
def test_the_axis_of_an_error_holds_its_limit_and_two_powers_of_ten_that_fit(limit: float) -> None:
    reach = _reach(limit)
    power = 10.0 ** math.floor(math.log10(reach))
    assert reach >= 1.2 * limit
    assert 95 / (2 * reach / power) >= 19.5, "rerun leaves out numbers that are nearer than 20 points"
