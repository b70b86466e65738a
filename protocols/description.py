"""Protocol description, the content of its YAML file: keys, types and bounds.

What a description means (dtypes, offsets, standard names) is checked by protocols/layout.py; docs/protocols.md is the
reference of the keys.
"""

from fractions import Fraction
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints

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
Code = Annotated[int, Field(strict=True, ge=0, le=2**64 - 1)]


class DescriptionPart(BaseModel):
    """Unknown keys are errors."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True, defer_build=True
    )


class FieldDescription(DescriptionPart):
    """One number of a header, payload or slot; without an offset it follows the field before it."""

    name: Name
    type: Literal["u8", "u16", "u32", "u64", "i8", "i16", "i32", "i64", "f32", "f64"]
    array: Annotated[int, Field(strict=True, ge=1, le=MAX_REPEAT)] | None = None
    offset: Annotated[int, Field(strict=True, ge=0, le=MAX_LENGTH_LIMIT)] | None = None
    unit: str | None = None
    scale: Scale | None = None
    zero: Number = Fraction(0)
    min: float | None = None
    max: float | None = None
    bits: dict[Annotated[int, Field(strict=True, ge=0, le=63)], Word] | None = None
    values: dict[Annotated[int, Field(strict=True)], Word] | None = None
    note: Note = ""


class SlotsDescription(DescriptionPart):
    """The same fields again and again: the objects of a panorama."""

    repeat: Annotated[int, Field(strict=True, ge=1, le=MAX_REPEAT)]
    offset: Annotated[int, Field(strict=True, ge=0, le=MAX_LENGTH_LIMIT)] | None = None
    fields: Annotated[list[FieldDescription], Field(min_length=1, max_length=MAX_FIELDS)]
    note: Note = ""


class MessageDescription(DescriptionPart):
    """One frame type; ``length`` is its one allowed payload length, checked against the fields where both stand."""

    code: Code
    direction: Literal["from sensor", "to sensor"]
    length: Annotated[int, Field(strict=True, ge=0)] | None = None
    fields: Annotated[list[FieldDescription], Field(max_length=MAX_FIELDS)] = []
    slots: SlotsDescription | None = None
    ignored: bool = False
    note: Note = ""


class FramingDescription(DescriptionPart):
    """How frames are told apart: by a sync word before each, or by a byte at the end of each (protocols.delimiter)."""

    kind: str
    sync_word: Annotated[str, StringConstraints(strict=True, pattern=r"^([0-9A-Fa-f]{2} ?){2,8}$")] | None = None


class ChecksumDescription(DescriptionPart):
    """The checksum after the payload, over header and payload, and over the sync word if so said."""

    name: str
    covers_sync_word: bool = False
    byte_order: Literal["big", "little"] | None = None


class Description(DescriptionPart):
    """A whole protocol description."""

    version: Literal[1]
    name: Name
    note: Note = ""
    byte_order: Literal["big", "little"]
    framing: FramingDescription
    header: Annotated[list[FieldDescription], Field(min_length=1, max_length=16)]
    checksum: ChecksumDescription
    length_limit: Annotated[int, Field(strict=True, ge=0, le=MAX_LENGTH_LIMIT)] = 1024
    scale: Scale = Fraction(1)
    messages: Annotated[dict[Name, MessageDescription], Field(min_length=1, max_length=MAX_MESSAGES)]
