"""Key of a session's results: what they follow from, as SHA-256."""

import hashlib
from dataclasses import astuple, dataclass


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
