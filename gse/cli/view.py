"""``gse view``: shows a session in rerun."""

import contextlib
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path

import click

from gse.cli.files import damage_code
from gse.cli.options import bind_option, clock_error_option, http_port_option
from gse.process import terminal
from gse.view.glance_word import level_of
from gse.view.viewer import open_native_viewer


@click.command("view")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="Show it as a web page, until Ctrl-C.")
@bind_option
@http_port_option
@click.option("--save", type=click.Path(path_type=Path, dir_okay=False), help="Save it as a rerun file, .rrd")
@click.option("--screenshot", type=click.Path(path_type=Path, dir_okay=False), help="Save a picture of it as .png")
@clock_error_option
@click.pass_context
def command(
    ctx: click.Context,
    *,
    path: Path,
    web: bool,
    bind: str,
    http_port: int,
    save: Path | None,
    screenshot: Path | None,
    clock_error_s: float | None,
) -> None:
    """Show the session FILE in rerun: in a window, unless --web, --save or --screenshot is given."""
    from gse.view.viewer import check_rerun

    check_rerun()
    with ExitStack() as stack:
        recording = save
        if recording is None:
            recording = Path(tempfile.mkdtemp(prefix="gse-view-")) / "session.rrd"
            if web or screenshot:
                stack.callback(_remove, recording)
        verdict, code = _write_recording(path, recording, clock_error_s)
        if save is not None:
            click.echo(f"saved: {save}", err=True)
        if screenshot is not None:
            from gse.view.screenshot import save_screenshot

            save_screenshot(recording, screenshot)
            click.echo(f"picture: {screenshot}", err=True)
        if web:
            from gse.view.server import Content, ViewServer

            server = stack.enter_context(ViewServer(bind, http_port, Content(recording=recording, verdict=verdict)))
            _serve_until_interrupt(server.url)
        elif save is None and screenshot is None:
            open_native_viewer(str(recording))
            click.echo(f"opened in rerun: {recording}", err=True)
    ctx.exit(code)


def _write_recording(path: Path, recording: Path, clock_error_s: float | None) -> tuple[tuple[str, str], int]:
    """Write it; returns the verdict and its level, for the bar of the page, and the exit code."""
    from gse.cli.finish import judge_as_stated
    from gse.cli.progress import judged_with_progress
    from gse.report.conclusion import explained
    from gse.report.metric_table import metrics_in_markdown
    from gse.report.summary import summarise
    from gse.station.setup import catalog_of
    from gse.view.saved_view import save_view

    judged = judged_with_progress(path)
    session, assessment = judged.session, judged.assessment
    if clock_error_s is not None:
        assessment = judge_as_stated(session, clock_error_s, ())
    utc_ns = int(session.frames.columns["utc_ns"][0]) if len(session.frames) else None
    statistics, told = assessment.statistics, summarise(session, assessment)["conclusion"]
    verdict, why = told["headline"], explained(told)
    save_view(
        session,
        catalog_of(session.station, utc_ns),
        recording,
        verdict,
        why,
        own=statistics.own,
        metrics=metrics_in_markdown(statistics),
    )
    shown = "; ".join([verdict, *why]), level_of(verdict)
    return shown, damage_code(path, damaged=session.truncated)


def _serve_until_interrupt(url: str) -> None:
    with contextlib.suppress(KeyboardInterrupt):
        click.echo(f"view: {url} (press Ctrl-C to end)", err=True)
        terminal.end_sign()
        threading.Event().wait()


def _remove(recording: Path) -> None:
    recording.unlink(missing_ok=True)
    recording.parent.rmdir()
