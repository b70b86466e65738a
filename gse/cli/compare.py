"""``gse compare``: sessions side by side, or one session under two identifiers or two station files."""

import functools
import json
import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.cli import EXIT_FAIL, EXIT_INCONCLUSIVE, damage_code
from gse.cli.options import IDENTIFIER, PLUG_HELP, anew_option, newest_sessions, say, start_utc_option
from gse.config.choice import StationText, change_to
from gse.errors import UsageError
from gse.sessions.expected_answers import ExpectedAttitudes
from gse.station.session_data import SessionData
from gse.statistics.session_statistics import statistics
from gse.verdict.compared_rows import ComparedRow
from gse.verdict.session_comparison import SessionComparison, session_comparison

if TYPE_CHECKING:
    from gse.station.loop import StationLoop

_OPEN = "nothing can be compared: no answer counts in one of the sessions"


@click.command("compare")
@click.argument("first", metavar="[A]", required=False, type=click.Path(path_type=Path))
@click.argument("others", metavar="[B]...", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--identifier",
    "identifiers",
    multiple=True,
    type=IDENTIFIER,
    help=f"Identifier of the second session; given twice: of the first and the second. {PLUG_HELP}",
)
@click.option(
    "--station",
    "stations",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Station file of the second session; given twice: of the first and the second.",
)
@click.option(
    "--sigmas",
    type=click.FloatRange(min=0),
    default=3.0,
    show_default=True,
    help="A difference of more sigmas than this is significant.",
)
@click.option(
    "--allow",
    "allowed_share",
    type=click.FloatRange(min=0),
    default=0.01,
    show_default=True,
    help="Share of a limit by which a value may become worse: 0.01 of a limit of 60 arcsec is 0.6 arcsec.",
)
@click.option("--bias-is-regression", is_flag=True, help="A bias that changed, either way, is a regression too.")
@click.option(
    "--with-sensor",
    is_flag=True,
    help="Compare each answer of A with the one that the sensor sent to the same panorama, on the counts of the wire.",
)
@start_utc_option
@anew_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.compare/1.")
@click.pass_context
def command(
    ctx: click.Context,
    *,
    first: Path | None,
    others: tuple[Path, ...],
    identifiers: tuple[str, ...],
    stations: tuple[Path, ...],
    sigmas: float,
    allowed_share: float,
    bias_is_regression: bool,
    with_sensor: bool,
    start_utc: str | None,
    anew: bool,
    as_json: bool,
) -> None:
    """Compare the statistics of session A and session B, or of A under two identifiers or two station files.

    Without A: the newest session below ./sessions, and the one of the same sensor before it.

    The exit code is 1 if the second session is worse: by more than --sigmas, and by more than --allow of a limit, in
    the answers of the identifier, or in the sensor's own where both sessions have some; 5 if nothing can be compared.
    Sessions of different panoramas are compared as over the star fields of the first. More than two sessions, of one
    sensor or of several, get a row each in the table of the LAPAN paper, and each is compared with A.

    --with-sensor asks whether the identifier on the host is the one in the sensor: the exit code is 1 if an answer
    differs from the ATTITUDE frame of its panorama, 5 if there is no answer to compare.
    """
    if first is None:
        first, others = _newest(alone=bool(with_sensor or identifiers or stations))
    if with_sensor:
        if others or len(identifiers) > 1 or len(stations) > 1:
            raise UsageError("--with-sensor compares one session with its sensor; leave out B and second options")
        change = change_to(stations[0] if stations else None, identifiers[0] if identifiers else None)
        ctx.exit(_with_sensor(first, change, start_utc, as_json=as_json))
    if len(others) > 1 and (identifiers or stations):
        raise UsageError(f"{len(others) + 1} sessions are compared as they are; leave out --identifier and --station")
    if not others and not identifiers and not stations:
        raise UsageError("a comparison needs two sides; give a second session, or --identifier, or --station")
    paths = (first, *(others or [first]))
    sessions = [
        _session(path, _of(identifiers, place), _of(stations, place), start_utc, anew=anew)
        for place, path in enumerate(paths)
    ]
    lost = _damage_code(paths, sessions)
    compared = functools.partial(
        session_comparison, sigmas=sigmas, allowed_share=allowed_share, bias_is_regression=bias_is_regression
    )
    comparisons = [compared(sessions[0], session) for session in sessions[1:]]
    if len(others) > 1:
        document = _document_of_many(paths, sessions, comparisons)
        lines = _lines_of_many(document)
    else:
        (only,), programs = comparisons, _programs(sessions)
        document = compare_report(only) | programs
        lines = [*_lines(only), *_program_lines(programs)]
    click.echo(json.dumps(document) if as_json else "\n".join(lines))
    ctx.exit(lost or _exit_code(comparisons))


