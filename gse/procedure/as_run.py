"""The as-run log: what was done in which step, read from the events of a session.

The events are the log: a live session writes them, a replay reads them, so both report the same. Each is one line whose
fields are parted by " | ":

    PROCEDURE        name | operator | number of steps
    STEP_BEGUN       number | planned
    STEP_DONE        number | outcome | planned | seen | by
    PROCEDURE_ENDED  how the supply was left
"""

import dataclasses
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from drivers.chunk import LinkEvent
from drivers.outside_text import plain_line
from gse.config.station import Station, VerifiedRequirement
from gse.procedure.file import Watch, parse_procedure
from gse.station.columns import STATUSES
from gse.station.events import ClockStep, StationKind
from gse.station.exclusions import Cause, Exclusion
from gse.station.frame_columns import Columns
from gse.station.housekeeping import Housekeeping
from gse.station.results import Status, Verdict
from gse.station.session_data import SessionData
from gse.station.session_tables import AttitudeTable, FrameTable
from gse.statistics.decision import RISK
from gse.values.instant import LAST_NS, NS_PER_S

DEVIATION = "deviation:"
"""A note of the operator that begins with this is listed as a deviation."""
KEEPS_ALL, PORT_GONE = "every row keeps its limit", "; the port is gone"
"""What is seen of a watch, after its frames, where nothing is to be said against it; and what is said with it."""
_PARTS = " | "
_MOST_SEEN, _MOST_NAME = 240, 60
_ALWAYS = (StationKind.TEST_STREAM, StationKind.ALIGNED, StationKind.EARTH_ORIENTATION, StationKind.NO_TRUTH)
"""Events that say something of each stretch, whenever they came."""


class StepOutcome(StrEnum):
    """The word on one step; a step that was not done leaves the run INCONCLUSIVE."""

    PASS = "PASS"
    FAIL = "FAIL"
    INCONCLUSIVE = "INCONCLUSIVE"
    NOT_DONE = "not done"


@dataclass(frozen=True, slots=True)
class StepRun:
    """A step as it was run; ``from_ns`` is None of one that was never begun, ``by`` who answered."""

    number: str
    planned: str
    outcome: StepOutcome
    seen: str
    by: str
    from_ns: int | None
    until_ns: int

    @property
    def watch(self) -> Watch | None:
        """The watch, where it is one that was begun."""
        if self.from_ns is None or not self.planned.startswith("watch: "):
            return None
        text = yaml.safe_dump({"version": 1, "name": "log"}) + f"steps:\n- {self.planned}\n"
        act = parse_procedure(text, f"the session's step {self.number}").steps[0].act
        return act if isinstance(act, Watch) else None


@dataclass(frozen=True, slots=True)
class AsRun:
    """The log of one run; ``is_over`` where it came to its end, ``power`` is how the supply was left."""

    name: str
    operator: str
    steps: tuple[StepRun, ...]
    deviations: tuple[str, ...]
    is_over: bool
    power: str

    @property
    def verdict(self) -> Verdict:
        """FAIL where a step failed, PASS where each one passed and the run came to its end."""
        outcomes = {step.outcome for step in self.steps}
        if StepOutcome.FAIL in outcomes:
            return Verdict.FAIL
        return Verdict.PASS if outcomes == {StepOutcome.PASS} and self.is_over else Verdict.INCONCLUSIVE

    def reasons(self) -> list[str]:
        """A line for each step that is not PASS, those that failed first."""
        order = (StepOutcome.FAIL, StepOutcome.INCONCLUSIVE, StepOutcome.NOT_DONE)
        lines = [
            f"step {step.number} {step.outcome}: {step.seen or step.planned}"
            for outcome in order
            for step in self.steps
            if step.outcome is outcome
        ]
        return lines if self.is_over else [*lines, "the run did not come to its end: its last steps are not known"]


def event_text(*fields: str) -> str:
    """The line of an event of the log."""
    most = (_MOST_SEEN * 3, _MOST_SEEN * 3, 600, _MOST_SEEN, _MOST_NAME)
    texts = (re.sub(r"(?<!\S)\|(?!\S)|^\||\|$", "/", plain_line(" ".join(field.split()))) for field in fields)
    return _PARTS.join(text if len(text) <= n else f"{text[: n - 4]} ..." for text, n in zip(texts, most, strict=False))


