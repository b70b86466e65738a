"""``gse ci``: replay a folder of sessions and compare their reports, or the answers of an identifier."""

import dataclasses
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivers.host_files import write_whole
from drivers.outside_text import plain_line
from gse.cli import EXIT_FAIL, EXIT_INCONCLUSIVE
from gse.cli.options import IDENTIFIER, PLUG_HELP
from gse.errors import UsageError

if TYPE_CHECKING:
    from gse.sessions.golden import Checked

_ANGLE = re.compile(r"(\d+(?:\.\d*)?(?:e[+-]?\d+)?) ?(mas|arcsec|arcmin|deg)")
_ARCSEC = {"mas": 1e-3, "arcsec": 1.0, "arcmin": 60.0, "deg": 3600.0}


def _arcsec(ctx: click.Context, param: click.Parameter, text: str | None) -> float | None:
    """An angle with its unit."""
    if text is None:
        return None
    found = _ANGLE.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"--within is {text!r:.60}; expected an angle with its unit ({', '.join(_ARCSEC)}): 1arcsec")
    return float(found[1]) * _ARCSEC[found[2]]


@click.command("ci")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--identifier",
    type=IDENTIFIER,
    help="Compare the answers of this identifier with NAME.answers.ndjson, instead of reports: to the last bit, or "
    f"--within an angle. {PLUG_HELP}",
)
@click.option(
    "--within",
    "within_arcsec",
    callback=_arcsec,
    metavar="ANGLE",
    help="Largest rotation between two answers that are the same, e.g. 1arcsec.",
)
@click.option(
    "--junit", "junit_path", type=click.Path(path_type=Path, dir_okay=False), help="Write the results as a JUnit file."
)
@click.option("--update", is_flag=True, help="Write the new reports, or answers, as the expected ones.")
@click.option("--speed", default="max", show_default=True, help="Speed of the replay: max, 1, or a factor such as 20.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.ci/1.")
@click.pass_context
def command(
    ctx: click.Context,
    *,
    folder: Path,
    identifier: str | None,
    within_arcsec: float | None,
    junit_path: Path | None,
    update: bool,
    speed: str,
    as_json: bool,
) -> None:
    """Replay every session (.mcap) in FOLDER and compare its report with NAME.report.json beside it.

    All that the expected report states must be the same; only the version of gse may differ. What only the new report
    states is listed as new; a new row of the verdict with a limit must be PASS. On a processor that is not of x86-64 a
    figure may differ by one unit of its last printed digit; each that does is listed. The exit code is 1 if a report
    differs, is missing, or cannot be made.

    With --identifier the answers are compared, frame by frame, and no report. The exit code is 1 if one differs, is
    missing, or is there more than expected; 5 if no frame was answered, now or then. Time-outs are counted apart.
    """
    from gse.sessions.golden import check, check_answers, junit_of, recordings_in
    from gse.sessions.replay import ReplayOptions

    if within_arcsec is not None and (identifier is None or update):
        raise UsageError("--within compares answers: give --identifier with it, and not --update")
    options, checked = ReplayOptions(speed=speed), []
    for recording in recordings_in(folder):
        name = plain_line(recording.relative_to(folder).as_posix().removesuffix(".mcap"))
        if identifier is None:
            one = check(recording, name, options, update=update)
        else:
            one = check_answers(recording, name, options, identifier, within_arcsec=within_arcsec, update=update)
        checked.append(one)
        if not as_json:
            what = "ERROR" if one.error else "DIFFERS" if one.differences else "kept" if update else "same"
            click.echo("\n".join([f"{what:8} {one.verdict:13} {name}", *(f"         {line}" for line in one.lines)]))
    if as_json:
        click.echo(json.dumps({"schema": "gse.ci/1", "recordings": [dataclasses.asdict(one) for one in checked]}))
    else:
        click.echo(_summary(checked, update=update))
    if junit_path is not None:
        _write_junit(junit_path, junit_of(checked, folder))
    ctx.exit(_exit_code(checked))


def _summary(checked: "Sequence[Checked]", *, update: bool) -> str:
    passed = f"{sum(one.passed for one in checked)} of {len(checked)} sessions"
    answers = [one.answers for one in checked if one.answers is not None]
    if not answers:
        return f"{passed} give the expected report"
    compared, different = sum(one.compared for one in answers), sum(one.different for one in answers)
    if update:
        return f"{compared:,} answers kept; {passed} have them"
    return f"{different:,} of {compared:,} answers differ; {passed} give the expected ones"


def _exit_code(checked: "Sequence[Checked]") -> int:
    if not all(one.passed for one in checked):
        return EXIT_FAIL
    answers = [one.answers for one in checked if one.answers is not None]
    return EXIT_INCONCLUSIVE if answers and all(one.compared == one.unanswered for one in answers) else 0


def _write_junit(path: Path, text: str) -> None:
    try:
        write_whole(path, [text])
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
