"""Values of the last minutes, numbered in the order of their coming."""

from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

from gse.instant import NS_PER_S

T = TypeVar("T")


class Recent(Generic[T]):
    """At most ``most`` values, none of them ``window_s`` seconds older than the last one."""

    def __init__(self, most: int, window_s: float) -> None:
        self._window_ns = window_s * NS_PER_S
        self._kept: deque[tuple[int, int, T]] = deque(maxlen=most)

    def add(self, number: int, utc_ns: int, value: T) -> None:
        """Keep a value of an instant; numbers grow."""
        self._kept.append((number, utc_ns, value))
        while self._kept[0][1] < utc_ns - self._window_ns:
            self._kept.popleft()

    def after(self, number: int) -> list[T]:
        """The values with greater numbers, in order."""
        return [value for kept, _, value in self._kept if kept > number]


@dataclass(frozen=True, slots=True)
class Piece:
    """What a viewer does not have yet: a recording (.rrd), the place to go on from, and its last instant (UTC, ns)."""

    rrd: bytes = b""
    place: str = ""
    utc_ns: int = 0
