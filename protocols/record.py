"""Compiles the fields of a record: names and units checked, one numpy dtype that reads them all."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np

from protocols.description import MAX_LENGTH_LIMIT, TEXT_TYPES, Description, FieldDescription, SlotsDescription
from protocols.errors import DescriptionError
from protocols.reading import DescriptionSource, Path
from protocols.vocabulary import SECONDS, SPARE, Kind, Role, Unit, near_unit

# Places fields in a record: each at its offset, none on another.


@dataclass(frozen=True, slots=True)
class Placed:
    """A field, or a block of slots (``field`` is None), with the bytes that it takes.

    ``shares`` says that it is bits of the same word as the field before it.
    """

    field: FieldDescription | None
    offset: int
    size: int
    path: Path
    shares: bool = False

    @property
    def end(self) -> int:
        """The first byte after it."""
        return self.offset + self.size

    @property
    def name(self) -> str:
        """Its name, for errors."""
        return self.field.name if self.field else "slots"


def place(
    fields: Sequence[FieldDescription],
    source: DescriptionSource,
    path: Path,
    *,
    slots: SlotsDescription | None = None,
    slots_path: Path = (),
    items: Sequence[FieldDescription] = (),
    items_path: Path = (),
) -> list[Placed]:
    """The fields in the order of the description, then the items and the slots; DescriptionError where two overlap."""
    placed: list[Placed] = []
    end = 0
    taken = 0
    of_fields = [(field, (*path, number)) for number, field in enumerate(fields)]
    for field, where in of_fields + [(item, (*items_path, number)) for number, item in enumerate(items)]:
        _check_mask(field, source, where)
        shares = bool(taken) and _is_in_the_word_of(field, placed[-1].field, taken)
        offset = placed[-1].offset if shares else end if field.offset is None else field.offset
        placed.append(Placed(field, offset, width(field) * (field.array or 1), where, shares))
        taken = (taken if shares else 0) | (field.mask or 0)
        end = placed[-1].end
    if slots is not None:
        record = max(p.end for p in place(slots.fields, source, (*slots_path, "fields")))
        offset = end if slots.offset is None else slots.offset
        placed.append(Placed(None, offset, record * (slots.repeat or slots.most or 1), slots_path))
    _refuse_overlaps([p for p in placed if not p.shares], source)
    return placed


def _is_in_the_word_of(field: FieldDescription, before: FieldDescription | None, taken: int) -> bool:
    """Whether a field is other bits of the word of the field before it, of which these are ``taken``."""
    is_same = before is not None and width(before) == width(field)
    return field.mask is not None and field.offset is None and is_same and not field.mask & taken


def _check_mask(field: FieldDescription, source: DescriptionSource, path: Path) -> None:
    mask = field.mask
    if field.array is not None and width(field) == 3:
        raise source.error("numbers of 24 bits stand one by one", (*path, "array"))
    if mask is None:
        return
    if field.type[0] not in "ui" or field.type in TEXT_TYPES or field.array is not None:
        raise source.error("only a single integer has bits to choose", (*path, "mask"))
    if mask >> 8 * width(field):
        raise source.error(f"0x{mask:X} does not fit {field.type}", (*path, "mask"))
    if "01" in f"{mask:b}":
        raise source.error(f"0x{mask:X} has a gap: expected bits that stand side by side", (*path, "mask"))


def width(field: FieldDescription) -> int:
    """Bytes of one number of this field, as the station holds it where the wire has text."""
    return 8 if field.type in TEXT_TYPES else int(field.type[1:]) // 8


def counts_digits(field: FieldDescription, kind: Kind) -> bool:
    """Whether a line's number is counted in units of its last digit: a double holds too few digits of a time."""
    return field.type == "decimal" and kind is Kind.INTEGER and bool(field.unit and field.digits)


def bits(field: FieldDescription) -> tuple[int, int]:
    """The lowest bit of its word that is the field's, and how many are."""
    if field.mask is None:
        return 0, 8 * width(field)
    return (field.mask & -field.mask).bit_length() - 1, field.mask.bit_count()


