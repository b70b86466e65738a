"""The header of a frame: type, flags, length and sequence number, where the protocol has them."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from protocols.description import FieldDescription
from protocols.placement import check_words, place, width
from protocols.reading import Source
from protocols.vocabulary import HEADER_FIELDS, SPARE

_READ = ("type", "flags", "length", "sequence")
_ABSENT = (None, 0, None, -1)
"""What a header without one of these fields says."""
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


def compile_header(fields: Sequence[FieldDescription], order: str, source: Source) -> HeaderLayout:
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
    field: FieldDescription, seen: Mapping[str, FieldDescription], source: Source, path: Sequence[str | int]
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
