"""Compiles a protocol description: offsets, numpy dtypes, conversions from wire counts to the station's units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from protocols.checksum import CHECKSUMS, Checksum
from protocols.description import ChecksumDescription, Description, FieldDescription, MessageDescription
from protocols.header import HeaderLayout, compile_header
from protocols.placement import Placed, place
from protocols.reading import Path, Source
from protocols.vocabulary import FORMS, SPARE, Form, Kind, Role, Unit

_ONLY_STANDARD = ("unit", "scale", "min", "max", "bits", "values")


@dataclass(frozen=True, slots=True)
class FieldLayout:
    """A standard field: value = factor * count + zero, in the unit of its attribute's name."""

    name: str
    role: Role
    format: str
    array: int | None
    factor: Fraction
    zero: Fraction
    minimum: float | None
    maximum: float | None
    words: Mapping[int, str]

    @property
    def is_float(self) -> bool:
        """Whether the wire carries a floating-point number."""
        return self.format[-2] == "f"


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

    ``sync_word`` is empty where SLIP's END bytes tell frames apart; ``names`` and ``sizes`` are the message and the
    payload length of each type code.
    """

    sync_word: bytes
    header: HeaderLayout
    checksum: Checksum
    checksum_little: bool
    checksum_covers_sync_word: bool
    names: Mapping[int, str]
    sizes: Mapping[int, int]

    @property
    def overhead(self) -> int:
        """Bytes of a frame that are not payload, SLIP's END and ESC bytes not counted."""
        return len(self.sync_word) + self.header.size + self.checksum.size

    @property
    def largest(self) -> int:
        """Bytes of the largest frame, SLIP's END and ESC bytes not counted."""
        return self.overhead + max(self.sizes.values())

    def checksum_of(self, frame: bytes) -> bytes:
        """The checksum field of a frame that stands here without it, its sync word included."""
        covered = frame if self.checksum_covers_sync_word else frame[len(self.sync_word) :]
        return self.checksum.compute(covered).to_bytes(self.checksum.size, "little" if self.checksum_little else "big")

    def is_checksum_right(self, frame: bytes) -> bool:
        """Whether a whole frame, sync word to checksum, is as it was sent."""
        return self.checksum_of(frame[: -self.checksum.size]) == frame[-self.checksum.size :]


def compile_frame(description: Description, source: Source) -> FrameLayout:
    """Framing, header and checksum of a description."""
    framing, checksum = description.framing, description.checksum
    if (framing.kind == "sync") != (framing.sync_word is not None):
        wanted = "is missing" if framing.kind == "sync" else "SLIP has none; its END byte C0 tells frames apart"
        raise source.error(wanted, ("framing", "sync_word"))
    if checksum.covers_sync_word and framing.kind == "slip":
        raise source.error("SLIP has no sync word", ("checksum", "covers_sync_word"))
    header = compile_header(description.header, _order(description.byte_order), source)
    _check_codes(description, header, source)
    return FrameLayout(
        sync_word=bytes.fromhex(framing.sync_word or ""),
        header=header,
        checksum=_checksum(checksum, source),
        checksum_little=(checksum.byte_order or description.byte_order) == "little",
        checksum_covers_sync_word=checksum.covers_sync_word,
        names={message.code: name for name, message in description.messages.items()},
        sizes={message.code: _size(message, source, name) for name, message in description.messages.items()},
    )


def compile_messages(description: Description, source: Source) -> dict[str, MessageLayout]:
    """The layout of every message, by name."""
    return {
        name: _compile_message(name, message, description, source) for name, message in description.messages.items()
    }


def _order(byte_order: str) -> str:
    return ">" if byte_order == "big" else "<"


def _checksum(description: ChecksumDescription, source: Source) -> Checksum:
    if description.name not in CHECKSUMS:
        raise source.error(f"is {description.name!r:.60}: expected one of {', '.join(CHECKSUMS)}", ("checksum", "name"))
    return CHECKSUMS[description.name]


def _check_codes(description: Description, header: HeaderLayout, source: Source) -> None:
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


def _size(message: MessageDescription, source: Source, name: str) -> int:
    path = ("messages", name)
    end = max((p.end for p in _placed(message, source, path)), default=0)
    if message.ignored and message.length is not None:
        end = max(end, message.length)
    if message.length is not None and message.length != end:
        raise source.error(f"is {message.length}, but the fields take {end} bytes", (*path, "length"))
    return end


def _placed(message: MessageDescription, source: Source, path: Path) -> list[Placed]:
    """Fields and slots in their places; the slots as one block."""
    return place(message.fields, source, (*path, "fields"), message.slots, (*path, "slots"))


