"""Compiles a protocol description: the layout of its frames and of its messages."""

import dataclasses
import difflib
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from protocols.checksum import CHECKSUMS, Checksum
from protocols.delimiter import DELIMITERS, Delimiter
from protocols.description import (
    TEXT_TYPES,
    ChecksumDescription,
    CoversDescription,
    Description,
    FieldDescription,
    FramingDescription,
    MessageDescription,
    SequenceDescription,
)
from protocols.frame import BAD_CRC, BAD_LENGTH, NOT_FOR_US, UNKNOWN_TYPE, Reason
from protocols.messages import AttitudeMessage
from protocols.reading import DescriptionSource, Path
from protocols.record import FieldLayout, Placed, bits, check_words, compile_record, free_roles, order_of, place
from protocols.vocabulary import FORMS, HEADER_FIELDS, QUATERNION, SPARE, TIMES_OF_COMMANDS, Form, Role

# The header of a frame: type, flags, length, sequence number and addresses, where the protocol has them.

_READ = ("type", "flags", "length", "sequence")
_ABSENT = (0, 0, None, -1)
"""What a header without one of these fields says."""
_SYNC, _LENGTH, _STUFFED, _LINE, _CLASS = "sync", "length", "stuffed", "line", "class"
"""The framings that no entry of DELIMITERS makes."""
_CODES = {1: "B", 2: "H", 4: "I", 8: "Q"}
_KEYS_OF = {
    _SYNC: ("sync_word", "end_word"),
    _LENGTH: ("end_word",),
    _STUFFED: ("start", "end", "escape"),
    _LINE: ("separator", "begin"),
    _CLASS: ("name", "distribution", "version", "sha256"),
}


@dataclass(frozen=True, slots=True)
class HeaderLayout:
    """Layout of the header's numbers.

    ``fields`` are shift and width in bits of each in the number that all bytes of the header make together. Where all
    are whole numbers of their own, ``packed`` reads them faster: ``names`` is their order in it, ``places`` those of
    type, flags, length and sequence in it, or beyond it in _ABSENT. The length field says payload bytes =
    factor * count + zero. ``fixed`` is a mask, and what all frames have there.
    """

    size: int
    byte_order: Literal["big", "little"]
    fields: Mapping[str, tuple[int, int]]
    fixed: tuple[int, int]
    packed: struct.Struct | None
    names: tuple[str, ...]
    places: tuple[int, int, int, int]
    length_factor: int
    length_zero: int
    sequence_modulus: int
    flag_names: Mapping[int, str]

    @property
    def largest_type(self) -> int:
        """The highest type code that fits."""
        return self._largest("type")

    @property
    def largest_flags(self) -> int:
        """All flags set; 0 without flags."""
        return self._largest("flags")

    def _largest(self, name: str) -> int:
        return 2 ** self.fields[name][1] - 1 if name in self.fields else 0

    def can_say_length(self, size: int) -> bool:
        """Whether the length field, if there is one, can say this payload length."""
        if "length" not in self.fields:
            return True
        count, rest = divmod(size - self.length_zero, self.length_factor)
        return rest == 0 and 0 <= count <= self._largest("length")

    def read(self, frame: bytes | bytearray, offset: int) -> tuple[int, int, int | None, int]:
        """Type, flags, payload length (None if the header does not say) and sequence number (-1 without one).

        A type of -1 is that of a header in which something else stands where all frames of the protocol are the same.
        """
        if self.packed is None:
            return self._read_bits(frame, offset)
        values = (*self.packed.unpack_from(frame, offset), *_ABSENT)
        code, flags, length, sequence = self.places
        stated = values[length]
        if stated is not None:
            stated = self.length_factor * stated + self.length_zero
        return values[code], values[flags], stated, values[sequence]

    def _read_bits(self, frame: bytes | bytearray, offset: int) -> tuple[int, int, int | None, int]:
        whole = int.from_bytes(frame[offset : offset + self.size], self.byte_order)
        code, flags, length, sequence = (self._field(whole, *of) for of in zip(_READ, _ABSENT, strict=True))
        mask, value = self.fixed
        if length is not None:
            length = self.length_factor * length + self.length_zero
        return code if whole & mask == value else -1, flags, length, sequence

    def _field(self, whole: int, name: str, absent: Any) -> Any:
        if name not in self.fields:
            return absent
        shift, width = self.fields[name]
        return whole >> shift & (1 << width) - 1

    def addresses(self, frame: bytes | bytearray, offset: int) -> tuple[int, int]:
        """Destination and source of a frame."""
        whole = int.from_bytes(frame[offset : offset + self.size], self.byte_order)
        return self._field(whole, "destination", -1), self._field(whole, "source", -1)

    def write(self, code: int, flags: int, size: int, sequence: int, addresses: tuple[int, int] | None = None) -> bytes:
        """The bytes of a header; the sequence number wraps, the caller has checked that the others fit."""
        values = {
            "type": code,
            "flags": flags,
            "length": (size - self.length_zero) // self.length_factor,
            "sequence": sequence % (self.sequence_modulus or 1),
        }
        if addresses:
            values["destination"], values["source"] = addresses
        whole = self.fixed[1]
        for name, (shift, width) in self.fields.items():
            whole |= (values.get(name, 0) & (1 << width) - 1) << shift
        return whole.to_bytes(self.size, self.byte_order)


