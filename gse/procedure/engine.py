"""The engine: the steps of a procedure, one after the other, on the ticks of the station's loop.

Each kind of step is a generator that yields where it would wait; ``tick`` goes on with the one that runs, on the thread
of the loop, which alone reads the port. What ends a run is thrown into that generator, so that it is the step that was
interrupted which says so. The cleanup follows whatever happened, also a defect of ours, which is raised after it;
nothing interrupts it. ``finish`` does what is left of it where no loop runs any more, without waiting.

Time is that of the data: of the host's clock on a live port, of the simulation on a simulated one.
"""

import inspect
import math
import queue
from collections import defaultdict
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from typing import Any
from typing import Protocol as Interface

import numpy as np

from drivers.chunk import LinkEvent
from drivers.clock import read_clock
from drivers.errors import PortError
from gse.procedure.as_run import KEEPS_ALL, PORT_GONE, StepOutcome, event_text
from gse.procedure.desk import STOPS, Desk, Question
from gse.procedure.file import (
    Act,
    Ask,
    CheckNow,
    Procedure,
    Repeat,
    Send,
    ShareOf,
    Step,
    SwitchPower,
    Tell,
    Wait,
    Watch,
    items_of,
)
from gse.procedure.power import Ran
from gse.station.columns import STATUSES
from gse.station.events import LINK_WORDS, SKY_WORDS, StationKind
from gse.station.frame_results import FrameResults
from gse.station.results import Status
from gse.station.session_data import SessionData
from gse.statistics.decision import Outcome, share_of, share_outcome
from gse.values.instant import NS_PER_S
from gse.values.text import count_text, percent
from protocols import NO_ANSWER, Condition, EncodeError, Frame, ItemValue, Protocol
from protocols.items import in_words

SILENT_NS = 2 * NS_PER_S
"""A sensor that has sent no frame for so long is silent."""
_POLL_S = 0.5
"""Between two requests of a wait for an item that comes only when it is asked for."""
_PERSON_S = 0.1
_MOST_LEFT = 100
"""Steps that a program may still give where no loop runs any more: it switches off, and does not try for ever."""
_CLEANUP_S = 60.0
"""Time that one program of the supply may still take when no loop runs any more; its own time-out is usually less."""


class Bench(Interface):
    """What the steps act on."""

    session: SessionData
    protocol: Protocol
    is_live: bool

    def now(self) -> tuple[int, int]:
        """UTC and monotonic nanoseconds of the data."""

    def send(self, data: bytes) -> None:
        """Bytes to the sensor; PortError where the port is gone."""

    def record(self, kind: str, text: str) -> None:
        """An event of the session, now."""

    def switch(self, *, on: bool) -> "Future[Ran] | None":
        """Switch the supply; None where there is no switch."""

    def judge(self, from_ns: int, until_ns: int, watch: Watch) -> tuple[Outcome, str]:
        """Judge a stretch of the session."""

    def interrupted(self) -> str:
        """Why the run is to end; empty where it is not."""


@dataclass(frozen=True, slots=True)
class Done:
    """The outcome of a step, what was seen, and who answered; true where it is PASS."""

    outcome: StepOutcome
    seen: str = ""
    by: str = ""

    def __bool__(self) -> bool:
        """Whether it passed."""
        return self.outcome is StepOutcome.PASS

    @property
    def ends(self) -> bool:
        """Whether the run ends here; what could not be decided does not end it."""
        return self.outcome in (StepOutcome.FAIL, StepOutcome.NOT_DONE)


_Ticks = Generator[None, None, Done]


class _Interrupted(Exception):  # noqa: N818  # it is no error
    """Thrown into the step that runs."""


