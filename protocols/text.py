"""Lines of text: fields between separators, as NMEA 0183 and many laboratory sensors send them.

    $STAR,123456,12,2,512.25,300.50,2100,...*5A CR LF
    |  |     |                              |  |
    |  type  fields of header and payload   |  checksum in hexadecimal digits, over all between $ and *
    |                                       |
    begin, where there is one               where there is a checksum

A line becomes the payload that a binary frame with the same fields would have, eight bytes each, and is read on as one.
"""

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, date, datetime, timedelta
from decimal import Decimal
from typing import Any

from protocols.delimiter import Delimiter
from protocols.description import Description, FieldDescription
from protocols.errors import EncodeError
from protocols.frame import BAD_CRC, BAD_LENGTH, NO_SYNC, UNKNOWN_TYPE, Reason
from protocols.layout import FrameLayout, MessageLayout, compile_frame
from protocols.reading import DescriptionSource
from protocols.record import counts_digits, order_of
from protocols.vocabulary import SPARE, Kind

LINE = Delimiter("a line", b"\n", lambda line: line + b"\r\n", lambda line: line.removesuffix(b"\r"), "")

_WHOLE = re.compile(r"[+-]?[0-9]{1,18}")
_DECIMAL = re.compile(r"[+-]?([0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})([eE][+-]?[0-9]{1,2})?")
_HEX = re.compile(r"[0-9A-Fa-f]{1,15}")
_ISO = re.compile(r"([0-9]{4})-([0-9]{2})-([0-9]{2})[T ]([0-9]{2}):([0-9]{2}):([0-9]{2})(?:\.([0-9]{1,9}))?Z?")
_EPOCH = date(1970, 1, 1).toordinal()


class _NoNumberError(Exception):
    """What stands in a field is none of its numbers."""


Number = int | float


@dataclass(frozen=True, slots=True)
class TextField:
    """How one field of a line is read and written; ``code`` is that of its number in the struct module, or ``8x``."""

    code: str
    read: Callable[[str], Number]
    write: Callable[[Number], str]


