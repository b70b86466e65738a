"""``gse replay``: a test from a session or a raw capture."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.cli import EXIT_FAIL, EXIT_INCONCLUSIVE
from gse.cli.damage import DAMAGED
from gse.cli.finish import (
    Applied,
    applied,
    conclude,
    judge_as_stated,
    say_exit_code,
    show_paths,
    show_report,
)
from gse.cli.live_outputs import LiveOptions, LiveOutputs, live_options
from gse.cli.options import (
    clock_error_option,
    earth_orientation_option,
    gathered,
    identifier_option,
    json_option,
    leave_out_option,
    out_option,
    plots_option,
    say,
    start_utc_option,
    station_option,
    threads_option,
)
from gse.config.choice import change_to
from gse.errors import UsageError
from gse.station.exclusions import Exclusion

if TYPE_CHECKING:
    from gse.sessions.expected_answers import Comparison
    from gse.sessions.replay import Replay, ReplayOptions
    from gse.station.loop import Listener, StationLoop

_SENSOR = "sensor"
"""The word of --expect for the sensor's own answers."""


def _replay_options(**values: Any) -> "ReplayOptions":
    from gse.sessions.replay import ReplayOptions

    return ReplayOptions(**values)


_replayed = gathered(
    "options",
    _replay_options,
    click.option("--speed", default="max", show_default=True, help="Speed of the replay: max, 1, or a factor like 20."),
    click.option("--from", "from_utc", help="Replay from this UTC on, e.g. 2026-03-20T18:30:00Z."),
    click.option("--to", "to_utc", help="Replay before this UTC."),
    click.option("--loop", type=click.IntRange(min=1), help="Replay this many times in a row."),
    start_utc_option,
    earth_orientation_option,
)


@click.command("replay")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@station_option
@identifier_option
@_replayed
@click.option("--step", is_flag=True, help="Wait for the Enter key after each panorama.")
@click.option(
    "--expect",
    "expected",
    metavar="FILE|sensor",
    help="Count the answers that differ from those of this file (lines of gse.answer/1 or gse.frame/1), or from the "
    "sensor's own (sensor: its ATTITUDE frames in the session); exit code 1, 5 where there is no answer to compare.",
)
@live_options
@clock_error_option
@leave_out_option
@threads_option
@plots_option
@json_option
@out_option
@click.pass_context
def command(
    ctx: click.Context,
    *,
    path: Path,
    station_path: Path | None,
    identifier: str | None,
    options: "ReplayOptions",
    step: bool,
    expected: str | None,
    live: LiveOptions,
    clock_error_s: float | None,
    excluded: tuple[Exclusion, ...],
    threads: int,
    plots: bool,
    as_json: bool,
    out: Path,
) -> None:
    """Replay FILE, a session or a raw capture, as if a sensor sent it. The same bytes give the same report.

    The station file of the session is used, unless --station gives another one. A raw capture needs --start-utc. The
    report is written to a new folder in --out.
    """
    from gse.cli.progress import ReplayedShare
    from gse.sessions.replay import replay_session

    compare = _comparison(expected)
    comparisons: list[Comparison] = []

    def listeners_of(loop: "StationLoop", folder: Path | None) -> "list[Listener]":
        comparisons.extend(compare(loop))
        return [*live_outputs.listeners(loop, folder), *comparisons]

    progress = ReplayedShare(path).text
    with LiveOutputs(live, step=step, diagnose=options.speed != "max", progress=progress) as live_outputs:
        replay = replay_session(
            path,
            options=options,
            station=change_to(station_path, identifier),
            make_listeners=listeners_of,
            tell=say,
            threads=1 if step else threads,
        )
        live_outputs.enter_judging()
        folder = _new_folder(out, replay)
        assessment = judge_as_stated(replay.session, clock_error_s, excluded)
        report = conclude(replay.session, assessment, folder, replay.own_elapsed_us, plots=plots)
        live_outputs.conclude(report)
    show_report(report, as_json=as_json, json_frames=live.json_frames)
    show_paths(folder)
    found = applied(report, folder, data_lost=DAMAGED if replay.session.truncated else "")
    ctx.exit(say_exit_code([*found, *_differing(comparisons, replay)]))


def _new_folder(out: Path, replay: "Replay") -> Path:
    from gse.sessions.live import new_session_folder

    frames = replay.session.frames.columns
    first_ns = int(frames["utc_ns"][0]) if len(frames) else 0
    return new_session_folder(out, f"{replay.session.station.sensor.name}-replay", first_ns)


def _comparison(expected: str | None) -> "Callable[[StationLoop], list[Comparison]]":
    """What --expect compares, for the loop of a replay; a damaged file is refused before it."""
    from gse.sessions.expected_answers import ExpectedAnswers

    if expected is None:
        return lambda loop: []
    if expected == _SENSOR:
        return _with_sensor
    answers = ExpectedAnswers(Path(expected))
    return lambda loop: [answers]


def _with_sensor(loop: "StationLoop") -> "list[Comparison]":
    from gse.sessions.expected_attitudes import ExpectedAttitudes

    protocol = loop.setup.protocol
    if not protocol.slots:
        raise UsageError(
            f"--expect {_SENSOR}: {protocol.name} has no panoramas, so nothing is identified that its answers could be "
            "compared with; leave out --expect: their errors are in the report"
        )
    return [ExpectedAttitudes(protocol, loop.setup.station.sensor.attitude)]


def _differing(comparisons: "list[Comparison]", replay: "Replay") -> list[Applied]:
    """The exit codes of answers that differ from expected ones, or of none to compare; both are printed."""
    found: list[Applied] = []
    for answers in comparisons:
        answers.finish(replay.session)
        click.echo(answers.text(), err=True)
        if not answers.is_same:
            found.append((EXIT_FAIL, "answers differ from the expected ones"))
        elif answers.shows_nothing:
            found.append((EXIT_INCONCLUSIVE, "there was no answer to compare with an expected one"))
    return found