class Seen:
    """What the sensor showed since the last command, or switch of its supply; a listener of the loop."""

    def __init__(self) -> None:
        self.link, self.sky = "waiting", ""
        self.stars = self.exposure_s = math.nan
        self.frame_ns = self.first_answer_ns = 0
        self.is_answered = False
        self.since_ns = 0

    def forget(self, now_ns: int) -> None:
        """From now on: what was seen before says nothing any more."""
        self.since_ns, self.frame_ns, self.first_answer_ns, self.is_answered = now_ns, 0, 0, False

    def on_results(self, results: FrameResults, session: SessionData) -> None:
        """Take results."""
        came_ns = results.rows["host_utc_ns"]
        new = came_ns >= self.since_ns
        if not new.any():
            return
        answered = (results.rows["status"] == STATUSES.index(Status.IDENTIFIED)) & new
        self.frame_ns, self.is_answered = int(came_ns[new][-1]), bool(answered[new][-1])
        self.stars = float(np.nan_to_num(results.rows["matched"][new][-1]))
        self.exposure_s = float(results.rows["exposure_s"][new][-1])
        if answered.any() and not self.first_answer_ns:
            self.first_answer_ns = int(came_ns[answered][0])

    def on_event(self, event: LinkEvent) -> None:
        """Take an event that says how link or sky is."""
        self.link = LINK_WORDS.get(event.kind, self.link)
        self.sky = SKY_WORDS.get(event.kind, self.sky)

    def state(self, now_ns: int) -> str:
        """The state of the sensor: acquired, searching or silent; empty where nothing is known yet."""
        if now_ns - max(self.frame_ns, self.since_ns) > SILENT_NS:
            return "silent"
        if not self.frame_ns:
            return ""
        return "acquired" if self.is_answered else "searching"


