import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gse.external.answers import ExternalAnswer, parse_answer, parse_line
from gse.external.panoramas import SensorDescription, WireUnit, rows_here
from gse.values.attitude import Attitude
from gse.values.camera import Camera
from gse.values.panorama import Panorama

CAMERA = Camera(1024, 1024, 4000.0, (511.5, 511.5))
SCALAR = st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(["", "1", "NaN"])
JUNK = SCALAR | st.lists(SCALAR | st.fixed_dictionaries({"object": SCALAR, "star": SCALAR}), max_size=4)


@given(
    ra=st.floats(0, 360, exclude_max=True),
    de=st.floats(-89.9, 89.9),
    roll=st.floats(-360, 360),
)
def test_ra_de_and_roll_come_through_unchanged(ra, de, roll):
    line = json.dumps({"frame_no": 5, "ra_deg": ra, "de_deg": de, "roll_deg": roll}).encode()
    attitude = parse_line(line, 5, 0).attitude
    assert math.remainder(attitude.ra_deg - ra, 360) == pytest.approx(0, abs=1e-9)
    assert attitude.de_deg == pytest.approx(de, abs=1e-9)
    assert math.remainder(attitude.roll_deg - roll, 360) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("order", ["scalar-first", "scalar-last"])
@pytest.mark.parametrize("maps", ["icrs-to-sensor", "sensor-to-icrs"])
def test_a_quaternion_means_what_scipy_takes_it_for(order, maps):
    true = Attitude.from_angles(211.0, -37.0, 61.0)
    rotation = Rotation.from_matrix(true.icrs_to_sensor)
    x, y, z, w = (rotation if maps == "icrs-to-sensor" else rotation.inv()).as_quat()
    numbers = [x, y, z, w] if order == "scalar-last" else [w, x, y, z]
    answer = parse_answer({"frame_no": 1, "quaternion": numbers, "order": order, "maps": maps}, 1, 0)
    assert answer.attitude.icrs_to_sensor == pytest.approx(true.icrs_to_sensor, abs=1e-12)
    assert answer.has_roll


@pytest.mark.parametrize(("status", "is_answer"), [("NO_MATCH", False), ("TOO_FEW", False), ("LOCKED", True)])
def test_numbers_beside_a_word_for_no_answer_are_what_was_left_there(status, is_answer):
    answer = parse_answer({"frame_no": 1, "ra_deg": 0.0, "de_deg": 0.0, "status": status}, 1, 0)
    assert (answer.attitude is not None) is is_answer
    assert answer.status == status


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"ra_deg": 400}, "ra_deg is 400: expected a number from 0 to 360"),
        ({"ra_deg": "10"}, "ra_deg is '10'"),
        ({"ra_deg": None}, "ra_deg is None"),
        ({"de_deg": -90.5}, "de_deg is -90.5"),
        ({"elapsed_us": -1}, "elapsed_us is -1"),
        ({"matches": [{"object": 3, "star": 1}]}, "an object from 0 to 2"),
        ({"quaternion": [0, 0, 0, 1]}, ""),
        ({"quaternion": [0, 0, 0, 1], "order": "xyzw", "maps": "icrs-to-sensor"}, ""),
        ({"quaternion": [0, 0, 0, 2], "order": "scalar-last", "maps": "icrs-to-sensor"}, ""),
        ({"quaternion": [0, 0, 1], "order": "scalar-last", "maps": "icrs-to-sensor"}, ""),
        ({"quaternion": [0, 0, None, 1], "order": "scalar-last", "maps": "icrs-to-sensor"}, ""),
        ({"matches": [{"object": 0, "star": 1}, {"object": 0, "star": 2}]}, ""),
        ({"matches": [{"object": True, "star": 1}]}, ""),
        ({"matches": [{"object": 0, "star": 2**63}]}, ""),
        ({"matches": {"object": 0, "star": 1}}, ""),
        ({"matches": [{"object": 0, "star": "9223372036854775808"}]}, ""),
        ({"matches": [{"object": 0, "star": "Gaia DR3 1"}]}, ""),
        ({"matches": [{"object": 0, "star": "1e18"}]}, ""),
        ({"matches": [{"object": 0, "star": 1e18}]}, ""),
        ({"status": 3}, ""),
        ({"status": "IDENTIFIED", "ra_deg": None, "de_deg": None}, ""),
    ],
)
def test_an_answer_out_of_the_schema_is_nonsense_and_in_step(values, words):
    found = parse_answer({"frame_no": 1, "ra_deg": 1.0, "de_deg": 1.0, **values}, 1, 3)
    assert not isinstance(found, ExternalAnswer)
    assert found.in_step
    assert words in found.detail


@given(document=st.dictionaries(st.sampled_from(["ra_deg", "de_deg", "roll_deg", "matches", "status"]), JUNK))
def test_no_answer_ever_raises_or_carries_what_is_no_number(document):
    answer = parse_answer({"frame_no": 1, **document}, 1, 3)
    if isinstance(answer, ExternalAnswer) and answer.attitude:
        assert np.isfinite(answer.attitude.icrs_to_sensor).all()


@given(line=st.binary(max_size=80))
def test_no_line_ever_raises(line):
    parse_line(line, 1, 3)


@pytest.mark.parametrize("star", [5853498713190525696, -118218, 2**63 - 1])
def test_the_number_of_a_star_may_be_text(star):
    documents = ({"frame_no": 0, "matches": [{"object": 0, "star": form}]} for form in (star, str(star)))
    assert [parse_answer(document, 0, 1).star_ids.tolist() for document in documents] == [[star], [star]]


def test_ra_and_de_alone_are_enough_and_no_answer_says_why():
    both = parse_answer({"frame_no": 1, "ra_deg": 360, "de_deg": 90}, 1, 0)
    assert (both.has_roll, both.attitude.de_deg) == (False, 90.0)
    none = parse_answer({"frame_no": 1, "status": "TOO_FEW", "detail": "2 objects"}, 1, 0)
    assert (none.attitude, none.status, none.detail) == (None, "TOO_FEW", "2 objects")


def test_a_panorama_goes_out_in_wire_units_and_in_the_order_of_the_wire():
    sensor = SensorDescription("made", CAMERA, 4096, WireUnit(1 / 32), WireUnit(1 / 32, 0.5), WireUnit())
    xy_px, brightness = np.array([[700.5, 3.0], [10.53125, 20.25]]), np.array([900.0, 30.0])
    wire_rows = np.array([1, 0])
    panorama = Panorama(1_774_018_800_000_000_000, xy_px, brightness, 7, 0.1, 123_000, wire_rows=wire_rows)
    document = json.loads(*sensor.lines([panorama]))
    assert document == {
        "schema": "gse.panorama/1",
        "frame_no": 7,
        "utc": "2026-03-20T15:00:00.000000000Z",
        "time_us": 123_000,
        "exposure_us": 100_000,
        "objects": [[648, 321, 30], [96, 22400, 900]],
    }
    assert rows_here(panorama, np.array([0, 1])).tolist() == [1, 0]


def test_the_sensor_is_described_with_its_optics_and_units():
    document = SensorDescription("made", CAMERA, 4096, WireUnit(1 / 32), WireUnit(1 / 32)).document()
    assert document["schema"] == "gse.sensor/1"
    assert (document["focal_length_px"], document["mirrored"], document["index_max"]) == (4000.0, False, 4096)
    assert document["units"]["y"] == {"factor": 1 / 32, "zero": 0.0}
