"""The words of a protocol description: names of messages, of their fields, of units.

docs/protocols.md shows this table to those who describe a sensor of their own.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction

from protocols.messages import Ack, AttitudeMessage, Message, Nak, PanoramaMessage, StarsMessage, StatusMessage

SPARE = "spare"
"""A field that the station has no use for: written as zero, not looked at when read."""

HEADER_FIELDS = ("type", "flags", "length", "sequence", "destination", "source")


class Kind(Enum):
    """What a field's counts become."""

    INTEGER = "integer"
    NUMBER = "number"
    BITS = "bits"
    WORD = "word"
    COMMAND = "command"
    INTEGERS = "integers"


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit in terms of the station's: value = factor * (number in this unit) + zero."""

    factor: Fraction = Fraction(1)
    zero: Fraction = Fraction(0)


SECONDS = {
    "ns": Unit(Fraction(1, 10**9)),
    "us": Unit(Fraction(1, 10**6)),
    "ms": Unit(Fraction(1, 1000)),
    "s": Unit(),
}
_MICROSECONDS = {name: Unit(unit.factor * 10**6) for name, unit in SECONDS.items()}
_CELSIUS = {"degC": Unit(), "K": Unit(zero=Fraction("-273.15"))}
_VOLTS = {"mV": Unit(Fraction(1, 1000)), "V": Unit()}
_PIXELS = {"px": Unit()}
_DEGREES = {
    "deg": Unit(),
    "mdeg": Unit(Fraction(1, 1000)),
    "udeg": Unit(Fraction(1, 10**6)),
    "arcsec": Unit(Fraction(1, 3600)),
    "rad": Unit(Fraction("57.29577951308232")),
}
_ARCSECONDS = {name: Unit(unit.factor * 3600) for name, unit in _DEGREES.items()}
_RIGHT_ASCENSION = {**_DEGREES, "h": Unit(Fraction(15))}

_PER_SECOND = {f"{name}/s": unit for name, unit in _DEGREES.items()}
_AMPERES = {"uA": Unit(Fraction(1, 10**6)), "mA": Unit(Fraction(1, 1000)), "A": Unit()}
_WATTS = {"mW": Unit(Fraction(1, 1000)), "W": Unit()}
_HERTZ = {"Hz": Unit(), "kHz": Unit(Fraction(1000)), "MHz": Unit(Fraction(10**6))}
_LONG_TIMES = {"min": Unit(Fraction(60)), "h": Unit(Fraction(3600))}
_FAMILIES: tuple[Mapping[str, Unit], ...] = (
    {**SECONDS, **_LONG_TIMES}, _CELSIUS, {"uV": Unit(Fraction(1, 10**6)), **_VOLTS}, _AMPERES, _WATTS, _HERTZ,
    _DEGREES, _PER_SECOND,
)  # fmt: skip
"""Units of items, arguments and conditions that are converted into each other; any other word stands for itself."""

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S*)\s*")


def quantity(value: float | str, unit: str) -> float:
    """A number in this unit, of a number, or of a text with a unit such as ``200 ms``; ValueError with what is known.

    A number by itself is in the unit already.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"is {value!r:.60}: expected a number{f' in {unit}' if unit else ''}")
    found = _QUANTITY.fullmatch(str(value))
    if found is None or not math.isfinite(number := float(found[1])):
        raise ValueError(f"is {value!r:.60}: expected a number{f' in {unit}, such as 5 {unit}' if unit else ''}")
    given = found[2] or unit
    return number if given == unit else _converted(number, given, unit)


def _converted(number: float, given: str, unit: str) -> float:
    family = next((family for family in _FAMILIES if unit in family), None)
    if family is None or given not in family:
        known = ", ".join(family) if family else unit or "none"
        raise ValueError(f"has the unit {given!r:.20}: known here: {known}")
    of, to = family[given], family[unit]
    return float((of.factor * Fraction(str(number)) + of.zero - to.zero) / to.factor)


def near_unit(unit: str) -> str | None:
    """The known unit that was meant by a word which differs from it in case only."""
    known = [name for family in _FAMILIES for name in family]
    return next((name for name in known if name.casefold() == unit.casefold()), None) if unit not in known else None


QUATERNION = ("q1", "q2", "q3", "q4")
"""The numbers of a quaternion, in the order of the wire."""


@dataclass(frozen=True, slots=True)
class Role:
    """A standard field: the attribute of the message that it fills, what it is, in which units it may come."""

    attribute: str
    kind: Kind = Kind.INTEGER
    units: Mapping[str, Unit] = field(default_factory=dict)
    required: bool = False


@dataclass(frozen=True, slots=True)
class Form:
    """A standard message: its class, the fields it may have, those of each slot."""

    message: type[Message]
    roles: Mapping[str, Role] = field(default_factory=dict)
    slot_roles: Mapping[str, Role] = field(default_factory=dict)


_TIME = Role("time_us", Kind.INTEGER, _MICROSECONDS, required=True)
_PARTS_OF_TIME = {
    "fraction": Role("time_us", Kind.INTEGER, _MICROSECONDS),
    "week": Role("time_us", Kind.INTEGER, {"week": Unit(Fraction(7 * 86_400 * 10**6))}),
}
"""What is added to ``time`` where a sensor's time stands in several fields."""