def as_run(events: Iterable[LinkEvent]) -> AsRun | None:
    """The log of a session; None of a session without a procedure."""
    head: list[str] | None = None
    begun: dict[str, tuple[str, int]] = {}
    steps: list[StepRun] = []
    notes: list[str] = []
    left, last_ns = None, 0
    for event in events:
        fields = event.text.split(_PARTS)
        last_ns = max(last_ns, event.utc_ns)
        if event.kind == StationKind.PROCEDURE and head is None:
            head = [*fields, "", ""]
        elif event.kind == StationKind.STEP_BEGUN and len(fields) == 2:
            begun[fields[0]] = fields[1], event.utc_ns
        elif event.kind == StationKind.STEP_DONE and len(fields) == 5 and fields[1] in [*StepOutcome]:
            from_ns = begun.pop(fields[0])[1] if fields[0] in begun else None
            number, outcome, planned, seen, by = fields
            steps.append(StepRun(number, planned, StepOutcome(outcome), seen, by, from_ns, event.utc_ns))
        elif event.kind == StationKind.PROCEDURE_ENDED:
            left = event.text
        elif event.kind == StationKind.NOTE and event.text.lower().startswith(DEVIATION):
            notes.append(event.text[len(DEVIATION) :].strip())
    if head is None:
        return None
    for number, (planned, from_ns) in begun.items():
        words = "the session ended in this step"
        steps.append(StepRun(number, planned, StepOutcome.NOT_DONE, words, "", from_ns, last_ns))
    skipped = [f"step {step.number} was not done" for step in steps if step.outcome is StepOutcome.NOT_DONE]
    return AsRun(head[0], head[1], tuple(_in_order(steps)), (*notes, *skipped), left is not None, left or "not known")


def _in_order(steps: Sequence[StepRun]) -> list[StepRun]:
    """As they are numbered: a repeat ends after its rounds, and stands before them."""

    def key(step: StepRun) -> tuple[bool, list[int]]:
        return step.number.startswith("cleanup"), [int(part) for part in re.findall(r"\d+", step.number)]

    return sorted(steps, key=key)


# The stretch of a watch, as a session of its own.


def stretch(session: SessionData, step: StepRun, watch: Watch) -> SessionData:
    """The part of a session that a watch judges, under its limits: frames that were exposed in it, and their events."""
    part = part_of(session, step.from_ns or 0, step.until_ns, station_of(session.station, watch))
    return replace(part, excluded=(*part.excluded, *_of_other_exposures(part.frames.columns, watch)))


def part_of(session: SessionData, from_ns: int, until_ns: int, station: Station) -> SessionData:
    """The frames, answers and events of a stretch of UTC; frames lost in it are those that their numbers tell."""
    frames, own = session.frames.columns, session.sensor_attitudes.columns
    rows = np.flatnonzero((frames["utc_ns"] >= from_ns) & (frames["utc_ns"] < until_ns))
    came_ns = own["host_utc_ns"]
    return replace(
        session,
        station=station,
        frames=_rows_of(session.frames, rows),
        housekeeping=_items_of(session.housekeeping, from_ns, until_ns),
        sensor_attitudes=AttitudeTable.from_rows(own[(came_ns >= from_ns) & (came_ns < until_ns + NS_PER_S)]),
        star_names=session.star_names.between(from_ns, until_ns),
        statuses=[item for item in session.statuses if from_ns <= item[0] < until_ns],
        events=[
            event
            for event in session.events
            if isinstance(event, ClockStep) or event.kind in _ALWAYS or from_ns <= event.utc_ns < until_ns
        ],
        link=replace(session.link, frames_lost=0, unanswered=0, frames_repeated=0, sensor_resets=0),
        others_lost=0,
    )


def _items_of(table: Housekeeping, from_ns: int, until_ns: int) -> Housekeeping:
    part = Housekeeping({item.name: item for item in table.items})
    utc_ns = table.rows["utc_ns"]
    part.extend(table.rows.rows((utc_ns >= from_ns) & (utc_ns < until_ns)))
    return part


def _rows_of(table: FrameTable, rows: NDArray[np.int64]) -> FrameTable:
    place = np.full(len(table), -1)
    place[rows] = np.arange(len(rows))
    matches, others = (of[place[of["frame"]] >= 0] for of in (table.matches, table.others))
    for mine in (matches, others):
        mine["frame"] = place[mine["frame"]]
    part = FrameTable.with_rows(len(rows), matches, others, stride=table.picture_stride)
    for name in table.columns.dtype.names or ():
        part.columns[name] = table.columns[name][rows]
    return part


def station_of(station: Station, watch: Watch) -> Station:
    """The station with the limits and requirements of a watch; parameters are compared over the whole session."""
    limits = dataclasses.replace(station.limits, **watch.limits)
    named = {row: _requirement(text) for row, text in watch.requirements.items()}
    update = {"requirements": {**station.test.requirements, **named}, "parameters": {}, "parameters_sha256": None}
    test = station.test.model_copy(update=update)
    return station.model_copy(update={"limits": limits, "test": test})


