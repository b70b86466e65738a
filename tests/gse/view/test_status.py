"""The status line, on a terminal and where there is none."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from skies.one_by_one import results_of
from skies.synthetic_night import synthetic_frames, synthetic_night

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading
from gse.station.events import StationKind
from gse.station.own_answers import OWN_ERROR
from gse.station.results import AnswerCheck, LinkCounters, Status
from gse.values.limits import Limits
from gse.view.live_state import ErrorsSoFar, LiveState, SessionSoFar
from gse.view.status import Announcer, StatusLine
from gse.view.verdict_text import verdict_so_far
from protocols.description import TimeDescription


def told(session, frames, *, folder: Path | None = None, terminal: bool = False, width: int = 200) -> str:
    """All that a status line writes about some frames."""
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=terminal, width=width, highlight=False)
    live = LiveState(session.station)
    with live.add(StatusLine(live, folder, console)):
        for event in session.events:
            live.on_event(event)
        if shown := list(frames):
            live.on_results(results_of(shown), session)
    return screen.getvalue()


@pytest.fixture
def session():
    return synthetic_night(20)


def test_without_a_terminal_a_line_comes_every_ten_seconds_of_the_data(session) -> None:
    lines = [line for line in told(session, synthetic_frames(301)).splitlines() if "identified" in line]
    assert [line[:9] for line in lines] == ["18:30:00Z", "18:30:10Z", "18:30:20Z", "18:30:30Z"]


def test_the_line_says_all_that_matters(session, tmp_path: Path) -> None:
    text = told(session, synthetic_frames(301), folder=tmp_path)
    line = [line for line in text.splitlines() if "identified" in line][-1]
    for words in ("link closed", "301 frames at 10.0/s", "98.0 % identified", "dRA* +6.", "dDE -3.", "NEA ", "GB free"):
        assert words in line
    assert "clock within 1 ms" in line


@pytest.mark.parametrize(("late_s", "style"), [(0.0123, ""), (-18.0, "bold red")])
def test_an_absolute_clock_of_the_sensor_is_shown_against_that_of_the_host(session, late_s, style) -> None:
    live = LiveState(session.station)
    line = StatusLine(live, console=Console(file=io.StringIO(), width=250))
    live.add(line)
    shown = list(synthetic_frames(20))
    live.on_results(results_of(shown), session)
    assert "sensor clock" not in line.line().plain
    session.time = TimeDescription(scale="gps")
    frames = session.frames.columns
    frames["host_utc_ns"] = frames["utc_ns"] + np.round((frames["exposure_s"] / 2 + late_s) * 1e9).astype(np.int64)
    frames["host_utc_ns"][:-1] += 5_000_000
    live.on_results(results_of(shown), session)
    said = f"host - sensor clock {late_s:+.3f} s"
    assert said in line.line().plain
    assert said in verdict_so_far(live.so_far)
    assert [span.style for span in line.line().spans if line.line().plain[span.start : span.end].strip() == said] == [
        style
    ] * bool(style)


@pytest.mark.parametrize("width", [80, 66, 50])
def test_a_narrow_terminal_is_not_exceeded_and_shows_what_matters_most(session, tmp_path: Path, width: int) -> None:
    session.clock = [ClockReading(0, 0, "kernel PLL", True, 0.0, 0.001)]
    text = told(session, synthetic_frames(301), folder=tmp_path, width=width)
    line = [line for line in text.splitlines() if "link" in line and "dRA*" in line][-1]
    assert len(line) <= width
    assert "dDE" in line
    assert ("identified" in line) == (width >= 66)


def test_on_a_narrow_terminal_trouble_comes_before_figures(session) -> None:
    session.clock = [ClockReading(0, 0, "unsynchronised", False, 0.0, 16.0)]
    line = [line for line in told(session, synthetic_frames(301), width=60).splitlines() if "link" in line][-1]
    assert "clock NOT synchronised" in line
    assert len(line) <= 60


def test_a_session_folder_that_is_gone_is_said_and_ends_nothing(session, tmp_path: Path) -> None:
    text = told(session, synthetic_frames(301), folder=tmp_path / "removed")
    assert "disk: No such file or directory" in text.splitlines()[-1]


def test_a_sky_without_answers_is_shouted_and_forgotten_when_they_come_again(session) -> None:
    frames = list(synthetic_frames(400, trouble=False))
    clouded = [
        replace(frame, status=Status.TOO_FEW, attitude_error=None) if 80 <= number < 210 else frame
        for number, frame in enumerate(frames)
    ]
    lines = [line for line in told(session, clouded).splitlines() if "identified" in line]
    assert ["NO ANSWER" in line for line in lines] == [False, True, True, False]
    assert "NO ANSWER for 12 s, " in lines[2]
    so_far = SessionSoFar(session.station.limits)
    for frame in clouded[:150]:
        so_far = so_far.with_rows(results_of([frame]).rows)
    assert verdict_so_far(so_far).startswith("# Running: NO ANSWER for 7 s, ")
    cloud = LinkEvent(so_far.utc_ns, 0, "CLOUDED", "stars are 3.0 mag too faint")
    assert verdict_so_far(so_far.with_event(cloud)).startswith("# Running: CLOUD for 7 s, ")


def test_lost_frames_stand_beside_those_that_came(session) -> None:
    session.link.frames_lost = 0
    assert " lost" not in told(session, synthetic_frames(1))
    session.link.frames_lost = 7
    assert "1 frame  7 lost  " in told(session, synthetic_frames(1))


def test_a_replay_says_how_far_it_is_beside_what_it_shows(session) -> None:
    console = Console(file=io.StringIO(), width=80)
    live = LiveState(session.station)
    status = StatusLine(live, None, console, progress=lambda: "43 % done, 12 s left")
    for event in session.events:
        live.on_event(event)
    live.on_event(LinkEvent(0, 0, LinkKind.STREAMING, "valid frames come"))
    live.on_results(results_of(list(synthetic_frames(301, trouble=False))), session)
    line = status.line().plain
    assert len(line) <= 80
    for words in ("43 % done, 12 s left", "100.0 % identified", "dRA*", "dDE"):
        assert words in line


def test_an_unsynchronised_clock_is_shouted(session) -> None:
    session.clock = [ClockReading(0, 0, "unsynchronised", False, 0.0, 16.0)]
    assert "clock NOT synchronised" in told(session, synthetic_frames(1))


def test_the_verdict_panel_says_once_that_the_clock_is_not_synchronised(session) -> None:
    reading = ClockReading(0, 0, "unsynchronised", False, 0.0, 16.0)
    text = verdict_so_far(SessionSoFar(session.station.limits, clock=reading))
    assert "- clock: NOT synchronised" in text.splitlines()


def test_events_are_told_once_and_then_counted(session) -> None:
    session.events = [LinkEvent(0, 0, "LOST", f"unplugged {n}") for n in range(5)]
    text = told(session, [])
    assert text.count("unplugged") == 1
    assert "not shown: LOST 4" in text


def test_on_a_terminal_the_line_is_renewed_and_taken_away(session) -> None:
    session.events = []
    text = told(session, synthetic_frames(301), terminal=True)
    assert text.count("identified") < 30, "not for each of the 301 frames"
    assert text.endswith("\x1b[2K")


def test_before_the_first_frame_nothing_is_claimed(session) -> None:
    line = StatusLine(LiveState(session.station)).line().plain
    assert line == "no link  0 frames  - identified  dRA* -  dDE -  NEA -, - arcsec  clock not read"


def test_mean_and_spread_so_far_are_those_of_numpy() -> None:
    values = [1.0, 4.0, -2.0, 7.5]
    first = ErrorsSoFar().with_errors(np.array(values[:1]))
    errors = first.with_errors(np.array(values[1:]))
    assert errors.mean == pytest.approx(2.625)
    assert errors.std == pytest.approx(np.std(values, ddof=1))
    assert errors.nea == pytest.approx(((9 + 36 + 90.25) / 6) ** 0.5)


def test_running_figures_count_answers_limits_and_false_ones(session) -> None:
    so_far = SessionSoFar(session.station.limits)
    frames = list(synthetic_frames(422))
    for frame in frames:
        so_far = so_far.with_rows(results_of([frame]).rows)
    assert so_far.frames == 422
    assert so_far.identified == pytest.approx(1 - 8 / 422)
    assert so_far.d_ra.n - so_far.inside == 2
    assert so_far.false_answers == sum(frame.answer_check is AnswerCheck.FALSE for frame in frames) == 0
    assert so_far.frames_per_s == pytest.approx(10)


@pytest.mark.parametrize("batch", [1, 30])
def test_frames_without_sky_do_not_count_as_missing_answers(session, batch: int) -> None:
    so_far = SessionSoFar(session.station.limits)
    frames = [
        replace(frame, status=Status.TOO_FEW, attitude_error=None) if 60 <= number < 360 else frame
        for number, frame in enumerate(synthetic_frames(600, trouble=False))
    ]
    for first in range(0, len(frames), batch):
        if first == 120:  # the sky is found out seconds after it has gone, and after it has come back
            so_far = so_far.with_event(LinkEvent(0, 0, StationKind.NO_STARS, "lens cap"))
            assert so_far.outside == ("availability 50.0 % (limit 95 %)",), "six seconds are no stretch yet"
        if first == 390:
            so_far = so_far.with_event(LinkEvent(0, 0, StationKind.CLEAR, "stars are seen"))
        so_far = so_far.with_rows(results_of(frames[first : first + batch]).rows)
    assert so_far.without_sky == 300
    assert so_far.identified == 1
    assert so_far.outside == ()


def test_a_day_does_not_count_where_the_first_answer_comes_after_the_first_star(session) -> None:
    so_far = SessionSoFar(session.station.limits).with_event(LinkEvent(0, 0, StationKind.DAYLIGHT, "Sun 1 deg up"))
    frames = list(synthetic_frames(310, trouble=False))
    failing = [replace(frame, status=Status.TOO_FEW, attitude_error=None) for frame in frames[:210]]
    so_far = so_far.with_rows(results_of(failing[:200]).rows)
    so_far = so_far.with_event(LinkEvent(0, 0, StationKind.CLEAR, "5 of 16 expected stars are seen"))
    so_far = so_far.with_rows(results_of([*failing[200:], *frames[210:]]).rows)
    assert so_far.without_sky == 200
    assert so_far.identified == pytest.approx(100 / 110)


def test_in_twilight_no_frame_without_an_answer_counts_though_every_second_one_has_one(session) -> None:
    so_far = SessionSoFar(session.station.limits).with_event(LinkEvent(0, 0, StationKind.DAYLIGHT, "Sun 6 deg down"))
    for number, frame in enumerate(synthetic_frames(200, trouble=False)):
        shown = frame if number % 2 else replace(frame, status=Status.TOO_FEW, attitude_error=None)
        so_far = so_far.with_rows(results_of([shown]).rows)
    assert (so_far.without_sky, so_far.identified, so_far.outside) == (100, 1.0, ())


def test_frames_without_an_answer_below_a_clear_sky_count(session) -> None:
    so_far = SessionSoFar(session.station.limits)
    frames = list(synthetic_frames(200, trouble=False))
    failing = [replace(frame, status=Status.TOO_FEW, attitude_error=None) for frame in frames[100:]]
    so_far = so_far.with_event(LinkEvent(0, 0, StationKind.CLEAR, "stars are seen"))
    so_far = so_far.with_rows(results_of([*frames[:100], *failing]).rows)
    assert so_far.outside == ("availability 50.0 % (limit 95 %)",)


def test_lost_frames_make_the_verdict_panel_bad_though_all_that_came_were_identified(session) -> None:
    so_far = SessionSoFar(session.station.limits)
    for frame in synthetic_frames(90, trouble=False):
        so_far = so_far.with_rows(results_of([frame]).rows)
    assert verdict_so_far(so_far).startswith("# Running: inside the limits")
    text = verdict_so_far(replace(so_far, link=LinkCounters(frames_lost=10)))
    assert text.startswith("# Running: OUTSIDE the limits")
    assert "frames lost: **10**" in text


@pytest.mark.parametrize(
    ("d_ra_arcsec", "d_de_arcsec", "words"),
    [
        (59.0, -59.0, ()),
        (61.0, 59.0, ("mean |sensor dRA*| 61.0 arcsec (limit 60)",)),
        (-59.0, 61.0, ("mean |sensor dDE| 61.0 arcsec (limit 60)",)),
    ],
)
def test_either_axis_of_the_sensors_own_answers_is_held_against_its_limit(d_ra_arcsec, d_de_arcsec, words):
    so_far = SessionSoFar(Limits())
    errors = np.zeros(5, dtype=OWN_ERROR)
    errors["d_ra_cosde_arcsec"], errors["d_de_arcsec"] = d_ra_arcsec, d_de_arcsec
    errors["d_ra_cosde_arcsec"][2] = errors["d_de_arcsec"][2] = np.nan
    assert so_far.with_own(errors).outside == words


# The operator is told of events


def test_each_kind_of_event_is_said_once_and_then_counted() -> None:
    said: list[str] = []
    teller = Announcer(said.append)
    for number in range(5):
        teller.on_event(LinkEvent(1_774_000_000_000_000_000 + number, 0, "LOST", "the port is gone"))
        teller.on_event(LinkEvent(1_774_000_000_000_000_000 + number, 0, "STREAMING", "valid frames come"))
    teller.on_event(LinkEvent(0, 0, "CLOCK_STEP", "the clock stepped"))
    assert said == [
        "2026-03-20T09:46:40.0Z LOST: the port is gone",
        "2026-03-20T09:46:40.0Z STREAMING: valid frames come",
        "before the first byte CLOCK_STEP: the clock stepped",
    ]
    teller.conclude()
    assert said[3:] == ["events that came again, not shown: LOST 4"]


def test_a_second_full_disk_is_said_like_the_first() -> None:
    said: list[str] = []
    teller = Announcer(said.append)
    for _ in range(2):
        teller.on_event(LinkEvent(0, 0, "RECORDER_REFUSED", "the disk is full"))
        teller.on_event(LinkEvent(0, 0, "RECORDER_RECOVERED", "it takes bytes again"))
    teller.conclude()
    assert len(said) == 4


def test_one_repetition_is_counted_and_a_single_event_is_not() -> None:
    said: list[str] = []
    teller = Announcer(said.append)
    for kind, count in (("LOST", 2), ("FROZEN", 1), ("BACKLOG", 3)):
        for number in range(count):
            teller.on_event(LinkEvent(1, 0, kind, f"{kind} {number}"))
    teller.conclude()
    assert said[-1] == "events that came again, not shown: LOST 1, BACKLOG 2"
