"""Raw captures of other programs as sessions: their bytes, a station file, and the UTC of their first panorama.

A capture has no host times. The session says so (``start_utc`` in stated.json): its panoramas follow from that instant
by the sensor's clock, as in a replay of the capture itself, and its report is the same.
"""

import json
from collections.abc import Mapping
from pathlib import Path

from drivers.errors import CaptureError
from drivers.mock.playback import is_session, raw_items
from gse.config.station import Station
from gse.errors import UsageError
from gse.recording.recorder import Recorder
from gse.recording.session_format import PROTOCOL, STATED, STATION
from gse.values import instant
from protocols import load_protocol


def import_capture(
    capture: Path, path: Path, station: Station, station_text: str, start_utc: str, clock_error_s: float | None
) -> int:
    """Write a new session of a capture's bytes; how many there are. CaptureError or UsageError where that cannot be."""
    if not capture.is_file():
        raise CaptureError(f"there is no capture {capture}; expected a file of received bytes")
    if is_session(capture):
        raise UsageError(f"{capture} is a session already: gse report, view and why take it as it is")
    if path.exists():
        raise UsageError(f"{path} exists; nothing is overwritten: choose another --out")
    try:
        start_ns = instant.from_text(start_utc)
    except ValueError as error:
        raise UsageError(f"--start-utc: {error}") from error
    protocol = load_protocol(station.protocol)
    items = raw_items(capture, start_ns)
    size = 0
    with Recorder(path, live=False) as recorder:
        recorder.attach(STATION, "application/yaml", station_text.encode())
        recorder.attach(PROTOCOL, "application/yaml", protocol.text.encode())
        stated = {"start_utc": start_utc, "clock_error_s": clock_error_s}
        recorder.attach(STATED, "application/json", json.dumps(stated).encode())
        for item in items:
            recorder.rx(item)  # type: ignore[arg-type]  # a capture has no events
            size += len(item.data)  # type: ignore[union-attr]
    return size


def stated_start_ns(attachments: Mapping[str, str]) -> int | None:
    """The UTC of the first panorama of an imported session; None of one that was recorded here."""
    try:
        return instant.from_text(str(json.loads(attachments.get(STATED) or "{}")["start_utc"]))
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
