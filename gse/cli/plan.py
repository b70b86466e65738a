"""``gse plan``: how long a session must be for a verdict."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.cli import EXIT_FAIL
from gse.cli.folding import folded
from gse.config.choice import station_of
from gse.errors import UsageError

if TYPE_CHECKING:
    from gse.assessment.session_plan import AxisQuestion, SessionPlan
    from gse.assessment.verdict import Assessment
    from gse.config.station import Station

_QUANTITY = re.compile(r"([+-]?\d+(?:\.\d*)?(?:e[+-]?\d+)?) ?([a-zA-Z/]+)")
_ANGLES = {"mas": 1e-3, "arcsec": 1.0, "arcmin": 60.0, "deg": 3600.0}
_TIMES = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_RATES = {"Hz": 1.0, "/s": 1.0, "/min": 1 / 60}


def _quantity(
    units: dict[str, float], example: str, *, least: float = 0.0
) -> Callable[[click.Context, click.Parameter, str | None], float | None]:
    """Reads a number with its unit."""

    def read(ctx: click.Context, param: click.Parameter, text: str | None) -> float | None:
        if text is None:
            return None
        found = _QUANTITY.fullmatch(text.strip())
        number = float(found[1]) * units[found[2]] if found and found[2] in units else math.nan
        if not (math.isfinite(number) and number >= least):
            at_least = f"that is {least:g} or more" if math.isfinite(least) else "of either sign"
            raise UsageError(
                f"{param.opts[0]} is {text!r:.60}; expected a number {at_least}, with its unit "
                f"({', '.join(units)}), for example {example}"
            )
        return number

    return read


_angle = _quantity(_ANGLES, "10arcsec")
_noise = _quantity(_ANGLES, "10arcsec", least=1e-3)  # equal errors tell no bounds, however many
_signed_angle = _quantity(_ANGLES, "-5arcsec", least=-math.inf)
_limit = _quantity(_ANGLES, "60arcsec", least=1e-3)
_time = _quantity(_TIMES, "3s")
_rate = _quantity(_RATES, "10Hz", least=1e-6)


@click.command("plan")
@click.argument("session", required=False, type=click.Path(path_type=Path))
@click.option(
    "--station", "station_path", type=click.Path(path_type=Path), help="Station file; default: the built-in station."
)
@click.option("--noise", "noise_arcsec", callback=_noise, help="Standard deviation of dRA* and dDE, e.g. 10arcsec.")
@click.option("--roll-noise", "roll_noise_arcsec", callback=_noise, help="Standard deviation of roll, e.g. 2arcmin.")
@click.option("--tau", "tau_s", callback=_time, help="Time that an independent value of an error takes, e.g. 3s.")
@click.option("--error", "bias_arcsec", callback=_signed_angle, help="Constant error that is expected, e.g. 5arcsec.")
@click.option("--limit", "limit_arcsec", callback=_limit, help="Limit of dRA* and dDE, instead of the station file's.")
@click.option(
    "--truth", "truth_arcsec", callback=_angle, help="Standard uncertainty of truth, instead of the budget's."
)
@click.option("--rate", "frames_per_s", callback=_rate, help="Frame rate, e.g. 10Hz.")
@click.option(
    "--availability",
    type=click.FloatRange(min=0, max=1, min_open=True),
    help="Share of the frames that are expected to be answered.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.plan/1.")
@click.pass_context
def command(
    ctx: click.Context, /, *, session: Path | None, station_path: Path | None, as_json: bool, **expected: float | None
) -> None:
    """Show how long a session must be for a PASS with 90 % probability, if the sensor performs as expected.

    Angles, times and rates have their unit: 10arcsec, 3s, 10Hz. Without options it expects whole-pixel positions of 20
    stars, each for the time that a star takes over a pixel. With a recorded SESSION its own statistics are used, and
    the additional time for a verdict is shown. Exit code 1 where no length of session gives a verdict.
    """
    if session is not None:
        if any(value is not None for value in (station_path, *expected.values())):
            raise UsageError("a session has its own statistics: give either SESSION or options, not both")
        ctx.exit(_of_session(session, as_json=as_json))
    station, _ = station_of(station_path)
    ctx.exit(_of_station(station, expected, as_json=as_json))


def _of_station(station: "Station", given: dict[str, float | None], *, as_json: bool) -> int:
    from gse.assessment.session_plan import session_plan
    from gse.inspection.planned_session import RATE_HZ, expected_availability, questions

    frames_per_s = RATE_HZ if given["frames_per_s"] is None else given["frames_per_s"]
    availability = expected_availability(station) if given["availability"] is None else given["availability"]
    axes = questions(station, given, frames_per_s)
    plan = session_plan(axes, station.limits, availability=availability, frames_per_s=frames_per_s)
    document = {"expected": _expected(axes, availability, frames_per_s), **_planned(plan)}
    if as_json:
        click.echo(json.dumps({"schema": "gse.plan/1", "session": None, **document}))
    else:
        lines = [*_assumptions(axes, availability, frames_per_s), "", *_table(plan), "", _summary(plan)]
        click.echo(folded("\n".join(lines), indent=2))
    return 0 if plan.frames is not None else EXIT_FAIL


def _of_session(path: Path, *, as_json: bool) -> int:
    from gse.assessment.session_plan import minutes_left, plan_like, rows_left
    from gse.cli.progress import judged_with_progress

    judged = judged_with_progress(path)
    session, assessment = judged.session, judged.assessment
    subject = max(assessment.statistics.subjects)  # the sensor's own answers where it sends them
    plan = plan_like(assessment, subject, session.station.limits)
    left_min = minutes_left(assessment)
    if as_json:
        rows = [
            {"subject": item.row.subject, "name": item.row.name, "outcome": item.row.outcome, **_left(item.minutes)}
            for item in rows_left(assessment)
        ]
        like = _planned(plan) if plan else {"rows": None, "frames": None, "minutes": None}
        head = {"schema": "gse.plan/1", "session": str(path), "verdict": assessment.verdict, **_left(left_min)}
        click.echo(json.dumps({**head, "session_rows": rows, **like}))
    else:
        undecided = [item for item in rows_left(assessment) if item.minutes != 0]
        lines = [f"  {item.row.label}: {_more_minutes(item.minutes)}" for item in undecided]
        click.echo(folded("\n".join([_headline(assessment, left_min), *lines]), indent=2))
        if plan is not None:
            click.echo("\n".join(["", "Another session like this one:", *_table(plan), "", _summary(plan)]))
    return EXIT_FAIL if math.isinf(left_min) else 0


def _headline(assessment: "Assessment", left_min: float) -> str:
    if left_min == 0:
        return f"{assessment.word}: it is decided"
    if math.isfinite(left_min):
        return f"{assessment.word}: {_more_minutes(left_min)} would have decided"
    if math.isnan(left_min):
        return f"{assessment.word}: too short to tell how long it must be"
    return "\n".join([f"{assessment.word}: a longer session like this decides nothing", *assessment.reasons])


def _left(minutes: float) -> dict[str, Any]:
    return {"decided": minutes == 0, "more_minutes": round(minutes, 2) if math.isfinite(minutes) else None}


def _more_minutes(minutes: float) -> str:
    if math.isnan(minutes):
        return "too short to tell"
    if math.isinf(minutes):
        return "no length decides"
    count = max(math.ceil(minutes), 1)
    return f"{count} more minute{'s' if count > 1 else ''}"


def _planned(plan: "SessionPlan") -> dict[str, Any]:
    from gse.assessment.planning import PROBABILITY

    rows = [
        {
            "name": row.name,
            "limit": row.limit,
            "unit": row.unit,
            "frames": row.frames,
            "minutes": _minutes(plan, row.frames),
        }
        for row in plan.rows
    ]
    return {"probability": PROBABILITY, "rows": rows, "frames": plan.frames, "minutes": _minutes(plan, plan.frames)}


def _minutes(plan: "SessionPlan", frames: int | None) -> float | None:
    minutes = plan.minutes(frames)
    return None if minutes is None else round(minutes, 2)


def _expected(axes: "tuple[AxisQuestion, ...]", availability: float, frames_per_s: float) -> dict[str, Any]:
    of_axes = [
        {
            "name": axis.name,
            "noise_arcsec": round(axis.expected.noise_arcsec, 3),
            "bias_arcsec": round(axis.expected.bias_arcsec, 3),
            "tau_s": round(axis.expected.tau_s, 3),
            "truth_arcsec": round(axis.truth_arcsec, 3) if math.isfinite(axis.truth_arcsec) else None,
        }
        for axis in axes
    ]
    return {"axes": of_axes, "availability": availability, "frames_per_s": frames_per_s}


def _assumptions(axes: "tuple[AxisQuestion, ...]", availability: float, frames_per_s: float) -> list[str]:
    lines = [
        f"{axis.name:5} error {axis.expected.bias_arcsec:g} arcsec, noise {axis.expected.noise_arcsec:.3g} arcsec, "
        f"an independent value each {axis.expected.tau_s:.3g} s, truth {axis.truth_arcsec:.3g} arcsec"
        for axis in axes
    ]
    return [
        "Expected:",
        *lines,
        f"{100 * availability:.4g} % of the frames answered, none falsely, {frames_per_s:g} Hz",
    ]


def _table(plan: "SessionPlan") -> list[str]:
    limits = [f"{row.limit:g} {row.unit}".strip() for row in plan.rows]
    lines = [
        f"{row.name:16}{limit:>14}{_cells(plan, row.frames)}" for row, limit in zip(plan.rows, limits, strict=True)
    ]
    return [f"{'row':16}{'limit':>14}{'frames':>10}{'minutes':>10}", *lines]


def _cells(plan: "SessionPlan", frames: int | None) -> str:
    minutes = plan.minutes(frames)
    return f"{frames:>10}{minutes:>10.1f}" if minutes is not None else f"{'never':>10}{'never':>10}"


def _summary(plan: "SessionPlan") -> str:
    minutes = plan.minutes(plan.frames)
    if minutes is not None:
        return f"{plan.frames} frames, {minutes:.1f} minutes, for a PASS with 90 % probability"
    words = " and ".join(row.name for row in plan.rows if row.frames is None)
    return f"no length of session gives a PASS: {words} cannot keep the limit, with what is expected and truth leaves"
