"""Protocol description, the content of its YAML file: keys, types and bounds.

What a description means (dtypes, offsets, standard names) is checked by protocols/layout.py; docs/protocols.md is the
reference of the keys.
"""

import functools
from collections.abc import Mapping
from datetime import date, datetime
from fractions import Fraction
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints, model_validator

MAX_LENGTH_LIMIT = 65535
"""Payload bytes: what a 16-bit length can say; a decoder holds at most one such frame."""

MAX_REPEAT = 65535
MAX_MESSAGES = 256
MAX_FIELDS = 256


def _fraction(value: object) -> object:
    """A number that is meant as it is written: 1/32, 0.01, 5."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError("expected a number or a fraction such as 1/32")
    try:
        number = Fraction(str(value)[:40])
    except (ValueError, ZeroDivisionError):
        raise ValueError("expected a number or a fraction such as 1/32") from None
    if abs(number) > 10**12 or number.denominator > 10**18:
        raise ValueError("expected a number of ordinary size")
    return number


def _not_zero(value: object) -> object:
    number = _fraction(value)
    if number == 0:
        raise ValueError("a scale of 0 would make every value the same")
    return number


Number = Annotated[Fraction, BeforeValidator(_fraction)]
Scale = Annotated[Fraction, BeforeValidator(_not_zero)]
Name = Annotated[str, StringConstraints(strict=True, pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,39}$")]
Word = Annotated[
    str,
    StringConstraints(strict=True, min_length=1, max_length=60, pattern=r"^[^\p{C}\u2028\u2029]*$"),
]
"""Words are shown to people: without control characters, which steer what shows them."""
Note = Annotated[str, StringConstraints(max_length=2000)]
Code = Annotated[int, Field(strict=True, ge=0, le=2**64 - 1)] | Word
"""The number in the header's type field; in a line of text the word there."""
Hex = Annotated[str, StringConstraints(strict=True, pattern=r"^([0-9A-Fa-f]{2} ?){1,8}$")]
"""Bytes as pairs of hexadecimal digits."""


class DescriptionPart(BaseModel):
    """Unknown keys are errors."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True, defer_build=True
    )


TEXT_TYPES = ("decimal", "hex", "word", "iso")
"""Types of a field in a line of text."""


class FieldDescription(DescriptionPart):
    """One number of a header, payload or slot; without an offset it follows the field before it.

    With a ``mask`` it is some bits of its word; the next field with a mask of other bits stands in the same word.
    """

    name: Name
    type: Literal[
        "u8", "u16", "u24", "u32", "u64", "i8", "i16", "i24", "i32", "i64", "f32", "f64",
        "decimal", "hex", "word", "iso",
    ]  # fmt: skip
    mask: Annotated[int, Field(strict=True, ge=1, le=2**64 - 1)] | None = None
    value: Annotated[int, Field(strict=True, ge=0, le=2**64 - 1)] | None = None
    digits: Annotated[int, Field(strict=True, ge=0, le=15)] | None = None
    array: Annotated[int, Field(strict=True, ge=1, le=MAX_REPEAT)] | None = None
    offset: Annotated[int, Field(strict=True, ge=0, le=MAX_LENGTH_LIMIT)] | None = None
    unit: str | None = None
    scale: Scale | None = None
    zero: Number = Fraction(0)
    min: float | None = None
    max: float | None = None
    bits: dict[Annotated[int, Field(strict=True, ge=0, le=63)], Word] | None = None
    values: dict[Annotated[int, Field(strict=True)], Word] | None = None
    words: dict[Word, Annotated[int, Field(strict=True)]] | None = None
    note: Note = ""


def _in_order(ends: tuple[float | None, float | None]) -> tuple[float | None, float | None]:
    low, high = ends
    if low is None and high is None:
        raise ValueError("both ends are open: give a number for one")
    if low is not None and high is not None and low > high:
        raise ValueError(f"the low end {low:.15g} is over the high end {high:.15g}: swap them")
    return ends


Range = Annotated[tuple[float | None, float | None], AfterValidator(_in_order)]
"""Low and high end in the unit of the item or argument, of which one may be open (null)."""


class LimitsDescription(DescriptionPart):
    """Where an item is as it should be: outside of ``yellow`` it is yellow, outside of ``red`` red."""

    yellow: Range | None = None
    red: Range | None = None

    @model_validator(mode="after")
    def _yellow_within_red(self) -> Self:
        if self.yellow and self.red:
            (low, high), (lowest, highest) = self.yellow, self.red
            if (lowest is not None and (low is None or low < lowest)) or (
                highest is not None and (high is None or high > highest)
            ):
                raise ValueError("the limits cross: expected yellow within red")
        return self


class ItemDescription(FieldDescription):
    """One item of the sensor's housekeeping: a field of any name and unit, with its limits."""

    limits: LimitsDescription | None = None


