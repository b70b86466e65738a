"""Seeded faults for the mock ports: those of cables, adapters and sensors.

    faults=flip:1e-4,drop_frame:0.01,disconnect:12.5s/3s

    flip, drop, double, insert     probability per byte: a bit is inverted, the byte is lost, doubled, one put before it
    noise                          probability per byte: 8 to 64 random bytes come before it
    split                          probability per byte: the chunk is cut before it
    drop_frame, double_frame, swap_frame
                                   probability per frame: it is lost, comes twice, comes after the next one
    lost_ack                       probability per acknowledgement: it is lost
    stall                          per second: the computer gives nothing for 0.2 to 3 s, then all at once
    disconnect, rename             at 12.5s after the start, or within frame f100; for 2 s, or /3s; with rename the
                                   adapter comes back under another name
    reset                          at 12.5s: clock and sequence jump back. A recording sends again what it sent from
                                   the start on, a simulated sensor starts anew under the sky of then
    baud                           what the sensor speaks, while the port listens at its own rate

Every fault is drawn for the bytes, frames and seconds of the source, by a random stream of its own kind: the same
seed gives the same bytes in every process, and switching one kind on does not move the others. Each fault that is made
comes as an event FAULT; those of the port as LOST and REOPENED, as they would.

A frame is what begins at ``frame_start``, an acknowledgement what begins at ``ack_start``: bytes in hexadecimal, by
default those of the panorama protocol.
"""

import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from drivers.chunk import NS_PER_S
from drivers.errors import UrlError

BYTE_KINDS = ("flip", "drop", "double", "insert", "noise")
FRAME_KINDS = ("drop_frame", "double_frame", "swap_frame", "lost_ack")
RATE_KINDS = (*BYTE_KINDS, *FRAME_KINDS, "split", "stall")
OUTAGE_KINDS = ("disconnect", "rename")
KINDS = (*RATE_KINDS, *OUTAGE_KINDS, "reset", "baud")
OPTIONS = ("faults", "seed", "frame_start", "ack_start")

OUTAGE_S = 2.0
LONGEST_RESET_S = 3600
_OUTAGE = re.compile(r"(?:(\d+(?:\.\d+)?)s|f(\d+))(?:/(\d+(?:\.\d+)?)s)?")
_SECONDS = re.compile(r"(\d+(?:\.\d+)?)s")


@dataclass(frozen=True, slots=True)
class Outage:
    """The port goes: so many ns after the start, or in the middle of a frame."""

    kind: str
    after_ns: int | None
    frame: int | None
    duration_ns: int


@dataclass(frozen=True, slots=True)
class Faults:
    """The faults that were asked for, and the seed that decides where they come."""

    seed: int = 0
    rates: dict[str, float] = field(default_factory=dict)
    outages: tuple[Outage, ...] = ()
    reset_after_ns: int | None = None
    sensor_baud: int | None = None
    frame_start: bytes = bytes.fromhex("1acffc1d")
    ack_start: bytes = bytes.fromhex("1acffc1d10")

    def random(self, kind: str) -> np.random.Generator:
        """The random stream of one kind of fault."""
        return np.random.default_rng([self.seed, zlib.crc32(kind.encode())])

    def rate(self, kind: str) -> float:
        """The probability of a kind, 0 where it was not asked for."""
        return self.rates.get(kind, 0.0)


def parse_faults(options: dict[str, str]) -> Faults | None:
    """The faults of a mock port's URL, None where it asks for none; UrlError says what was expected."""
    text = options.get("faults", "")
    if not text:
        return None
    rates: dict[str, float] = {}
    outages: list[Outage] = []
    reset_after_ns = sensor_baud = None
    entries = [entry.strip() for entry in text.split(",")]
    for number, entry in enumerate(entries):
        kind, _, value = entry.partition(":")
        if kind not in OUTAGE_KINDS and any(other.startswith(f"{kind}:") for other in entries[:number]):
            raise UrlError(f"faults: {kind} is given twice")
        if kind in RATE_KINDS:
            rates[kind] = _rate(kind, value)
        elif kind in OUTAGE_KINDS:
            outages.append(_outage(kind, value))
        elif kind == "reset":
            reset_after_ns = _seconds(kind, value)
        elif kind == "baud":
            sensor_baud = _whole(kind, value)
        else:
            raise UrlError(f"faults: there is no kind {kind!r}; known are {', '.join(KINDS)}")
    return Faults(
        seed=_whole("seed", options.get("seed", "0")),
        rates=rates,
        outages=tuple(outages),
        reset_after_ns=reset_after_ns,
        sensor_baud=sensor_baud,
        frame_start=_hex("frame_start", options.get("frame_start", "1acffc1d")),
        ack_start=_hex("ack_start", options.get("ack_start", "1acffc1d10")),
    )


def _rate(kind: str, text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = -1.0
    if not 0 <= rate <= 1:
        raise UrlError(f"faults: {kind}:{text} does not work: expected a probability from 0 to 1, e.g. {kind}:1e-4")
    return rate


def _outage(kind: str, text: str) -> Outage:
    match = _OUTAGE.fullmatch(text)
    if match is None:
        raise UrlError(
            f"faults: {kind}:{text} does not work: expected e.g. {kind}:12.5s, {kind}:f100 or {kind}:f100/3s"
        )
    after, frame, duration = match.groups()
    return Outage(
        kind,
        after_ns=round(float(after) * NS_PER_S) if after else None,
        frame=int(frame) if frame else None,
        duration_ns=round(float(duration or OUTAGE_S) * NS_PER_S),
    )


def _seconds(kind: str, text: str) -> int:
    match = _SECONDS.fullmatch(text)
    if match is None:
        raise UrlError(f"faults: {kind}:{text} does not work: expected e.g. {kind}:12.5s")
    if float(match[1]) > LONGEST_RESET_S:
        raise UrlError(
            f"faults: {kind}:{text} does not work: all bytes until then are kept, at most {LONGEST_RESET_S} s"
        )
    return round(float(match[1]) * NS_PER_S)


def _whole(name: str, text: str) -> int:
    if not re.fullmatch(r"\d{1,18}", text) or (name == "baud" and int(text) == 0):
        raise UrlError(f"faults: {name} {text!r} does not work: expected a whole number of up to 18 digits")
    return int(text)


def _hex(name: str, text: str) -> bytes:
    try:
        data = bytes.fromhex(text)
    except ValueError:
        data = b""
    if not 1 <= len(data) <= 16:
        raise UrlError(f"faults: {name}={text} does not work: expected 1 to 16 bytes in hexadecimal, e.g. 1acffc1d")
    return data


class Places:
    """Where a fault of some probability strikes: whole numbers, drawn once and in order."""

    def __init__(self, random: np.random.Generator, rate: float) -> None:
        self._random, self._rate = random, rate
        self._next = self._gap() - 1 if rate > 0 else -1

    def before(self, end: int) -> Iterator[int]:
        """All places before ``end`` that have not been given yet."""
        while 0 <= self._next < end:
            place = self._next
            self._next += self._gap()
            yield place

    def _gap(self) -> int:
        return int(self._random.geometric(self._rate))
