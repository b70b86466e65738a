"""``gse replay``: a test from a session or a raw capture."""

from pathlib import Path

import click

from gse.cli import DAMAGED
from gse.cli.finish import (
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
    gathered,
    identifier_option,
    leave_out_option,
    out_option,
    plots_option,
    say,
    start_utc_option,
    station_option,
)
from gse.cli.progress import ReplayedShare
from gse.config.choice import change_to
from gse.sessions.replay import Replay, ReplayOptions, replay_session
from gse.station.exclusions import Exclusion
from gse.view.live_state import LiveState

_replayed = gathered(
    "options",
    ReplayOptions,
    click.option("--speed", default="max", show_default=True, help="Speed of the replay: max, 1, or a factor like 20."),
    click.option("--from", "from_utc", help="Replay from this UTC on, e.g. 2026-03-20T18:30:00Z."),
    click.option("--to", "to_utc", help="Replay before this UTC."),
    start_utc_option,
    earth_orientation_option,
)


@click.command("replay")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@station_option
@identifier_option
@click.option(
    "--address",
    type=click.IntRange(min=0, max=2**63 - 1),
    help="Judge the sensor with this address on the recorded line, instead of that of the station file.",
)
@_replayed
@live_options
@clock_error_option
@leave_out_option
@plots_option
@printed
@out_option
@click.pass_context
def command(
    ctx: click.Context,
    *,
    path: Path,
    station_path: Path | None,
    identifier: str | None,
    address: int | None,
    options: ReplayOptions,
    live: LiveOptions,
    clock_error_s: float | None,
    excluded: tuple[Exclusion, ...],
    plots: bool,
    printed: Printed,
    out: Path,
) -> None:
    """Replay FILE, a session or a raw capture, as if a sensor sent it. The same bytes give the same report.

    The station file of the session is used, unless --station gives another one. A raw capture needs --start-utc. The
    report is written to a new folder in --out.
    """
    progress = ReplayedShare(path).text
    paced = options.speed != "max"
    with LiveOutputs(live, diagnose=paced, progress=progress, quiet=not (paced or printed.verbose)) as live_outputs:
        replay = replay_session(
            path,
            options=options,
            station=change_to(station_path, identifier, address),
            make_listeners=lambda loop: live_outputs.listeners(loop, None, LiveState.of(loop.session)),
            tell=say,
        )
        live_outputs.enter_judging()
        folder = _new_folder(out, replay, options.anchor_utc_ns if options.start_utc else 0)
        assessment = judge_as_stated(replay.session, clock_error_s, excluded)
        report = conclude(replay.session, assessment, folder, replay.own_elapsed_us, plots=plots)
        live_outputs.conclude(report)
    show_report(report, path, printed, json_frames=live.json_frames)
    show_path(folder)
    ctx.exit(say_exit_code(applied(report, folder, data_lost=DAMAGED if replay.session.truncated else "")))


def _new_folder(out: Path, replay: Replay, start_ns: int) -> Path:
    """A new folder with the UTC of the first frame, or of the beginning where none came."""
    from gse.sessions.live import new_session_folder

    session = replay.session
    frames = session.frames.columns
    began_ns = int(frames["utc_ns"][0]) if len(frames) else next((event.utc_ns for event in session.events), start_ns)
    return new_session_folder(out, f"{session.station.sensor.name}-replay", began_ns or None)
