"""Places fields in a record: each at its offset, none on another."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from protocols.description import MAX_LENGTH_LIMIT, FieldDescription, SlotsDescription
from protocols.errors import DescriptionError
from protocols.reading import Path, Source


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
    source: Source,
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


def check_words(field: FieldDescription, source: Source, path: Path) -> None:
    """Refuses names of bits and values that the type does not have, and a name that stands twice."""
    bits = 8 * width(field)
    for key, words, largest in (("bits", field.bits or {}, bits - 1), ("values", field.values or {}, 2**bits - 1)):
        for number in words:
            if number > largest:
                raise source.error(f"{number} does not fit {field.type}", (*path, key))
        if len(set(words.values())) < len(words):
            raise source.error("the same word is given twice", (*path, key))


def _refuse_overlaps(placed: Sequence[Placed], source: Source) -> None:
    ordered = sorted(placed, key=lambda p: p.offset)
    for before, after in pairwise(ordered):
        if after.offset < before.end:
            raise _overlap(before, after, source)
    for item in ordered:
        if item.end > MAX_LENGTH_LIMIT:
            raise source.error(f"{item.name} ends at byte {item.end}, over the {MAX_LENGTH_LIMIT} allowed", item.path)


def _overlap(before: Placed, after: Placed, source: Source) -> DescriptionError:
    return source.error(
        f"{after.name} at offset {after.offset} overlaps {before.name}, which takes the bytes "
        f"{before.offset} to {before.end - 1}",
        after.path,
    )
