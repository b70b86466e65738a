"""``gse run``: the live test of a sensor, real or simulated."""

import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.clock import read_clock
from drivers.errors import DriverError
from drivers.host_files import APPEND, READ
from drivers.mock_ports import parse_mock_url, sim_url
from drivers.ports import is_mock
from drivers.session_file.reader import read_capture
from drivers.session_file.records import EVENTS, RecordedMessage
from gse.cli import EXIT_DATA_LOST, EXIT_INTERRUPTED, exit_code_of, unexpected
from gse.cli.finish import (
    Applied,
    Printed,
    applied,
    conclude,
    judge_as_stated,
    printed,
    say_exit_code,
    show_path,
    show_report,
)
from gse.cli.live_outputs import LiveOptions, LiveOutputs, live_options
from gse.cli.options import (
    clock_error_option,
    earth_orientation_option,
    identifier_option,
    out_option,
    parsed_duration,
    plots_option,
    station_option,
)
from gse.cli.screen import scene_option, served, stage_of
from gse.config.choice import station_of, with_identifier, with_url
from gse.config.station import Sensor, Station
from gse.errors import GseError, UsageError
from gse.procedure.desk import Desk
from gse.procedure.engine import Run
from gse.procedure.file import Procedure, check, duration_s, exposure_range_s, parse_procedure
from gse.process import terminal
from gse.sessions import night
from gse.sessions.live import REST_S, Ending, LiveSession, Operator, run_live, told_once
from gse.sessions.night import run_every_night
from gse.sessions.status_file import StatusFile, is_unfinished, session_folders
from gse.station.events import Notes, StationKind
from gse.station.loop import Listener, StationLoop
from gse.station.polling import check_asking
from gse.station.setup import protocol_of
from gse.truth.orientation import GivenTables
from gse.values import instant
from gse.values.instant import NS_PER_S
from gse.values.screen import Shown
from gse.view.live_state import LiveState
from protocols import load_protocol
from protocols.errors import ProtocolError

if TYPE_CHECKING:
    from gse.sessions.screen import Stage


# Detached start: the session runs in a process without a terminal.
#
# Until its port is open, that process writes to the terminal, so that errors at the start are visible; afterwards to
# run.log in the session folder. A log of 16 MiB becomes run.1.log, in the place of the one before, and a new one
# begins: a week of --json-frames must not take the disk of the session.

LOG_NAME, OLDER_LOG_NAME = "run.log", "run.1.log"
MOST_LOG_BYTES = 16 << 20
"""Without --json-frames, two weeks."""


class Detachment:
    """The detached process: it has no controlling terminal and gets no hang-up."""

    def __init__(self, report_fd: int) -> None:
        self._report_fd = report_fd
        self._folder: Path | None = None

    def into(self, folder: Path) -> None:
        """Write stdout and stderr to the log of this session, and let the starting process exit."""
        self._folder = folder
        nothing = os.open(os.devnull, READ)
        os.dup2(nothing, 0)
        os.close(nothing)
        _write_to(folder / LOG_NAME)
        os.write(self._report_fd, json.dumps({"folder": str(folder), "pid": os.getpid()}).encode())
        os.close(self._report_fd)

    def keep_small(self) -> None:
        """Begin a new log where this one is long; where that fails, the old one goes on."""
        if self._folder is None or os.fstat(1).st_size < MOST_LOG_BYTES:
            return
        with contextlib.suppress(OSError):
            os.replace(self._folder / LOG_NAME, self._folder / OLDER_LOG_NAME)
            _write_to(self._folder / LOG_NAME)


def _write_to(path: Path) -> None:
    """Have stdout and stderr written to a file."""
    log = os.open(path, APPEND, 0o644)
    for fd in (1, 2):
        os.dup2(log, fd)
    os.close(log)


def detach() -> Detachment:
    """Continue in a detached process. The starting one never returns: it exits with 0 once the session runs.

    To be called before threads are started: a fork copies only the calling thread. Ports are opened with O_NOCTTY, so
    that none of them becomes the terminal of the new process.
    """
    if not hasattr(os, "fork"):
        raise UsageError("--detach needs a POSIX system; leave it out and keep the window of the session open")
    terminal.end_sign()
    read_fd, write_fd = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read_fd)
        os.setsid()
        return Detachment(write_fd)
    os.close(write_fd)
    try:
        with open(read_fd, "rb") as pipe:
            started = pipe.read()
    except KeyboardInterrupt:
        os.kill(pid, signal.SIGTERM)
        raise
    if not started:
        raise click.exceptions.Exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
    _say_where(json.loads(started))
    raise click.exceptions.Exit(0)


