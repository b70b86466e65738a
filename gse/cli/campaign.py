"""``gse campaign``: many sessions judged into a data set, its report, and questions to it."""

import importlib.util
import json
import os
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.cli import EXIT_DATA_LOST, EXIT_FAIL, EXIT_INCONCLUSIVE, EXIT_INTERRUPTED
from gse.cli.options import NewFolder
from gse.cli.progress import ProgressBar
from gse.config.choice import station_of
from gse.errors import UsageError
from gse.process.release_memory import spare_pandas
from gse.values.text import count_text

if TYPE_CHECKING:
    from gse.campaign.dataset import DataSet
    from gse.campaign.judging import JudgedSource

SCHEMA = "gse.campaign-run/1"
PACKAGES = ("dask", "distributed", "duckdb", "fsspec", "paramiko", "tenacity", "pyarrow")
_MOST_LINES = 20


def require_packages() -> None:
    """UsageError with the line that installs them, where packages of campaigns are not installed."""
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise UsageError(
            f"campaigns need packages that are not installed ({', '.join(missing)}); install them, in the folder of "
            "gse, with: .venv/bin/pip install '.[campaign]'"
        )


@click.group("campaign")
def command() -> None:
    """Judge many sessions on a Dask cluster into a Parquet data set, report on it, ask it questions in SQL.

    Paths may be folders and globs of this host, or URLs: sftp://user@host/folder, s3://bucket/folder. See
    docs/campaigns.md for credentials, clusters and TLS.
    """


@command.command("judge")
@click.argument("sources", nargs=-1, required=True, metavar="SOURCES...")
@click.option(
    "--out",
    "dataset_url",
    required=True,
    metavar="DATASET",
    help="Folder or URL of the data set; made where there is none.",
)
@click.option(
    "--scheduler", help="Address of a Dask scheduler, e.g. tcp://127.0.0.1:8786; default: workers on this machine."
)
@click.option(
    "--workers", type=click.IntRange(1, 256), help="Number of worker processes on this machine; default: its cores."
)
@click.option(
    "--station",
    "station_path",
    type=click.Path(path_type=Path),
    help="Station file for all sessions, instead of their own.",
)
@click.option(
    "--session-limit",
    "limit_min",
    type=click.IntRange(1, 10_000),
    default=60,
    show_default=True,
    help="Minutes that a worker may take for one session.",
)
@click.option("--rehash", is_flag=True, help="Read sources whose size and time of change are as before, too.")
@click.option("--json", "as_json", is_flag=True, help="The outcome as one JSON object on stdout.")
@click.pass_context
def judge_command(
    ctx: click.Context,
    *,
    sources: tuple[str, ...],
    dataset_url: str,
    scheduler: str | None,
    workers: int | None,
    station_path: Path | None,
    limit_min: int,
    rehash: bool,
    as_json: bool,
) -> None:
    """Judge the sessions of SOURCES as gse replay does, and put the results into DATASET.

    What is in DATASET already, from the same session, station file and software, is not judged again: the same command
    goes on after a run that ended early. A session that cannot be judged is a row with its error. Exit code 0, or 3
    where a session has an error or is damaged.
    """
    require_packages()
    from gse.campaign.cluster import cluster
    from gse.campaign.dataset import OWN_STATION, DataSet, station_sha256
    from gse.campaign.engine import plan_campaign, run_campaign
    from gse.campaign.first_compilation import compile_first
    from gse.campaign.sources import find_sources

    if scheduler is not None and workers is not None:
        raise UsageError("--scheduler has workers of its own; leave out --workers or --scheduler")
    station = station_of(station_path) if station_path else None
    found = find_sources(sources)
    dataset = DataSet.at(_absolute(dataset_url), create=True)
    campaign = plan_campaign(
        found,
        dataset,
        station=station,
        station_sha256=station_sha256(*station) if station else OWN_STATION,
        rehash=rehash,
        limit_s=60 * limit_min,
    )
    outcomes = list(campaign.unchanged)
    if campaign.todo:
        try:
            if scheduler is None:
                compile_first(lambda text: click.echo(text, err=True))
            with (
                cluster(scheduler, workers or _cores(len(campaign.todo))) as client,
                ProgressBar("judging", len(campaign.todo)) as bar,
            ):
                outcomes = run_campaign(campaign, client, lambda judged: bar.advance(is_error=bool(judged.error)))
        except KeyboardInterrupt:
            click.echo(f"interrupted; what was judged is in {dataset.url}: start the same command again", err=True)
            ctx.exit(EXIT_INTERRUPTED)
    document = _document(dataset, outcomes)
    click.echo(json.dumps(document) if as_json else "\n".join(_lines(document)))
    ctx.exit(EXIT_DATA_LOST if document["errors"] or document["damaged"] else 0)


