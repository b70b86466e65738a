"""The fingerprint that report.html carries: of which session, station file and statistics it is."""

import hashlib
import html
import json
import re
from typing import Any

from gse.report.provenance import Provenance

_META = re.compile(r'<meta name="gse-report" content="([^"]{1,2000})">')
_PROVENANCE = re.compile(r'<section id="provenance" data-json="([^"]{1,50000})">')

Fingerprint = dict[str, str | None]


def canonical(document: Any) -> str:
    """JSON with sorted keys and without spaces: one text for one content."""
    return json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)


def report_sha256(report: dict[str, Any]) -> str:
    """SHA-256 of the canonical report.json."""
    return hashlib.sha256(canonical(report).encode()).hexdigest()


def fingerprint(report: dict[str, Any]) -> Fingerprint:
    """Version, and SHA-256 of the received bytes, of the station file and of the canonical report.json."""
    session = report["session"]
    return {
        "version": session["version"],
        "raw_sha256": session["raw_sha256"],
        "station_sha256": session["station_sha256"],
        "report_sha256": report_sha256(report),
    }


def fingerprint_in(page: str) -> Fingerprint | None:
    """The fingerprint of a page; None where it has none."""
    found = _document(_META, page)
    keys = {"version", "raw_sha256", "station_sha256", "report_sha256"}
    return found if found is not None and set(found) == keys else None


def provenance_in(page: str) -> Provenance | None:
    """The provenance that a page states; None where it states none."""
    return _document(_PROVENANCE, page)


def _document(pattern: re.Pattern[str], page: str) -> dict[str, Any] | None:
    match = pattern.search(page)
    try:
        document = json.loads(html.unescape(match[1])) if match else None
    except (ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None
