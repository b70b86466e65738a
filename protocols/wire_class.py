"""Wire formats that no description can say: a Python class finds their frames and makes them.

An installed package offers the class as an entry point of the group ``gse.protocols``; ``protocol: NAME`` in the
station file names it. The class still brings a description (YAML, ``description``) of what its payloads hold, with
``framing: {kind: class}``: fields, units and objects are read as those of any sensor. Its header says how many bits
type, flags and sequence number have; where they stand on the wire is the class's affair, as are checksum and length.

The contract is that of a protocol without I/O: no port, no file, no clock, no thread, and nothing remembered from one
call to the next. ``gse protocol check NAME`` tries it.
"""

import hashlib
import inspect
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import NamedTuple
from typing import Protocol as Interface

from protocols.errors import DescriptionError, EncodeError
from protocols.frame import (
    BAD_LENGTH,
    MAX_DISCARD_BYTES,
    NO_SYNC,
    REASONS,
    TRUNCATED,
    UNKNOWN_TYPE,
    Discard,
    Frame,
    HeldBytes,
    Reason,
    discards,
)
from protocols.layout import FrameLayout, MessageLayout

GROUP = "gse.protocols"


class FoundFrame(NamedTuple):
    """A frame at the begin of the bytes: its size there, and what it says; ``sequence`` is -1 without numbers."""

    size: int
    code: int
    payload: bytes
    sequence: int = -1
    flags: int = 0


class Skipped(NamedTuple):
    """So many bytes at the begin are no frame, for a reason of protocols.REASONS."""

    size: int
    reason: Reason


class WireFormat(Interface):
    """What a class of the group offers, made without arguments."""

    description: str
    """The description of its payloads, as YAML."""
    longest: int
    """Bytes of its longest frame."""

    def look(self, data: bytes, *, from_sensor: bool | None) -> FoundFrame | Skipped | None:
        """What stands at the begin of ``data``; None if more bytes are needed to tell.

        The same bytes with more behind them give the same answer.
        """

    def make(self, code: int, payload: bytes, sequence: int, flags: int) -> bytes:
        """The bytes on the wire of a frame."""


class WireClass(NamedTuple):
    """An installed class: where it comes from, and one of it."""

    name: str
    distribution: str
    version: str
    sha256: str
    format: WireFormat


def wire_class_names() -> tuple[str, ...]:
    """The classes that are installed."""
    return tuple(sorted(entry.name for entry in entry_points(group=GROUP)))


def load_wire_class(name: str) -> WireClass:
    """The installed class of this name; DescriptionError where there is none, or it cannot be loaded."""
    found = list(entry_points(group=GROUP, name=name))
    if not found:
        raise DescriptionError(f"no installed package offers the protocol class {name}")
    entry: EntryPoint = found[0]
    try:
        made = entry.load()
        wire_format: WireFormat = made()
        source = inspect.getsourcefile(made)
        sha256 = hashlib.sha256(Path(source).read_bytes() if source else b"").hexdigest()
        if not isinstance(wire_format.description, str) or not 1 <= wire_format.longest <= 1 << 20:
            raise TypeError("expected a text `description`, and `longest`, up to 1048576 bytes")
    except Exception as error:  # whatever a foreign module raises
        raise DescriptionError(f"the protocol class {name} ({entry.value}) cannot be loaded: {error}") from error
    dist = entry.dist
    return WireClass(name, dist.name if dist else "", dist.version if dist else "", sha256, wire_format)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassLayout(FrameLayout):
    """The layout of frames that a class finds and makes; ``can_have`` says which payloads a type code has."""

    format: WireFormat
    layouts: tuple[MessageLayout, ...]

    @property
    def largest(self) -> int:
        """Bytes of the largest frame."""
        return self.format.longest

    def frame(self, layout: MessageLayout, payload: bytes, sequence: int, flags: int) -> bytes:
        """The bytes on the wire of a payload."""
        modulus = self.header.sequence_modulus or 1
        try:
            return bytes(self.format.make(layout.code, payload, sequence % modulus, flags))
        except Exception as error:  # whatever a foreign module raises
            raise EncodeError(f"the protocol class cannot make {layout.name}: {error}") from error

    def look(self, data: bytes, *, final: bool) -> FoundFrame | Skipped | None:
        """What the class finds, checked: a frame that its description does not have is none."""
        try:
            found = self.format.look(data, from_sensor=self.from_sensor)
        except Exception:  # whatever a foreign module raises costs a byte, not the session
            return Skipped(1, NO_SYNC)
        if found is None:
            return Skipped(1, TRUNCATED) if final else None
        if not 1 <= found.size <= len(data) or (isinstance(found, Skipped) and found.reason not in REASONS):
            return Skipped(1, NO_SYNC)
        if isinstance(found, Skipped):
            return found
        layout = next((of for of in self.layouts if self.names.get(found.code) == of.name), None)
        if layout is None:
            return Skipped(found.size, UNKNOWN_TYPE)
        return found if layout.can_have(len(found.payload)) else Skipped(found.size, BAD_LENGTH)


class ClassScanner(HeldBytes):
    """Holds at most one incomplete frame, and the discard before it; any byte may complete a frame."""

    def __init__(self, layout: ClassLayout) -> None:
        super().__init__()
        self._layout = layout

    def feed(self, data: bytes) -> list[Frame | Discard]:
        """Frames and discards that these bytes complete."""
        self._buffer += data
        return self._take(final=False)

    def finish(self) -> list[Frame | Discard]:
        """Frames and discards at the end of the stream."""
        out = self._take(final=True)
        out += self._discard(0, len(self._buffer))
        self._drop(len(self._buffer))
        self._scan, self._reason = 0, NO_SYNC
        return out

    def _take(self, *, final: bool) -> list[Frame | Discard]:
        out: list[Frame | Discard] = []
        at, longest = 0, self._layout.format.longest
        while self._scan < len(self._buffer):
            data = bytes(self._buffer[self._scan : self._scan + longest])
            found = self._layout.look(data, final=final)
            if found is None and len(data) == longest:
                found = Skipped(1, NO_SYNC)
            if found is None:
                break
            begin, end = self._scan, self._scan + found.size
            if isinstance(found, FoundFrame):
                out += self._discard(at, begin)
                name = self._layout.names[found.code]
                known_at = self._start + end
                out.append(
                    Frame(self._start + begin, found.size, name, found.flags, found.sequence, found.payload, known_at)
                )
                at, self._reason = end, NO_SYNC
            elif begin == at or found.reason != self._reason:
                out += self._discard(at, begin)
                at, self._reason = begin, found.reason
            self._scan = end
            if self._scan - at >= MAX_DISCARD_BYTES:
                out += self._discard(at, self._scan)
                at = self._scan
        self._drop(at)
        return out

    def _discard(self, at: int, end: int) -> list[Discard]:
        if end == at:
            return []
        return discards(self._start + at, bytes(self._buffer[at:end]), self._reason, self._start + end)
