"""A sensor that sends its own answers and no panoramas: the only subject of its session."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from skies.known_nights import START_NS, TABLE, TRUTH

from drivers.chunk import Chunk
from drivers.clock import ClockReading
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.report import summarise
from gse.report.files import frames_csv
from gse.station.columns import FRAME
from gse.station.loop import StationLoop
from gse.station.own_answers import (
    OwnAnswerProcessor,
    OwnAnswerTruth,
    field_of,
    measured_rotations,
    panoramas_of,
)
from gse.station.reception import Reception
from gse.station.results import OwnAnswer, Status, Subject, Verdict, attitude_errors
from gse.station.session_tables import OWN_ANSWER, QUATERNION
from gse.station.setup import set_up
from gse.statistics.decision import Outcome
from gse.truth.frames import icrs_to_frame
from gse.values.attitude import Attitude
from gse.values.attitude_convention import AttitudeConvention, state_angles, state_quaternions
from gse.values.camera import Camera
from gse.values.instant import NS_PER_S
from gse.verdict.assessment import judge
from protocols import AttitudeMessage, parse_protocol

QUATERNIONS_ONLY = """
version: 1
name: quaternions
byte_order: little
framing: {kind: slip}
header: [{name: type, type: u8}]
checksum: {name: crc32}
messages:
  ATTITUDE:
    code: 3
    direction: from sensor
    fields:
      - {name: time, type: u64, unit: us}
      - {name: frame_no, type: u32}
      - {name: q1, type: f64}
      - {name: q2, type: f64}
      - {name: q3, type: f64}
      - {name: q4, type: f64}
      - {name: matched, type: u8}
      - {name: state, type: u8, values: {0: lost, 1: acquired}}
      - {name: latency, type: u32, unit: us}