@command.command("report")
@click.argument("dataset_url", metavar="DATASET")
@click.option(
    "--station", "station_path", type=click.Path(path_type=Path), help="Report what was judged with this --station."
)
@click.option(
    "--out",
    type=NewFolder(),
    default="campaign-report",
    show_default=True,
    help="New folder for the report.",
)
@click.option("--pdf", is_flag=True, help="Also print campaign.html to campaign.pdf, by Chromium or Chrome.")
@click.option("--json", "as_json", is_flag=True, help="The report as one JSON object on stdout.")
@click.pass_context
def report_command(
    ctx: click.Context, *, dataset_url: str, station_path: Path | None, out: Path, pdf: bool, as_json: bool
) -> None:
    """Write campaign.html and campaign.json of DATASET: verdict, trends, error atlas, sky, and what was left out.

    The verdict is per sensor and requirement, with nights as the sample. The exit code is the verdict's.
    """
    require_packages()
    from gse.campaign.dataset import OWN_STATION, DataSet, station_sha256
    from gse.campaign.document import campaign_document
    from gse.campaign.page import write_campaign_report
    from gse.report.printing import find_browser, print_to_pdf

    spare_pandas()
    if out.exists():
        raise UsageError(f"{out} exists already; choose another --out")
    browser = find_browser() if pdf else None
    dataset = DataSet.at(_absolute(dataset_url))
    judged_with = station_sha256(*station_of(station_path)) if station_path else OWN_STATION
    with ProgressBar("reading", len(dataset.committed())) as bar:
        report = campaign_document(dataset, station_sha256=judged_with, each=bar.advance)
    page = write_campaign_report(report, out)
    if browser:
        click.echo(f"PDF: {print_to_pdf(browser, page)}", err=True)
    click.echo(json.dumps(report) if as_json else "\n".join(_verdict_lines(report)))
    click.echo(f"report: {page}", err=True)
    ctx.exit({"PASS": 0, "FAIL": EXIT_FAIL}.get(report["verdict"], EXIT_INCONCLUSIVE))


@command.command("query")
@click.argument("dataset_url", metavar="DATASET")
@click.argument("sql", metavar="SQL")
@click.option(
    "--format",
    "form",
    type=click.Choice(("text", "csv", "json")),
    default="text",
    show_default=True,
    help="Form of the answer; json has one object per line.",
)
def query_command(*, dataset_url: str, sql: str, form: str) -> None:
    """Ask DATASET a question in SQL, by DuckDB. Tables: sessions, frames, stars, housekeeping, names, atlas,
    and reports (report_json).

    For example: gse campaign query DATASET "select sensor, verdict, count(*) from sessions group by all"
    """
    require_packages()
    from gse.campaign.dataset import DataSet
    from gse.campaign.query import ask

    ask(DataSet.at(_absolute(dataset_url)), sql, form, sys.stdout)


def _verdict_lines(report: dict[str, Any]) -> list[str]:
    """The verdict of each sensor for a person."""
    from gse.campaign.decision import length_text

    lines = []
    for sensor in report["sensors"]:
        marks = [word for word in ("relative", "simulated") if sensor[word]]
        mark = f" ({', '.join(marks)})" if marks else ""
        length = (
            f"{count_text(sensor['nights'], 'night')}, {length_text(sensor['hours'])}"
            if sensor["nights"]
            else "no session counts"
        )
        lines.append(f"{sensor['name']}: {sensor['verdict']}{mark}, {length}")
        lines += [f"  {reason}" for reason in sensor["reasons"]]
        lines += [f"  {line}" for line in _atlas_lines(sensor["atlas"])]
    if report["left_out"]:
        lines.append(f"left out: {len(report['left_out'])} of {report['sessions']} sessions")
        lines += _some([f"  {one['source']}: {one['why']}" for one in report["left_out"]])
    return lines


