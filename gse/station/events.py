"""Events of a session: their kinds, what some of them carry, the log of the first of each kind, notes of the operator.

A note comes from the glance page or from ``gse note``; the loop fetches it and makes it an event NOTE, or MOUNT_TOUCHED
where it says that the mount was touched. Both sides only append to and take from a bounded queue: neither waits for the
other.
"""

import queue
from collections import Counter
from dataclasses import dataclass, replace
from enum import StrEnum

from drivers.chunk import LinkEvent, LinkKind
from gse.recording.session_format import MOST_KINDS, OTHER
from gse.values.instant import LAST_NS

# Kinds of events of the station.


class StationKind(StrEnum):
    """Events of the processing, of truth, of the host and of the sky."""

    SENSOR_RESET = "SENSOR_RESET"
    OTHER_SENSOR = "OTHER_SENSOR"
    SEQUENCE_CHAOS = "SEQUENCE_CHAOS"
    TEST_STREAM = "TEST_STREAM"
    CLOCK_STEP = "CLOCK_STEP"
    MIRRORED = "MIRRORED"
    WRONG_CAMERA = "WRONG_CAMERA"
    WRONG_DETECTOR = "WRONG_DETECTOR"
    IDENTIFIER_FAULT = "IDENTIFIER_FAULT"
    IDENTIFIER_GIVEN_UP = "IDENTIFIER_GIVEN_UP"
    ALIGNED = "ALIGNED"
    NO_TRUTH = "NO_TRUTH"
    EARTH_ORIENTATION = "EARTH_ORIENTATION"
    NO_STATION = "NO_STATION"
    OLD_STATION = "OLD_STATION"
    FROZEN = "FROZEN"
    ITEM_RED = "ITEM_RED"
    ITEM_BACK = "ITEM_BACK"
    UNANSWERED = "UNANSWERED"
    SECOND_MASTER = "SECOND_MASTER"
    SEARCH_THINNED = "SEARCH_THINNED"
    SENSOR_CLOCK = "SENSOR_CLOCK"
    TRANSLATED = "TRANSLATED"
    CLEAR = "CLEAR"
    CLOUDED = "CLOUDED"
    NO_STARS = "NO_STARS"
    DAYLIGHT = "DAYLIGHT"
    DARK_NIGHT = "DARK_NIGHT"
    FINDING = "FINDING"
    CLOSED = "CLOSED"
    TERMINAL_LOST = "TERMINAL_LOST"
    TERMINAL_STUCK = "TERMINAL_STUCK"
    NOTE = "NOTE"
    SCREEN_SHOWS = "SCREEN_SHOWS"
    SCREEN_LOST = "SCREEN_LOST"
    SCREEN_LATE = "SCREEN_LATE"
    MOUNT_TOUCHED = "MOUNT_TOUCHED"
    POWER_ON = "POWER_ON"
    POWER_OFF = "POWER_OFF"
    POWER_SAID = "POWER_SAID"
    POWER_FAILED = "POWER_FAILED"
    PROCEDURE = "PROCEDURE"
    STEP_BEGUN = "STEP_BEGUN"
    STEP_DONE = "STEP_DONE"
    PROCEDURE_ENDED = "PROCEDURE_ENDED"


LINK_WORDS: dict[str, str] = {
    LinkKind.NO_PORT: "no port",
    LinkKind.LOST: "no port",
    LinkKind.OPENED: "waiting",
    LinkKind.REOPENED: "waiting",
    LinkKind.WAITING: "waiting",
    LinkKind.SYNCING: "syncing",
    LinkKind.STREAMING: "streaming",
    LinkKind.STALE: "silent",
    StationKind.CLOSED: "closed",
}
"""The state of the link after each kind of event that changes it; the other kinds are only logged."""

SKY_WORDS: dict[str, str] = {
    StationKind.CLEAR: "clear",
    StationKind.CLOUDED: "clouded",
    StationKind.NO_STARS: "no stars",
    StationKind.DAYLIGHT: "daylight",
    StationKind.DARK_NIGHT: "dark night",
}
"""The sky after each kind of event that changes it."""


