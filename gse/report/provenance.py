"""Where a report comes from: its host, the fingerprint of what it shows, and what its results follow from."""

import functools
import hashlib
import html
import json
import platform
import re
import subprocess
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from drivers.host_files import only_a_file
from drivers.outside_text import plain_lines
from gse.process.installation import package_version, source_sha256
from gse.station.setup import versions

SCHEMA = "gse.provenance/1"
_DRAWN_WITH = ("matplotlib", "jinja2", "scipy")
_GIT_WITHIN_S = 10
_MOST_LENGTH = 200
_READ_AT_ONCE = 1 << 20

Provenance = dict[str, Any]


def provenance(versions: dict[str, str], self_check: dict[str, Any] | None) -> Provenance:
    """The object of schema gse.provenance/1: program, packages, machine and last self-check, null where it never ran.

    ``versions`` are those of the packages that the numbers depend on. No time of the host is in it: a report that is
    made again on the same host has the same bytes.
    """
    drawn_with = {name: package_version(name) for name in _DRAWN_WITH}
    return {
        "schema": SCHEMA,
        "version": versions.get("gse-star-sensor"),
        "commit": _commit(),
        "packages": {**versions, **drawn_with},
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": _line(platform.platform()),
        "machine": _line(platform.machine()),
        "host": _line(platform.node()),
        "self_check": self_check,
    }


@functools.lru_cache(maxsize=1)
def _commit() -> str | None:
    """Of the checkout that the program runs from, "-dirty" where its files were changed; None without one."""
    root = Path(str(resources.files("gse"))).parent
    if not (root / ".git").exists():
        return _installed_commit()
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_GIT_WITHIN_S)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return _line(done.stdout.decode("utf-8", "replace").strip()) or None if done.returncode == 0 else None


def _installed_commit() -> str | None:
    """Where pip installed a commit it wrote down which (PEP 610)."""
    try:
        text = metadata.distribution("gse-star-sensor").read_text("direct_url.json") or "{}"
        commit = json.loads(text)["vcs_info"]["commit_id"]
    except (metadata.PackageNotFoundError, ValueError, KeyError, TypeError):
        return None
    return _line(str(commit))


def _line(text: str) -> str:
    return plain_lines(text).replace("\n", " ")[:_MOST_LENGTH]


# The fingerprint that report.html carries: of which session, station file and statistics it is.

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


@dataclass(frozen=True, slots=True)
class ResultKey:
    """Key of a session's results, to the byte: hashes in hexadecimal.

    They are of the session's bytes, of the station file in force, and of the software.
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