def _atlas_lines(atlas: dict[str, Any] | None) -> list[str]:
    if atlas is None:
        return []
    lines = [
        f"pixel phase error along {one['axis']}: {one['amplitude_px']:.3f} px ({one['sigmas']:.1f} sigma)"
        for one in atlas["phase"]
        if one["found"]
    ]
    if atlas["stars_found"]:
        names = ", ".join(f"{star['name']} ({star['sigmas']:.1f} sigma)" for star in atlas["stars"][:5])
        lines.append(f"{count_text(atlas['stars_found'], 'star')} away from the catalogue's place: {names}")
    return lines


def _document(dataset: "DataSet", outcomes: list["JudgedSource"]) -> dict[str, Any]:
    """What became of the sources of this run, whether they were judged now or before."""
    from gse.campaign.dataset import UNKNOWN, DataSet
    from gse.campaign.storage import with_patience

    keys: dict[str, list[str]] = {}
    for one in outcomes:
        if one.key:
            keys.setdefault(one.key, []).append(one.source.url)
    columns = ("key", "sensor", "verdict", "truncated", "error")
    rows = []
    if keys:  # with a connection that may be newer than that of the run's beginning
        table = with_patience(dataset.url, lambda fs, root: DataSet(dataset.url, fs, root).sessions(columns))
        rows = [row for row in table.to_pylist() if row["key"] in keys]
    return {
        "schema": SCHEMA,
        "dataset": dataset.url,
        "sources": len(outcomes),
        "sessions": len(keys),
        "judged": len({one.key for one in outcomes if one.is_new}),
        "verdicts": dict(sorted(Counter(row["verdict"] for row in rows if row["verdict"]).items())),
        "sensors": dict(sorted(Counter(row["sensor"] for row in rows if row["sensor"] != UNKNOWN).items())),
        "damaged": sorted(keys[row["key"]][0] for row in rows if row["truncated"]),
        "twice": [sorted(urls) for urls in keys.values() if len(urls) > 1],
        "errors": [{"source": keys[row["key"]][0], "error": row["error"], "kept": True} for row in rows if row["error"]]
        + [{"source": one.source.url, "error": one.error, "kept": False} for one in outcomes if not one.key],
    }


def _lines(document: dict[str, Any]) -> list[str]:
    known, sessions = document["sessions"] - document["judged"], count_text(document["sessions"], "session")
    lines = [f"{sessions} in {document['dataset']}: {document['judged']} judged now, {known} before"]
    if document["verdicts"]:
        lines.append("verdicts: " + ", ".join(f"{count} {word}" for word, count in document["verdicts"].items()))
    if len(document["sensors"]) > 1:
        counts = ", ".join(f"{name} ({count})" for name, count in document["sensors"].items())
        lines.append(f"{len(document['sensors'])} sensors are among them, kept apart in data set and report: {counts}")
    lines += _some(
        [f"one session under {len(urls)} names, counted once: {', '.join(urls)}" for urls in document["twice"]]
    )
    lines += _some([f"damaged, judged as far as it goes: {url}" for url in document["damaged"]])
    lines += _some([_error_line(one) for one in document["errors"]])
    return lines


def _error_line(one: dict[str, Any]) -> str:
    later = "" if one["kept"] else " (not in the data set; the next run tries it again)"
    return f"not judged: {one['source']}: {one['error']}{later}"


def _some(lines: list[str]) -> list[str]:
    more = len(lines) - _MOST_LINES
    return lines if more <= 0 else [*lines[:_MOST_LINES], f"... and {more} more"]


def _cores(sessions: int) -> int:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, sessions)


def _absolute(url: str) -> str:
    """Workers have a working directory of their own."""
    return url if "://" in url else str(Path(url).absolute())
