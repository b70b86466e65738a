"""Live errors of the sensor's own answers: those that the report has, as they come."""

from pathlib import Path

import numpy as np
import pytest
from devices.rerun_recording import moving, rows_of

from drivers.clock import ClockReading
from gse.sessions.replay import replay_session
from gse.station.own_answers import sensor_answers
from gse.view.glance import Glance
from gse.view.own_answers import OwnAnswerErrors
from gse.view.rerun_feed import RerunFeed

SESSION = Path(__file__).parents[3] / "replays" / "golden" / "own-answers.mcap"


class Taken:
    """A listener that takes the errors of the own answers every ten frames."""

    def __init__(self, station) -> None:
        self.own = OwnAnswerErrors(station)
        self.parts = []

    def on_results(self, results, session) -> None:
        for result in results:
            self.own.take(result, session)
            if result.panorama.frame_no % 10 == 0:
                self.parts.append(self.own.errors())

    def on_event(self, event) -> None:
        pass


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    """The session, its live errors, the rows of its rerun recording, and its glance page."""
    path, listeners = tmp_path_factory.mktemp("view") / "session.rrd", []

    def listeners_of(loop, _):
        station = loop.setup.station
        listeners.extend([Taken(station), RerunFeed(station, serve=False, save_rrd=path), Glance(station)])
        return listeners

    session = replay_session(SESSION, make_listeners=listeners_of).session
    taken, feed, glance = listeners
    feed.close()
    glance.absorb(ClockReading(0, 0, "kernel PLL", True, 0.0, 0.01))
    document = glance.document(ClockReading(0, 0, "kernel PLL", True, 0.0, 0.01))
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
    assert any(axes["sensor", "dRA*"]["recent"])
