"""The comparison of answers: where angles turn over, at the pole, and of frame numbers that come again."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.sessions.expected_answers import compare_answers, read_answers
from gse.values.attitude import Attitude

ARCSEC = 1 / 3600


def rows_of(folder, *answers):
    """Answers as rows, read from a file; the frames are numbered from 0 unless an answer says otherwise."""
    path = folder / "lines.ndjson"
    path.write_text("".join(line(frame_no, **answer) for frame_no, answer in enumerate(answers)))
    return read_answers(path).rows


def line(frame_no, **answer):
    return json.dumps({"frame_no": frame_no, **answer}) + "\n"


def angles(ra_deg, de_deg, roll_deg=None):
    return {"ra_deg": ra_deg, "de_deg": de_deg} | ({} if roll_deg is None else {"roll_deg": roll_deg})


def compared(folder, then, now, **options):
    return compare_answers(rows_of(folder, then), rows_of(folder, now), **options)


@pytest.mark.parametrize(
    ("then", "now", "apart_arcsec"),
    [
        (angles(359.9999, 0, 10), angles(0.0001, 0, 10), 0.72),
        (angles(10, 0, 0), angles(10, 0, 360), 0),
        (angles(10, 0, 359.9999), angles(10, 0, 0.0001), 0.72),
        (angles(10, 90, 20), angles(100, 90, 110), 0),  # at the pole RA and roll turn alike
        (angles(10, 89.9999), angles(190, 89.9999), 0.72),  # on two sides of the pole, without a roll
        (angles(10, 60), angles(10 + 2 * ARCSEC, 60), 1),
        (angles(10, 60, 0), angles(10, 60, 5 * ARCSEC), 5),
    ],
)
def test_answers_are_as_far_apart_as_the_rotation_between_them(then, now, apart_arcsec, tmp_path):
    exact = compared(tmp_path, then, now)
    assert exact.different == 1
    assert exact.farthest_arcsec == pytest.approx(apart_arcsec, abs=1e-6)
    assert compared(tmp_path, then, now, within_arcsec=apart_arcsec + 1e-6).is_same
    if apart_arcsec:
        assert compared(tmp_path, then, now, within_arcsec=apart_arcsec - 1e-6).different == 1


def test_a_roll_on_one_side_only_differs_within_any_angle(tmp_path):
    assert compared(tmp_path, angles(1, 2), angles(1, 2, 0), within_arcsec=1e6).different == 1


def test_the_last_bit_of_a_number_differs_where_no_angle_is_given(tmp_path):
    assert compared(tmp_path, angles(1, 2, 3), angles(1, 2, 3)).is_same
    assert compared(tmp_path, angles(1, 2, 3), angles(1, 2, float(np.nextafter(3, 4)))).different == 1


@pytest.mark.parametrize("order", ["scalar-first", "scalar-last"])
@pytest.mark.parametrize("maps", ["icrs-to-sensor", "sensor-to-icrs"])
def test_a_quaternion_is_compared_with_angles_within_an_angle(order, maps, tmp_path):
    """scipy's rotations turn vectors, as the quaternion of an answer does."""
    rotation = Rotation.from_matrix(Attitude.from_angles(40, -30, 70).icrs_to_sensor)
    rotation = rotation if maps == "icrs-to-sensor" else rotation.inv()
    quaternion = rotation.as_quat(scalar_first=order == "scalar-first").tolist()
    answer = {"quaternion": quaternion, "order": order, "maps": maps}
    assert compared(tmp_path, angles(40, -30, 70), answer, within_arcsec=1e-6).is_same
    assert compared(tmp_path, angles(40, -30, 70), answer).different == 1
    assert compared(tmp_path, answer, answer).is_same
    assert compared(tmp_path, angles(41, -30, 70), answer, within_arcsec=1).different == 1
    negative = {**answer, "quaternion": [-q for q in quaternion]}
    assert compared(tmp_path, answer, negative, within_arcsec=1e-6).is_same


def test_a_frame_number_that_comes_again_is_paired_in_its_order(tmp_path):
    def rows(*numbered):
        path = tmp_path / "lines.ndjson"
        path.write_text("".join(line(number, **angles(ra_deg, 0)) for number, ra_deg in numbered))
        return read_answers(path).rows

    then = rows((7, 1), (8, 2), (7, 3))
    assert compare_answers(then, rows((7, 1), (7, 3), (8, 2))).is_same
    assert compare_answers(then, rows((7, 3), (8, 2), (7, 1))).different == 2
    fewer = compare_answers(then, rows((7, 1), (8, 2)))
    assert (fewer.compared, fewer.different, fewer.unused) == (2, 0, 1)


def test_another_reason_for_no_answer_differs_and_none_is_any(tmp_path):
    few, no_match, failed = {"status": "TOO_FEW"}, {"status": "NO_MATCH"}, {"failure": "CRASH"}
    assert compared(tmp_path, few, no_match).different == 1
    assert compared(tmp_path, {}, no_match).is_same
    assert compared(tmp_path, failed, no_match).different == 1
    assert compared(tmp_path, failed, failed).is_same
    # numbers beside these words were left in their place
    assert compared(tmp_path, no_match, no_match | angles(1, 2)).is_same


def test_the_word_identified_need_not_be_said(tmp_path):
    assert compared(tmp_path, angles(1, 2), angles(1, 2) | {"status": "IDENTIFIED"}).is_same


def test_nothing_beside_nothing_is_compared_without_a_warning(tmp_path):
    none = rows_of(tmp_path, angles(1, 2))[:0]
    both = compare_answers(none, none)
    assert (both.compared, both.is_same) == (0, True)
