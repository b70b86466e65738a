"""Simulated sessions: what the simulated sensor sends, as a session file."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol as Interface

from drivers.chunk import Chunk
from drivers.clock import ClockReading
from drivers.errors import DriverError
from drivers.link import SerialLink
from drivers.session_file.records import CLOCK
from drivers.urlhandlers.protocol_sim import register
from gse.config.station import Station
from gse.recording.recorder import Recorder
from gse.recording.session_format import EARTH_ORIENTATION, PROTOCOL, STATION, RecorderKind, clock_json
from gse.simulator.device import device_factory
from gse.values.instant import NS_PER_S
from protocols import Frame, FrameDecoder, Protocol, load_protocol

CLOCK_EVERY_NS = 60 * NS_PER_S
_RECEIVE_S = 0.2


@dataclass(frozen=True, slots=True)
class SimulatedRecording:
    """The bytes that the sensor sent, and what a full disk or a damaged file left of them, None where all is there."""

    bytes_sent: int
    damage: str | None


class Asker(Interface):
    """What asks the simulated sensor, between two rounds of receiving."""

    def came(self, panoramas: int, reconnects: int) -> None:
        """Panoramas came since the last call."""

    def wait_s(self) -> float:
        """How long a round may last."""


def record_simulation(
    path: Path,
    station: Station,
    station_text: str,
    orientation_json: str,
    *,
    asking: Callable[[SerialLink, Protocol], AbstractContextManager[Asker] | None] = lambda link, protocol: None,
) -> SimulatedRecording:
    """Record the simulated sensor of the station's port (a sim:// URL) from start to end.

    The clock readings say what is true: the simulated host's clock is right. The Earth orientation that a replay shall
    use is frozen in the session, as a live session does. UrlError where the URL is wrong: then nothing is left behind.
    """
    register(device_factory(station))
    protocol = load_protocol(station.protocol).with_addresses(station.port.address, station.port.host_address)
    recorder = Recorder(path, live=False, last_tries_s=0.0)
    try:
        link = SerialLink(station.port.url, station.port.baudrate, recorder=recorder)
    except DriverError:
        recorder.close()
        path.unlink()
        raise
    with recorder, link:
        recorder.attach(STATION, "application/yaml", station_text.encode())
        recorder.attach(PROTOCOL, "application/yaml", protocol.text.encode())
        recorder.attach(EARTH_ORIENTATION, "application/json", orientation_json.encode())
        with asking(link, protocol) or nullcontext() as asks:
            size = _record(link, recorder, FrameDecoder(protocol, from_sensor=True), asks)
    refused = [event.text for event in recorder.news() if event.kind == RecorderKind.LOST]
    return SimulatedRecording(size, "; ".join(filter(None, [recorder.damage, *refused])) or None)


def _record(link: SerialLink, recorder: Recorder, decoder: FrameDecoder, asks: Asker | None) -> int:
    size, clock_due_ns = 0, 0
    while not link.at_end:
        panoramas = 0
        for item in link.receive(asks.wait_s() if asks else _RECEIVE_S):
            if isinstance(item, Chunk):
                size += len(item.data)
                found = decoder.feed(item.data) if asks else ()
                panoramas += sum(isinstance(piece, Frame) and piece.type == "PANORAMA" for piece in found)
            if item.utc_ns >= clock_due_ns:
                clock_due_ns = item.utc_ns + CLOCK_EVERY_NS
                reading = ClockReading(item.utc_ns, item.mono_ns, "simulated", True, 0.0, 0.0)
                recorder.derived(CLOCK, item.utc_ns, clock_json(reading))
        if asks:
            asks.came(panoramas, 0)
    return size
