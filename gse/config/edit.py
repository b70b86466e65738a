"""Changes to the text of a station file that keep its other lines and comments."""

from collections.abc import Mapping

import yaml

from gse.config.station import parse_recorded, parse_station
from protocols.yaml_text import load_document


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
