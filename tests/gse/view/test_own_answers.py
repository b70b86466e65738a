"""Live errors of the sensor's own answers: those that the report has, as they come."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from devices.rerun_recording import moving, rows_of

from drivers.clock import ClockReading
from gse.sessions.replay import replay_session
from gse.station.own_answers import NewOwnErrors, sensor_answers
from gse.station.session_tables import AttitudeTable, FrameTable
from gse.view.glance import Glance
from gse.view.live_state import LiveState
from gse.view.rerun_feed import RerunFeed

SESSION = Path(__file__).parents[3] / "replays" / "golden" / "own-answers.mcap"


class Taken:
    """A display that keeps the errors of the own answers."""

    def __init__(self) -> None:
        self.parts = []

    def on_results(self, results, so_far) -> None:
        self.parts.append(so_far.own_errors)

    def on_event(self, event, so_far) -> None:
        pass


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    """The session, its live errors, the rows of its rerun recording, and its glance page."""
    path, shown = tmp_path_factory.mktemp("view") / "session.rrd", []

    def listeners_of(loop):
        live = LiveState(loop.setup.station)
        loop.most_at_once = 7
        feed = live.add(RerunFeed(live, serve=False, save_rrd=path))
        shown.extend([live.add(Taken()), feed, Glance(live)])
        return [live]

    session = replay_session(SESSION, make_listeners=listeners_of).session
    taken, feed, glance = shown
    feed.close()
    glance.absorb(ClockReading(0, 0, "kernel PLL", True, 0.0, 0.01))
    document = glance.document(ClockReading(0, 0, "kernel PLL", True, 0.0, 0.01))
    document["errors"] = glance.errors(("sky", "own", "0", "0", "0", "0"))
    return session, np.concatenate(taken.parts), rows_of(path), document


def test_live_errors_are_those_of_the_report(watched):
    session, live, _, _ = watched
    frames, judged = session.frames.columns, sensor_answers(session)
    assert len(live) > 0.9 * len(frames)
    rows = np.searchsorted(frames["utc_ns"], live["utc_ns"])
    assert (frames["utc_ns"][rows] == live["utc_ns"]).all()
    for name in ("d_ra_cosde_arcsec", "d_de_arcsec", "d_roll_arcsec", "latency_ms"):
        assert np.allclose(live[name], getattr(judged, name)[rows], rtol=0, atol=1e-6, equal_nan=True), name
    assert np.isfinite(live["d_ra_cosde_arcsec"]).sum() > 0.9 * len(live)


@pytest.mark.parametrize("ahead", [-3, 0, 3])
def test_an_answer_finds_its_panorama_whichever_of_them_comes_first(watched, ahead):
    session, _, _, _ = watched
    frames, answers = session.frames.columns.rows(), session.sensor_attitudes.columns
    growing, new = replace(session, frames=FrameTable()), NewOwnErrors()
    parts = []
    for k in range(-3, 63):  # the last answers come after the last panorama, or the other way round
        if 0 <= k < 60:
            growing.frames.extend(frames[k : k + 1].copy(), session.frames.matches[:0], session.frames.others[:0])
        growing.sensor_attitudes = AttitudeTable.from_rows(answers[: max(0, min(k + 1 + ahead, 60))])
        parts.append(new.take(growing))
    found, judged = np.concatenate(parts), sensor_answers(session)
    assert found["utc_ns"].tolist() == frames["utc_ns"][:60].tolist()
    assert np.array_equal(found["d_de_arcsec"], judged.d_de_arcsec[:60], equal_nan=True)


def test_rerun_has_a_series_of_the_sensor_beside_that_of_the_panoramas(watched):
    _, live, rows, _ = watched
    for path, name in (("/sensor/d_ra", "d_ra_cosde_arcsec"), ("/sensor/roll", "d_roll_arcsec")):
        series = moving(rows[path])
        shown = {row["utc"]: row["Scalars:scalars"][0] for row in series}
        expected = np.array([shown[utc_ns] for utc_ns in live["utc_ns"].tolist()])
        assert np.allclose(expected, live[name], rtol=0, atol=0.0006, equal_nan=True)


def test_the_glance_page_has_axes_of_both_subjects(watched):
    session, _, _, document = watched
    axes = {(axis["subject"], axis["name"]): axis for axis in document["axes"]}
    assert set(axes) == {(subject, name) for subject in ("onboard", "sensor") for name in ("dRA*", "dDE")}
    mean = np.nanmean(sensor_answers(session).d_de_arcsec)
    assert abs(axes["sensor", "dDE"]["mean_arcsec"] - mean) < 1.0
    assert document["errors"]["subject"] == "own"
    bins = np.array(document["errors"]["whole"]["bins"], float)
    assert abs(np.average(bins[:, 6], weights=bins[:, 1]) - mean) < 1.0
