"""The result of a self-check: injected against found, with a hash that anyone can make again."""

import hashlib
import json
import math
from dataclasses import dataclass
from typing import Any

SCHEMA = "gse.selfcheck/1"


@dataclass(frozen=True, slots=True)
class Row:
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
    rows: tuple[Row, ...]
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


def _row_json(row: Row) -> dict[str, Any]:
    return {
        "error": row.error,
        "quantity": row.quantity,
        "unit": row.unit,
        "injected": row.injected,
        "found": row.found if math.isfinite(row.found) else None,
        "tolerance": row.tolerance,
        "agrees": row.agrees,
    }


def _row(item: Any) -> Row:
    injected, tolerance = float(item["injected"]), float(item["tolerance"])
    found = math.nan if item["found"] is None else float(item["found"])
    return Row(str(item["error"]), str(item["quantity"]), str(item["unit"]), injected, found, tolerance)


def _canonical(document: dict[str, Any]) -> str:
    return json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
