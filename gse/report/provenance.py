"""provenance.json: what a report owes to the host that made it, and not to the session."""

import functools
import json
import platform
import subprocess
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from drivers.outside_text import plain_lines
from gse.process.installation import package_version

SCHEMA = "gse.provenance/1"
_DRAWN_WITH = ("matplotlib", "jinja2", "scipy")
_GIT_WITHIN_S = 10
_MOST_LENGTH = 200

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
