"""``gse view``: shows a session in rerun."""

import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from gse.cli.options import clock_error_option


@click.command("view")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="Show it as a web page, until Ctrl-C.")
@click.option("--bind", default="127.0.0.1", show_default=True, help="Address of the web page.")
@click.option(
    "--http-port", type=click.IntRange(0, 65535), default=0, help="Port of the web page; default: a free one."
)
@click.option("--save", type=click.Path(path_type=Path, dir_okay=False), help="Save it as a rerun file, .rrd")
@click.option("--screenshot", type=click.Path(path_type=Path, dir_okay=False), help="Save a picture of it as .png")
@clock_error_option
def command(
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
    from gse.view.page import ViewerPage, wait_for_interrupt
    from gse.view.screenshot import save_screenshot
    from gse.view.viewer import open_native_viewer

    with ExitStack() as stack:
        recording = save
        if recording is None:
            recording = Path(tempfile.mkdtemp(prefix="gse-view-")) / "session.rrd"
            if web or screenshot:
                stack.callback(_remove, recording)
        _write_recording(path, recording, clock_error_s)
        if save is not None:
            click.echo(f"saved: {save}", err=True)
        if screenshot is not None:
            save_screenshot(recording, screenshot)
            click.echo(f"picture: {screenshot}", err=True)
        if web:
            page = stack.enter_context(ViewerPage(bind, http_port, recording=recording))
            click.echo(f"view: {page.url} (press Ctrl-C to end)", err=True)
            wait_for_interrupt()
        elif save is None and screenshot is None:
            open_native_viewer(str(recording))
            click.echo(f"opened in rerun: {recording}", err=True)


def _write_recording(path: Path, recording: Path, clock_error_s: float | None) -> None:
    from gse.assessment.verdict import judge
    from gse.cli.progress import replay_with_progress
    from gse.station.loop import Listener, StationLoop
    from gse.view.saved_view import SavedView

    views: list[Any] = []

    def listeners_of(loop: StationLoop, folder: Path | None) -> list[Listener]:
        views.append(SavedView(loop.setup.station, loop.setup.identifier.catalog, recording))
        return list(views)

    session = replay_with_progress(path, listeners_of).session
    if clock_error_s is not None:
        session.clock_error_s = clock_error_s
    assessment = judge(session)
    views[0].finish(session, assessment.verdict.value, assessment.reasons)


def _remove(recording: Path) -> None:
    recording.unlink(missing_ok=True)
    recording.parent.rmdir()