def compile_header(description: Description, source: DescriptionSource) -> HeaderLayout:
    """The header of a description; DescriptionError where a field is unknown or no unsigned integer."""
    by_name: dict[str, FieldDescription] = {}
    placed = place(description.header, source, ("header",))
    size = max((p.end for p in placed), default=0)
    places: dict[str, tuple[int, int]] = {}
    mask = value = 0
    for item in placed:
        field = item.field
        assert field is not None
        low, many = bits(field)
        before = item.offset if description.byte_order == "little" else size - item.end
        where = 8 * before + low, many
        if field.name == SPARE:
            check_words(field, source, item.path)
            if field.value is not None:
                mask |= ((1 << many) - 1) << where[0]
                value |= field.value << where[0]
            continue
        _check(field, by_name, source, item.path)
        by_name[field.name] = field
        places[field.name] = where
    length, flags, sequence = (by_name.get(name) for name in ("length", "flags", "sequence"))
    packed, names = _packed(placed, mask, order_of(description.byte_order))
    return HeaderLayout(
        size=size,
        byte_order=description.byte_order,
        fields=places,
        fixed=(mask, value),
        packed=packed,
        names=names,
        places=_places(names),
        length_factor=int(length.scale or 1) if length else 1,
        length_zero=int(length.zero) if length else 0,
        sequence_modulus=_modulus(description, sequence, source),
        flag_names=(flags.bits or {}) if flags else {},
    )


def _packed(placed: Sequence[Placed], mask: int, order: str) -> tuple[struct.Struct | None, tuple[str, ...]]:
    """What reads a header whose fields are whole words, none of which is always the same; None for another."""
    fields = [p for p in placed if p.field and p.name != SPARE]
    if mask or not fields or any(p.size not in _CODES or (p.field and p.field.mask) for p in fields):
        return None, ()
    fields.sort(key=lambda p: p.offset)
    text, at = order, 0
    for item in fields:
        text += f"{item.offset - at}x{_CODES[item.size]}"
        at = item.end
    return struct.Struct(f"{text}{max(p.end for p in placed) - at}x"), tuple(p.name for p in fields)


def _modulus(description: Description, field: FieldDescription | None, source: DescriptionSource) -> int:
    """Where the sequence number wraps; 0 without one."""
    sequence = description.sequence
    if field is None:
        if sequence != SequenceDescription():
            raise source.error("the header has no field called sequence", ("sequence",))
        return 0
    largest = 2**63 if description.framing.kind == _LINE else 2 ** bits(field)[1]
    modulus = sequence.modulus or largest
    if modulus > largest:
        raise source.error(f"is {modulus}: the header's sequence has {bits(field)[1]} bits", ("sequence", "modulus"))
    if modulus % sequence.step:
        raise source.error(f"{modulus} numbers cannot be counted in steps of {sequence.step}", ("sequence", "step"))
    return modulus


def _places(names: tuple[str, ...]) -> tuple[int, int, int, int]:
    """Where ``HeaderLayout.read`` finds its four numbers."""
    code, flags, length, sequence = (
        names.index(name) if name in names else len(names) + place for place, name in enumerate(_READ)
    )
    return code, flags, length, sequence