def check_words(field: FieldDescription, source: DescriptionSource, path: Path) -> None:
    """Refuses names of bits and values that the type does not have, and a name that stands twice."""
    many = bits(field)[1]
    if field.value is not None and field.value >= 2**many:
        raise source.error(f"{field.value} does not fit its {many} bits", (*path, "value"))
    for word, number in (field.words or {}).items():
        if field.type != "word":
            raise source.error("a field of the type `word` has them, no other", (*path, "words"))
        if number not in (field.values or {}):
            raise source.error(f"{word} is {number}, and `values` names no such number", (*path, "words"))
    for key, words, largest in (("bits", field.bits or {}, many - 1), ("values", field.values or {}, 2**many - 1)):
        for number in words:
            if number > largest:
                raise source.error(f"{number} does not fit {field.type}", (*path, key))
        if len(set(words.values())) < len(words):
            raise source.error("the same word is given twice", (*path, key))


def _refuse_overlaps(placed: Sequence[Placed], source: DescriptionSource) -> None:
    ordered = sorted(placed, key=lambda p: p.offset)
    for before, after in pairwise(ordered):
        if after.offset < before.end:
            raise _overlap(before, after, source)
    for item in ordered:
        if item.end > MAX_LENGTH_LIMIT:
            raise source.error(f"{item.name} ends at byte {item.end}, over the {MAX_LENGTH_LIMIT} allowed", item.path)


def _overlap(before: Placed, after: Placed, source: DescriptionSource) -> DescriptionError:
    return source.error(
        f"{after.name} at offset {after.offset} overlaps {before.name}, which takes the bytes "
        f"{before.offset} to {before.end - 1}",
        after.path,
    )


@dataclass(frozen=True, slots=True)
class FieldLayout:
    """A standard field: value = factor * count + zero, in the unit of its attribute's name.

    ``word`` is what numpy reads at its place, ``shift`` and ``width`` (of bits) are its part of that word.
    """

    name: str
    role: Role
    word: str
    shift: int
    width: int
    is_signed: bool
    is_float: bool
    array: int | None
    factor: Fraction
    zero: Fraction
    minimum: float | None
    maximum: float | None
    words: Mapping[int, str]

    @property
    def is_packed(self) -> bool:
        """Whether numpy reads no number of its own at its place, but three bytes, or a word of which it is a part."""
        return self.word == BYTES_3 or self.width != 8 * int(self.word[-1])


BYTES_3 = "(3,)u1"
"""How numpy reads a number of three bytes."""


def order_of(byte_order: str) -> str:
    """The byte order as numpy and struct write it."""
    return ">" if byte_order == "big" else "<"


def compile_record(
    placed: Sequence[Placed], roles: Mapping[str, Role], size: int, description: Description, source: DescriptionSource
) -> tuple[tuple[FieldLayout, ...], np.dtype[np.void]]:
    """The standard fields among those placed, and the dtype of ``size`` bytes that reads them."""
    layouts: list[FieldLayout] = []
    offsets: list[int] = []
    for item in placed:
        field, path = item.field, item.path
        assert field is not None
        if field.name == SPARE:
            _check_spare(field, source, path)
            continue
        if field.name not in roles:
            known = ", ".join(roles) or "no field at all"
            raise source.error(f"is {field.name!r}: known here: {known}; or {SPARE}", (*path, "name"))
        if any(field.name == other.name for other in layouts):
            raise source.error(f"{field.name} is given twice", (*path, "name"))
        _check_field(field, roles[field.name], source, path)
        layouts.append(_layout(field, roles[field.name], description))
        offsets.append(item.offset)
    formats = [f"({f.array},){f.word}" if f.array else f.word for f in layouts]
    names = [f.name for f in layouts]
    return tuple(layouts), np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


