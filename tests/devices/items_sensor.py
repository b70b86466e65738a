"""The protocols of docs/protocols.md whose sensors send items, take commands of their own, and name their stars."""

import re
from pathlib import Path

from protocols import Protocol, parse_protocol

_DOCUMENT = (Path(__file__).parents[2] / "docs" / "protocols.md").read_text(encoding="utf-8")
ITEMS_TEXT, NAMES_TEXT = (
    re.findall(rf"```yaml\n(version: 1\nname: {name}.*?)```", _DOCUMENT, re.DOTALL)[0]
    for name in ("items-and-commands", "star-names")
)
ITEMS: Protocol = parse_protocol(ITEMS_TEXT, "items.yaml")
HEALTHY = {"mode": "standby", "faults": frozenset(), "supply_v": 5.0, "detector_degc": 20.0, "gain_db": 12.0}
LINES = """
version: 1
name: lines
byte_order: little
framing: {kind: line, separator: ","}
header: [{name: type, type: word}]
checksum: {name: none}
"""
"""The head of a format of lines, before its messages."""
