"""The simulated sensor's own answers and their faults, against the station's truth."""

import numpy as np
import pytest

from drivers.errors import UrlError
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.simulator.device import device_factory
from gse.simulator.own_answers import OwnAnswers
from gse.simulator.scenario import parse_scenario
from gse.station.own_answers import OwnAnswerTruth, measured_rotations
from gse.station.results import attitude_errors
from gse.station.session_tables import AttitudeTable
from gse.truth import EarthOrientation, SiderealTruth
from gse.values.instant import NS_PER_S, from_text
from protocols import AttitudeMessage, FrameDecoder, PanoramaMessage, load_protocol

START_NS = from_text("2026-03-20T15:00:00Z")
COUNT = 40
UTC_NS = START_NS + np.arange(COUNT) * (NS_PER_S // 2)
TILTED = BUILT_IN_TEXT.replace("altitude_deg: 90", "altitude_deg: 50").replace("azimuth_deg: 0", "azimuth_deg: 130")
ORIENTATION = EarthOrientation.from_disk(START_NS)


def answers(keys, convention="{}", stated=None, motion="{}"):
    """Errors (5, COUNT) of the answers of a scenario, as a station reads them, and the messages."""
    station = parse_station(TILTED.replace("sensor:\n", f"sensor:\n  attitude: {convention}\n"))
    text = f"text: test\nattitude: {{noise_arcsec: 0, roll_noise_arcsec: 0, {keys}}}\nmotion: {motion}"
    scenario = parse_scenario(text, "t")
    own = OwnAnswers(station, scenario, np.random.default_rng(5), START_NS)
    messages = [own.message(utc_ns, number, number) for number, utc_ns in enumerate(UTC_NS.tolist())]
    table = AttitudeTable()
    for message in messages:
        table.append(0, message)
    read_as = station.sensor.attitude if stated is None else stated
    truth = SiderealTruth(station.site, ORIENTATION)
    true = OwnAnswerTruth(truth, station.mount, read_as.aberration == "corrected").expected(UTC_NS)
    return attitude_errors(measured_rotations(table.columns, UTC_NS, read_as), true).T, messages


@pytest.mark.parametrize(
    "convention",
    [
        "{}",
        "{frame: date, ra_unit: h}",
        "{frame: J2000, roll_through: west}",
        "{frame: B1950}",
        "{aberration: corrected}",
    ],
)
def test_without_faults_an_answer_is_what_truth_expects(convention):
    errors, _ = answers("", convention)
    assert np.abs(errors[[0, 1, 3, 4]]).max() < 0.1
    assert np.abs(errors[2]).max() < 1.5


def test_a_quaternion_says_the_same_as_the_angles():
    _, messages = answers("")
    table = AttitudeTable()
    for message in messages:
        table.append(0, AttitudeMessage(0, q1=message.q1, q2=message.q2, q3=message.q3, q4=message.q4))
    convention = parse_station(BUILT_IN_TEXT).sensor.attitude
    by_quaternion = measured_rotations(table.columns, UTC_NS, convention)
    both = attitude_errors(by_quaternion, by_quaternion)
    assert table.columns["acquired"].all()
    assert np.abs(both).max() < 1e-6


def test_a_bias_lies_along_columns_rows_and_about_the_boresight():
    errors, _ = answers("bias_arcsec: [30, -20, 100]")
    _, _, roll, x, y = errors.mean(axis=1)
    assert x == pytest.approx(30, abs=0.2)
    assert y == pytest.approx(-20, abs=0.2)
    assert roll == pytest.approx(100, abs=2)


def test_the_answers_slip_with_the_mount():
    errors, _ = answers("", motion="{slips: [[10, 30, -20, 100]]}")
    moved = errors[2:, COUNT // 2 :].mean(axis=1) - errors[2:, : COUNT // 2].mean(axis=1)
    assert moved == pytest.approx([100, 30, -20], abs=0.3)


def test_a_delayed_answer_is_that_of_an_earlier_sky():
    errors, _ = answers("delay_frames: 4")
    de_deg = np.radians(answers("")[1][0].de_deg)
    assert errors[0, -1] == pytest.approx(-15.041 * 2.0 * np.cos(de_deg), abs=0.2)
    assert errors[1, -1] == pytest.approx(0, abs=0.2)


def test_a_frozen_answer_stays_and_zeros_are_zeros():
    _, messages = answers("frozen_s: [[5, 8]], zeros_s: [[10, 12]]")
    numbers = np.array([[one.ra_deg, one.de_deg, one.roll_deg] for one in messages])
    assert (numbers[10:16] == numbers[10]).all()
    assert (numbers[16] != numbers[10]).any()
    assert (numbers[20:24] == 0).all()
    assert (numbers[24] != 0).all()


def test_a_false_answer_is_degrees_off_and_called_good():
    errors, messages = answers("false_answers: 0.3")
    off = np.hypot(*errors[3:]) > 1800
    assert 5 < off.sum() < 20
    assert {message.state for message in messages} == {"acquired"}


def test_a_lost_sensor_says_so():
    _, messages = answers("lost: 1")
    assert {(one.state, one.matched, one.ra_deg) for one in messages} == {("lost", 0, 0.0)}


def decoded(text, options, protocol="panorama-v1", scenario="own-answers"):
    device = device_factory(parse_station(text))({"scenario": scenario, **options})
    frames = FrameDecoder(load_protocol(protocol))
    messages = []
    while (chunk := device.next_chunk()) is not None:
        messages += [load_protocol(protocol).decode(frame) for frame in frames.feed(chunk.data)]
    return messages


def test_each_panorama_is_followed_by_the_answer_to_it():
    messages = decoded(BUILT_IN_TEXT, {"frames": "4"})
    assert [type(message) for message in messages] == ([PanoramaMessage, AttitudeMessage] * 4)[:-1]  # the last is late
    for panorama, own in zip(messages[::2], messages[1::2], strict=False):
        assert (own.frame_no, own.time_us, own.latency_s) == (panorama.frame_no, panorama.time_us, 0.06)


def test_a_protocol_without_attitude_is_refused_with_its_name(tmp_path):
    path = tmp_path / "mute.yaml"
    text = load_protocol("panorama-v1").text
    begin, end = text.index("  ATTITUDE:"), text.index("  ACK:")
    path.write_text(text[:begin] + text[end:])
    with pytest.raises(UrlError, match="has no ATTITUDE, which the scenario sends"):
        decoded(BUILT_IN_TEXT + f"protocol: {path}\n", {"frames": "1"})
