"""End of a live or replayed session: verdict, report, exit code."""

import json
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from drivers.host_files import write_whole
from gse.cli import EXIT_DATA_LOST, EXIT_FAIL, EXIT_INCONCLUSIVE, EXIT_INTERNAL, EXIT_INTERRUPTED
from gse.cli.options import gathered, json_option, paper_option, verbose_option
from gse.errors import UsageError
from gse.station.exclusions import Exclusion
from gse.station.session_data import SessionData
from gse.station.session_tables import MOST_IN_MEMORY

if TYPE_CHECKING:
    from gse.verdict.assessment import Assessment

Applied = tuple[int, str]
"""An exit code that applies, and its reason."""

_WEIGHTIEST_FIRST = (EXIT_INTERNAL, EXIT_DATA_LOST, EXIT_FAIL, EXIT_INCONCLUSIVE, EXIT_INTERRUPTED, 0)
"""Lost data before the verdict, because the verdict then covers only a part of the session."""


def judge_as_stated(
    session: SessionData, clock_error_s: float | None, excluded: tuple[Exclusion, ...] = ()
) -> "Assessment":
    """Judge a session with the clock error and the excluded times that the operator states."""
    from gse.verdict.assessment import judge

    _give_back(session)
    if clock_error_s is not None:
        session.clock_error_s = clock_error_s
    session.excluded = excluded
    return judge(session)


def _give_back(session: SessionData) -> None:
    """Give back what the step before took; for a short session that takes more time than it is worth."""
    from gse.process.release_memory import give_back

    if len(session.frames) > MOST_IN_MEMORY:
        give_back()


def conclude(
    session: SessionData,
    assessment: "Assessment",
    folder: Path,
    own_elapsed_us: "array[float]",
    *,
    plots: bool,
    paper: bool = False,
) -> dict[str, Any]:
    """Write the report of a judged session and this host's own times into a folder; returns the report."""
    _give_back(session)  # before what draws is imported
    from gse.process.release_memory import spare_pandas
    from gse.report import summarise
    from gse.report.files import write_report
    from gse.report.provenance import provenance

    report = summarise(session, assessment)
    spare_pandas()
    try:
        write_report(session, assessment, folder, provenance(session.versions, _self_check()), plots=plots, paper=paper)
        write_whole(folder / "timing.json", [json.dumps(_timing(own_elapsed_us), indent=2) + "\n"])
    except (UsageError, OSError) as error:
        # The verdict is shown even if its file cannot be written.
        has_session = (folder / "session.mcap").exists()  # not where --out of a replay or report is
        following = f"make room, then: gse report {folder}" if has_session else "make room and repeat this command"
        click.echo(f"gse: {error}; {following}", err=True)
    return report


@dataclass(frozen=True, slots=True)
class Printed:
    """How a report is printed: as JSON, or its conclusion, with all else and the table of the paper where asked."""

    as_json: bool
    verbose: bool
    paper: bool


printed = gathered("printed", Printed, json_option, verbose_option, paper_option)


def show_report(report: dict[str, Any], session: Path, printed: Printed, *, json_frames: bool = False) -> None:
    """Print the verdict on the ``session`` at a path, or the report as JSON, to stdout; with --json-frames the verdict
    goes to stderr.
    """
    from rich.console import Console

    from gse.report.terminal import print_verdict

    if printed.as_json:
        click.echo(json.dumps(report))
        return
    console = Console(stderr=True) if json_frames else None
    print_verdict(report, str(session), console, verbose=printed.verbose, paper=printed.paper)


def show_path(folder: Path) -> None:
    """Print the path of the report to stderr, or that of the session where there is none."""
    for name, what in (("report.html", "report"), ("session.mcap", "session")):
        if (folder / name).exists():
            click.echo(f"{what}: {folder / name}", err=True)
            return


def applied(report: dict[str, Any], folder: Path, *, data_lost: str) -> list[Applied]:
    """The exit codes that apply to a report. ``data_lost`` describes lost data, or is empty.

    A report that could not be written into its folder is lost data too.
    """
    found: list[Applied] = [(EXIT_DATA_LOST, data_lost)] if data_lost else []
    if not (folder / "report.json").is_file():
        found.append((EXIT_DATA_LOST, "the report could not be written"))
    return [*found, ({"PASS": 0, "FAIL": EXIT_FAIL}.get(report["verdict"], EXIT_INCONCLUSIVE), report["word"])]


def say_exit_code(found: list[Applied]) -> int:
    """Print all exit codes that apply; returns the one of greatest weight."""
    found = sorted(found, key=lambda item: _WEIGHTIEST_FIRST.index(item[0]))
    click.echo(f"exit code {found[0][0]}: {', '.join(f'{text} ({code})' for code, text in found)}", err=True)
    return found[0][0]


def _self_check() -> dict[str, Any] | None:
    """The last self-check of this installation as a report states it; None where it never ran."""
    from gse.inspection.selfcheck_result import last_result

    result = last_result()
    if result is None:
        return None
    outcome = "agrees" if result.agrees else "DISAGREES"
    return {"outcome": outcome, "utc": result.utc, "sha256": result.sha256, "source_sha256": result.source_sha256}


def _timing(own_elapsed_us: "array[float]") -> dict[str, Any]:
    """Identification times of this host in this run; the report of a replay has the recorded ones instead."""
    times = np.array(own_elapsed_us) if own_elapsed_us else np.full(1, np.nan)
    statistics = {"p50": np.median(times), "p95": np.percentile(times, 95), "max": times.max()}
    return {
        "schema": "gse.timing/1",
        "frames": len(own_elapsed_us),
        "identification_us": {
            name: round(float(value), 1) if own_elapsed_us else None for name, value in statistics.items()
        },
    }
