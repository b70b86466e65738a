"""``gse procedure``: run a test by its steps, check its file, write one to start from."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivers.errors import DriverError
from drivers.mock.urls import parse_mock_url
from drivers.session_file.reader import read_capture
from drivers.session_file.records import EVENTS, RecordedMessage
from drivers.whole_file import write_whole
from gse.cli.finish import Printed, printed, show_report
from gse.cli.live_outputs import LiveOptions, LiveOutputs, live_options
from gse.cli.options import out_option, plots_option, station_option
from gse.cli.run import OneSession, say_line, simulated, waits_for_reader
from gse.config.choice import station_of
from gse.config.edit import with_values
from gse.config.station import Station
from gse.errors import ConfigError, UsageError
from gse.procedure.file import Procedure, check, duration_s, parse_procedure, read_procedure, runs_of
from gse.process import terminal
from gse.sessions.live import Ending
from gse.sessions.status_file import is_unfinished, session_folders
from gse.station.events import StationKind
from gse.station.notes import Notes
from gse.station.setup import addressed
from gse.values.shown import Shown
from gse.values.text import count_text
from protocols import Protocol, load_protocol

if TYPE_CHECKING:
    from gse.procedure.engine import Run
    from gse.sessions.live import LiveSession
    from gse.station.loop import Listener, StationLoop
    from gse.view.live_state import LiveState

_SPARE_S = 60.0
"""A simulated sensor goes on for so long after the longest time that the steps take."""
_MOST_PROBLEMS = 10

_FIRST = """\
# A procedure: steps that are done one after the other, and a cleanup that is done whatever happened.
# Run it:    gse procedure run {name}
# Check it:  gse procedure check {name}
version: 1
name: {title}
station: {station}          # a station file, relative to this file
steps:
  - tell: Take the cap off.                                      # the operator confirms
  - ask: {{label: serial, text: Serial number on the housing}}     # expect: a pattern, such as "SN \\\\d+"
  - wait: {{until: {{state: acquired}}, at_most: 60s}}               # or: {{for: 5s}}
  - check: {{stars: [4, null]}}                                    # items with a value, or [low, high]
  - watch: {{for: 2 min, limits: {{d_ra_cosde_arcsec: 60}}}}         # judged as a session is
# - power: on                                                    # where the station file has power: {{on, off}}
# - send: {{command: SET_EXPOSURE, exposure: 200 ms}}
# - repeat: {{times: 30, steps: [..]}}
cleanup:
  - wait: {{for: 1s}}
