"""Compiles a protocol description: the layout of its frames and of its messages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from protocols.checksum import CHECKSUMS, Checksum
from protocols.description import ChecksumDescription, Description, MessageDescription
from protocols.header import HeaderLayout, compile_header
from protocols.messages import AttitudeMessage
from protocols.placement import Placed, place
from protocols.reading import Path, Source
from protocols.record import FieldLayout, compile_record, order_of
from protocols.vocabulary import FORMS, QUATERNION, Form, Role


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
        return self.overhead + max(self.sizes.values(), default=0)

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
    header = compile_header(description.header, order_of(description.byte_order), source)
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
    if message.ignored:
        if message.length is None or message.fields or message.slots:
            raise source.error("an ignored message has a length instead of fields", path)
        return message.length
    end = max((p.end for p in _placed(message, source, path)), default=0)
    if message.length is not None and message.length != end:
        raise source.error(f"is {message.length}, but the fields take {end} bytes", (*path, "length"))
    return end


def _placed(message: MessageDescription, source: Source, path: Path) -> list[Placed]:
    """Fields and slots in their places; the slots as one block."""
    return place(message.fields, source, (*path, "fields"), message.slots, (*path, "slots"))


def _compile_message(name: str, message: MessageDescription, description: Description, source: Source) -> MessageLayout:
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
    message: MessageDescription, placed: Sequence[Placed], form: Form, description: Description, source: Source
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


def _check_required(roles: Mapping[str, Role], fields: Sequence[FieldLayout], source: Source, path: Path) -> None:
    for name, role in roles.items():
        if role.required and all(field.name != name for field in fields):
            raise source.error(f"{name} is missing", path)


def _check_direction(fields: Sequence[FieldLayout], source: Source, path: Path) -> None:
    """An ATTITUDE has RA and DE, or a whole quaternion."""
    names = {field.name for field in fields}
    if not names.issuperset(("ra", "de")) and not names.issuperset(QUATERNION):
        raise source.error(f"no direction: expected ra and de, or {', '.join(QUATERNION)}", path)