def _newest(*, alone: bool) -> tuple[Path, tuple[Path, ...]]:
    """The newest session, ``alone`` or after the one of the same sensor before it."""
    newest, *older = newest_sessions()
    if alone:
        say(f"the newest session: {newest}")
        return newest, ()
    before = next((folder for folder in older if _sensor_in(folder) == _sensor_in(newest)), None)
    if before is None:
        raise UsageError(f"{newest} is the only session of its sensor below ./sessions; give a second one")
    say(f"the newest two sessions of a sensor: {before} and {newest}")
    return before, (newest,)


def _sensor_in(folder: Path) -> str:
    """The name of the sensor in that of a session folder, <UTC>-<sensor>, or <UTC>-<sensor>-2."""
    return re.sub(r"-\d+$", "", folder.name.partition("-")[2])


def _with_sensor(
    path: Path, change: "Callable[[StationText], StationText]", start_utc: str | None, *, as_json: bool
) -> int:
    """Compare the answers to a session with the sensor's own; returns the exit code."""
    from gse.cli.progress import replay_with_progress
    from gse.sessions.replay import ReplayOptions

    attitudes: list[ExpectedAttitudes] = []

    def listeners_of(loop: "StationLoop") -> "list[ExpectedAttitudes]":
        protocol = loop.setup.protocol
        if not protocol.slots:
            raise UsageError(
                f"--with-sensor: {protocol.name} has no panoramas, so nothing is identified that the sensor's answers "
                "could be compared with; their errors are in the report"
            )
        attitudes.append(ExpectedAttitudes(protocol, loop.setup.station.sensor.attitude))
        return attitudes

    replay = replay_with_progress(path, listeners_of, ReplayOptions(start_utc=start_utc), change)
    (sent,) = attitudes
    sent.finish(replay.session)
    names = ("compared", "answered", "different", "missing", "unused")
    document = {name: getattr(sent, name) for name in names} | {"differences": sent.listed}
    click.echo(json.dumps({"schema": "gse.compare-sensor/1", **document}) if as_json else sent.text())
    lost = damage_code(path, damaged=replay.session.truncated)
    return lost or (EXIT_FAIL if not sent.is_same else 0 if sent.answered else EXIT_INCONCLUSIVE)


def _exit_code(comparisons: Sequence[SessionComparison]) -> int:
    if any(result.regressions for result in comparisons):
        return EXIT_FAIL
    return EXIT_INCONCLUSIVE if any(result.is_open for result in comparisons) else 0


def _word(regressions: Sequence[str], *, is_open: bool) -> str:
    """What a comparison found, in a line."""
    if regressions:
        return f"REGRESSION in {', '.join(regressions)}"
    return f"INCONCLUSIVE: {_OPEN}" if is_open else "no regression"


def _of(options: tuple[Any, ...], place: int) -> Any:
    """The option of the first (0) or second (1) session: one value is for the second."""
    if len(options) > 2:
        raise UsageError(
            f"an option was given {len(options)} times; expected once (second session) or twice (first and second)"
        )
    return options[place] if len(options) == 2 else options[0] if options and place == 1 else None


def _session(
    path: Path, identifier: str | None, station_path: Path | None, start_utc: str | None, *, anew: bool
) -> SessionData:
    from gse.cli.progress import judged_with_progress
    from gse.sessions.replay import ReplayOptions

    change = change_to(station_path, identifier)
    session = judged_with_progress(path, options=ReplayOptions(start_utc=start_utc), station=change, anew=anew).session
    if not len(session.frames) and not len(session.sensor_attitudes):
        raise UsageError(f"{path} has neither a panorama nor an answer of the sensor to compare; see 'gse why {path}'")
    return session


def _damage_code(paths: Sequence[Path], sessions: Sequence[SessionData]) -> int:
    """The exit code of sessions of which a part is missing, each printed once, or 0."""
    damaged = {path: session.truncated for path, session in zip(paths, sessions, strict=True)}
    return max(damage_code(path, damaged=truncated) for path, truncated in damaged.items())


def _programs(sessions: Sequence[SessionData]) -> dict[str, Any]:
    """The external identifiers of the two sides, with their failures; nothing where there is none."""
    from gse.report.summary import external_identifier, plain

    found = {side: external_identifier(session) for side, session in zip(("first", "second"), sessions, strict=True)}
    programs = {side: plain(program) for side, program in found.items() if program is not None}
    return {"external_identifiers": programs} if programs else {}


