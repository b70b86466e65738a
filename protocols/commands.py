"""Commands of a protocol: their arguments, their bytes, and the answer that proves them.

No port and no clock: who sends hands the frames that come to ``AwaitedAnswer``, and keeps the time-out.
"""

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from protocols.description import ArgumentDescription, CommandDescription, Description
from protocols.errors import EncodeError
from protocols.frame import Frame
from protocols.items import Condition, Item, ItemValue, unknown_name
from protocols.layout import MessageLayout
from protocols.messages import Ack, Command, Message, Nak, Value
from protocols.reading import DescriptionSource
from protocols.record import FieldLayout
from protocols.vocabulary import Kind, near_unit, quantity

ACK, NO_ANSWER = "ACK", "none"
_REPEATS = 3
"""Of the commands that are described among the messages, as ICD of the panorama protocol has it."""
_ANSWERS = {"PING": "STATUS", "REQUEST": "PANORAMA"}


@dataclass(frozen=True, slots=True)
class Argument:
    """One argument: its unit, its words by number, and what it may be (low, high), open where None."""

    name: str
    unit: str
    kind: Kind
    words: Mapping[int, str]
    low: float | None
    high: float | None
    step: float
    note: str
    is_free: bool = False
    """Whether it may be anything that the wire can say, to see a sensor refuse it."""

    @property
    def text(self) -> str:
        """What may be given, for people."""
        if self.words:
            return f"{self.name}={' | '.join(self.words.values())}"
        ends = [f"{end:.10g}" for end in (self.low, self.high) if end is not None]
        word = {2: " to ", 1: ", at least " if self.high is None else ", at most "}.get(len(ends), "")
        limits = word.join(ends) if len(ends) == 2 else word + "".join(ends)
        return f"{self.name}=NUMBER" + (f" in {self.unit}" if self.unit else "") + (f" {limits}" if ends else "")

    def value(self, given: Any) -> Value:
        """The value that is meant, in the argument's unit; EncodeError where it cannot be."""
        if self.kind is Kind.WORD:
            if given not in self.words.values() and not self.is_free:
                raise EncodeError(f"{self.name} cannot be {given!r:.60}: known are {', '.join(self.words.values())}")
            return str(given)
        if self.kind is Kind.BITS:
            names = [name.strip() for name in given.split(",")] if isinstance(given, str) else list(given)
            return frozenset(str(name) for name in names if name)
        if self.kind is Kind.INTEGERS:
            numbers = given.split(",") if isinstance(given, str) else given
            return tuple(int(self._number(number)) for number in numbers)
        return self._number(given)

    def _number(self, given: Any) -> float | int:
        try:
            number = quantity(given, self.unit)
        except ValueError as error:
            raise EncodeError(f"{self.name} {error}") from error
        low, high = (None, None) if self.is_free else (self.low, self.high)
        slack = 1e-6 * self.step  # an end that was read from the wire may be off by a rounding
        if (low is not None and number < low - slack) or (high is not None and number > high + slack):
            expected = self.text.partition("=")[2].replace("NUMBER", "a number")
            raise EncodeError(f"{self.name} is {f'{number:.6g} {self.unit}'.rstrip()}: expected {expected}")
        if self.kind is Kind.NUMBER:
            return number
        if isinstance(given, int):
            return given
        if number != round(number):
            raise EncodeError(f"{self.name} is {number:.6g}: expected a whole number")
        return round(number)


@dataclass(frozen=True, slots=True)
class Answered:
    """What a frame says of a command: that it is done, or, where not ``is_done``, refused; and in which words."""

    is_done: bool
    text: str
    message: Message
    items: Mapping[str, ItemValue]


