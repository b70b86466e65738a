"""The table of housekeeping: rows of the frames that came, events of red items, summaries that no thinning changes."""

import numpy as np
import pytest
from devices.items_sensor import HEALTHY, ITEMS
from numpy.typing import NDArray

from drivers.chunk import Chunk, LinkEvent
from gse.station.housekeeping import ITEM, MOST_IN_MEMORY, Housekeeping
from gse.station.reception import Reception
from protocols import Other

SECOND_NS = 1_000_000_000
FIRST_NS = 1_800_000_000 * SECOND_NS


def health(sequence: int, **changes: object) -> bytes:
    return ITEMS.encode(Other("HEALTH", bytes(6)), sequence, items=HEALTHY | changes)  # type: ignore[arg-type]


def received(*data: bytes) -> tuple[NDArray[np.void], list[LinkEvent]]:
    """Rows and events of what comes a second apart."""
    reception = Reception(ITEMS, baudrate=115200)
    rows, events = [], []
    for second, piece in enumerate(data):
        came = reception.receive(reception.stream.feed(Chunk(FIRST_NS + second * SECOND_NS, second * SECOND_NS, piece)))
        rows.append(came.items)
        events += [item for item in came if isinstance(item, LinkEvent)]
    return np.concatenate(rows), events


def test_each_value_is_a_row_at_the_time_at_which_its_frame_was_complete() -> None:
    whole = health(0, supply_v=4.85)
    rows, events = received(whole[:5], whole[5:], health(1))
    names = [list(ITEMS.items)[number] for number in rows["item"][:5]]
    assert names == ["mode", "faults", "supply_v", "detector_degc", "gain_db"]
    assert rows["value"].tolist() == pytest.approx([1, 0, 4.85, 20, 12, 1, 0, 5, 20, 12])
    assert rows["colour"].tolist() == [0, 0, 2, 1, 0, 0, 0, 1, 1, 0]
    assert set(rows["utc_ns"][:5].tolist()) == {FIRST_NS + SECOND_NS}
    assert events == []


def test_an_item_that_goes_red_and_comes_back_makes_two_events() -> None:
    data = [health(0), health(1, supply_v=4.2), health(2, supply_v=4.1), health(3)]
    _, events = received(*data)
    assert [(event.kind, event.utc_ns - FIRST_NS) for event in events] == [
        ("ITEM_RED", SECOND_NS),
        ("ITEM_BACK", 3 * SECOND_NS),
    ]
    assert events[0].text == "supply_v is 4.2 V, outside of its red limits, 4.75 to 5.25"
    assert received(b"".join(data))[1][0].text == events[0].text


def test_a_copy_of_a_frame_is_no_second_value() -> None:
    assert len(received(health(0), health(0))[0]) == 5


def test_the_latest_values_are_at_hand_in_words() -> None:
    table = Housekeeping(ITEMS.items)
    table.extend(received(health(0), health(1, mode="tracking", supply_v=5.2))[0])
    assert (table.latest["mode"].value, table.latest["mode"].colour) == ("tracking", "")
    assert (table.latest["supply_v"].text, table.latest["supply_v"].colour) == ("5.2 V", "yellow")
    assert "background_counts" not in table.latest
    summary = table.summaries["supply_v"]
    assert (summary.count, summary.least, summary.largest, summary.colours) == (2, 5.0, 5.2, (0, 1, 1, 0))


def rows_of(values: NDArray[np.float64]) -> NDArray[np.void]:
    """Values of two items in turn, one a second."""
    rows = np.zeros(2 * len(values), ITEM)
    rows["utc_ns"] = np.repeat(np.arange(len(values)) * SECOND_NS, 2)
    rows["item"] = np.tile([2, 3], len(values))
    rows["value"] = np.repeat(values, 2)
    rows["colour"] = 1
    return rows


def test_a_flood_is_thinned_in_memory_evenly_and_summed_up_wholly() -> None:
    values = np.arange(MOST_IN_MEMORY * 0.7)
    live, replayed = Housekeeping(ITEMS.items), Housekeeping(ITEMS.items)
    replayed.use_disk()
    for part in np.array_split(values, 7):
        live.extend(rows_of(part))
        replayed.extend(rows_of(part))
    assert live.summaries == replayed.summaries
    assert live.summaries["supply_v"].count == len(values)
    assert len(replayed.rows) == 2 * len(values) > MOST_IN_MEMORY >= len(live.rows)
    of_one = live.rows["value"][np.asarray(live.rows["item"]) == 3]
    assert set(np.diff(of_one).tolist()) == {float(live.stride)} == {2.0}
