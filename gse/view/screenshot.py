"""Screenshot of a recording, by rerun's viewer without a window."""

import contextlib
import subprocess
import threading
import warnings
from pathlib import Path

from rerun.experimental import ViewerClient

from gse.errors import GseError, UsageError
from gse.view.viewer import free_port, quiet_environment, rerun_program

_START_TRIES = 150
_LOAD_TRIES = 300
_TRY_EVERY_S = 0.2
_SETTLE_S = 3.0
"""Time from the last byte loaded to the last label drawn, which the viewer does not report."""

_HINT = "it needs Vulkan, for example Debian's mesa-vulkan-drivers"


def save_screenshot(recording: Path, picture: Path, size: str = "1920x1080") -> None:
    """Write a PNG of the views of a recording (.rrd); GseError if the viewer cannot draw it."""
    if picture.suffix.lower() != ".png":
        raise UsageError(f"the screenshot {picture} is written as PNG; name it .png")
    if picture.exists():
        raise UsageError(f"{picture} exists already; choose another name")
    port = free_port("127.0.0.1")
    options = ["--headless", "--window-size", size, "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"]
    viewer = subprocess.Popen(
        [str(rerun_program()), *options, str(recording)],
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
