"""Reads a protocol description: YAML text to a validated Description, errors with file, line and key."""

import difflib
import reprlib
from collections.abc import Sequence
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from protocols.description import (
    ArgumentDescription,
    ChecksumDescription,
    CommandDescription,
    CoversDescription,
    DelayDescription,
    Description,
    FieldDescription,
    FramingDescription,
    ItemDescription,
    LimitsDescription,
    MessageDescription,
    SequenceDescription,
    SlotsDescription,
    TimeDescription,
)
from protocols.errors import DescriptionError
from protocols.yaml_text import load_document, yaml_problem

MAX_TEXT = 100_000
"""Characters of a description: the built-in ones have some 4000."""

_MAX_PROBLEMS = 5
_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = 60

Path = Sequence[str | int]


class DescriptionSource:
    """Where a description came from: names file, line and key of what is wrong with it."""

    def __init__(self, name: str, root: yaml.Node | None = None) -> None:
        self._name = name
        self._root = root

    def error(self, reason: str, path: Path = ()) -> DescriptionError:
        """The error that says this of the key at this path."""
        return DescriptionError(self.explain(reason, path))

    def explain(self, reason: str, path: Path = ()) -> str:
        """One line: file, line, key, reason."""
        line = self._line(path)
        where = f"{self._name}, line {line}" if line else self._name
        return f"{where}: {_key(path)}: {reason}" if path else f"{where}: {reason}"

    def _line(self, path: Path) -> int | None:
        node, line = self._root, None
        for part in path:
            if isinstance(node, yaml.MappingNode):
                found = next(((k, v) for k, v in node.value if k.value == str(part) or _int(k) == part), None)
                if found is None:
                    return line
                line, node = found[0].start_mark.line + 1, found[1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
                node = node.value[part]
                line = node.start_mark.line + 1
            else:
                return line
        return line


def _int(key: yaml.Node) -> int | None:
    try:
        return int(key.value, 0)
    except (ValueError, TypeError):
        return None


def _key(path: Path) -> str:
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def read_document(text: str, source_name: str) -> tuple[dict[str, Any], DescriptionSource]:
    """The YAML mapping of a text; DescriptionError where it is none, too large, or gives a key twice."""
    source = DescriptionSource(source_name)
    if len(text) > MAX_TEXT:
        raise source.error(f"longer than {MAX_TEXT} characters: this is not a protocol description")
    try:
        root, document = load_document(text)
    except yaml.YAMLError as error:
        raise source.error(yaml_problem(error, "not YAML")) from error
    if not isinstance(document, dict) or root is None:
        raise source.error(f"expected a mapping with the keys {', '.join(Description.model_fields)}")
    source = DescriptionSource(source_name, root)
    _refuse_repeated_keys(root, (), source)
    return document, source


def _refuse_repeated_keys(node: yaml.Node, path: tuple[str | int, ...], source: DescriptionSource) -> None:
    if isinstance(node, yaml.MappingNode):
        seen = set()
        for key, value in node.value:
            if key.value in seen:
                raise source.error("this key is given twice", (*path, str(key.value)))
            seen.add(key.value)
            _refuse_repeated_keys(value, (*path, str(key.value)), source)
    elif isinstance(node, yaml.SequenceNode):
        for position, value in enumerate(node.value):
            _refuse_repeated_keys(value, (*path, position), source)


def validate(document: dict[str, Any], source: DescriptionSource) -> Description:
    """The Description of a document; DescriptionError names each wrong key."""
    try:
        return Description.model_validate(document)
    except ValidationError as error:
        items = sorted(error.errors(include_url=False), key=lambda item: item["type"] != "extra_forbidden")
        lines = dict.fromkeys(_explain(item, source) for item in items)
        raise DescriptionError("\n".join(list(lines)[:_MAX_PROBLEMS])) from error


_MODEL_OF: dict[str, type[BaseModel]] = {
    "framing": FramingDescription,
    "checksum": ChecksumDescription,
    "header": FieldDescription,
    "fields": FieldDescription,
    "slots": SlotsDescription,
    "items": ItemDescription,
    "limits": LimitsDescription,
    "messages": MessageDescription,
    "commands": CommandDescription,
    "arguments": ArgumentDescription,
    "sequence": SequenceDescription,
    "covers": CoversDescription,
    "time": TimeDescription,
    "delay_ms": DelayDescription,
}


def _explain(item: Any, source: DescriptionSource) -> str:
    path = [part for part in item["loc"] if part != "[key]"]
    return source.explain(_reason(item, path), path)


def _reason(item: Any, path: list[str | int]) -> str:
    match item["type"]:
        case "extra_forbidden":
            return f"unknown key; {_nearest(path)}"
        case "missing":
            return "is missing"
        case "value_error":
            return str(item["ctx"]["error"])
        case "string_pattern_mismatch" if path[-1] == "sync_word":
            return f"is {_REPR.repr(item['input'])}: expected 2 to 8 bytes as pairs of hexadecimal digits"
        case "string_pattern_mismatch":
            return f"is {_REPR.repr(item['input'])}: expected a name of letters, digits, _ and -"
        case "string_type" if isinstance(item["input"], bool):
            return f"is a YAML word for {str(item['input']).lower()}: put it in quotes, such as 'on' or 'off'"
        case "string_type" if path[-1] == "sync_word":
            return f"is {_REPR.repr(item['input'])}: expected hexadecimal digits in quotes"
        case _:
            return f"is {_REPR.repr(item['input'])}: {item['msg'][0].lower()}{item['msg'][1:]}"


def _nearest(path: list[str | int]) -> str:
    section = next((part for part in reversed(path[:-1]) if part in _MODEL_OF), "")
    model = _MODEL_OF.get(str(section), Description)
    known = [*model.model_fields, *(["extends"] if model is Description else [])]
    near = difflib.get_close_matches(str(path[-1]), known, n=1, cutoff=0.6)
    return f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