class ArgumentDescription(FieldDescription):
    """One argument of a command; ``range`` is what it may be, in its unit."""

    range: Range | None = None


AnswerValue = float | str | Range
"""What an item must become: a number, a word, the name of an argument, or [low, high]."""


class CommandDescription(DescriptionPart):
    """A command with its arguments, and the answer that proves it.

    ``answer`` is ACK, the name of another message, `none`, or the values that items take: {item: value}.
    """

    code: Code | None = None
    arguments: Annotated[list[ArgumentDescription], Field(max_length=MAX_FIELDS)] = []
    answer: Name | Annotated[dict[Name, AnswerValue], Field(min_length=1, max_length=16)] | None = None
    timeout_s: Annotated[float, Field(gt=0, le=3600)] = 0.5
    repeats: Annotated[int, Field(strict=True, ge=0, le=20)] = 0
    note: Note = ""


class PartsDescription(DescriptionPart):
    """A panorama that comes in several frames: the fields that number the frame, and tell how many there are."""

    field: Literal["part"] = "part"
    of: Literal["parts"] = "parts"
    first: Literal[0, 1] = 1


class SlotsDescription(DescriptionPart):
    """The same fields again and again: the objects of a panorama.

    ``repeat`` slots are always sent; or as many as the field ``count`` says, ``most`` of them.
    """

    repeat: Annotated[int, Field(strict=True, ge=1, le=MAX_REPEAT)] | None = None
    count: Literal["count"] | None = None
    most: Annotated[int, Field(strict=True, ge=1, le=MAX_REPEAT)] | None = None
    parts: PartsDescription | None = None
    offset: Annotated[int, Field(strict=True, ge=0, le=MAX_LENGTH_LIMIT)] | None = None
    fields: Annotated[list[FieldDescription], Field(min_length=1, max_length=MAX_FIELDS)]
    note: Note = ""


class MessageDescription(DescriptionPart):
    """One frame type; ``length`` is its one allowed payload length, checked against the fields where both stand."""

    code: Code | None = None
    direction: Literal["from sensor", "to sensor"]
    length: Annotated[int, Field(strict=True, ge=0)] | None = None
    fields: Annotated[list[FieldDescription], Field(max_length=MAX_FIELDS)] = []
    items: Annotated[list[ItemDescription], Field(max_length=MAX_FIELDS)] = []
    slots: SlotsDescription | None = None
    ignored: bool = False
    note: Note = ""


class FramingDescription(DescriptionPart):
    """How frames are told apart: docs/protocols.md explains each kind and the keys that it has."""

    kind: str
    sync_word: Annotated[str, StringConstraints(strict=True, pattern=r"^([0-9A-Fa-f]{2} ?){2,8}$")] | None = None
    end_word: Hex | None = None
    start: Hex | None = None
    end: Hex | None = None
    escape: Hex | None = None
    begin: Annotated[str, StringConstraints(strict=True, pattern=r"^[!-~]$")] | None = None
    separator: Annotated[str, StringConstraints(strict=True, pattern=r"^[ -~]$")] | None = None
    name: Annotated[str, StringConstraints(strict=True, min_length=1, max_length=100)] | None = None
    distribution: Word | None = None
    version: Word | None = None
    sha256: Annotated[str, StringConstraints(max_length=64)] | None = None


