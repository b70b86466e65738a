"""Saved view of a session in rerun: the scene of the live view, complete and with the verdict.

Its picture is drawn by rerun's viewer without a window.
"""

import contextlib
import subprocess
import threading
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.experimental import ViewerClient

from gse.catalog import StarCatalog
from gse.errors import GseError, UsageError
from gse.station.own_answers import OWN_ERROR, SensorAnswers
from gse.station.session_data import SessionData
from gse.values.axis import AXES
from gse.view.glance_word import bare_verdict
from gse.view.scene import Scene
from gse.view.verdict_text import verdict_at_end, verdict_so_far
from gse.view.viewer import free_port, quiet_environment, rerun_program


def save_view(
    session: SessionData,
    catalog: StarCatalog | None,
    path: Path,
    verdict: str,
    reasons: Sequence[str],
    *,
    own: SensorAnswers | None = None,
    metrics: str = "",
) -> None:
    """Write a recording for rerun (.rrd) of a session that has ended.

    ``own`` are the sensor's own answers, ``metrics`` is a table in Markdown. UsageError where the file cannot be
    written, or the disk did not take all of it: then no file is left.
    """
    stream = rr.RecordingStream("gse", send_properties=False)
    stream.set_sinks(rrd_file_sink(path))
    try:
        _fill(Scene(stream, session.station, catalog, live=False), session, verdict, reasons, own, metrics)
        stream.flush()
        stream.disconnect()
    except RuntimeError as error:  # rerun's only one
        path.unlink(missing_ok=True)
        raise UsageError(f"cannot write {path}: {error}; is the disk full?") from error


def _fill(
    scene: Scene, session: SessionData, verdict: str, reasons: Sequence[str], own: SensorAnswers | None, metrics: str
) -> None:
    own_errors = _own_errors(session, own)
    clock = session.clock[-1] if session.clock else None
    begun = replace(scene.so_far, link=session.link, clock=clock, clock_error_s=session.clock_error_s)
    scene.so_far = begun.with_own(own_errors)
    scene.add_own_answers(own_errors)
    scene.add_housekeeping(session.housekeeping)
    if len(session.frames):
        scene.add_whole(session.frames, session.events, session.stars.name if session.stars else str)
    else:
        for event in session.events:
            scene.event(event)
    scene.show_log()
    scene.flush()
    scene.clock(session.clock)
    text = verdict_so_far(scene.so_far)
    scene.words_for_all_times(verdict_at_end(verdict, list(reasons), text), metrics)
    if len(session.frames):
        scene.stands(int(session.frames.columns["utc_ns"][0]), bare_verdict(verdict))


def _own_errors(session: SessionData, own: SensorAnswers | None) -> NDArray[np.void]:
    """Rows of OWN_ERROR of the answers that have a panorama."""
    if own is None:
        return np.zeros(0, OWN_ERROR)
    rows = np.zeros(int(own.sent.sum()), OWN_ERROR)
    rows["utc_ns"] = session.frames.columns["utc_ns"][own.sent]
    for name in (*(axis.column for axis in AXES), "latency_ms"):
        rows[name] = getattr(own, name)[own.sent]
    return rows


def rrd_file_sink(path: Path) -> object:
    """A sink of rerun that writes a new file; UsageError where it cannot be written (rerun itself only prints it)."""
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        raise UsageError(f"{path} exists already; choose another name") from None
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
    return rr.FileSink(str(path))


_START_TRIES = 150
_LOAD_TRIES = 300
_TRY_EVERY_S = 0.2
_SETTLE_S = 3.0
"""Time from the last byte loaded to the last label drawn, which the viewer does not report."""

_PICTURE_PX = "1920x1080"
_HINT = "it needs Vulkan, for example Debian's mesa-vulkan-drivers"


def save_screenshot(recording: Path, picture: Path) -> None:
    """Write a PNG of the views of a recording (.rrd); GseError if the viewer cannot draw it."""
    if picture.suffix.lower() != ".png":
        raise UsageError(f"the screenshot {picture} is written as PNG; name it .png")
    if picture.exists():
        raise UsageError(f"{picture} exists already; choose another name")
    port = free_port("127.0.0.1")
    options = ["--headless", "--window-size", _PICTURE_PX, "--bind", "127.0.0.1", "--port", str(port)]
    viewer = subprocess.Popen(
        [str(rerun_program()), *options, "--hide-welcome-screen", str(recording)],
        env=quiet_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        client = _connect(viewer, port)
        _wait_until_loaded(client)
        client.save_screenshot(str(picture.absolute()))
    except (RuntimeError, OSError) as error:
        raise GseError(f"rerun's viewer drew no picture ({str(error).splitlines()[0]:.100}); {_HINT}") from error
    finally:
        viewer.kill()
        viewer.wait()
    if not picture.exists():
        raise GseError(f"rerun's viewer wrote no {picture}; {_HINT}")


def _connect(viewer: subprocess.Popen[bytes], port: int) -> ViewerClient:
    pause = threading.Event()
    for _ in range(_START_TRIES):
        if viewer.poll() is not None:
            raise GseError(f"rerun's viewer ended at once (exit code {viewer.returncode}); {_HINT}")
        with contextlib.suppress(Exception):  # rerun raises various kinds until the viewer listens
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
            return client
        pause.wait(_TRY_EVERY_S)
    raise GseError(f"rerun's viewer does not answer; {_HINT}")


def _wait_until_loaded(client: ViewerClient) -> None:
    pause = threading.Event()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # rerun warns that this is experimental
        for _ in range(_LOAD_TRIES):
            state = client.get_state()
            if state.recordings and not state.loading:
                break
            pause.wait(_TRY_EVERY_S)
    pause.wait(_SETTLE_S)
