"""A result as JSON: every field, rounded, and null where it is absent."""

from dataclasses import replace

import numpy as np
import pytest
from skies.known_nights import START_NS, frame, unanswered
from skies.one_by_one import Stars, result_of

from gse.identifier import Identification
from gse.station.frame_results import frame_json
from gse.station.results import AttitudeError
from gse.values.attitude import Attitude

ERROR = AttitudeError(1.23456, -2.34567, 345.67891, 1.0, 2.0)
ATTITUDE = Attitude.from_angles(123.456789312, -45.678901234, 12.345678901)


def made(**changes):
    result = frame(START_NS, 7, ERROR, matches=((10.0, 20.0, 3.0, 4.0), (30.0, 40.0, 0.004, 0.0)))
    matches = Stars(np.array([0, 1]), np.array([5, 9]), np.array([[3.0, 4.0], [0.126, 0.0]]), {5: "Vega", 9: "9"}.get)
    found = Identification(np.array([0, 1]), np.array([5, 9]), 1.23456e-9)
    others = ((1, "Moon"),)
    says = replace(result, attitude=ATTITUDE, identification=found, matches=matches, others=others, **changes)
    return frame_json(result_of(says))


def test_every_number_of_an_answer_is_told():
    found = made(elapsed_us=150.26)
    assert (found["schema"], found["status"], found["frame_no"]) == ("gse.frame/1", "IDENTIFIED", 7)
    assert (found["ra_deg"], found["de_deg"], found["roll_deg"]) == (123.4567893, -45.6789012, 12.345679)
    assert (found["matched"], found["objects"], found["chance"]) == (2, 2, 1.23e-9)
    assert found["elapsed_us"] == 150.3
    assert (found["d_ra_cosde_arcsec"], found["d_de_arcsec"], found["d_roll_arcsec"]) == (1.235, -2.346, 345.679)
    assert found["answer_check"] == "correct"
    assert [(one["object"], one["residual_arcsec"]) for one in found["matches"]] == [(0, 5.0), (1, 0.13)]
    assert found["others"] == [{"object": 1, "kind": "Moon"}]


def test_an_answer_without_a_roll_has_none_and_no_error_of_it():
    found = made(has_roll=False)
    assert (found["roll_deg"], found["d_roll_arcsec"]) == (None, None)
    assert found["d_de_arcsec"] == -2.346


@pytest.mark.parametrize(
    "name", ["ra_deg", "de_deg", "roll_deg", "chance", "elapsed_us", "d_de_arcsec", "d_roll_arcsec"]
)
def test_what_there_is_not_is_null(name):
    found = frame_json(result_of(unanswered(3)))
    assert found[name] is None
    assert (found["status"], found["matches"], found["others"]) == ("NO_MATCH", [], [])
