"""Compiled protocol, ready to decode and encode."""

import copy
import dataclasses
import difflib
import functools
import random
import reprlib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from protocols.codec import MessageCodec, PanoramaCodec, StarsCodec
from protocols.commands import compile_commands
from protocols.description import Description, TimeDescription
from protocols.errors import DescriptionError, EncodeError
from protocols.frame import Frame
from protocols.items import Item, ItemValue, compile_items, unknown_name
from protocols.layout import Addresses, FrameLayout, MessageLayout, compile_frame, compile_messages, one_way
from protocols.messages import (
    Ack,
    Command,
    Message,
    Nak,
    Other,
    PanoramaColumns,
    PanoramaMessage,
    StarsMessage,
    StatusMessage,
    Value,
)
from protocols.parts import MAX_PARTS, PART
from protocols.reading import MAX_TEXT, DescriptionSource, read_document, validate
from protocols.text import TextLayout, compile_text
from protocols.vocabulary import NAME_OF
from protocols.wire_class import ClassLayout, load_wire_class, wire_class_names

_CODECS = {"PANORAMA": PanoramaCodec, "STARS": StarsCodec}


class Protocol:
    """Decodes and encodes the messages of one sensor.

    ``text`` is the YAML that it was made from, complete in itself: what a session keeps.
    """

    def __init__(self, description: Description, text: str, source: DescriptionSource) -> None:
        self.name = description.name
        self.text = text
        self.description = description
        layouts = compile_messages(description, source)
        compiled = compile_text if description.framing.kind == "line" else compile_frame
        self.frame_layout: FrameLayout = compiled(description, layouts, source)
        self.remark = ""
        if description.framing.kind == "class":
            self.frame_layout, self.remark = _of_class(description, self.frame_layout, layouts, source)
        commands = {layout.code: name for name, layout in layouts.items() if not layout.from_sensor}
        self.items = compile_items(description, layouts, source)
        self.commands = compile_commands(description, layouts, self.items, source, self)
        self.parameters = self._parameter_names(source)
        self._codecs = {
            name: (_CODECS[name] if layout.slots else MessageCodec)(layout, commands)
            for name, layout in layouts.items()
        }
        panoramas = self._codecs.get("PANORAMA")
        self.panoramas = panoramas if isinstance(panoramas, PanoramaCodec) else None
        stars = self._codecs.get("STARS")
        self.stars = stars if isinstance(stars, StarsCodec) else None

    def __repr__(self) -> str:
        return f"<Protocol {self.name}: {', '.join(self._codecs)}>"

    def _parameter_names(self, source: DescriptionSource) -> tuple[str, ...]:
        """The items that are parameters; DescriptionError where no command reads them back."""
        name = self.description.parameters
        if name is None:
            return ()
        if name not in self.commands:
            raise source.error(unknown_name(name, self.commands, "command"), ("parameters",))
        found = tuple(item.name for item in self.items.values() if item.message == self.commands[name].answer)
        if not found:
            raise source.error(f"the answer to {name} is no message with items", ("parameters",))
        return found

    @functools.cached_property
    def items_by_message(self) -> dict[str, tuple[Item, ...]]:
        """The items of each message that brings any, in the order of ``item_numbers``."""
        names = dict.fromkeys(item.message for item in self.items.values())
        return {name: tuple(item for item in self.items.values() if item.message == name) for name in names}

    @functools.cached_property
    def acknowledges(self) -> dict[type[Message], frozenset[str]]:
        """The fields that ACK and NAK have."""
        found = {Ack: "ACK", Nak: "NAK"}
        codecs = self._codecs
        return {
            of: frozenset(field.name for field in codecs[name].layout.fields) if name in codecs else frozenset()
            for of, name in found.items()
        }

    @property
    def types(self) -> tuple[str, ...]:
        """The names of its messages."""
        return tuple(self._codecs)

    @property
    def sequence_modulus(self) -> int:
        """Where its sequence numbers wrap; 0 if it has none."""
        return self.frame_layout.header.sequence_modulus

    @property
    def slots(self) -> int:
        """How many objects one panorama holds; 0 if there are no panoramas."""
        layout = self._codecs["PANORAMA"].layout if "PANORAMA" in self._codecs else None
        if layout is None or layout.slots is None:
            return 0
        return layout.slots.repeat * (1 if layout.slots.part_first is None else MAX_PARTS)

    @property
    def object_units(self) -> dict[str, tuple[float, float]]:
        """Factor and zero of the counts of an object's y, x and index; empty if there are no panoramas."""
        layout = self._codecs["PANORAMA"].layout if "PANORAMA" in self._codecs else None
        fields = layout.slots.fields if layout and layout.slots else ()
        return {field.name: (float(field.factor), float(field.zero)) for field in fields}

    def is_from_sensor(self, type_name: str) -> bool:
        """Whether messages of this type go from sensor to station."""
        return self._codecs[type_name].layout.from_sensor

    def one_way_layout(self, *, from_sensor: bool, echoes: bool = False) -> FrameLayout:
        """The layout of the frames that the sensor sends, or of those that it is sent; ``echoes`` as of a decoder."""
        layouts = [codec.layout for codec in self._codecs.values()]
        return one_way(self.frame_layout, layouts, from_sensor=from_sensor, echoes=echoes)

    def with_addresses(self, sensor: int | None, host: int | None) -> "Protocol":
        """The same protocol between other addresses than its description's; EncodeError where it has none."""
        if sensor is None and host is None:
            return self
        own = self.frame_layout.addresses
        if own is None:
            raise EncodeError(
                f"the protocol {self.name} has no addresses: leave out port.address and port.host_address"
            )
        found = copy.copy(self)
        addresses = Addresses(own.sensor if sensor is None else sensor, own.host if host is None else host)
        found.frame_layout = dataclasses.replace(self.frame_layout, addresses=addresses)
        found.commands = {name: dataclasses.replace(of, _protocol=found) for name, of in self.commands.items()}
        return found

    @property
    def time(self) -> TimeDescription:
        """What its time tags tell; a counter's, at mid-exposure, unless the description says otherwise."""
        return self.description.time or TimeDescription()

    @property
    def sequence_step(self) -> int:
        """By which a sequence number goes on from frame to frame."""
        return self.description.sequence.step

    @property
    def counts_each_message(self) -> bool:
        """Whether each message has a sequence number of its own."""
        return self.description.sequence.per == "message"

    def frames_of(self, message: Message) -> int:
        """How many frames say this message."""
        return (
            self.panoramas.parts(len(message.index)) if isinstance(message, PanoramaMessage) and self.panoramas else 1
        )

    def random_payload(self, type_name: str, draw: random.Random) -> bytes:
        """Bytes of a length that this message can have, with a count that agrees; its spare bits as they always are."""
        layout = self._codecs[type_name].layout
        if not layout.slots:
            # Any number stands in a binary field, in a line only those that its words can say.
            return layout.blank if isinstance(self.frame_layout, TextLayout) else draw.randbytes(layout.size)
        codec = self._codecs[type_name]
        if not isinstance(codec, PanoramaCodec):
            return codec.encode(StarsMessage(objects=(1, 0), stars=(draw.randint(1, 255), 7), residuals_arcsec=(1, 2)))
        return codec.encode_parts(codec.random_message(draw))[0]

    def flags_of(self, frame: Frame) -> frozenset[str]:
        """The names of the header's flags that are set; ``stored`` is data that is not live."""
        names = self.frame_layout.header.flag_names
        bits = (bit for bit in range(frame.flags.bit_length()) if frame.flags >> bit & 1)
        return frozenset(names.get(bit, f"bit {bit}") for bit in bits)

    @property
    def test_flag(self) -> int:
        """The header's flag of a stream that comes from no detector; 0 in a format without room for it."""
        return sum(1 << bit for bit, name in self.frame_layout.header.flag_names.items() if name == "test")

    @property
    def has_serial(self) -> bool:
        """Whether STATUS has the serial number, which is 0 in a stream that comes from no detector."""
        return "STATUS" in self._codecs and any(one.name == "serial" for one in self._codecs["STATUS"].layout.fields)

    def is_test(self, frame: Frame) -> bool:
        """Whether a frame says that its stream comes from no detector: by its flag; in a format without it by STATUS.

        The serial number 0 is that of an emulator.
        """
        if test_flag := self.test_flag:
            return bool(frame.flags & test_flag)
        if frame.type != "STATUS" or not self.has_serial:
            return False
        message = self.decode(frame)
        return isinstance(message, StatusMessage) and message.serial == 0

    def decode(self, frame: Frame) -> Message:
        """The message of a frame of this protocol's own decoder; invalid values are listed in its ``problems``."""
        if frame.type == PART:
            return Other(PART, frame.payload)
        return self._codecs[frame.type].decode(frame.payload)

    def blank(self, type_name: str) -> bytes:
        """A payload of a message in which nothing is said yet."""
        return self._codecs[type_name].layout.blank

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons for which NAK refuses a command; empty where it names none."""
        fields = self._codecs["NAK"].layout.fields if "NAK" in self._codecs else ()
        return next((tuple(field.words.values()) for field in fields if field.name == "reason"), ())

    def item_numbers(self, type_name: str, payloads: Sequence[bytes]) -> NDArray[np.float64]:
        """The items (N, K) of messages of one type, in the order of ``items_by_message``; words as their numbers."""
        return self._codecs[type_name].items(payloads, [item.field for item in self.items_by_message[type_name]])

    def items_of(self, frame: Frame) -> dict[str, ItemValue]:
        """The items that a frame brings, by name."""
        items = self.items_by_message.get(frame.type, ())
        numbers = self.item_numbers(frame.type, [frame.payload])[0].tolist() if items else ()
        return {item.name: item.value(number) for item, number in zip(items, numbers, strict=True)}

    def decode_panoramas(self, frames: Sequence[Frame]) -> PanoramaColumns:
        """The messages of PANORAMA frames, as columns."""
        codec = self._codecs["PANORAMA"]
        assert isinstance(codec, PanoramaCodec)
        return codec.decode_many([frame.payload for frame in frames])

    def encode(
        self, message: Message, sequence: int, flags: int = 0, items: Mapping[str, Value] = MappingProxyType({})
    ) -> bytes:
        """The bytes on the wire that say this message, its sequence number wrapped as the protocol does.

        With ``items`` those of them that are its own. EncodeError if this protocol cannot say it.
        """
        name = name_of(message)
        if name not in self._codecs:
            raise EncodeError(f"the protocol {self.name} has no {name}: it has {', '.join(self._codecs)}")
        codec = self._codecs[name]
        payloads = codec.encode_parts(message) if isinstance(codec, PanoramaCodec) else [codec.encode(message)]
        if items and codec.layout.items:
            payloads = [codec.with_items(payload, items) for payload in payloads]
        step = self.sequence_step
        return b"".join(
            [self.encode_payload(name, payload, sequence + at * step, flags) for at, payload in enumerate(payloads)]
        )

    def as_sent(self, message: Message) -> Message:
        """The message as it is read at the other end: its values as counts of the wire; EncodeError as for encode."""
        codec = self._codecs[name_of(message)]
        return codec.decode(codec.encode(message))

    def resent(self, frame: Frame, message: Message, sequence: int, flags: int) -> bytes:
        """A frame of this protocol anew, with the time of ``message`` and another sequence number.

        All else of its payload is as it was; a panorama that came in parts goes in parts. EncodeError if the time does
        not fit.
        """
        in_parts = frame.type == "PANORAMA" and self.panoramas is not None and self.panoramas.in_parts
        if in_parts:
            return self.encode(message, sequence, flags)
        time_us = getattr(message, "time_us", None)
        payload = frame.payload if time_us is None else self._codecs[frame.type].retimed(frame.payload, time_us)
        return self.encode_payload(frame.type, payload, sequence, flags)

    def encode_payload(self, type_name: str, payload: bytes, sequence: int, flags: int = 0) -> bytes:
        """The bytes on the wire of a payload, without a check of its content."""
        layout, frames = self._codecs[type_name].layout, self.frame_layout
        is_any = isinstance(frames, TextLayout) and type_name not in frames.messages
        if not is_any and not layout.can_have(len(payload)):
            raise EncodeError(f"{type_name} has {layout.size} bytes of payload, not {len(payload)}")
        if not 0 <= flags <= frames.header.largest_flags:
            raise EncodeError(f"flags cannot be {flags}: the header has room for 0 to {frames.header.largest_flags}")
        return frames.frame(layout, payload, sequence, flags)


def name_of(message: Message) -> str:
    """The name of a message in a description."""
    if isinstance(message, Other):
        return message.type
    return message.name if isinstance(message, Command) else NAME_OF[type(message)]


def _of_class(
    description: Description, base: FrameLayout, layouts: Mapping[str, MessageLayout], source: DescriptionSource
) -> tuple[FrameLayout, str]:
    """The layout of a class's frames, and a remark where it is not the one that the description was made with."""
    framing = description.framing
    try:
        found = load_wire_class(framing.name or "")
    except DescriptionError as error:
        wanted = " ".join(filter(None, (framing.distribution, framing.version)))
        advice = f"; it was {wanted}: install that" if wanted else ""
        raise source.error(f"{error}{advice}", ("framing", "name")) from error
    same = framing.sha256 in (None, found.sha256)
    remark = (
        f"the protocol class {found.name} is that of {found.distribution} {found.version} now; "
        f"the session was recorded with {framing.distribution} {framing.version}"
    )
    fields = {field.name: getattr(base, field.name) for field in dataclasses.fields(base)}
    return ClassLayout(**fields, format=found.format, layouts=tuple(layouts.values())), "" if same else remark


