"""``gse view``: shows a session in rerun."""

import contextlib
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path

import click

from gse.cli import damage_code
from gse.cli.options import bind_option, clock_error_option, http_port_option, session_argument
from gse.errors import UsageError
from gse.process import terminal
from gse.view.glance_word import level_of
from gse.view.viewer import check_rerun, open_native_viewer

_PICTURES = (".png", ".jpg", ".jpeg", ".gif", ".tif", ".tiff", ".bmp", ".webp")
"""Only the first can be written, and whoever draws it says so of the others."""


@click.command("view")
@session_argument
@click.option(
    "--view",
    type=click.Choice(("web", "native")),
    help="Show it as a web page, until Ctrl-C, or in rerun's window; default: native.",
)
@bind_option
@http_port_option
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write this new file instead: .png is a picture, .rrd a file for rerun.",
)
@clock_error_option
@click.pass_context
def command(
    ctx: click.Context,
    *,
    path: Path,
    view: str | None,
    bind: str,
    http_port: int,
    out: Path | None,
    clock_error_s: float | None,
) -> None:
    """Show SESSION, or the newest one below ./sessions, in rerun: in a window, on a web page, or in a file."""
    if out is not None and view is not None:
        raise UsageError("--view shows the session, --out writes a file; give one of them")
    check_rerun()
    picture = out if out is not None and out.suffix.lower() in _PICTURES else None
    with ExitStack() as stack:
        recording = None if picture else out
        if recording is None:
            recording = Path(tempfile.mkdtemp(prefix="gse-view-")) / "session.rrd"
            if view == "web" or picture:
                stack.callback(_remove, recording)
        verdict, code = _write_recording(path, recording, clock_error_s)
        if picture is not None:
            from gse.view.saved_view import save_screenshot

            save_screenshot(recording, picture)
        if out is not None:
            click.echo(f"saved: {out}", err=True)
        elif view == "web":
            from gse.view.server import Content, ViewServer

            server = stack.enter_context(ViewServer(bind, http_port, Content(recording=recording, verdict=verdict)))
            _serve_until_interrupt(server.url)
        else:
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
    session = judged.session
    assessment = judged.assessment if clock_error_s is None else judge_as_stated(session, clock_error_s)
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
