"""The rerun program: found, and started without its telemetry."""

import os
import subprocess
import sys
from pathlib import Path

import rerun_cli  # type: ignore[import-untyped]

from gse.errors import GseError, UsageError


def rerun_program() -> Path:
    """The rerun binary itself; ``bin/rerun`` is a wrapper, and killing it would orphan the binary."""
    folder = Path(rerun_cli.__file__).parent
    for name in ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun"):
        if (folder / name).is_file():
            return folder / name
    raise GseError(f"no rerun program in {folder}: reinstall rerun-sdk")


def quiet_environment() -> dict[str, str]:
    """An environment without usage data from rerun: it sends none where CI is set."""
    return {**os.environ, "CI": "1", "RUST_LOG": "error"}


def open_native_viewer(url: str) -> subprocess.Popen[bytes]:
    """Open rerun's own window on a server or a recording; it outlives this process. UsageError without a screen."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError(
            "there is no screen for a window here (no DISPLAY, no WAYLAND_DISPLAY); use --web, or --view web"
        )
    return subprocess.Popen(
        [str(rerun_program()), "--connect", url, "--port", "auto", "--hide-welcome-screen"],
        env=quiet_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
