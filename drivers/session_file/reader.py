"""Session files: MCAP to records, whatever was done to the file.

Every record is checked before it is given (messages by the CRC in ``sequence``, chunks and attachments by MCAP's own)
and after a damaged one the reader looks for the next that is whole. A file that was cut, or is still being written,
gives all its whole records. Memory is bounded by the largest record that is believed.
"""

import json
import re
import zlib
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from drivers.errors import CaptureError
from drivers.session_file.record_scanner import FileWindow, RecordScanner
from drivers.session_file.records import CONTINUED, CONTINUES, RX, TX, Attachment, Damage, Record, RecordedMessage

MOST_ATTACHMENTS = 1000
"""Names kept to give each file frozen into the segments once."""
MAX_DAMAGES_KEPT = 100
"""Damages listed one by one; all are counted."""
_SEAMS = (CONTINUED, CONTINUES)
"""They hold the segments together, and are no messages of the session."""
_NOT_PLAIN = (None, *_SEAMS)


# Which files are segments of one session.
#
# A file name is no proof: somebody's session.part2.mcap beside a session.mcap is another session. A segment says of
# which session it is, which number it has, and where the one before it ended. Segments from before November 2026 do not
# say it; they have the attachments of the first.


@dataclass(slots=True)
class _Head:
    """What stands before and in the first message of a file; ``damaged``: a part of it is not a valid record."""

    attachments: dict[str, int] = field(default_factory=dict)
    stamp: tuple[int, int] | None = None
    statement: dict[str, object] | None = None
    damaged: bool = False


class SegmentChain:
    """Decides which files are the segments of a session, in their order.

    ``missing`` names segments that should be there; ``foreign`` are sentences on files that have the name of a segment
    and belong to another session: they are not read.
    """

    def __init__(self, first: Path) -> None:
        self.missing: list[str] = []
        self.foreign: list[str] = []
        self._first = first
        self._files = _numbered(first)
        self._head = _head_of(first) if len(self._files) > 1 else _Head()
        self._segment = first
        self._number = 1
        self._end: RecordedMessage | None = None
        self._is_last = False

    def segments(self) -> Iterator[Path]:
        """Each segment; ``was_read`` has to be called before the next is asked for."""
        yield self._first
        for number, path in self._files[1:]:
            if reason := self._refusal(number, path):
                self.foreign.append(f"{path.name} was not read, it is no part of {self._first.name}: {reason}")
                continue
            self.missing += [segment_path(self._first, gap).name for gap in range(self._number + 1, number)]
            self._segment, self._number, self._end = path, number, None
            yield path
        if self._end is not None:
            self.missing.append(f"what follows {self._segment.name}")

    def was_read(self, scanner: RecordScanner, end: RecordedMessage | None, *, damaged: bool) -> None:
        """A segment was read to its end: with this message of CONTINUED, or none."""
        self._end = end
        self._is_last = scanner.ended and not damaged and not scanner.has_channel(CONTINUED)

    def _refusal(self, number: int, path: Path) -> str | None:
        """Why a file is not the segment of its number, or None."""
        if self._is_last:
            return f"{self._segment.name} is closed, and says that nothing follows"
        try:
            head = _head_of(path)
        except CaptureError as error:
            return str(error)
        if head.statement is None:
            return self._refusal_of_undeclared(head)
        session, said = head.statement.get("session"), head.statement.get("segment")
        if self._head.stamp is not None and not self._head.damaged and session != list(self._head.stamp):
            return "it says that it continues another session"
        if said != number:
            return f"it says that it is segment {said!r:.20}"
        if self._end and number == self._number + 1 and head.stamp != (self._end.utc_ns, self._end.mono_ns):
            return f"it does not begin where {self._segment.name} ends"
        return None

    def _refusal_of_undeclared(self, head: _Head) -> str | None:
        """The same for a file that does not say what it continues: one from before segments did, or no segment."""
        if head.damaged or self._head.damaged:
            return None
        if self._end is not None and self._end.data.startswith(b"{"):
            return "it is the beginning of a session"
        for name, crc in self._head.attachments.items():
            if head.attachments.get(name, crc) != crc:
                return f"its {name} is another"
        return None


def _head_of(path: Path) -> _Head:
    head = _Head()
    with FileWindow(path) as window:
        for record in RecordScanner(window, path.name).records():
            if isinstance(record, Damage):
                head.damaged = True
            elif isinstance(record, RecordedMessage):
                head.stamp = (record.utc_ns, record.mono_ns)
                head.statement = _object(record.data) if record.topic == CONTINUES else None
                break
            elif len(head.attachments) < MOST_ATTACHMENTS:
                head.attachments.setdefault(record.name, zlib.crc32(record.data))
    return head


def _object(data: bytes) -> dict[str, object]:
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


