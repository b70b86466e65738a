"""The errors over time, as the live page gets them: few numbers that lose neither mean, spread nor extremes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skies.one_by_one import results_of
from skies.synthetic_night import START_NS, synthetic_frames, synthetic_night

from drivers.chunk import LinkEvent, LinkKind
from gse.station.events import StationKind
from gse.values.axis import ALL_AXES
from gse.values.instant import NS_PER_S
from gse.view.glance import CLOSE_S, MOST_BINS, MOST_MARKS, VIEWS, ErrorTrace, ErrorTraces
from gse.view.live_state import LiveState

COLUMNS = [axis.column for axis in ALL_AXES]
ALL = ("0", "0", "0", "0")


def rows_of(seconds: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Rows with the same errors (N,) on each axis, plus 1, 2, ... arcsec."""
    rows = np.zeros(len(seconds), [("utc_ns", "i8"), *((name, "f8") for name in COLUMNS)])
    rows["utc_ns"] = np.round(seconds * NS_PER_S).astype(np.int64)
    for place, name in enumerate(COLUMNS):
        rows[name] = errors + place
    return rows


def whole(trace: ErrorTrace, place: int = 0) -> np.ndarray:
    return np.array(trace.whole_after(0, 0, [place])["bins"], float)


def pooled(bins: np.ndarray) -> tuple[float, float, float, float, float]:
    """Count, mean, standard deviation and extremes of all bins together."""
    count, mean, sigma = bins[:, 1], bins[:, 2], bins[:, 3]
    of_all = np.average(mean, weights=count)
    variance = np.average(sigma**2 + mean**2, weights=count) - of_all**2
    return count.sum(), of_all, variance**0.5, bins[:, 4].min(), bins[:, 5].max()


@given(st.integers(1, 4000), st.integers(0, 10**6), st.integers(1, 40), st.sampled_from([0.1, 1.0, 7.0]))
def test_bins_hold_the_count_mean_spread_and_extremes_of_all_errors(
    count: int, seed: int, parts: int, step_s: float
) -> None:
    rng = np.random.default_rng(seed)
    seconds, errors = 1000 + step_s * np.arange(count), rng.normal(15, 3, count)
    trace = ErrorTrace(COLUMNS)
    for part in np.array_split(np.arange(count), parts):
        trace.add(rows_of(seconds[part], errors[part]))
    bins = whole(trace, 2)
    assert len(bins) <= MOST_BINS
    found = pooled(bins)
    assert found[0] == count
    expected = (errors.mean() + 2, errors.std(), errors.min() + 2, errors.max() + 2)
    assert found[1:] == pytest.approx(expected, abs=0.02)


def test_a_long_session_has_longer_bins_and_a_close_up_of_ten_minutes_by_the_second() -> None:
    trace = ErrorTrace(COLUMNS)
    for hour in range(8):
        trace.add(rows_of(3600 * hour + np.arange(3600.0), np.zeros(3600)))
    document = trace.whole_after(0, 0, [0])
    assert document["step_s"] == 32
    assert len(document["bins"]) == 900
    close = trace.close_after(0, [0])
    assert (close["step_s"], len(close["bins"])) == (1, CLOSE_S)
    assert close["bins"][-1][0] == 8 * 3600 - 1


def test_frames_without_an_answer_leave_a_gap() -> None:
    trace, errors = ErrorTrace(COLUMNS), np.ones(20)
    errors[5:15] = np.nan
    trace.add(rows_of(np.arange(20.0), errors))
    assert whole(trace)[:, 0].tolist() == [*range(5), *range(15, 20)]


def test_a_page_gets_what_it_does_not_have_yet() -> None:
    trace = ErrorTrace(COLUMNS)
    trace.add(rows_of(np.arange(10.0), np.zeros(10)))
    trace.add(rows_of(np.arange(9.5, 12.0, 0.5), np.ones(5)))
    news = trace.close_after(9, [0, 1])
    assert not news["anew"]
    assert [row[:3] for row in news["bins"]] == [[9, 2, 0.5], [10, 2, 1.0], [11, 2, 1.0]]
    assert trace.whole_after(2, 9, [0])["anew"]  # of bins of another length
    trace.add(rows_of(np.arange(3.0), np.zeros(3)))  # the clock was set back
    assert trace.close_after(11, [0])["anew"]
    assert [row[0] for row in trace.close_after(11, [0])["bins"]] == [0, 1, 2]


def test_a_request_names_view_subject_and_what_the_page_has() -> None:
    session = synthetic_night(20)
    live, limits = LiveState(session.station), session.station.limits
    traces = live.add(ErrorTraces())
    frames = list(synthetic_frames(20, trouble=False))
    for frame in frames:
        live.on_results(results_of([frame]), session)
    for view, axes in VIEWS.items():
        document = traces.document((view, "onboard", *ALL), limits)
        assert document is not None
        assert [axis["name"] for axis in document["axes"]] == [axis.label for axis in axes]
        assert len(document["close"]["bins"][0]) == 2 + 4 * len(axes)
    assert document["axes"][0]["limit_arcsec"] == limits.d_roll_arcsec
    errors = [frame.attitude_error.d_ra_cosde_arcsec for frame in frames if frame.attitude_error]
    sky = traces.document(("sky", "own", *ALL), limits)
    assert sky is not None
    assert sky["subject"] == "onboard"  # the sensor sends no answers
    assert sum(row[1] * row[2] for row in sky["whole"]["bins"]) == pytest.approx(sum(errors), abs=0.2)


@pytest.mark.parametrize("request_", ["", "sky", "sky onboard 1 2 3", "moon onboard 0 0 0 0", "sky onboard x 0 0 0"])
def test_another_request_gets_nothing(request_: str) -> None:
    assert ErrorTraces().document(request_.split(), synthetic_night(1).station.limits) is None


def test_notes_clouds_and_jumps_are_marked_at_their_times_and_the_latest_are_kept() -> None:
    session = synthetic_night(1)
    live = LiveState(session.station)
    traces = live.add(ErrorTraces())
    kinds = (StationKind.NOTE, StationKind.CLOUDED, StationKind.CLOCK_STEP, LinkKind.STREAMING, LinkKind.LOST)
    for second, kind in enumerate(kinds):
        live.on_event(LinkEvent(START_NS + second * NS_PER_S, 0, kind, f"text {second}"))
    marks = traces.document(("sky", "onboard", *ALL), session.station.limits)["marks"]
    assert [mark[2:] for mark in marks] == [
        (kind, f"text {second}") for second, kind in enumerate(kinds) if kind != LinkKind.STREAMING
    ]
    assert marks[1][1] == pytest.approx(START_NS / NS_PER_S + 1, abs=0.1)
    (last,) = traces.document(("sky", "onboard", "0", "0", "0", "3"), session.station.limits)["marks"]
    assert last[3] == "text 4"
    for number in range(MOST_MARKS):
        live.on_event(LinkEvent(START_NS, 0, StationKind.NOTE, f"note {number}"))
    marks = traces.document(("sky", "onboard", *ALL), session.station.limits)["marks"]
    assert (len(marks), marks[-1][3]) == (MOST_MARKS, f"note {MOST_MARKS - 1}")
