"""Compiles a protocol description: the layout of its frames and of its messages."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from protocols.checksum import CHECKSUMS, Checksum
from protocols.delimiter import DELIMITERS, Delimiter
from protocols.description import (
    ChecksumDescription,
    Description,
    FieldDescription,
    FramingDescription,
    MessageDescription,
)
from protocols.messages import AttitudeMessage
from protocols.reading import DescriptionSource, Path
from protocols.record import FieldLayout, Placed, check_words, compile_record, order_of, place, width
from protocols.vocabulary import FORMS, HEADER_FIELDS, QUATERNION, SPARE, Form, Role

# The header of a frame: type, flags, length and sequence number, where the protocol has them.

_READ = ("type", "flags", "length", "sequence")
_ABSENT = (None, 0, None, -1)
"""What a header without one of these fields says."""
_SYNC = "sync"
"""The framing without a delimiter."""
_CODES = {1: "B", 2: "H", 4: "I", 8: "Q"}


@dataclass(frozen=True, slots=True)
class HeaderLayout:
    """Layout of the header's numbers.

    ``names`` are the fields in the order of ``packed``, ``places`` those of type, flags, length and sequence in it, or
    beyond it in _ABSENT; the length field says payload bytes = factor * count + zero.
    """

    packed: struct.Struct
    names: tuple[str, ...]
    places: tuple[int, int, int, int]
    widths: Mapping[str, int]
    length_factor: int
    length_zero: int
    flag_names: Mapping[int, str]

    @property
    def size(self) -> int:
        """Bytes of the header."""
        return self.packed.size

    @property
    def largest_type(self) -> int:
        """The highest type code that fits."""
        return int(256 ** self.widths["type"] - 1)

    @property
    def largest_flags(self) -> int:
        """All flags set; 0 without flags."""
        return int(256 ** self.widths.get("flags", 0) - 1)

    @property
    def sequence_modulus(self) -> int:
        """Where the sequence number wraps; 0 without one."""
        return int(256 ** self.widths["sequence"]) if "sequence" in self.widths else 0

    def can_say_length(self, size: int) -> bool:
        """Whether the length field, if there is one, can say this payload length."""
        if "length" not in self.widths:
            return True
        count, rest = divmod(size - self.length_zero, self.length_factor)
        return rest == 0 and 0 <= count < 256 ** self.widths["length"]

    def read(self, frame: bytes | bytearray, offset: int) -> tuple[int, int, int | None, int]:
        """Type, flags, payload length (None if the header does not say) and sequence number (-1 without one)."""
        values = (*self.packed.unpack_from(frame, offset), *_ABSENT)
        code, flags, length, sequence = self.places
        stated = values[length]
        if stated is not None:
            stated = self.length_factor * stated + self.length_zero
        return values[code], values[flags], stated, values[sequence]

    def write(self, code: int, flags: int, size: int, sequence: int) -> bytes:
        """The bytes of a header; the sequence number wraps, the caller has checked that the others fit."""
        values = {
            "type": code,
            "flags": flags,
            "length": (size - self.length_zero) // self.length_factor,
            "sequence": sequence % (self.sequence_modulus or 1),
        }
        return self.packed.pack(*(values[name] for name in self.names))


def compile_header(fields: Sequence[FieldDescription], order: str, source: DescriptionSource) -> HeaderLayout:
    """The header of a description; DescriptionError where a field is unknown or no unsigned integer."""
    by_name: dict[str, FieldDescription] = {}
    placed = place(fields, source, ("header",))
    for item in placed:
        field = item.field
        assert field is not None
        if field.name == SPARE:
            continue
        _check(field, by_name, source, item.path)
        by_name[field.name] = field
    if "type" not in by_name:
        raise source.error("type is missing: it tells the messages apart", ("header",))
    length = by_name.get("length")
    ordered = sorted((p for p in placed if p.name != SPARE), key=lambda p: p.offset)
    text, at = order, 0
    for item in ordered:
        text += f"{item.offset - at}x{_CODES[item.size]}"
        at = item.end
    flags = by_name.get("flags")
    names = tuple(item.name for item in ordered)
    return HeaderLayout(
        packed=struct.Struct(f"{text}{max(p.end for p in placed) - at}x"),
        names=names,
        places=_places(names),
        widths={name: width(field) for name, field in by_name.items()},
        length_factor=int(length.scale or 1) if length else 1,
        length_zero=int(length.zero) if length else 0,
        flag_names=(flags.bits or {}) if flags else {},
    )


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
    if field.type[0] != "u":
        raise source.error("expected an unsigned integer type in a header", (*path, "type"))
    whole = all(number.denominator == 1 for number in (field.scale or 1, field.zero))
    given = {
        "array": field.array is not None,
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
    """The slots of a panorama: ``repeat`` times the same record from ``offset`` on."""

    repeat: int
    offset: int
    dtype: np.dtype[np.void]
    fields: tuple[FieldLayout, ...]


@dataclass(frozen=True, slots=True)
class MessageLayout:
    """One frame type: its code, its one allowed payload length, where its numbers stand.

    ``form`` is None for a message that the station has no use for.
    """

    name: str
    code: int
    from_sensor: bool
    size: int
    form: Form | None
    dtype: np.dtype[np.void]
    fields: tuple[FieldLayout, ...]
    slots: SlotsLayout | None


@dataclass(frozen=True, slots=True)
class FrameLayout:
    """All that framing needs to know: [sync word] header payload checksum.

    ``sync_word`` is empty where a ``delimiter`` tells frames apart; ``names`` and ``sizes`` are the message and the
    payload length of each type code.
    """

    sync_word: bytes
    delimiter: Delimiter | None
    header: HeaderLayout
    checksum: Checksum
    checksum_little: bool
    checksum_covers_sync_word: bool
    names: Mapping[int, str]
    sizes: Mapping[int, int]

    @property
    def overhead(self) -> int:
        """Bytes of a frame that are not payload, as they are before a delimiter packs them."""
        return len(self.sync_word) + self.header.size + self.checksum.size

    @property
    def largest(self) -> int:
        """Bytes of the largest frame, as they are before a delimiter packs them."""
        return self.overhead + max(self.sizes.values(), default=0)

    def checksum_of(self, frame: bytes) -> bytes:
        """The checksum field of a frame that stands here without it, its sync word included."""
        covered = frame if self.checksum_covers_sync_word else frame[len(self.sync_word) :]
        return self.checksum.compute(covered).to_bytes(self.checksum.size, "little" if self.checksum_little else "big")

    def is_checksum_right(self, frame: bytes) -> bool:
        """Whether a whole frame, sync word to checksum, is as it was sent."""
        return self.checksum_of(frame[: -self.checksum.size]) == frame[-self.checksum.size :]


def compile_frame(description: Description, source: DescriptionSource) -> FrameLayout:
    """Framing, header and checksum of a description."""
    framing, checksum = description.framing, description.checksum
    delimiter = _delimiter(framing, source)
    if delimiter and framing.sync_word is not None:
        byte = delimiter.end.hex().upper()
        raise source.error(
            f"{delimiter.name} has none; its END byte {byte} tells frames apart", ("framing", "sync_word")
        )
    if delimiter is None and framing.sync_word is None:
        raise source.error("is missing", ("framing", "sync_word"))
    if checksum.covers_sync_word and delimiter:
        raise source.error(f"{delimiter.name} has no sync word", ("checksum", "covers_sync_word"))
    header = compile_header(description.header, order_of(description.byte_order), source)
    _check_codes(description, header, source)
    return FrameLayout(
        sync_word=bytes.fromhex(framing.sync_word or ""),
        delimiter=delimiter,
        header=header,
        checksum=_checksum(checksum, source),
        checksum_little=(checksum.byte_order or description.byte_order) == "little",
        checksum_covers_sync_word=checksum.covers_sync_word,
        names={message.code: name for name, message in description.messages.items()},
        sizes={message.code: _size(message, source, name) for name, message in description.messages.items()},
    )


def compile_messages(description: Description, source: DescriptionSource) -> dict[str, MessageLayout]:
    """The layout of every message, by name."""
    return {
        name: _compile_message(name, message, description, source) for name, message in description.messages.items()
    }


def _delimiter(description: FramingDescription, source: DescriptionSource) -> Delimiter | None:
    """What ends each frame; None where a sync word begins it."""
    if description.kind not in (_SYNC, *DELIMITERS):
        known = ", ".join((_SYNC, *DELIMITERS))
        raise source.error(f"is {description.kind!r:.60}: expected one of {known}", ("framing", "kind"))
    return DELIMITERS.get(description.kind)


def _checksum(description: ChecksumDescription, source: DescriptionSource) -> Checksum:
    if description.name not in CHECKSUMS:
        raise source.error(f"is {description.name!r:.60}: expected one of {', '.join(CHECKSUMS)}", ("checksum", "name"))
    return CHECKSUMS[description.name]


def _check_codes(description: Description, header: HeaderLayout, source: DescriptionSource) -> None:
    taken: dict[int, str] = {}
    for name, message in description.messages.items():
        path = ("messages", name)
        if message.code in taken:
            raise source.error(f"0x{message.code:02X} is the code of {taken[message.code]} already", (*path, "code"))
        taken[message.code] = name
        if message.code > header.largest_type:
            raise source.error(f"0x{message.code:X} does not fit the header's type field", (*path, "code"))
        size = _size(message, source, name)
        if size > description.length_limit:
            raise source.error(
                f"the payload has {size} bytes, over the length_limit of {description.length_limit}", (*path, "length")
            )
        if not header.can_say_length(size):
            raise source.error(
                f"{size} bytes of payload cannot be said by the header's length field", (*path, "length")
            )


def _size(message: MessageDescription, source: DescriptionSource, name: str) -> int:
    path = ("messages", name)
    if message.ignored:
        if message.length is None or message.fields or message.slots:
            raise source.error("an ignored message has a length instead of fields", path)
        return message.length
    end = max((p.end for p in _placed(message, source, path)), default=0)
    if message.length is not None and message.length != end:
        raise source.error(f"is {message.length}, but the fields take {end} bytes", (*path, "length"))
    return end


def _placed(message: MessageDescription, source: DescriptionSource, path: Path) -> list[Placed]:
    """Fields and slots in their places; the slots as one block."""
    return place(message.fields, source, (*path, "fields"), message.slots, (*path, "slots"))


def _compile_message(
    name: str, message: MessageDescription, description: Description, source: DescriptionSource
) -> MessageLayout:
    path = ("messages", name)
    form = None if message.ignored else FORMS.get(name)
    if form is None and not message.ignored:
        raise source.error(
            f"unknown message; known are {', '.join(FORMS)}; `ignored: true` describes one that the station skips", path
        )
    roles = form.roles if form else {}
    placed = _placed(message, source, path)
    size = _size(message, source, name)
    fields, dtype = compile_record([p for p in placed if p.field], roles, size, description, source)
    _check_required(roles, fields, source, (*path, "fields"))
    if form and form.message is AttitudeMessage:
        _check_direction(fields, source, (*path, "fields"))
    return MessageLayout(
        name=name,
        code=message.code,
        from_sensor=message.direction == "from sensor",
        size=size,
        form=form,
        dtype=dtype,
        fields=fields,
        slots=_slots(message, placed, form, description, source) if form else None,
    )


def _slots(
    message: MessageDescription,
    placed: Sequence[Placed],
    form: Form,
    description: Description,
    source: DescriptionSource,
) -> SlotsLayout | None:
    slots, path = message.slots, ("messages", "PANORAMA", "slots")
    if slots is None:
        if form.slot_roles:
            raise source.error("is missing: a panorama is a number of slots with y, x and index", path)
        return None
    block = placed[-1]
    if not form.slot_roles:
        raise source.error("only PANORAMA has slots", block.path)
    inner = place(slots.fields, source, (*path, "fields"))
    fields, dtype = compile_record(inner, form.slot_roles, block.size // slots.repeat, description, source)
    _check_required(form.slot_roles, fields, source, (*path, "fields"))
    return SlotsLayout(slots.repeat, block.offset, dtype, fields)


def _check_required(
    roles: Mapping[str, Role], fields: Sequence[FieldLayout], source: DescriptionSource, path: Path
) -> None:
    for name, role in roles.items():
        if role.required and all(field.name != name for field in fields):
            raise source.error(f"{name} is missing", path)


def _check_direction(fields: Sequence[FieldLayout], source: DescriptionSource, path: Path) -> None:
    """An ATTITUDE has RA and DE, or a whole quaternion."""
    names = {field.name for field in fields}
    if not names.issuperset(("ra", "de")) and not names.issuperset(QUATERNION):
        raise source.error(f"no direction: expected ra and de, or {', '.join(QUATERNION)}", path)