class Capture:
    """A session, read once from front to end: iterate over it.

    While it goes, and when it is over, ``truncated`` tells whether the end is missing, ``damages`` lists the first
    damaged places, ``damage_count`` and ``damaged_bytes`` count all of them, ``missing`` names segments that should be
    there, ``foreign`` are sentences on files that are no segments, and ``segments`` those that were read.
    """

    def __init__(
        self,
        first: Path,
        *,
        from_utc_ns: int | None = None,
        only: Collection[str] | None = None,
        alone: bool = False,
    ) -> None:
        self.segments: list[Path] = []
        self.truncated = False
        self.damages: list[Damage] = []
        self.damage_count = 0
        self.damaged_bytes = 0
        self._chain = SegmentChain(first)
        self._from_utc_ns = from_utc_ns
        self._only = None if only is None else frozenset(only)
        self._alone = alone
        self._parts = self._read(iter([first]) if alone else self._chain.segments())
        self._records = chain.from_iterable(self._parts)

    def __iter__(self) -> Iterator[Record]:
        return self._records

    def __next__(self) -> Record:
        return next(self._records)

    def parts(self) -> Iterator[Sequence[Record]]:
        """The records in parts, those of a chunk of the file together: to be read instead of the records."""
        return self._parts

    @property
    def missing(self) -> list[str]:
        """Names of segments that should be there."""
        return self._chain.missing

    @property
    def foreign(self) -> list[str]:
        """Sentences on files that have the name of a segment and belong to another session."""
        return self._chain.foreign

    @property
    def is_damaged(self) -> bool:
        """Whether something is missing of what was read so far."""
        return self.truncated or self.damage_count > 0

    def _read(self, segments: Iterator[Path]) -> Iterator[Sequence[Record]]:
        attached: set[str] = set()
        searched = None if self._only is None else {*self._only, CONTINUED}
        for segment in segments:
            self.segments.append(segment)
            end, damages = None, self.damage_count
            with FileWindow(segment) as window:
                walk = RecordScanner(window, segment.name, from_utc_ns=self._from_utc_ns, only=searched)
                for part in walk.parts():
                    kinds = {record.topic if isinstance(record, RecordedMessage) else None for record in part}
                    if CONTINUED in kinds:
                        end = next(
                            each for each in part if isinstance(each, RecordedMessage) and each.topic == CONTINUED
                        )
                    is_plain = kinds <= self._only if self._only is not None else kinds.isdisjoint(_NOT_PLAIN)
                    yield part if is_plain else [record for record in part if self._gives(record, attached)]
            self.truncated |= not walk.ended
            self._chain.was_read(walk, end, damaged=self.damage_count > damages)
        self.truncated |= bool(self.missing or self.foreign)

    def _gives(self, record: Record, attached: set[str]) -> bool:
        """Whether a record is for the reader: a wanted message, damage, which is counted, or a new attachment."""
        if isinstance(record, RecordedMessage):
            return self._alone if record.topic in _SEAMS else self._only is None or record.topic in self._only
        if isinstance(record, Damage):
            self._count(record)
            return True
        is_new = record.name not in attached
        if is_new and len(attached) < MOST_ATTACHMENTS:
            attached.add(record.name)
        return is_new

    def _count(self, damage: Damage) -> None:
        self.damage_count += 1
        self.damaged_bytes += damage.size
        if len(self.damages) < MAX_DAMAGES_KEPT:
            self.damages.append(damage)


def read_capture(path: Path | str, *, from_utc_ns: int | None = None, only: Collection[str] | None = None) -> Capture:
    """The records of a session file, or of a folder with a session.mcap, with all its segments.

    With ``from_utc_ns``, compressed chunks that end before it are skipped without being unpacked; single earlier
    messages may still come. ``only`` names the topics whose messages are wanted. CaptureError where there is no file,
    or none of ours.
    """
    path = session_file(Path(path))
    with FileWindow(path) as window:
        RecordScanner(window, path.name).check_ours()
    return Capture(path, from_utc_ns=from_utc_ns, only=only)


def one_file(path: Path) -> Capture:
    """The records of one file alone, its mentions of the segments before and after it included."""
    return Capture(path, alone=True)


def session_file(path: Path) -> Path:
    """The first segment of the session that a path names: a file, or a folder with a session.mcap."""
    if path.is_dir():
        folder, path = path, path / "session.mcap"
        if not path.exists() and (folder / "report.json").exists():
            raise CaptureError(f"{folder} holds a report and no session; give the session that it was made from")
    if not path.exists():
        raise CaptureError(f"there is no session {path}; a session is a .mcap file or the folder that 'gse run' made")
    return path


def segment_path(first: Path, number: int) -> Path:
    """The path of a segment, counted from 1: session.mcap, session.part2.mcap, session.part3.mcap ..."""
    return first if number == 1 else first.with_name(f"{first.stem}.part{number}{first.suffix}")


def segment_files(first: Path) -> list[Path]:
    """The files beside a session that have the names of its segments, in order, with itself."""
    return [path for _, path in _numbered(first)]


