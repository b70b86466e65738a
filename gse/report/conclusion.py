"""The conclusion of a session: verdict and its subject, the reason, the one cause, the next step, what was not tested.

Terminal, page, ``gse why``, report.json and junit.xml take their words from here, so that all of them say the same.
"""

import re
import textwrap
from collections.abc import Iterator
from typing import Any

from gse.station.exclusions import Cause
from gse.statistics.clock_health import CLOCK_REMEDY
from gse.statistics.decision import Outcome
from gse.values.limits import Decision
from gse.values.text import count_text
from gse.verdict.assessment import LEFT_OUT, RELATIVE
from gse.verdict.obstacles import NO_TRUTH, NOTHING_COMPARED
from gse.verdict.requirements import requirement_named

SET_UP = "set-up: "
"""Before the reason that a mistake of the set-up is."""

EQUALS = " - or, which this session cannot tell apart: "
"""Between a cause and others that explain the session as well."""

_NO_SKY = (Cause.NO_SKY, Cause.NO_OBJECTS)
_NIGHT_STEP = "repeat it under a clear, dark sky, without a lens cap; when it is dark: gse preflight --station FILE"
_CLOCK_STEP = f"{CLOCK_REMEDY}; for this session: gse report SESSION --clock-error 0.1s"
_CLOCK_WORD = "the error of the clock is not known"
_SILENT_STEP = "look at power, cable and port, and whether the sensor must be started: gse preflight --station FILE"
_UNREADABLE_STEP = "find the protocol: gse decode --try SESSION"
_COPY_STEP = "take a copy of the session file that is longer; if there is none, look at power, cable and port"
_LINE_STEP = "look at what did not arrive whole, then at cable and baud rate: gse decode SESSION --discards"
_STDERR_STEP = "see what the external identifier wrote to stderr: gse session export SESSION --format stderr"
_PROCEDURE_STEP = "see to what the step says, and run it again"
_COVERED_STEP = "repeat it with nothing before the lens; where nothing was, the sensor was blind: gse view SESSION"
_OBSTACLE_STEPS = {
    "belong to no panorama": "see whether ATTITUDE has the time tag and frame_no of its PANORAMA: gse decode SESSION",
    "the sensor's clock (": "where dRA* keeps its limit the sensor's clock is right, and this computer's is not: gse "
    "preflight; else correct sensor.time in the station file",
    "frames read late": "look what holds bytes back between sensor and computer, and repeat the session",
}
"""What to do about a reason that has these words: a longer session leaves it where it is."""
_OTHER_STEP = "see to what stands in the way of a verdict, and repeat the session: gse why SESSION"
_PLAN_STEP = "see how much longer a session must be: gse plan SESSION"
_LABELS = (("reason", "why"), ("cause", "cause"), ("note", "note"), ("next", "next"))
_MOST_LINES = {"why": 2, "cause": 3, "note": 2, "next": 2, "not tested": 2, "": 2}
"""Lines of a terminal for each part: together twelve with the path of the report; ``gse why`` shows all of it."""
_COMMAND = re.compile("gse [^;]*")
_GLUE = "\N{NO-BREAK SPACE}"


def conclusion(report: dict[str, Any]) -> dict[str, Any]:
    """The object ``conclusion`` of a report: texts, empty where there is nothing to say; SESSION stands for the path.

    A PASS has no cause; what was found beside it is its ``note``.
    """
    is_pass = report["verdict"] == "PASS"
    cause, equals, steps = _found(report) if "procedure" not in report else _of_watched(report)
    found = f"{cause}{EQUALS}{equals}" if equals else cause
    reason = _of_pass(report) if is_pass else _reason(report)
    return {
        "headline": headline(report["word"], simulated=report["simulated"]),
        "subject": _subject(report),
        "reason": "" if reason == found else reason,
        "cause": "" if is_pass else found,
        "note": found if is_pass else "",
        "next": next(iter(next_steps(report, steps)), ""),
        "not_tested": list(_not_tested(report)),
    }


def headline(word: str, *, simulated: bool) -> str:
    """A verdict as it is printed, marked where no sensor took part."""
    return f"{word} (SIMULATED)" if simulated else word


