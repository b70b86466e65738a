"""Payloads to messages, and back."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from protocols.conversion import FieldCodec
from protocols.errors import EncodeError
from protocols.layout import MessageLayout
from protocols.messages import Message, Other, PanoramaMessage


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
        self._end = self._slots.offset + self._slots.repeat * self._slots.dtype.itemsize

    def decode(self, payload: bytes) -> PanoramaMessage:
        """The panorama of a payload that has this type's length."""
        if self._has_floats:
            with np.errstate(invalid="ignore", over="ignore"):  # a signalling NaN, say: a problem, not a warning
                return self._decode(payload)
        return self._decode(payload)

    def _decode(self, payload: bytes) -> PanoramaMessage:
        values, problems = self._decode_fields(payload)
        used = self._used(payload, values.pop("count", None), problems)
        slots = np.frombuffer(payload, self._slots.dtype, used, self._slots.offset)
        xy_px = np.empty((used, 2))
        xy_px[:, 0] = self._x.values_of(slots["x"])
        xy_px[:, 1] = self._y.values_of(slots["y"])
        problems += self._problems(field.problem_among(slots[field.name]) for field in self._checked_slots)
        return PanoramaMessage(
            time_us=values["time_us"],
            frame_no=values.get("frame_no", 0),
            exposure_s=values.get("exposure_s", 0.0),
            flags=values.get("flags", frozenset()),
            temperature_c=values.get("temperature_c", math.nan),
            xy_px=xy_px,
            index=self._index.values_of(slots["index"]),
            problems=tuple(problems),
        )

    def _used(self, payload: bytes, count: int | None, problems: list[str]) -> int:
        """How many slots hold an object; without a count, up to the last that is not all zero."""
        size = self._slots.dtype.itemsize
        if count is None:
            used = len(payload[self._slots.offset : self._end].rstrip(b"\0"))
            return -(-used // size)
        if count > self._slots.repeat:
            problems.append(f"count is {count}, but there are {self._slots.repeat} slots")
            return self._slots.repeat
        unused = payload[self._slots.offset + count * size : self._end]
        if unused.count(0) != len(unused):
            problems.append(f"count is {count}, but a slot after that is not zero")
        return count

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
