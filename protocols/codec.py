"""Payloads to messages, and back."""

from collections.abc import Mapping
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

    def decode(self, payload: bytes) -> Message:
        """The message of a payload that has this type's length."""
        if self.layout.form is None:
            return Other(self.layout.name, payload)
        values, problems = self._decode_fields(payload)
        return self.layout.form.message(**values, problems=tuple(problems))

    def _decode_fields(self, payload: bytes) -> tuple[dict[str, Any], list[str]]:
        values: dict[str, Any] = {}
        problems: list[str] = []
        if self._fields:
            counts = np.frombuffer(payload, self.layout.dtype, 1)[0].item()
            for field, count in zip(self._fields, counts, strict=True):
                values[field.attribute] = field.value_of(count)
                problem = field.problem_of(count)
                if problem is not None:
                    problems.append(problem)
        return values, problems

    def encode(self, message: Message) -> bytes:
        """The payload that says this message; EncodeError if a value does not fit."""
        if isinstance(message, Other):
            if len(message.payload) != self.layout.size:
                raise EncodeError(f"{message.type} has {self.layout.size} bytes, not {len(message.payload)}")
            return message.payload
        record = np.zeros(1, self.layout.dtype) if self.layout.size else np.zeros(0, np.uint8)
        for field in self._fields:
            record[field.name] = field.count_of(getattr(message, field.attribute))
        return record.tobytes()


class PanoramaCodec(MessageCodec):
    """Converts panoramas: their slots are read as arrays."""

    def __init__(self, layout: MessageLayout, commands: Mapping[int, str]) -> None:
        super().__init__(layout, commands)
        assert layout.slots is not None
        self._slots = layout.slots
        codecs = {field.name: FieldCodec(field, commands) for field in layout.slots.fields}
        self._x, self._y, self._index = codecs["x"], codecs["y"], codecs["index"]
        self._end = self._slots.offset + self._slots.repeat * self._slots.dtype.itemsize

    def decode(self, payload: bytes) -> PanoramaMessage:
        """The panorama of a payload that has this type's length."""
        values, problems = self._decode_fields(payload)
        count = self._used(payload, values.pop("count", None), problems)
        slots = np.frombuffer(payload, self._slots.dtype, self._slots.repeat, self._slots.offset)[:count]
        xy_px = np.empty((count, 2))
        xy_px[:, 0] = self._x.value_of(slots["x"])
        xy_px[:, 1] = self._y.value_of(slots["y"])
        index = np.asarray(self._index.value_of(slots["index"]), dtype=np.float64)
        if count:
            self._check(slots, xy_px, index, problems)
        return PanoramaMessage(
            time_us=values["time_us"],
            frame_no=values.get("frame_no", 0),
            exposure_s=values.get("exposure_s", 0.0),
            flags=values.get("flags", frozenset()),
            temperature_c=values.get("temperature_c", float("nan")),
            xy_px=xy_px,
            index=index,
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

    def _check(self, slots: Any, xy_px: Any, index: Any, problems: list[str]) -> None:
        if not (np.isfinite(xy_px).all() and np.isfinite(index).all()):
            problems.append("a position or index is not a finite number")
        for field in (self._x, self._y, self._index):
            if field.is_bounded:
                counts = slots[field.name]
                problem = field.problem_of(counts.min().item()) or field.problem_of(counts.max().item())
                if problem is not None:
                    problems.append(problem)

    def encode(self, message: Message) -> bytes:
        """The payload that says this panorama."""
        assert isinstance(message, PanoramaMessage)
        count = len(message.xy_px)
        if count > self._slots.repeat or len(message.index) != count:
            raise EncodeError(
                f"a panorama of {count} positions and {len(message.index)} index values: "
                f"expected as many of each, up to {self._slots.repeat}"
            )
        payload = bytearray(self.layout.size)
        head = np.frombuffer(payload, self.layout.dtype, 1)
        for field in self._fields:
            head[field.name] = field.count_of(count if field.name == "count" else getattr(message, field.attribute))
        slots = np.frombuffer(payload, self._slots.dtype, self._slots.repeat, self._slots.offset)[:count]
        slots["x"] = self._x.counts_of(message.xy_px[:, 0])
        slots["y"] = self._y.counts_of(message.xy_px[:, 1])
        slots["index"] = self._index.counts_of(message.index)
        return bytes(payload)