def _compile_message(name: str, message: MessageDescription, description: Description, source: Source) -> MessageLayout:
    path = ("messages", name)
    form = FORMS.get(name)
    if form is None and not message.ignored:
        raise source.error(
            f"unknown message; known are {', '.join(FORMS)}; `ignored: true` describes one that the station skips", path
        )
    if message.ignored:
        form = None
    placed = _placed(message, source, path)
    size = _size(message, source, name)
    order = _order(description.byte_order)
    fields = [p for p in placed if p.field is not None and p.field.name != SPARE] if form else []
    layouts = _fields(fields, form.roles if form else {}, order, source)
    slots = _slots(message, next((p for p in placed if p.field is None), None), form, description, source)
    _check_required(form.roles if form else {}, [f.name for f in layouts], source, (*path, "fields"))
    if form and form.slot_roles and slots is None:
        raise source.error("is missing: a panorama is a number of slots with y, x and index", (*path, "slots"))
    return MessageLayout(
        name=name,
        code=message.code,
        from_sensor=message.direction == "from sensor",
        size=size,
        form=form,
        dtype=_dtype(layouts, [p.offset for p in fields], size),
        fields=layouts,
        slots=slots,
    )


def _slots(
    message: MessageDescription, block: Placed | None, form: Form | None, description: Description, source: Source
) -> SlotsLayout | None:
    if form is None or message.slots is None or block is None:
        return None
    path = block.path
    if not form.slot_roles:
        raise source.error("only PANORAMA has slots", path)
    inner = place(message.slots.fields, source, (*path, "fields"))
    used = [p for p in inner if p.field is not None and p.field.name != SPARE]
    order = _order(description.byte_order)
    layouts = _fields(used, form.slot_roles, order, source, pixel_scale=description.scale)
    _check_required(form.slot_roles, [f.name for f in layouts], source, (*path, "fields"))
    dtype = _dtype(layouts, [p.offset for p in used], block.size // message.slots.repeat)
    return SlotsLayout(message.slots.repeat, block.offset, dtype, layouts)


def _check_required(roles: Mapping[str, Role], names: Sequence[str], source: Source, path: Path) -> None:
    for name, role in roles.items():
        if role.required and name not in names:
            raise source.error(f"{name} is missing", path)


def _dtype(layouts: Sequence[FieldLayout], offsets: Sequence[int], size: int) -> np.dtype[np.void]:
    formats = [(f.format, (f.array,)) if f.array else f.format for f in layouts]
    return np.dtype(
        {"names": [f.name for f in layouts], "formats": formats, "offsets": list(offsets), "itemsize": size}
    )


def _fields(
    placed: Sequence[Placed],
    roles: Mapping[str, Role],
    order: str,
    source: Source,
    pixel_scale: Fraction = Fraction(1),
) -> tuple[FieldLayout, ...]:
    layouts: list[FieldLayout] = []
    for item in placed:
        field, path = item.field, item.path
        assert field is not None
        if field.name not in roles:
            known = ", ".join(roles) or "no field at all"
            raise source.error(f"is {field.name!r}: known here: {known}; or {SPARE}", (*path, "name"))
        if any(field.name == other.name for other in layouts):
            raise source.error(f"{field.name} is given twice", (*path, "name"))
        role = roles[field.name]
        _check_field(field, role, source, path)
        default_scale = pixel_scale if "px" in role.units else Fraction(1)
        unit = role.units[field.unit] if field.unit else Unit()
        layouts.append(
            FieldLayout(
                name=field.name,
                role=role,
                format=order + field.type[0] + str(int(field.type[1:]) // 8),
                array=field.array,
                factor=unit.factor * (default_scale if field.scale is None else field.scale),
                zero=unit.factor * field.zero + unit.zero,
                minimum=field.min,
                maximum=field.max,
                words=field.bits or field.values or {},
            )
        )
    return tuple(layouts)


def _check_field(field: FieldDescription, role: Role, source: Source, path: Path) -> None:
    if role.units and field.unit not in role.units:
        was = f"is {field.unit!r:.60}: " if field.unit is not None else "is missing: "
        raise source.error(f"{was}expected one of {', '.join(role.units)}", (*path, "unit"))
    has_scale = role.kind is Kind.NUMBER or bool(role.units)
    wrong = {
        "unit": field.unit is not None and not role.units,
        "scale": field.scale is not None and not has_scale,
        "zero": field.zero != 0 and not has_scale,
        "bits": field.bits is not None and role.kind is not Kind.BITS,
        "values": field.values is not None and role.kind is not Kind.WORD,
        "array": field.array is not None and role.kind is not Kind.INTEGERS,
        "type": field.type[0] == "f" and not has_scale,
    }
    for key in (key for key, is_wrong in wrong.items() if is_wrong):
        reason = "expected an integer type" if key == "type" else f"{field.name} has none"
        raise source.error(reason, (*path, key))
    _check_words(field, source, path)


def _check_words(field: FieldDescription, source: Source, path: Path) -> None:
    width = int(field.type[1:])
    for key, words, largest in (("bits", field.bits or {}, width - 1), ("values", field.values or {}, 2**width - 1)):
        for number in words:
            if number > largest:
                raise source.error(f"{number} does not fit {field.type}", (*path, key))
        if len(set(words.values())) < len(words):
            raise source.error("the same word is given twice", (*path, key))