def _layout(field: FieldDescription, role: Role, description: Description) -> FieldLayout:
    scale = field.scale
    if scale is None:
        scale = description.scale if role.attribute == "xy_px" else Fraction(1)
    if counts_digits(field, role.kind):
        scale /= 10 ** (field.digits or 0)
    unit = role.units[field.unit] if field.unit else Unit()
    shift, many = bits(field)
    is_text = field.type in TEXT_TYPES
    kind = field.type[0] if not is_text else "f" if role.kind is Kind.NUMBER and field.type == "decimal" else "i"
    order = order_of(description.byte_order)
    word = f"{order}{'u' if field.mask else kind}{width(field)}"
    return FieldLayout(
        name=field.name,
        role=role,
        word=BYTES_3 if width(field) == 3 else word,
        shift=shift,
        width=many,
        is_signed=kind == "i",
        is_float=kind == "f",
        array=field.array,
        factor=unit.factor * scale,
        zero=unit.factor * field.zero + unit.zero,
        minimum=field.min,
        maximum=field.max,
        words=field.bits or field.values or {},
    )


def free_roles(
    fields: Sequence[FieldDescription], source: DescriptionSource, path: Path, times: Collection[str] = ()
) -> dict[str, Role]:
    """The roles of items, or of the arguments of a command: any name, any unit, in which their values are.

    Those whose names are among ``times`` must have a unit of time.
    """
    roles: dict[str, Role] = {}
    for number, field in enumerate(fields):
        if field.name == SPARE:
            continue
        if field.name in roles:
            raise source.error(f"{field.name} is given twice", (*path, number, "name"))
        if field.unit is not None and (meant := near_unit(field.unit)):
            raise source.error(f"is {field.unit!r:.60}: did you mean {meant}?", (*path, number, "unit"))
        roles[field.name] = Role(field.name, _free_kind(field), {field.unit: Unit()} if field.unit else {})
        if field.name in times and field.unit not in SECONDS:
            was = f"is {field.unit!r:.60}: " if field.unit is not None else "is missing: "
            raise source.error(f"{was}expected one of {', '.join(SECONDS)}", (*path, number, "unit"))
    return roles


def _free_kind(field: FieldDescription) -> Kind:
    if field.bits is not None:
        return Kind.BITS
    if field.values is not None:
        return Kind.WORD
    if field.array is not None:
        return Kind.INTEGERS
    is_counted = field.unit or field.scale is not None or field.zero != 0
    return Kind.NUMBER if is_counted or field.type in ("f32", "f64", "decimal") else Kind.INTEGER


def _check_spare(field: FieldDescription, source: DescriptionSource, path: Path) -> None:
    for key in ("unit", "scale", "min", "max", "bits", "values"):
        if getattr(field, key) is not None:
            raise source.error(f"a {SPARE} field has none: its value is not used", (*path, key))


def _check_field(field: FieldDescription, role: Role, source: DescriptionSource, path: Path) -> None:
    if role.units and field.unit not in role.units:
        was = f"is {field.unit!r:.60}: " if field.unit is not None else "is missing: "
        raise source.error(f"{was}expected one of {', '.join(role.units)}", (*path, "unit"))
    has_scale = role.kind is Kind.NUMBER or bool(role.units)
    has_bounds = has_scale or role.kind is Kind.INTEGER
    wrong = {
        "unit": field.unit is not None and (not role.units or role.kind in (Kind.WORD, Kind.BITS, Kind.INTEGERS)),
        "scale": field.scale is not None and not has_scale,
        "zero": field.zero != 0 and not has_scale,
        "min": field.min is not None and not has_bounds,
        "max": field.max is not None and not has_bounds,
        "bits": field.bits is not None and role.kind is not Kind.BITS,
        "values": field.values is not None and role.kind is not Kind.WORD,
        "array": field.array is not None and role.kind is not Kind.INTEGERS,
        "value": field.value is not None,
        "type": field.type in ("f32", "f64") and not has_scale,
    }
    for key in (key for key, is_wrong in wrong.items() if is_wrong):
        reason = "expected an integer type" if key == "type" else f"{field.name} has none"
        raise source.error(reason, (*path, key))
    if field.min is not None and field.max is not None and field.min > field.max:
        raise source.error(f"the minimum is over the maximum of {field.max:.15g}", (*path, "min"))
    check_words(field, source, path)
