"""The operator is told once, clearly."""

from drivers.chunk import LinkEvent
from gse.view.status import Announcer


def test_each_kind_of_event_is_said_once_and_then_counted() -> None:
    said: list[str] = []
    teller = Announcer(said.append)
    for number in range(5):
        teller.on_event(LinkEvent(1_774_000_000_000_000_000 + number, 0, "LOST", "the port is gone"))
        teller.on_event(LinkEvent(1_774_000_000_000_000_000 + number, 0, "STREAMING", "valid frames come"))
    teller.on_event(LinkEvent(0, 0, "CLOCK_STEP", "the clock stepped"))
    assert said == [
        "2026-03-20T09:46:40.0Z LOST: the port is gone",
        "2026-03-20T09:46:40.0Z STREAMING: valid frames come",
        "before the first byte CLOCK_STEP: the clock stepped",
    ]
    teller.conclude()
    assert said[3:] == ["repeated events: LOST 4 x"]


def test_a_second_full_disk_is_said_like_the_first() -> None:
    said: list[str] = []
    teller = Announcer(said.append)
    for _ in range(2):
        teller.on_event(LinkEvent(0, 0, "RECORDER_REFUSED", "the disk is full"))
        teller.on_event(LinkEvent(0, 0, "RECORDER_RECOVERED", "it takes bytes again"))
    teller.conclude()
    assert len(said) == 4


def test_one_repetition_is_counted_and_a_single_event_is_not() -> None:
    said: list[str] = []
    teller = Announcer(said.append)
    for kind, count in (("LOST", 2), ("FROZEN", 1), ("BACKLOG", 3)):
        for number in range(count):
            teller.on_event(LinkEvent(1, 0, kind, f"{kind} {number}"))
    teller.conclude()
    assert said[-1] == "repeated events: LOST 1 x, BACKLOG 2 x"