@functools.lru_cache(maxsize=16)
def parse_protocol(text: str, source: str) -> Protocol:
    """The protocol of a YAML text; DescriptionError names ``source``, line, key and reason.

    One that was compiled before is given again: a protocol never changes, and PyYAML takes 20 ms.
    """
    document, where = read_document(text, source)
    if "extends" in document:
        document = _extended(document, where)
        text = yaml.safe_dump(document, sort_keys=False)
    return Protocol(validate(document, where), text, where)


def _extended(document: dict[str, Any], where: DescriptionSource) -> dict[str, Any]:
    """The document with the top-level keys that it leaves out taken from the built-in description it extends."""
    if "extends" not in document:
        return document
    base = document["extends"]
    if not isinstance(base, str) or base not in built_in_names():
        raise where.error(f"is {reprlib.repr(base)}: expected one of {', '.join(built_in_names())}", ("extends",))
    merged = {**_extended(*read_document(_built_in_text(base), base)), **document}
    del merged["extends"]
    return merged


def load_protocol(name_or_path: str) -> Protocol:
    """The protocol of a built-in name, of an installed class, or of a YAML file."""
    if name_or_path in built_in_names():
        return parse_protocol(_built_in_text(name_or_path), f"{name_or_path}.yaml")
    if name_or_path in wire_class_names():
        return parse_protocol(_class_text(name_or_path), f"protocol class {name_or_path}")
    path = Path(name_or_path)
    if path.exists() and not path.is_file():
        raise DescriptionError(
            f"{name_or_path} is not a file: expected a built-in protocol or the path of a description"
        )
    try:
        with path.open("rb") as file:
            text = file.read(MAX_TEXT + 1).decode("utf-8")
    except OSError as error:
        near = difflib.get_close_matches(name_or_path, built_in_names(), n=1)
        raise DescriptionError(
            f"{name_or_path}: neither a built-in protocol ({', '.join(built_in_names())}) "
            f"nor a description that can be read: {error.strerror}{f'; did you mean {near[0]}?' if near else ''}"
        ) from error
    except UnicodeDecodeError as error:
        raise DescriptionError(f"{name_or_path}: not a protocol description: it is not UTF-8 text") from error
    return parse_protocol(text, name_or_path)


def _class_text(name: str) -> str:
    """The description that a class brings, with the class's own identity: what a session keeps."""
    found = load_wire_class(name)
    document, _ = read_document(found.format.description, f"description of the protocol class {name}")
    identity = {"distribution": found.distribution, "version": found.version, "sha256": found.sha256}
    return yaml.safe_dump(document | {"framing": {"kind": "class", "name": name, **identity}}, sort_keys=False)


def built_in_names() -> tuple[str, ...]:
    """The protocols that come with the station."""
    return tuple(
        sorted(entry.name[:-5] for entry in resources.files("protocols").iterdir() if entry.name.endswith(".yaml"))
    )


def _built_in_text(name: str) -> str:
    return resources.files("protocols").joinpath(f"{name}.yaml").read_text(encoding="utf-8")
