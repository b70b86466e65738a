"""Items of a sensor's housekeeping: name, unit, limits; and conditions on them.

A condition is a table of items, each with what it must be: {mode: standby, supply_v: [4.8, 5.2], gain: 12}. Numbers may
have a unit of their own (200 ms), an end of a range may be open (null), and all must hold.
"""

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from protocols.description import Description, Range
from protocols.layout import MessageLayout
from protocols.reading import DescriptionSource
from protocols.record import FieldLayout
from protocols.vocabulary import SPARE, Kind, quantity

COLOURS = ("", "green", "yellow", "red")
"""What the limits of an item say of its value; nothing where it has none."""

_OF_STATUS = {
    "supply": ("supply_v", "V"),
    "temperature": ("temperature_degc", "degC"),
    **{name: (name, "") for name in ("mode", "frames_taken", "frames_sent", "commands_ok", "commands_bad", "serial")},
}
_STANDARD = {"STATUS": _OF_STATUS, "ATTITUDE": {"state": ("state", "")}}
"""Fields of standard messages that are items too, with name and unit."""

ItemValue = float | str
"""A number in the item's unit, or its word; of bits the names of those that are set, with commas."""


@dataclass(frozen=True, slots=True)
class Item:
    """One item: the message that brings it, its unit, its words by number, and its limits (low, high), open where None.

    ``field`` is its name in the message; ``step`` what one count of the wire is worth.
    """

    name: str
    message: str
    field: str
    unit: str
    words: Mapping[int, str]
    are_bits: bool
    step: float
    yellow: Range | None = None
    red: Range | None = None

    def value(self, number: float) -> ItemValue:
        """The value of a number of the table: itself, or its words."""
        if math.isnan(number) or not (self.words or self.are_bits):
            return number
        if not self.are_bits:
            return self.words.get(int(number), f"value {int(number)}")
        bits = (bit for bit in range(int(number).bit_length()) if int(number) >> bit & 1)
        return ", ".join(self.words.get(bit, f"bit {bit}") for bit in bits)

    def colour(self, number: float) -> int:
        """The place in COLOURS of a number; one that is none (NaN) is red where there are limits."""
        if self.yellow is None and self.red is None:
            return 0
        return 3 if not _within(number, self.red) else 2 if not _within(number, self.yellow) else 1

    def text(self, number: float) -> str:
        """The value with its unit, for people."""
        value = self.value(number)
        return value if isinstance(value, str) else f"{value:.6g} {self.unit}".rstrip()


def _within(number: float, ends: Range | None) -> bool:
    low, high = ends or (None, None)
    return not math.isnan(number) and (low is None or number >= low) and (high is None or number <= high)


def compile_items(
    description: Description, layouts: Mapping[str, MessageLayout], source: DescriptionSource
) -> dict[str, Item]:
    """All items by name; DescriptionError where two have one name."""
    found: dict[str, Item] = {}
    for name, message in description.messages.items():
        layouts_of = {field.name: field for field in layouts[name].items}
        for number, item in enumerate(message.items):
            path = ("messages", name, "items", number)
            if item.name == SPARE:
                continue
            if item.array is not None:
                raise source.error("give each number an item of its own", (*path, "array"))
            if item.name in found:
                other = found[item.name].message
                raise source.error(f"{item.name} is an item of {other} already", (*path, "name"))
            if any(item.name == field.name for field in layouts[name].fields):
                raise source.error(f"{item.name} is a field of {name} already", (*path, "name"))
            limits = item.limits
            if limits and (item.values is not None or item.bits is not None):
                raise source.error("only a number has limits", (*path, "limits"))
            yellow, red = (limits.yellow, limits.red) if limits else (None, None)
            found[item.name] = _item(layouts_of[item.name], item.name, name, item.unit or "", yellow, red)
    for message_name, items in _STANDARD.items():
        for field in layouts[message_name].fields if message_name in layouts else ():
            if field.name in items and items[field.name][0] not in found:
                own, unit = items[field.name]
                found[own] = _item(field, own, message_name, unit)
    return found


def _item(
    field: FieldLayout, name: str, message: str, unit: str, yellow: Range | None = None, red: Range | None = None
) -> Item:
    are_bits = field.role.kind is Kind.BITS
    return Item(name, message, field.name, unit, field.words, are_bits, abs(float(field.factor)), yellow, red)