def _check(
    field: FieldDescription, seen: Mapping[str, FieldDescription], source: DescriptionSource, path: Sequence[str | int]
) -> None:
    if field.name not in HEADER_FIELDS:
        raise source.error(f"is {field.name!r}: known here: {', '.join(HEADER_FIELDS)}; or {SPARE}", (*path, "name"))
    if field.name in seen:
        raise source.error(f"{field.name} is given twice", (*path, "name"))
    if field.type[0] != "u" and field.type not in TEXT_TYPES:
        raise source.error("expected an unsigned integer type in a header", (*path, "type"))
    whole = all(number.denominator == 1 for number in (field.scale or 1, field.zero))
    given = {
        "array": field.array is not None,
        "value": field.value is not None,
        "unit": field.unit is not None,
        "min": field.min is not None,
        "max": field.max is not None,
        "values": field.values is not None,
        "bits": field.bits is not None and field.name != "flags",
        "scale": field.scale is not None and (field.name != "length" or not whole),
        "zero": field.zero != 0 and (field.name != "length" or not whole),
    }
    for key in (key for key, is_wrong in given.items() if is_wrong):
        raise source.error(f"a header's {field.name} has no {key}, or not this one", (*path, key))
    check_words(field, source, path)


@dataclass(frozen=True, slots=True)
class SlotsLayout:
    """The slots of a panorama, or of STARS: up to ``repeat`` times the same record from ``offset`` on.

    ``are_counted`` where a payload ends with the last one that is used. ``part_first`` is the number of the first of
    the frames that a panorama comes in, None where one is enough.
    """

    repeat: int
    offset: int
    dtype: np.dtype[np.void]
    fields: tuple[FieldLayout, ...]
    are_counted: bool = False
    part_first: int | None = None


@dataclass(frozen=True, slots=True)
class MessageLayout:
    """One frame type: its code, its payload length (the longest), where its numbers stand.

    ``form`` is None for a command, and for a message that has items only, or nothing that the station has a use for;
    ``item_dtype`` reads its ``items``; ``blank`` is a payload in which nothing is said yet.
    """

    name: str
    code: int
    from_sensor: bool
    size: int
    form: Form | None
    byte_order: Literal["big", "little"]
    dtype: np.dtype[np.void]
    fields: tuple[FieldLayout, ...]
    slots: SlotsLayout | None
    blank: bytes
    items: tuple[FieldLayout, ...]
    item_dtype: np.dtype[np.void]
    is_command: bool

    def can_have(self, size: int) -> bool:
        """Whether a payload can have so many bytes."""
        counted = _counted(self)
        return size == self.size if counted is None else counted.can_be(size)


@dataclass(frozen=True, slots=True)
class Counted:
    """A payload of ``base`` bytes, and ``record`` bytes for each of up to ``most`` objects.

    Their number is ``width`` bits from ``shift`` on in the word of ``size`` bytes at ``offset``.
    """

    base: int
    record: int
    most: int
    offset: int
    size: int
    shift: int
    width: int
    byte_order: Literal["big", "little"]

    def can_be(self, size: int) -> bool:
        """Whether a payload can have so many bytes."""
        count, rest = divmod(size - self.base, self.record)
        return rest == 0 and 0 <= count <= self.most

    def stated(self, buffer: bytes | bytearray, payload_at: int) -> int:
        """The bytes of the payload that begins there; -1 if it says that it has more objects than it can."""
        at = payload_at + self.offset
        word = int.from_bytes(buffer[at : at + self.size], self.byte_order)
        count = word >> self.shift & (1 << self.width) - 1
        return self.base + count * self.record if count <= self.most else -1


class Addresses(NamedTuple):
    """Addresses on a line that several share."""

    sensor: int
    host: int


class Refused(NamedTuple):
    """A frame that is whole and not to be used, of so many bytes from its begin on."""

    size: int
    reason: Reason