def _numbered(first: Path) -> list[tuple[int, Path]]:
    pattern = re.compile(re.escape(first.stem) + r"\.part([1-9]\d{0,3})" + re.escape(first.suffix))
    found = {1: first}
    for path in first.parent.iterdir():
        if match := pattern.fullmatch(path.name):
            found[int(match[1])] = path
    return sorted(found.items())


def messages(path: Path | str, topic: str) -> Iterator[RecordedMessage]:
    """The messages of one topic of a session."""
    return (record for record in read_capture(path, only=(topic,)) if isinstance(record, RecordedMessage))


# Whether a session is whole: every file of it, to the bit.

_BLOCK_BYTES = 1 << 20
_FOOTER_BYTES_IN_CRC = 9 + 16
"""The CRC of the summary covers the footer up to the CRC itself, MCAP specification, section Footer."""


@dataclass(slots=True)
class FileCheck:
    """Result for one file of a session; the first damaged places and attachments are listed, all are counted.

    ``closed``: it has its proper end. ``checksums`` is False where the whole-file checksums of a closed file do not
    agree although no record was found damaged: then an index or a length was, and no data.
    """

    name: str
    size: int
    closed: bool = False
    checksums: bool = True
    messages: Counter[str] = field(default_factory=Counter)
    rx_bytes: int = 0
    tx_bytes: int = 0
    attachments: list[str] = field(default_factory=list)
    damages: list[Damage] = field(default_factory=list)
    damage_count: int = 0
    damaged_bytes: int = 0
    first_ns: int | None = None
    last_ns: int | None = None

    @property
    def is_whole(self) -> bool:
        """Whether nothing at all is wrong with it."""
        return self.closed and self.checksums and not self.damage_count


@dataclass(frozen=True, slots=True)
class SessionCheck:
    """Result for a session: its files, the names of missing files, sentences on files that are no part of it."""

    files: tuple[FileCheck, ...]
    missing: tuple[str, ...]
    foreign: tuple[str, ...]

    @property
    def is_whole(self) -> bool:
        """Whether nothing at all is wrong with it."""
        return not self.missing and not self.foreign and all(file.is_whole for file in self.files)

    @property
    def damaged_bytes(self) -> int:
        """Bytes of the files outside intact records."""
        return sum(file.damaged_bytes for file in self.files)


def verify(path: Path) -> SessionCheck:
    """Read every byte of a session; CaptureError where there is none."""
    first = session_file(path)
    with FileWindow(first) as window:
        RecordScanner(window, first.name).check_ours()
    chain = SegmentChain(first)
    files = tuple(_check(segment, chain) for segment in chain.segments())
    return SessionCheck(files, tuple(chain.missing), tuple(chain.foreign))


def _check(path: Path, chain: SegmentChain) -> FileCheck:
    end = None
    with FileWindow(path) as window:
        check = FileCheck(path.name, window.size)
        walk = RecordScanner(window, path.name)
        for record in walk.records():
            if isinstance(record, Damage):
                _count_damage(check, record)
            elif isinstance(record, Attachment):
                check.attachments += [record.name] if len(check.attachments) < MOST_ATTACHMENTS else []
            else:
                end = record if record.topic == CONTINUED else end
                _count(check, record)
        check.closed = walk.ended
        if walk.ended:
            check.checksums = _checksums_agree(window, walk)
    chain.was_read(walk, end, damaged=check.damage_count > 0)
    return check


def _count_damage(check: FileCheck, damage: Damage) -> None:
    check.damage_count += 1
    check.damaged_bytes += damage.size
    if len(check.damages) < MAX_DAMAGES_KEPT:
        check.damages.append(damage)


def _count(check: FileCheck, message: RecordedMessage) -> None:
    check.messages[message.topic] += 1
    check.rx_bytes += len(message.data) if message.topic == RX else 0
    check.tx_bytes += len(message.data) if message.topic == TX else 0
    if message.topic in (RX, TX):
        check.first_ns = min(check.first_ns or message.utc_ns, message.utc_ns)
        check.last_ns = max(check.last_ns or message.utc_ns, message.utc_ns)


def _checksums_agree(window: FileWindow, walk: RecordScanner) -> bool:
    if walk.data_end is None or walk.footer is None:
        return False
    data_end, data_crc = walk.data_end
    footer, summary_start, summary_crc = walk.footer
    if data_crc == 0 or not 0 < summary_start <= footer:
        return False
    summary_end = footer + _FOOTER_BYTES_IN_CRC
    return _crc(window, 0, data_end) == data_crc and _crc(window, summary_start, summary_end) == summary_crc


def _crc(window: FileWindow, start: int, end: int) -> int:
    crc = 0
    for offset in range(start, end, _BLOCK_BYTES):
        crc = zlib.crc32(window.get(offset, min(_BLOCK_BYTES, end - offset)), crc)
    return crc
