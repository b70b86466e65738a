"""A sensor and a host whose clocks a test makes: frames of astropy's sky as bytes, stamped by the host's two clocks."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from skies.astropy_night import STATION_TEXT, AstropyNight

from drivers.chunk import Chunk
from drivers.clock import ClockReading
from gse.config.station import parse_station
from gse.identifier import Answers, Identification, Identifier, ObjectColumns, Unidentified
from gse.station.loop import StationLoop
from gse.station.session_data import SessionData
from gse.station.setup import set_up
from gse.values.instant import NS_PER_S, from_text
from protocols import AttitudeMessage, PanoramaMessage

TEXT = (
    STATION_TEXT
    + "protocol: panorama-v1-subpixel\nlimits: {identification_ms: 60000, false_share: 0.05, availability: 0.9}\n"
)
"""What is tested needs no long session, and no machine that is idle."""

START_NS = from_text("2026-03-20T15:00:00Z")
"""Late in the evening at the site."""

EXPOSURE_S = 0.1
_BYTE_NS = 10 * NS_PER_S // 115_200
_POWER_ON_S = 1.0
_CHUNKS_AT_ONCE = 64
"""As a replay hands them in."""


def nominal(true_s: float) -> float:
    """A clock that is right."""
    return true_s


@dataclass
class InjectedClocks:
    """The clocks, by the true time in seconds since the session began.

    ``utc_s`` and ``mono_s`` are the host's, ``tag_s`` the sensor's; ``read_s`` is when the bytes that came at an
    instant are read. ``readings`` are what the kernel says: true time and whether the clock is synchronised.
    """

    utc_s: Callable[[float], float] = nominal
    mono_s: Callable[[float], float] = nominal
    tag_s: Callable[[float], float] = nominal
    read_s: Callable[[float], float] = nominal
    readings: tuple[tuple[float, bool], ...] = ((0.0, True),)
    asleep_s: tuple[float, float] = (0.0, 0.0)
    frame_no: Callable[[int], int] = field(default=lambda number: number)
    sequence: Callable[[int], int] = field(default=lambda number: number)


class Remembering:
    """An identifier that searches the sky for each panorama once: many sessions show it the same objects."""

    def __init__(self, identifier: Identifier) -> None:
        self.name, self.catalog = identifier.name, identifier.catalog
        self._identifier = identifier
        self._answers: dict[bytes, Identification | Unidentified] = {}

    def identify(self, directions_sensor: np.ndarray, brightness: np.ndarray) -> Identification | Unidentified:
        """As the identifier does."""
        key = directions_sensor.tobytes() + brightness.tobytes()
        if key not in self._answers:
            self._answers[key] = self._identifier.identify(directions_sensor, brightness)
        return self._answers[key]

    def identify_many(self, objects: ObjectColumns) -> Answers:
        """As the identifier does."""
        return Answers.from_answers([self.identify(*panorama) for panorama in objects])


class Sky:
    """The frames of a minute or some more, made once for all sessions: true seconds and objects."""

    def __init__(self, duration_s: float = 80.0, rate_hz: float = 5.0) -> None:
        made = set_up(parse_station(TEXT), TEXT, utc_ns=START_NS)
        self.setup = replace(made, identifier=Remembering(made.identifier), reference=Remembering(made.reference))
        instants = START_NS + np.arange(round(duration_s * rate_hz)) * round(NS_PER_S / rate_hz)
        night = AstropyNight(self.setup.identifier.catalog.icrs)
        made = list(night.panoramas(instants, noise_px=0.05, seed=5))
        self.frames = [((panorama.utc_ns - START_NS) / NS_PER_S, panorama.xy_px) for panorama in made]
        self.elsewhere_px = np.random.default_rng(3).uniform(20, 1000, (10, 2))
        """Objects that no sky shows."""

    def session(
        self,
        clocks: InjectedClocks,
        *,
        blind_s: tuple[float, float] = (0.0, 0.0),
        blind_px: Sequence[np.ndarray] | None = None,
        own: bool = False,
    ) -> SessionData:
        """The session of the sensor and host with these clocks.

        ``blind_px`` are seen, by frame, in a stretch of true time.
        """
        loop = StationLoop(self.setup)
        for true_s, synchronised in clocks.readings:
            error_s = 0.001 if synchronised else 16.0
            source = "kernel PLL" if synchronised else "unsynchronised"
            utc_ns = START_NS + round(clocks.utc_s(true_s) * NS_PER_S)
            loop.read_clock(
                ClockReading(utc_ns, round(clocks.mono_s(true_s) * 1e9), source, synchronised, 0.0, error_s)
            )
        chunks = self.chunks(clocks, blind_s, blind_px, own)
        while some := list(itertools.islice(chunks, _CHUNKS_AT_ONCE)):
            loop.take(some)
        loop.finish()
        return loop.session

    def chunks(
        self, clocks: InjectedClocks, blind_s: tuple[float, float], blind_px: Sequence[np.ndarray] | None, own: bool
    ) -> Iterator[Chunk]:
        """What the host reads."""
        sequences = map(clocks.sequence, itertools.count())
        for number, (true_s, seen_px) in enumerate(self.frames):
            if clocks.asleep_s[0] <= true_s < clocks.asleep_s[1]:
                continue
            xy_px = blind_px[number] if blind_px is not None and blind_s[0] <= true_s < blind_s[1] else seen_px
            data = b"".join(
                self.setup.protocol.encode(message, sequence=next(sequences) % 65536)
                for message in messages(clocks, number, true_s, xy_px, own)
            )
            read_s = clocks.read_s(true_s)
            late_ns = round((EXPOSURE_S / 2 + 0.0002) * NS_PER_S) + _BYTE_NS
            yield Chunk(
                START_NS + round(clocks.utc_s(read_s) * NS_PER_S) + late_ns,
                round((clocks.mono_s(read_s) + 1000.0) * NS_PER_S) + late_ns,
                data,
            )


def messages(
    clocks: InjectedClocks, number: int, true_s: float, xy_px: np.ndarray, own: bool
) -> Iterator[PanoramaMessage | AttitudeMessage]:
    """A panorama; with ``own`` the sensor's answer as well, of the catalogue's place where its boresight looks."""
    time_us = round((clocks.tag_s(true_s) + _POWER_ON_S) * 1e6)
    yield PanoramaMessage(
        time_us=time_us,
        frame_no=clocks.frame_no(number),
        exposure_s=EXPOSURE_S,
        flags=frozenset(),
        temperature_c=20.0,
        xy_px=xy_px,
        index=np.rint(np.linspace(4000, 200, len(xy_px))),
    )
    if own:
        yield AttitudeMessage(
            time_us, 10.0, 20.0, 30.0, frame_no=clocks.frame_no(number), matched=20, state="acquired", latency_s=0.01
        )


def until_14_s(bad: Callable, good: Callable = lambda value: value, *, change: float = 14) -> Callable:
    """One function of time or number until ``change``, another from then on."""
    return lambda value: bad(value) if value < change else good(value)


def in_bunches(true_s: float) -> float:
    """When bytes are read that are fetched once a second."""
    return true_s // 1 + 1


TO_2038_S = 365.25 * 86400 * 11.8
MISBEHAVIOURS = {
    "sound clocks": InjectedClocks(),
    "stuck tags": InjectedClocks(tag_s=until_14_s(lambda t: 0.0)),
    "tags 20 % fast": InjectedClocks(tag_s=until_14_s(lambda t: 1.2 * t, lambda t: t + 2.8)),
    "tags 20 % slow": InjectedClocks(tag_s=until_14_s(lambda t: 0.8 * t, lambda t: t - 2.8)),
    "a leap ahead": InjectedClocks(tag_s=until_14_s(lambda t: t, lambda t: t + 3)),
    "a leap back": InjectedClocks(tag_s=until_14_s(lambda t: t, lambda t: t - 3)),
    "a leap ahead, read in bunches": InjectedClocks(
        tag_s=until_14_s(lambda t: t, lambda t: t + 3), read_s=until_14_s(in_bunches)
    ),
    "a long leap, read in bunches": InjectedClocks(
        tag_s=until_14_s(lambda t: t, lambda t: t + 15.9), read_s=until_14_s(in_bunches)
    ),
    "a real backlog": InjectedClocks(read_s=until_14_s(lambda t: 14.0)),
    "a clock step at its end": InjectedClocks(utc_s=until_14_s(lambda t: t, lambda t: t + 3)),
    "a clock an hour ahead": InjectedClocks(utc_s=until_14_s(lambda t: t + 3600)),
    "a clock in 2038": InjectedClocks(utc_s=until_14_s(lambda t: t + TO_2038_S)),
    "a clock that falls to 1970 and stays": InjectedClocks(
        utc_s=until_14_s(lambda t: t, lambda t: t - START_NS / NS_PER_S)
    ),
    "a second that NTP repeats": InjectedClocks(utc_s=until_14_s(lambda t: t, lambda t: t - 1)),
    "a smeared second": InjectedClocks(utc_s=lambda t: t - t / 86400),
    "a host that sleeps at its end": InjectedClocks(
        mono_s=until_14_s(lambda t: t, lambda t: t - 5, change=19), asleep_s=(14.0, 19.0)
    ),
    "frame_no stands still": InjectedClocks(frame_no=until_14_s(lambda n: 7, change=70)),
    "sequence chaos": InjectedClocks(sequence=until_14_s(lambda n: n * 7919, change=70)),
    "sequence stands still": InjectedClocks(sequence=until_14_s(lambda n: 5, change=70)),
    "sequence and tags stand still": InjectedClocks(
        sequence=until_14_s(lambda n: 5, change=70), tag_s=until_14_s(lambda t: 0.0)
    ),
    "nothing moves but the stars": InjectedClocks(
        sequence=until_14_s(lambda n: 5, change=70),
        tag_s=until_14_s(lambda t: 0.0),
        frame_no=until_14_s(lambda n: 5, change=70),
    ),
}


def wrong_objects(sky: Sky) -> list[np.ndarray]:
    """Objects by frame, four of them beside where stars are."""
    rng = np.random.default_rng(7)
    return [np.clip(xy_px[:4] + rng.normal(0, 40, (4, 2)), 1, 1000) for _, xy_px in sky.frames]
