"""Payloads to messages, and back."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.conversion import FieldCodec
from protocols.errors import EncodeError
from protocols.layout import MessageLayout
from protocols.messages import Message, Other, PanoramaColumns, PanoramaMessage


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