def _say_where(started: dict[str, str]) -> None:
    folder = started["folder"]
    click.echo(f"session: {folder}")
    click.echo(f"process: {started['pid']}")
    click.echo(f"status: gse status {folder}")
    click.echo(f"messages: tail -F {folder}/{LOG_NAME}")
    click.echo(f"end: gse status --stop {folder}")


_MOST_LISTED = 3
"""Most unfinished sessions listed; of further ones only the number."""


@click.command("run")
@click.argument("station_given", metavar="[STATION]", required=False, type=click.Path(path_type=Path))
@station_option
@click.option("--port", "url", metavar="URL", help="Another port: /dev/ttyUSB0, sim://?speed=10")
@identifier_option
@click.option(
    "--duration",
    "duration_s",
    metavar="TIME",
    callback=parsed_duration,
    help="Stop after this time: 90, 5m, 1h30m.",
)
@click.option("--from", "from_text", metavar="TIME", help="Begin then: dusk, dusk+20m, or UTC.")
@click.option("--until", "until_text", metavar="TIME", help="End then: dawn, dawn-10m, or UTC.")
@click.option(
    "--every",
    type=click.Choice(("night",)),
    help="A session each night, from dusk until dawn.",
)
@click.option("--starts", type=click.IntRange(1, 200), help="Switch the sensor off and on so often; first fix of each.")
@click.option(
    "--off",
    "off_s",
    metavar="TIME",
    callback=parsed_duration,
    help="With --starts: off so long: 5s.",
)
@live_options
@scene_option
@click.option(
    "--rates",
    metavar="LIST",
    help="Turn the scene at one rate after the other, 60 s each: 0,0.1,0.2,0.5,1,2deg/s",
)
@click.option("--wait-port", is_flag=True, help="Wait for the port if it does not exist yet.")
@click.option("--detach", "detached", is_flag=True, help="Run without this terminal: gse status.")
@clock_error_option
@earth_orientation_option
@plots_option
@printed
@out_option
@click.pass_context
def command(
    ctx: click.Context,
    *,
    station_given: Path | None,
    station_path: Path | None,
    url: str | None,
    identifier: str | None,
    duration_s: float | None,
    from_text: str | None,
    until_text: str | None,
    every: str | None,
    starts: int | None,
    off_s: float | None,
    live: LiveOptions,
    scene: str | None,
    rates: str | None,
    wait_port: bool,
    detached: bool,
    clock_error_s: float | None,
    given_orientation: GivenTables | None,
    plots: bool,
    printed: Printed,
    out: Path,
) -> None:
    """Receive, record, identify, compare, show, judge.

    STATION is a station file; without one a simulated sensor is tested for 60 s. Ctrl-C ends the session; the exit code
    is the verdict's.
    """
    station, text = _station(station_given, station_path, url, identifier)
    if until_text is not None and duration_s is not None:
        raise UsageError("--until and --duration both say when the session ends; give one")
    if every is not None:
        if detached:
            raise UsageError("--every night needs its process; leave out --detach, and start it by systemd or nohup")
        ctx.exit(run_every_night(sys.argv[1:], out, say_line))
    sweeps = bool(station.sensor.exposures_s) and not station.port.url.startswith("replay://")
    if (starts is not None or sweeps) and any((duration_s, from_text, until_text, scene, rates, detached, wait_port)):
        raise UsageError(
            f"{'--starts' if starts else 'sensor.exposures_s'} is a session of its own: leave out --duration, "
            "--from, --until, --scene, --rates, --detach and --wait-port"
        )
    asked = Asked(
        live,
        printed,
        out,
        plots=plots,
        detachment=detach() if detached else None,
        duration_s=duration_s,
        from_text=from_text,
        until_text=until_text,
        wait_port=wait_port,
        clock_error_s=clock_error_s,
        given_orientation=given_orientation,
    )
    if starts is not None:
        ctx.exit(run_starts(station, text, starts, off_s or 5.0, asked))
    if sweeps:
        ctx.exit(run_sweep(station, text, asked))
    ctx.exit(_run_before(scene, rates, station, text, asked))


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What the command line asks of a session beside its station: how it is shown, when it begins and ends."""

    live: LiveOptions = field(kw_only=False)
    printed: Printed = field(kw_only=False)
    out: Path = field(kw_only=False)
    plots: bool
    detachment: Detachment | None = None
    duration_s: float | None = None
    from_text: str | None = None
    until_text: str | None = None
    wait_port: bool = False
    clock_error_s: float | None = None
    given_orientation: GivenTables | None = None


def run_session(
    station: Station,
    text: str,
    asked: Asked,
    *,
    shown: Sequence[Shown] = (),
    stage: "Stage | None" = None,
    procedure: Run | None = None,
) -> int:
    """Run, judge and report one session; returns the exit code of its verdict.

    What stands before the sensor is ``shown`` in a simulation, and planned by the ``stage`` of a screen. The steps of a
    ``procedure`` are done in it.
    """
    session, notes = OneSession(asked.detachment), Notes()
    outputs, alarmed = LiveOutputs(asked.live, notes=notes), contextlib.ExitStack()

    def listeners(loop: StationLoop, folder: Path, live: LiveState) -> Sequence[Listener]:
        def show(words: str) -> None:
            live.question = words
            outputs.ask(words)

        if procedure is not None:
            procedure.desk.show = show
        elif (station.alarms.command or station.alarms.post) and not station.port.url.startswith("replay://"):
            from gse.sessions.alarms import Alarmed

            alarmed.enter_context(Alarmed(station.alarms, live, folder, notes, tell=say_line))
        return outputs.listeners(loop, folder, live)

    def receive() -> LiveSession:
        with alarmed:
            received = run_live(
                station,
                text,
                asked.out,
                Operator(ending, say_line, session.opened, session.terminal_news, notes, *_before_sensor(stage, shown)),
                make_listeners=listeners,
                duration_s=duration_s,
                wait_port=asked.wait_port,
                clock_error_s=asked.clock_error_s,
                given_orientation=asked.given_orientation,
                procedure=procedure,
            )
        outputs.enter_judging()
        return received

    rest_s = REST_S if procedure is None else _REST_OF_CLEANUP_S
    with Ending(say_line, rest_s=rest_s) as ending, terminal.queued(waits_for_reader(station, ending)):
        _list_unfinished(asked.out)
        if procedure is not None:
            _say_how_power_was_left(asked.out)
        _wait_for_begin(station, asked, ending)
        duration_s = _duration_s(station, asked)
        with outputs, served(stage, say_line):
            report, found = session.run(receive, ending, asked.clock_error_s, plots=asked.plots)
            if report:
                outputs.conclude(report)
        return session.end(report, found, asked.out, asked.printed, json_frames=asked.live.json_frames)


class OneSession:
    """One session from the open port to the exit code."""

    def __init__(self, detachment: Detachment | None) -> None:
        self._detachment = detachment
        self.folder: Path | None = None
        self._status: StatusFile | None = None

    def opened(self, folder: Path, status: StatusFile) -> None:
        """Print the path of the recording, and how to end the session."""
        self.folder, self._status = folder, status
        if self._detachment is not None:
            self._detachment.into(folder)
        say_line(f"recording: {folder / 'session.mcap'}")
        say_line("Ctrl-C ends the session: it is closed, judged and reported")

    def terminal_news(self) -> list[terminal.News]:
        """Events of the readers of stdout and stderr since the last call; a log in their place is kept small."""
        if self._detachment is not None:
            self._detachment.keep_small()
        return terminal.news()

    def run(
        self, receive: Callable[[], LiveSession], ending: Ending, clock_error_s: float | None, *, plots: bool
    ) -> tuple[dict[str, Any] | None, list[Applied]]:
        """Receive and judge; returns the report, None without one, and the exit codes that apply."""
        found: list[Applied] = []
        try:
            if ending.asked():
                return None, [(EXIT_INTERRUPTED, "ended before anything was received")]
            live = receive()
            lost = f"{live.lost_bytes} received bytes are not in the session" if live.lost_bytes else ""
            lost = "; ".join(part for part in (lost, live.damage) if part)
            found = [(EXIT_DATA_LOST, lost)] if lost else []
            if live.left_bytes:
                why = "Ctrl-C came again" if ending.leaves else "this computer is too slow"
                left = f"{live.left_bytes} received bytes are recorded, but not processed: {why}"
                return None, [*found, (EXIT_INTERRUPTED, f"{left}; make the report with: gse report {live.folder}")]
            report = self._judged(live, ending, clock_error_s, plots=plots)
            return report, applied(report, live.folder, data_lost=lost)
        except (GseError, DriverError, ProtocolError) as error:
            if self._status is not None:
                self._status.close(exit_code_of(error))
            raise
        except (Exception, KeyboardInterrupt) as error:
            if self.folder is None:
                raise
            code = unexpected(error)
            return None, [*found, (code, f"no verdict; make the report with: gse report {self.folder}")]

    def _judged(self, live: LiveSession, ending: Ending, clock_error_s: float | None, *, plots: bool) -> dict[str, Any]:
        """The written report of the session."""
        if self._status is not None:
            self._status.enter("reporting")
        say_line(f"judging and reporting in {live.folder}")
        with ending.interruptible():
            assessment = judge_as_stated(live.session, clock_error_s)
            report = conclude(live.session, assessment, live.folder, live.own_elapsed_us, plots=plots)
        from gse.sessions.kept_results import keep_live

        keep_live(live.session, assessment, live.folder, say_line)
        return report

    def end(
        self, report: dict[str, Any] | None, found: list[Applied], out: Path, printed: Printed, *, json_frames: bool
    ) -> int:
        """Print what came out, and the exit code, which is returned."""
        terminal.settle()
        if report:
            show_report(report, self.folder or out, printed, json_frames=json_frames)
        terminal.settle()
        if self.folder is not None:
            show_path(self.folder)
        code = say_exit_code(found)
        if self._status is not None:
            self._status.close(code, report["verdict"] if report else None)
        return code


def _run_before(scene: str | None, rates: str | None, station: Station, text: str, asked: Asked) -> int:
    """Run one session of a simulated sensor, or of one that looks at a screen if there is one."""
    if station.port.url.startswith("sim://"):
        from gse.sessions.stepped import simulated_station

        shown: list[Shown] = []
        station, text = simulated_station(*_with_scene(station, text, scene, rates), shown)
        return run_session(station, text, asked, shown=shown)
    with_screen = station.screen is not None or scene is not None or rates is not None
    return run_session(station, text, asked, stage=stage_of(station, scene, rates) if with_screen else None)


def _station(
    argument: Path | None, option: Path | None, url: str | None, identifier: str | None
) -> tuple[Station, str]:
    """The station to run, with another port and another identifier where they are given, and its text."""
    if argument is not None and option is not None:
        raise UsageError(f"two station files: {argument} and {option}; give one")
    station, text = with_identifier(*station_of(argument or option), identifier)
    return (station, text) if url is None else with_url(station, text, url)


def _with_scene(station: Station, text: str, scene: str | None, rates: str | None) -> tuple[Station, str]:
    """The station whose simulated sensor looks at a scene of the command line."""
    given = {name: value for name, value in (("scenario", scene), ("rates", rates)) if value is not None}
    if not given:
        return station, text
    return with_url(station, text, sim_url(**(parse_mock_url(station.port.url).options | given)))


def say_line(text: str) -> None:
    with contextlib.suppress(OSError):
        click.echo(text, err=True)


def waits_for_reader(station: Station, ending: Ending) -> Callable[[], bool]:
    """Whether output waits for its reader: only with simulated or recorded data, until the session is to end."""
    can_wait = is_mock(station.port.url)
    return lambda: can_wait and not ending.asked()


_LOOK_EVERY_S = 0.5


def _wait_for_begin(station: Station, asked: Asked, ending: Ending) -> None:
    """Wait for the instant of --from, or until a signal asks for the end."""
    if asked.from_text is None:
        return
    utc_ns = night.begin_ns(asked.from_text, station.site, read_clock().utc_ns, asked.until_text)
    if utc_ns > read_clock().utc_ns:
        say_line(f"waiting until {instant.to_text(utc_ns, 0)}; Ctrl-C ends it")
    pause = threading.Event()
    while read_clock().utc_ns < utc_ns and not ending.asked():
        pause.wait(_LOOK_EVERY_S)


def _duration_s(station: Station, asked: Asked) -> float | None:
    """From now on: as --duration states, or to the instant of --until."""
    if asked.until_text is None:
        return asked.duration_s
    now_ns = read_clock().utc_ns
    return (night.end_ns(asked.until_text, station.site, now_ns) - now_ns) / NS_PER_S


def _list_unfinished(out: Path) -> None:
    """List sessions that ended without a report, with the command for the report."""

    found = [folder for folder in session_folders(out) if is_unfinished(folder)]
    for folder in found[-_MOST_LISTED:]:
        say_line(f"unfinished session: {folder} has no report; make one with: gse report {folder}")
    if len(found) > _MOST_LISTED:
        say_line(f"and {len(found) - _MOST_LISTED} older ones")


def _before_sensor(
    stage: "Stage | None", shown: Sequence[Shown]
) -> tuple[Callable[[], Sequence[Shown | tuple[str, str]]], Callable[[], bool]]:
    """What a screen shows, or a simulation all at once, since the last call; and whether its scene is over."""
    if stage is not None:
        return stage.take, lambda: stage.is_over
    return told_once(shown), lambda: False


# Procedures in a session: of a file (gse procedure), or of the one repeat that --starts is.

_SPARE_S = 60.0
"""A simulated sensor goes on for so long after the longest time that the steps take."""


def simulated_for(station: Station, text: str, procedure: Procedure, shown: list[Shown]) -> tuple[Station, str]:
    """The station with a simulated sensor that goes on until the last step is done."""
    from gse.sessions.stepped import endless, simulated_station

    _, longest_s = duration_s((*procedure.steps, *procedure.cleanup), load_protocol(station.protocol))
    return simulated_station(*endless(station, text, longest_s + _SPARE_S), shown)


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

_EXPOSURE = """\
  - repeat:
      times: 1
      steps:
        - send: {{command: SET_EXPOSURE, exposure: {exposure_s:g} s}}
        - wait: {{until: {{exposure_s: [{low_s:.6g}, {high_s:.6g}]}}, at_most: 1 min}}
        - watch: {{for: {for_s:.0f} s, frames: {frames}, exposure: {exposure_s:g} s}}
    on_failure: go on
