"""The ``test:`` block of a station file as the report gives it, with what the sensor says of itself."""

from collections.abc import Iterable
from typing import Any

from gse.station.session_data import SessionData
from gse.statistics.decision import Row
from protocols import StatusMessage

_MOST_SENT = 5
"""A sensor that sends a new serial number in each frame tells nothing by the sixth."""


def documented_test(session: SessionData, rows: Iterable[Row]) -> dict[str, Any]:
    """The object ``test`` of report.json; null where station file and sensor say nothing.

    ``requirements_of_no_row`` are those of names that no row has.
    """
    given = session.station.test.model_dump(mode="json")
    names = {row.name for row in rows}
    requirements = given.pop("requirements")
    unknown = [{"row": row, **of_row} for row, of_row in requirements.items() if row not in names]
    messages = [message for _, message in session.statuses]
    sensor = {
        "serial": _said(_serials(messages), given.pop("sensor_serial")),
        "firmware": _said(_firmwares(messages), given.pop("sensor_firmware")),
    }
    return {**given, "sensor": sensor, "requirements_of_no_row": unknown}


def requirement_of(session: SessionData, row: Row) -> dict[str, Any] | None:
    """The requirement that a row verifies."""
    found = session.station.test.requirements.get(row.name)
    return found.model_dump(mode="json") if found else None


def _serials(messages: list[StatusMessage]) -> list[str]:
    return [str(message.serial) for message in messages if message.serial]


def _firmwares(messages: list[StatusMessage]) -> list[str]:
    return [".".join(str(part) for part in message.firmware) for message in messages if any(message.firmware)]


def _said(sent: list[str], stated: str | None) -> dict[str, Any]:
    """What the sensor sent and what the station file states; all of it, where the sensor sent several."""
    return {"sent": list(dict.fromkeys(sent))[:_MOST_SENT], "stated": stated}