class CoversDescription(DescriptionPart):
    """The part of a frame that a checksum is over: from the first byte of one to the last byte of the other."""

    start: Annotated[str, Field(alias="from")] = "header"
    end: Annotated[str, Field(alias="to")] = "payload"


class ChecksumDescription(DescriptionPart):
    """The checksum after the payload, over header and payload, and over the sync word if so said."""

    name: str
    covers_sync_word: bool = False
    covers: CoversDescription | None = None
    byte_order: Literal["big", "little"] | None = None


class SequenceDescription(DescriptionPart):
    """How the sequence number counts: by ``step``, up to before ``modulus``, all frames or each message by itself."""

    modulus: Annotated[int, Field(strict=True, ge=2, le=2**64)] | None = None
    step: Annotated[int, Field(strict=True, ge=1, le=2**32)] = 1
    per: Literal["direction", "message"] = "direction"


class AddressesDescription(DescriptionPart):
    """The usual addresses of sensor and host on a line that others share."""

    sensor: Annotated[int, Field(strict=True, ge=0, le=2**64 - 1)]
    host: Annotated[int, Field(strict=True, ge=0, le=2**64 - 1)]


class DelayDescription(DescriptionPart):
    """From the end of an exposure to the first byte of its frame: how long, how well known, or how long at most."""

    value: Annotated[float, Field(ge=0, le=60_000)] | None = None
    uncertainty: Annotated[float, Field(ge=0, le=60_000)] | None = None
    most: Annotated[float, Field(gt=0, le=60_000)] | None = None

    @model_validator(mode="after")
    def _value_or_most(self) -> "DelayDescription":
        if (self.value is None) is (self.most is None) or (self.value is None) is not (self.uncertainty is None):
            raise ValueError("expected {value: .., uncertainty: ..} or {most: ..}, in ms")
        return self


class TimeDescription(DescriptionPart):
    """What the time tag of an exposure tells, in which scale; times are in ms, uncertainties half-widths of 95 %."""

    tag_of: Literal["middle", "start", "end", "sent"] = "middle"
    scale: Literal["counter", "host", "utc", "unix", "gps", "tai"] = "counter"
    epoch: date | datetime | None = None
    uncertainty_ms: Annotated[float, Field(ge=0, le=60_000)] = 1.0
    delay_ms: DelayDescription | None = None

    @model_validator(mode="after")
    def _epoch_of_an_absolute_scale(self) -> "TimeDescription":
        if self.epoch is not None and not self.is_absolute:
            raise ValueError(f"a clock of the scale {self.scale} has no epoch: expected utc, unix, gps or tai")
        return self

    @property
    def is_absolute(self) -> bool:
        """Whether the sensor's own clock says when, not only how much later."""
        return self.scale not in ("counter", "host")


class Description(DescriptionPart):
    """A whole protocol description."""

    version: Literal[1]
    name: Name
    note: Note = ""
    byte_order: Literal["big", "little"]
    framing: FramingDescription
    header: Annotated[list[FieldDescription], Field(max_length=32)] = []
    checksum: ChecksumDescription
    sequence: SequenceDescription = SequenceDescription()
    addresses: AddressesDescription | None = None
    time: TimeDescription | None = None
    length_limit: Annotated[int, Field(strict=True, ge=0, le=MAX_LENGTH_LIMIT)] = 1024
    scale: Scale = Fraction(1)
    messages: Annotated[dict[Name, MessageDescription], Field(min_length=1, max_length=MAX_MESSAGES)]
    commands: Annotated[dict[Name, CommandDescription], Field(max_length=MAX_MESSAGES)] = {}
    parameters: Name | None = None
    """The command whose answer is the table of parameters: the items of that message."""

    @functools.cached_property
    def every_message(self) -> Mapping[str, MessageDescription]:
        """The messages, and the commands as messages to the sensor."""
        commands = {
            name: MessageDescription(code=command.code, direction="to sensor", fields=list(command.arguments))
            for name, command in self.commands.items()
        }
        return {**self.messages, **commands}

    def fields_path(self, name: str) -> tuple[str, str, str]:
        """Where the fields of a message stand in the description, for errors: a command's are its arguments."""
        return ("messages", name, "fields") if name in self.messages else ("commands", name, "arguments")