"""
"""An exposure that the sensor refuses, or at which it fails, keeps none of the others from being tested."""


def sweep_of(sensor: Sensor) -> str:
    """The procedure that commands each of ``sensor.exposures_s`` and judges frames of it.

    A watch ends after five times what its frames take, and a minute more.
    """
    stated = [one.period_ms for one in (sensor.start, sensor.poll) if one is not None]
    period_s = next((float(one) / 1000 for one in stated if one != "asap"), 1.0)
    steps = "".join(
        _EXPOSURE.format(
            exposure_s=exposure_s,
            low_s=exposure_range_s(exposure_s)[0],
            high_s=exposure_range_s(exposure_s)[1],
            for_s=60 + 5 * sensor.frames_each * max(exposure_s, period_s),
            frames=sensor.frames_each,
        )
        for exposure_s in sensor.exposures_s or ()
    )
    return f"version: 1\nname: {len(sensor.exposures_s or ())} exposures\nsteps:\n{steps}"


def run_sweep(station: Station, text: str, asked: Asked) -> int:
    """Command each of the exposures that the station file lists, and judge frames of each."""
    check_asking(station.sensor, station.port, protocol_of(station))
    return _run_made(station, text, parse_procedure(sweep_of(station.sensor), "sensor.exposures_s"), asked)


def run_starts(station: Station, text: str, times: int, off_s: float, asked: Asked) -> int:
    """Switch the sensor off and on again and again, and judge its first fix: a procedure of one repeat."""
    limit_s = station.limits.first_fix_s
    keeps = f"  - check: {{first_fix_s: {{share: {_SHARE}, at_most: {limit_s:g}}}}}\n" if limit_s else ""
    procedure = parse_procedure(_STARTS.format(times=times, off_s=off_s, check=keeps), "--starts")
    return _run_made(station, text, procedure, asked)


def _run_made(station: Station, text: str, procedure: Procedure, asked: Asked) -> int:
    """Run a procedure that no file holds."""
    protocol = protocol_of(station)
    if problems := check(procedure, station, protocol):
        raise UsageError(problems[0])
    shown: list[Shown] = []
    if station.port.url.startswith("sim://"):
        station, text = simulated_for(station, text, procedure, shown)
    one = Run(procedure, Desk(name=station.test.operator or ""), say=say_line)
    return run_session(station, text, asked, shown=shown, procedure=one)


_REST_OF_CLEANUP_S = 600.0
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
