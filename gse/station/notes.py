"""Notes of the operator on a running session, on their way to the loop.

A note comes from the glance page or from ``gse note``; the loop fetches it and makes it an event NOTE, or MOUNT_TOUCHED
where it says that the mount was touched. Both sides only append to and take from a bounded queue: neither waits for the
other.
"""

import queue

from gse.station.events import StationKind

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
