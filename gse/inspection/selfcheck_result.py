"""The result of a self-check: injected against found, with a hash that anyone can make again."""

import contextlib
import hashlib
import json
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from platformdirs import user_state_path

from gse.process.installation import source_sha256
from gse.station.setup import versions

SCHEMA = "gse.selfcheck/1"


@dataclass(frozen=True, slots=True)
class CheckedRow:
    """One quantity of one made session: what was injected, what the station found, and how far they may differ."""

    error: str
    quantity: str
    unit: str
    injected: float
    found: float
    tolerance: float

    @property
    def agrees(self) -> bool:
        """Whether the station found what was injected; never where it found nothing."""
        return abs(self.found - self.injected) <= self.tolerance


@dataclass(frozen=True, slots=True)
class SelfCheckResult:
    """A self-check of one installation.

    ``source_sha256`` is of the program's own files, ``packages`` are the versions that the numbers depend on, ``utc``
    is when the host ran it, which the hash leaves out: the same installation gives the same hash.
    """

    version: str
    source_sha256: str
    packages: dict[str, str]
    rows: tuple[CheckedRow, ...]
    utc: str

    @property
    def agrees(self) -> bool:
        """Whether every row does."""
        return bool(self.rows) and all(row.agrees for row in self.rows)

    @property
    def sha256(self) -> str:
        """SHA-256 of the canonical JSON of all but ``utc``."""
        return hashlib.sha256(_canonical(self._hashed()).encode()).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """The object of schema gse.selfcheck/1; ``from_json`` gives an equal one."""
        return {**self._hashed(), "utc": self.utc, "sha256": self.sha256}

    def _hashed(self) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "version": self.version,
            "source_sha256": self.source_sha256,
            "packages": self.packages,
            "agrees": self.agrees,
            "rows": [_row_json(row) for row in self.rows],
        }


def from_json(document: Any) -> SelfCheckResult:
    """The result of a JSON object; ValueError where it is none, or not what its hash was made of."""
    try:
        rows = tuple(_row(item) for item in document["rows"])
        texts = [str(document[name]) for name in ("version", "source_sha256", "utc")]
        packages = {str(name): str(version) for name, version in document["packages"].items()}
        result = SelfCheckResult(texts[0], texts[1], packages, rows, texts[2])
        expected = document["sha256"]
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"no object of schema {SCHEMA}: {error!r}") from error
    if result.sha256 != expected:
        raise ValueError("its hash is not that of its content")
    return result


def _row_json(row: CheckedRow) -> dict[str, Any]:
    return {
        "error": row.error,
        "quantity": row.quantity,
        "unit": row.unit,
        "injected": row.injected,
        "found": row.found if math.isfinite(row.found) else None,
        "tolerance": row.tolerance,
        "agrees": row.agrees,
    }


def _row(item: Any) -> CheckedRow:
    injected, tolerance = float(item["injected"]), float(item["tolerance"])
    found = math.nan if item["found"] is None else float(item["found"])
    return CheckedRow(str(item["error"]), str(item["quantity"]), str(item["unit"]), injected, found, tolerance)


def _canonical(document: dict[str, Any]) -> str:
    return json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


# The last self-check of this installation, kept in the user's state folder for the reports to come.

_MAX_BYTES = 1_000_000
"""A result takes 10 kB; anything bigger is another file."""


def last_result() -> SelfCheckResult | None:
    """The last self-check of this very installation; None where it never ran, or its file was changed since."""
    try:
        with _path(source_sha256()).open("rb") as file:
            result = from_json(json.loads(file.read(_MAX_BYTES)))
    except (OSError, ValueError, RecursionError):
        return None
    is_this = result.source_sha256 == source_sha256() and result.packages == versions()
    return result if is_this else None


def keep_result(result: SelfCheckResult) -> Path:
    """Keep a result as the last of its installation; OSError where the folder cannot be written."""
    path = _path(result.source_sha256)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, new = tempfile.mkstemp(dir=path.parent, suffix=".new")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump(result.to_json(), file, indent=1)
        os.replace(new, path)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(new)
        raise
    return path


def _path(of_source: str) -> Path:
    """One file for each state of the program's files: another installation of the same user has its own."""
    return user_state_path("gse") / f"selfcheck-{of_source[:16]}.json"
