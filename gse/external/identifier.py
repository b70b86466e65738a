"""The external identifier under test: many panoramas in, one answer or failure for each out.

A failure costs its panorama: the first that is not answered. The program is then started anew, and the panoramas after
it are sent again. One that fails too often in a row is given up, so that a session with a broken program ends.
"""

import json
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.outside_text import plain_line
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RecordedMessage
from gse.catalog import StarCatalog
from gse.external.answers import ExternalAnswer, Failure, FailureKind, parse_answer
from gse.external.child import Child, Log, Reply
from gse.external.plugs import MOST_AHEAD, Plug, start_failure
from gse.recording.session_format import ANSWER_TOPIC
from gse.values.panorama import Panorama

MOST_FAILURES_IN_A_ROW = 100
START_S = 10.0
"""Added to the time of the first answer after a start: a program reads its catalogue then."""
MOST_SILENT_STARTS = 5
"""Starts in a row without an answer within their time, a minute of a session in all: the program will not answer."""
MOST_LOG_BYTES = 1 << 20
"""Most bytes that are kept of what a program writes to stderr in a session."""


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What an external identifier gave for a panorama, and the time for it in microseconds.

    ``has_own_time`` where the time is that of the identifier's own clock, and not of this host.
    """

    answer: ExternalAnswer | Failure
    elapsed_us: float | None = None
    has_own_time: bool = False


@dataclass(slots=True)
class ExternalCounts:
    """Panoramas by what was given for them; ``own_times`` of the answers state a time by their own clock.

    ``stars_named`` counts the stars that answers name, ``stars_unknown`` those of them that no catalogue has.
    """

    answers: int = 0
    own_times: int = 0
    stars_named: int = 0
    stars_unknown: int = 0
    failures: Counter[str] = field(default_factory=Counter)

    def count(self, given: Given, known_stars: int) -> None:
        """Count what was given for one panorama; the catalogue has so many of the stars that it names."""
        if isinstance(given.answer, Failure):
            self.failures[given.answer.kind.value] += 1
        else:
            self.answers += 1
            self.own_times += given.has_own_time
            self.stars_named += given.answer.stars_named
            self.stars_unknown += max(given.answer.stars_named - known_stars, 0)


class AnswerSource(Protocol):
    """A source of answers: the program itself, or a session that recorded them."""

    @property
    def identity(self) -> dict[str, Any]:
        """Name, version and hashes, schema gse.identifier/1."""
        ...

    def answers(self, panoramas: Sequence[Panorama]) -> list[Given]:
        """What is given for each panorama, in order."""
        ...

    def take_log(self) -> bytes:
        """What the program wrote to stderr since the last call."""
        ...

    def close(self) -> None:
        """End the program."""
        ...


class RunningIdentifier:
    """A program that answers; started at once, and again after each failure.

    ``timeout_s`` is the time for one panorama, ``start_s`` the time to start beside it.
    """

    def __init__(self, plug: Plug, timeout_s: float, start_s: float = START_S) -> None:
        self._plug, self._timeout_s, self._start_s = plug, timeout_s, start_s
        self._log = Log(MOST_LOG_BYTES)
        self._failures_in_a_row = 0
        self._child: Child | None = None

    @property
    def identity(self) -> dict[str, Any]:
        """Name, version and hashes, schema gse.identifier/1."""
        return self._plug.identity.document()

    def answers(self, panoramas: Sequence[Panorama]) -> list[Given]:
        """What is given for each panorama, in order."""
        found: list[Given] = []
        while len(found) < len(panoramas):
            found += self._some(panoramas[len(found) : len(found) + MOST_AHEAD])
        return found

    def _some(self, panoramas: Sequence[Panorama]) -> list[Given]:
        """What is given for the first of these, up to the first failure that ends the program."""
        if self._failures_in_a_row >= MOST_FAILURES_IN_A_ROW:
            text = "it failed too often in a row and is not started again"
            return [Given(Failure(FailureKind.GIVEN_UP, text)) for _ in panoramas]
        requests = self._plug.requests(panoramas)
        first_s, starts = self._timeout_s, self._child is None
        if self._child is None:
            try:
                self._child = self._plug.start(self._log)
            except OSError as error:
                return self._ended([], Failure(FailureKind.START, f"it {start_failure(error)}"))
            requests.insert(0, self._plug.greeting)
            first_s += self._start_s
        replies, failure = self._child.exchange(
            requests, self._plug.split, len(panoramas), first_s=first_s, each_s=self._timeout_s
        )
        if starts and failure is not None and failure.kind is FailureKind.TIMEOUT and not replies:
            self._failures_in_a_row += MOST_FAILURES_IN_A_ROW // MOST_SILENT_STARTS - 1
        if starts and replies:  # the time of its start is not that of an identification
            replies[0] = Reply(replies[0].data, None)
        return self._read(panoramas, replies, failure)

    def _read(self, panoramas: Sequence[Panorama], replies: list[Reply], failure: Failure | None) -> list[Given]:
        found: list[Given] = []
        for panorama, reply in zip(panoramas, replies, strict=False):
            answer = self._plug.read(reply.data, panorama)
            if isinstance(answer, Failure) and not answer.in_step:
                return self._ended(found, answer)
            self._failures_in_a_row = 0
            found.append(_given(answer, reply))
        return self._ended(found, failure) if failure else found

    def _ended(self, found: list[Given], failure: Failure) -> list[Given]:
        """The answers so far, and the failure that ended the program."""
        self._failures_in_a_row += 1
        self.close()
        return [*found, Given(failure)]

    def take_log(self) -> bytes:
        """What the program wrote to stderr since the last call."""
        return self._log.take()

    def close(self) -> None:
        """End the program."""
        if self._child is not None:
            self._child.close()
            self._child = None


def _given(answer: ExternalAnswer | Failure, reply: Reply) -> Given:
    """The answer with its time: its own, otherwise that of the call, otherwise that of the reply."""
    if isinstance(answer, Failure):
        return Given(answer, reply.elapsed_us)
    if answer.elapsed_us is not None:
        return Given(answer, answer.elapsed_us, has_own_time=True)
    is_first = reply.elapsed_us is None
    return Given(answer, reply.elapsed_us if is_first or answer.call_us is None else answer.call_us)


HANGS_S = 10.0
"""A program that is evaluated, not used live, is waited for so long: a busy computer is no fault of it."""


def evaluated(plug: Plug, timeout_s: float) -> RunningIdentifier:
    """A program whose answers are taken late, to be judged by ``in_time``."""
    return RunningIdentifier(plug, max(timeout_s, HANGS_S))


def in_time(given: Given, timeout_s: float) -> Given:
    """What was given, or a failure where its time, the program's own if it states one, is over the limit."""
    if given.elapsed_us is None or given.elapsed_us <= 1e6 * timeout_s or isinstance(given.answer, Failure):
        return given
    whose = "it states" if given.has_own_time else "it took"
    text = f"{whose} {given.elapsed_us / 1000:.4g} ms; {1000 * timeout_s:g} ms are allowed"
    return replace(given, answer=Failure(FailureKind.TIMEOUT, text))


class ExternalIdentifier:
    """The external identifier as the subject of a session; ``catalog`` has the stars that its answers may name."""

    name = "external"

    def __init__(self, catalog: StarCatalog, source: AnswerSource) -> None:
        self.catalog, self.source = catalog, source
        self._order = np.argsort(catalog.ids, kind="stable")

    def rows_of(self, star_ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Catalogue rows (M,) of star numbers (M,); -1 of a number that is not in the catalogue."""
        place = np.searchsorted(self.catalog.ids, star_ids, sorter=self._order)
        rows = self._order[np.minimum(place, len(self._order) - 1)]
        return np.where(self.catalog.ids[rows] == star_ids, rows, -1)


# Recorded answers of an external identifier: written with a live session, judged in its replay.
#
# A replay never starts a program that a session names; it judges what the program answered then, its time-outs too. The
# answers are read in step with the panoramas, so that eight hours of them take no memory.

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
