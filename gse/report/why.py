"""One page on a session: what happened, when, why, and what to do next."""

import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from drivers.chunk import LinkEvent
from gse import instant
from gse.report.terminal import headline
from gse.station.exclusions import Cause
from gse.station.results import Subject

WIDTH = 80
_MOST_EVENTS = 12
_MOST_REASONS = 8
_GLUE = "\N{NO-BREAK SPACE}"
_QUIET = {"OPENED", "SYNCING", "STREAMING", "CLOSED"}
"""The ordinary course of a session."""

_STDERR_STEP = "see what the external identifier wrote to stderr: gse session export SESSION --format stderr"


_NO_SKY = (Cause.NO_SKY, Cause.NO_OBJECTS)
_NIGHT_STEP = "repeat it under a clear, dark sky, without a lens cap; when it is dark: gse preflight --station FILE"


def why_page(report: dict[str, Any], events: Sequence[LinkEvent], session: str) -> str:
    """The page, from a report (as ``summarise`` gives it) and the events; ``session`` stands in the commands."""
    return "\n".join(
        [
            *_head(report),
            "",
            "What happened",
            *_events(events),
            "",
            "Why",
            *_why(report),
            "",
            "What next",
            *_next(report, session),
        ]
    )


def _head(report: dict[str, Any]) -> Iterator[str]:
    facts, found = report["session"], report["identification"]
    verdict = headline(report["word"], simulated=report["simulated"])
    yield f"{verdict}: {facts['sensor']}, {_span(facts)}"
    identified = found["statuses"].get("IDENTIFIED", 0)
    what = "answers of its own, no panoramas" if list(found["subjects"]) == [Subject.SENSOR] else "panoramas"
    lost = found["frames_expected"] - sum(found["statuses"].values())
    yield f"{found['frames']} {what}, {identified} identified, {lost} lost"


def _span(facts: dict[str, Any]) -> str:
    if facts["first_utc"] is None:
        return "no panorama came"
    return f"{facts['first_utc'][:19]}Z for {facts['duration_s']:.0f} s"


def _events(events: Sequence[LinkEvent]) -> Iterator[str]:
    """The first of each kind, with how many more there were and when the last was."""
    firsts: dict[str, LinkEvent] = {}
    lasts: dict[str, LinkEvent] = {}
    counts: dict[str, int] = {}
    for event in events:
        firsts.setdefault(event.kind, event)
        lasts[event.kind] = event
        counts[event.kind] = counts.get(event.kind, 0) + 1
    told = [event for event in firsts.values() if event.kind not in _QUIET][:_MOST_EVENTS]
    for event in told:
        last = _clock(lasts[event.kind])
        more = f" ({counts[event.kind] - 1} more, the last at {last})" if counts[event.kind] > 1 else ""
        yield from _item(f"{_clock(event)} {event.kind}: {event.text}{more}")
    if not told:
        yield "  nothing out of the ordinary on the link, the clock and the sky"


def _clock(event: LinkEvent) -> str:
    return instant.to_text(event.utc_ns, 0)[11:]


def _why(report: dict[str, Any]) -> Iterator[str]:
    findings = [f"{item['cause']}: {item['size']}" for item in report["diagnosis"]]
    equals = [", ".join(item["equals"]) for item in report["diagnosis"]]
    for line, others in zip(findings, equals, strict=True):
        yield from _item(line + (f" - or, which this session cannot tell apart: {others}" if others else ""))
    said = set(report["findings"])
    reasons = [reason for reason in report["reasons"] if reason.removeprefix("set-up: ") not in said]
    for reason in reasons[:_MOST_REASONS]:
        yield from _item(reason)
    if len(reasons) > _MOST_REASONS:
        yield f"  and {len(reasons) - _MOST_REASONS} more reasons: see the report"
    if not findings and not reasons:
        yield "  every row of the verdict passes, and no cause of an error is to be seen"


def _next(report: dict[str, Any], session: str) -> Iterator[str]:
    steps = [item["next_step"] for item in report["diagnosis"] if item["next_step"]]
    if report.get("external_identifier", {}).get("failures"):
        steps.append(_STDERR_STEP)
    if not steps and report["verdict"] == "INCONCLUSIVE" and _saw_no_sky(report):
        steps = [_NIGHT_STEP]
    if not steps:
        steps = {
            "PASS": ["nothing; the report is made by: gse report SESSION"],
            "INCONCLUSIVE": ["see how much longer a session must be: gse plan SESSION"],
        }.get(report["verdict"], ["look at the errors over time: gse view SESSION"])
    for step in dict.fromkeys(steps):
        yield from _step(step.replace("SESSION", session))
    if report["verdict"] != "PASS":
        yield from _step(
            f"what each message means: docs/troubleshooting.md; for a maintainer: gse why {session} --bundle FILE"
        )


def _saw_no_sky(report: dict[str, Any]) -> bool:
    """Whether no sky was to be seen in most of the session, so that a longer one like it decides nothing."""
    blind = sum(item["frames"] for item in report["exclusions"] if item["cause"] in _NO_SKY)
    return bool(2 * blind > report["identification"]["frames"])


def _step(text: str) -> list[str]:
    """Lines of a step with its command in one piece, which can be copied."""
    whole = re.sub("gse [^;]*", lambda command: command[0].replace(" ", _GLUE), text)
    return [line.replace(_GLUE, " ") for line in _item(whole)]


def _item(text: str) -> list[str]:
    return textwrap.wrap(
        text, WIDTH, initial_indent="  ", subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )
