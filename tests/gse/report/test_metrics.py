"""The metrics of a session: each from where it is computed, with its interval, or with the reason of its absence."""

import json
from dataclasses import replace

import numpy as np
import pytest
from skies.one_by_one import add_frame
from skies.synthetic_night import synthetic_frames, synthetic_night

from gse.report import summarise
from gse.report.metric_table import metric_table
from gse.report.page import report_html
from gse.station.results import Subject
from gse.statistics import session_statistics as room
from gse.statistics.metrics import metrics
from gse.statistics.session_statistics import statistics
from gse.statistics.spatial_errors import MIN_STARS, ErrorPart, SpatialErrors, spatial_errors
from gse.verdict.assessment import judge


@pytest.fixture(scope="module")
def many_stars():
    """Sixty frames with enough different stars: other ones in every third of them."""
    session = synthetic_night(0)
    for number, frame in enumerate(synthetic_frames(60, rate_hz=0.02, trouble=False)):
        others = replace(frame.matches, stars=frame.matches.stars + number % 3 * 20)
        add_frame(session.frames, replace(frame, matches=others))
    return session


@pytest.fixture(scope="module")
def stats():
    return statistics(synthetic_night(300))


def by_name(found, name, axis):
    return next(metric for metric in found if metric.name == name and metric.axis == axis)


def table_of(found):
    documents = [{name: getattr(metric, name) for name in metric.__slots__} for metric in found]
    text = json.dumps([{**one, "subject": one["subject"].value} for one in documents]).replace("NaN", "null")
    return {line[0]: line for line in metric_table(json.loads(text), "onboard")}


def test_the_spatial_errors_are_those_of_all_counted_frames(many_stars) -> None:
    matches, camera = many_stars.frames.matches, many_stars.station.sensor.camera()
    xy_px = np.column_stack([matches["x_px"], matches["y_px"]]).astype(float)
    expected = spatial_errors(matches, camera.directions(xy_px), (camera.columns, camera.rows))
    found = statistics(many_stars)
    assert expected is not None
    assert found.spatial == expected
    part = by_name(metrics(found), "temporal noise, of a star", "cross_x")
    assert (part.value, part.low) == (expected[0].temporal.rms_arcsec, expected[0].temporal.low_arcsec)
    boresight = by_name(metrics(found), "FOV spatial error, of the boresight", "cross_y")
    assert boresight.value == expected[1].fov.boresight_arcsec


def test_only_counted_frames_enter_the_spatial_errors(many_stars) -> None:
    counted, matches = statistics(many_stars).counted, many_stars.frames.matches
    even = np.arange(60) % 2 == 0
    found = room._spatial(many_stars, replace(counted, used=counted.used & even))
    assert found is not None
    assert found[0].n == int(even[matches["frame"]].sum())


def test_few_stars_are_told_not_filled_with_numbers(stats) -> None:
    assert stats.spatial is None
    found = by_name(metrics(stats), "pixel spatial error, of a star", "cross_y")
    assert np.isnan(found.value)
    assert found.note == "too few stars to tell"
    assert MIN_STARS > 1


def test_below_an_hour_a_drift_is_given_only_where_it_is_significant(stats) -> None:
    short = by_name(metrics(stats), "drift", "cross_x")
    assert np.isnan(short.value)
    assert "not significant" in short.note
    long = by_name(metrics(replace(stats, duration_s=3600.0)), "drift", "cross_x")
    assert long.low < long.value < long.high
    onboard = stats.onboard
    drifting = replace(onboard.axes["cross_x"], drift_arcsec_per_h=9.0, drift_low_arcsec_per_h=3.0)
    changed = replace(onboard, axes={**onboard.axes, "cross_x": drifting})
    assert by_name(metrics(replace(stats, subjects={Subject.ONBOARD: changed})), "drift", "cross_x").value == 9.0


def test_the_table_of_accuracy_gives_a_drift_by_the_same_rule(many_stars) -> None:
    report = summarise(many_stars, judge(many_stars))
    drifting, still = report["accuracy"]["onboard"]["d_de"], report["accuracy"]["onboard"]["d_ra_cosde"]
    still.update(drift_arcsec_per_h=2.0, drift_low_arcsec_per_h=-1.0, drift_high_arcsec_per_h=5.0)
    drifting.update(drift_arcsec_per_h=7200.0, drift_low_arcsec_per_h=5.0, drift_high_arcsec_per_h=10800.0)
    page = report_html(many_stars, judge(many_stars), report, plots=False)
    assert page.count('<td class="n">2.000° [5.00, 3.000°]</td>') == 1
    assert "2.00 [-1.00, 5.00]" not in page
    report["session"]["duration_s"] = 3600.0
    assert "2.00 [-1.00, 5.00]" in report_html(many_stars, judge(many_stars), report, plots=False)


def test_the_starts_of_a_session_are_a_distribution(stats) -> None:
    changed = replace(stats.onboard, first_fixes_s=(1.0, 2.0, 9.0, float("nan")))
    found = by_name(metrics(replace(stats, subjects={Subject.ONBOARD: changed})), "time to first fix, median", None)
    assert found.value == 2.0
    assert found.note == "4 starts, 1 without an answer; from 1.00 to 9.00 s"


def test_the_table_has_a_cell_for_each_axis_in_a_unit_that_makes_sense(stats) -> None:
    part = ErrorPart(7200.0, 3600.0, 9000.0, 0.25)
    spatial = (SpatialErrors(part, part, part, 40, 400),) * 2
    lines = table_of(metrics(replace(stats, spatial=spatial)))
    assert lines["FOV spatial error, of a star"][3] == ("2.000 deg rms [1.000 deg, 2.500 deg]",) * 2 + ("–",)
    assert lines["FOV spatial error, of the boresight"][3] == ("0.25 arcsec rms",) * 2 + ("–",)
    assert lines["latency, median"][3] == ("5.00 ms",)
    assert "arcsec [" in lines["bias"][3][2]


def test_a_note_on_a_dash_says_so_where_other_axes_of_the_line_have_a_value(stats) -> None:
    drift = by_name(metrics(stats), "drift", "cross_x")
    dash = replace(drift, value=np.nan, low=np.nan, high=np.nan, note="not significant in less than an hour")
    given = replace(drift, axis="cross_y", value=-145.1, low=-176.2, high=-114.1, note="")
    assert table_of([dash, given])["drift"][-1] == "a dash: not significant in less than an hour"
    assert table_of([dash])["drift"][-1] == "not significant in less than an hour"