class Run:
    """One run of a procedure from step ``first`` on, by the operator at a ``desk``."""

    def __init__(
        self, procedure: Procedure, desk: Desk, *, first: str = "1", say: Callable[[str], None] = lambda text: None
    ) -> None:
        self.procedure, self.desk = procedure, desk
        self.seen = Seen()
        self.is_over = False
        self._first, self._say = first, say
        self._bench: Bench | None = None
        self._ticks: Generator[None, None, None] | None = None
        self._is_interruptible, self._hurries = True, False
        self._began_ns = 0
        self._measured: dict[str, list[float]] = defaultdict(list)
        self._power = ""
        self._after = "the step began"
        self._frames: list[Frame] | None = None
        self._sequence = 0

    def begin(self, bench: Bench) -> None:
        """Begin with the first step at the next tick."""
        self._bench = bench
        self._ticks = self._run()

    def tick(self) -> None:
        """Go on as far as the data allow."""
        if self._ticks is None or self.is_over:
            return
        reason = self.bench.interrupted()
        try:
            if reason and self._is_interruptible:
                self._interrupt(self._ticks, reason)
            else:
                next(self._ticks)
        except StopIteration:
            self.is_over = True

    def take_frame(self, frame: Frame) -> None:
        """A frame of the sensor, while a command waits for its answer."""
        if self._frames is not None:
            self._frames.append(frame)

    def finish(self, reason: str = "the session ended") -> None:
        """Do what is left of the cleanup, without waiting for the sensor: no loop runs any more."""
        self._hurries = True
        if self._ticks is None or inspect.getgeneratorstate(self._ticks) == inspect.GEN_CLOSED:
            return
        try:
            if self._is_interruptible:
                self._interrupt(self._ticks, reason)
            for _ in self._ticks:
                pass
        except StopIteration:
            pass
        self.is_over = True

    def _interrupt(self, ticks: Generator[None, None, None], reason: str) -> None:
        self._is_interruptible = False
        if inspect.getgeneratorstate(ticks) == inspect.GEN_CREATED:
            next(ticks)  # to its first wait: a run that has not begun takes no interruption
        ticks.throw(_Interrupted(reason))

    @property
    def bench(self) -> Bench:
        """What the steps act on, from ``begin`` on."""
        assert self._bench is not None
        return self._bench

    # The run

    def _record_begin(self) -> None:
        """At the first tick, after the data that had come: they stand before it in the recording, too."""
        steps = str(len(self.procedure.steps))
        self.bench.record(StationKind.PROCEDURE, event_text(self.procedure.name, self.desk.name, steps))

    def _run(self) -> Generator[None, None, None]:
        self._record_begin()
        ended, defect = "", None
        try:
            yield
        except _Interrupted as reason:
            ended = str(reason)
        steps = self.procedure.steps
        at = next((n for n, step in enumerate(steps) if step.number == self._first), 0)
        for step in steps[:at]:
            self._leave(step, f"the run began at step {self._first}")
        try:
            while at < len(steps) and not ended:
                step, at = steps[at], at + 1
                done = yield from self._step(step, step.number)
                ended = f"step {step.number} {done.outcome}" if done.ends and not step.goes_on else ""
        except _Interrupted as reason:
            ended = str(reason)
        except Exception as error:  # a defect of the station: the supply must not stay on for it
            ended, defect = f"an internal error in step {steps[at - 1].number}", error
        self._is_interruptible = False
        self.desk.answered()
        for step in steps[at:]:
            self._leave(step, ended)
        for step in self.procedure.cleanup:
            try:
                yield from self._step(step, step.number)
            except Exception as error:
                defect = defect or error
        self._record_end()
        if defect is not None:
            raise defect

    def _record_end(self) -> None:
        left = f"the supply was left {self._power}" if self._power else "the supply was not switched"
        self.bench.record(StationKind.PROCEDURE_ENDED, left)

    def _leave(self, step: Step, reason: str) -> None:
        self._record_done(step, step.number, Done(StepOutcome.NOT_DONE, reason))

    def _record_done(self, step: Step, number: str, done: Done) -> None:
        text = event_text(number, done.outcome, step.planned, done.seen, done.by)
        self.bench.record(StationKind.STEP_DONE, text)
        self._say(f"step {number} {done.outcome}: {done.seen or step.planned}")

    def _step(self, step: Step, number: str) -> _Ticks:
        self.bench.record(StationKind.STEP_BEGUN, event_text(number, step.planned))
        self._began_ns = self.bench.now()[1]
        try:
            done = yield from self._act(step.act, number)
        except _Interrupted as reason:
            self._record_done(step, number, Done(StepOutcome.NOT_DONE, f"interrupted by {reason}"))
            raise
        except PortError as error:
            done = Done(StepOutcome.NOT_DONE, f"the port is gone: {error}")
        except Exception as error:
            words = f"internal error of gse: {type(error).__name__}: {error}"
            self._record_done(step, number, Done(StepOutcome.NOT_DONE, words))
            raise
        finally:
            self._frames = None
        self._record_done(step, number, done)
        return done

    def _act(self, act: Act, number: str) -> _Ticks:
        match act:
            case Tell():
                return self._ask(Question(number, number, act.text, confirms=True), act.at_most_s)
            case Ask():
                return self._ask(Question(number, act.label, act.text, act.expect), act.at_most_s)
            case SwitchPower():
                return self._switch(on=act.on)
            case Wait(for_s=float(for_s)):
                return self._pause(for_s)
            case Wait():
                return self._wait(act)
            case Send():
                return self._send(act)
            case CheckNow():
                return self._check(act)
            case Watch():
                return self._watch(act)
            case Repeat():
                return self._repeat(act, number)

    def _passed_s(self) -> float:
        """Seconds since the step began."""
        return (self.bench.now()[1] - self._began_ns) / NS_PER_S

    # Kinds of steps

    def _ask(self, question: Question, at_most_s: float) -> _Ticks:
        desk, began_ns = self.desk, read_clock().mono_ns
        if self._hurries or not desk.can_answer(question):
            way = "run it in a terminal, with --view web, or with --answers FILE that has a line"
            return Done(StepOutcome.NOT_DONE, f"nobody can answer: {way} {question.label or question.number}: ..")
        desk.ask(question)
        try:
            while (read_clock().mono_ns - began_ns) / NS_PER_S < at_most_s:
                # The time of a simulation stands still while its operator thinks.
                given = desk.take(0.0 if self.bench.is_live else _PERSON_S)
                if given is None:
                    if self.bench.is_live or self.bench.interrupted():
                        yield
                    continue
                answer, by = given
                if question.confirms and answer.lower() in STOPS:
                    return Done(StepOutcome.NOT_DONE, f"the operator says {answer}", by)
                if problem := question.problem(answer):
                    if by == "answers file":
                        return Done(StepOutcome.FAIL, problem, by)
                    desk.ask(question, problem)
                    continue
                return Done(StepOutcome.PASS, answer or "done", by)
        finally:
            desk.answered()
        return Done(StepOutcome.NOT_DONE, f"the operator did not answer within {at_most_s:g} s")

    def _switch(self, *, on: bool) -> _Ticks:
        self._act_now(f"power {'on' if on else 'off'}")
        future = self.bench.switch(on=on)
        if future is None:
            return Done(StepOutcome.NOT_DONE, "the station file has no power: {on, off}")
        while not future.done() and self.bench.is_live and not self._hurries:
            yield
        ran = future.result(_CLEANUP_S)
        word = "on" if on else "off"
        self._power = word if ran.is_done else f"as nobody knows: power {word} failed"
        return Done(StepOutcome.PASS if ran.is_done else StepOutcome.NOT_DONE, ran.words or f"switched {word}")

    def _act_now(self, what: str) -> None:
        """Something is done to the sensor: what it said before does not count any more."""
        self._after = what
        self.seen.forget(self.bench.now()[0])

    def _pause(self, for_s: float) -> _Ticks:
        while (passed_s := self._passed_s()) < for_s and not self._hurries:
            yield
        if passed_s < for_s:
            return Done(StepOutcome.NOT_DONE, "no time was left to wait")
        return Done(StepOutcome.PASS, f"waited {passed_s:.1f} s")

    def _wait(self, act: Wait) -> _Ticks:
        condition = Condition(act.until, items_of(self.bench.protocol))
        polled_s, came = -_POLL_S, "it was so already"
        while differs := condition.what_differs(self._values()):
            if act.poll and self._passed_s() - polled_s >= _POLL_S:
                polled_s = self._passed_s()
                self.bench.send(self._request(act.poll))
            if self._passed_s() >= act.at_most_s or self._hurries:
                if act.measure:
                    self._measured[act.measure].append(math.inf)
                if self.seen.link == "no port":
                    return Done(StepOutcome.NOT_DONE, f"the port is gone; {differs}")
                return Done(StepOutcome.FAIL, f"after {act.at_most_s:g} s {differs}")
            came = "it came"
            yield
        took_s = self._took_s(act.until)
        if act.measure:
            self._measured[act.measure].append(took_s)
        seen = f"{act.measure} {took_s:.3f} s" if act.measure else f"{came} {took_s:.3f} s after {self._after}"
        return Done(StepOutcome.PASS, seen)

    def _request(self, command: str) -> bytes:
        """The frame of a command without arguments, whose answer is an item; it counts as no command to the sensor."""
        self._sequence = (self._sequence + 1) % (self.bench.protocol.sequence_modulus or 1)
        layout = self.bench.protocol.commands[command]
        return layout.awaited(layout.made()).sent(self._sequence)

    def _took_s(self, until: Mapping[str, object]) -> float:
        """From the last command, or switch of the supply, until what made the conditions hold had come."""
        latest = self.bench.session.housekeeping.latest
        came_ns = [latest[name].utc_ns for name in until if name in latest]
        if until.get("state") == "acquired" and "state" not in latest:
            came_ns.append(self.seen.first_answer_ns)
        since_ns = self.seen.since_ns or self.bench.now()[0] - round(self._passed_s() * NS_PER_S)
        return max(max(came_ns, default=self.bench.now()[0]) - since_ns, 0) / NS_PER_S

    def _values(self) -> dict[str, ItemValue]:
        """The items that came since the last command, and what the station knows."""
        seen, session = self.seen, self.bench.session
        latest = session.housekeeping.latest
        # The link streams until it was silent for a while: what came before says nothing of a sensor that starts.
        is_heard = seen.frame_ns or any(item.utc_ns >= seen.since_ns for item in latest.values())
        link = seen.link if is_heard or seen.link != "streaming" else ""
        known = {"state": seen.state(self.bench.now()[0]), "link": link, "sky": seen.sky}
        values: dict[str, ItemValue] = {name: word for name, word in known.items() if word}
        of_frame = {"stars": seen.stars, "exposure_s": seen.exposure_s} if seen.frame_ns else {}
        values |= {name: value for name, value in of_frame.items() if not math.isnan(value)}
        if session.power and session.power[-1].utc_ns >= seen.since_ns:
            values["power_a"] = session.power[-1].amperes
            if not math.isnan(session.power[-1].volts):
                values["power_v"] = session.power[-1].volts
        return values | {name: item.value for name, item in latest.items() if item.utc_ns >= seen.since_ns}

    def _send(self, act: Send) -> _Ticks:
        layout = self.bench.protocol.commands.get(act.command)
        if layout is None:
            return Done(StepOutcome.NOT_DONE, f"the protocol has no command {act.command}")
        self._sequence = (self._sequence + 1) % (self.bench.protocol.sequence_modulus or 1)
        try:
            awaited = layout.awaited((layout if act.refused is None else layout.free).made(**act.arguments))
            data = awaited.sent(self._sequence)
        except EncodeError as error:
            return Done(StepOutcome.NOT_DONE, str(error))
        frames: list[Frame] = []
        self._frames = frames
        self._act_now(act.command)
        self.bench.send(data)
        if layout.answer == NO_ANSWER and act.refused is None:
            return Done(StepOutcome.PASS, "sent; the protocol has no answer that proves it")
        at_most_s = act.at_most_s or layout.timeout_s
        given = "".join(f", {name} {value}" for name, value in act.arguments.items())
        proof = ""
        while self._passed_s() < at_most_s and not self._hurries:
            while frames:
                if (answer := awaited.take(frames.pop(0))) is None:
                    continue
                if act.refused is not None and answer.is_done:
                    proof = answer.text  # an item may have had this value before: a refusal can still come
                    continue
                if answer.is_done or act.refused in ("", getattr(answer.message, "reason", None)):
                    return Done(StepOutcome.PASS, f"{answer.text} after {self._passed_s():.2f} s")
                other = f"; expected the reason {act.refused}" if act.refused else ""
                return Done(StepOutcome.FAIL, f"{answer.text}: {act.command}{given}{other}")
            yield
        if self._hurries:
            return Done(StepOutcome.INCONCLUSIVE, "sent; its answer was not awaited")
        if self.seen.link == "no port":
            return Done(StepOutcome.NOT_DONE, "the port is gone")
        came = f"; {awaited.wrong}" if awaited.wrong else ""
        if proof:
            return Done(StepOutcome.FAIL, f"{proof}: {act.command}{given}; expected a refusal (NAK){came}")
        expected = layout.expected if act.refused is None else "a refusal (NAK)"
        return Done(StepOutcome.FAIL, f"no answer within {at_most_s:g} s: expected {expected}{came}")

    def _check(self, act: CheckNow) -> _Ticks:
        words, outcomes = [], []
        if act.items:
            while missing := act.items.keys() - (values := self._values()).keys():
                if self._passed_s() >= act.at_most_s or self._hurries:
                    names = ", ".join(sorted(missing))
                    return Done(StepOutcome.INCONCLUSIVE, f"after {act.at_most_s:g} s no value of {names} had come")
                yield
            items = items_of(self.bench.protocol)
            differs = Condition(act.items, items).what_differs(values)
            said = (f"{name} is {in_words(values[name])} {items[name].unit}".rstrip() for name in act.items)
            words.append(differs or ", ".join(said))
            outcomes.append(StepOutcome.FAIL if differs else StepOutcome.PASS)
        for share in act.shares:
            outcome, text = self._share(share)
            words.append(text)
            outcomes.append(outcome)
        worst = next(one for one in (StepOutcome.FAIL, StepOutcome.INCONCLUSIVE, StepOutcome.PASS) if one in outcomes)
        return Done(worst, "; ".join(words))

    def _share(self, asked: ShareOf) -> tuple[StepOutcome, str]:
        """Decided by the exact bounds of a binomial: as the order statistic of the values against the limit."""
        values = self._measured[asked.name]
        if not values:
            return StepOutcome.INCONCLUSIVE, f"{asked.name} was not measured"
        kept = share_of(sum(value <= asked.at_most for value in values), len(values))
        decision = self.bench.session.station.limits.decision
        outcome = StepOutcome(share_outcome(kept, asked.share, at_least=True, decision=decision))
        text = f"{asked.name}: {kept.count} of {kept.of} within {asked.at_most:g}, {percent(asked.share, 1)} asked"
        return outcome, f"{text}, at least {percent(kept.lower, 1)} with 95 % confidence"

    def _watch(self, act: Watch) -> _Ticks:
        from_ns, first = self.bench.now()[0], len(self.bench.session.frames)
        while self._passed_s() < act.for_s and not self._hurries:
            if act.frames is not None and self._counted(act, first, from_ns) >= act.frames:
                break
            yield
        if self._hurries:
            return Done(StepOutcome.NOT_DONE, f"watched for {self._passed_s():.0f} of {act.for_s:g} s")
        outcome, words = self.bench.judge(from_ns, self.bench.now()[0], act)
        came = count_text(len(self.bench.session.frames) - first, "frame")
        if act.frames is not None:
            came = f"{self._counted(act, first, from_ns)} of {count_text(act.frames, 'frame')}"
        if act.exposure_s is not None:
            came += f" of {act.exposure_s:g} s"
        gone = PORT_GONE if self.seen.link == "no port" else ""
        return Done(StepOutcome(outcome), f"{came}: {words or KEEPS_ALL}{gone}")

    def _counted(self, act: Watch, first: int, from_ns: int) -> int:
        """Frames from row ``first`` on that were exposed since then, as the watch asks."""
        frames = self.bench.session.frames.columns
        return int((act.counts(frames["exposure_s"][first:]) & (frames["utc_ns"][first:] >= from_ns)).sum())

    def _repeat(self, act: Repeat, number: str) -> _Ticks:
        seen: dict[StepOutcome, str] = {}
        for turn in range(1, act.times + 1):
            for n, step in enumerate(act.steps, 1):
                done = yield from self._step(step, f"{number}.{turn}.{n}")
                seen.setdefault(done.outcome, f"round {turn} of {act.times}: {done.seen}")
                if done.ends and not step.goes_on:
                    return Done(done.outcome, seen[done.outcome])
        worst = next((one for one in _WORST_FIRST if one in seen), StepOutcome.PASS)
        return Done(worst, count_text(act.times, "round") if worst is StepOutcome.PASS else seen[worst])


