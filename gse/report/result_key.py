"""Key of a session's results: what they follow from, as SHA-256."""

import functools
import hashlib
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from pathlib import Path

from drivers.host_files import only_a_file
from gse.process.installation import source_sha256
from gse.station.setup import versions

_READ_AT_ONCE = 1 << 20


@dataclass(frozen=True, slots=True)
class ResultKey:
    """Hashes in hexadecimal: of the session's bytes, of the station file in force, and of the software.

    Same key, same results, to the byte.
    """

    session_sha256: str
    station_sha256: str
    software_sha256: str

    @property
    def text(self) -> str:
        """The three as one, 64 hexadecimal digits."""
        return hashlib.sha256("\n".join(astuple(self)).encode()).hexdigest()


def session_sha256(segments: Iterable[Path]) -> str:
    """Of the files of a session, in the order of its segments."""
    whole = hashlib.sha256()
    for path in segments:
        with open(path, "rb", opener=only_a_file) as file:
            while data := file.read(_READ_AT_ONCE):
                whole.update(data)
    return whole.hexdigest()


@functools.lru_cache(maxsize=1)
def software_sha256() -> str:
    """Of the program's files and the versions of the packages that the numbers of a report depend on."""
    packages = "\n".join(f"{name} {version}" for name, version in sorted(versions().items()))
    return hashlib.sha256(f"{source_sha256()}\n{packages}".encode()).hexdigest()