@dataclass(frozen=True, slots=True)
class TextMessage:
    """The fields of a message in their order, those of a slot, and where the number of slots stands among them."""

    fields: tuple[TextField, ...]
    slot: tuple[TextField, ...]
    slots: int
    count_at: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TextLayout(FrameLayout):
    """The layout of lines; ``words`` are the type codes by word, ``head`` the names of the header's fields in order."""

    separator: str
    order: str
    head: tuple[str, ...]
    hexadecimal: frozenset[str]
    words: Mapping[str, int]
    messages: Mapping[str, TextMessage]
    limit: int

    @property
    def largest(self) -> int:
        """Half of the longest line that is looked at."""
        return self.limit

    def examine(self, content: bytes) -> tuple[str, int, int, bytes] | Reason:
        """Message, flags, sequence number and payload of a line, or why it is no frame."""
        if self.begin and not content.startswith(self.begin):
            return NO_SYNC
        body, star, stated = content[len(self.begin) :].partition(b"*") if self.checksum.size else (content, b"", b"")
        if not self.checksum.size:
            body = content[len(self.begin) :]
        text = body.decode("latin-1")
        found = text.split() if self.separator == " " else [word.strip() for word in text.split(self.separator)]
        if len(found) < len(self.head):
            return BAD_LENGTH
        head = dict(zip(self.head, found, strict=False))
        code = self.words.get(head["type"], -1) if "type" in head else 0
        name = self.names.get(code)
        if name is None:
            return UNKNOWN_TYPE
        if self.checksum.size and (not star or not self._is_right(body, stated)):
            return BAD_CRC
        try:
            flags, sequence = (self._number(head, of, absent) for of, absent in (("flags", 0), ("sequence", -1)))
            return name, flags, sequence, self._payload(name, found[len(self.head) :], body)
        except (_NoNumberError, struct.error, OverflowError):
            return BAD_LENGTH

    def _is_right(self, body: bytes, stated: bytes) -> bool:
        digits = 2 * self.checksum.size
        return stated.strip().upper() == b"%0*X" % (digits, self.checksum.compute(body))

    def _number(self, head: Mapping[str, str], name: str, absent: int) -> int:
        if name not in head:
            return absent
        number = _hex(head[name]) if name in self.hexadecimal else _whole(head[name])
        if number < 0 or (name == "sequence" and number >= self.header.sequence_modulus):
            raise _NoNumberError
        return number

    def _payload(self, name: str, found: Sequence[str], body: bytes) -> bytes:
        message = self.messages.get(name)
        if message is None:
            return body
        many = (len(found) - len(message.fields)) // max(len(message.slot), 1)
        many = many if message.count_at is not None else message.slots
        layout = (*message.fields, *(many * message.slot))
        if len(found) != len(layout) or many > message.slots:
            raise _NoNumberError
        numbers = [of.read(word) for of, word in zip(layout, found, strict=True)]
        if message.count_at is not None and numbers[message.count_at] != many:
            raise _NoNumberError
        codes = "".join(of.code for of in layout)
        return struct.pack(self.order + codes, *(n for n, of in zip(numbers, layout, strict=True) if of.code != "8x"))

    def frame(self, layout: MessageLayout, payload: bytes, sequence: int, flags: int) -> bytes:
        """The line that says a payload."""
        assert self.delimiter is not None
        head = {"sequence": sequence % (self.header.sequence_modulus or 1), "flags": flags}
        words = [
            next(word for word, code in self.words.items() if code == layout.code)
            if name == "type"
            else f"{head.get(name, 0):{'X' if name in self.hexadecimal else 'd'}}"
            for name in self.head
        ]
        message = self.messages.get(layout.name)
        if message is None:
            body = payload
        else:
            size = 8 * len(message.slot) or 1
            slots = max(len(payload) - 8 * len(message.fields), 0) // size if message.slot else 0
            of = (*message.fields, *(slots * message.slot))
            numbers = iter(struct.unpack(self.order + "".join(one.code for one in of), payload))
            words += [one.write(0 if one.code == "8x" else next(numbers)) for one in of]
            body = self.separator.join(words).encode()
        line = self.begin + body
        if self.checksum.size:
            line += b"*%0*X" % (2 * self.checksum.size, self.checksum.compute(body))
        if len(line) > self.limit:
            raise EncodeError(f"the line has {len(line)} characters, over the length_limit of {self.limit}")
        return self.delimiter.packed(line)


def compile_text(
    description: Description, layouts: Mapping[str, MessageLayout], source: DescriptionSource
) -> TextLayout:
    """The layout of the lines of a description."""
    base = compile_frame(description, layouts, source)
    framing, messages = description.framing, description.every_message
    if description.checksum.covers is not None:
        raise source.error("a line's checksum is over all that stands before it", ("checksum", "covers"))
    for number, field in enumerate(description.header):
        wanted = ("word",) if field.name == "type" else ("decimal", "hex")
        if field.name != SPARE and field.type not in wanted:
            raise source.error(f"is {field.type!r}: expected {' or '.join(wanted)}", ("header", number, "type"))
        if field.name in ("length", "destination", "source"):
            raise source.error("a line has none", ("header", number, "name"))
    words = {str(message.code): layouts[name].code for name, message in messages.items() if message.code is not None}
    return TextLayout(
        **{field.name: getattr(base, field.name) for field in fields(base) if field.name not in ("begin", "delimiter")},
        begin=(framing.begin or "").encode(),
        delimiter=LINE,
        separator=framing.separator or ",",
        order=order_of(description.byte_order),
        head=tuple(field.name for field in description.header),
        hexadecimal=frozenset(field.name for field in description.header if field.type == "hex"),
        words=words,
        messages={
            name: _message(description, name, layouts[name], words, source)
            for name, message in messages.items()
            if not message.ignored
        },
        limit=description.length_limit,
    )


