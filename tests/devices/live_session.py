"""A live session as a device under test: ``gse run`` as a process of its own, on a pty."""

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from devices.patience import PATIENCE_S
from devices.terminal import Terminal

from drivers.session_file.reader import read_capture, verify
from drivers.session_file.records import EVENTS, RecordedMessage


def run_command(out: Path, *options: str) -> list[str]:
    """The command line of a session on a silent port, which begins with its session folder below ``out``.

    Its report has no plots: they take longer than the rest of such a session.
    """
    out.mkdir(parents=True)
    terminal = Terminal(out.with_name(f"{out.name}-tty"))
    command = [sys.executable, "-m", "gse", "run", "--port", str(terminal.path), "--out", str(out), "--no-plots"]
    return [*command, *options]


class LiveSession:
    """One session below ``out``, begun by anybody: what its folder says of it."""

    def __init__(self, out: Path) -> None:
        self._out = out

    @property
    def folder(self) -> Path:
        (folder,) = self._out.iterdir()
        return folder

    def status(self) -> dict[str, Any]:
        """status.json as it is now; empty before there is one."""
        try:
            return dict(json.loads((self.folder / "status.json").read_text()))
        except (OSError, ValueError):
            return {}

    def await_state(self, *states: str) -> dict[str, Any]:
        """Wait until the session is in one of these states; its status then."""
        until_s = time.monotonic() + PATIENCE_S
        while (status := self.status()).get("state") not in states:
            assert time.monotonic() < until_s, status
            time.sleep(0.02)
        return status

    def await_frames(self, count: int) -> None:
        """Wait until the session has so many frames."""
        until_s = time.monotonic() + PATIENCE_S
        while (status := self.status()).get("frames", 0) < count:
            assert time.monotonic() < until_s, status
            time.sleep(0.02)

    def events(self) -> dict[str, str]:
        """The recorded events: the last text of each kind."""
        records = read_capture(self.folder / "session.mcap")
        events = [
            record.event() for record in records if isinstance(record, RecordedMessage) and record.topic == EVENTS
        ]
        return {event.kind: event.text for event in events}

    def is_closed_judged_and_reported(self) -> bool:
        """Whether the session file is whole and closed, and its report stands beside it."""
        return verify(self.folder / "session.mcap").is_whole and all(
            (self.folder / name).stat().st_size for name in ("report.json", "report.html", "junit.xml", "frames.csv")
        )


def ended(process: "subprocess.Popen[str]") -> int:
    """Wait for the end of a process; its exit code."""
    return process.wait(PATIENCE_S)