@dataclass(frozen=True, slots=True)
class CommandLayout:
    """One command: what it takes, what proves it, how long that may take, how often it may be sent again.

    ``answer`` is ACK, the name of another message, NO_ANSWER, or the values that items take.
    """

    name: str
    arguments: tuple[Argument, ...]
    answer: str | Mapping[str, Any]
    timeout_s: float
    repeats: int
    note: str
    _protocol: Any = field(repr=False)  # a protocols.protocol.Protocol, which has these

    @property
    def free(self) -> "CommandLayout":
        """The same command with arguments that may be anything that the wire can say, to see a sensor refuse it."""
        return replace(self, arguments=tuple(replace(argument, is_free=True) for argument in self.arguments))

    def made(self, **given: Any) -> Command:
        """The command with these arguments; EncodeError where one is missing, unknown or out of its range.

        A value is a number in the argument's unit, a text with a unit of its own (200 ms), or a word.
        ``exposure_s=0.2`` is ``exposure="0.2 s"``.
        """
        known = {argument.name: argument for argument in self.arguments}
        values: dict[str, Value] = {}
        for name, value in given.items():
            argument, text = known.get(name), value
            if argument is None:
                stem, _, unit = name.rpartition("_")
                argument = known.get(stem)
                if argument is not None and not _is_unit(_unit_of(unit), argument.unit):
                    argument = None
                text = f"{value} {_unit_of(unit)}"
            if argument is None:
                raise EncodeError(f"{self.name}: {unknown_name(name, known, 'argument')}")
            if argument.name in values:
                raise EncodeError(f"{self.name}: {argument.name} is given twice")
            values[argument.name] = argument.value(text)
        missing = [argument.text for argument in self.arguments if argument.name not in values]
        if missing:
            raise EncodeError(f"{self.name} needs {', '.join(missing)}")
        return Command(self.name, values)

    def encode(self, *, sequence: int = 0, **given: Any) -> bytes:
        """The bytes of the command with these arguments, as ``made`` takes them; EncodeError."""
        data: bytes = self._protocol.encode(self.made(**given), sequence)
        return data

    def awaited(self, command: Command) -> "AwaitedAnswer":
        """What recognises the answer to this command, as ``made`` gives it."""
        return AwaitedAnswer(self, command, self._protocol)

    @property
    def expected(self) -> str:
        """What proves the command, for people."""
        if isinstance(self.answer, str):
            return "no answer" if self.answer == NO_ANSWER else f"the answer {self.answer}"
        return ", ".join(f"{name} = {wanted}" for name, wanted in self.answer.items())


def _is_unit(unit: str, own: str) -> bool:
    """Whether a number in this unit is one in an argument's own."""
    try:
        quantity(f"1 {unit}", own)
    except ValueError:
        return False
    return True


def _unit_of(suffix: str) -> str:
    """The unit that the end of a name says: degc is degC, v is V."""
    return near_unit(suffix) or suffix


class AwaitedAnswer:
    """Recognises the answer to one command among the frames that come after it was sent.

    ``wrong`` is what came instead of it so far, in words: for the text of a time-out.
    """

    def __init__(self, layout: CommandLayout, command: Command, protocol: Any) -> None:
        self.command, self.wrong = command, ""
        self._layout, self._protocol = layout, protocol
        self._sequences: set[int] = set()
        self._values: dict[str, ItemValue] = {}
        self._condition = None
        if not isinstance(layout.answer, str):
            wanted = {name: self._argument(value) for name, value in layout.answer.items()}
            with contextlib.suppress(ValueError):  # no item can have this value: only a refusal answers it
                self._condition = Condition(wanted, protocol.items)

    def _argument(self, value: Any) -> Any:
        return self.command.arguments.get(value, value) if isinstance(value, str) else value

    def sent(self, sequence: int) -> bytes:
        """The bytes to send with this sequence number, whose answers are awaited from now on."""
        self._sequences.add(sequence)
        data: bytes = self._protocol.encode(self.command, sequence)
        return data

    @property
    def late(self) -> str:
        """Why there is no answer, once the time-out is over."""
        layout = self._layout
        differs = self._condition.what_differs(self._values) if self._condition else ""
        came = "; ".join(filter(None, (self.wrong, differs))) or f"nothing came (expected {layout.expected})"
        return f"no answer to {layout.name} within {layout.timeout_s:g} s: {came}"

    def take(self, frame: Frame) -> Answered | None:
        """What a frame says of the command; None where it says nothing."""
        layout, message = self._layout, self._protocol.decode(frame)
        if isinstance(message, Ack | Nak):
            return self._taken(message)
        if layout.answer == frame.type:
            return Answered(True, f"{frame.type} came", message, self._protocol.items_of(frame))
        if self._condition is not None and (items := self._protocol.items_of(frame)):
            self._values.update(items)
            if self._condition.holds(self._values):
                text = ", ".join(f"{name} is {self._values[name]}" for name in layout.answer)
                return Answered(True, text, message, items)
        return None

    def _taken(self, message: Ack | Nak) -> Answered | None:
        name, counts = self._layout.name, self._protocol.acknowledges
        if "sequence" in counts[type(message)] and message.sequence not in self._sequences:
            return None
        if "command" in counts[type(message)] and message.command != name:
            self.wrong = f"{type(message).__name__.upper()} of {message.command} came, not of {name}"
            return None
        if isinstance(message, Nak):
            text = f"the sensor refuses {name}: {message.reason or 'it gives no reason'}"
            return Answered(False, text, message, {})
        return Answered(True, f"the sensor accepted {name}", message, {}) if self._layout.answer == ACK else None


