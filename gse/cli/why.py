"""``gse why``: one page on a session: what happened, when, why, what next."""

from pathlib import Path

import click

from gse.cli.options import clock_error_option, session_argument
from gse.errors import UsageError


@click.command("why")
@session_argument
@clock_error_option
@click.option(
    "--bundle",
    "bundle_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also write a new .zip file for a maintainer: this page, report, station file, events, versions.",
)
@click.option(
    "--with-site",
    is_flag=True,
    help="Put the recording and the place of the mount into the bundle; without it the place is blurred to a degree.",
)
def command(*, path: Path, clock_error_s: float | None, bundle_path: Path | None, with_site: bool) -> None:
    """Show one page on SESSION: what happened, when, why, and the next step as a command.

    Without SESSION: on the newest one below ./sessions. The findings are those of the report;
    docs/troubleshooting.md explains each.
    """
    from gse.cli.finish import judge_as_stated
    from gse.cli.progress import judged_with_progress
    from gse.report.summary import summarise
    from gse.report.why import why_page, write_bundle

    if with_site and bundle_path is None:
        raise UsageError("--with-site says what a bundle holds; expected --bundle FILE beside it")
    if bundle_path is not None and bundle_path.exists():
        raise UsageError(f"{bundle_path} exists already; choose another name")
    judged = judged_with_progress(path)
    session = judged.session
    assessment = judged.assessment if clock_error_s is None else judge_as_stated(session, clock_error_s)
    report = summarise(session, assessment)
    click.echo(why_page(report, session.events, str(path)))
    if bundle_path is not None:
        try:
            write_bundle(bundle_path, session, report, str(path), recording=_recording(path) if with_site else None)
        except OSError as error:
            raise UsageError(f"cannot write {bundle_path}: {error.strerror}") from error
        click.echo(f"bundle: {bundle_path}", err=True)


def _recording(path: Path) -> Path:
    return path / "session.mcap" if path.is_dir() else path
