"""A sensor and a host whose clocks a test makes: frames of astropy's sky as bytes, stamped by the host's two clocks."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from skies.astropy_night import STATION_TEXT, AstropyNight

from drivers.chunk import Chunk
from drivers.clock import ClockReading
from gse.config.station import parse_station
from gse.instant import NS_PER_S, from_text
from gse.station.loop import StationLoop
from gse.station.session_data import SessionData
from gse.station.setup import set_up
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


class Sky:
    """The frames of a minute or some more, made once for all sessions: true seconds and objects."""

    def __init__(self, duration_s: float = 80.0, rate_hz: float = 5.0) -> None:
        self.setup = set_up(parse_station(TEXT), TEXT, utc_ns=START_NS)
        instants = START_NS + np.arange(round(duration_s * rate_hz)) * round(NS_PER_S / rate_hz)
        night = AstropyNight(self.setup.identifier.catalog.icrs)
        made = list(night.panoramas(instants, noise_px=0.05, seed=5))
        self.frames = [((panorama.utc_ns - START_NS) / NS_PER_S, panorama.xy_px) for panorama in made]
        self.elsewhere_px = np.random.default_rng(3).uniform(20, 1000, (25, 2))
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
