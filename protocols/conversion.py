"""Wire counts to values in the station's units, and back."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.errors import EncodeError
from protocols.layout import FieldLayout
from protocols.vocabulary import Kind

Count = Any  # a Python int or float, or a list of ints, as numpy gives it
Value = Any  # int, float, str, frozenset[str] or tuple[int, ...], as the field's Kind says

LARGEST_TIME_US = 2**53
"""A sensor clock of 285 years is no clock; beyond it nanoseconds no longer fit 64 bits."""


class FieldCodec:
    """Converts the numbers of one field; ``codes`` names the commands that ACK and NAK speak of."""

    def __init__(self, field: FieldLayout, codes: Mapping[int, str]) -> None:
        self.name = field.name
        self.attribute = field.role.attribute
        self._field = field
        self._words = codes if field.role.kind is Kind.COMMAND else field.words
        self._numbers = {word: number for number, word in self._words.items()}
        self._multiplier, self._divisor = field.factor.numerator, field.factor.denominator
        self._zero = float(field.zero)
        self.value_of: Callable[[Count], Value] = self._reader()

    def _reader(self) -> Callable[[Count], Value]:
        match self._field.role.kind:
            case Kind.NUMBER:
                return self._number
            case Kind.BITS:
                return self._bits
            case Kind.WORD:
                return self._word
            case Kind.COMMAND:
                return self._word
            case Kind.INTEGERS:
                return lambda counts: tuple(int(c) for c in counts) if isinstance(counts, Iterable) else (counts,)
            case Kind.INTEGER:
                plain = self._field.factor == 1 and self._field.zero == 0 and not self._field.is_float
                return (lambda count: count) if plain else self._whole

    def _number(self, count: Count) -> float:
        return count * self._multiplier / self._divisor + self._zero  # type: ignore[no-any-return]

    def _whole(self, count: Count) -> int:
        if isinstance(count, float):
            value = count * self._multiplier / self._divisor + self._zero
            return round(value) if math.isfinite(value) and abs(value) < 2**63 else 0
        return round(self._field.factor * count + self._field.zero)

    def _bits(self, count: int) -> frozenset[str]:
        bits = (bit for bit in range(count.bit_length()) if count >> bit & 1)
        return frozenset(self._words.get(bit, f"bit {bit}") for bit in bits)

    def _word(self, count: int) -> str:
        return self._words.get(count, f"value {count}")

    def problem_of(self, count: Count) -> str | None:
        """What is out of order with this count, in words; None if nothing is."""
        field = self._field
        if isinstance(count, float) and not math.isfinite(count):
            return f"{self.name} is {count}: not a finite number"
        if field.minimum is not None and count < field.minimum:
            return f"{self.name} is {count}, under the minimum of {field.minimum:g}"
        if field.maximum is not None and count > field.maximum:
            return f"{self.name} is {count}, over the maximum of {field.maximum:g}"
        if self.attribute == "time_us" and not 0 <= count * self._multiplier / self._divisor <= LARGEST_TIME_US:
            return f"time is {count}: no sensor clock runs that long"
        return None

    def count_of(self, value: Value) -> Count:
        """The count that says this value; EncodeError if there is none."""
        try:
            count = self._count(value)
        except (TypeError, ValueError, OverflowError) as error:
            raise EncodeError(f"{self.name} cannot be {value!r:.60}") from error
        self._check_fits(count, value)
        return count

    def counts_of(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The counts that say these values (N,), whole numbers unless the wire carries floats; EncodeError."""
        counts = (np.asarray(values, dtype=np.float64) - self._zero) * self._divisor / self._multiplier
        if self._field.is_float:
            return counts
        counts = np.rint(counts)
        low, high = self._range()
        fits = (counts >= low) & (counts <= high)
        if not fits.all():
            raise self._does_not_fit(values[int(np.argmin(fits))])
        return counts

    @property
    def is_bounded(self) -> bool:
        """Whether the description says what counts are in order."""
        return self._field.minimum is not None or self._field.maximum is not None

    def _count(self, value: Value) -> Count:
        match self._field.role.kind:
            case Kind.BITS:
                return sum(1 << self._number_of(word, "bit ") for word in value)
            case Kind.WORD | Kind.COMMAND:
                return self._number_of(value, "value ")
            case Kind.INTEGERS:
                return list(value)
            case _:
                if self._field.is_float:
                    return (value - self._zero) * self._divisor / self._multiplier
                if isinstance(value, int):
                    return round((value - self._field.zero) / self._field.factor)
                return round((value - self._zero) * self._divisor / self._multiplier)

    def _number_of(self, word: str, prefix: str) -> int:
        number = self._numbers.get(word)
        if number is None:
            if not word.startswith(prefix):
                raise EncodeError(f"{self.name} cannot be {word!r:.60}: known are {', '.join(self._numbers) or 'none'}")
            number = int(word.removeprefix(prefix))
        return number

    def _check_fits(self, count: Count, value: Value) -> None:
        if self._field.is_float:
            return
        counts = count if isinstance(count, list) else [count]
        if len(counts) != (self._field.array or 1):
            raise EncodeError(f"{self.name} has {len(counts)} numbers: expected {self._field.array or 1}")
        low, high = self._range()
        if not all(low <= c <= high for c in counts):
            raise self._does_not_fit(value)

    def _range(self) -> tuple[int, int]:
        width = 8 * int(self._field.format[-1])
        return (0, 2**width - 1) if self._field.format[-2] == "u" else (-(2 ** (width - 1)), 2 ** (width - 1) - 1)

    def _does_not_fit(self, value: Value) -> EncodeError:
        low, high = self._range()
        return EncodeError(f"{self.name} cannot be {value!r:.60}: on the wire it is {low} to {high} counts")