class OpenRun(Run):
    """A run whose steps a caller on another thread gives; ``on_begin`` is called when the first may be given."""

    def __init__(self, procedure: Procedure, desk: Desk) -> None:
        super().__init__(procedure, desk)
        self._asked: queue.Queue[tuple[Step, Future[Done]] | None] = queue.Queue()
        self._result: Future[Done] | None = None
        self._defect: Exception | None = None
        self._reason, self._has_caller = "", False
        self.on_begin: Callable[[], None] = lambda: None

    def do(self, step: Step, session: "Future[Any]") -> Done:
        """Have a step done and wait for its outcome; raises what ended the ``session`` meanwhile."""
        result: Future[Done] = Future()
        self._asked.put((step, result))
        wait([result, session], return_when=FIRST_COMPLETED)
        if not result.done():
            session.result()
            return Done(StepOutcome.NOT_DONE, "the session has ended")
        return result.result(0)

    def end(self, reason: str = "") -> None:
        """No more steps; ``reason`` says what went wrong with the caller."""
        self._reason = self._reason or reason
        self._asked.put(None)

    def _run(self) -> Generator[None, None, None]:
        self._record_begin()
        try:
            yield
            self.on_begin()
            self._has_caller = True
            yield from self._steps_given()
        except _Interrupted as reason:
            self._reason = str(reason)
            if self._result is not None and not self._result.done():
                self._result.set_result(Done(StepOutcome.NOT_DONE, self._reason))
            if self._has_caller and self.bench.is_live:
                yield from self._steps_given(_MOST_LEFT)
        if self._reason:
            text = event_text("0", StepOutcome.NOT_DONE, "the steps of the program", self._reason, "")
            self.bench.record(StationKind.STEP_DONE, text)
        self._record_end()
        if self._defect is not None:
            raise self._defect

    def _steps_given(self, most: float = math.inf) -> Generator[None, None, None]:
        """Do the steps that the caller gives until it ends; after a defect of ours it is told, and may clean up."""
        while most > 0 and (asked := (yield from self._next())) is not None:
            most -= 1
            step, self._result = asked
            try:
                done = yield from self._step(step, step.number)
            except _Interrupted:
                raise
            except Exception as error:
                self._defect = self._defect or error
                self._result.set_exception(error)
            else:
                self._result.set_result(done)

    def _next(self) -> "Generator[None, None, tuple[Step, Future[Done]] | None]":
        """The next step, None at the end; the time of a simulation stands still while its caller thinks."""
        while True:
            try:
                return self._asked.get(not self.bench.is_live or self._hurries, _PERSON_S)
            except queue.Empty:
                if self.bench.is_live or self.bench.interrupted():
                    yield


_WORST_FIRST = (StepOutcome.FAIL, StepOutcome.NOT_DONE, StepOutcome.INCONCLUSIVE)