"""


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
    from gse.procedure.desk import Desk, read_answers, terminal_of_operator
    from gse.procedure.engine import Run

    procedure, station, text, _ = _checked(path, station_path)
    if first not in [step.number for step in procedure.steps]:
        raise UsageError(f"--from {first}: expected a step from 1 to {len(procedure.steps)}")
    answers = read_answers(answers_path) if answers_path else None
    shown: list[Shown] = []
    if station.port.url.startswith("sim://"):
        station, text = simulated(*_long_enough(station, text, procedure), shown)
    desk = Desk(
        name=operator_name or station.test.operator or "",
        show=lambda words: say_line(f"\a{words}") if words else None,
        terminal=terminal_of_operator() if answers is None else None,
        page=live.view == "web",
        answers=answers,
    )
    run_procedure(
        ctx,
        station,
        text,
        Run(procedure, desk, first=first, say=say_line),
        live,
        printed,
        out,
        plots=plots,
        shown=shown,
    )


@command.command("check")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
def check_command(path: Path) -> None:
    """Check every step of FILE against its station file and description, and say how long the run takes."""
    procedure, station, _, _ = _checked(path, None)
    least_s, longest_s = duration_s(procedure.steps, station.power.settle_s if station.power else 0.0)
    asked = sum(step.planned.startswith(("tell:", "ask:")) for step in procedure.all_steps())
    click.echo(f"{path}: {procedure.name}")
    rounds = runs_of(procedure.steps)
    of_rounds = f" ({rounds} with the rounds of repeats)" if rounds != len(procedure.steps) else ""
    click.echo(f"steps: {len(procedure.steps)}{of_rounds}, cleanup: {len(procedure.cleanup)}")
    beside = f", and what the operator takes for {count_text(asked, 'answer')}" if asked else ""
    click.echo(f"time: {_time(least_s)} to {_time(longest_s)}{beside}")
    click.echo(f"station: {station.sensor.name} on {station.port.url}, {station.protocol}")


@command.command()
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
def init(path: Path) -> None:
    """Write a procedure with one step of each kind to start from."""
    if path.exists():
        raise UsageError(f"{path} exists; give another name, or remove it")
    text = _FIRST.format(name=path, title=path.stem, station="station.yaml")
    if not (path.parent / "station.yaml").exists():
        text = text.replace("station: station.yaml ", "# station: station.yaml ")
    try:
        write_whole(path, [text])
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
    click.echo(f"{path} is written; edit it, then: gse procedure check {path}")


def _checked(path: Path, station_path: Path | None) -> tuple[Procedure, Station, str, Protocol]:
    """The procedure with its station and the protocol; ConfigError where it names what they do not know."""
    procedure = read_procedure(path)
    station, text = station_of(station_path or procedure.station)
    protocol = addressed(load_protocol(station.protocol), station)
    if problems := check(procedure, station, protocol):
        more = [f"and {len(problems) - _MOST_PROBLEMS} more"] if len(problems) > _MOST_PROBLEMS else []
        raise ConfigError("\n".join([*problems[:_MOST_PROBLEMS], *more]))
    return procedure, station, text, protocol


def _long_enough(station: Station, text: str, procedure: Procedure) -> tuple[Station, str]:
    """The station with a simulated sensor that goes on until the last step is done."""
    from gse.simulator.device import scenario_of

    url = station.port.url
    options = parse_mock_url(url).options
    if "frames" in options:
        return station, text
    _, longest_s = duration_s((*procedure.steps, *procedure.cleanup))
    own = {name: value for name, value in options.items() if name in ("scenario", "rate_hz", "start")}
    frames = max(round((longest_s + _SPARE_S) * scenario_of(own, station).rate_hz), 1)
    url += f"{'&' if '?' in url else '?'}frames={frames}"
    return station.model_copy(update={"port": station.port.model_copy(update={"url": url})}), with_values(
        text, "port", {"url": url}
    )


def run_procedure(
    ctx: click.Context,
    station: Station,
    text: str,
    procedure: "Run",
    live: LiveOptions,
    printed: Printed,
    out: Path,
    *,
    plots: bool,
    shown: Sequence[Shown] = (),
) -> None:
    """Run a procedure in a session, report on it, and end with the exit code of the verdict."""
    from gse.sessions.live import Operator, run_live

    _say_how_power_was_left(out)
    session, notes, waiting = OneSession(None), Notes(), list(shown)
    outputs = LiveOutputs(live, notes=notes)

    def taken() -> Sequence[Shown]:
        found, waiting[:] = list(waiting), []
        return found

    def listeners(loop: "StationLoop", folder: Path, state: "LiveState") -> "Sequence[Listener]":
        procedure.desk.on_page = lambda words: setattr(state, "question", words)
        return outputs.listeners(loop, folder, state)

    def receive() -> "LiveSession":
        received = run_live(
            station,
            text,
            out,
            Operator(ending, say_line, session.opened, session.terminal_news, notes, taken),
            make_listeners=listeners,
            procedure=procedure,
        )
        outputs.enter_judging()
        return received

    with Ending(say_line, rest_s=_REST_S) as ending, terminal.queued(waits_for_reader(station, ending)), outputs:
        report, found = session.run(receive, ending, None, plots=plots)
        if report:
            outputs.conclude(report)
        terminal.settle()
        if report:
            show_report(report, session.folder or out, printed, json_frames=live.json_frames)
        terminal.settle()
        ctx.exit(session.finish(report, found))


_STARTS = """\
version: 1
name: {times} starts
steps:
  - repeat:
      times: {times}
      steps:
        - power: off
        - wait: {{for: {off_s:g}s}}
        - power: on
        - wait: {{until: {{state: acquired}}, at_most: 2 min, measure: first_fix_s}}
          on_failure: go on
{check}cleanup:
  - power: on
"""
_SHARE = 0.95
"""Of the starts, which must keep limits.first_fix_s."""


def run_starts(
    ctx: click.Context,
    station: Station,
    text: str,
    times: int,
    off_s: float,
    live: LiveOptions,
    printed: Printed,
    out: Path,
    *,
    plots: bool,
) -> None:
    """Switch the sensor off and on again and again, and judge its first fix: a procedure of one repeat."""
    from gse.procedure.desk import Desk
    from gse.procedure.engine import Run

    limit_s = station.limits.first_fix_s
    asked = f"  - check: {{first_fix_s: {{share: {_SHARE}, at_most: {limit_s:g}}}}}\n" if limit_s else ""
    procedure = parse_procedure(_STARTS.format(times=times, off_s=off_s, check=asked), "--starts")
    protocol = addressed(load_protocol(station.protocol), station)
    if problems := check(procedure, station, protocol):
        raise UsageError(problems[0])
    shown: list[Shown] = []
    if station.port.url.startswith("sim://"):
        station, text = simulated(*_long_enough(station, text, procedure), shown)
    one = Run(procedure, Desk(name=station.test.operator or ""), say=say_line)
    run_procedure(ctx, station, text, one, live, printed, out, plots=plots, shown=shown)


_REST_S = 600.0
"""After a signal the cleanup is done first: programs of the supply may take long."""


def _say_how_power_was_left(out: Path) -> None:
    """Of the newest run that ended without a report: whether the supply is on, as its events say."""
    unfinished = [folder for folder in session_folders(out) if is_unfinished(folder)]
    with contextlib.suppress(DriverError, OSError):
        for folder in unfinished[-1:]:
            records = read_capture(folder / "session.mcap", only=(EVENTS,))
            kinds = [record.event().kind for record in records if isinstance(record, RecordedMessage)]
            turns = [kind for kind in kinds if kind in (StationKind.POWER_ON, StationKind.POWER_OFF)]
            if turns:
                word = "on" if turns[-1] == StationKind.POWER_ON else "off"
                say_line(f"the run in {folder} ended without a report: its last power command was {word}")


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
