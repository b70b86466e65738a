"""What is taken of a session to look for gross mistakes: few frames of its whole length, and places over the field."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gse.diagnosis.gross_causes import RawAttitudes, central
from gse.station.columns import FRAME
from gse.values.attitude import Attitude
from gse.values.camera import Camera


def frames(count):
    made = np.zeros(count, dtype=FRAME)
    made["utc_ns"] = np.arange(count) * 10**9
    made["ra_deg"], made["de_deg"], made["roll_deg"] = np.arange(count) % 360, -20.0, 30.0
    return made


@pytest.mark.parametrize(("columns", "rows"), [(1024, 1024), (1600, 800)])
def test_the_field_is_its_middle_and_corners_at_seven_tenths(columns, rows):
    camera = Camera(rows, columns, 2000.0, (columns / 2, rows / 2))
    found = RawAttitudes.from_frames(frames(3), np.arange(3), camera).field_sensor
    x, y = 0.35 * columns / 2000.0, 0.35 * rows / 2000.0
    assert np.linalg.norm(found, axis=1) == pytest.approx(np.ones(5))
    on_plane = found[:, :2] / found[:, 2:]
    expected = [[0, 0], [x, y], [-x, y], [x, -y], [-x, -y]]
    assert on_plane.tolist() == [pytest.approx(one) for one in expected]
    assert (found[:, 2] > 0).all()


@pytest.mark.parametrize(("answered", "taken"), [(1, 1), (14, 14), (15, 15), (16, 15), (1000, 15)])
def test_fifteen_answered_frames_stand_for_all_first_and_last_among_them(answered, taken):
    rows = 3 + 2 * np.arange(answered)
    found = RawAttitudes.from_frames(frames(3000), rows, Camera(1024, 1024, 4170.0, (511.5, 511.5)))
    at_s = found.utc_ns // 10**9
    assert len(at_s) == taken
    assert (at_s[0], at_s[-1]) == (rows[0], rows[-1])
    assert np.isin(at_s, rows).all()
    assert taken < 3 or np.ptp(np.diff(at_s)) <= 2
    first = Attitude.from_angles(float(rows[0] % 360), -20.0, 30.0).icrs_to_sensor
    assert found.icrs_to_sensor[0] == pytest.approx(first)


def test_some_of_them_are_the_first_the_middle_and_the_last_of_a_mask():
    raw = RawAttitudes(np.arange(9), np.zeros((9, 3, 3)), np.zeros((5, 3)))
    mask = np.array([0, 1, 1, 0, 1, 1, 1, 1, 0], dtype=bool)
    assert raw.some(mask).utc_ns.tolist() == [1, 5, 7]


@pytest.mark.parametrize("false_first", [True, False])
def test_the_central_one_of_some_attitudes_is_no_false_answer(false_first):
    turns_deg = [0.0, 0.3, 0.1, 0.2, 0.15]
    false_deg = [-170.0, 90.0, -60.0]
    all_deg = false_deg + turns_deg if false_first else turns_deg + false_deg
    found = central(Rotation.from_rotvec(np.outer(all_deg, [0, 0, 1]), degrees=True).as_matrix())
    # of eight, half are nearest to the middle of the five that are alike
    assert all_deg[found] == 0.15