@dataclass(frozen=True, slots=True)
class FrameLayout:
    """All that framing needs to know: [sync word] header payload checksum [end word].

    ``sync_word`` is empty where a ``delimiter`` tells frames apart, or nothing does; ``names`` and ``sizes`` are the
    message and the (longest) payload of each type code; ``exact`` are the sizes of those that have one, ``counted``
    tells those of the others. ``covers`` are the bytes from the begin of the frame that the checksum begins and ends
    with, None where it ends with the payload. ``tail`` is the size of checksum and end word.

    ``other`` is the layout of the frames that go the other way, where they are looked for. ``begin`` is the first byte
    of a line.
    """

    sync_word: bytes
    end_word: bytes
    escape: bytes
    delimiter: Delimiter | None
    header: HeaderLayout
    checksum: Checksum
    checksum_little: bool
    covers: tuple[int, int | None]
    tail: int
    names: Mapping[int, str]
    sizes: Mapping[int, int]
    exact: Mapping[int, int]
    counted: Mapping[int, Counted]
    addresses: Addresses | None = None
    from_sensor: bool | None = None
    other: "FrameLayout | None" = None
    begin: bytes = b""

    @property
    def overhead(self) -> int:
        """Bytes of a frame that are not payload, as they are before a delimiter packs them."""
        return len(self.sync_word) + self.header.size + self.tail

    @property
    def largest(self) -> int:
        """Bytes of the largest frame, as they are before a delimiter packs them."""
        return self.overhead + max(self.sizes.values(), default=0)

    def checksum_of(self, frame: bytes) -> bytes:
        """The checksum field of a frame that stands here without it, its sync word included."""
        start, end = self.covers
        value = self.checksum.compute(frame[start:end] if start or end is not None else frame)
        return value.to_bytes(self.checksum.size, "little" if self.checksum_little else "big")

    def is_checksum_right(self, frame: bytes) -> bool:
        """Whether a whole frame, sync word to end word, is as it was sent."""
        end = len(frame) - self.tail
        return self.checksum_of(frame[:end]) + self.end_word == frame[end:]

    def is_for_us(self, frame: bytes | bytearray, header_at: int) -> bool:
        """Whether a frame goes between the sensor and the host of these addresses, in this layout's direction."""
        if self.addresses is None or self.from_sensor is None:
            return True
        sensor, host = self.addresses
        return self.header.addresses(frame, header_at) == ((host, sensor) if self.from_sensor else (sensor, host))

    def examine(self, content: bytes) -> tuple[str, int, int, bytes] | Reason:
        """Message, flags, sequence number and payload of a frame that is whole, or why it is none.

        It stands here as it was before it was packed, from its sync word to its end word where it has them.
        """
        header_at = len(self.sync_word)
        if len(content) < self.overhead - self.checksum.size:
            return BAD_LENGTH
        code, flags, length, sequence = self.header.read(content, header_at)
        if self.addresses is not None and not self.is_for_us(content, header_at) and self.is_checksum_right(content):
            return NOT_FOR_US
        name = self.names.get(code)
        if name is None:
            return UNKNOWN_TYPE
        there = len(content) - self.overhead
        size = self.exact[code] if code in self.exact else self._counted_size(code, content, there)
        if there != size or (length is not None and length != size):
            return BAD_LENGTH
        if not self.is_checksum_right(content):
            return BAD_CRC
        payload_at = header_at + self.header.size
        return name, flags, sequence, content[payload_at : payload_at + size]

    def _counted_size(self, code: int, content: bytes, there: int) -> int:
        counted = self.counted[code]
        return counted.stated(content, len(self.sync_word) + self.header.size) if there >= counted.base else -1

    def frame(self, layout: MessageLayout, payload: bytes, sequence: int, flags: int) -> bytes:
        """The bytes on the wire of a payload."""
        way = None
        if self.addresses is not None:
            sensor, host = self.addresses
            way = (host, sensor) if layout.from_sensor else (sensor, host)
        content = self.sync_word + self.header.write(layout.code, flags, len(payload), sequence, way) + payload
        content += self.checksum_of(content)
        if self.delimiter:
            return self.delimiter.packed(content)
        if self.escape:
            begin = len(self.sync_word)
            content = content[:begin] + content[begin:].replace(self.escape, 2 * self.escape)
        return content + self.end_word


