"""The declaration of the columns: what it refuses, and that everything that shows columns shows what is declared."""

from dataclasses import fields

import numpy as np
import pytest
from skies.synthetic_night import synthetic_night

from gse.report.files import frames_csv
from gse.station.columns import COLUMNS, FRAME, OWN_COLUMNS, SKY_CONDITIONS, Column, empty_rows, unit_of
from gse.station.own_answers import SensorAnswers
from gse.station.results import Subject


def test_a_number_whose_name_ends_with_no_known_unit_is_refused_with_a_sentence():
    with pytest.raises(
        ValueError, match="the name of the column 'sky_adu' ends with no known unit; expected one of _mag_p"
    ):
        Column("sky_adu", "f4", "brightness of the sky")


def test_shares_counts_and_words_have_no_unit():
    assert Column("clouded_share", "f4", "share of the field behind clouds", decimals=3).unit == ""
    assert Column("risk", "f8", "risk of a false answer", significant=2).unit == ""
    assert Column("trails", "u1", "objects that are trails").unit == ""
    assert Column("sky", "u1", "the sky", words=SKY_CONDITIONS).unit == ""


@pytest.mark.parametrize(
    ("name", "unit", "decimals"),
    [
        ("d_de_arcsec", "arcsec", 3),
        ("drift_arcsec_per_h", "arcsec/h", 3),
        ("ra_deg", "deg", 7),
        ("exposure_s", "s", 6),
        ("elapsed_us", "us", 1),
        ("latency_ms", "ms", 3),
        ("temperature_c", "degC", 2),
    ],
)
def test_the_end_of_a_name_states_the_unit_and_with_it_the_decimals(name, unit, decimals):
    column = Column(name, "f8", "a number")
    assert (column.unit, column.shown_decimals) == (unit, decimals)
    assert Column(name, "f8", "a number", decimals=5).shown_decimals == 5


def test_a_unit_is_a_word_of_its_own():
    assert unit_of("star_fields") == ""
    assert unit_of("gas") == ""


def test_answers_have_the_name_of_their_subject_before_theirs_and_instants_no_unit():
    names = {column.name: column.name_of(Subject.SENSOR) for column in COLUMNS}
    assert names["ra_deg"] == "sensor_ra_deg"
    assert names["ra_true_deg"] == "ra_true_deg"
    assert (names["utc_ns"], names["host_utc_ns"]) == ("utc", "host_utc")


def test_in_rows_without_anything_known_numbers_are_nan_and_counts_0():
    rows = empty_rows(3)
    assert rows.dtype == FRAME
    for name in FRAME.names:
        empty = np.nan if FRAME[name].kind == "f" else 0
        np.testing.assert_array_equal(rows[name], np.full(3, empty, FRAME[name]))


def test_a_line_of_frames_csv_has_each_declared_column():
    head, *_ = frames_csv(synthetic_night(1).frames.columns)
    shown = head.rstrip().split(",")
    declared = {f"onboard_{column.name}" if column.of_answer else column.name for column in COLUMNS}
    assert set(shown) == declared - {"utc_ns"} | {"utc", "firmware", "serial"}


def test_a_probability_has_its_significant_digits_in_frames_csv_and_an_error_its_decimals():
    frames = synthetic_night(1).frames.columns
    frames["false_match_probability"], frames["d_de_arcsec"] = 1.23456e-12, 1.23456
    head, line, *_ = "".join(frames_csv(frames)).splitlines()
    cells = dict(zip(head.split(","), line.split(","), strict=True))
    assert (cells["onboard_false_match_probability"], cells["onboard_d_de_arcsec"]) == ("1.23e-12", "1.235")


def test_the_sensors_own_answers_have_the_declared_columns():
    assert [field.name for field in fields(SensorAnswers)] == [column.name for column in OWN_COLUMNS]
