"""Text of the verdict panel."""

import math

from drivers.clock import ClockReading
from gse.station.housekeeping import in_words
from gse.view.live_state import ErrorsSoFar, SessionSoFar


def verdict_so_far(so_far: SessionSoFar, *, dropped: int = 0) -> str:
    """Markdown on a running session; ``dropped`` counts frames that the slow view did not show."""
    link, clock = so_far.link, so_far.clock
    share = so_far.inside / so_far.d_ra.n if so_far.d_ra.n else math.nan
    lines = [
        f"# {headline(so_far)}",
        f"**{so_far.frames}** frames, **{percent(so_far.identified)}** identified, "
        f"**{percent(share)}** of these inside the limits",
        "",
        "| arcsec | last | mean | std | NEA | limit |",
        "|---|---|---|---|---|---|",
        *(_row(whose + axis.label, errors, so_far.limits.of(axis)) for whose, axis, errors in so_far.compared),
        "",
        *(f"- {status}: {count}" for status, count in sorted(so_far.by_status.items())),
        f"- false answers, onboard: {so_far.false_answers}",
        f"- frames lost: {_loud(link.frames_lost)}, bytes discarded: {link.bytes_discarded} of {link.bytes_in}",
        f"- reconnects: {link.reconnects}, sensor resets: {link.sensor_resets}",
    ]
    if so_far.late:
        lines.append(f"- **{so_far.late}**")
    if so_far.status and (housekeeping := in_words(so_far.status)):
        lines.append(f"- sensor: {housekeeping}")
    if so_far.sky:
        lines.append(f"- sky: **{so_far.sky}**: {so_far.sky_text}")
    if clock is not None:
        source = f"{clock.source}, " if clock.synchronised else ""
        lines.append(f"- clock: {source}{clock_health(clock, so_far.clock_error_s)}")
    if not math.isnan(so_far.host_minus_sensor_s):
        lines.append(f"- {host_minus_sensor(so_far.host_minus_sensor_s)}")
    if not math.isnan(so_far.frames_per_s):
        lines.append(f"- {so_far.frames_per_s:.1f} frames per second")
    if dropped:
        lines.append(f"- **not shown here: {dropped}** (the view was too slow; the session has them)")
    return "\n".join(lines)


def verdict_at_end(verdict: str, reasons: list[str], so_far: str) -> str:
    """Markdown of the verdict as a report prints it, its reasons, and the last statistics."""
    body = so_far.split("\n", 1)[1] if "\n" in so_far else so_far
    return "\n".join([f"# {verdict}", *(f"- {reason}" for reason in reasons), "", body])


def headline(so_far: SessionSoFar) -> str:
    """State of a running session in a few words."""
    if not so_far.frames:
        return "Waiting for frames"
    if so_far.silence:
        return f"Running: {so_far.silence}"
    if not so_far.d_ra.n:
        return "Running: nothing compared yet"
    outside = so_far.outside
    return f"Running: OUTSIDE the limits: {', '.join(outside)}" if outside else "Running: inside the limits"


def standing(so_far: SessionSoFar) -> str:
    """The same in a word of VERDICT_COLOURS; empty before the first frame."""
    if not so_far.frames:
        return ""
    if so_far.silence or not so_far.d_ra.n:
        return "no answer"
    return "OUTSIDE" if so_far.outside else "inside"


def _loud(count: int) -> str:
    return f"**{count}**" if count else "0"


def _row(name: str, errors: ErrorsSoFar, limit: float) -> str:
    signed = (errors.last, errors.mean if errors.n else math.nan)
    cells = [*map(arcsec, signed), *(arcsec(size, "") for size in (errors.std, errors.nea))]
    return f"| {name} | {' | '.join(cells)} | {limit:g} |"


def clock_health(clock: ClockReading, stated_s: float | None = None) -> str:
    """Whether the clock is synchronised, and how far off it may be; ``stated_s`` is what the operator measured."""
    if stated_s is not None:
        return f"within {1000 * stated_s:.3g} ms, as stated"
    if not clock.synchronised:
        return "NOT synchronised"
    return f"within {1000 * clock.error_bound_s:.3g} ms"


def host_minus_sensor(seconds: float) -> str:
    """The host's clock against the sensor's own, with the delay of the sensor and of the line in it."""
    return f"host - sensor clock {seconds:+.3f} s"


def arcsec(value: float, sign: str = "+") -> str:
    """One decimal, with its sign unless ``sign`` is empty, or a dash."""
    return "-" if math.isnan(value) else f"{value:{sign}.1f}"


def percent(share: float) -> str:
    """A share as percent, or a dash."""
    return "-" if math.isnan(share) else f"{100 * share:.1f} %"
