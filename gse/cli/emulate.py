"""``gse emulate``: the simulated sensor, or a recorded session, on a pty, a TCP port or a serial port."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from drivers.clock import read_clock
from drivers.ports import is_mock
from drivers.uart import BITS_PER_BYTE
from gse.cli import folded
from gse.cli.options import gathered, parsed_duration, station_option
from gse.config.choice import station_of
from gse.config.station import Port
from gse.errors import UsageError
from gse.process import terminal
from gse.values.instant import NS_PER_S, to_text
from protocols import load_protocol

if TYPE_CHECKING:
    from gse.simulator.emulator import Endpoint


_LAST_PORT = 65535
_OF_THE_SIMULATION = ("station_path", "scenario", "rate_hz", "standby", "start", "dark", "level")
"""What a recorded session says itself."""
_NO_MARK = (
    "nothing in this format says that the frames come from no detector: sessions with them are not marked SIMULATED; "
    "the mark is a header flag `test`, or `serial` in STATUS"
)


@dataclass(frozen=True, slots=True)
class Simulation:
    """What the simulated sensor sees and sends."""

    scenario: str
    rate_hz: float | None
    standby: bool
    start: str | None
    dark: bool
    level: str

    def options(self, seed: int) -> dict[str, str]:
        """As those of a sim:// URL."""
        options = {"scenario": self.scenario, "seed": str(seed), "start": self.start or to_text(read_clock().utc_ns, 9)}
        options |= {"level": self.level, **({"standby": "yes"} if self.standby else {})}
        return options | ({"rate_hz": str(self.rate_hz)} if self.rate_hz else {})


@click.command("emulate")
@click.option("--pty", "use_pty", is_flag=True, help="Use a new pseudo-terminal.")
@click.option(
    "--tcp", "tcp_address", metavar="HOST:PORT", help="Use a TCP port, e.g. 127.0.0.1:4000; port 0 is any free port."
)
@click.option("--port", "port_url", metavar="DEVICE", help="Use a serial port, whose other end the other program has.")
@click.option(
    "--session",
    "session_path",
    type=click.Path(path_type=Path, exists=True),
    help="Play this recorded session instead, with the same bytes at the recorded pace.",
)
@click.option(
    "--shift",
    type=click.Choice(("now",)),
    help="With --session: time tags, counters and checksums made anew for now, marked as test data.",
)
@click.option("--faults", help="With --session: faults of the cable, as of sim://, e.g. flip:1e-5,drop_frame:0.01.")
@station_option
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of the noise.")
@gathered(
    "simulation",
    Simulation,
    click.option("--scenario", default="clear-zenith", show_default=True, help="Name of a scenario, or a YAML file."),
    click.option(
        "--rate-hz", type=click.FloatRange(0.001, 1000), help="Panoramas per second; default: as in the scenario."
    ),
    click.option("--standby", is_flag=True, help="Wait for the command START before sending."),
    click.option("--start-utc", "start", help="UTC of the simulated sky, e.g. 2026-03-20T15:00:00Z; default: now."),
    click.option("--dark", is_flag=True, help="Leave the light of the Sun out: stars at any hour, where they are now."),
    click.option(
        "--level",
        type=click.Choice(("panorama", "image", "image-sub-pixel")),
        default="panorama",
        show_default=True,
        help="Simulate lists of stars, or whole images and their extraction (slower).",
    ),
)
@click.option(
    "--duration",
    "duration_s",
    metavar="TIME",
    callback=parsed_duration,
    help="End after this time: 90, 90s, 5m, 1h30m.",
)
@click.pass_context
def command(
    ctx: click.Context,
    *,
    use_pty: bool,
    tcp_address: str | None,
    port_url: str | None,
    session_path: Path | None,
    shift: str | None,
    faults: str | None,
    station_path: Path | None,
    simulation: Simulation,
    seed: int,
    duration_s: float | None,
) -> None:
    """Simulate the sensor of a station file in real time, for this station or for other ground software.

    With --session a recorded night is played to a flight computer. It begins when somebody opens the other end,
    and on a --pty sets a baud rate.

    The frames bear the flag `test`, so that no session with them passes for one of a sensor: it is SIMULATED. Where
    the format has no room for a mark, the command says so. The address to open is printed on stdout. The emulator ends
    with Ctrl-C or after --duration.
    """
    if use_pty + (tcp_address is not None) + (port_url is not None) != 1:
        raise UsageError("give either --pty or --tcp HOST:PORT or --port DEVICE, for example --tcp 127.0.0.1:4000")

    def open_endpoint(of_station: Port) -> "Endpoint":
        return _endpoint(tcp_address, port_url, of_station)

    if session_path is None:
        if shift or faults:
            raise UsageError("--shift and --faults are for a recorded session: give --session too")
        _simulate(simulation, station_path, seed, open_endpoint, duration_s)
        return
    given = [name for name in _OF_THE_SIMULATION if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE]
    if given:
        options_given = [param.opts[-1] for param in ctx.command.params if param.name in given]
        raise UsageError(f"a session has its own station and sky: leave out {', '.join(options_given)}")
    _play(session_path, open_endpoint, shift, faults, seed, duration_s)