def _requirement(text: str) -> VerifiedRequirement:
    given = yaml.safe_load(text)
    return VerifiedRequirement(**given) if isinstance(given, dict) else VerifiedRequirement(id=str(given))


def not_watched(session: SessionData, log: AsRun) -> Iterator[Exclusion]:
    """The stretches of a session that no watch judges, each with the last step that was begun in it."""
    watched = sorted((step.from_ns or 0, step.until_ns) for step in log.steps if step.watch is not None)
    begin = 0
    for from_ns, until_ns in [*watched, (LAST_NS, LAST_NS)]:
        if from_ns > begin:
            here = [step for step in log.steps if step.from_ns is not None and begin <= step.from_ns < from_ns]
            last = f"; the last one in it is {here[-1].number}, {here[-1].planned}" if here else ""
            yield Exclusion(begin, from_ns, f"no step of the procedure watched it{last}", Cause.STEP)
        begin = max(begin, until_ns)
    for step in log.steps:
        if (watch := step.watch) is not None:
            frames = part_of(session, step.from_ns or 0, step.until_ns, session.station).frames.columns
            yield from _of_other_exposures(frames, watch)


def _of_other_exposures(frames: Columns, watch: Watch) -> Iterator[Exclusion]:
    """Frames of another exposure than a watch asks for, one after the other."""
    counts = watch.counts(frames["exposure_s"])
    for rows in np.split(np.arange(len(frames)), np.flatnonzero(np.diff(counts)) + 1):
        if len(rows) and not counts[rows[0]]:
            utc_ns, exposure_s = frames["utc_ns"][rows], float(frames["exposure_s"][rows[0]])
            reason = f"the exposure was {exposure_s:g} s, expected {watch.exposure_s:g} s"
            yield Exclusion(int(utc_ns.min()), int(utc_ns.max()) + 1, reason, Cause.STEP)


# Starts: each time that the supply was switched on, with its first panorama and its first answer.


@dataclass(frozen=True, slots=True)
class Start:
    """One start; times in seconds after the supply was switched on, NaN where nothing came before it was off."""

    utc_ns: int
    boot_s: float
    first_fix_s: float


def starts(session: SessionData) -> tuple[Start, ...]:
    """The starts of a session, in their order; a supply that is on already does not start the sensor."""
    turns = [
        (event.utc_ns, event.kind == StationKind.POWER_ON)
        for event in session.events
        if event.kind in (StationKind.POWER_ON, StationKind.POWER_OFF)
    ]
    came_ns = session.frames.columns["host_utc_ns"]
    answered = session.frames.columns["status"] == STATUSES.index(Status.IDENTIFIED)
    turns = [turn for n, turn in enumerate(turns) if n == 0 or turn[1] != turns[n - 1][1]]
    found = []
    for (utc_ns, is_on), (until_ns, _) in pairwise([*turns, (LAST_NS, False)]):
        if is_on:
            here = (came_ns >= utc_ns) & (came_ns < until_ns)
            firsts = (came_ns[here], came_ns[here & answered])
            boot_s, fix_s = (float(ns.min() - utc_ns) / NS_PER_S if len(ns) else math.nan for ns in firsts)
            found.append(Start(utc_ns, boot_s, fix_s))
    return tuple(found)


def spread_of(values_s: Sequence[float]) -> dict[str, Any]:
    """Number, median, 95 % and the one-sided 95 % bound of that quantile, by order statistics; None where unknown.

    The bound is the least value of which the 95 % quantile is at most with 95 % confidence: the r-th of n where a
    binomial of n and 0.95 is below r with 95 % (Conover 1999, section 3.2). Fewer than 59 values have none. What never
    came is longer than all others.
    """
    from scipy.stats import binom

    ordered = sorted(math.inf if math.isnan(value) else value for value in values_s)
    n = len(ordered)
    rank = int(binom.ppf(1 - RISK, n, 0.95)) + 1 if n else 0
    picked = {
        "median_s": (ordered[(n - 1) // 2] + ordered[n // 2]) / 2 if n else math.inf,
        "p95_s": ordered[min(math.ceil(0.95 * n), n) - 1] if n else math.inf,
        "p95_bound_s": ordered[rank - 1] if 0 < rank <= n else math.inf,
    }
    return {"n": n, **{name: None if math.isinf(value) else value for name, value in picked.items()}}
