"""Flight software against the ATTITUDE frames that the sensor itself recorded, on the counts of the wire."""

import json
from pathlib import Path

import numpy as np
import pytest
from devices.command_line import runner
from devices.programs import program
from skies.one_by_one import Made, result_of

from gse.external.answers import parse_answer
from gse.external.identifier import Given
from gse.sessions.expected_answers import ExpectedAttitudes
from gse.sessions.replay import replay_session
from gse.station.own_answers import measured_rotations, paired
from gse.station.results import Status, Subject
from gse.station.session_tables import AttitudeTable
from gse.values.attitude_convention import AttitudeConvention, read_quaternions, state_angles, state_quaternions
from gse.values.panorama import Panorama
from protocols import AttitudeMessage, load_protocol

SESSION = Path(__file__).parents[3] / "replays" / "golden" / "own-answers.mcap"

SCHEMA = "gse.compare-sensor/1"

FLIGHT = """\
import json, sys
own = {answer["frame_no"]: answer for answer in map(json.loads, open(sys.argv[1]))}
sys.stdin.readline()
for line in sys.stdin:
    frame_no = json.loads(line)["frame_no"]
    print(json.dumps(own.get(frame_no, {"frame_no": frame_no, "status": "NO_MATCH"})), flush=True)
"""


@pytest.fixture(scope="module")
def session():
    return replay_session(SESSION).session


def answers_of(session, path, *, changed=0, has_roll=True):
    """The answers of a program that says what the sensor said, to a third of a count, but for ``changed`` frames."""
    rows, places = paired(session.frames.columns, session.sensor_attitudes.columns)
    sent, utc_ns = session.sensor_attitudes.columns[places], session.frames.columns["utc_ns"][rows]
    rotations = measured_rotations(sent, utc_ns, session.station.sensor.attitude)
    lines = []
    for place, (row, angles) in enumerate(zip(sent, state_angles(rotations, AttitudeConvention()), strict=True)):
        answer = {"frame_no": int(row["frame_no"]), "status": "NO_MATCH"}
        if row["acquired"]:
            ra_deg, de_deg, roll_deg = angles.tolist()
            de_deg += 1e-6 if place < changed else 0.3e-6
            answer = {"frame_no": int(row["frame_no"]), "ra_deg": ra_deg, "de_deg": de_deg, "roll_deg": roll_deg}
            answer = answer if has_roll else {key: answer[key] for key in ("frame_no", "ra_deg", "de_deg")}
        lines.append(json.dumps(answer) + "\n")
    path.write_text("".join(lines))
    return len(lines)


@pytest.mark.parametrize(("changed", "has_roll", "as_json"), [(0, True, False), (3, False, False), (3, True, True)])
def test_a_program_that_says_what_the_sensor_said_differs_nowhere(
    session, tmp_path, capsys, changed, has_roll, as_json
):
    count = answers_of(session, tmp_path / "own.ndjson", changed=changed, has_roll=has_roll)
    flight = program(tmp_path, FLIGHT, head="")
    done = runner(capsys)(
        *("compare", SESSION, "--identifier", f"command:{flight} {tmp_path / 'own.ndjson'}", "--with-sensor"),
        *(["--json"] if as_json else []),
    )
    assert done.code == (changed > 0)
    if as_json:
        document = json.loads(done.out)
        assert (document["schema"], document["compared"], document["different"]) == (SCHEMA, count, changed)
    else:
        assert f"{changed} of {count} answers differ from the sensor's" in done.out
        assert done.out.count("the sensor sent") == changed


class Sent:
    """A session with the answers of a sensor, and one panorama each."""

    subject = Subject.ONBOARD

    def __init__(self, messages):
        self.sensor_attitudes = AttitudeTable()
        for message in messages:
            self.sensor_attitudes.append(0, message)


def compared(protocol, convention, message, document):
    """The comparison of an ATTITUDE message with an external answer."""
    expected = ExpectedAttitudes(load_protocol(protocol), convention)
    panorama = Panorama(1_774_018_800_000_000_000, np.empty((0, 2)), np.empty(0), 7, time_us=5)
    answer = parse_answer({"frame_no": 7, **document}, 7, 0)
    status = Status.IDENTIFIED if answer.attitude else Status.NO_MATCH
    result = result_of(Made(panorama, status, "", "external", attitude=answer.attitude, given=Given(answer)))
    session = Sent([message])
    expected.compare(result, session)
    expected.finish(session)
    return expected


Q = [0.1, -0.7, 0.5, 0.5]
ARGUMENTS = {"state": "acquired", "latency_s": 0.0, "frame_no": 7}


@pytest.mark.parametrize("conjugate", [False, True])
@pytest.mark.parametrize("scalar", ["first", "last"])
@pytest.mark.parametrize("order", ["scalar-first", "scalar-last"])
@pytest.mark.parametrize("maps", ["icrs-to-sensor", "sensor-to-icrs"])
def test_a_quaternion_is_compared_to_the_last_bit_in_any_order_and_sense(conjugate, scalar, order, maps):
    convention = AttitudeConvention(scalar=scalar, conjugate=conjugate)
    answer = parse_answer({"frame_no": 7, "quaternion": Q, "order": order, "maps": maps}, 7, 0)
    (exact,) = state_quaternions(answer.attitude.icrs_to_sensor[None], convention)
    of_answer = sorted(Q, key=abs)
    on_wire = [min(of_answer, key=lambda q, e=e: abs(abs(q) - abs(e))) for e in exact]
    on_wire = [abs(q) * np.sign(e) for q, e in zip(on_wire, exact, strict=True)]
    assert np.allclose(read_quaternions(np.array([on_wire]), convention)[0], answer.attitude.icrs_to_sensor)
    document = {"quaternion": Q, "order": order, "maps": maps}
    numbers = dict(zip(("q1", "q2", "q3", "q4"), on_wire, strict=True))
    message = AttitudeMessage(5, **numbers, **ARGUMENTS)
    assert compared("attitude-quaternion", convention, message, document).is_same
    other = AttitudeMessage(5, **{**numbers, "q2": np.nextafter(numbers["q2"], 1)}, **ARGUMENTS)
    assert compared("attitude-quaternion", convention, other, document).different == 1


def test_an_answer_where_the_sensor_has_none_differs_and_none_beside_none_does_not():
    lost = AttitudeMessage(5, 0.0, 0.0, 0.0, state="lost", latency_s=0.0, frame_no=7)
    convention = AttitudeConvention()
    assert compared("panorama-v1", convention, lost, {"status": "NO_MATCH"}).is_same
    both = compared("panorama-v1", convention, lost, {"ra_deg": 1.0, "de_deg": 2.0})
    assert both.different == 1
    assert both.listed == ["frame 7: an answer here, none by the sensor"]
    acquired = AttitudeMessage(5, 1.0, 2.0, 3.0, **ARGUMENTS)
    assert compared("panorama-v1", convention, acquired, {"status": "NO_MATCH"}).different == 1
    # RA and DE alone are compared without a roll
    assert compared("panorama-v1", convention, acquired, {"ra_deg": 1.0, "de_deg": 2.0}).is_same
    elsewhere = AttitudeMessage(6, 1.0, 2.0, 3.0, **ARGUMENTS)
    none = compared("panorama-v1", convention, elsewhere, {"ra_deg": 1.0, "de_deg": 2.0})
    assert (none.missing, none.unused, none.is_same) == (1, 1, False)
