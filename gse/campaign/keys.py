"""Hashes that results follow from: session, station file, software."""

import functools
import hashlib
from collections.abc import Iterable
from pathlib import Path

from gse.config.station import Station
from gse.selfcheck.installation import source_sha256
from gse.station.setup import versions

OWN_STATION = "own"
"""In place of a hash: each session is judged with the station file that it holds."""
_READ_AT_ONCE = 1 << 20


def session_sha256(segments: Iterable[Path]) -> str:
    """Of the files of a session, in the order of its segments."""
    whole = hashlib.sha256()
    for path in segments:
        with path.open("rb") as file:
            while data := file.read(_READ_AT_ONCE):
                whole.update(data)
    return whole.hexdigest()


def station_sha256(station: Station, text: str) -> str:
    """Of a station file given for all sessions, with the catalogue and the protocol description that it names."""
    whole = hashlib.sha256(text.encode())
    for name in (station.catalog, station.protocol):
        path = Path(name)
        whole.update(b"\0" + (hashlib.sha256(path.read_bytes()).digest() if path.is_file() else name.encode()))
    return whole.hexdigest()


@functools.lru_cache(maxsize=1)
def software_sha256() -> str:
    """Of the program's files and the versions of the packages that the numbers of a report depend on."""
    packages = "\n".join(f"{name} {version}" for name, version in sorted(versions().items()))
    return hashlib.sha256(f"{source_sha256()}\n{packages}".encode()).hexdigest()
