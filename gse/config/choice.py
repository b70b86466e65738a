"""The station and the identifier under test that somebody chooses: by a file, by a name, by a program.

A choice also changes the text of the station file, for the session file: its other lines and comments stay.
"""

import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import get_args

import yaml

from gse.config.station import BUILT_IN_TEXT, Station, parse_recorded, parse_station, read_station
from gse.errors import UsageError
from gse.values.identifier_options import PLUG_KEYS, Algorithm
from protocols.yaml_text import load_document

StationText = tuple[Station, str]
"""A station and the text of its file."""

ALGORITHMS = tuple(name for name in get_args(Algorithm) if name != "external")

_PLUGS = ("command:", "library:", "entry-point:")


def change_to(
    path: Path | None, algorithm: str | None = None, address: int | None = None
) -> Callable[[StationText], StationText]:
    """What a replay does to the recorded station: another file in its place, another identifier under test.

    With ``address`` it judges another sensor on the same line.

    The file is read here, once: results, and the key that they are kept under, follow from the same text.
    """
    given = station_of(path) if path else None

    def change(recorded: StationText) -> StationText:
        return with_address(*with_identifier(*(given or recorded), algorithm), address)

    return change


def station_of(path: Path | None) -> StationText:
    """The station of a file, or the built-in one, with its text."""
    if path is None:
        return parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT
    station, text = read_station(path)
    return _beside(station, path), text


def with_url(station: Station, text: str, url: str) -> StationText:
    """The station on another port, and its text."""
    port = station.port.model_copy(update={"url": url})
    return station.model_copy(update={"port": port}), with_values(text, "port", {"url": url})


def with_address(station: Station, text: str, address: int | None) -> StationText:
    """The station of another sensor on the same line, and its text."""
    if address is None:
        return station, text
    # A raw capture has no port; an address alone must not make it that of the simulated sensor.
    is_named = "port" in station.model_fields_set and text != BUILT_IN_TEXT
    values = {"address": address, **({} if is_named else {"url": "replay://"})}
    text = with_values(text, "port", values, recorded=True)
    return station.model_copy(update={"port": parse_recorded(text).port}), text


def with_identifier(station: Station, text: str, name: str | None) -> StationText:
    """The station with another identifier under test, and its text for the session file.

    An external one is named by its plug: ``command:./onboard --flight``, ``library:./libonboard.so,symbol=identify``,
    ``entry-point:tetra3rs``; further options of the plug follow after commas. Paths are those of the working directory.
    """
    if name is None or name == station.identifier.algorithm:
        return station, text
    if name == "external":
        raise UsageError("--identifier external names no program; expected one of command:, library:, entry-point:")
    # The time for a panorama is the station's, whatever program is named.
    own = {"timeout_ms": station.identifier.timeout_ms}
    values = {"algorithm": name} if name in ALGORITHMS else plug_values(name) | own
    text = with_values(text, "identifier", values, drop=PLUG_KEYS, recorded=True)
    return station.model_copy(update={"identifier": parse_recorded(text).identifier}), text


def plug_values(text: str) -> dict[str, object]:
    """The section ``identifier`` of an external one that is named by its plug; UsageError."""
    plug = next((prefix for prefix in _PLUGS if text.startswith(prefix)), None)
    if plug is None:
        known = ", ".join((*ALGORITHMS, *(f"{prefix}..." for prefix in _PLUGS)))
        raise UsageError(f"there is no identifier {text!r:.60}; known are {known}")
    rest = text.removeprefix(plug)
    try:
        words = shlex.split(rest) if plug == "command:" else rest.split(",")
    except ValueError as error:
        raise UsageError(f"{text!r:.60}: {error}") from error
    if not words or not words[0]:
        raise UsageError(f"{plug} names no program; expected for example command:./onboard or library:./libonboard.so")
    values: dict[str, object] = {"algorithm": "external", "directory": str(Path.cwd())}
    if plug == "command:":
        return values | {"command": words}
    values["library" if plug == "library:" else "entry_point"] = words[0]
    for word in words[1:]:
        key, _, value = word.partition("=")
        if key not in ("symbol", "config"):
            raise UsageError(f"{text!r:.60}: unknown option {key!r:.30}; known are symbol=NAME and config=FILE")
        values[key] = value
    return values


def _beside(station: Station, path: Path) -> Station:
    """Paths in a station file are relative to the file, not to the working directory."""
    changes: dict[str, object] = {}
    if station.catalog != "gaia":
        changes["catalog"] = str(path.parent / station.catalog)
    if station.protocol.endswith((".yaml", ".yml")):
        changes["protocol"] = str(path.parent / station.protocol)
    if station.identifier.algorithm == "external":
        folder = (path.parent / (station.identifier.directory or ".")).absolute()
        changes["identifier"] = replace(station.identifier, directory=str(folder))
    return station.model_copy(update=changes) if changes else station


def with_values(
    text: str, section: str, values: Mapping[str, object], *, drop: tuple[str, ...] = (), recorded: bool = False
) -> str:
    """The text with other values in one section; keys not in ``values`` stay but for those to ``drop``.

    The section is written anew, without comments inside it; all else stays as it was. The result is checked:
    ConfigError where it is not a station file. A ``recorded`` text may be of an earlier version.
    """
    parse = parse_recorded if recorded else parse_station
    _, document = load_document(text, base_60=bool(recorded and parse(text).refusal))
    kept = {key: value for key, value in (document.get(section) or {}).items() if key not in drop}
    block = _block(section, {**kept, **values})
    lines = text.splitlines()
    begin, end = _extent(text, section, len(lines))
    changed = "\n".join([*lines[:begin], *block, *lines[end:]]) + "\n"
    parse(changed, "the changed station file")
    return changed


def _block(section: str, values: Mapping[str, object]) -> list[str]:
    body = [
        yaml.safe_dump({key: value}, default_flow_style=True, width=10_000).strip()[1:-1]
        for key, value in values.items()
    ]
    return [f"{section}:", *(f"  {line}" for line in body)]


def _extent(text: str, section: str, lines: int) -> tuple[int, int]:
    """First line and line after the last of a section; the end of the text where there is none."""
    node, _ = load_document(text)
    assert isinstance(node, yaml.MappingNode)
    keys = [key for key, _ in node.value]
    for place, key in enumerate(keys):
        if key.value == section:
            begin = key.start_mark.line
            end = keys[place + 1].start_mark.line if place + 1 < len(keys) else lines
            return begin, _before_comments(text.splitlines(), begin, end)
    return lines, lines


def _before_comments(lines: list[str], begin: int, end: int) -> int:
    """Blank lines and unindented comments before the next section belong to that."""
    while end > begin + 1 and (not lines[end - 1].strip() or lines[end - 1].startswith("#")):
        end -= 1
    return end
