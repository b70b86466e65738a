"""Payloads to messages, and back."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.errors import EncodeError
from protocols.layout import MessageLayout
from protocols.messages import Message, Other, PanoramaColumns, PanoramaMessage
from protocols.record import FieldLayout
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

    def __init__(self, field: FieldLayout, commands: Mapping[int, str]) -> None:
        self.name = field.name
        self.attribute = field.role.attribute
        self.is_float = field.is_float
        self._field = field
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
        width = 8 * int(self._field.format[-1])
        return (0, 2**width - 1) if self._field.format[-2] == "u" else (-(2 ** (width - 1)), 2 ** (width - 1) - 1)

    def _does_not_fit(self, value: Value) -> EncodeError:
        low, high = self._range()
        return EncodeError(f"{self.name} cannot be {value!r:.60}: on the wire it has {low} to {high} counts")


class MessageCodec:
    """Converts payloads of one type; ``commands`` are the names of the command codes."""

    def __init__(self, layout: MessageLayout, commands: Mapping[int, str]) -> None:
        self.layout = layout
        self._fields = tuple(FieldCodec(field, commands) for field in layout.fields)
        self._checked = tuple((at, field) for at, field in enumerate(self._fields) if field.is_checked)

    def decode(self, payload: bytes) -> Message:
        """The message of a payload that has this type's length."""
        if self.layout.form is None:
            return Other(self.layout.name, payload)
        values, problems = self._decode_fields(payload)
        return self.layout.form.message(**values, problems=tuple(problems))

    def _decode_fields(self, payload: bytes) -> tuple[dict[str, Any], list[str]]:
        if not self._fields:
            return {}, []
        counts = np.frombuffer(payload, self.layout.dtype, 1)[0].item()
        values = {field.attribute: field.value_of(count) for field, count in zip(self._fields, counts, strict=True)}
        return values, self._problems(field.problem_of(counts[at]) for at, field in self._checked)

    @staticmethod
    def _problems(found: Iterator[str | None]) -> list[str]:
        return [problem for problem in found if problem is not None]

    def encode(self, message: Message) -> bytes:
        """The payload that says this message; EncodeError if a value does not fit."""
        if isinstance(message, Other):
            return message.payload
        payload = bytearray(self.layout.size)
        self._encode_fields(payload, [getattr(message, field.attribute) for field in self._fields])
        return bytes(payload)

    def _encode_fields(self, payload: bytearray, values: Sequence[Any]) -> None:
        if self._fields:
            counts = tuple(field.count_of(value) for field, value in zip(self._fields, values, strict=True))
            np.frombuffer(payload, self.layout.dtype, 1)[0] = counts


class PanoramaCodec(MessageCodec):
    """Converts panoramas: their slots are read and written as arrays."""

    def __init__(self, layout: MessageLayout, commands: Mapping[int, str]) -> None:
        super().__init__(layout, commands)
        assert layout.slots is not None
        self._slots = layout.slots
        codecs = {field.name: FieldCodec(field, commands) for field in layout.slots.fields}
        self._x, self._y, self._index = codecs["x"], codecs["y"], codecs["index"]
        self._checked_slots = tuple(field for field in codecs.values() if field.is_checked)
        self._has_floats = any(field.is_float for field in codecs.values())

    def decode(self, payload: bytes) -> PanoramaMessage:
        """The panorama of a payload that has this type's length."""
        return self.decode_many([payload])[0]

    def decode_many(self, payloads: Sequence[bytes]) -> PanoramaColumns:
        """The panoramas of payloads that have this type's length."""
        if self._has_floats:
            with np.errstate(invalid="ignore", over="ignore"):  # a signalling NaN, say: a problem, not a warning
                return self._decode_many(payloads)
        return self._decode_many(payloads)

    def _decode_many(self, payloads: Sequence[bytes]) -> PanoramaColumns:
        whole = b"".join(payloads)
        values, problems = self._values_of(whole, len(payloads))
        used = self._used(whole, values.get("count"), problems)
        first = np.zeros(len(payloads) + 1, dtype=np.int64)
        np.cumsum(used, out=first[1:])
        slots = self._slots_of(whole, self._slots.dtype, self._slots.dtype.itemsize)
        objects = slots[np.arange(self._slots.repeat) < used[:, None]]
        xy_px = np.empty((len(objects), 2))
        xy_px[:, 0], xy_px[:, 1] = self._x.values_of(objects["x"]), self._y.values_of(objects["y"])
        for field in self._checked_slots:
            for k in dict.fromkeys(np.searchsorted(first, field.suspects(objects[field.name]), side="right").tolist()):
                problem = field.problem_among(objects[field.name][first[k - 1] : first[k]])
                problems[k - 1] += [] if problem is None else [problem]
        return PanoramaColumns(
            time_us=values["time_us"],
            frame_no=values.get("frame_no", [0] * len(payloads)),
            exposure_s=values.get("exposure_s", [0.0] * len(payloads)),
            flags=values.get("flags", [frozenset()] * len(payloads)),
            temperature_c=values.get("temperature_c", [math.nan] * len(payloads)),
            first=first,
            xy_px=xy_px,
            index=self._index.values_of(objects["index"]),
            problems=[tuple(found) for found in problems],
        )

    def _values_of(self, whole: bytes, count: int) -> tuple[dict[str, list[Any]], list[list[str]]]:
        """The values of all fields of so many payloads that follow each other, and the problems of each payload."""
        problems: list[list[str]] = [[] for _ in range(count)]
        if not self._fields:
            return {}, problems
        rows = np.frombuffer(whole, self.layout.dtype)
        counts = [rows[field.name].tolist() for field in self._fields]
        for at, field in self._checked:
            for found, number in zip(problems, counts[at], strict=True):
                if (problem := field.problem_of(number)) is not None:
                    found.append(problem)
        columns = zip(self._fields, counts, strict=True)
        return {field.attribute: [field.value_of(number) for number in column] for field, column in columns}, problems

    def _slots_of(self, whole: bytes, dtype: np.dtype[Any], step: int) -> NDArray[Any]:
        """The slots of payloads that follow each other, (K, repeat) records or (K, bytes)."""
        size = self._slots.repeat * self._slots.dtype.itemsize
        shape = len(whole) // self.layout.size, size // step
        return np.ndarray(shape, dtype, whole, self._slots.offset, (self.layout.size, step))

    def _used(self, whole: bytes, counts: list[int] | None, problems: list[list[str]]) -> NDArray[np.int64]:
        """How many slots (K,) hold an object; without a count, up to the last that is not all zero."""
        size, repeat = self._slots.dtype.itemsize, self._slots.repeat
        is_used = self._slots_of(whole, np.dtype(np.uint8), 1) != 0
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
        assert isinstance(message, PanoramaMessage)
        count = len(message.xy_px)
        if count > self._slots.repeat or len(message.index) != count:
            raise EncodeError(
                f"a panorama of {count} positions and {len(message.index)} index values: "
                f"expected as many of each, up to {self._slots.repeat}"
            )
        payload = bytearray(self.layout.size)
        values = [count if f.name == "count" else getattr(message, f.attribute) for f in self._fields]
        self._encode_fields(payload, values)
        slots = np.frombuffer(payload, self._slots.dtype, count, self._slots.offset)
        slots["x"] = self._x.counts_of(message.xy_px[:, 0])
        slots["y"] = self._y.counts_of(message.xy_px[:, 1])
        slots["index"] = self._index.counts_of(message.index)
        return bytes(payload)
