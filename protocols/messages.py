"""Messages of a star sensor in px, s and degC, independent of the wire format.

    sensor to station                        station to sensor
    PANORAMA    PanoramaMessage              any command   Command
    STATUS      StatusMessage
    ATTITUDE    AttitudeMessage
    STARS       StarsMessage
    ACK         Ack
    NAK         Nak
    any other   Other

A frame with a correct checksum is a valid frame; invalid values in it are listed in ``problems``, one line each. A
number that the protocol does not carry is NaN or 0, a word is empty.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Message:
    """Common part of all messages: invalid values, in words for the operator."""

    problems: tuple[str, ...] = field(default=(), kw_only=True)

    def __eq__(self, other: object) -> bool:
        """Equal in each field. Messages with numbers that may be NaN take this instead of a dataclass's own equality.

        From Python 3.13 on a dataclass that holds NaN does not even equal itself.
        """
        if type(other) is not type(self):
            return NotImplemented
        return all(_same(getattr(self, of.name), getattr(other, of.name)) for of in fields(self))


@dataclass(frozen=True, slots=True, eq=False)
class PanoramaMessage(Message):
    """The objects of one exposure, in the order of the wire (brightest first).

    ``time_us`` is the sensor's clock, at mid-exposure unless the protocol says otherwise; ``processing_s`` the time
    from the end of the exposure to the first byte, as the sensor states it; ``xy_px`` (N, 2) is x = column, y = row;
    ``index`` (N,) the brightness; ``flags`` the status bits by name.
    """

    time_us: int
    frame_no: int
    exposure_s: float
    flags: frozenset[str]
    temperature_c: float
    xy_px: NDArray[np.float64]
    index: NDArray[np.float64]
    processing_s: float = math.nan

    @classmethod
    def empty(cls) -> "PanoramaMessage":
        """A panorama without an object."""
        return cls(0, 0, 0.05, frozenset(), 20.0, np.empty((0, 2)), np.empty(0))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PanoramaMessage):
            return NotImplemented
        return (
            (self.time_us, self.frame_no, self.flags, self.problems)
            == (other.time_us, other.frame_no, other.flags, other.problems)
            and _same(self.exposure_s, other.exposure_s)
            and _same(self.temperature_c, other.temperature_c)
            and _same(self.processing_s, other.processing_s)
            and np.array_equal(self.xy_px, other.xy_px, equal_nan=True)
            and np.array_equal(self.index, other.index, equal_nan=True)
        )

    __hash__ = None  # type: ignore[assignment]  # it holds arrays


@dataclass(frozen=True, slots=True, eq=False)
class PanoramaColumns:
    """Panorama messages of which each object is a row; ``columns[k]`` is one of them.

    Message k has the rows ``first[k]`` to before ``first[k + 1]`` of ``xy_px`` (M, 2) and ``index`` (M,).
    """

    time_us: Sequence[int]
    frame_no: Sequence[int]
    exposure_s: Sequence[float]
    flags: Sequence[frozenset[str]]
    temperature_c: Sequence[float]
    first: NDArray[np.int64]
    xy_px: NDArray[np.float64]
    index: NDArray[np.float64]
    problems: Sequence[tuple[str, ...]]
    processing_s: Sequence[float] | None = None

    def __len__(self) -> int:
        return len(self.time_us)

    def __getitem__(self, k: int) -> PanoramaMessage:
        rows = slice(self.first[k], self.first[k + 1])
        return PanoramaMessage(
            time_us=self.time_us[k],
            frame_no=self.frame_no[k],
            exposure_s=self.exposure_s[k],
            flags=self.flags[k],
            temperature_c=self.temperature_c[k],
            xy_px=self.xy_px[rows],
            index=self.index[rows],
            problems=self.problems[k],
            processing_s=math.nan if self.processing_s is None else self.processing_s[k],
        )


def _same(a: Any, b: Any) -> bool:
    return bool(a == b) or (isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b))


@dataclass(frozen=True, slots=True, eq=False)
class StatusMessage(Message):
    """The sensor's housekeeping; ``mode`` is ``standby`` or ``streaming``, ``firmware`` (major, minor, patch)."""

    time_us: int = 0
    frames_taken: int = 0
    frames_sent: int = 0
    commands_ok: int = 0
    commands_bad: int = 0
    temperature_c: float = math.nan
    supply_v: float = math.nan
    mode: str = ""
    firmware: tuple[int, ...] = ()
    serial: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeMessage(Message):
    """The sensor's own solution for the exposure ``frame_no``; ``state`` is ``lost`` or ``acquired``.

    Its direction comes as angles, or as a quaternion whose four numbers ``q1`` to ``q4`` are in the order of the wire:
    which of them is the scalar, and between which axes it turns, is the sensor's convention.
    """

    time_us: int
    ra_deg: float = math.nan
    de_deg: float = math.nan
    roll_deg: float = math.nan
    frame_no: int = 0
    matched: int = 0
    state: str = ""
    latency_s: float = math.nan
    q1: float = math.nan
    q2: float = math.nan
    q3: float = math.nan
    q4: float = math.nan


@dataclass(frozen=True, slots=True, eq=False)
class StarsMessage(Message):
    """The stars that the sensor names in the panorama ``frame_no``: objects, their stars, what is left between the two.

    ``objects`` are counted from 0 in the order of the panorama, ``stars`` are numbers of the sensor's catalogue.
    """

    time_us: int = 0
    frame_no: int = 0
    objects: tuple[int, ...] = ()
    stars: tuple[int, ...] = ()
    residuals_arcsec: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Ack(Message):
    """The sensor obeys the command of this name; ``sequence`` is that of the command's frame."""

    command: str = ""
    sequence: int = 0


@dataclass(frozen=True, slots=True)
class Nak(Message):
    """The sensor refuses the command of this name, and says why."""

    command: str = ""
    reason: str = ""
    sequence: int = 0


Value = float | int | str | frozenset[str] | tuple[int, ...]
"""What an argument or an item may be: a number, a word, the names of the bits that are set, or some integers."""


@dataclass(frozen=True, slots=True, eq=False)
class Command(Message):
    """A command by its name; ``arguments`` are in the units of the protocol's description."""

    name: str
    arguments: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Other(Message):
    """A message that the protocol describes and the station has no use for."""

    type: str
    payload: bytes