def compile_commands(
    description: Description,
    layouts: Mapping[str, MessageLayout],
    items: Mapping[str, Item],
    source: DescriptionSource,
    protocol: Any,
) -> dict[str, CommandLayout]:
    """All commands by name; DescriptionError where an answer is not known."""
    found = {}
    for name, layout in layouts.items():
        if not layout.is_command:
            continue
        stated = description.commands.get(name)
        stated_by_name = {of.name: of for of in description.every_message[name].fields}
        arguments = tuple(_argument(of, stated_by_name[of.name]) for of in layout.fields)
        answer = stated.answer if stated else None
        if stated is None:
            timeout_s, repeats, note = 0.5, _REPEATS, description.messages[name].note
        else:
            timeout_s, repeats, note = stated.timeout_s, stated.repeats, stated.note
            _check_answer(name, stated, arguments, layouts, items, source)
        usual = _ANSWERS.get(name, "")
        if answer is None and usual in layouts and (usual == "STATUS" or ACK not in layouts):
            answer = usual
        answer = answer if answer is not None else ACK if ACK in layouts else NO_ANSWER
        found[name] = CommandLayout(name, arguments, answer, timeout_s, repeats, note, protocol)
    return found


def _argument(layout: FieldLayout, stated: Any) -> Argument:
    factor, zero = float(layout.factor), float(layout.zero)
    ends = [None if end is None else end * factor + zero for end in (layout.minimum, layout.maximum)]
    low, high = ends if factor > 0 else ends[::-1]
    if isinstance(stated, ArgumentDescription) and stated.range is not None:
        low, high = stated.range
    kind = layout.role.kind
    words = layout.words if kind is Kind.WORD else {}
    return Argument(layout.name, stated.unit or "", kind, words, low, high, abs(factor), stated.note)


def _check_answer(
    name: str,
    stated: CommandDescription,
    arguments: tuple[Argument, ...],
    layouts: Mapping[str, MessageLayout],
    items: Mapping[str, Item],
    source: DescriptionSource,
) -> None:
    path = ("commands", name, "answer")
    if isinstance(stated.answer, str):
        known = [other for other, layout in layouts.items() if layout.from_sensor]
        if stated.answer not in (*known, NO_ANSWER):
            text = unknown_name(stated.answer, dict.fromkeys([*known, NO_ANSWER]), "message")
            raise source.error(f"{text}; or {{item: value}}", path)
    elif stated.answer is not None:
        own = {argument.name: argument for argument in arguments}
        for item, wanted in stated.answer.items():
            if isinstance(wanted, str) and wanted in own and item in items:
                continue
            try:
                Condition({item: wanted}, items)
            except ValueError as error:
                raise source.error(str(error), (*path, item)) from error