def _program_lines(programs: dict[str, Any]) -> list[str]:
    from gse.report.terminal import external_lines

    found = programs.get("external_identifiers", {}).items()
    return ["", *(f"{side}: {line}" for side, program in found for line in external_lines(program))] if found else []


def compare_report(result: SessionComparison) -> dict[str, Any]:
    """The JSON of schema gse.compare/1."""
    return {
        "schema": "gse.compare/1",
        "regression": None if result.is_open else bool(result.regressions),
        "paired": result.paired,
        "rows": [_row_report(row) for row in result.rows],
        "metrics": [_row_report(row) for row in result.metrics],
    }


def _row_report(row: ComparedRow) -> dict[str, Any]:
    return {
        "name": row.name,
        "unit": row.unit,
        "first": _number(row.first),
        "second": _number(row.second),
        "second_alike": _number(row.alike),
        "difference": _number(row.difference),
        "sigmas": _number(row.sigmas, 2),
        "allowed": _number(row.allowed),
        "gated": row.gate,
        "worse": row.worse,
    }


def _document_of_many(
    paths: Sequence[Path], sessions: Sequence[SessionData], comparisons: Sequence[SessionComparison]
) -> dict[str, Any]:
    """The JSON of schema gse.compare-many/1: a row for each subject of each session, and each session against A."""
    from gse.report.summary import plain, table_4_1

    names = [f"{session.station.sensor.name} {path.name}" for path, session in zip(paths, sessions, strict=True)]
    table = table_4_1((name, statistics(session)) for name, session in zip(names, sessions, strict=True))
    return {
        "schema": "gse.compare-many/1",
        "regression": any(result.regressions for result in comparisons),
        "table_4_1": plain(table),
        "comparisons": [
            {"first": names[0], "second": name, **compare_report(result)}
            for name, result in zip(names[1:], comparisons, strict=True)
        ],
    }


def _lines_of_many(document: dict[str, Any]) -> list[str]:
    from gse.report.terminal import TABLE_4_1_HEAD, aligned, table_4_1_rows

    lines = [*aligned(TABLE_4_1_HEAD, table_4_1_rows(document)), ""]
    for item in document["comparisons"]:
        worse = [row["name"] for row in item["rows"] if row["worse"]]
        found = _word(worse, is_open=item["regression"] is None)
        lines.append(f"{item['second']} against {item['first']}: {found}")
    return lines


def _number(value: float, digits: int = 6) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _lines(result: SessionComparison) -> list[str]:
    """The result for a person."""
    head = f"{'':27}{'first':>8}{'second':>8}{'alike':>8}{'diff.':>8}{'sigmas':>7}{'allowed':>8}"
    paired = (
        "the same panoramas in both" if result.paired else "different panoramas; alike: over the fields of the first"
    )
    return [
        _word([row.name for row in result.regressions], is_open=result.is_open),
        paired,
        "",
        head,
        *(_line(row) for row in result.rows),
        "",
        "allowed -: not judged.",
        "Metrics after ECSS-E-ST-60-20C (docs/metrics.md), not judged either;",
        "x along columns, y along rows:",
        f"{'':52}{'first':>7}{'second':>7}{'diff.':>8}{'sigma':>6}",
        *(_metric_line(row) for row in result.metrics),
    ]


def _metric_line(row: ComparedRow) -> str:
    name = f"{row.name}, {row.unit}".replace("noise equivalent angle", "NEA")
    values = f"{_figure(row.first, '7.3g')}{_figure(row.second, '7.3g')}{_figure(row.difference, '+8.3g')}"
    return f"{name:52}{values}{_figure(row.sigmas, '6.1f')}"


def _figure(value: float, form: str) -> str:
    """A number, or a dash of the same width where there is none; a blank parts it from the one before."""
    width = len(f"{0.0:{form}}")
    if not math.isfinite(value):
        return f"{'-':>{width}}"
    sign = "+" if form.startswith("+") else ""
    text = f"{value:{sign}.0f}" if 1000 <= abs(value) < 1e5 else f"{value:{form}}".strip()
    return f" {text}".rjust(width)


def _sigmas(value: float) -> str:
    """Those of another program on the same panoramas may be thousands."""
    return _figure(value, "7.1f" if abs(value) < 1e4 else "+7.0e")


def _line(row: ComparedRow) -> str:
    name = f"{row.name} ({row.unit})" if row.unit else row.name
    values = "".join(_figure(value, "8.4g") for value in (row.first, row.second, row.alike))
    values += _figure(row.difference, "+8.3g") + _sigmas(row.sigmas)
    allowed = f"{row.allowed:8.3g}" if row.gate else f"{'-':>8}"
    return f"{name:27}{values}{allowed}{' WORSE' if row.worse else ''}"
