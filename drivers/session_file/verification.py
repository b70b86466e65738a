"""Whether a session is whole: every file of it, to the bit."""

import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from drivers.session_file.reader import MAX_DAMAGES_KEPT, MOST_ATTACHMENTS, SegmentChain, session_file
from drivers.session_file.record_scanner import FileWindow, RecordScanner
from drivers.session_file.records import CONTINUED, RX, TX, Attachment, Damage, RecordedMessage

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
