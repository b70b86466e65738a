"""``gse ci``: replay a folder of sessions and compare their reports."""

import dataclasses
import json
from pathlib import Path

import click

from gse.cli import EXIT_FAIL


@click.command("ci")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--junit", "junit_path", type=click.Path(path_type=Path, dir_okay=False), help="Write the results as a JUnit file."
)
@click.option("--update", is_flag=True, help="Write the new reports as the expected ones.")
@click.option("--speed", default="max", show_default=True, help="Speed of the replay: max, 1, or a factor such as 20.")
@click.option("--cut", "cut_bytes", type=click.IntRange(min=1), help="Replay in chunks of this many bytes.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.ci/1.")
@click.pass_context
def command(
    ctx: click.Context,
    *,
    folder: Path,
    junit_path: Path | None,
    update: bool,
    speed: str,
    cut_bytes: int | None,
    as_json: bool,
) -> None:
    """Replay every session (.mcap) in FOLDER and compare its report with NAME.report.json beside it.

    All that the expected report states must be the same; only the version of gse may differ. What only the new report
    states is listed as new; a new row of the verdict with a limit must be PASS. The exit code is 1 if a report differs,
    is missing, or cannot be made.
    """
    from gse.process.release_memory import keep_for_many_sessions
    from gse.sessions.golden import check, junit_of, recordings_in
    from gse.sessions.replay import ReplayOptions

    keep_for_many_sessions()
    outcomes = []
    for recording in recordings_in(folder):
        name = recording.relative_to(folder).as_posix().removesuffix(".mcap")
        outcome = check(recording, name, ReplayOptions(speed=speed, chunk_bytes=cut_bytes), update=update)
        outcomes.append(outcome)
        if not as_json:
            what = "ERROR" if outcome.error else "DIFFERS" if outcome.differences else "kept" if update else "same"
            click.echo(f"{what:8} {outcome.verdict:13} {name}")
            for line in (*outcome.error.splitlines(), *outcome.differences, *outcome.new_lines):
                click.echo(f"         {line}")
    failed = [outcome.name for outcome in outcomes if not outcome.passed]
    if as_json:
        rows = [dataclasses.asdict(outcome) for outcome in outcomes]
        click.echo(json.dumps({"schema": "gse.ci/1", "recordings": rows}))
    else:
        click.echo(f"{len(outcomes) - len(failed)} of {len(outcomes)} sessions give the expected report")
    if junit_path is not None:
        _write_junit(junit_path, junit_of(outcomes, folder))
    ctx.exit(EXIT_FAIL if failed else 0)


def _write_junit(path: Path, text: str) -> None:
    from drivers.whole_file import write_whole
    from gse.errors import UsageError

    try:
        write_whole(path, [text])
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
