"""``gse plan``: how long a session must be for a verdict."""

import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gse.cli import EXIT_FAIL, folded
from gse.cli.options import session_argument

if TYPE_CHECKING:
    from gse.verdict.assessment import Assessment
    from gse.verdict.session_plan import SessionPlan


_GLUE = "\N{NO-BREAK SPACE}"


@click.command("plan")
@session_argument
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.plan/1.")
@click.pass_context
def command(ctx: click.Context, *, path: Path, as_json: bool) -> None:
    """Show how much longer SESSION must have been for its verdict, and how long another one like it must be.

    Another one: for a PASS with 90 % probability, if the sensor performs as in SESSION; without SESSION the newest one
    below ./sessions. Exit code 1 where no length of session gives a verdict.
    """
    ctx.exit(_of_session(path, as_json=as_json))


def _of_session(path: Path, *, as_json: bool) -> int:
    from gse.cli.progress import judged_with_progress
    from gse.verdict.session_plan import minutes_left, plan_like, rows_left

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
        click.echo(folded(_headline(assessment, left_min), indent=2))
        for line in (*(_others(assessment) if math.isinf(left_min) else ()), *lines):
            click.echo(_with_commands_whole(line.replace("SESSION", str(path))))
        if plan is not None:
            click.echo("\n".join(["", "Another session like this one:", *_table(plan), ""]))
            click.echo(folded(_summary(plan), indent=2))
    return EXIT_FAIL if math.isinf(left_min) else 0


def _headline(assessment: "Assessment", left_min: float) -> str:
    from gse.verdict.session_plan import lacks_sky

    if left_min == 0:
        return f"{assessment.word}: it is decided"
    if math.isfinite(left_min):
        return f"{assessment.word}: {_more_minutes(left_min)} would have decided"
    if math.isnan(left_min):
        return f"{assessment.word}: too short to tell how long it must be"
    which = "no length of such a sky decides" if lacks_sky(assessment) else "no length can be named that decides"
    return f"{assessment.word}: {which}"


def _others(assessment: "Assessment") -> list[str]:
    """The reasons but those of rows that a longer session decides: how much longer is said below them."""
    from gse.verdict.session_plan import rows_left

    decided = {item.row.reason for item in rows_left(assessment) if math.isfinite(item.minutes)}
    return [reason for reason in assessment.reasons if reason not in decided]


def _with_commands_whole(line: str) -> str:
    """A line as ``folded`` has it, each command in one piece, which can be copied."""
    glued = re.sub("gse [^;]*", lambda command: command[0].replace(" ", _GLUE), line)
    return folded(glued, indent=2).replace(_GLUE, " ")


def _left(minutes: float) -> dict[str, Any]:
    return {"decided": minutes == 0, "more_minutes": round(minutes, 2) if math.isfinite(minutes) else None}


def _more_minutes(minutes: float) -> str:
    if math.isnan(minutes):
        return "too short to tell"
    if math.isinf(minutes):
        return "no length can be named that decides"
    count = max(math.ceil(minutes), 1)
    return f"{count} more minute{'s' if count > 1 else ''}"


def _planned(plan: "SessionPlan") -> dict[str, Any]:
    from gse.statistics.decision import PROBABILITY

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
    left = "with errors like these and the uncertainty of truth"
    return f"no length of session gives a PASS: {words} cannot keep the limit, {left}"