def conclusion_lines(conclusion: dict[str, Any], session: str, columns: int | None = None) -> list[str]:
    """The conclusion on the session at a path, each part a line; folded to ``columns``, it has at most eleven lines."""
    parts = [("", f"{conclusion['headline']}: {conclusion['subject']}")]
    parts += [(label, conclusion[key]) for key, label in _LABELS]
    parts.append(("not tested", "; ".join(conclusion["not_tested"])))
    return [
        line
        for label, text in parts
        if text
        for line in _folded(label, text.replace("SESSION", session), columns, _MOST_LINES[label])
    ]


def explained(conclusion: dict[str, Any]) -> list[str]:
    """What follows a headline, without the next step, for a screen that has no path of the session."""
    return [conclusion[key] for key in ("reason", "cause", "note") if conclusion[key]]


def _folded(label: str, text: str, columns: int | None, most: int) -> list[str]:
    head = f"{label}: " if label else ""
    return [head + text] if columns is None else folded(text, columns, head=head, below="  ", most=most)


def folded(text: str, columns: int, *, head: str, below: str, most: int | None = None) -> list[str]:
    """Lines of a text after its ``head``, each command in one piece, which can be copied."""
    whole = _COMMAND.sub(lambda command: command[0].replace(" ", _GLUE), text)
    lines = textwrap.wrap(
        whole,
        columns,
        initial_indent=head,
        subsequent_indent=below,
        max_lines=most,
        placeholder=" ...",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_GLUE, " ") for line in lines]


def _subject(report: dict[str, Any]) -> str:
    facts, found = report["session"], report["identification"]
    if "procedure" in report:
        return (
            f"{facts['sensor']}, {report['procedure']['name']}, {count_text(len(report['procedure']['steps']), 'step')}"
        )
    names = " and ".join(found["subjects"])
    of = f"{facts['sensor']} ({names})" if names else facts["sensor"]
    if facts["first_utc"] is None:
        return f"{of}, no frame came"
    return (
        f"{of}, {count_text(found['frames'], 'frame')} in {facts['duration_s']:.0f} s from {facts['first_utc'][:19]}Z"
    )


def _of_pass(report: dict[str, Any]) -> str:
    if "procedure" in report:
        return "each step of the procedure passed"
    if report["decision"]["rule"] == Decision.SIMPLE:
        return "the value of every row that was tested keeps its limit; uncertainty does not count (decision: simple)"
    return "every row that was tested keeps its limit with 95 % confidence"


def _reason(report: dict[str, Any]) -> str:
    """The step or the row that decides, or what stands in the way of PASS."""
    if "procedure" in report:
        return next(iter(report["reasons"]), "")
    if not report["identification"]["frames"]:
        return _without_frames(report)
    if not _is_compared(report) and NO_TRUTH not in report["reasons"]:
        return "no frame could be compared with the sky"
    decided = (row["reason"] for row in _undecided_rows(report))
    return next(decided, None) or next(_obstacles(report), "")


def _without_frames(report: dict[str, Any]) -> str:
    link = report["link"]
    received = f"{link['bytes_in']:,} bytes"
    if not link["bytes_in"]:
        if link["truncated"]:
            return "nothing is left in the session file, which lost its end: whether anything came is not known"
        return "nothing came: not one byte was received"
    if link["bytes_discarded"] == link["bytes_in"]:
        return f"{received}, and no valid frame in them"
    return f"{received} and valid frames, but no frame that could be compared with the sky"


def _is_compared(report: dict[str, Any]) -> bool:
    """Whether a row whose figure is an error has a value."""
    valued = (requirement_named(row["name"]) for row in report["measurements"] if row["value"] is not None)
    return any(found is not None and found.is_error for found in valued)


