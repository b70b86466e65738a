"""Text of the verdict panel."""

import math

from drivers.clock import ClockReading
from gse.station.results import LinkCounters
from gse.view.glance_word import bare_verdict
from gse.view.running_statistics import Moments, Running

_MARKS = {"PASS": "✔", "FAIL": "✘", "INCONCLUSIVE": "?"}


def verdict_so_far(
    running: Running,
    link: LinkCounters,
    clock: ClockReading | None = None,
    *,
    clock_error_s: float | None = None,
    dropped: int = 0,
) -> str:
    """Markdown on a running session; ``dropped`` counts frames that the slow view did not show."""
    limits, last = running.limits, running.last
    share = running.inside / running.d_ra.n if running.d_ra.n else math.nan
    lines = [
        f"# {headline(running, link.frames_lost)}",
        f"**{running.frames}** frames, **{percent(running.identified)}** identified, "
        f"**{percent(share)}** of these inside the limits",
        "",
        "| arcsec | last | mean | std | NEA | limit |",
        "|---|---|---|---|---|---|",
        _row("dRA*", last.d_ra_cosde_arcsec if last else None, running.d_ra, limits.d_ra_cosde_arcsec),
        _row("dDE", last.d_de_arcsec if last else None, running.d_de, limits.d_de_arcsec),
        *_own_rows(running),
        "",
        *(f"- {status}: {count}" for status, count in sorted(running.by_status.items())),
        f"- false answers, onboard: {running.false_answers}",
        f"- frames lost: {_loud(link.frames_lost)}, bytes discarded: {link.bytes_discarded} of {link.bytes_in}",
        f"- reconnects: {link.reconnects}, sensor resets: {link.sensor_resets}",
    ]
    if running.housekeeping:
        lines.append(f"- sensor: {running.housekeeping}")
    if running.sky:
        lines.append(f"- sky: **{running.sky}**: {running.sky_text}")
    if clock is not None:
        source = f"{clock.source}, " if clock.synchronised else ""
        lines.append(f"- clock: {source}{clock_health(clock, clock_error_s)}")
    if not math.isnan(running.frames_per_s):
        lines.append(f"- {running.frames_per_s:.1f} frames per second")
    if dropped:
        lines.append(f"- **not shown here: {dropped}** (the view was too slow; the session has them)")
    return "\n".join(lines)


def verdict_at_end(verdict: str, reasons: list[str], so_far: str) -> str:
    """Markdown of the verdict as a report prints it, its reasons, and the last statistics."""
    body = so_far.split("\n", 1)[1] if "\n" in so_far else so_far
    return "\n".join(
        [f"# {_MARKS.get(bare_verdict(verdict), '')} {verdict}", *(f"- {reason}" for reason in reasons), "", body]
    )


def headline(running: Running, lost: int) -> str:
    """State of a running session in a few words; ``lost`` counts frames that never came."""
    if not running.frames:
        return "Waiting for frames"
    if running.silence:
        return f"Running: {running.silence}"
    if not running.d_ra.n:
        return "Running: nothing compared yet"
    outside = running.outside(lost)
    return f"Running: OUTSIDE the limits: {', '.join(outside)}" if outside else "Running: inside the limits"


def standing(running: Running, lost: int) -> str:
    """The same in a word of VERDICT_COLOURS; empty before the first frame."""
    if not running.frames:
        return ""
    if running.silence or not running.d_ra.n:
        return "no answer"
    return "OUTSIDE" if running.outside(lost) else "inside"


def _loud(count: int) -> str:
    return f"**{count}**" if count else "0"


def _own_rows(running: Running) -> list[str]:
    """Rows of the sensor's own answers, where it sends some."""
    limits = running.limits
    axes = (
        ("sensor dRA*", running.own_d_ra, limits.d_ra_cosde_arcsec),
        ("sensor dDE", running.own_d_de, limits.d_de_arcsec),
    )
    return [_row(name, axis.last, axis, limit) for name, axis, limit in axes if axis.n]


def _row(name: str, last: float | None, moments: Moments, limit: float) -> str:
    signed = (last, moments.mean if moments.n else None)
    cells = [*map(arcsec, signed), *(arcsec(size, "") for size in (moments.std, moments.nea))]
    return f"| {name} | {' | '.join(cells)} | {limit:g} |"


def clock_health(clock: ClockReading, stated_s: float | None = None) -> str:
    """Whether the clock is synchronised, and how far off it may be; ``stated_s`` is what the operator measured."""
    if stated_s is not None:
        return f"within {1000 * stated_s:.3g} ms, as stated"
    if not clock.synchronised:
        return "NOT synchronised"
    return f"within {1000 * clock.error_bound_s:.3g} ms"


def arcsec(value: float | None, sign: str = "+") -> str:
    """One decimal, with its sign unless ``sign`` is empty, or a dash."""
    return "-" if value is None or math.isnan(value) else f"{value:{sign}.1f}"


def percent(share: float) -> str:
    """A share as percent, or a dash."""
    return "-" if math.isnan(share) else f"{100 * share:.1f} %"
