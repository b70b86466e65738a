"""Table of the items that a sensor sends: its housekeeping, one row per value.

``ItemReader`` makes rows and events of frames, ``Housekeeping`` keeps them. What a report says of an item is summed up
as the rows come (``ItemSummary``), so it does not depend on how many of them are kept.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.station.events import StationKind
from gse.station.frame_columns import ColumnStore, FrameColumns
from protocols import COLOURS, Item, ItemValue, Protocol

ITEM = np.dtype([("utc_ns", "i8"), ("value", "f8"), ("item", "u2"), ("colour", "u1")])
"""One row per value; ``item`` is a place among the items of the protocol, ``colour`` in COLOURS."""
NO_ITEMS = np.zeros(0, ITEM)
RED = COLOURS.index("red")
MOST_IN_MEMORY = 1 << 20
"""Rows of a live session, 20 MB: 12 items each second for 24 h. Of more every second, fourth, ... value is kept."""


class FrameWithItems(NamedTuple):
    """A frame that brings items: its message, payload, times, and the place of its events among the news."""

    type: str
    payload: bytes
    utc_ns: int
    mono_ns: int
    place: int
    before: int


class ItemReader:
    """Reads the items of frames, and finds those that go red and come back."""

    def __init__(self, protocol: Protocol) -> None:
        self.types = frozenset(protocol.items_by_message)
        self._protocol = protocol
        self._items = tuple(protocol.items.values())
        numbers = {name: number for number, name in enumerate(protocol.items)}
        self._numbers = {
            name: np.array([numbers[item.name] for item in items], dtype=np.uint16)
            for name, items in protocol.items_by_message.items()
        }
        ends = np.array([_ends(item) for item in self._items]).reshape(-1, 5)
        self._ends = {name: ends[at] for name, at in self._numbers.items()}
        self._is_red = np.zeros(len(self._items), dtype=np.bool_)

    def read(self, frames: Sequence[FrameWithItems]) -> tuple[NDArray[np.void], list[tuple[FrameWithItems, LinkEvent]]]:
        """Rows of ITEM in the order of the frames, and the events that they bring."""
        parts, events = [], []
        begin = 0
        for end in range(1, len(frames) + 1):
            if end == len(frames) or frames[end].type != frames[begin].type:
                rows, found = self._read(frames[begin:end])
                parts.append(rows)
                events += found
                begin = end
        return (np.concatenate(parts) if parts else NO_ITEMS), events

    def _read(
        self, frames: Sequence[FrameWithItems]
    ) -> tuple[NDArray[np.void], list[tuple[FrameWithItems, LinkEvent]]]:
        """Of frames of one message."""
        name = frames[0].type
        values = self._protocol.item_numbers(name, [frame.payload for frame in frames])
        numbers, (has, low, high, lowest, highest) = self._numbers[name], self._ends[name].T
        is_red = ~((values >= lowest) & (values <= highest)) & (has > 0)  # NaN is red, too
        is_yellow = ~((values >= low) & (values <= high))
        rows = np.empty(values.shape, ITEM)
        rows["utc_ns"] = np.array([frame.utc_ns for frame in frames])[:, None]
        rows["value"], rows["item"] = values, numbers
        rows["colour"] = np.where(is_red, RED, np.where(is_yellow, RED - 1, 1)) * (has > 0)
        before = np.concatenate([self._is_red[numbers][None], is_red[:-1]])
        self._is_red[numbers] = is_red[-1]
        events = []
        for k, at in zip(*np.nonzero(before != is_red), strict=True):
            item, value = self._items[numbers[at]], float(values[k, at])
            events.append((frames[k], self._event(frames[k], item, value, is_red=bool(is_red[k, at]))))
        return rows.ravel(), events

    @staticmethod
    def _event(frame: FrameWithItems, item: Item, value: float, *, is_red: bool) -> LinkEvent:
        low, high = item.red or (None, None)
        ends = " to ".join("any" if end is None else f"{end:g}" for end in (low, high))
        text = f"{item.name} is {item.text(value)}, {'outside' if is_red else 'back inside'} of its red limits, {ends}"
        kind = StationKind.ITEM_RED if is_red else StationKind.ITEM_BACK
        return LinkEvent(frame.utc_ns, frame.mono_ns, kind, text)


def _ends(item: Item) -> tuple[float, float, float, float, float]:
    """1 where an item has limits, then its yellow and red ones, infinite where they are open."""
    ends = [
        sign * np.inf if end is None else end
        for limits in (item.yellow, item.red)
        for sign, end in zip((-1, 1), limits or (None, None), strict=True)
    ]
    return float(item.colour(0.0) > 0), ends[0], ends[1], ends[2], ends[3]


@dataclass(frozen=True, slots=True)
class ItemNow:
    """The latest value of an item, in words too, with its colour (of COLOURS) and when it came."""

    utc_ns: int
    value: ItemValue
    text: str
    colour: str


@dataclass(frozen=True, slots=True)
class ItemSummary:
    """What a session showed of an item: how many values, the first, least, largest and last, how many of each colour.

    Of a word or of bits they are the numbers on the wire.
    """

    count: int
    first: float
    least: float
    largest: float
    last: float
    colours: tuple[int, int, int, int]


class Housekeeping:
    """The items of a session: their ``latest`` values, their ``summaries``, and the table of all (``rows``).

    ``parameters`` are the names of those that are parameters of the sensor.
    """

    def __init__(self, items: Mapping[str, Item], parameters: Sequence[str] = ()) -> None:
        self.items = tuple(items.values())
        self.parameters = tuple(parameters)
        self.latest: Mapping[str, ItemNow] = {}
        self.summaries: dict[str, ItemSummary] = {}
        self.stride = 1
        self._store = ColumnStore(ITEM, 1 << 12 if items else 0)
        self._on_disk = False
        self._counts = np.zeros(len(self.items), dtype=np.int64)

    @classmethod
    def restored(
        cls,
        items: Mapping[str, Item],
        parameters: Sequence[str],
        summaries: Mapping[str, ItemSummary],
        stride: int,
        rows: NDArray[np.void],
    ) -> "Housekeeping":
        """The table that these were taken from; it gets no more rows."""
        table = cls(items, parameters)
        table.summaries, table.stride = dict(summaries), stride
        table._store = ColumnStore(ITEM, len(rows))
        table._store.extend(rows)
        return table

    def use_disk(self) -> None:
        """Keep all rows, more than MOST_IN_MEMORY of them in a temporary file: where no sensor waits for the disk."""
        self._on_disk = True

    @property
    def rows(self) -> FrameColumns:
        """Columns of ITEM, in the order of time; every ``stride``-th value of each item."""
        return FrameColumns(self._store, 0, self._store.used)

    def extend(self, rows: NDArray[np.void]) -> None:
        """Add rows of ITEM."""
        if not len(rows):
            return
        counts = self._counts[rows["item"]] + _places_in_item(rows["item"])
        latest = dict(self.latest)
        for number in np.unique(rows["item"]).tolist():
            of_item = rows.compress(rows["item"] == number)
            self._counts[number] += len(of_item)
            item, value = self.items[number], float(of_item["value"][-1])
            utc_ns, colour = int(of_item["utc_ns"][-1]), COLOURS[int(of_item["colour"][-1])]
            latest[item.name] = ItemNow(utc_ns, item.value(value), item.text(value), colour)
            self._sum_up(item.name, of_item["value"], of_item["colour"])
        self.latest = latest
        self._keep(rows, counts)

    def _sum_up(self, name: str, values: NDArray[np.float64], colours: NDArray[np.uint8]) -> None:
        counts = np.bincount(colours, minlength=len(COLOURS)).tolist()
        known = values[~np.isnan(values)]
        least, largest = (float(known.min()), float(known.max())) if len(known) else (np.nan, np.nan)
        before = self.summaries.get(name)
        if before is None:
            self.summaries[name] = ItemSummary(
                len(values), float(values[0]), least, largest, float(values[-1]), tuple(counts)
            )
            return
        self.summaries[name] = replace(
            before,
            count=before.count + len(values),
            least=float(np.fmin(before.least, least)),
            largest=float(np.fmax(before.largest, largest)),
            last=float(values[-1]),
            colours=tuple(a + b for a, b in zip(before.colours, counts, strict=True)),
        )

    def _keep(self, rows: NDArray[np.void], counts: NDArray[np.int64]) -> None:
        """Store those of the rows that are kept; ``counts`` says the how manieth value of its item each is."""
        kept = rows.compress(counts % self.stride == 0)
        while self._store.used + len(kept) > MOST_IN_MEMORY and not self._on_disk:
            self._thin()
            kept = rows.compress(counts % self.stride == 0)
        needed = self._store.used + len(kept)
        if needed > self._store.rows:
            self._store = self._store.with_room(2 * needed, on_disk=needed > MOST_IN_MEMORY)
        self._store.extend(kept)

    def _thin(self) -> None:
        """Drop every second stored value of each item."""
        self.stride *= 2
        stored = np.empty(self._store.used, ITEM)
        for name in ITEM.names or ():
            stored[name] = self.rows[name]
        kept = stored.compress(_places_in_item(stored["item"]) % 2 == 0)
        self._store = ColumnStore(ITEM, MOST_IN_MEMORY)
        self._store.extend(kept)


def _places_in_item(items: NDArray[np.uint16]) -> NDArray[np.int64]:
    """The how manieth value of its item each row is, from 0."""
    order = np.argsort(items, kind="stable")
    ordered = items[order]
    places = np.empty(len(items), dtype=np.int64)
    places[order] = np.arange(len(items)) - np.searchsorted(ordered, ordered)
    return places