@dataclass(frozen=True, slots=True)
class ClockStep(LinkEvent):
    """A step of the host's UTC clock against its monotonic one; ``step_ns`` is positive where UTC went forward.

    ``utc_kept`` where the sensor's clock went along with UTC: the monotonic clock stood still, or leapt.
    """

    step_ns: int
    utc_kept: bool = False


@dataclass(frozen=True, slots=True)
class Finding:
    """One cause of what a session shows, for the operator.

    The limits decide, not a finding; a mistake of the set-up may excuse what they say.

    ``cause`` is the head word, the same for all sizes (docs/troubleshooting.md has an entry for each). ``size`` says it
    in the unit that an operator turns, ``equals`` are causes that the session cannot tell apart from it, and
    ``next_step`` is what to do, with a command. ``is_gross`` causes are mistakes of the set-up: degrees, not
    arcseconds.
    """

    cause: str
    size: str
    equals: tuple[str, ...] = ()
    next_step: str = ""
    is_gross: bool = False

    def __str__(self) -> str:
        """One line."""
        equals = f"; this session cannot tell it apart from: {', '.join(self.equals)}" if self.equals else ""
        following = f"; next: {self.next_step}" if self.next_step else ""
        return f"{self.cause}: {self.size}{equals}{following}"


@dataclass(frozen=True, slots=True)
class FindingEvent(LinkEvent):
    """A finding of a running session, for its listeners; it is not recorded, since a replay finds it again."""

    finding: Finding


MOST_OF_A_KIND = 1000
MOST_EVENTS = 20_000


class EventLog:
    """Counts events by kind and decides which are stored."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def bounded(self, event: LinkEvent) -> LinkEvent:
        """The event with a valid instant, and of kind OTHER where there are too many different kinds."""
        is_known = event.kind in self._counts or len(self._counts) < MOST_KINDS
        if is_known and 0 <= event.utc_ns <= LAST_NS:
            return event
        return replace(event, kind=event.kind if is_known else OTHER, utc_ns=min(max(event.utc_ns, 0), LAST_NS))

    def accepts(self, event: LinkEvent) -> bool:
        """Count the event; whether it is to be stored."""
        self._counts[event.kind] += 1
        return self._counts[event.kind] <= MOST_OF_A_KIND and self._counts.total() <= MOST_EVENTS


MOST_CHARACTERS = 280
MOST_WAITING = 20
OF_MOUNT = "mount:"
"""With this begins a note that the mount was touched."""
OF_SENSOR = "send:"
"""With this begins what ``gse sensor`` leaves for the sensor, in hexadecimal digits: never a note of the page."""


class Notes:
    """The notes that the loop has not fetched yet; at most MOST_WAITING."""

    def __init__(self) -> None:
        self._texts: queue.Queue[str] = queue.Queue(MOST_WAITING)

    def put(self, text: str) -> bool:
        """Leave a note; False where too many wait."""
        try:
            self._texts.put_nowait(text)
        except queue.Full:
            return False
        return True

    def take(self) -> list[str]:
        """All notes since the last call."""
        found = []
        while True:
            try:
                found.append(self._texts.get_nowait())
            except queue.Empty:
                return found


def note_text(text: str) -> str:
    """A note as it is recorded: one line of printable characters; ValueError where nothing is left, or too much."""
    line = " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())
    if not line:
        raise ValueError("the note is empty; expected a line of text, for example: clouds from the west")
    if line.startswith(OF_SENSOR):
        raise ValueError(
            f"a note cannot begin with {OF_SENSOR}; commands to the sensor are sent by gse sensor --session"
        )
    if len(line) > MOST_CHARACTERS:
        raise ValueError(f"the note has {len(line)} characters; expected {MOST_CHARACTERS} at most")
    return line


def event_of(line: str) -> tuple[StationKind, str]:
    """Kind and text of the event that a note makes."""
    if not line.startswith(OF_MOUNT):
        return StationKind.NOTE, line
    return StationKind.MOUNT_TOUCHED, line.removeprefix(OF_MOUNT).strip() or "the mount was touched"
