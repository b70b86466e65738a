"""The last self-check of this installation, kept in the user's state folder for the reports to come."""

import contextlib
import json
import os
import tempfile
from pathlib import Path

from platformdirs import user_state_path

from gse.process.installation import source_sha256
from gse.selfcheck.result import SelfCheckResult, from_json
from gse.station.setup import versions

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