Wanted = float | str | Sequence[float | str | None]
"""What an item must be: a number, a word, or [low, high] of which one end may be open."""


def unknown_name(name: str, known: Mapping[str, object], what: str) -> str:
    """The sentence on a name that is not known."""
    near = difflib.get_close_matches(name, known, n=1)
    advice = f"did you mean {near[0]}? " if near else ""
    return f"no {what} {name!r:.60}; {advice}known: {', '.join(known) or 'none'}"


class Condition:
    """What items must be, all of them; ValueError where an item, a word or a unit is not known."""

    def __init__(self, wanted: Mapping[str, Wanted], items: Mapping[str, Item]) -> None:
        if not wanted:
            raise ValueError("expected items with values, such as {mode: standby}")
        self._wanted = [(name, _known(name, of, items)) for name, of in wanted.items()]
        self._items = items

    def holds(self, values: Mapping[str, ItemValue]) -> bool:
        """Whether all of the items have come, and are as wanted."""
        return not any(True for _ in self._others(values))

    def what_differs(self, values: Mapping[str, ItemValue]) -> str:
        """What each item is that is not as wanted, and what was wanted; empty where the condition holds."""
        return ", ".join(self._others(values))

    def _others(self, values: Mapping[str, ItemValue]) -> Iterator[str]:
        for name, wanted in self._wanted:
            value, unit = values.get(name), self._items[name].unit
            if value is not None and _meets(value, wanted, self._items[name].step):
                continue
            was = "has not come" if value is None else f"is {in_words(value)}"
            low, high = wanted if isinstance(wanted, tuple) else (wanted, wanted)
            ends = range_in_words(low, high) if isinstance(wanted, tuple) else in_words(low)
            yield f"{name} {was} {unit} (expected {ends} {unit}".replace(" ,", ",").replace("  ", " ").rstrip() + ")"


def range_in_words(low: ItemValue | None, high: ItemValue | None) -> str:
    """A range, an end of which may be open."""
    if low is None or high is None:
        return f"at most {in_words(high)}" if low is None else f"at least {in_words(low)}"
    return f"{in_words(low)} to {in_words(high)}"


def in_words(value: ItemValue | None) -> str:
    """A value for a person."""
    return (value or "''") if isinstance(value, str) else f"{value:.6g}"


def _known(name: str, wanted: Wanted, items: Mapping[str, Item]) -> str | float | Range:
    if name not in items:
        raise ValueError(unknown_name(name, items, "item"))
    item = items[name]
    if item.words and not item.are_bits:
        if not isinstance(wanted, str) or wanted not in item.words.values():
            raise ValueError(f"{name} cannot be {wanted!r:.60}: known are {', '.join(item.words.values())}")
        return wanted
    if item.are_bits:
        words = [item.words.get(bit, f"bit {bit}") for bit in range(64)]
        named = {word.strip() for word in wanted.split(",")} - {""} if isinstance(wanted, str) else {str(wanted)}
        if unknown := ", ".join(sorted(named - set(words))):
            known = ", ".join(item.words.values())
            raise ValueError(f"{name} has no bit {unknown:.60}: known are {known}, with commas; '' where none is set")
        return ", ".join(word for word in words if word in named)
    try:
        if isinstance(wanted, int | float | str):
            return quantity(wanted, item.unit)
        low, high = (None if end is None else quantity(end, item.unit) for end in wanted)
    except ValueError as error:
        wrong = str(error) if str(error).startswith(("is ", "has ")) else "expected a value, or [low, high]"
        raise ValueError(f"{name} {wrong}") from error
    if low is None and high is None:
        raise ValueError(f"{name}: both ends are open: give a number for one")
    if low is not None and high is not None and low > high:
        raise ValueError(f"{name}: the low end {low:g} is over the high end {high:g}: swap them")
    return low, high


def _meets(value: ItemValue, wanted: str | float | Range, step: float) -> bool:
    if isinstance(value, str) or isinstance(wanted, str):
        return value == wanted
    if isinstance(wanted, tuple):
        return _within(value, wanted)
    return abs(value - wanted) <= step * 0.5001 or value == wanted
