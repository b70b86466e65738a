"""``gse report``: the report of a session, or of several side by side."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.host_files import whole_files
from gse.cli import DAMAGED, EXIT_FAIL, EXIT_INCONCLUSIVE, damage_code
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
from gse.cli.options import (
    NewFolder,
    anew_option,
    clock_error_option,
    earth_orientation_option,
    gathered,
    given_or_newest,
    leave_out_option,
    plots_option,
    start_utc_option,
)
from gse.config.choice import StationText, change_to
from gse.errors import UsageError
from gse.process.terminal import working
from gse.station.exclusions import Exclusion
from gse.station.results import Verdict
from gse.truth.orientation import GivenTables

if TYPE_CHECKING:
    from gse.sessions.kept_results import Judged


@dataclass(frozen=True, slots=True)
class _Judging:
    """How a session is judged."""

    station: "Callable[[StationText], StationText]"
    clock_error_s: float | None
    given_orientation: GivenTables | None
    excluded: tuple[Exclusion, ...]
    start_utc: str | None
    anew: bool

    def judged(self, path: Path, *, anew: bool = False) -> "Judged":
        """A session as it is judged with these options; ``anew``: not from kept results."""
        from gse.cli.progress import judged_with_progress
        from gse.sessions.replay import ReplayOptions

        found = judged_with_progress(
            path,
            options=ReplayOptions(given_orientation=self.given_orientation, start_utc=self.start_utc),
            station=self.station,
            anew=anew or self.anew,
        )
        if self.clock_error_s is None and not self.excluded:
            return found
        stated = judge_as_stated(found.session, self.clock_error_s, self.excluded)
        return replace(found, _assessment=stated)


@dataclass(frozen=True, slots=True)
class _Output:
    """What is written and printed."""

    out: Path | None
    pdf: bool
    screenshot: Path | None
    verified: Path | None
    plots: bool

    def check(self, sessions: int) -> None:
        """UsageError where it cannot be made of so many sessions, or exists already."""
        if sessions > 1 and (self.pdf or self.screenshot or self.verified):
            raise UsageError("--pdf, --screenshot and --verify are for one session; give one SESSION")
        for wanted in (self.out, self.screenshot):
            if wanted is not None and (wanted.exists() or wanted.is_symlink()):
                raise UsageError(f"{wanted} exists already; choose another name")
        if self.screenshot is not None and not self.screenshot.parent.is_dir():
            raise UsageError(f"there is no folder {self.screenshot.parent} for the picture; make it, or choose another")


_judging = gathered(
    "judging",
    _Judging,
    click.option(
        "--station",
        type=click.Path(path_type=Path),
        callback=lambda _context, _option, path: change_to(path),
        help="Station file instead of the session's own, e.g. where that names a catalogue file.",
    ),
    clock_error_option,
    earth_orientation_option,
    leave_out_option,
    start_utc_option,
    anew_option,
)

_output = gathered(
    "output",
    _Output,
    click.option(
        "--out",
        type=NewFolder(),
        help="New folder for the report; default: 'report' beside FILE, numbered where there is one.",
    ),
    click.option("--pdf", is_flag=True, help="Also print report.html to report.pdf beside it."),
    click.option(
        "--screenshot",
        type=click.Path(path_type=Path, dir_okay=False),
        help="Also save the top of the report as a picture, .png",
    ),
    click.option(
        "--verify",
        "verified",
        type=click.Path(path_type=Path, dir_okay=False),
        help="Write nothing: tell whether this report.html belongs to the session and was changed since; "
        "exit code 0 or 1.",
    ),
    plots_option,
)


@click.command("report")
@click.argument("paths", metavar="[SESSION]...", nargs=-1, type=click.Path(path_type=Path), callback=given_or_newest)
@_judging
@_output
@printed
@click.pass_context
def command(
    ctx: click.Context, *, paths: tuple[Path, ...], judging: _Judging, output: _Output, printed: Printed
) -> None:
    """Write report.html, report.json, frames.csv, junit.xml and provenance.json of SESSION.

    Without SESSION: of the newest one below ./sessions. The same session gives the same report, byte for byte. Results
    that an earlier run kept are used where session, station file and gse are the same. The exit code is the verdict's.

    Of several SESSIONs, of one sensor or of several: one page with their verdicts and table 4-1 of the LAPAN paper, a
    row for each (sessions.html, sessions.json); the exit code is that of the worst.
    """
    output.check(len(paths))
    if len(paths) > 1:
        ctx.exit(_report_several(paths, judging, output, printed))
    if output.verified:
        ctx.exit(_verify(paths[0], judging, output.verified))
    ctx.exit(_report_one(paths[0], judging, output, printed))


def _report_one(path: Path, judging: _Judging, output: _Output, printed: Printed) -> int:
    """Write and show the report of a session; the exit code."""
    from gse.report.printing import find_browser, print_to_pdf, save_picture
    from gse.report.summary import summarise

    browser = find_browser() if output.pdf or output.screenshot else None
    judged = judging.judged(path)
    report = summarise(judged.session, judged.assessment)
    as_it_is = output.pdf and output.out is None and not printed.paper
    written = _written(path, report) if as_it_is else None
    folder = written or _new_folder(output.out, path)
    if written is None:
        with working("drawing the report"):
            conclude(
                judged.session,
                judged.assessment,
                folder,
                judged.own_elapsed_us,
                plots=output.plots,
                paper=printed.paper,
            )
    if browser and output.pdf:
        click.echo(f"PDF: {print_to_pdf(browser, folder / 'report.html')}", err=True)
    if browser and output.screenshot:
        save_picture(browser, folder / "report.html", output.screenshot)
        click.echo(f"picture: {output.screenshot}", err=True)
    show_report(report, path, printed)
    show_path(folder)
    return say_exit_code(applied(report, folder, data_lost=DAMAGED if judged.session.truncated else ""))


def _written(path: Path, report: dict[str, Any]) -> Path | None:
    """The folder of the session's own report.html, where that says what is judged now."""
    from gse.report.page import NO_PLOTS, read_page
    from gse.report.provenance import fingerprint, fingerprint_in

    page = (path if path.is_dir() else path.parent) / "report.html"
    if not page.is_file():
        return None
    text = read_page(page)
    return page.parent if fingerprint_in(text) == fingerprint(report) and NO_PLOTS not in text else None