"""
SCALAR_FIRST = AttitudeConvention(scalar="first", conjugate=True, body_axes="-y x z")
TEXT = BUILT_IN_TEXT.replace("sensor:\n", "sensor:\n  attitude: {scalar: first, conjugate: true, body_axes: -y x z}\n")
STATION = parse_station(TEXT)
PROCESSING_S = 0.08
BYTE_NS = 10 * NS_PER_S // 115_200


def rotations(utc_ns, seed=1, noise_arcsec=5.0):
    """What a sensor with white noise on the built-in mount answers: catalogue places, as it sees them."""
    small = np.random.default_rng(seed).normal(0, noise_arcsec / 206_265, (len(utc_ns), 3))
    x, y, z = small.T
    one = np.ones(len(utc_ns))
    turns = np.array([[one, -z, y], [z, one, -x], [-y, x, one]]).transpose(2, 0, 1)
    return turns @ OwnAnswerTruth(TRUTH, STATION.mount).expected(utc_ns)


def night(count, *, lost=()):
    """The session of a sensor whose processing takes 80 ms, and which is lost in some frames."""
    setup = set_up(STATION, TEXT, utc_ns=START_NS, protocol=parse_protocol(QUATERNIONS_ONLY, "quaternions.yaml"))
    loop = StationLoop(setup, earth_orientation=TABLE)
    loop.read_clock(ClockReading(START_NS, 0, "kernel PLL", True, 0.0, 0.01))
    utc_ns = START_NS + np.arange(count) * (NS_PER_S // 5)
    numbers = state_quaternions(rotations(utc_ns), SCALAR_FIRST)
    for number, (instant_ns, quaternion) in enumerate(zip(utc_ns.tolist(), numbers.tolist(), strict=True)):
        message = AttitudeMessage(
            (instant_ns - START_NS) // 1000 + 5_000_000,
            frame_no=number,
            matched=14,
            state="lost" if number in lost else "acquired",
            latency_s=PROCESSING_S,
            **dict(zip(("q1", "q2", "q3", "q4"), quaternion, strict=True)),
        )
        read_ns = instant_ns + round(PROCESSING_S * NS_PER_S) + BYTE_NS
        loop.take([Chunk(read_ns, read_ns - START_NS + NS_PER_S, setup.protocol.encode(message, 0))])
    loop.finish()
    return loop.session


@pytest.fixture(scope="module")
def session():
    return night(1500, lost=range(700, 710))


def test_the_sensor_is_the_only_subject_and_is_judged(session):
    assessment = judge(session)
    assert session.subject is Subject.SENSOR
    assert {row.subject for row in assessment.rows} == {Subject.SENSOR}
    rows = {row.name: row.outcome for row in assessment.rows}
    assert rows["mean |dRA*|"] is rows["95 % of |dDE|"] is rows["availability"] is Outcome.PASS
    assert rows["processing time as it states, 99 %"] is Outcome.PASS
    assert "onboard: no panoramas came" in " ".join(assessment.not_tested)
    assert assessment.verdict is Verdict.PASS, assessment.reasons


def test_its_errors_are_its_noise(session):
    axes = judge(session).statistics.subjects[Subject.SENSOR].axes
    for axis in ("d_ra_cosde", "d_de"):
        assert abs(axes[axis].bias_arcsec) < 0.6
        assert axes[axis].std_arcsec == pytest.approx(5.0, abs=0.5)


def test_an_answer_that_the_sensor_calls_lost_is_none(session):
    statuses = [str(Status.IDENTIFIED)] * 1500
    assert judge(session).statistics.statuses[statuses[0]] == 1490


def test_its_report_names_the_sensor_alone(session):
    report = summarise(session, judge(session))
    assert list(report["accuracy"]) == ["sensor"]
    assert report["timing"]["subjects"]["sensor"]["arrival_ms"]["p50"] == pytest.approx(80.1, abs=0.1)
    head = next(iter(frames_csv(session.frames.columns, None, session.subject)))
    assert "sensor_d_ra_cosde_arcsec" in head
    assert "onboard" not in head


@pytest.mark.parametrize("aberration", ["corrected", "not corrected"])
@pytest.mark.parametrize("frame", ["ICRS", "J2000", "date"])
def test_what_is_stated_in_a_convention_is_read_by_it(frame, aberration):
    utc_ns = START_NS + np.arange(3) * NS_PER_S
    convention = AttitudeConvention(frame=frame, aberration=aberration, ra_unit="h", roll_through="west")
    true = OwnAnswerTruth(TRUTH, STATION.mount, aberration == "corrected").expected(utc_ns)
    sent = state_angles(true @ icrs_to_frame(frame, utc_ns).transpose(0, 2, 1), convention)
    answers = np.zeros(3, dtype=OWN_ANSWER)
    answers["ra_deg"], answers["de_deg"], answers["roll_deg"] = sent.T
    read = measured_rotations(answers, utc_ns, convention)
    assert np.abs(attitude_errors(read, true)).max() < 1e-4


def test_aberration_moves_an_answer_by_what_astronomy_says():
    utc_ns = np.array([START_NS + 30 * NS_PER_S])
    one, other = (OwnAnswerTruth(TRUTH, STATION.mount, corrected).expected(utc_ns) for corrected in (True, False))
    x, y = attitude_errors(one, other)[0, 3:]
    boresight = TRUTH.attitude_true(int(utc_ns[0]), STATION.mount).boresight_icrs
    apparent = TRUTH.apparent(boresight[None], int(utc_ns[0]))[0]
    assert np.hypot(x, y) == pytest.approx(np.degrees(np.linalg.norm(apparent - boresight)) * 3600, abs=0.005)
    assert 1 < np.hypot(x, y) < 21


def test_a_description_without_a_direction_is_refused():
    text = "\n".join(line for line in QUATERNIONS_ONLY.splitlines() if "q3" not in line)
    with pytest.raises(Exception, match="no direction: expected ra and de, or q1, q2, q3, q4"):
        parse_protocol(text, "own.yaml")


def test_answers_of_a_capture_go_on_from_the_latest_where_the_sensor_starts_anew():
    """The host's times mean nothing there."""
    protocol = parse_protocol(QUATERNIONS_ONLY, "quaternions")
    reception = Reception(protocol, baudrate=115_200, anchor_utc_ns=START_NS)
    tags_s = [100.0, 101.0, 102.0, 1.0, 2.0]
    data = b"".join(
        protocol.encode(
            AttitudeMessage(
                round(tag_s * 1e6), q1=0.0, q2=0.0, q3=0.0, q4=1.0, frame_no=number, state="acquired", latency_s=0.0
            ),
            sequence=0,
        )
        for number, tag_s in enumerate(tags_s)
    )
    answers = [
        item for item in reception.receive(reception.stream.feed(Chunk(0, 0, data))) if isinstance(item, OwnAnswer)
    ]
    assert [(answer.utc_ns - START_NS) / NS_PER_S for answer in answers] == [0.0, 1.0, 2.0, 2.0, 3.0]
    assert {answer.host_utc_ns for answer in answers} == {0}


