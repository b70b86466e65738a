"""The simulated sensor behind sim://: its bytes as a serial port of a busy host would give them."""

from collections import deque
from collections.abc import Callable

import numpy as np

from drivers.chunk import Chunk
from drivers.errors import UrlError
from drivers.uart import BITS_PER_BYTE
from gse.config.station import Station
from gse.errors import GseError
from gse.simulator.firmware import Detector, SensorFirmware, Transmission
from gse.simulator.own_answers import OwnAnswers
from gse.simulator.panorama import PanoramaSource
from gse.simulator.scenario import DEFAULT, Host, Scenario, check_start, load_scenario
from gse.values.instant import NS_PER_S
from protocols import load_protocol

OPTIONS = ("scenario", "seed", "frames", "start", "rate_hz", "standby", "level", "reset_s", "rates")
LEVELS = ("panorama", "image", "image-sub-pixel")
DEFAULT_SEED = 1
_IDLE_NS = 100_000_000
"""A silent sensor lets its time pass in steps of this length."""
_ASKED_NS = 10_000_000
"""And in shorter ones while it waits for a command."""
_READ_EVERY_NS = 8_000_000
"""A USB adapter hands over what has come every few milliseconds."""
_BOOTED_NS = 3600 * NS_PER_S
"""The host's monotonic clock at the start of the scenario."""


