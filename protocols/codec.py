"""Payloads to messages, and back."""

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.errors import EncodeError
from protocols.layout import MessageLayout
from protocols.messages import Command, Message, Other, PanoramaColumns, PanoramaMessage, StarsMessage
from protocols.record import BYTES_3, FieldLayout
from protocols.vocabulary import Kind

# Wire counts to values in the station's units, and back.

Count = Any  # a Python int or float, or an array of ints, as numpy gives it
Value = Any  # int, float, str, frozenset[str] or tuple[int, ...], as the field's Kind says

LARGEST_TIME_US = 2**53
"""Longest valid sensor time, 285 years; beyond it nanoseconds do not fit 64 bits."""

LARGEST_FLOAT = 1e18
"""Beyond it a float on the wire is garbage; also what keeps scaled values finite."""

_NO_BITS: frozenset[str] = frozenset()


class FieldCodec:
    """Converts the numbers of one field; ``commands`` are the names of the codes that ACK and NAK speak of.

    ``value_of`` is the value of a count; ``is_checked`` says whether some counts are out of order at all.
    """

    def __init__(self, field: FieldLayout, commands: Mapping[int, str], byte_order: str) -> None:
        self.name = field.name
        self.attribute = field.role.attribute
        self.is_float = field.is_float
        self.is_packed = field.is_packed
        self._field = field
        self._bytes_3 = (2, 1, 0) if byte_order == "little" else (0, 1, 2)
        self._is_time = self.attribute == "time_us"
        self._multiplier, self._divisor = float(field.factor.numerator), float(field.factor.denominator)
        self._zero = float(field.zero)
        self._is_plain = field.factor == 1 and field.zero == 0
        self._words = commands if field.role.kind is Kind.COMMAND else field.words
        self._numbers = {word: number for number, word in self._words.items()}
        low, high = field.minimum, field.maximum
        most = LARGEST_FLOAT if field.is_float else math.inf
        self._bounds = (max(-most, -math.inf if low is None else low), min(most, math.inf if high is None else high))
        self.value_of: Callable[[Count], Value] = self._reader()

    @property
    def is_checked(self) -> bool:
        """Whether ``problem_of`` may find something."""
        bounded = self._field.minimum is not None or self._field.maximum is not None
        return bounded or self.is_float or self._is_time

    def _reader(self) -> Callable[[Count], Value]:
        multiplier, divisor, zero = self._multiplier, self._divisor, self._zero
        match self._field.role.kind:
            case Kind.BITS:
                return self._bits
            case Kind.WORD | Kind.COMMAND:
                return self._word
            case Kind.INTEGERS:
                return lambda counts: tuple(np.atleast_1d(counts).tolist())
            case Kind.INTEGER:
                return self._time if self._is_time else lambda count: count
            case Kind.NUMBER if multiplier == 1 and zero == 0:
                return lambda count: count / divisor
            case Kind.NUMBER:
                return lambda count: count * multiplier / divisor + zero

    def _time(self, count: Count) -> int:
        if self.is_float:
            value = count * self._multiplier / self._divisor + self._zero
            time_us = round(value) if math.isfinite(value) else 0
        elif self._is_plain:
            time_us = count
        else:
            time_us = round(self._field.factor * count + self._field.zero)
        return min(max(time_us, 0), LARGEST_TIME_US)

    def _bits(self, count: int) -> frozenset[str]:
        if count == 0:
            return _NO_BITS
        bits = (bit for bit in range(count.bit_length()) if count >> bit & 1)
        return frozenset(self._words.get(bit, f"bit {bit}") for bit in bits)

    def _word(self, count: int) -> str:
        return self._words.get(count, f"value {count}")

    def values_of(self, counts: NDArray[Any]) -> NDArray[np.float64]:
        """The values of many counts (N,); floats want an ``errstate`` around it, for a signalling NaN is a problem."""
        values = counts.astype(np.float64)  # first of all: a u16 times a scale would stay a u16
        if self._multiplier != 1:
            values *= self._multiplier
        if self._divisor != 1:
            values /= self._divisor
        if self._zero != 0:
            values += self._zero
        return values

    def problem_of(self, count: Count) -> str | None:
        """The problem with this count, in words; None without one."""
        low, high = self._field.minimum, self._field.maximum
        if self.is_float and not abs(count) <= LARGEST_FLOAT:
            return f"{self.name} is {count}: no number of ordinary size"
        if low is not None and count < low:
            return f"{self.name} is {count}, under the minimum of {low:.15g}"
        if high is not None and count > high:
            return f"{self.name} is {count}, over the maximum of {high:.15g}"
        if self._is_time and not 0 <= count * self._multiplier / self._divisor + self._zero <= LARGEST_TIME_US:
            return f"time is {count}: no sensor clock runs that long"
        return None

    def suspects(self, counts: NDArray[Any]) -> NDArray[np.int64]:
        """The places of many counts (N,) with which there may be a problem."""
        low, high = self._bounds
        return (~((counts >= low) & (counts <= high))).nonzero()[0]  # as NaN is not within

    def problem_among(self, counts: NDArray[Any]) -> str | None:
        """The problem with one of many counts (N,); None without one."""
        low, high = self._bounds
        for count in counts.tolist():
            if not low <= count <= high:  # as NaN is not
                return self.problem_of(count)
        return None

    def column(self, rows: NDArray[Any]) -> NDArray[Any]:
        """The counts (K,) of this field in records (K,)."""
        words = rows[self.name]
        if not self.is_packed:
            return words
        field = self._field
        if field.word == BYTES_3:
            high, middle, low = (words[..., at].astype(np.int64) for at in self._bytes_3)
            words = high << 16 | middle << 8 | low
        counts = words >> field.shift & (1 << field.width) - 1
        if not field.is_signed:
            return counts
        counts = counts.astype(np.int64)
        return counts - (counts >> (field.width - 1) << field.width)

    def put(self, rows: NDArray[Any], counts: Any) -> None:
        """Write counts (K,), or one for all, into records (K,)."""
        if not self.is_packed:
            rows[self.name] = counts
            return
        field = self._field
        mask = (1 << field.width) - 1
        if field.word != BYTES_3:
            word = rows[self.name].dtype
            rows[self.name] |= (np.asarray(counts).astype(np.int64) & mask).astype(word) << field.shift
            return
        words = (np.asarray(counts).astype(np.int64) & mask) << field.shift
        for at, shift in zip(self._bytes_3, (16, 8, 0), strict=True):
            rows[self.name][..., at] |= (words >> shift & 0xFF).astype(np.uint8)

    def clear(self, rows: NDArray[Any]) -> None:
        """Write no count into records (K,), so that another can be put there."""
        field = self._field
        if not self.is_packed:
            rows[self.name] = 0
            return
        kept = ~((1 << field.width) - 1 << field.shift)
        if field.word != BYTES_3:
            word = rows[self.name].dtype
            rows[self.name] &= word.type(kept & (1 << 8 * word.itemsize) - 1)
            return
        for at, shift in zip(self._bytes_3, (16, 8, 0), strict=True):
            rows[self.name][..., at] &= np.uint8(kept >> shift & 0xFF)

    def count_of(self, value: Value) -> Count:
        """The count that says this value; EncodeError if there is none."""
        try:
            count = self._count(value)
        except (TypeError, ValueError, OverflowError) as error:
            raise EncodeError(f"{self.name} cannot be {value!r:.60}") from error
        if self.is_float:
            return count
        numbers = count if isinstance(count, tuple) else (count,)
        if len(numbers) != (self._field.array or 1):
            raise EncodeError(f"{self.name} has {len(numbers)} numbers: expected {self._field.array or 1}")
        low, high = self._range()
        if not all(low <= number <= high for number in numbers):
            raise self._does_not_fit(value)
        return count

    def whole(self, count: int) -> int:
        """A count as it is; EncodeError if it does not fit."""
        low, high = self._range()
        if not low <= count <= high:
            raise self._does_not_fit(count)
        return count

    def folded(self, count: int) -> int:
        """A whole number as it is where it fits, else its remainder."""
        low, high = self._range()
        return count if low <= count <= high else count % high

    def counts_of(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The counts that say these values (N,), whole numbers unless the wire carries floats; EncodeError."""
        counts = (np.asarray(values, dtype=np.float64) - self._zero) * self._divisor / self._multiplier
        if self.is_float:
            return counts
        counts = np.rint(counts)
        low, high = self._range()
        fits = (counts >= low) & (counts <= high)
        if not fits.all():
            raise self._does_not_fit(float(values[int(np.argmin(fits))]))
        return counts

    def _count(self, value: Value) -> Count:
        match self._field.role.kind:
            case Kind.BITS:
                return sum(1 << self._number(word, "bit ") for word in value)
            case Kind.WORD | Kind.COMMAND:
                return self._number(value, "value ")
            case Kind.INTEGERS:
                numbers = tuple(int(number) for number in value)
                return numbers if self._field.array or len(numbers) != 1 else numbers[0]
            case Kind.INTEGER if not self.is_float:
                # Exactly: a 64-bit count does not fit a float.
                return int(value) if self._is_plain else round((int(value) - self._field.zero) / self._field.factor)
            case _:
                count = (value - self._zero) * self._divisor / self._multiplier
                return count if self.is_float else round(count)

    def _number(self, word: str, prefix: str) -> int:
        number = self._numbers.get(word)
        if number is None and not word.startswith(prefix):
            raise EncodeError(f"{self.name} cannot be {word!r:.60}: known are {', '.join(self._numbers) or 'none'}")
        return int(word.removeprefix(prefix)) if number is None else number

    def _range(self) -> tuple[int, int]:
        width = self._field.width
        return (-(2 ** (width - 1)), 2 ** (width - 1) - 1) if self._field.is_signed else (0, 2**width - 1)

    def _does_not_fit(self, value: Value) -> EncodeError:
        low, high = self._range()
        return EncodeError(f"{self.name} cannot be {value!r:.60}: on the wire it has {low} to {high} counts")


class SplitTime:
    """A time that stands in several fields: weeks, seconds, fractions; each counts up to one of the coarser."""

    def __init__(self, fields: Sequence[FieldLayout]) -> None:
        """``fields`` are those of a message; those of its time are ``places`` among them."""
        own = [(field.factor, at) for at, field in enumerate(fields) if field.role.attribute == "time_us"]
        own.sort(reverse=True)
        self.places = [at for _, at in own]
        self._factors = [factor for factor, _ in own]
        self._zero = sum((fields[at].zero for at in self.places), Fraction(0))
        self._ratios = [coarse / fine for coarse, fine in pairwise(self._factors)]

    def time_us(self, counts: Sequence[int]) -> int:
        """The time of the counts of a message's fields."""
        whole = sum((factor * counts[at] for factor, at in zip(self._factors, self.places, strict=True)), self._zero)
        return min(max(round(whole), 0), LARGEST_TIME_US)

    def counts(self, time_us: int) -> list[tuple[int, int]]:
        """The places of its fields, and the counts that say this time."""
        rest = round((time_us - self._zero) / self._factors[-1])
        found = []
        for at, ratio in zip(self.places[:0:-1], self._ratios[::-1], strict=True):
            rest, count = divmod(rest, int(ratio))
            found.append((at, count))
        return [*found, (self.places[0], rest)]


class MessageCodec:
    """Converts payloads of one type; ``commands`` are the names of the command codes."""

    def __init__(self, layout: MessageLayout, commands: Mapping[int, str]) -> None:
        self.layout = layout
        self._fields = tuple(FieldCodec(field, commands, layout.byte_order) for field in layout.fields)
        self._is_packed = any(field.is_packed for field in self._fields)
        self._checked = tuple((at, field) for at, field in enumerate(self._fields) if field.is_checked)
        self._by_name = {field.name: field for field in self._fields}
        self._items = {item.name: FieldCodec(item, {}, layout.byte_order) for item in layout.items}
        time = SplitTime(layout.fields)
        self._split_time = time if len(time.places) > 1 else None

    def decode(self, payload: bytes) -> Message:
        """The message of a payload that has this type's length."""
        if self.layout.form is None and not self.layout.is_command:
            return Other(self.layout.name, payload)
        values, problems = self._decode_fields(payload)
        if self.layout.form is None:
            return Command(self.layout.name, values, problems=tuple(problems))
        return self.layout.form.message(**values, problems=tuple(problems))

    def _decode_fields(self, payload: bytes) -> tuple[dict[str, Any], list[str]]:
        if not self._fields:
            return {}, []
        rows = np.frombuffer(payload, self.layout.dtype, 1)
        if self._is_packed:
            counts = tuple(field.column(rows)[0].tolist() for field in self._fields)
        else:
            counts = rows[0].item()
        values = {field.attribute: field.value_of(count) for field, count in zip(self._fields, counts, strict=True)}
        if self._split_time:
            values["time_us"] = self._split_time.time_us(counts)
        return values, self._problems(field.problem_of(counts[at]) for at, field in self._checked)

    @staticmethod
    def _problems(found: Iterator[str | None]) -> list[str]:
        return [problem for problem in found if problem is not None]

    def encode(self, message: Message) -> bytes:
        """The payload that says this message; EncodeError if a value does not fit."""
        if isinstance(message, Other):
            return message.payload
        payload = bytearray(self.layout.blank)
        self._encode_fields(payload, [self._value(message, field) for field in self._fields])
        return bytes(payload)

    def _value(self, message: Message, field: FieldCodec) -> Value:
        if not isinstance(message, Command):
            return getattr(message, field.attribute)
        if field.name not in message.arguments:
            raise EncodeError(f"{self.layout.name} needs {field.name}")
        return message.arguments[field.name]

    def _encode_fields(self, payload: bytearray, values: list[Any]) -> None:
        if not self._fields:
            return
        split = dict(self._split_time.counts(values[self._split_time.places[0]])) if self._split_time else {}
        counts = [
            field.whole(split[at]) if at in split else field.count_of(value)
            for at, (field, value) in enumerate(zip(self._fields, values, strict=True))
        ]
        rows = np.frombuffer(payload, self.layout.dtype, 1)
        if not self._is_packed:
            rows[0] = tuple(counts)
            return
        for field, count in zip(self._fields, counts, strict=True):
            field.put(rows, count)

    def items(self, payloads: Sequence[bytes], names: Sequence[str]) -> NDArray[np.float64]:
        """These items (N, K) of payloads: numbers in their units; of words and bits the number on the wire.

        A name is that of an item, or of a standard field.
        """
        layout, size = self.layout, self.layout.size
        whole = b"".join([payload[:size].ljust(size, b"\0") for payload in payloads])
        fields, items = (np.frombuffer(whole, dtype, len(payloads)) for dtype in (layout.dtype, layout.item_dtype))
        found = np.empty((len(payloads), len(names)))
        with np.errstate(invalid="ignore", over="ignore"):  # a signalling NaN, say
            for at, name in enumerate(names):
                item, rows = (self._items[name], items) if name in self._items else (self._by_name[name], fields)
                found[:, at] = item.values_of(item.column(rows))
        found[~(np.abs(found) <= LARGEST_FLOAT)] = np.nan
        return found

    def with_items(self, payload: bytes, values: Mapping[str, Value]) -> bytes:
        """The payload with these items, those that are not given as they are; EncodeError if a value does not fit."""
        changed = bytearray(payload.ljust(self.layout.size, b"\0"))  # objects by count may be fewer
        rows = np.frombuffer(changed, self.layout.item_dtype, 1)
        for name, item in self._items.items():
            if name in values:
                item.clear(rows)
                item.put(rows, item.count_of(values[name]))
        return bytes(changed[: len(payload)])

    def retimed(self, payload: bytes, time_us: int) -> bytes:
        """The payload with another time, and all else as it is; EncodeError if the time does not fit."""
        places = [at for at, field in enumerate(self._fields) if field.attribute == "time_us"]
        if not places:
            return payload
        if self._split_time:
            counts = [(at, self._fields[at].whole(count)) for at, count in self._split_time.counts(time_us)]
        else:
            counts = [(places[0], self._fields[places[0]].count_of(time_us))]
        changed = bytearray(payload.ljust(self.layout.dtype.itemsize, b"\0"))  # objects by count may be fewer
        rows = np.frombuffer(changed, self.layout.dtype, 1)
        for at, count in counts:
            self._fields[at].clear(rows)
            self._fields[at].put(rows, count)
        return bytes(changed[: len(payload)])


class StarsCodec(MessageCodec):
    """Converts lists of stars, whose slots are few."""

    def __init__(self, layout: MessageLayout, commands: Mapping[int, str]) -> None:
        super().__init__(layout, commands)
        assert layout.slots is not None
        self._slots = layout.slots
        self._of_slot = [FieldCodec(field, commands, layout.byte_order) for field in layout.slots.fields]
        self._star = next(field for field in self._of_slot if field.name == "star")

    @property
    def most(self) -> int:
        """How many stars a list holds."""
        return self._slots.repeat

    def number_of(self, star: int) -> int:
        """What stands on the wire for a star of a catalogue: its number, of which a narrow field has the remainder."""
        return self._star.folded(star)

    def decode(self, payload: bytes) -> Message:
        """The list of a payload that has this type's length; slots behind the last that is not all zero are empty."""
        slots = self._slots
        whole = payload.ljust(self.layout.size, b"\0")  # slots by count may be fewer
        values, problems = self._decode_fields(whole)
        rows = np.frombuffer(whole, slots.dtype, slots.repeat, slots.offset)
        used = values.pop("count", None)
        if used is None:
            used = -(-len(whole[slots.offset :].rstrip(b"\0")) // slots.dtype.itemsize)
        for field in self._of_slot:
            counts = field.column(rows[: max(used, 0)])
            if (problem := field.problem_among(counts) if field.is_checked else None) is not None:
                problems.append(problem)
            values[field.attribute] = tuple(field.value_of(count) for count in counts.tolist())
        return StarsMessage(**values, problems=tuple(problems))

    def encode(self, message: Message) -> bytes:
        """The payload that says this list; EncodeError if a value does not fit."""
        assert isinstance(message, StarsMessage)
        slots, count = self._slots, len(message.stars)
        if count > slots.repeat:
            raise EncodeError(f"a list of {count} stars: expected {slots.repeat} at most")
        payload = bytearray(self.layout.blank)
        self._encode_fields(
            payload, [count if f.name == "count" else getattr(message, f.attribute) for f in self._fields]
        )
        rows = np.frombuffer(payload, slots.dtype, count, slots.offset)
        for field in self._of_slot:
            for row, value in enumerate(getattr(message, field.attribute)):
                field.put(rows[row : row + 1], field.count_of(value))
        return bytes(payload[: slots.offset + count * slots.dtype.itemsize] if slots.are_counted else payload)


class PanoramaCodec(MessageCodec):
    """Converts panoramas: their slots are read and written as arrays."""

    def __init__(self, layout: MessageLayout, commands: Mapping[int, str]) -> None:
        super().__init__(layout, commands)
        assert layout.slots is not None
        self._slots = layout.slots
        codecs = {field.name: FieldCodec(field, commands, layout.byte_order) for field in layout.slots.fields}
        self._x, self._y, self._index = codecs["x"], codecs["y"], codecs.get("index")
        self._checked_slots = tuple(field for field in codecs.values() if field.is_checked)

    def decode(self, payload: bytes) -> PanoramaMessage:
        """The panorama of a payload that has this type's length."""
        return self.decode_many([payload])[0]

    @np.errstate(invalid="ignore", over="ignore")  # a signalling NaN, say: a problem, not a warning
    def decode_many(self, payloads: Sequence[bytes]) -> PanoramaColumns:
        """The panoramas of payloads that have this type's length."""
        size, repeat = self.layout.size, self._slots.repeat
        lengths = None
        if self._slots.are_counted or self._slots.part_first is not None:
            # Slots by count, or those of several frames: their number is that of the bytes. Empty ones fill the rest.
            lengths = [len(payload) for payload in payloads]
            size = max(size, *lengths)
            payloads = [payload.ljust(size, b"\0") for payload in payloads]
            repeat = (size - self._slots.offset) // self._slots.dtype.itemsize
        whole = b"".join(payloads)
        rows = np.ndarray((len(payloads),), self.layout.dtype, whole, 0, (size,))
        values, problems = self._values_of(rows)
        slots = self._slots_of(whole, self._slots.dtype, repeat, size)
        if lengths is None:
            used = self._used(whole, values.get("count"), problems)
        else:
            used = (np.array(lengths) - self._slots.offset) // self._slots.dtype.itemsize
        first = np.zeros(len(payloads) + 1, dtype=np.int64)
        np.cumsum(used, out=first[1:])
        objects = slots[np.arange(repeat) < used[:, None]]
        xy_px = np.empty((len(objects), 2))
        xy_px[:, 0] = self._x.values_of(self._x.column(objects))
        xy_px[:, 1] = self._y.values_of(self._y.column(objects))
        for field in self._checked_slots:
            counts = field.column(objects)
            for k in dict.fromkeys(np.searchsorted(first, field.suspects(counts), side="right").tolist()):
                problem = field.problem_among(counts[first[k - 1] : first[k]])
                problems[k - 1] += [] if problem is None else [problem]
        if self._index is None:
            index = (np.repeat(first[1:], used) - np.arange(len(objects))).astype(np.float64)
        else:
            index = self._index.values_of(self._index.column(objects))
        return PanoramaColumns(
            time_us=values.get("time_us", [0] * len(payloads)),
            frame_no=values.get("frame_no", [0] * len(payloads)),
            exposure_s=values.get("exposure_s", [0.0] * len(payloads)),
            flags=values.get("flags", [frozenset()] * len(payloads)),
            temperature_c=values.get("temperature_c", [math.nan] * len(payloads)),
            first=first,
            xy_px=xy_px,
            index=index,
            problems=[tuple(found) for found in problems],
            processing_s=values.get("processing_s"),
        )

    def _values_of(self, rows: NDArray[Any]) -> tuple[dict[str, list[Any]], list[list[str]]]:
        """The values of all fields of records (K,), and the problems of each."""
        problems: list[list[str]] = [[] for _ in range(len(rows))]
        if not self._fields:
            return {}, problems
        counts = [field.column(rows).tolist() for field in self._fields]
        for at, field in self._checked:
            for found, number in zip(problems, counts[at], strict=True):
                if (problem := field.problem_of(number)) is not None:
                    found.append(problem)
        columns = zip(self._fields, counts, strict=True)
        values = {field.attribute: [field.value_of(number) for number in column] for field, column in columns}
        if self._split_time:
            values["time_us"] = [self._split_time.time_us(row) for row in zip(*counts, strict=True)]
        return values, problems

    def random_message(self, draw: random.Random) -> PanoramaMessage:
        """A panorama whose numbers all fit its fields."""
        count = self._slots.repeat if self.in_parts else draw.randint(0, min(self._slots.repeat, 30))
        rows = [[draw.randint(0, 255) for _ in range(3)] for _ in range(count)]
        table = np.array(rows, dtype=float).reshape(-1, 3)
        empty = PanoramaMessage.empty()
        xy_px = np.column_stack([self._x.values_of(table[:, 0]), self._y.values_of(table[:, 1])])
        index = table[:, 2] if self._index is None else self._index.values_of(table[:, 2])
        time_us, frame_no = 1_000_000 * draw.randint(0, 2000), draw.randint(0, 255)
        return replace(empty, xy_px=xy_px, index=index, processing_s=0.02, time_us=time_us, frame_no=frame_no)

    @property
    def in_parts(self) -> bool:
        """Whether a panorama may come in several frames."""
        return self._slots.part_first is not None

    def part_of(self, payload: bytes) -> tuple[bytes, int, int, bytes]:
        """Of one frame of a panorama: what tells the exposure, its part (from 0), how many there are, its slots."""
        assert self._slots.part_first is not None
        rows = np.frombuffer(payload, self.layout.dtype, 1)
        counts = {field.name: field.column(rows)[0].tolist() for field in self._fields}
        own = str([counts.get(name) for name in ("frame_no", "week", "time", "fraction")]).encode()
        used = self._used_of_part(payload, counts)
        return own, counts["part"] - self._slots.part_first, counts["parts"], used

    def joined(self, payload: bytes, slots: bytes) -> bytes:
        """The payload of a panorama whose first frame has this one, and all frames these slots."""
        return payload[: self._slots.offset] + slots

    def _used_of_part(self, payload: bytes, counts: Mapping[str, int]) -> bytes:
        slots = payload[self._slots.offset :]
        record = self._slots.dtype.itemsize
        if "count" in counts:
            return slots[: counts["count"] * record]
        while slots and not any(slots[-record:]):
            slots = slots[:-record]
        return slots

    def _slots_of(self, whole: bytes, dtype: np.dtype[Any], columns: int, size: int) -> NDArray[Any]:
        """The slots of payloads of this size that follow each other, as records or bytes (K, columns)."""
        shape = len(whole) // size, columns
        return np.ndarray(shape, dtype, whole, self._slots.offset, (size, dtype.itemsize))

    def _used(self, whole: bytes, counts: list[int] | None, problems: list[list[str]]) -> NDArray[np.int64]:
        """How many slots (K,) hold an object; without a count, up to the last that is not all zero."""
        size, repeat = self._slots.dtype.itemsize, self._slots.repeat
        is_used = self._slots_of(whole, np.dtype(np.uint8), repeat * size, self.layout.size) != 0
        last = np.where(is_used.any(axis=1), is_used.shape[1] - np.argmax(is_used[:, ::-1], axis=1), 0)
        if counts is None:
            return -(-last // size)
        used = np.array([min(max(count, 0), repeat + 1) for count in counts], dtype=np.int64)
        for k in ((used > repeat) | (last > used * size)).nonzero()[0].tolist():
            many = f"there are {repeat} slots" if used[k] > repeat else "a slot after that is not zero"
            problems[k].append(f"count is {counts[k]}, but {many}")
        return np.minimum(used, repeat)

    def encode(self, message: Message) -> bytes:
        """The payload that says this panorama; EncodeError if a value does not fit."""
        [payload] = self.encode_parts(message)
        return payload

    def parts(self, objects: int) -> int:
        """How many frames a panorama of so many objects comes in."""
        return 1 if self._slots.part_first is None else max(-(-objects // self._slots.repeat), 1)

    def encode_parts(self, message: Message) -> list[bytes]:
        """The payloads of the frames that say this panorama."""
        assert isinstance(message, PanoramaMessage)
        count, repeat = len(message.xy_px), self._slots.repeat
        parts = self.parts(count)
        if count > parts * repeat or len(message.index) != count:
            raise EncodeError(
                f"a panorama of {count} positions and {len(message.index)} index values: "
                f"expected as many of each, up to {repeat}"
            )
        return [self._encode_part(message, slice(at * repeat, (at + 1) * repeat), parts) for at in range(parts)]

    def _encode_part(self, message: PanoramaMessage, rows: slice, parts: int) -> bytes:
        xy_px, index = message.xy_px[rows], message.index[rows]
        record, at = self._slots.dtype.itemsize, rows.start // self._slots.repeat
        own = {"count": len(index), "part": at + (self._slots.part_first or 0), "parts": parts}
        payload = bytearray(self.layout.blank)
        self._encode_fields(
            payload, [own[f.name] if f.name in own else getattr(message, f.attribute) for f in self._fields]
        )
        slots = np.frombuffer(payload, self._slots.dtype, len(index), self._slots.offset)
        self._x.put(slots, self._x.counts_of(xy_px[:, 0]))
        self._y.put(slots, self._y.counts_of(xy_px[:, 1]))
        if self._index is not None:
            self._index.put(slots, self._index.counts_of(index))
        return bytes(payload[: self._slots.offset + len(index) * record] if self._slots.are_counted else payload)