def test_over_a_field_that_is_low_the_mean_of_what_air_bends_is_expected():
    """14 deg at 22 deg: half of the bend's second derivative, 2 x 58 arcsec tan z / cos z^2, times the mean square."""
    low = replace(STATION.mount, azimuth_deg=200.0, altitude_deg=22.0)
    utc_ns, camera = np.array([START_NS]), STATION.sensor.camera()
    narrow, wide = OwnAnswerTruth(TRUTH, low), OwnAnswerTruth(TRUTH, low, field_sensor=field_of(camera))
    x, y = attitude_errors(wide.expected(utc_ns), narrow.expected(utc_ns))[0, 3:]
    zenith_rad, half = np.radians(68.0), 512 / camera.focal_length_px
    assert np.hypot(x, y) == pytest.approx(58 * np.tan(zenith_rad) / np.cos(zenith_rad) ** 2 * half**2 / 3, rel=0.3)
    assert narrow.uneven_arcsec(START_NS) == 0
    assert wide.uneven_arcsec(START_NS) == pytest.approx(58 / np.cos(zenith_rad) ** 2 * half / 3**0.5, rel=0.3)


def test_at_the_zenith_a_field_expects_what_its_middle_does():
    utc_ns, field_sensor = np.array([START_NS]), field_of(STATION.sensor.camera())
    narrow, wide = OwnAnswerTruth(TRUTH, STATION.mount), OwnAnswerTruth(TRUTH, STATION.mount, field_sensor=field_sensor)
    assert attitude_errors(wide.expected(utc_ns), narrow.expected(utc_ns))[0] == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize(
    ("problems", "state", "status", "detail"),
    [
        ((), "tracking", Status.NO_MATCH, "the sensor says tracking"),
        ((), "", Status.NO_MATCH, "the sensor says nothing"),
        (("ra is nan: no number of ordinary size", "another"), "acquired", Status.SENSOR_FAULT, "ra is nan"),
    ],
)
def test_an_answer_that_cannot_be_is_a_fault_of_the_sensor_and_one_that_it_does_not_give_is_none(
    problems, state, status, detail
):
    message = AttitudeMessage(7, *[np.nan] * 3, frame_no=3, matched=0, state=state, latency_s=0.1, problems=problems)
    processor = OwnAnswerProcessor(AttitudeConvention(), STATION.sensor.camera())
    answer = OwnAnswer(message, START_NS + 5, START_NS, 9)
    (result,) = processor.results(OwnAnswerProcessor.panorama(answer), message, None, None)
    assert result.status is status
    assert result.detail.startswith(detail)
    assert result.attitude is None
    assert result.elapsed_us == 100_000.0


# The parts of it, by hand


class FixedSky:
    """A sky that does not turn, over a sensor that looks along the pole; air and aberration are what a test makes them.

    Sensor, ICRS and horizon axes differ by a permutation, so that the zenith stands along ``up``.
    """

    def __init__(self, up=(0.0, 0.0, 1.0), *, air=lambda seen: seen, aberration=lambda stars: stars):
        self._up, self._air, self._aberration = np.array(up), air, aberration
        self.asked_ns, self.shown = [], []

    def attitude_true(self, utc_ns, mount):
        self.asked_ns.append(utc_ns)
        return Attitude(np.eye(3), np.zeros((3, 3)))

    def icrs_to_horizon(self, utc_ns):
        return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], self._up])

    def unrefracted(self, seen, zenith_sensor):
        assert zenith_sensor.tolist() == self._up.tolist()
        self.shown.append(seen)
        return self._air(seen)

    def apparent(self, stars, utc_ns):
        return self._aberration(stars)


def units(*vectors):
    made = np.array(vectors, dtype=float)
    return made / np.linalg.norm(made, axis=1)[:, None]


def test_a_field_is_nine_by_nine_directions_in_the_middle_of_its_parts():
    """A detector of 90 columns and 180 rows has parts of 10 by 20 pixels; pixel 0 begins at -0.5."""
    camera = Camera(180, 90, 500.0, (44.5, 89.5))
    places = camera.pixels(field_of(camera))
    x, y = np.arange(4.5, 90, 10), np.arange(9.5, 180, 20)
    assert places == pytest.approx(np.array([(column, row) for row in y for column in x]), abs=1e-9)
    assert len(places) == 81


