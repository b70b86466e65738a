"""The port sim://: a simulated sensor.

The simulation itself needs catalogue and camera, which the drivers do not know. The owner of both registers a factory
here, once, at start-up; the options of the URL go to it as they are, but those that are the port's own: ``speed``,
``cut``, ``faults``, ``frame_start``, ``ack_start`` (drivers/faults.py). ``seed`` serves both. A fault ``reset``
is the sensor's own affair and goes to it as ``reset_s``: what it sees after its restart is the sky of then.
"""

from collections.abc import Callable, Iterator
from typing import Protocol

from drivers.chunk import NS_PER_S, Chunk
from drivers.errors import PortError
from drivers.faults import inject, parse_faults
from drivers.mock_ports import Item, TimestampedSerial, parse_mock_url
from drivers.playback import cut

OWN_OPTIONS = ("speed", "cut", "faults", "frame_start", "ack_start")


class SimulatedDevice(Protocol):
    """Simulated device behind the port."""

    def next_chunk(self) -> Chunk | None:
        """The next bytes that the sensor sends, None when the scenario is over."""

    def command(self, data: bytes, utc_ns: int) -> None:
        """Bytes that were sent to the sensor at an instant of its own time."""

    def switch(self, *, on: bool) -> None:
        """Switch its supply."""


Factory = Callable[[dict[str, str]], SimulatedDevice]

_factories: list[Factory] = []


def register(factory: Factory) -> None:
    """Set the factory of simulated sensors; the last one counts."""
    _factories[:] = [factory]


class Serial(TimestampedSerial):
    """A simulated sensor behind the interface of a serial port."""

    def _open_items(self) -> tuple[Iterator[Item], float]:
        url = parse_mock_url(str(self.port))
        if not _factories:
            raise PortError(
                "sim:// needs a simulator, and none is registered: use it through 'gse run' or 'gse simulate'"
            )
        speed, most = url.speed(), url.number("cut", 0, least=1)
        faults = parse_faults(url.options)
        options = {name: value for name, value in url.options.items() if name not in OWN_OPTIONS}
        if faults is not None and faults.reset_after_ns is not None:
            options["reset_s"] = repr(faults.reset_after_ns / NS_PER_S)
        self._device = _factories[0](options)
        items: Iterator[Item] = iter(self._device.next_chunk, None)
        if faults is not None:
            items = inject(items, faults, int(self.baudrate), device_resets=True)
        return (cut(items, most) if most else items), speed

    def switch(self, *, on: bool) -> None:
        """Switch the supply of the simulated sensor."""
        self._device.switch(on=on)

    def _take(self, data: bytes) -> None:
        self._device.command(data, self.stamp()[0])
