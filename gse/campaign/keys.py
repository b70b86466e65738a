"""Hashes that results follow from: session, station file, software."""

import hashlib
from pathlib import Path

from gse.config.station import Station
from gse.report.result_key import session_sha256, software_sha256

__all__ = ["OWN_STATION", "session_sha256", "software_sha256", "station_sha256"]

OWN_STATION = "own"
"""In place of a hash: each session is judged with the station file that it holds."""


def station_sha256(station: Station, text: str) -> str:
    """Of a station file given for all sessions, with the catalogue and the protocol description that it names."""
    whole = hashlib.sha256(text.encode())
    for name in (station.catalog, station.protocol):
        path = Path(name)
        whole.update(b"\0" + (hashlib.sha256(path.read_bytes()).digest() if path.is_file() else name.encode()))
    return whole.hexdigest()