def test_a_row_is_read_by_its_angles_or_else_by_its_quaternion_each_in_its_place():
    utc_ns = START_NS + np.arange(4) * NS_PER_S
    convention = AttitudeConvention()
    true = OwnAnswerTruth(TRUTH, STATION.mount).expected(utc_ns)
    answers = np.zeros(4, dtype=OWN_ANSWER)
    for name in ("ra_deg", "de_deg", "roll_deg", "q1", "q2", "q3", "q4"):
        answers[name] = np.nan
    angles, quaternions = state_angles(true, convention), state_quaternions(true, convention)
    for row in (0, 3):
        answers["ra_deg"][row], answers["de_deg"][row], answers["roll_deg"][row] = angles[row]
    for row in (1, 2):
        for place, name in enumerate(("q1", "q2", "q3", "q4")):
            answers[name][row] = quaternions[row, place]
    answers["q1"][0], answers["ra_deg"][1], answers["roll_deg"][2] = 0.5, 10.0, 30.0  # half of the other is none
    read = measured_rotations(answers, utc_ns, convention)
    assert np.abs(attitude_errors(read, true)).max() < 1e-4


def test_an_answer_of_ra_and_de_alone_is_read_with_a_roll_of_zero():
    answers = np.full(1, np.nan, dtype=[(name, "f8") for name in ("ra_deg", "de_deg", "roll_deg", *QUATERNION)])
    answers["ra_deg"], answers["de_deg"] = 120.0, -35.0
    (read,) = measured_rotations(answers, np.array([START_NS]), AttitudeConvention())
    assert read == pytest.approx(Attitude.from_angles(120.0, -35.0, 0.0).icrs_to_sensor, abs=1e-12)


NEAR = units([0, 0, 1], [1e-3, 0, 1], [0, 1e-3, 1])
"""What stands for a small field: its middle and two directions a milliradian beside it."""


@pytest.mark.parametrize(
    ("sines", "used"),
    [
        ([0.3, 0.2, 0.1, 0.06], [0, 1, 2, 3]),
        ([0.3, 0.2, 0.06, 0.05], [0, 1, 2]),  # a sine of 0.05 is 2.87 deg
        ([0.3, 0.04, 0.06, 0.0501], [0, 2, 3]),
        ([0.3, 0.2, 0.049, -0.5], None),  # fewer than three: the middle stands for all
        ([-0.3, -0.2, -0.1, 0.0], None),
    ],
)
def test_stars_below_three_degrees_are_left_out_as_long_as_three_remain(sines, used):
    """The zenith stands along x; so much of each direction points there."""
    field_sensor = np.array([[sine, 0.0, np.sqrt(1 - sine**2)] for sine in sines])
    sky = FixedSky((1.0, 0.0, 0.0), air=lambda seen: units([0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1])[: len(seen)])
    OwnAnswerTruth(sky, None, True, field_sensor).shifts(np.array([START_NS]))
    assert sky.shown[0] == pytest.approx(NEAR if used is None else field_sensor[used], abs=1e-15)


def test_a_small_field_is_kept_whole_however_low_it_stands():
    sky = FixedSky((0.0, 0.0, -1.0))
    OwnAnswerTruth(sky, None, True).shifts(np.array([START_NS]))
    assert sky.shown[0] == pytest.approx(NEAR, abs=1e-15)


def test_shifts_are_those_of_the_middle_of_each_minute_and_computed_once():
    sky = FixedSky()
    truth = OwnAnswerTruth(sky, None, True)
    minute_ns = START_NS // (60 * NS_PER_S)
    utc_ns = np.array([minute_ns + 2, minute_ns, minute_ns + 1, minute_ns + 2]) * 60 * NS_PER_S + [
        0,
        1,
        2,
        59 * NS_PER_S,
    ]
    assert truth.shifts(utc_ns).shape == (4, 3, 3)
    assert sky.asked_ns == [(minute_ns + k) * 60 * NS_PER_S + 30 * NS_PER_S for k in range(3)]
    truth.shifts(utc_ns[:1])
    assert len(sky.asked_ns) == 3
    assert truth.shifts(utc_ns[:0]).shape == (0, 3, 3)


def turned_by(rad):
    return Rotation.from_rotvec([0.0, rad, 0.0]).as_matrix()


