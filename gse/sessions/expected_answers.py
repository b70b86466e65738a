"""Answers that a replay is expected to give: bit-true replay of flight software.

The file has a line of JSON for each panorama, schema gse.answer/1 (what the flight computer answered) or gse.frame/1
(what ``gse replay --json-frames`` printed). Compared are RA, DE, roll where a line has it, or the quaternion, and the
status of gse.frame/1: to the last bit for gse.answer/1, to the printed decimals for gse.frame/1. Where no frame has an
answer on either side, nothing was shown: that is not agreement.
"""

import json
import math
from collections import defaultdict, deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drivers.chunk import LinkEvent
from gse.count_text import count_text
from gse.errors import TableError
from gse.external.answers import NO_ANSWER, ExternalAnswer
from gse.station.frame_json import SCHEMA, frame_json
from gse.station.frame_results import NewResults
from gse.station.results import FrameResult
from gse.station.session_data import SessionData

MOST_BYTES = 500_000_000
"""Eight hours of answers at 10 Hz take 60 MB, with their matches 300 MB."""
LONGEST_LINE = 100_000
"""An answer with the matches of 30 objects takes 4 kB."""

MOST_LISTED = 10
_ANGLES = ("ra_deg", "de_deg", "roll_deg")
_QUATERNION = ("quaternion", "order", "maps")


class Comparison:
    """A listener that compares each result with the expected answer to its frame.

    ``compared`` frames had one, ``different`` of them were answered otherwise, ``missing`` frames had none; in
    ``answered`` of those compared there is an attitude on either side. ``listed`` says of the first differences what
    they are.
    """

    def __init__(self) -> None:
        self.compared = self.answered = self.different = self.missing = 0
        self.listed: list[str] = []

    def on_results(self, results: NewResults, session: SessionData) -> None:
        """Compare results."""
        for result in results:
            self.compare(result, session)

    def compare(self, result: FrameResult, session: SessionData) -> None:
        """Compare a result."""
        raise NotImplementedError

    def on_event(self, event: LinkEvent) -> None:
        """Nothing: events are not compared."""

    def finish(self, session: SessionData) -> None:
        """Compare what came after the last result; nothing, where that cannot be."""

    @property
    def unused(self) -> int:
        """Expected answers without a frame in the replay."""
        raise NotImplementedError

    @property
    def is_same(self) -> bool:
        """Whether all frames were answered as expected, and all expected answers were given."""
        return not (self.different or self.missing or self.unused)

    @property
    def shows_nothing(self) -> bool:
        """Whether nothing differs only because there was no answer to compare."""
        return self.is_same and self.answered == 0

    def note(self, frame_no: int, differences: Sequence[str], *, answered: bool) -> None:
        """Count a frame that was compared, and list how its answer differs."""
        self.compared += 1
        self.answered += answered
        if differences:
            self.different += 1
            if len(self.listed) < MOST_LISTED:
                self.listed.append(f"frame {frame_no}: {'; '.join(differences)}")

    def text(self) -> str:
        """The result in one line, and the first differences."""
        head = f"{self.different} of {self.compared} answers differ from the expected ones"
        without = self.compared - self.answered
        head += f"; {without} of them are no answer on both sides" if without else ""
        head += f"; {count_text(self.missing, 'frame')} without an expected answer" if self.missing else ""
        head += f"; {self.unused} expected answers without a frame" if self.unused else ""
        return "\n".join([head, *(f"  {line}" for line in self.listed)])


class ExpectedAnswers(Comparison):
    """The expected answers of a file; TableError where it is damaged."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._answers = _read(path)

    @property
    def unused(self) -> int:
        """Expected answers without a frame in the replay."""
        return sum(map(len, self._answers.values()))

    def compare(self, result: FrameResult, session: SessionData) -> None:
        """Compare a result with the next expected answer to its frame number."""
        waiting = self._answers.get(result.panorama.frame_no)
        if not waiting:
            self.missing += 1
            return
        expected = waiting.popleft()
        given = frame_json(result) if expected.get("schema") == SCHEMA else _exact(result)
        wrong = [key for key in _compared_keys(expected) if expected.get(key) != given.get(key)]
        self.note(
            result.panorama.frame_no,
            [f"{key} is {given.get(key)!r}, expected {expected.get(key)!r}" for key in wrong],
            answered=any(side.get(key) is not None for side in (expected, given) for key in ("ra_deg", "quaternion")),
        )


def _compared_keys(expected: dict[str, Any]) -> tuple[str, ...]:
    if "quaternion" in expected:
        return _QUATERNION
    angles = _ANGLES if "roll_deg" in expected else _ANGLES[:2]
    return (*_ANGLES, "status") if expected.get("schema") == SCHEMA else angles


def _exact(result: FrameResult) -> dict[str, Any]:
    """The answer to the last bit: as an external identifier wrote it, else the angles of the attitude."""
    if result.attitude is None:
        return {}
    angles = {key: getattr(result.attitude, key) for key in _ANGLES}
    if result.given is None or not isinstance(result.given.answer, ExternalAnswer):
        return angles
    document = result.given.answer.document
    return angles | document if "quaternion" in document else document


def _read(path: Path) -> dict[int, deque[dict[str, Any]]]:
    found: dict[int, deque[dict[str, Any]]] = defaultdict(deque)
    if path.exists() and not path.is_file():
        raise TableError(f"{path} is not a file; expected answers as lines of JSON")
    try:
        if path.stat().st_size > MOST_BYTES:
            raise TableError(f"{path} is larger than {MOST_BYTES} bytes; expected answers as lines of JSON")
        with path.open(encoding="utf-8") as file:
            for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE + 1), ""), 1):
                if len(line) > LONGEST_LINE:
                    raise TableError(f"{path}, line {number} is longer than {LONGEST_LINE} characters")
                if line.strip():
                    document = _line(path, number, line)
                    found[document["frame_no"]].append(document)
    except OSError as error:
        raise TableError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise TableError(f"{path} is not UTF-8 text: expected answers as lines of JSON") from error
    if not found:
        raise TableError(f"{path} has no answer: expected a line of JSON for each frame")
    return found


def _line(path: Path, number: int, line: str) -> dict[str, Any]:
    try:
        document = json.loads(line)
        frame_no = document["frame_no"]
    except (ValueError, KeyError, TypeError, RecursionError):
        frame_no = None
    if not isinstance(frame_no, int):
        raise TableError(f"{path}, line {number}: expected an answer as JSON with frame_no, ra_deg and de_deg")
    keys = ("schema", "frame_no", "status", *(() if document.get("status") in NO_ANSWER else (*_ANGLES, *_QUATERNION)))
    answer = {key: document[key] for key in keys if document.get(key) is not None}
    for key in (*_ANGLES, "quaternion"):
        numbers = answer.get(key, 0.0)
        if not all(map(_is_finite, numbers if key == "quaternion" and isinstance(numbers, list) else [numbers])):
            raise TableError(f"{path}, line {number}: {key} is {numbers!r:.60}: expected numbers, or no answer")
    return answer


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < math.inf