def compile_frame(
    description: Description, layouts: Mapping[str, MessageLayout], source: DescriptionSource
) -> FrameLayout:
    """Framing, header and checksum of a description."""
    framing, checksum = description.framing, _checksum(description.checksum, source)
    delimiter = _delimiter(framing, source)
    sync_word, end_word, escape = (
        bytes.fromhex(word or "")
        for word in (framing.sync_word or framing.start, framing.end_word or framing.end, framing.escape)
    )
    header = compile_header(description, source)
    _check_addresses(description, header, source)
    _check_codes(description, layouts, header, source)
    addresses = description.addresses
    return FrameLayout(
        sync_word=sync_word,
        end_word=end_word,
        escape=escape,
        delimiter=delimiter,
        header=header,
        checksum=checksum,
        checksum_little=(description.checksum.byte_order or description.byte_order) == "little",
        covers=_covers(description, len(sync_word), header, source),
        tail=checksum.size + len(end_word),
        addresses=Addresses(addresses.sensor, addresses.host) if addresses else None,
        **_tables(layouts.values()),
    )


def one_way(
    layout: FrameLayout, layouts: Iterable[MessageLayout], *, from_sensor: bool, echoes: bool = False
) -> FrameLayout:
    """The layout of the frames of one direction; with ``echoes`` those of the other one are recognised."""
    mine, others = ([of for of in layouts if of.from_sensor is way] for way in (from_sensor, not from_sensor))
    other = dataclasses.replace(layout, **_tables(others), from_sensor=not from_sensor) if echoes else None
    return dataclasses.replace(layout, **_tables(mine), from_sensor=from_sensor, other=other)


def _tables(layouts: Iterable[MessageLayout]) -> dict[str, Any]:
    """The tables of a FrameLayout by type code; where one code goes both ways, that of the sensor's message."""
    by_code = {of.code: of for of in sorted(layouts, key=lambda of: of.from_sensor)}
    counted = {code: made for code, of in by_code.items() if (made := _counted(of)) is not None}
    sizes = {code: of.size for code, of in by_code.items()}
    return {
        "names": {code: of.name for code, of in by_code.items()},
        "sizes": sizes,
        "exact": {code: size for code, size in sizes.items() if code not in counted},
        "counted": counted,
    }


def _counted(layout: MessageLayout) -> Counted | None:
    slots = layout.slots
    if slots is None or not slots.are_counted:
        return None
    field = next(field for field in layout.fields if field.name == "count")
    dtype, offset = layout.dtype.fields["count"][:2]  # type: ignore[index]
    order: Literal["big", "little"] = "little" if layout.byte_order == "little" else "big"
    record = slots.dtype.itemsize
    return Counted(slots.offset, record, slots.repeat, offset, dtype.itemsize, field.shift, field.width, order)


def compile_messages(description: Description, source: DescriptionSource) -> dict[str, MessageLayout]:
    """The layout of every message, by name."""
    for name in description.commands:
        if name in description.messages:
            raise source.error("is a message already: expected another name", ("commands", name))
    return {
        name: _compile_message(name, message, description, source)
        for name, message in description.every_message.items()
    }


def _delimiter(description: FramingDescription, source: DescriptionSource) -> Delimiter | None:
    """What ends each frame; None where a sync word begins it, or nothing tells frames apart."""
    kinds = (*_KEYS_OF, *DELIMITERS)
    if description.kind not in kinds:
        raise source.error(f"is {description.kind!r:.60}: expected one of {', '.join(kinds)}", ("framing", "kind"))
    known = _KEYS_OF.get(description.kind, ())
    for key in dict.fromkeys(key for keys in _KEYS_OF.values() for key in keys):
        if getattr(description, key) is not None and key not in known:
            raise source.error(f"a framing of the kind {description.kind} has none", ("framing", key))
    needed = known if description.kind == _STUFFED else known[:1] if description.kind in (_SYNC, _CLASS) else ()
    for key in needed:
        if getattr(description, key) is None:
            raise source.error("is missing", ("framing", key))
    if description.kind == _STUFFED:
        _check_stuffing(description, source)
    return DELIMITERS.get(description.kind)


