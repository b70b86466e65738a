"""Session files: MCAP to records, whatever was done to the file.

Every record is checked before it is given (messages by the CRC in ``sequence``, chunks and attachments by MCAP's own)
and after a damaged one the reader looks for the next that is whole. A file that was cut, or is still being written,
gives all its whole records. Memory is bounded by the largest record that is believed.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from itertools import chain
from pathlib import Path

from drivers.errors import CaptureError
from drivers.session_file.file_window import FileWindow
from drivers.session_file.record_scanner import RecordScanner
from drivers.session_file.records import CONTINUED, Damage, Record, RecordedMessage

MOST_ATTACHMENTS = 1000
"""Names kept to give each file frozen into the segments once."""
MAX_DAMAGES_KEPT = 100
"""Damages listed one by one; all are counted."""


class Capture:
    """A session, read once from front to end: iterate over it.

    While it goes, and when it is over, ``truncated`` tells whether the end is missing, ``damages`` lists the first
    damaged places, ``damage_count`` and ``damaged_bytes`` count all of them, ``missing`` names segments that should be
    there, ``segments`` those that are.
    """

    def __init__(
        self,
        segments: list[Path],
        missing: list[str],
        *,
        from_utc_ns: int | None = None,
        only: Collection[str] | None = None,
        alone: bool = False,
    ) -> None:
        self.segments = segments
        self.missing = missing
        self.truncated = False
        self.damages: list[Damage] = []
        self.damage_count = 0
        self.damaged_bytes = 0
        self._from_utc_ns = from_utc_ns
        self._only = None if only is None else frozenset(only)
        self._alone = alone
        self._parts = self._read()
        self._records = chain.from_iterable(self._parts)

    def __iter__(self) -> Iterator[Record]:
        return self._records

    def __next__(self) -> Record:
        return next(self._records)

    def parts(self) -> Iterator[Sequence[Record]]:
        """The records in parts, those of a chunk of the file together: to be read instead of the records."""
        return self._parts

    @property
    def is_damaged(self) -> bool:
        """Whether something is missing of what was read so far."""
        return self.truncated or self.damage_count > 0

    def _read(self) -> Iterator[Sequence[Record]]:
        attached: set[str] = set()
        searched = None if self._only is None else {*self._only, CONTINUED}
        for segment in self.segments:
            continued = False
            with FileWindow(segment) as window:
                walk = RecordScanner(window, segment.name, from_utc_ns=self._from_utc_ns, only=searched)
                for part in walk.parts():
                    kinds = {record.topic if isinstance(record, RecordedMessage) else None for record in part}
                    continued |= CONTINUED in kinds
                    is_plain = kinds <= self._only if self._only is not None else kinds.isdisjoint((None, CONTINUED))
                    yield part if is_plain else [record for record in part if self._gives(record, attached)]
            self.truncated |= not walk.ended
            if continued and segment == self.segments[-1] and not self._alone:
                self.missing.append(f"what follows {segment.name}")
        self.truncated |= bool(self.missing)

    def _gives(self, record: Record, attached: set[str]) -> bool:
        """Whether a record is for the reader: a wanted message, damage, which is counted, or a new attachment."""
        if isinstance(record, RecordedMessage):
            return self._alone if record.topic == CONTINUED else self._only is None or record.topic in self._only
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
    return Capture(*find_segments(path), from_utc_ns=from_utc_ns, only=only)


def one_file(path: Path) -> Capture:
    """The records of one file alone, its mention of a successor included."""
    return Capture([path], [], alone=True)


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


def find_segments(first: Path) -> tuple[list[Path], list[str]]:
    """The segments of a session that are there, in order, and the names of those missing between them."""
    pattern = re.compile(re.escape(first.stem) + r"\.part([1-9]\d{0,3})" + re.escape(first.suffix))
    found = {1: first}
    for path in first.parent.iterdir():
        if match := pattern.fullmatch(path.name):
            found[int(match[1])] = path
    missing = [segment_path(first, number).name for number in range(1, max(found)) if number not in found]
    return [found[number] for number in sorted(found)], missing


def messages(path: Path | str, topic: str) -> Iterator[RecordedMessage]:
    """The messages of one topic of a session."""
    return (record for record in read_capture(path, only=(topic,)) if isinstance(record, RecordedMessage))