def _message(
    description: Description, name: str, layout: MessageLayout, words: Mapping[str, int], source: DescriptionSource
) -> TextMessage:
    message, path = description.every_message[name], description.fields_path(name)
    kinds = {field.name: field.role.kind for field in layout.fields}
    own: list[TextField] = []
    count_at = None
    for number, field in enumerate(message.fields):
        if field.name == "count" and message.slots and message.slots.count:
            count_at = len(own)
        own += [_field(field, kinds, words, source, (*path, number))] * (field.array or 1)
    kinds = {item.name: item.role.kind for item in layout.items}
    for number, item in enumerate(message.items):
        own += [_field(item, kinds, words, source, (*path[:2], "items", number))] * (item.array or 1)
    slots = message.slots
    kinds = {field.name: field.role.kind for field in layout.slots.fields} if layout.slots else {}
    slot = [
        _field(field, kinds, words, source, (*path[:2], "slots", "fields", number))
        for number, field in enumerate(slots.fields if slots else ())
    ]
    return TextMessage(tuple(own), tuple(slot), layout.slots.repeat if layout.slots else 0, count_at)


def _field(
    field: FieldDescription, kinds: Mapping[str, Kind], words: Mapping[str, int], source: DescriptionSource, path: Any
) -> TextField:
    for key in ("offset", "mask"):
        if getattr(field, key) is not None:
            raise source.error("a field of a line has none: it stands after the one before it", (*path, key))
    if field.name == SPARE:
        return TextField("8x", lambda word: 0, lambda number: str(field.value or 0))
    kind = kinds[field.name]
    match field.type:
        case "hex":
            return TextField("q", _hex, lambda number: f"{int(number):X}")
        case "iso":
            return TextField("q", _iso, _iso_text)
        case "word":
            own = field.words or {word: number for number, word in (field.values or {}).items()}
            named = words if kind is Kind.COMMAND else own
            if not named:
                raise source.error("a word needs `values`", (*path, "type"))
            return TextField("q", lambda word: _named(named, word), lambda number: _name(named, number))
        case _ if kind is Kind.NUMBER:
            digits = field.digits
            return TextField("d", _decimal, repr if digits is None else lambda number: f"{number:.{digits}f}")
        case _ if counts_digits(field, kind):
            last = Decimal(1).scaleb(-(field.digits or 0))
            return TextField("q", lambda word: _counted(word, last), lambda number: f"{int(number) * last:f}")
        case _:
            return TextField("q", _whole, lambda number: str(int(number)))


def _named(numbers: Mapping[str, int], word: str) -> int:
    if word not in numbers:
        raise _NoNumberError
    return numbers[word]


def _name(numbers: Mapping[str, int], number: Number) -> str:
    word = next((word for word, of in numbers.items() if of == number), None)
    if word is None:
        raise EncodeError(f"no word stands for {number}: known are {', '.join(numbers)}")
    return word


def _whole(word: str) -> int:
    if not _WHOLE.fullmatch(word):
        raise _NoNumberError
    return int(word)


def _hex(word: str) -> int:
    if not _HEX.fullmatch(word):
        raise _NoNumberError
    return int(word, 16)


def _decimal(word: str) -> float:
    if not _DECIMAL.fullmatch(word):
        raise _NoNumberError
    return float(word)


def _counted(word: str, last: Decimal) -> int:
    if not _DECIMAL.fullmatch(word):
        raise _NoNumberError
    return int((Decimal(word) / last).to_integral_value())


def _iso(word: str) -> int:
    """Microseconds since 1970, in the scale of the text; a leap second is the first one of the next minute."""
    found = _ISO.fullmatch(word)
    if found is None:
        raise _NoNumberError
    year, month, day, hour, minute, second = map(int, found.groups()[:6])
    if hour > 23 or minute > 59 or second > 60:
        raise _NoNumberError
    try:
        days = date(year, month, day).toordinal() - _EPOCH
    except ValueError:
        raise _NoNumberError from None
    ns = int((found[7] or "0").ljust(9, "0"))
    return ((days * 24 + hour) * 60 + minute) * 60_000_000 + second * 1_000_000 + round(ns / 1000)


def _iso_text(number: Number) -> str:
    try:
        at = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(number))
    except OverflowError:
        raise EncodeError(f"time cannot be {number} us: expected a year from 1970 to 9999") from None
    return at.strftime("%Y-%m-%dT%H:%M:%S.%f") + "Z"
