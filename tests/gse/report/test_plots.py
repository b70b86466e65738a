"""What figures are drawn from: thinned lines, spectra, tracks."""

import itertools
import math
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from astropy.timeseries import LombScargle
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from skies.one_by_one import add_frame
from skies.synthetic_night import synthetic_frames, synthetic_night

from gse.report.plot_data import PlotData, close_edge_of, edge_of, extremes, sample
from gse.report.session_plots import draw_sky, power_density
from gse.report.svg import WIDTH_IN, svg_of
from gse.report.time_plots import draw_errors, line
from gse.station.columns import FRAME
from gse.station.results import AnswerCheck, AttitudeError
from gse.statistics.counted_frames import counted_frames
from gse.values.attitude import Attitude
from gse.view.drawing import BLUE, field_outline_icrs


@given(st.integers(0, 4000), st.integers(0, 2**32 - 1), st.floats(0, 0.5))
@settings(max_examples=40)
def test_a_thinned_line_keeps_every_extreme_of_every_bin(n: int, seed: int, missing: float) -> None:
    generator = np.random.default_rng(seed)
    values = generator.normal(size=n)
    values[generator.random(n) < missing] = math.nan
    rows = extremes(values, bins=50)
    assert (np.diff(rows) > 0).all()
    assert len(rows) <= max(200, 4 * 50)
    edges = np.linspace(0, n, 51).astype(int)
    for first, last in itertools.pairwise(edges):
        part, kept = values[first:last], values[rows[(rows >= first) & (rows < last)]]
        if np.isfinite(part).any():
            assert np.nanmax(kept) == np.nanmax(part)
            assert np.nanmin(kept) == np.nanmin(part)


def test_a_short_line_is_not_thinned() -> None:
    assert extremes(np.arange(10.0)).tolist() == list(range(10))
    assert sample(5, 10).tolist() == [0, 1, 2, 3, 4]
    assert sample(1000, 3).tolist() == [0, 499, 999]


def test_white_noise_has_the_flat_spectrum_of_its_variance() -> None:
    generator = np.random.default_rng(3)
    time_s = np.arange(20_000) / 10
    frequency, density = power_density(time_s, generator.normal(0, 4, len(time_s)))
    assert frequency[-1] == pytest.approx(5, rel=0.05)
    assert np.median(density[frequency > 0.1]) == pytest.approx(2 * 4**2 / 10, rel=0.1)


def test_a_sine_in_the_errors_stands_out_at_its_frequency_though_frames_are_missing() -> None:
    generator = np.random.default_rng(4)
    time_s = np.flatnonzero(generator.random(20_000) < 0.8) / 10
    frequency, density = power_density(
        time_s, np.sin(2 * np.pi * 0.25 * time_s) + generator.normal(0, 0.5, len(time_s))
    )
    assert frequency[np.argmax(density)] == pytest.approx(0.25, rel=0.05)


def test_the_spectrum_of_a_night_with_gaps_is_that_of_lomb_and_scargle():
    generator = np.random.default_rng(5)
    time_s = np.flatnonzero(generator.random(6000) < 0.9) / 10
    error = np.cumsum(generator.normal(0, 0.3, len(time_s))) + generator.normal(0, 4, len(time_s))
    frequency, density = power_density(time_s, error)
    scargle = LombScargle(time_s, error - error.mean(), normalization="psd", fit_mean=False)
    slow, fast = (frequency > 0.01) & (frequency < 0.1), frequency > 0.5
    for band in slow, fast:
        expected = 2 * 0.1 * scargle.power(frequency[band]).mean()
        assert density[band].mean() == pytest.approx(expected, rel=0.3)


def test_too_few_frames_have_no_spectrum() -> None:
    assert len(power_density(np.arange(15.0), np.ones(15))[0]) == 0
    assert len(power_density(np.zeros(40), np.ones(40))[0]) == 0


def test_false_answers_are_not_drawn_as_errors() -> None:
    session = synthetic_night(0)
    for number, frame in enumerate(synthetic_frames(100, trouble=False)):
        if number == 50:
            frame = _with(frame, AttitudeError(4e5, 0.0, 0.0, 4e5, 0.0), AnswerCheck.UNKNOWN)
        if number == 60:
            frame = _with(frame, frame.attitude_error, AnswerCheck.FALSE)
        add_frame(session.frames, frame)
    good = PlotData.from_session(session, counted_frames(session)).good
    assert np.flatnonzero(~good).tolist() == [50, 60]


