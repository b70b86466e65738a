"""What a page that comes late is sent: nothing twice, and no more of the past than ten minutes."""

from gse.values.instant import NS_PER_S
from gse.view.scene import Recent


def kept(most: int = 100, window_s: float = 600.0, count: int = 10, step_s: int = 1) -> Recent[str]:
    recent: Recent[str] = Recent(most, window_s)
    for number in range(count):
        recent.add(number, number * step_s * NS_PER_S, f"value {number}")
    return recent


def test_a_page_gets_what_came_after_its_place_and_nothing_twice() -> None:
    assert kept().after(6) == ["value 7", "value 8", "value 9"]
    assert kept().after(9) == []


def test_a_page_without_a_place_gets_all() -> None:
    assert len(kept().after(-1)) == 10


def test_the_oldest_go_beyond_the_window_and_beyond_the_count() -> None:
    assert kept(window_s=3.0).after(-1) == ["value 6", "value 7", "value 8", "value 9"]
    assert kept(most=2).after(-1) == ["value 8", "value 9"]
