"""``gse procedure``: run a test by its steps, check its file, write one to start from."""

from importlib import resources
from pathlib import Path

import click

from drivers.host_files import write_whole
from gse.cli.finish import Printed, printed
from gse.cli.live_outputs import LiveOptions, live_options
from gse.cli.options import duration_text, out_option, plots_option, station_option
from gse.cli.run import Asked, run_session, say_line, simulated_for
from gse.config.choice import station_of
from gse.config.station import Station
from gse.errors import ConfigError, UsageError
from gse.procedure.desk import Desk, read_answers, terminal_of_operator
from gse.procedure.engine import Run
from gse.procedure.file import Procedure, check, duration_s, read_procedure, runs_of
from gse.station.setup import protocol_of
from gse.values.screen import Shown
from gse.values.text import count_text
from protocols import Protocol

_MOST_PROBLEMS = 10

_EXAMPLES = ("functional", "acquisition", "night")


@click.group("procedure")
def command() -> None:
    """Run a test by the steps of a file, check such a file, or write one to start from."""


@command.command()
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@station_option
@click.option("--from", "first", metavar="STEP", default="1", help="Begin at this step; those before are not done.")
@click.option("--answers", "answers_path", type=click.Path(path_type=Path), help="YAML file of the operator's answers.")
@click.option("--operator", "operator_name", metavar="NAME", help="Who runs it; default: that of the station file.")
@live_options
@plots_option
@printed
@out_option
@click.pass_context
def run(
    ctx: click.Context,
    *,
    path: Path,
    station_path: Path | None,
    first: str,
    answers_path: Path | None,
    operator_name: str | None,
    live: LiveOptions,
    plots: bool,
    printed: Printed,
    out: Path,
) -> None:
    """Run the steps of FILE in one session, with one report; the cleanup is done whatever happens.

    The operator answers here, or on the page of --view web. The exit code is the verdict's.
    """
    procedure, station, text, _ = _checked(path, station_path)
    if first not in [step.number for step in procedure.steps]:
        raise UsageError(f"--from {first}: expected a step from 1 to {len(procedure.steps)}")
    answers = read_answers(answers_path) if answers_path else None
    shown: list[Shown] = []
    if station.port.url.startswith("sim://"):
        station, text = simulated_for(station, text, procedure, shown)
    desk = Desk(
        name=operator_name or station.test.operator or "",
        terminal=terminal_of_operator(),
        page=live.view == "web",
        answers=answers,
    )
    one = Run(procedure, desk, first=first, say=say_line)
    ctx.exit(run_session(station, text, Asked(live, printed, out, plots=plots), shown=shown, procedure=one))


@command.command("check")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
def check_command(path: Path) -> None:
    """Check every step of FILE against its station file and description, and say how long the run takes."""
    procedure, station, _, protocol = _checked(path, None)
    least_s, longest_s = duration_s(procedure.steps, protocol, station.power.settle_s if station.power else 0.0)
    asked = sum(step.planned.startswith(("tell:", "ask:")) for step in procedure.all_steps())
    click.echo(f"{path}: {procedure.name}")
    rounds = runs_of(procedure.steps)
    of_rounds = f" ({rounds} with the rounds of repeats)" if rounds != len(procedure.steps) else ""
    click.echo(f"steps: {len(procedure.steps)}{of_rounds}, cleanup: {len(procedure.cleanup)}")
    beside = f", and what the operator takes for {count_text(asked, 'answer')}" if asked else ""
    click.echo(f"time: {duration_text(least_s)} to {duration_text(longest_s)}{beside}")
    click.echo(f"station: {station.sensor.name} on {station.port.url}, {station.protocol}")


@command.command()
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.argument("like", metavar="[EXAMPLE]", type=click.Choice(_EXAMPLES), default=_EXAMPLES[0])
def init(path: Path, like: str) -> None:
    """Write a procedure to start from: the EXAMPLE functional, acquisition or night."""
    if path.exists():
        raise UsageError(f"{path} exists; give another name, or remove it")
    text = resources.files("gse.procedure").joinpath("examples", f"{like}.yaml").read_text(encoding="utf-8")
    try:
        write_whole(path, [text])
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
    click.echo(f"{path} is written; edit it, then: gse procedure check {path}")


def _checked(path: Path, station_path: Path | None) -> tuple[Procedure, Station, str, Protocol]:
    """The procedure with its station and the protocol; ConfigError where it names what they do not know."""
    procedure = read_procedure(path)
    station, text = station_of(station_path or procedure.station)
    protocol = protocol_of(station)
    if problems := check(procedure, station, protocol):
        more = [f"and {len(problems) - _MOST_PROBLEMS} more"] if len(problems) > _MOST_PROBLEMS else []
        raise ConfigError("\n".join([*problems[:_MOST_PROBLEMS], *more]))
    return procedure, station, text, protocol
