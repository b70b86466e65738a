"""A recorded session made ready to be played to a flight computer (gse/simulator/played_session.py)."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drivers.clock import read_clock
from drivers.faults import inject, parse_faults
from drivers.mock_ports import Item
from drivers.playback import is_session, session_items
from gse.config.station import Port
from gse.errors import UsageError
from gse.recording.session_format import read_attachments
from gse.sessions.imported import stated_start_ns
from gse.sessions.replay import station_in_force
from gse.simulator.played_session import ShiftedFrames, shifted
from gse.station.setup import addressed
from gse.values.sensor_time import time_of
from protocols import load_protocol, parse_protocol


@dataclass(frozen=True, slots=True)
class PlayedSession:
    """The items of a session, the port that it was recorded from, and what makes its frames anew, if anything does."""

    items: Iterator[Item]
    port: Port
    frames: ShiftedFrames | None
    words: str


def played_session(path: Path, *, is_shifted: bool, faults: str | None, seed: int) -> PlayedSession:
    """A session to be played; UsageError where it holds no pace or no description, CaptureError where it is none."""
    if not is_session(path):
        raise UsageError(f"{path} is not a session; a raw capture has no times of its bytes and cannot be played")
    attachments = read_attachments(path)
    if stated_start_ns(attachments) is not None:
        raise UsageError(f"{path} was imported from a capture, which has no times of its bytes: it cannot be played")
    force = station_in_force(attachments, lambda recorded: recorded)
    station, text = force.station, force.protocol_text
    protocol = load_protocol(station.protocol) if text is None else parse_protocol(text, "the session's protocol.yaml")
    items = session_items(path)
    frames = None
    words = "its bytes as recorded, which bear no mark of test data"
    if is_shifted:
        time = time_of(station.sensor.time, protocol)
        frames = ShiftedFrames(addressed(protocol, station), time, lambda: read_clock().utc_ns)
        items = shifted(items, frames)
        marked = f"marked by {frames.mark}" if frames.mark else "with no mark: the format has no room for one"
        words = f"its frames made anew for now, {marked}"
    start = {"frame_start": word.hex()} if (word := protocol.frame_layout.sync_word) else {}
    chosen = parse_faults({"faults": faults or "", "seed": str(seed), **start})
    if chosen is not None:
        items = inject(items, chosen, station.port.baudrate)
    return PlayedSession(items, station.port, frames, words)