def _simulate(
    simulation: Simulation,
    station_path: Path | None,
    seed: int,
    open_endpoint: Callable[[Port], "Endpoint"],
    duration_s: float | None,
) -> None:
    """Be the sensor of a station under a scenario's sky, until Ctrl-C or for a time."""
    from gse.simulator.device import detector_of, firmware_of, scenario_of
    from gse.simulator.emulator import Emulator
    from gse.simulator.outlook import outlook

    options = simulation.options(seed)
    station, _ = station_of(station_path)
    session = scenario_of(options, station)
    if simulation.dark:
        session = session.model_copy(update={"air": session.air.model_copy(update={"sunlight": False})})
    device = session.device_for(station)
    detector = detector_of(station, session, options)
    # A first exposure, which is not sent, loads catalogue, ephemeris and Earth orientation.
    seen = detector.expose(session.start_utc_ns, session.exposure_s, session.firmware.temperature_c[0])
    began_ns = read_clock().utc_ns
    offset_ns = session.start_utc_ns - began_ns if simulation.start else 0
    firmware = firmware_of(station, session, options, detector, began_ns + offset_ns, is_test=True)
    endpoint = open_endpoint(device.port)
    click.echo(endpoint.address)
    sky = outlook(device, session, "--start-utc chooses a night, --dark leaves the Sun's light out")
    click.echo(folded(sky, indent=2, err=True), err=True)
    click.echo(f"{device.sensor.name} sends {device.protocol}; press Ctrl-C to end", err=True)
    protocol = load_protocol(device.protocol)
    if not (protocol.test_flag or protocol.has_serial):
        click.echo(folded(_NO_MARK, indent=2, err=True), err=True)
    carried, needed = device.port.baudrate / BITS_PER_BYTE, firmware.bytes_per_s(seen)
    if needed > carried:
        too_much = (
            f"the line carries {carried:,.0f} bytes/s at {device.port.baudrate} baud, and this sensor has "
            f"{needed:,.0f} to send: panoramas are left out; lower --rate-hz or raise port.baudrate"
        )
        click.echo(folded(too_much, indent=2, err=True), err=True)
    terminal.end_sign()
    try:
        now_ns: Callable[[], int] = lambda: read_clock().utc_ns + offset_ns  # noqa: E731
        Emulator(firmware, endpoint, now_ns, baudrate=device.port.baudrate).run(
            lambda: duration_s is not None and read_clock().utc_ns > began_ns + duration_s * NS_PER_S
        )
    finally:
        endpoint.close()


def _play(
    path: Path,
    open_endpoint: Callable[[Port], "Endpoint"],
    shift: str | None,
    faults: str | None,
    seed: int,
    duration_s: float | None,
) -> None:
    """Play a recorded session until its end, or for a time."""
    from gse.sessions.played import play, played_session

    recording = played_session(path, is_shifted=shift is not None, faults=faults, seed=seed)
    endpoint = open_endpoint(recording.port)
    click.echo(endpoint.address)
    click.echo(f"{path}: {recording.words}; press Ctrl-C to end", err=True)
    terminal.end_sign()
    began_ns = read_clock().mono_ns
    try:
        sent = play(
            recording.items,
            endpoint,
            lambda: read_clock().mono_ns,
            lambda: duration_s is not None and read_clock().mono_ns > began_ns + duration_s * NS_PER_S,
            baudrate=recording.port.baudrate,
        )
    finally:
        endpoint.close()
    left_out = recording.frames.left_out if recording.frames else 0
    also = f"; {left_out} frames cannot be made anew and were left out" if left_out else ""
    click.echo(f"{sent} bytes played{also}", err=True)


def _endpoint(tcp_address: str | None, port_url: str | None, of_station: Port) -> "Endpoint":
    from gse.simulator.emulator import PortEndpoint, TcpEndpoint

    if port_url is not None:
        if is_mock(port_url):
            raise UsageError(f"--port {port_url} is no cable; expected for example /dev/ttyUSB1")
        return PortEndpoint(port_url, of_station.baudrate, of_station.line)
    if tcp_address is None:
        return _pty_endpoint()
    host, _, port = tcp_address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > _LAST_PORT:
        raise UsageError(f"--tcp {tcp_address} is not an address; expected for example 127.0.0.1:4000")
    return TcpEndpoint(host.strip("[]"), int(port))


def _pty_endpoint() -> "Endpoint":
    try:
        from gse.simulator.pty_endpoint import PtyEndpoint
    except ImportError as error:
        raise UsageError("this system has no pseudo-terminals; give an address, e.g. --tcp 127.0.0.1:4000") from error
    return PtyEndpoint()