def _report_several(paths: tuple[Path, ...], judging: _Judging, output: _Output, printed: Printed) -> int:
    """Write and show the report of several sessions; the exit code of the worst."""
    from gse.report.several import sessions_html, sessions_report
    from gse.report.terminal import TABLE_4_1_HEAD, aligned, table_4_1_rows

    judged = [judging.judged(path) for path in paths]
    report = sessions_report(
        [(_name_of(path), one.session, one.assessment) for path, one in zip(paths, judged, strict=True)]
    )
    folder = _new_folder(output.out, paths[0].parent)
    with whole_files() as write:
        write(folder / "sessions.html", [sessions_html(report)])
        write(folder / "sessions.json", [json.dumps(report, indent=2) + "\n"])
    width = max(len(one["word"]) for one in report["sessions"])
    lines = [*(f"{one['word']:{width}}  {one['name']}" for one in report["sessions"]), ""]
    lines += aligned(TABLE_4_1_HEAD, table_4_1_rows(report))
    click.echo(json.dumps(report) if printed.as_json else "\n".join(lines))
    click.echo(f"report: {folder / 'sessions.html'}", err=True)
    lost = [damage_code(path, damaged=one.session.truncated) for path, one in zip(paths, judged, strict=True)]
    verdicts = {one.assessment.verdict for one in judged}
    codes = {Verdict.FAIL: EXIT_FAIL, Verdict.INCONCLUSIVE: EXIT_INCONCLUSIVE}
    return max(lost) or next((code for verdict, code in codes.items() if verdict in verdicts), 0)


def _name_of(path: Path) -> str:
    """What tells a session from others: its folder's name where the file is called as all are."""
    return path.resolve().parent.name if path.name == "session.mcap" else path.name


def _verify(path: Path, judging: _Judging, page: Path) -> int:
    """Say what a report is to a session; the exit code."""
    from gse.report.page import Answer, read_page, verify

    written = read_page(page)
    judged = judging.judged(path, anew=True)
    found = verify(written, judged.session, judged.assessment)
    click.echo(f"the report {found.answer.value}\n  {found.detail}")
    return 0 if found.answer is Answer.UNCHANGED else 1


def _new_folder(out: Path | None, session: Path) -> Path:
    beside = session if session.is_dir() else session.parent
    numbered = ["report", *(f"report-{number}" for number in range(2, 1000))]
    for folder in [out] if out else [beside / name for name in numbered]:
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise UsageError(f"cannot make the folder {folder}: {error.strerror}; choose another --out") from error
        return folder
    raise UsageError(f"no room for another report in {beside}; choose another place with --out")
