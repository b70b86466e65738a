"""``gse simulate``: write a simulated session."""

from functools import partial
from pathlib import Path

import click

from drivers.mock_ports import sim_url
from gse.cli import EXIT_DATA_LOST, folded
from gse.cli.options import out_option, station_option
from gse.config.choice import station_of
from gse.config.station import parse_station
from protocols import load_protocol


@click.command("simulate")
@click.option("--scenario", default="clear-zenith", show_default=True, help="Name of a scenario, or a YAML file.")
@click.option("--list", "as_list", is_flag=True, help="List the built-in scenarios.")
@station_option
@click.option("--seconds", type=click.FloatRange(min=0.001), help="Length of the session; default: as in the scenario.")
@click.option(
    "--rate-hz", type=click.FloatRange(0.001, 1000), help="Panoramas per second; default: as in the scenario."
)
@click.option("--start-utc", "start", help="UTC of the start, e.g. 2026-03-20T15:00:00Z; default: as in the scenario.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of noise and faults.")
@click.option(
    "--level",
    type=click.Choice(("panorama", "image", "image-sub-pixel")),
    default="panorama",
    show_default=True,
    help="Simulate lists of stars, or whole images and their extraction (slower).",
)
@click.option("--faults", help="Faults of cable and adapter, e.g. flip:1e-4,disconnect:12.5s/3s; see docs/simulator.md")
@click.option(
    "--file",
    "path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write to this new file instead of a session folder.",
)
@out_option
def command(
    *,
    scenario: str,
    as_list: bool,
    station_path: Path | None,
    seconds: float | None,
    rate_hz: float | None,
    start: str | None,
    seed: int,
    level: str,
    faults: str | None,
    path: Path | None,
    out: Path,
) -> None:
    """Write a simulated session. The same options give the same bytes.

    The session is written to a new folder in --out, or to --file; its path is printed on stdout. It contains the
    station file of the scenario. Replay it with gse replay.
    """
    from drivers.faults import parse_faults
    from gse.sessions.asking import asking_of
    from gse.sessions.live import new_session_folder
    from gse.simulator.device import scenario_of
    from gse.simulator.outlook import outlook
    from gse.simulator.recording import record_simulation
    from gse.simulator.scenario import load_scenario, scenario_names
    from gse.station.polling import check_asking
    from gse.truth import EarthOrientation

    if as_list:
        for name in scenario_names():
            click.echo(f"{name:20} {load_scenario(name).text}")
        return
    changes = {"scenario": scenario, "start": start, "rate_hz": rate_hz, "seed": seed, "level": level}
    options = {name: str(value) for name, value in changes.items() if value is not None}
    base, text = station_of(station_path)
    described = scenario_of(options, base)
    parse_faults({"faults": faults or "", "seed": str(seed)})
    if seconds is not None:
        options["frames"] = str(max(round(seconds * described.rate_hz), 1))
    text = described.station_text(text)
    station = parse_station(text, f"station of scenario {scenario}") if described.station else base
    port = station.port.model_copy(update={"url": sim_url(**options, faults=faults)})
    orientation = EarthOrientation.from_disk(described.start_utc_ns)
    if path is None:
        path = new_session_folder(out, f"{station.sensor.name}-{scenario}", described.start_utc_ns) / "session.mcap"
    check_asking(station.sensor, station.port, load_protocol(station.protocol))
    recording = record_simulation(
        path,
        station.model_copy(update={"port": port}),
        text,
        orientation.to_json(),
        asking=partial(asking_of, station.sensor),
    )
    click.echo(path)
    click.echo(f"{recording.bytes_sent} bytes of {scenario}: {described.text}", err=True)
    seen = outlook(described.device_for(station), described, "--start-utc chooses a night")
    click.echo(folded(seen, indent=2, err=True), err=True)
    if recording.damage:
        click.echo(f"gse: {recording.damage}", err=True)
        raise click.exceptions.Exit(EXIT_DATA_LOST)