def _undecided_rows(report: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for outcome in (Outcome.FAIL, Outcome.INCONCLUSIVE):
        yield from (row for row in report["measurements"] if row["outcome"] == outcome)


def _obstacles(report: dict[str, Any]) -> Iterator[str]:
    """The reasons that are neither rows nor findings, the gravest first."""
    said = {*report["findings"], *(row["reason"] for row in report["measurements"])}
    for reason in report["reasons"]:
        if reason not in said and not reason.startswith((SET_UP, RELATIVE, NOTHING_COMPARED)):
            yield reason


def _found(report: dict[str, Any]) -> tuple[str, str, list[str]]:
    """The cause, what cannot be told apart from it, and what to do about all causes."""
    steps = [item["next_step"] for item in report["diagnosis"] if item["next_step"]]
    clock = next((reason for reason in report["reasons"] if _CLOCK_WORD in reason), None)
    if clock and not any(item["is_gross"] for item in report["diagnosis"]):
        return clock.partition("; ")[0], "", [_CLOCK_STEP, *steps]
    if report["diagnosis"]:
        first = report["diagnosis"][0]
        return f"{first['cause']}: {first['size']}", ", ".join(first["equals"]), steps
    set_up = next((reason for reason in report["reasons"] if reason.startswith(SET_UP)), "")
    cause, _, step = set_up.removeprefix(SET_UP).partition("; next: ")
    if not cause and report["verdict"] != "PASS" and report["identification"]["frames"]:
        cause = next(_obstacles(report), "")
        step = next((step for words, step in _OBSTACLE_STEPS.items() if words in cause), "")
    link = report["link"]
    if not cause and report["verdict"] == "FAIL" and link["frames_lost"]:
        lost, discarded = count_text(link["frames_lost"], "frame"), count_text(link["bytes_discarded"], "byte")
        return f"the line: {lost} lost, {discarded} discarded", "", [_LINE_STEP]
    return cause, "", [step] if step else steps


def _empty_step(link: dict[str, Any]) -> str:
    if link["bytes_in"]:
        return _UNREADABLE_STEP
    return _COPY_STEP if link["truncated"] else _SILENT_STEP


def next_steps(report: dict[str, Any], steps: list[str] | None = None) -> list[str]:
    """What to do, the most useful first; ``steps`` are those of the causes."""
    steps = list(_found(report)[2] if steps is None else steps)
    if report["verdict"] == "PASS":
        return steps
    if "procedure" in report and not steps:
        return [_PROCEDURE_STEP]
    if report.get("external_identifier", {}).get("failures"):
        steps.append(_STDERR_STEP)
    if not report["identification"]["frames"] and not steps:
        steps.append(_empty_step(report["link"]))
    if not steps and _saw_no_sky(report):
        steps.append(_NIGHT_STEP)
    if not steps and _was_blind(report):
        steps.append(_COVERED_STEP)
    if not steps and report["verdict"] == "INCONCLUSIVE":
        is_open = any(row["outcome"] == Outcome.INCONCLUSIVE for row in report["measurements"])
        steps.append(_PLAN_STEP if is_open else _OTHER_STEP)
    if not steps:
        steps.append("look at the errors: gse view SESSION")
    return list(dict.fromkeys(steps))


def _of_watched(report: dict[str, Any]) -> tuple[str, str, list[str]]:
    """The cause of what the steps saw that watched the sensor: of a step that was not done nothing is known."""
    was_done = all(step["outcome"] in ("PASS", "INCONCLUSIVE") for step in report["procedure"]["steps"])
    lacks_clock = was_done and any(_CLOCK_WORD in reason for reason in report["reasons"])
    return _found(report) if report["diagnosis"] or lacks_clock else ("", "", [])


def _saw_no_sky(report: dict[str, Any]) -> bool:
    """Whether no sky was to be seen in most of the session, so that a longer one like it decides nothing."""
    blind = sum(item["frames"] for item in report["exclusions"] if item["cause"] in _NO_SKY)
    return bool(2 * blind > report["identification"]["frames"])


def _was_blind(report: dict[str, Any]) -> bool:
    """Whether every row is decided and frames without objects stand in the way: a longer session leaves them there."""
    outcomes = {row["outcome"] for row in report["measurements"]}
    blind = any(item["cause"] == Cause.NO_OBJECTS for item in report["exclusions"])
    return blind and not outcomes & {Outcome.INCONCLUSIVE, Outcome.FAIL}


def _not_tested(report: dict[str, Any]) -> Iterator[str]:
    """What a reader could believe was tested: of the rows only those that a requirement names."""
    rows = [row for row in report["measurements"] if row["outcome"] == Outcome.NOT_TESTED]
    of_rows = {row["reason"] for row in rows}
    yield from (row["reason"] for row in rows if row["requirement"])
    if report["identification"]["frames"]:
        yield from (line for line in report["not_tested"] if line not in of_rows and LEFT_OUT not in line)