def _check_stuffing(description: FramingDescription, source: DescriptionSource) -> None:
    start, end, escape = (bytes.fromhex(of or "") for of in (description.start, description.end, description.escape))
    if len(escape) != 1:
        raise source.error("expected one byte", ("framing", "escape"))
    for key, word in (("start", start), ("end", end)):
        if len(word) != 2 or word[:1] != escape or word[1:] == escape:
            raise source.error(
                f"expected two bytes: the escape {escape.hex().upper()}, and another one", ("framing", key)
            )
    if start == end:
        raise source.error("is the start, too: expected another word", ("framing", "end"))


def _checksum(description: ChecksumDescription, source: DescriptionSource) -> Checksum:
    if description.name not in CHECKSUMS:
        near = difflib.get_close_matches(description.name, CHECKSUMS, n=4, cutoff=0)
        text = f"is {description.name!r:.60}: expected one of {', '.join(near)}; docs/protocols.md has all"
        raise source.error(text, ("checksum", "name"))
    return CHECKSUMS[description.name]


def _covers(
    description: Description, sync: int, header: HeaderLayout, source: DescriptionSource
) -> tuple[int, int | None]:
    """The bytes of a frame that the checksum is over, from its first one on."""
    checksum = description.checksum
    if checksum.covers_sync_word and (not sync or checksum.covers):
        raise source.error(
            "expected no covers beside it" if sync else f"{_title(description)} has no sync word",
            ("checksum", "covers_sync_word"),
        )
    covers = checksum.covers or CoversDescription(**{"from": "sync word" if checksum.covers_sync_word else "header"})
    placed = place(description.header, source, ("header",))
    starts = {"sync word": 0, "header": sync, "payload": sync + header.size}
    ends: dict[str, int | None] = {"header": sync + header.size, "payload": None}
    for item in placed:
        if item.name != SPARE:
            starts[item.name], ends[item.name] = sync + item.offset, sync + item.end
    if covers.start not in starts or (covers.start == "sync word" and not sync):
        known = [name for name in starts if name != "sync word" or sync]
        raise source.error(
            f"is {covers.start!r:.60}: expected one of {', '.join(known)}", ("checksum", "covers", "from")
        )
    if covers.end not in ends:
        raise source.error(f"is {covers.end!r:.60}: expected one of {', '.join(ends)}", ("checksum", "covers", "to"))
    start, end = starts[covers.start], ends[covers.end]
    if end is not None and end <= start:
        raise source.error("stands before the begin of what it covers", ("checksum", "covers", "to"))
    return start, end


def _title(description: Description) -> str:
    kind = description.framing.kind
    return DELIMITERS[kind].name if kind in DELIMITERS else f"a framing of the kind {kind}"


def _check_addresses(description: Description, header: HeaderLayout, source: DescriptionSource) -> None:
    there = [name in header.fields for name in ("destination", "source")]
    if any(there) and (not all(there) or description.addresses is None):
        raise source.error(
            "a header with destination and source needs both, and `addresses: {sensor: .., host: ..}`", ("header",)
        )
    if description.addresses is not None:
        if not all(there):
            raise source.error("the header has no destination and source", ("addresses",))
        for key in ("sensor", "host"):
            address = getattr(description.addresses, key)
            if any(address >= 2 ** header.fields[name][1] for name in ("destination", "source")):
                raise source.error(f"{address} does not fit the header", ("addresses", key))


def _check_codes(
    description: Description, layouts: Mapping[str, MessageLayout], header: HeaderLayout, source: DescriptionSource
) -> None:
    taken: dict[tuple[bool, int], str] = {}
    for name, message in description.every_message.items():
        path = description.fields_path(name)[:2]
        layout = layouts[name]
        key = layout.from_sensor, layout.code
        if key in taken:
            if "type" not in header.fields:
                raise source.error(
                    f"a header without type cannot tell it from {taken[key]}: expected one message {message.direction}",
                    path,
                )
            raise source.error(f"{_code(message)} is the code of {taken[key]} already", (*path, "code"))
        taken[key] = name
        if description.framing.kind == _LINE:
            continue
        if layout.code > header.largest_type:
            raise source.error(f"0x{layout.code:X} does not fit the header's type field", (*path, "code"))
        if layout.size > description.length_limit:
            raise source.error(
                f"the payload has {layout.size} bytes, over the length_limit of {description.length_limit}",
                (*path, "length"),
            )
        least = layout.slots.offset if layout.slots and layout.slots.are_counted else layout.size
        for size in (least, layout.size):
            if not header.can_say_length(size):
                raise source.error(
                    f"{size} bytes of payload cannot be said by the header's length field", (*path, "length")
                )