FORMS: Mapping[str, Form] = {
    "PANORAMA": Form(
        PanoramaMessage,
        {
            "time": _TIME,
            **_PARTS_OF_TIME,
            "frame_no": Role("frame_no"),
            "exposure": Role("exposure_s", Kind.NUMBER, SECONDS),
            "processing": Role("processing_s", Kind.NUMBER, SECONDS),
            "status": Role("flags", Kind.BITS),
            "temperature": Role("temperature_c", Kind.NUMBER, _CELSIUS),
            "count": Role("count"),
            "part": Role("part"),
            "parts": Role("parts"),
        },
        {
            "y": Role("xy_px", Kind.NUMBER, _PIXELS, required=True),
            "x": Role("xy_px", Kind.NUMBER, _PIXELS, required=True),
            "index": Role("index", Kind.NUMBER),
        },
    ),
    "STATUS": Form(
        StatusMessage,
        {
            "time": Role("time_us", Kind.INTEGER, _MICROSECONDS),
            **_PARTS_OF_TIME,
            "frames_taken": Role("frames_taken"),
            "frames_sent": Role("frames_sent"),
            "commands_ok": Role("commands_ok"),
            "commands_bad": Role("commands_bad"),
            "temperature": Role("temperature_c", Kind.NUMBER, _CELSIUS),
            "supply": Role("supply_v", Kind.NUMBER, _VOLTS),
            "mode": Role("mode", Kind.WORD),
            "firmware": Role("firmware", Kind.INTEGERS),
            "serial": Role("serial"),
        },
    ),
    "ATTITUDE": Form(
        AttitudeMessage,
        {
            "time": _TIME,
            **_PARTS_OF_TIME,
            "frame_no": Role("frame_no"),
            "ra": Role("ra_deg", Kind.NUMBER, _RIGHT_ASCENSION),
            "de": Role("de_deg", Kind.NUMBER, _DEGREES),
            "roll": Role("roll_deg", Kind.NUMBER, _DEGREES),
            "matched": Role("matched"),
            "state": Role("state", Kind.WORD),
            "latency": Role("latency_s", Kind.NUMBER, SECONDS),
            **{name: Role(name, Kind.NUMBER) for name in QUATERNION},
        },
    ),
    "STARS": Form(
        StarsMessage,
        {"time": _TIME, **_PARTS_OF_TIME, "frame_no": Role("frame_no"), "count": Role("count")},
        {
            "object": Role("objects", required=True),
            "star": Role("stars", required=True),
            "residual": Role("residuals_arcsec", Kind.NUMBER, _ARCSECONDS),
        },
    ),
    "ACK": Form(Ack, {"command": Role("command", Kind.COMMAND), "sequence": Role("sequence")}),
    "NAK": Form(
        Nak,
        {
            "command": Role("command", Kind.COMMAND),
            "reason": Role("reason", Kind.WORD),
            "sequence": Role("sequence"),
        },
    ),
}
"""Every message from the sensor that has a meaning of its own; others have items only, or are ignored."""

TIMES_OF_COMMANDS = {"START": "period", "SET_EXPOSURE": "exposure"}
"""The argument of a command that the station sends by itself, or that a simulated sensor obeys: a time."""

NAME_OF = {form.message: name for name, form in FORMS.items()}
"""The standard name of a message class."""
