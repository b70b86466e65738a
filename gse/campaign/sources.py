"""Sources of a campaign: the sessions below folders, globs and URLs."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from drivers.outside_text import is_plain, plain_line
from gse.campaign.storage import explained, find_files, open_storage, protocol_of
from gse.errors import UsageError

MOST_SESSIONS = 1_000_000
_SEGMENT = re.compile(r"(.+)\.part[1-9]\d{0,3}\.mcap")
_GLOB = re.compile(r"[*?\[]")


@dataclass(frozen=True, slots=True, order=True)
class SessionSource:
    """A session as it lies: URL of its first segment, those of all, and what tells whether it changed.

    ``state`` is size and time of change of each segment.
    """

    url: str
    segments: tuple[str, ...]
    size_bytes: int
    state: str


def find_sources(wanted: Iterable[str]) -> list[SessionSource]:
    """The sessions below paths, globs and URLs, each once, in the order of their URLs; UsageError where there are none.

    A folder is searched with its subfolders. The further segments of a session belong to its first.
    """
    found = {source.url: source for url in wanted for source in _sources_of(url)}
    for url in found:
        if not is_plain(url):
            raise UsageError(f"'{plain_line(url):.200}' has characters that cannot be shown; rename the file")
    if len(found) > MOST_SESSIONS:
        raise UsageError(f"{len(found)} sessions are more than the {MOST_SESSIONS} of one campaign; divide it")
    return sorted(found.values())


def _sources_of(url: str) -> Iterator[SessionSource]:
    fs, path = open_storage(url)
    try:
        files = _files(fs, path, is_glob=bool(_GLOB.search(path)) and not fs.exists(path))
    except Exception as error:
        raise explained(error, url) from error
    sessions: dict[str, list[str]] = {}
    for name in sorted(files, key=_place):
        segment = _SEGMENT.fullmatch(name)
        first = f"{segment[1]}.mcap" if segment else name
        sessions.setdefault(first if first in files else name, []).append(name)
    if not sessions:
        raise UsageError(f"there is no session (.mcap) in {url}")
    for first, segments in sessions.items():
        infos = [files[name] for name in segments]
        yield SessionSource(
            _url(first, url),
            tuple(_url(name, url) for name in segments),
            sum(int(info.get("size") or 0) for info in infos),
            ";".join(_state(info) for info in infos),
        )


def _files(fs: Any, path: str, *, is_glob: bool) -> dict[str, dict[str, Any]]:
    """The session files of a path with what the storage tells of each, by name."""
    matched = fs.glob(path, detail=True) if is_glob else {path: fs.info(path)}
    files: dict[str, dict[str, Any]] = {}
    for name, info in matched.items():
        if info["type"] == "directory":
            below = find_files(fs, name)
            files |= {path: info for path, info in below.items() if path.endswith(".mcap")}
        else:
            files[name] = info
            files |= _further_segments(fs, name)
    return files


def _further_segments(fs: Any, first: str) -> dict[str, dict[str, Any]]:
    if not first.endswith(".mcap") or _SEGMENT.fullmatch(first):
        return {}
    found: dict[str, dict[str, Any]] = fs.glob(f"{_plain(first.removesuffix('.mcap'))}.part*.mcap", detail=True)
    return {name: info for name, info in found.items() if _SEGMENT.fullmatch(name)}


def _plain(text: str) -> str:
    """A path in which no sign is one of a glob."""
    return _GLOB.sub(lambda sign: f"[{sign[0]}]", text)


def _place(name: str) -> tuple[str, int]:
    """Segments in their order: part10 after part2."""
    segment = _SEGMENT.fullmatch(name)
    return (f"{segment[1]}.mcap", int(name.rsplit(".part", 1)[1].split(".")[0])) if segment else (name, 1)


def _url(name: str, asked: str) -> str:
    if protocol_of(asked) == "file":
        return str(Path(name).absolute())
    host = asked.split("://", 1)[1].split("/", 1)[0]
    return f"s3://{name}" if protocol_of(asked) == "s3" else f"{asked.split('://', 1)[0]}://{host}/{name.lstrip('/')}"


def _state(info: dict[str, Any]) -> str:
    changed = info.get("mtime") or ""
    if isinstance(changed, datetime):
        changed = changed.isoformat()
    return f"{info.get('size')} {changed}".strip()