class SimulatedSensor:
    """A sensor and the host's side of its wire; chunks have the host's stamps, in simulated time."""

    def __init__(
        self, firmware: SensorFirmware, random: np.random.Generator, *, start_ns: int, end_ns: int, baudrate: int,
        jitter_ms: tuple[float, float], host: Host,
    ) -> None:  # fmt: skip
        self._firmware, self._random = firmware, random
        self._now_ns, self._end_ns = start_ns, end_ns
        self._start_ns, self._host = start_ns, host
        self._mono_minus_utc_ns = _BOOTED_NS - start_ns
        self._byte_ns = BITS_PER_BYTE * NS_PER_S // baudrate
        self._jitter_ns = (jitter_ms[0] * 1e6, jitter_ms[1] * 1e6)
        self._chunks: deque[Chunk] = deque()

    def next_chunk(self) -> Chunk | None:
        """The next bytes, an empty chunk while the sensor is silent, None when the scenario is over."""
        if not self._chunks:
            due_ns = self._firmware.due_ns
            idle_ns = self._now_ns + (_ASKED_NS if due_ns is None else _IDLE_NS)
            if min(idle_ns, due_ns if due_ns is not None else idle_ns) >= self._end_ns:
                return None
            if due_ns is None or due_ns > idle_ns:
                self._pass(idle_ns, b"")
            else:
                self._receive(self._firmware.step())
                if not self._chunks:
                    self._pass(max(due_ns, self._now_ns), b"")
        return self._chunks.popleft()

    def command(self, data: bytes, utc_ns: int) -> None:
        """Bytes that were sent to the sensor."""
        arrived_ns = max(utc_ns, self._now_ns) + len(data) * self._byte_ns
        self._receive(self._firmware.command(data, arrived_ns))

    def switch(self, *, on: bool) -> None:
        """Switch the sensor's supply."""
        self._chunks = deque(chunk._replace(data=b"") for chunk in self._chunks) if not on else self._chunks
        self._firmware.switch(self._now_ns, on=on)

    def _receive(self, transmissions: list[Transmission]) -> None:
        """Cut what is sent into what is read: each read takes the bytes that are complete by then."""
        for sent in transmissions:
            given, read_ns = 0, sent.start_ns + self._byte_ns
            while given < len(sent.data):
                read_ns = max(read_ns, self._now_ns) + round(self._random.uniform(*self._jitter_ns))
                complete = min((read_ns - sent.start_ns) // self._byte_ns, len(sent.data))
                if complete > given:
                    self._pass(read_ns, sent.data[given:complete])
                    given = complete
                read_ns = max(read_ns + _READ_EVERY_NS, sent.start_ns + (given + 1) * self._byte_ns)

    def _pass(self, utc_ns: int, data: bytes) -> None:
        self._now_ns = utc_ns
        fast_ns = round(self._host.fast_s((utc_ns - self._start_ns) / NS_PER_S) * NS_PER_S)
        self._chunks.append(Chunk(utc_ns + fast_ns, utc_ns + self._mono_minus_utc_ns, data))


def device_factory(station: Station) -> Callable[[dict[str, str]], SimulatedSensor]:
    """What makes simulated sensors for sim:// when the station file says ``station``.

    Options of the URL: ``scenario`` (a name or a YAML file), ``seed``, ``frames`` (exposures until the end), ``start``
    (RFC 3339 UTC), ``rate_hz``, ``standby`` (yes: the sensor waits for a command, which is the default where the
    station file has it asked), ``level`` (``panorama``, or the slower ``image`` and ``image-sub-pixel``: whole images,
    extracted), ``reset_s`` (the sensor restarts so many seconds after the start), ``rates`` (deg/s, at which the scene
    turns one after the other). UrlError otherwise, with what was expected.
    """

    def make(options: dict[str, str]) -> SimulatedSensor:
        unknown = sorted(set(options) - set(OPTIONS))
        if unknown:
            raise UrlError(f"sim://: unknown option {unknown[0]!r}; known are speed, cut, {', '.join(OPTIONS)}")
        try:
            scenario = scenario_of(options, station)
            return _sensor(station, scenario, options)
        except GseError as error:
            raise UrlError(f"sim://: {error}") from error

    return make


def scenario_of(options: dict[str, str], station: Station) -> Scenario:
    """The scenario with what the options change in it; UrlError or ConfigError otherwise."""
    scenario = load_scenario(options.get("scenario") or DEFAULT)
    if "rates" in options:
        scenario = scenario.at_rates(rates_of(options["rates"]), station)
    changes: dict[str, object] = {}
    if "start" in options:
        try:
            check_start(options["start"])
        except ValueError as error:
            raise UrlError(f"sim://: start: {error}") from error
        changes["start"] = options["start"]
    rate_hz = _number(options, "rate_hz", scenario.rate_hz, 0.001, 1000)
    frames = _whole(options, "frames", max(round(scenario.seconds * rate_hz), 1), 1, 10**9)
    if "reset_s" in options:
        resets_s = (*scenario.firmware.resets_s, _number(options, "reset_s", 0, 0, 1e9))
        changes["firmware"] = scenario.firmware.model_copy(update={"resets_s": resets_s})
    changes |= {"rate_hz": rate_hz, "seconds": frames / rate_hz, "exposure_s": min(scenario.exposure_s, 1 / rate_hz)}
    return scenario.model_copy(update=changes)


def rates_of(text: str) -> list[float]:
    """Rates of turn from a text like 0,0.1,0.5deg/s; none where it is no such text."""
    try:
        return [float(part) for part in text.strip().removesuffix("deg/s").split(",")]
    except ValueError:
        return []


def firmware_of(
    station: Station,
    scenario: Scenario,
    options: dict[str, str],
    detector: Detector,
    start_ns: int,
    *,
    is_test: bool = False,
) -> SensorFirmware:
    """The sensor's computer, from ``start_ns`` on, as ``seed`` and ``standby`` of the options say.

    Its stream says where it ``is_test``; sim:// is known by its port.
    """
    device = scenario.device_for(station)
    standby = options.get("standby", "yes" if device.sensor.start or device.sensor.poll else "no")
    if standby not in ("yes", "no"):
        raise UrlError(f"sim://: standby={standby} does not work: expected yes or no")
    protocol = load_protocol(device.protocol).with_addresses(device.port.address, device.port.host_address)
    answers = scenario.attitude.sends or not protocol.slots
    if answers and "ATTITUDE" not in protocol.types:
        wanted = "ATTITUDE, which the scenario sends" if protocol.slots else "PANORAMA: there is nothing to simulate"
        raise UrlError(f"sim://: the protocol {protocol.name} has no {wanted}")
    return SensorFirmware(
        protocol,
        detector,
        scenario.firmware,
        _generators(options)[1],
        start_ns=start_ns,
        exposure_s=scenario.exposure_s,
        period_s=None if standby == "yes" else 1 / scenario.rate_hz,
        baudrate=device.port.baudrate,
        own_answers=OwnAnswers(device, scenario, _generators(options)[3], start_ns) if answers else None,
        is_test=is_test,
        time=device.sensor.time,
    )


def _sensor(station: Station, scenario: Scenario, options: dict[str, str]) -> SimulatedSensor:
    start_ns = scenario.start_utc_ns
    return SimulatedSensor(
        firmware_of(station, scenario, options, detector_of(station, scenario, options), start_ns),
        _generators(options)[2],
        start_ns=start_ns,
        end_ns=start_ns + round(scenario.seconds * NS_PER_S),
        baudrate=scenario.device_for(station).port.baudrate,
        jitter_ms=scenario.firmware.host_jitter_ms,
        host=scenario.host,
    )


def _generators(options: dict[str, str]) -> list[np.random.Generator]:
    """Noise of the sky, of the sensor's computer, of the host and of the sensor's own answers, each its own."""
    return np.random.default_rng(_whole(options, "seed", DEFAULT_SEED, 0, 10**18 - 1)).spawn(4)


def detector_of(station: Station, scenario: Scenario, options: dict[str, str]) -> Detector:
    """What takes the exposures, as ``seed`` and ``level`` of the options say."""
    level, device, random = options.get("level", LEVELS[0]), scenario.device_for(station), _generators(options)[0]
    if level not in LEVELS:
        raise UrlError(f"sim://: level={level} does not work: expected one of {', '.join(LEVELS)}")
    drawn_for = scenario.station_for(station).screen
    if level == "panorama":
        return PanoramaSource(device, scenario, random, drawn_for=drawn_for)
    from gse.simulator.image import ImageSource  # numba takes a second to import

    return ImageSource(device, scenario, random, sub_pixel=level == "image-sub-pixel", drawn_for=drawn_for)


def _number(options: dict[str, str], name: str, default: float, least: float, most: float) -> float:
    try:
        value = float(options[name]) if name in options else default
    except ValueError:
        value = float("nan")
    if not least <= value <= most:
        raise UrlError(f"sim://: {name}={options.get(name, '')} does not work: expected a number {least:g} to {most:g}")
    return value


def _whole(options: dict[str, str], name: str, default: int, least: int, most: int) -> int:
    text = options.get(name, str(default))
    value = int(text) if text.isdecimal() and len(text) <= len(str(most)) else -1
    if not least <= value <= most:
        raise UrlError(f"sim://: {name}={text} does not work: expected a whole number from {least} to {most}")
    return value