def _with(frame, attitude_error, judge):
    return replace(frame, attitude_error=attitude_error, answer_check=judge)


def test_the_range_of_a_graph_holds_the_limits_and_nearly_all_values() -> None:
    assert edge_of(np.array([1.0, -2.0]), 60) == 78
    assert close_edge_of(np.full(9, 5.0), 60) == pytest.approx(6.5)  # the axis follows the errors
    assert close_edge_of(np.full(9, 40.0), 60) == 78
    assert close_edge_of(np.array([]), 60) == 78
    assert edge_of(np.full(100, 500.0), 60) == 600
    assert edge_of(np.array([]), 60) == 78
    assert edge_of(np.append(np.zeros(10_000), 1e6), 60) == 78


@pytest.mark.parametrize(("ra_deg", "de_deg"), [(0.0, 0.0), (359.9, -40.0), (120.0, 89.9), (10.0, -88.0)])
def test_the_field_of_view_on_the_sky_is_as_wide_as_the_camera_sees(ra_deg: float, de_deg: float) -> None:
    camera = synthetic_night(0).station.sensor.camera()
    attitude = Attitude.from_angles(ra_deg, de_deg, 33.0)
    outline = field_outline_icrs(attitude, camera)
    corner = math.degrees(math.acos(float((outline @ attitude.boresight_icrs).min())))
    assert corner == pytest.approx(math.degrees(camera.diagonal_rad / 2), abs=0.01)
    assert np.allclose(outline[0], outline[-1])


@pytest.mark.parametrize("de_deg", [-89.99, -6.0, 80.0, 89.99])
def test_a_track_is_drawn_at_the_poles_and_across_ra_zero(de_deg: float) -> None:
    session = synthetic_night(0)
    for number, frame in enumerate(synthetic_frames(30, trouble=False)):
        attitude = Attitude.from_angles((359.9 + number * 0.01) % 360, de_deg, 10.0)
        add_frame(session.frames, replace(frame, attitude=attitude, attitude_true=attitude))
    drawn = PlotData.from_session(session, counted_frames(session))
    svg = svg_of("sky", 3.0, lambda figure: draw_sky(figure, drawn))
    assert svg.startswith("<svg")


@pytest.mark.parametrize("frames", [151, 201, 301])
def test_a_time_at_the_end_of_the_axis_is_whole(frames: int) -> None:
    session = synthetic_night(frames)
    figure = Figure(figsize=(WIDTH_IN, 4.0))
    with mpl.rc_context({"font.size": 8}):  # as in a report
        draw_errors(figure, PlotData.from_session(session, counted_frames(session)))
        last = figure.axes[1]
        last.set_xlim(*last.dataLim.intervalx)  # the last mark is at the very end
        figure.draw_without_rendering()
    texts = [label for label in last.get_xticklabels() if label.get_text()]
    assert max(label.get_window_extent().x1 for label in texts) <= figure.bbox.x1


@pytest.mark.parametrize(("missing_s", "broken_at"), [(0.85, []), (0.95, [150])])
def test_a_line_is_broken_where_frames_of_a_second_and_more_are_missing(missing_s: float, broken_at: list[int]) -> None:
    session = synthetic_night(300)
    session.frames.columns["utc_ns"][150:] += round(missing_s * 1e9)
    data, (axes,) = PlotData.from_session(session, counted_frames(session)), Figure().subplots(1, 1, squeeze=False)[0]
    line(axes, data, np.arange(300.0), BLUE, "")
    assert np.flatnonzero(np.isnan(axes.lines[0].get_ydata())).tolist() == broken_at


def test_a_hundred_thousand_points_make_a_small_figure() -> None:
    session = synthetic_night(300)
    drawn = PlotData.from_session(session, counted_frames(session))
    big = PlotData(
        session,
        {name: np.tile(drawn.frames[name], 330) for name in FRAME.names},
        np.tile(drawn.utc, 330),
        np.tile(drawn.good, 330),
        np.tile(drawn.unidentified, 330),
        drawn.gaps,
        drawn.exclusions,
    )
    big.frames["utc_ns"][:] = drawn.frames["utc_ns"][0] + np.arange(len(big.utc)) * 100_000_000
    svg = svg_of("errors", 4.0, lambda figure: draw_errors(figure, big))
    assert len(svg) < 600_000
