"""The protocol of docs/protocols.md whose sensor sends items and takes commands of its own."""

import re
from pathlib import Path

from protocols import Protocol, parse_protocol

_DOCUMENT = Path(__file__).parents[2] / "docs" / "protocols.md"
ITEMS_TEXT = re.findall(
    r"```yaml\n(version: 1\nname: items-and-commands.*?)```", _DOCUMENT.read_text(encoding="utf-8"), re.DOTALL
)[0]
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