def test_each_instant_has_the_shift_of_its_own_minute():
    """Air turns all that is seen by a hundredth of a radian more in each minute."""
    minute_ns = 60 * NS_PER_S
    sky = FixedSky(air=lambda seen: seen @ turned_by((sky.asked_ns[-1] - START_NS) // minute_ns / 100))
    minutes = [5, 3, 4]
    shifts = OwnAnswerTruth(sky, None, True).shifts(START_NS + np.array(minutes) * minute_ns + 1)
    assert shifts == pytest.approx(np.array([turned_by(minute / 100) for minute in minutes]), abs=1e-12)


def test_shifts_of_4096_minutes_are_kept():
    """Three days: then all are computed anew."""
    sky, utc_ns = FixedSky(), START_NS + np.arange(4097) * 60 * NS_PER_S
    truth = OwnAnswerTruth(sky, None, True)
    for some in (utc_ns[:4096], utc_ns[:1], utc_ns[4096:], utc_ns[:1], utc_ns[:1]):
        truth.shifts(some)
    assert len(sky.asked_ns) == 4096 + 2


def test_aberration_is_left_in_where_it_is_not_corrected():
    """A twentieth of a radian of it along x, of which the catalogue knows nothing."""
    by = 0.05

    def aberration(stars):
        moved = stars + np.array([by, 0.0, 0.0])
        return moved / np.linalg.norm(moved, axis=1)[:, None]

    sky, utc_ns = FixedSky(aberration=aberration), np.array([START_NS])
    assert OwnAnswerTruth(sky, None, True).shifts(utc_ns)[0] == pytest.approx(np.eye(3), abs=1e-12)
    for truth in (
        OwnAnswerTruth(sky, None),
        OwnAnswerTruth(sky, None, False, units([0, 0, 1], [0.1, 0, 1], [0, 0.1, 1])),
    ):
        place = truth.shifts(utc_ns)[0].T @ [0.0, 0.0, 1.0]
        tolerance = 1e-8 if truth.field_sensor is None else 1e-3  # a field has the mean of what moves its stars
        assert aberration(place[None])[0] == pytest.approx([0.0, 0.0, 1.0], abs=tolerance)


def test_how_unevenly_air_parts_the_stars_of_a_field_is_its_rms_without_their_mean():
    """Four stars at 0.1 rad; air parts those along x by 1e-4 rad each, and lifts all by another angle."""
    field_sensor = units([0.1, 0, 1], [-0.1, 0, 1], [0, 0.1, 1], [0, -0.1, 1])
    lift = Rotation.from_rotvec([0.0, 2e-3, 0.0]).as_matrix()

    def air(seen):
        parted = seen + np.array([[1e-4], [-1e-4], [0], [0]]) * np.cross([0.0, 1.0, 0.0], seen)
        return parted / np.linalg.norm(parted, axis=1)[:, None] @ lift.T

    truth = OwnAnswerTruth(FixedSky(air=air), None, True, field_sensor)
    assert truth.uneven_arcsec(START_NS) == pytest.approx(1e-4 * np.sqrt(2 / 4) * 206_265, rel=1e-3)
    even = OwnAnswerTruth(FixedSky(air=lambda seen: seen @ lift.T), None, True, field_sensor)
    assert even.uneven_arcsec(START_NS) == pytest.approx(0.0, abs=1e-6)
    assert even.shifts(np.array([START_NS]))[0] == pytest.approx(lift.T, abs=1e-12)
    small = OwnAnswerTruth(FixedSky(air=lambda seen: seen @ lift.T), None, True)
    assert small.shifts(np.array([START_NS]))[0] == pytest.approx(lift.T, abs=1e-12)


def test_the_rotation_between_two_fields_is_that_of_scipy():
    rng = np.random.default_rng(5)
    for count in (3, 12):
        seen = units(*(rng.normal(0, 1, (count, 3)) * [1, 1, 0] + [0, 0, 1]))
        true = units(*(Rotation.random(rng=rng).apply(seen) + rng.normal(0, 0.05, (count, 3))))
        expected, _ = Rotation.align_vectors(seen, true)
        sky = FixedSky(air=lambda _, true=true: true)
        shift = OwnAnswerTruth(sky, None, True, seen).shifts(np.array([START_NS]))[0]
        assert shift == pytest.approx(expected.as_matrix(), abs=1e-7)


@pytest.mark.parametrize(
    ("beside", "turn_rad"),
    [
        ([[0, 0, 2.0], [0.3, 0, 3.0], [0, 0.02, 0.5]], 0.0),  # whatever their lengths
        ([[0, 0, 1.0], [np.cos(0.1), np.sin(0.1), 5.0], [np.sin(0.1), np.cos(0.1), 0.1]], 0.0),  # sheared
        ([[0, 0, 1.0], [2 * np.cos(0.2), 2 * np.sin(0.2), 1.0], [0, 0.5, 1.0]], 0.1),
    ],
)
def test_a_small_field_turns_with_its_middle_and_by_the_mean_of_the_two_directions_beside_it(beside, turn_rad):
    axes = Rotation.random(rng=np.random.default_rng(6)).as_matrix()
    sky = FixedSky(air=lambda _: np.array(beside) @ axes.T)
    shift = OwnAnswerTruth(sky, None, True).shifts(np.array([START_NS]))[0]
    assert pytest.approx(axes @ Rotation.from_rotvec([0.0, 0.0, turn_rad]).as_matrix(), abs=1e-12) == shift.T


# Which panorama an answer is to


def two_lives(count=50, *, apart_s=100, host=True):
    """Frames of a sensor that started anew, with the tags and numbers of its first life, and answers 80 ms later."""
    frames, answers = np.zeros(2 * count, dtype=FRAME), np.zeros(2 * count, dtype=OWN_ANSWER)
    number = np.tile(np.arange(1, count + 1), 2)
    life_ns = np.repeat([0, apart_s * NS_PER_S], count)
    for rows, late_ns in ((frames, 0), (answers, 80_000_000)):
        rows["time_us"], rows["frame_no"] = number * 100_000, number
        if host:
            rows["host_utc_ns"] = START_NS + life_ns + number * NS_PER_S // 10 + late_ns
    return frames, answers


@pytest.mark.parametrize("host", [True, False])
@pytest.mark.parametrize("numbered", [True, False])
def test_answers_of_a_sensor_that_repeats_tags_and_numbers_are_to_the_panoramas_of_their_own_life(host, numbered):
    frames, answers = two_lives(host=host)
    if not numbered:
        answers["frame_no"] = 0
    assert panoramas_of(frames, answers).tolist() == list(range(100))
    part = np.r_[0:20, 50:100]
    if host:
        assert panoramas_of(frames, answers[part]).tolist() == part.tolist()
        assert panoramas_of(frames[part], answers)[:20].tolist() == list(range(20))
        assert panoramas_of(frames[part], answers)[50:].tolist() == list(range(20, 70))


def test_an_answer_is_to_a_panorama_of_its_own_tag_and_number_alone():
    frames, answers = two_lives(3)
    answers["time_us"][1] += 1
    answers["frame_no"][2] += 5
    assert panoramas_of(frames, answers).tolist() == [0, -1, -1, 3, 4, 5]
    assert panoramas_of(frames[:0], answers).tolist() == [-1] * 6
    assert panoramas_of(frames, answers[:0]).tolist() == []


def test_under_a_tag_that_stands_still_the_number_tells():
    frames, answers = two_lives(50)
    frames["time_us"] = answers["time_us"] = 7
    assert panoramas_of(frames, answers).tolist() == list(range(100))


@given(st.data())
def test_the_nearest_panorama_of_the_same_tag_and_number_is_that_of_a_search_one_by_one(data):
    small = st.integers(1, 3)
    rows = st.lists(st.tuples(small, small, st.integers(1, 60)), max_size=12)
    frames, answers = (_rows(data.draw(rows), dtype) for dtype in (FRAME, OWN_ANSWER))
    for answer, row in zip(answers, panoramas_of(frames, answers), strict=True):
        same = [
            abs(int(frame["host_utc_ns"]) - int(answer["host_utc_ns"]))
            for frame in frames
            if frame["time_us"] == answer["time_us"] and frame["frame_no"] == answer["frame_no"]
        ]
        if not same:
            assert row == -1
        else:
            found = frames[row]
            assert (found["time_us"], found["frame_no"]) == (answer["time_us"], answer["frame_no"])
            assert abs(int(found["host_utc_ns"]) - int(answer["host_utc_ns"])) == min(same)


def _rows(drawn, dtype):
    rows = np.zeros(len(drawn), dtype=dtype)
    for row, (time_us, frame_no, host_ns) in zip(rows, drawn, strict=True):
        row["time_us"], row["frame_no"], row["host_utc_ns"] = time_us, frame_no, host_ns
    return rows
