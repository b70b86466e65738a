"""Housekeeping: what a sensor says of itself beside its panoramas, in STATUS frames and as items.

STATUS frames give the rows of FRAME their supply voltage and mode. The items that a protocol describes have a table of
their own, one row per value: ``ItemReader`` makes rows and events of frames, ``Housekeeping`` keeps them. What a report
says of an item is summed up as the rows come (``ItemSummary``), so it does not depend on how many of them are kept.

Items that are parameters of the sensor have a hash: that of the lines ``name value unit`` in the order of the
description, a number in its shortest form, each line ended by LF. So it can be made by hand, and is the same for the
same values on any machine.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from gse.config.station import DocumentedTest
from gse.station.events import StationKind
from gse.station.frame_columns import Columns, ColumnStore, FrameColumns
from protocols import COLOURS, Item, ItemValue, Protocol, StatusMessage
from protocols.items import range_in_words


class Mode(StrEnum):
    """Mode of the sensor, in the words of the protocols; unknown before the first STATUS."""

    UNKNOWN = "unknown"
    STANDBY = "standby"
    STREAMING = "streaming"


MODES = tuple(Mode)


def fill_housekeeping(frames: Columns, statuses: list[tuple[int, StatusMessage]]) -> None:
    """Give each row of FRAME supply voltage and mode of the latest STATUS before it; none before the first."""
    if not statuses:
        return
    place = latest_status(frames["host_utc_ns"], statuses)
    known = place >= 0
    frames["supply_v"][known] = np.array([message.supply_v for _, message in statuses], dtype=np.float32)[place[known]]
    frames["mode"][known] = np.array([_place(message.mode) for _, message in statuses])[place[known]]


def latest_status(host_utc_ns: NDArray[np.int64], statuses: Sequence[tuple[int, StatusMessage]]) -> NDArray[np.int64]:
    """Place in ``statuses`` of the latest before each time (N,), -1 before the first."""
    begins_ns = np.array([utc_ns for utc_ns, _ in statuses], dtype=np.int64)
    order = np.argsort(begins_ns, kind="stable")
    return np.append(order, -1)[np.searchsorted(begins_ns[order], host_utc_ns, side="right") - 1]


def firmware_text(message: StatusMessage) -> str:
    """The version of the firmware, as 1.2.0; empty where the protocol has none."""
    return ".".join(map(str, message.firmware))


def _place(mode: str) -> int:
    return MODES.index(Mode(mode)) if mode in MODES else 0


def in_words(message: StatusMessage) -> str:
    """The housekeeping of a STATUS frame in a line; what the protocol does not have is left out."""
    parts = [
        message.mode,
        "" if np.isnan(message.supply_v) else f"{message.supply_v:.2f} V",
        "" if np.isnan(message.temperature_c) else f"{message.temperature_c:.1f} degC",
        f"firmware {firmware_text(message)}" if message.firmware else "",
        f"serial {message.serial}" if message.serial else "",
    ]
    return ", ".join(part for part in parts if part)


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
        ends = range_in_words(low, high)
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


def parameters_of(housekeeping: Housekeeping) -> dict[str, ItemValue]:
    """The values that came last, by name; empty where none came, or the protocol has no parameters."""
    by_name = {item.name: item for item in housekeeping.items}
    seen = housekeeping.summaries
    return {name: by_name[name].value(seen[name].last) for name in housekeeping.parameters if name in seen}


def parameters_sha256(housekeeping: Housekeeping) -> str | None:
    """The hash of the parameters; None where none came."""
    found = parameters_of(housekeeping)
    units = {item.name: item.unit for item in housekeeping.items}
    lines = "".join(f"{' '.join(filter(None, (name, str(value), units[name])))}\n" for name, value in found.items())
    return hashlib.sha256(lines.encode()).hexdigest() if found else None


def parameter_differences(housekeeping: Housekeeping, test: DocumentedTest) -> Iterator[str]:
    """In which way the parameters are not those that the station file states, or did not stay the same."""
    found, sha256 = parameters_of(housekeeping), parameters_sha256(housekeeping)
    if not found:
        if test.parameters_sha256 or test.parameters:
            yield "the sensor's parameters never came: send the command that reads them back in the session"
        return
    for name in found:
        seen = housekeeping.summaries[name]
        if seen.least < seen.largest:
            yield f"the parameter {name} changed in the session, from {seen.least:.6g} to {seen.largest:.6g}"
    for name, stated in test.parameters.items():
        value = found.get(name)
        if value != stated:
            yield f"the parameter {name} is {_in_words(value)}, test.parameters states {_in_words(stated)}"
    if test.parameters_sha256 is not None and sha256 != test.parameters_sha256.lower():
        yield f"the SHA-256 of the parameters is {sha256}, test.parameters_sha256 states {test.parameters_sha256}"


def _in_words(value: ItemValue | None) -> str:
    return "missing" if value is None else value if isinstance(value, str) else f"{value:.15g}"
