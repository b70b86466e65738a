"""Recorded answers of an external identifier: written with a live session, judged in its replay.

A replay never starts a program that a session names; it judges what the program answered then, its time-outs too. The
answers are read in step with the panoramas, so that eight hours of them take no memory.
"""

import json
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from drivers.outside_text import plain_line
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RecordedMessage
from gse.external.answers import ExternalAnswer, Failure, FailureKind, parse_answer
from gse.external.identifier import Given
from gse.recording.session_format import ANSWER_TOPIC
from gse.values.panorama import Panorama

_SEARCH_AHEAD = 1000
"""Most answers without their panorama between two panoramas."""
_MOST_TEXT = 300


def recorded_json(panorama: Panorama, given: Given) -> bytes:
    """The message of /gse/answer for one panorama."""
    answer = given.answer
    document: dict[str, Any] = {"time_us": panorama.time_us, "own_time": given.has_own_time}
    if isinstance(answer, Failure):
        document |= {"frame_no": panorama.frame_no, "failure": answer.kind.value, "detail": answer.detail}
    else:
        document["answer"] = answer.document
    return json.dumps(document, separators=(",", ":")).encode()


class RecordedAnswers:
    """The answers that a session recorded, in the order of its panoramas; ``identity`` is what it says of the program.

    Times are those of the session, so these answers have none.
    """

    def __init__(self, path: Path, identity: dict[str, Any]) -> None:
        self.identity = identity
        self._messages = (
            record
            for record in read_capture(path, only=(ANSWER_TOPIC,))
            if isinstance(record, RecordedMessage) and record.topic == ANSWER_TOPIC
        )
        self._ahead: deque[dict[str, Any]] = deque()

    def answers(self, panoramas: Sequence[Panorama]) -> list[Given]:
        """What was given for each panorama, in order."""
        return [self._given(panorama) for panorama in panoramas]

    def _given(self, panorama: Panorama) -> Given:
        for place, document in enumerate(self._documents()):
            if document.get("time_us") == panorama.time_us:
                for _ in range(place + 1):
                    self._ahead.popleft()
                return _read(document, panorama)
        return Given(Failure(FailureKind.NOT_RECORDED, "the session has no answer to this panorama"))

    def _documents(self) -> Iterator[dict[str, Any]]:
        """The next answers, read as far as they are looked at."""
        place = 0
        while place < _SEARCH_AHEAD:
            if place == len(self._ahead):
                message = next(self._messages, None)
                if message is None:
                    return
                self._ahead.append(_document(message))
            yield self._ahead[place]
            place += 1

    def take_log(self) -> bytes:
        """Nothing: no program runs."""
        return b""

    def close(self) -> None:
        """Nothing to end."""


def read_identity(text: str | None) -> dict[str, Any]:
    """What a session says of the program, its known keys as plain text; nothing where it cannot be read."""
    keys = ("plug", "name", "version", "program_sha256", "config_sha256")
    try:
        document = json.loads(text or "{}")
        given = {key: document.get(key) for key in keys}
    except (ValueError, AttributeError, RecursionError):
        given = dict.fromkeys(keys)
    return {key: None if value is None else plain_line(str(value))[:_MOST_TEXT] for key, value in given.items()}


def _document(message: RecordedMessage) -> dict[str, Any]:
    try:
        document = json.loads(message.data)
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def _read(document: dict[str, Any], panorama: Panorama) -> Given:
    own = bool(document.get("own_time"))
    if "failure" in document:
        kinds = {kind.value: kind for kind in FailureKind}
        kind = kinds.get(str(document["failure"]), FailureKind.NONSENSE)
        return Given(Failure(kind, plain_line(str(document.get("detail", "")))[:_MOST_TEXT]))
    answer: ExternalAnswer | Failure = Failure(FailureKind.NONSENSE, "the session's record of an answer is damaged")
    if isinstance(document.get("answer"), dict):
        answer = parse_answer(document["answer"], panorama.frame_no, len(panorama.brightness))
    return Given(answer, None, own)
