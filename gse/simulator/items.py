"""Items and commands of a simulated sensor, whatever its protocol calls them.

An item has the value that the scenario gives it, else one within its limits. A command does what proves it: its items
take the values, and an argument sets the item of its name. So a parameter that was set is read back.
"""

import difflib
from collections.abc import Iterator
from typing import Any

import numpy as np

from gse.errors import ConfigError
from gse.simulator.scenario import CommandFault
from gse.simulator.scenario import Firmware as Traits
from gse.values.instant import NS_PER_S
from protocols import ACK, Ack, Command, Item, Message, Nak, Other, Protocol
from protocols.items import unknown_name
from protocols.messages import Value
from protocols.vocabulary import FORMS, quantity

_WRONG_COUNTS = 10
"""By so many counts of the wire an item is off that a wrong answer sets."""


class SimulatedItems:
    """The items of a sensor since power-on, what commands made of them, and how it answers."""

    def __init__(self, protocol: Protocol, traits: Traits) -> None:
        self._protocol, self._profiles = protocol, traits.items
        with_items = {name: message for name, message in protocol.description.messages.items() if message.items}
        self.carriers = frozenset(with_items)
        self.own = tuple(name for name, message in with_items.items() if name not in FORMS)
        asked = {layout.answer for layout in protocol.commands.values() if isinstance(layout.answer, str)}
        every = traits.items_every_s
        named, others_s = (every, 1.0) if isinstance(every, dict) else ({}, every)
        self.every_s = dict.fromkeys((name for name in self.own if name not in asked), others_s) | named
        """Messages that come unasked, with the time between two of them."""
        for key, what, known, names in (
            ("items", "item", protocol.items, traits.items),
            ("commands", "command", protocol.commands, traits.commands),
            ("items_every_s", "message that has items only", dict.fromkeys(self.own), named),
        ):
            for name in names:
                if name not in known:
                    raise ConfigError(f"scenario: firmware.{key}: {unknown_name(name, known, what)}")
        self._faults = dict(traits.commands)
        self._left = {name: fault.times for name, fault in traits.commands.items()}
        self.power_on(0)

    def power_on(self, utc_ns: int) -> None:
        """Begin anew: what commands have set is forgotten."""
        self._power_on_ns = utc_ns
        self._set: dict[str, Value] = {}

    def values(self, utc_ns: int) -> dict[str, Value]:
        """The value of each item at a time."""
        powered_s = (utc_ns - self._power_on_ns) / NS_PER_S
        return {name: self._value(item, powered_s) for name, item in self._protocol.items.items()}

    def _value(self, item: Item, powered_s: float) -> Value:
        if item.name in self._set:
            return self._set[item.name]
        profile = self._profiles.get(item.name)
        if profile is None:
            return _usual(item)
        seconds, values = zip(*profile, strict=True)
        if any(isinstance(value, str) for value in values):
            word = str(values[max(int(np.searchsorted(seconds, powered_s, side="right")) - 1, 0)])
            return frozenset(name.strip() for name in word.split(",") if name.strip()) if item.are_bits else word
        return float(np.interp(powered_s, seconds, values))

    def fault_of(self, command: Command) -> CommandFault | None:
        """How the answer to a command is to be spoiled; each call counts as one answer."""
        fault, left = self._faults.get(command.name), self._left.get(command.name)
        if fault is None or left == 0:
            return None
        self._left[command.name] = None if left is None else left - 1
        return fault

    def obey(self, command: Command, *, wrongly: bool = False) -> None:
        """Set what the command sets."""
        layout = self._protocol.commands[command.name]
        for argument in layout.arguments:
            for name in (argument.name, f"{argument.name}_{argument.unit.lower()}"):
                if name in self._protocol.items:
                    self._take(name, command.arguments[argument.name], argument.unit, wrongly=wrongly)
        for name, wanted in {} if isinstance(layout.answer, str) else layout.answer.items():
            given = command.arguments.get(wanted) if isinstance(wanted, str) else None
            unit = next((of.unit for of in layout.arguments if of.name == wanted), "") if given is not None else ""
            self._take(name, _middle(wanted) if given is None else given, unit, wrongly=wrongly)

    def _take(self, name: str, value: Any, unit: str, *, wrongly: bool) -> None:
        item = self._protocol.items[name]
        if isinstance(value, str) and item.words:
            others = [word for word in item.words.values() if word != value]
            self._set[name] = others[0] if wrongly and others else value
            return
        if isinstance(value, int | float | str):
            number = quantity(f"{value} {unit}" if unit else value, item.unit or unit)
            self._set[name] = number + (_WRONG_COUNTS * item.step if wrongly else 0)

    def answers(self, command: Command, sequence: int) -> Iterator[Message]:
        """The frames that prove a command, but STATUS and panoramas, which the firmware makes."""
        layout = self._protocol.commands[command.name]
        if layout.answer == ACK:
            yield Ack(command.name, sequence)
        for name in self.proofs(command):
            if name in self.own:
                yield self.message(name)

    def proofs(self, command: Command) -> tuple[str, ...]:
        """The messages that prove a command."""
        answer = self._protocol.commands[command.name].answer
        if isinstance(answer, str):
            return (answer,)
        return tuple(dict.fromkeys(self._protocol.items[name].message for name in answer))

    def wrong_answers(self, command: Command, sequence: int) -> Iterator[Message]:
        """What a confused sensor sends: ACK of another command, or its items as they are."""
        others = [name for name in self._protocol.commands if name != command.name]
        yield Ack((others or [command.name])[0], sequence)
        layout = self._protocol.commands[command.name]
        if not isinstance(layout.answer, str):
            yield from (self.message(name) for name in self.proofs(command) if name in self.own)

    def refusal(self, command: str, sequence: int, reason: str = "") -> Nak:
        """NAK with the reason of the protocol that is nearest to this one, else with its first."""
        known = {word.replace("_", " ").lower(): word for word in self._protocol.reasons}
        near = difflib.get_close_matches(reason.lower(), known, n=1) or [*known][:1]
        return Nak(command, known[near[0]] if near else "", max(sequence, 0))

    def message(self, name: str) -> Other:
        """A message that has items only, which are filled in when it is sent."""
        return Other(name, self._protocol.blank(name))


def _middle(wanted: Any) -> Any:
    if not isinstance(wanted, tuple | list):
        return wanted
    ends = [end for end in wanted if end is not None]
    return sum(ends) / len(ends)


def _usual(item: Item) -> Value:
    """A value within the limits of an item."""
    if item.are_bits:
        return frozenset()
    if item.words:
        return item.words[min(item.words)]
    low, high = item.yellow or item.red or (None, None)
    if low is not None and high is not None:
        return (low + high) / 2
    return 0.0 if item.colour(0.0) <= 1 else low if low is not None else high if high is not None else 0.0
