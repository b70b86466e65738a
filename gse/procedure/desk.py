"""The operator's desk: one question at a time, answered in the terminal, on the page, by a note or from a file.

Whoever answers first counts. The terminal is read by a thread, since a line may never come; the page and ``gse note``
leave their answers among the notes of the session, which begin with ANSWER.
"""

import getpass
import queue
import re
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import yaml

from drivers.outside_text import plain_line
from gse.errors import UsageError
from protocols.yaml_text import load_document

ANSWER = "answer:"
"""A note that begins with this answers the step that waits for the operator."""
STOPS = ("n", "no", "not done", "stop", "abort", "cancel")
"""Answers to what one is told that mean: this cannot be done."""
_NOTE = re.compile(r"\s*(?:([\d.]+):)?\s*(.*)", re.DOTALL)
_MOST_ANSWERS_BYTES = 100_000
_MOST_WAITING = 20


@dataclass(frozen=True, slots=True)
class Question:
    """What a step wants of the operator: ``label`` is the key of its answer in a file, ``expect`` its pattern."""

    number: str
    label: str
    text: str
    expect: str | None = None
    confirms: bool = False

    def shown(self, problem: str = "") -> str:
        """The question with what may be answered, and the ``problem`` of the answer before."""
        how = "Enter when it is done, no if it cannot be" if self.confirms else "type the answer"
        return f"step {self.number}: {self.text} [{f'{problem}; ' if problem else ''}{how}]"

    def problem(self, answer: str) -> str:
        """Why an answer does not do; empty where it does."""
        if self.confirms or (self.expect is None and answer):
            return ""
        if self.expect is not None and re.fullmatch(self.expect, answer):
            return ""
        return f"{answer!r:.60} does not do: expected {self.expect or 'an answer'}"


class Desk:
    """Asks the operator: ``show`` is given a question, empty when it is answered; ``page``: a page can answer, too.

    ``look`` takes the notes of the session, also while the time of a simulation stands still for the answer.
    """

    def __init__(
        self,
        *,
        name: str = "",
        terminal: TextIO | None = None,
        page: bool = False,
        answers: Mapping[str, str] | None = None,
    ) -> None:
        self.name = name or _login_name()
        self._page, self._answers = page, answers
        self.show: Callable[[str], None] = lambda text: None
        self.look: Callable[[], None] = lambda: None
        self._given: queue.Queue[tuple[str, str]] = queue.Queue(_MOST_WAITING)
        self._terminal = terminal
        self._reading: threading.Thread | None = None
        self.shown = ""
        self._asks: Question | None = None

    def can_answer(self, question: Question) -> bool:
        """Whether anybody or anything could answer."""
        return self._terminal is not None or self._page or self._from_file(question) is not None

    def ask(self, question: Question, problem: str = "") -> None:
        """Show a question, and the ``problem`` of its answer so far; answers to an earlier one are forgotten."""
        while not self._given.empty():
            self._given.get_nowait()
        if (answer := self._from_file(question)) is not None:
            self._given.put_nowait((answer, "answers file"))
            return
        self.shown, self._asks = question.shown(problem), question
        self.show(self.shown)
        if self._terminal is not None and self._reading is None:
            self._reading = threading.Thread(target=self._read, name="operator", daemon=True)
            self._reading.start()

    def take(self, wait_s: float = 0.0) -> tuple[str, str] | None:
        """The answer, and who gave it; None while there is none."""
        self.look()
        try:
            return self._given.get(timeout=wait_s) if wait_s else self._given.get_nowait()
        except queue.Empty:
            return None

    def answered(self) -> None:
        """The question is answered, or is not asked any more."""
        if self.shown:
            self.shown, self._asks = "", None
            self.show("")

    def put(self, answer: str, by: str) -> None:
        """Take an answer from elsewhere; one too many is dropped."""
        if not self._given.full():
            self._given.put_nowait((plain_line(" ".join(answer.split())), by))

    def put_note(self, note: str) -> None:
        """Take a note that begins with ANSWER; one to another step than that which asks is dropped."""
        found = _NOTE.match(note.removeprefix(ANSWER))
        assert found is not None  # all of it may be empty
        if self._asks is not None and found[1] in (None, self._asks.number):
            self.put(found[2], "by the page or a note")

    def _from_file(self, question: Question) -> str | None:
        if self._answers is None:
            return None
        return self._answers.get(question.label, self._answers.get(question.number))

    def _read(self) -> None:
        """Lines of the terminal, for as long as there are any."""
        assert self._terminal is not None
        for line in self._terminal:
            self.put(line, self.name)


def _login_name() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return "operator"


def terminal_of_operator() -> TextIO | None:
    """The terminal where somebody can answer; None in a job without one."""
    try:
        return sys.stdin if sys.stdin is not None and sys.stdin.isatty() else None
    except ValueError:  # it was closed
        return None


def read_answers(path: Path) -> dict[str, str]:
    """The answers of a YAML file: the label of a question, or the number of a step, with its answer; UsageError."""
    expected = "expected lines such as: serial: SN 12, and 1: done for step 1"
    try:
        with path.open(encoding="utf-8") as file:
            _, document = load_document(file.read(_MOST_ANSWERS_BYTES))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = getattr(error, "strerror", None) or getattr(error, "problem", None) or "it is not UTF-8 text"
        raise UsageError(f"--answers {path}: {reason}; {expected}") from error
    if not isinstance(document, dict):
        raise UsageError(f"--answers {path}: {expected}")
    return {str(key): _answer(value) for key, value in document.items()}


def _answer(value: Any) -> str:
    return "done" if value is True else "no" if value is False else plain_line(" ".join(str(value).split()))
