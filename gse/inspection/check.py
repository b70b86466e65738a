"""A check before a session: what was looked at, what came out, what to do."""

from dataclasses import dataclass
from enum import StrEnum


class Outcome(StrEnum):
    """Result of a check."""

    OK = "OK"
    WARN = "WARN"
    FAIL = "FAIL"


@dataclass(frozen=True, slots=True)
class Check:
    """One check: its subject, its result, and advice."""

    name: str
    outcome: Outcome
    text: str
    advice: str = ""
