"""Compiles the fields of a record: names and units checked, one numpy dtype that reads them all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np

from protocols.description import MAX_LENGTH_LIMIT, Description, FieldDescription, SlotsDescription
from protocols.errors import DescriptionError
from protocols.reading import DescriptionSource, Path
from protocols.vocabulary import SPARE, Kind, Role, Unit

# Places fields in a record: each at its offset, none on another.


@dataclass(frozen=True, slots=True)
class Placed:
    """A field, or a block of slots (``field`` is None), with the bytes that it takes."""

    field: FieldDescription | None
    offset: int
    size: int
    path: Path

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
    slots: SlotsDescription | None = None,
    slots_path: Path = (),
) -> list[Placed]:
    """The fields in the order of the description, then the slots; DescriptionError where two overlap."""
    placed: list[Placed] = []
    end = 0
    for number, field in enumerate(fields):
        offset = end if field.offset is None else field.offset
        placed.append(Placed(field, offset, width(field) * (field.array or 1), (*path, number)))
        end = placed[-1].end
    if slots is not None:
        record = max(p.end for p in place(slots.fields, source, (*slots_path, "fields")))
        offset = end if slots.offset is None else slots.offset
        placed.append(Placed(None, offset, record * slots.repeat, slots_path))
    _refuse_overlaps(placed, source)
    return placed


def width(field: FieldDescription) -> int:
    """Bytes of one number of this field."""
    return int(field.type[1:]) // 8


def check_words(field: FieldDescription, source: DescriptionSource, path: Path) -> None:
    """Refuses names of bits and values that the type does not have, and a name that stands twice."""
    bits = 8 * width(field)
    for key, words, largest in (("bits", field.bits or {}, bits - 1), ("values", field.values or {}, 2**bits - 1)):
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
    formats = [(f.format, (f.array,)) if f.array else f.format for f in layouts]
    names = [f.name for f in layouts]
    return tuple(layouts), np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


def _layout(field: FieldDescription, role: Role, description: Description) -> FieldLayout:
    scale = field.scale
    if scale is None:
        scale = description.scale if "px" in role.units else Fraction(1)
    unit = role.units[field.unit] if field.unit else Unit()
    return FieldLayout(
        name=field.name,
        role=role,
        format=order_of(description.byte_order) + field.type[0] + str(width(field)),
        array=field.array,
        factor=unit.factor * scale,
        zero=unit.factor * field.zero + unit.zero,
        minimum=field.min,
        maximum=field.max,
        words=field.bits or field.values or {},
    )


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
        "unit": field.unit is not None and not role.units,
        "scale": field.scale is not None and not has_scale,
        "zero": field.zero != 0 and not has_scale,
        "min": field.min is not None and not has_bounds,
        "max": field.max is not None and not has_bounds,
        "bits": field.bits is not None and role.kind is not Kind.BITS,
        "values": field.values is not None and role.kind is not Kind.WORD,
        "array": field.array is not None and role.kind is not Kind.INTEGERS,
        "type": field.type[0] == "f" and not has_scale,
    }
    for key in (key for key, is_wrong in wrong.items() if is_wrong):
        reason = "expected an integer type" if key == "type" else f"{field.name} has none"
        raise source.error(reason, (*path, key))
    if field.min is not None and field.max is not None and field.min > field.max:
        raise source.error(f"the minimum is over the maximum of {field.max:.15g}", (*path, "min"))
    check_words(field, source, path)
