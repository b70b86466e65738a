"""``gse selfcheck``: known errors through the station, injected against found."""

import json
from typing import TYPE_CHECKING

import click

from drivers.clock import read_clock
from gse.cli import EXIT_FAIL
from gse.values.instant import to_text

if TYPE_CHECKING:
    from gse.inspection.selfcheck_result import CheckedRow, SelfCheckResult


@click.command("selfcheck")
@click.option("--json", "as_json", is_flag=True, help="One JSON object, schema gse.selfcheck/1.")
@click.pass_context
def command(ctx: click.Context, *, as_json: bool) -> None:
    """Check this installation with sessions that contain known errors, which it must find.

    The sky is computed with astropy alone, without the station's own astrometry. The result is stored, and reports name
    it. The exit code is 1 if a quantity differs.
    """
    from gse.inspection.selfcheck import selfcheck

    shown: list[str] = []

    def show(row: "CheckedRow") -> None:
        if row.error not in shown:
            shown.append(row.error)
            click.echo(f"{row.error:38}{'injected':>10}{'found':>10}{'tolerance':>11}")
        click.echo(_line(row))

    result = selfcheck(to_text(read_clock().utc_ns, 0), each=lambda row: None if as_json else show(row))
    click.echo(json.dumps(result.to_json()) if as_json else _summary(result))
    _keep(result)
    ctx.exit(0 if result.agrees else EXIT_FAIL)


def _line(row: "CheckedRow") -> str:
    quantity = f"{row.quantity} ({row.unit})" if row.unit else row.quantity
    digits = 0 if not row.unit else 4 if row.unit == "%" else 2
    injected, found = (f"{round(value, digits) + 0.0:10.{digits}f}" for value in (row.injected, row.found))
    tolerance = f"{row.tolerance:11.{digits}f}"
    return f"  {quantity:36}{injected}{found}{tolerance}  {'OK' if row.agrees else 'DIFFERS'}"


def _summary(result: "SelfCheckResult") -> str:
    wrong = [row for row in result.rows if not row.agrees]
    word = f"DIFFERS: {len(wrong)} of {len(result.rows)} quantities" if wrong else f"OK: {len(result.rows)} quantities"
    return f"{word}, gse {result.version},\nSHA-256 {result.sha256}"


def _keep(result: "SelfCheckResult") -> None:
    from gse.inspection.selfcheck_result import keep_result

    try:
        keep_result(result)
    except OSError as error:
        click.echo(f"gse: the result could not be stored for the reports: {error}", err=True)