def _code(message: MessageDescription) -> str:
    return f"0x{message.code:02X}" if isinstance(message.code, int) else f"{message.code!r}"


def _size(message: MessageDescription, source: DescriptionSource, path: Path) -> int:
    if message.ignored:
        if message.length is None or message.fields or message.slots or message.items:
            raise source.error("an ignored message has a length instead of fields", path[:2])
        return message.length
    end = max((p.end for p in _placed(message, source, path)), default=0)
    if message.length is not None and message.length != end:
        raise source.error(f"is {message.length}, but the fields take {end} bytes", (*path[:2], "length"))
    return end


def _placed(message: MessageDescription, source: DescriptionSource, path: Path) -> list[Placed]:
    """Fields, items and slots in their places; the slots as one block. ``path`` is that of the fields."""
    return place(
        message.fields,
        source,
        path,
        slots=message.slots,
        slots_path=(*path[:2], "slots"),
        items=message.items,
        items_path=(*path[:2], "items"),
    )


def _compile_message(
    name: str, message: MessageDescription, description: Description, source: DescriptionSource
) -> MessageLayout:
    path = description.fields_path(name)
    is_command = message.direction == "to sensor" and not message.ignored
    form = None if message.ignored or is_command else FORMS.get(name)
    if form is None and not (message.ignored or is_command or (message.items and not message.fields)):
        raise source.error(
            f"unknown message; known are {', '.join(FORMS)}; a message of its own has `items` and no fields; "
            "`ignored: true` describes one that the station skips",
            path[:2],
        )
    if is_command and message.items:
        raise source.error("the sensor sends items: a command has arguments", (*path[:2], "items"))
    roles = form.roles if form else {}
    if is_command:
        roles = free_roles(message.fields, source, path, TIMES_OF_COMMANDS.get(name, "").split())
    _check_types(name, message, description, source)
    placed = _placed(message, source, path)
    size = _size(message, source, path)
    of_fields = [p for p in placed if p.field and p.path[:-1] == path]
    fields, dtype = compile_record(of_fields, roles, size, description, source)
    items_path = (*path[:2], "items")
    of_items = [p for p in placed if p.field and p.path[:-1] == items_path]
    item_roles = free_roles(message.items, source, items_path)
    items, item_dtype = compile_record(of_items, item_roles, size, description, source)
    has_time = description.time is None or description.time.scale != "host"
    needed = {name: role for name, role in roles.items() if has_time or name != "time"}
    _check_required(needed, fields, source, path)
    _check_time(fields, source, path)
    if form and form.message is AttitudeMessage:
        _check_direction(fields, source, path)
    return MessageLayout(
        name=name,
        code=_number(message, description, source, path[:2]),
        from_sensor=message.direction == "from sensor",
        byte_order=description.byte_order,
        size=size,
        form=form,
        dtype=dtype,
        fields=fields,
        slots=_slots(name, message, placed, form, description, source) if form else None,
        blank=_blank(placed, size, description),
        items=items,
        item_dtype=item_dtype,
        is_command=is_command,
    )


def _number(message: MessageDescription, description: Description, source: DescriptionSource, path: Path) -> int:
    """The code as a number; words are numbered in the order of the description."""
    code, has_type = message.code, any(field.name == "type" for field in description.header)
    is_line = description.framing.kind == _LINE
    if (code is None) is has_type:
        raise source.error("is missing" if has_type else "the header has no type", (*path, "code"))
    if code is None:
        return 0
    if isinstance(code, str) is not is_line:
        raise source.error(f"is {code!r:.60}: expected {'a word' if is_line else 'a number'}", (*path, "code"))
    words = list(dict.fromkeys(other.code for other in description.every_message.values()))
    return words.index(code) if isinstance(code, str) else code


