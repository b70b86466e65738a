"""The end of a session, live or replayed: judge, write the report, show it, and what the exit code is."""

import json
from array import array
from pathlib import Path
from typing import Any

import click
import numpy as np

from gse.cli import EXIT_DATA_LOST, EXIT_FAIL, EXIT_INCONCLUSIVE
from gse.errors import UsageError
from gse.station.exclusions import Exclusion
from gse.station.session_data import SessionData


def conclude(
    session: SessionData,
    folder: Path,
    own_elapsed_us: "array[float]",
    clock_error_s: float | None,
    excluded: tuple[Exclusion, ...] = (),
) -> dict[str, Any]:
    """Judge a night, write its report into a folder and this host's own times beside it; the report."""
    from gse.assessment.verdict import judge
    from gse.release_memory import give_back
    from gse.report import summarise, write_report
    from gse.station.setup import clear_caches

    clear_caches()
    if clock_error_s is not None:
        session.clock_error_s = clock_error_s
    session.excluded = excluded
    assessment = judge(session)
    report = summarise(session, assessment)
    give_back()
    try:
        write_report(session, assessment, folder)
        (folder / "timing.json").write_text(json.dumps(_timing(own_elapsed_us), indent=2) + "\n")
    except (UsageError, OSError) as error:
        # The verdict is worth more than the file that it does not fit into.
        click.echo(f"gse: {error}; make room, then: gse report {folder}", err=True)
    return report


def show_report(report: dict[str, Any], folder: Path, *, as_json: bool, json_frames: bool) -> None:
    """The verdict on stdout, or the whole report as JSON; beside a stream of frames the verdict goes to stderr.

    Paths go to stderr, always.
    """
    from rich.console import Console

    from gse.report.terminal import print_verdict

    if as_json:
        click.echo(json.dumps(report))
    else:
        print_verdict(report, Console(stderr=True) if json_frames else None)
    for name in ("session.mcap", "report.html"):
        if (folder / name).exists():
            click.echo(f"{'session' if name == 'session.mcap' else 'report'}: {folder / name}", err=True)


def exit_code(report: dict[str, Any], folder: Path, *, data_lost: bool) -> int:
    """The exit code of a report: lost or recovered data before the verdict, because the verdict is not on all of it.

    A report that could not be written into its folder is lost data too.
    """
    if data_lost or not (folder / "report.json").is_file():
        return EXIT_DATA_LOST
    return {"PASS": 0, "FAIL": EXIT_FAIL}.get(report["verdict"], EXIT_INCONCLUSIVE)


def _timing(own_elapsed_us: "array[float]") -> dict[str, Any]:
    """Identification times of this host in this run: a replay's own, which are not in its report."""
    times = np.array(own_elapsed_us) if own_elapsed_us else np.full(1, np.nan)
    figures = {"p50": np.median(times), "p95": np.percentile(times, 95), "max": times.max()}
    return {
        "schema": "gse.timing/1",
        "frames": len(own_elapsed_us),
        "identification_us": {
            name: round(float(value), 1) if own_elapsed_us else None for name, value in figures.items()
        },
    }