def _check_types(name: str, message: MessageDescription, description: Description, source: DescriptionSource) -> None:
    """Lines have fields of text, other frames have none."""
    is_line = description.framing.kind == _LINE
    groups: list[tuple[Sequence[FieldDescription], Path]] = [
        (description.header, ("header",)),
        (message.fields, description.fields_path(name)),
        (message.items, ("messages", name, "items")),
    ]
    if message.slots:
        groups.append((message.slots.fields, ("messages", name, "slots", "fields")))
    for fields, path in groups:
        for number, field in enumerate(fields):
            if (field.type in TEXT_TYPES) is not is_line:
                expected = ", ".join(TEXT_TYPES) if is_line else "an integer or a float of so many bits"
                raise source.error(f"is {field.type!r}: expected {expected}", (*path, number, "type"))


def _blank(placed: Sequence[Placed], size: int, description: Description) -> bytes:
    """A payload with nothing but the spare bits that always are the same."""
    blank = bytearray(size)
    for item in placed:
        if item.field is not None and item.field.name == SPARE and item.field.value:
            word = int.from_bytes(blank[item.offset : item.end], description.byte_order)
            word |= item.field.value << bits(item.field)[0]
            blank[item.offset : item.end] = word.to_bytes(item.size, description.byte_order)
    return bytes(blank)


def _slots(
    name: str,
    message: MessageDescription,
    placed: Sequence[Placed],
    form: Form,
    description: Description,
    source: DescriptionSource,
) -> SlotsLayout | None:
    slots, path = message.slots, ("messages", name, "slots")
    if slots is None:
        if form.slot_roles:
            raise source.error(f"is missing: {name} is a number of slots with {', '.join(form.slot_roles)}", path)
        return None
    block = placed[-1]
    if not form.slot_roles:
        raise source.error("only PANORAMA and STARS have slots", block.path)
    names = [field.name for field in message.fields]
    if (slots.repeat is None) is (slots.count is None and slots.most is None):
        raise source.error("expected repeat, or count and most", path)
    if slots.count is not None or slots.most is not None:
        if slots.count is None or slots.most is None:
            raise source.error("is missing", (*path, "most" if slots.most is None else "count"))
        if "count" not in names:
            raise source.error("is missing: it says how many slots follow", ("messages", name, "fields"))
        if message.length is not None:
            raise source.error("depends on the count: leave it out", ("messages", name, "length"))
        if any(item.offset >= block.offset for item in placed[:-1]):
            raise source.error("slots by count stand at the end of the payload", path)
    if slots.parts and not {"part", "parts"} <= set(names):
        raise source.error("needs the fields part and parts", (*path, "parts"))
    if {"part", "parts"} & set(names) and not slots.parts:
        raise source.error("is missing: the message has the fields part and parts", (*path, "parts"))
    inner = place(slots.fields, source, (*path, "fields"))
    record = max(item.end for item in inner)
    fields, dtype = compile_record(inner, form.slot_roles, record, description, source)
    _check_required(form.slot_roles, fields, source, (*path, "fields"))
    return SlotsLayout(
        slots.repeat or slots.most or 1,
        block.offset,
        dtype,
        fields,
        are_counted=slots.count is not None,
        part_first=slots.parts.first if slots.parts else None,
    )


def _check_required(
    roles: Mapping[str, Role], fields: Sequence[FieldLayout], source: DescriptionSource, path: Path
) -> None:
    for name, role in roles.items():
        if role.required and all(field.name != name for field in fields):
            raise source.error(f"{name} is missing", path)


def _check_time(fields: Sequence[FieldLayout], source: DescriptionSource, path: Path) -> None:
    """A time in several fields: each finer one counts up to one of the next coarser."""
    parts = sorted((field for field in fields if field.role.attribute == "time_us"), key=lambda field: -field.factor)
    if len(parts) < 2:
        return
    if any(field.is_float for field in parts):
        raise source.error("a time in several fields is one of whole numbers", path)
    for coarse, fine in pairwise(parts):
        if (coarse.factor / fine.factor).denominator != 1:
            raise source.error(f"{fine.name} does not divide the coarser {coarse.name}", path)


def _check_direction(fields: Sequence[FieldLayout], source: DescriptionSource, path: Path) -> None:
    """An ATTITUDE has RA and DE, or a whole quaternion."""
    names = {field.name for field in fields}
    if not names.issuperset(("ra", "de")) and not names.issuperset(QUATERNION):
        raise source.error(f"no direction: expected ra and de, or {', '.join(QUATERNION)}", path)
