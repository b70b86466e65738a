"""Live session: receive, record, identify, compare with truth."""

import contextlib
import json
import re
import signal
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from types import FrameType
from typing import Any, Self

from drivers.chunk import Chunk, LinkEvent
from drivers.clock import ClockReading, read_clock
from drivers.errors import DriverError, PortError
from drivers.link import ITEMS_AT_ONCE, SerialLink
from drivers.ports import is_mock
from drivers.session_file.records import CLOCK
from gse.config.station import Station
from gse.errors import UsageError
from gse.external.identifier import recorded_json
from gse.procedure.as_run import StepOutcome, StepRun
from gse.procedure.desk import ANSWER
from gse.procedure.engine import Run
from gse.procedure.file import Watch
from gse.procedure.power import PowerSwitch, Ran
from gse.process import interrupts
from gse.recording.recorder import CLOSE_S, Recorder
from gse.recording.session_format import (
    ANSWER_TOPIC,
    EARTH_ORIENTATION,
    IDENTIFIER,
    LOG_TOPIC,
    MOST_READINGS,
    POWER_TOPIC,
    PROCEDURE,
    PROTOCOL,
    SCREEN_TOPIC,
    STATED,
    STATION,
    TIMING_TOPIC,
    PowerReading,
    clock_json,
    power_json,
    shown_json,
    timing_json,
)
from gse.sessions.asking import Asking, asking_of
from gse.sessions.status_file import StatusFile
from gse.station.events import OF_SENSOR, Notes, StationKind, event_of
from gse.station.frame_results import FrameResults
from gse.station.housekeeping import parameters_of
from gse.station.loop import RECEIVE_TIMEOUT_S, Listener, StationLoop
from gse.station.polling import check_asking
from gse.station.session_data import SessionData
from gse.station.setup import check_external, protocol_of, set_up
from gse.statistics.decision import Outcome
from gse.truth import EarthOrientation
from gse.truth.orientation import GivenTables
from gse.values import instant
from gse.values.screen import Shown
from gse.view.live_state import LiveState
from protocols import EncodeError, Protocol

# End of a live session by signals from a person, a terminal or the system.
#
# first signal       the session ends: it is closed, judged and reported
# Ctrl-Z             nothing but a word: a stopped process would lose what its port cannot hold
# Ctrl-C after that  no verdict: judging is left at once, closing is not, since data come first

_NAMED = {
    "SIGINT": "Ctrl-C (SIGINT)",
    "SIGTERM": "SIGTERM",
    "SIGHUP": "the hang-up of its terminal (SIGHUP)",
    "SIGQUIT": "Ctrl-\\ (SIGQUIT)",
    "SIGBREAK": "Ctrl-Break (SIGBREAK)",
}
REASONS = {signal.Signals[name]: text for name, text in _NAMED.items() if hasattr(signal, name)}
"""Reasons by signal, for the signals that this system has."""
SAME_PRESS_S = 1.0
"""A second Ctrl-C within this time is ignored: a double keystroke, or terminal and shell both sent one."""

REST_S = 20.0
"""After the signal, the time in which an overloaded computer processes what it has received; the rest is recorded."""


class Ending:
    """Catches the signals that end a session, and keeps the reason; a context manager.

    An ignored hang-up, as under nohup, stays ignored.
    """

    def __init__(self, say: Callable[[str], None] = lambda text: None, *, rest_s: float = REST_S) -> None:
        self._rest_s = rest_s
        self.reason = ""
        self.leaves = False
        self._say = say
        self._first_s = 0.0
        self._interruptible = False
        self._before: dict[int, Any] = {}

    def asked(self) -> bool:
        """Whether a signal asked for the end of the session."""
        return bool(self.reason)

    def leaves_the_rest(self) -> bool:
        """Whether what is received and not processed is left: after a second Ctrl-C, or REST_S after the first."""
        return self.leaves or (self.asked() and time.monotonic() - self._first_s > self._rest_s)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """A block that a second Ctrl-C interrupts with KeyboardInterrupt, also one pressed before the block."""
        try:
            self._interruptible = True
            if self.leaves:
                raise KeyboardInterrupt
            yield
        finally:
            self._interruptible = False

    def __enter__(self) -> Self:
        for number in REASONS:
            if number.name != "SIGHUP" or signal.getsignal(number) is not signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._on_signal)
        if hasattr(signal, "SIGTSTP"):
            self._before[signal.SIGTSTP] = signal.signal(signal.SIGTSTP, self._on_stop)
        # With `stty tostop` a word from the background would stop the process.
        if hasattr(signal, "SIGTTOU"):
            self._before[signal.SIGTTOU] = signal.signal(signal.SIGTTOU, signal.SIG_IGN)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _on_stop(self, number: int, frame: FrameType | None) -> None:
        self._say("Ctrl-Z stops no session: it would lose bytes. Ctrl-C ends it; --detach runs one without a terminal")

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not self.reason:
            self.reason = REASONS[signal.Signals(number)]
            self._first_s = time.monotonic()
            self._say(
                f"{self.reason}: the session is closed, judged and reported; Ctrl-C again leaves it without a verdict"
            )
        elif number == signal.SIGINT and time.monotonic() - self._first_s >= SAME_PRESS_S:
            if not self.leaves:
                self.leaves = True
                self._say("Ctrl-C again: the session is closed, but not judged")
            if self._interruptible:
                interrupts.interrupt(number, frame)


FIRST_WITHIN_S = 1.0
"""Time for the first item: a live port reports at once that it is open, a simulated one sends its first bytes."""

FEW_BYTES = 64 << 10
"""Fewer unwritten bytes than this are usual."""

_BEHIND_NS = 2 * instant.NS_PER_S
"""Between two looks at the steps of a procedure while received bytes wait."""
_ITEMS_OF_A_STEP = 3
"""Chunks of a simulated port between two looks at the steps of a procedure: about a panorama."""

CLOCK_EVERY_NS = 60 * instant.NS_PER_S


@dataclass(frozen=True, slots=True)
class LiveSession:
    """Result of a live session: data, folder, this host's identification times, and the bytes that were not recorded.

    ``damage`` describes the difference between the closed file and the bytes written to it. ``left_bytes`` were
    recorded and not processed, because the session was to end.
    """

    session: SessionData
    folder: Path
    own_elapsed_us: "array[float]"
    lost_bytes: int
    damage: str | None = None
    left_bytes: int = 0


@dataclass(frozen=True, slots=True)
class Operator:
    """Connection of a session to the person at the terminal.

    ``tell`` prints a line, ``opened`` is called with the session's folder and status once the port is open,
    ``terminal_news`` gives kind and text of the terminal's events since the last call, ``notes`` takes the operator's,
    ``screen_news`` gives what a screen before the sensor shows from when on, and its events, since the last call;
    ``scene_is_over`` ends a session whose scene has an end.
    """

    ending: Ending
    tell: Callable[[str], None] = lambda text: None
    opened: Callable[[Path, StatusFile], None] = lambda folder, status: None
    terminal_news: Callable[[], list[tuple[str, str]]] = list
    notes: Notes = field(default_factory=Notes)
    screen_news: Callable[[], Sequence[Shown | tuple[str, str]]] = list
    scene_is_over: Callable[[], bool] = lambda: False


def told_once(shown: Sequence[Shown]) -> Callable[[], list[Shown]]:
    """News of a screen that a simulation knows from the begin: all of it at the first call."""
    left = list(shown)

    def news() -> list[Shown]:
        found, left[:] = list(left), []
        return found

    return news


def new_session_folder(out: Path, name: str, utc_ns: int | None) -> Path:
    """A new folder <UTC>-<sensor>/ under ``out``, numbered if the name is taken; without an unknown UTC."""
    begun = "" if utc_ns is None else instant.to_text(utc_ns, 0).replace(":", "").replace("-", "") + "-"
    stem = begun + re.sub(r"[^A-Za-z0-9._-]+", "-", name)
    for number in range(1, 10_000):
        folder = out / (stem if number == 1 else f"{stem}-{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            if not out.is_dir():
                raise UsageError(f"--out {out} is a file; expected a folder for the sessions") from None
            continue
        except OSError as error:
            raise UsageError(
                f"cannot make the session folder {folder}: {error.strerror}; choose another --out"
            ) from error
        return folder
    raise UsageError(f"{out} is full of sessions called {stem}; choose another --out")


def run_live(
    station: Station,
    station_text: str,
    out: Path,
    operator: Operator,
    *,
    make_listeners: Callable[[StationLoop, Path, LiveState], Sequence[Listener]] = lambda loop, folder, live: (live,),
    duration_s: float | None = None,
    wait_port: bool = False,
    clock_error_s: float | None = None,
    given_orientation: GivenTables | None = None,
    procedure: Run | None = None,
) -> LiveSession:
    """Run until the port is at its end (simulated), ``duration_s`` of the data's time have passed, or a signal.

    With a ``procedure`` until its last step, and its cleanup in any case.

    Recording begins with the first byte, before the tables are loaded. DriverError where the port cannot be opened,
    UsageError where an external identifier cannot be started: then nothing is left behind.
    """
    protocol = protocol_of(station)
    check_asking(station.sensor, station.port, protocol)
    check_external(station, protocol, operator.tell)
    folder = new_session_folder(out, station.sensor.name, read_clock().utc_ns)
    recorder, link = _opened(station, folder, wait_port, duration_s)
    _attach(recorder, station_text, protocol, clock_error_s)
    live = LiveState(station)
    status = StatusFile(folder, live, operator.notes)
    with recorder, link:
        operator.opened(folder, status)
        sends = procedure is not None or station.test.parameters or station.test.parameters_sha256
        most = _ITEMS_OF_A_STEP if sends and not link.is_live else ITEMS_AT_ONCE
        first = link.receive(FIRST_WITHIN_S, most)
        with operator.ending.interruptible():
            began_ns = first[0].utc_ns if first else link.utc_ns() or None
            setup = set_up(station, station_text, utc_ns=began_ns, protocol=protocol, tell=operator.tell)
            loop = StationLoop(setup, given_orientation=given_orientation)
        asking = asking_of(station.sensor, link, loop.setup.protocol)
        power = PowerSwitch(station.power) if station.power is not None and link.is_live else None
        running = _RunningSession(loop, recorder, link, operator, duration_s=duration_s, asking=asking, power=power)
        loop.session.clock_error_s = clock_error_s
        live.housekeeping = loop.session.housekeeping
        live.in_work_since_ns = lambda: loop.in_work_since_ns
        loop.listeners = make_listeners(loop, folder, live)
        if procedure is not None:
            running.begin_procedure(procedure)
        status.enter("running")
        running.take_screen(began_ns or 0)
        with asking or nullcontext(), power or nullcontext():
            session = running.run(first, most)
        running.close()
        status.enter("closing")
        operator.tell(_closing_words(recorder))
        session.housekeeping.use_disk()
        session.frames.use_disk()  # nothing is received any more, and judging takes memory
    for event in recorder.news():
        loop.on_event(event)
        operator.tell(f"{event.kind}: {event.text}")
    return LiveSession(session, folder, loop.own_elapsed_us, recorder.lost_bytes, recorder.damage, loop.left_bytes)


def _opened(station: Station, folder: Path, wait_port: bool, duration_s: float | None) -> tuple[Recorder, SerialLink]:
    """The recording and the port; where either cannot be opened, the folder is gone too."""
    port = station.port
    try:
        recorder = Recorder(folder / "session.mcap", live=not is_mock(port.url))
    except (DriverError, OSError):
        folder.rmdir()
        raise
    try:
        link = SerialLink(
            port.url,
            port.baudrate,
            recorder=recorder,
            wait_port=wait_port,
            stamped_s=duration_s,
            line=port.line,
            pass_to=port.pass_to,
            tx_url=port.tx_url,
        )
    except DriverError:
        recorder.close()
        recorder.path.unlink()
        folder.rmdir()
        raise
    return recorder, link


def _attach(recorder: Recorder, station_text: str, protocol: Protocol, clock_error_s: float | None) -> None:
    """Record what was stated before the first byte: a replay reads it with the bytes."""
    recorder.attach(STATION, "application/yaml", station_text.encode())
    recorder.attach(PROTOCOL, "application/yaml", protocol.text.encode())
    if clock_error_s is not None:
        recorder.attach(STATED, "application/json", json.dumps({"clock_error_s": clock_error_s}).encode())


def _closing_words(recorder: Recorder) -> str:
    waiting = recorder.waiting_bytes
    waits = f"; {waiting} bytes wait for the disk, up to {CLOSE_S:.0f} s: make room" if waiting > FEW_BYTES else ""
    return f"closing {recorder.path}{waits}"


_READ_BACK_TIMES, _READ_BACK_NS = 3, 5 * instant.NS_PER_S
"""A sensor that did not answer in this time is asked again for its parameters, so often in all."""


class _RunningSession:
    """A session while its loop runs: all that is done between two rounds of the loop.

    Derived data is recorded beside the bytes: identification times, clock readings, Earth orientation. What operator,
    screen, supply and procedure bring gets its place among the events. ``is_over`` says when the session ends.
    """

    def __init__(
        self,
        loop: StationLoop,
        recorder: Recorder,
        link: SerialLink,
        operator: Operator,
        *,
        duration_s: float | None,
        asking: Asking | None,
        power: PowerSwitch | None,
    ) -> None:
        self._loop, self._recorder, self._link, self._operator = loop, recorder, link, operator
        self._asking, self._power = asking, power
        self._procedure: Run | None = None
        self._ticked_ns = 0
        self._duration_ns = None if duration_s is None else round(duration_s * instant.NS_PER_S)
        self._first_ns: int | None = None
        self._last_ns = 0
        self._clock_due_ns = 0
        self._orientation_kept: EarthOrientation | None = None
        self._identity_kept: dict[str, object] | None = None
        self._read_back_left, self._read_back_due_ns = _READ_BACK_TIMES, 0

    def run(self, first: Sequence[Chunk | LinkEvent], most: int) -> SessionData:
        """Run the loop from the ``first`` items until the session is over; a procedure has its cleanup in any case."""
        try:
            return self._loop.run(
                self._link,
                first,
                stop=self.is_over,
                leave=self._operator.ending.leaves_the_rest,
                each=self.keep,
                wait_s=self._asking.wait_s if self._asking else lambda: RECEIVE_TIMEOUT_S,
                most=most,
                last=self.finish_procedure,
            )
        except Exception as error:
            self.finish_procedure(f"an internal error of gse: {type(error).__name__}: {error}")
            raise
        finally:
            self.finish_procedure()

    def is_over(self) -> bool:
        """Whether a signal asked for the end, or the duration is over; a procedure ends with its cleanup."""
        if self._procedure is not None:
            return self._procedure.is_over or self._operator.ending.leaves
        if self._operator.ending.asked() or self._operator.scene_is_over():
            return True
        if self._duration_ns is None or not self._link.is_live:  # a simulated port ends by itself
            return False
        # A host clock that is set in the session must not lengthen or end it.
        now_ns = self._link.mono_ns()
        if self._first_ns is None:
            self._first_ns = now_ns
        return now_ns - self._first_ns >= self._duration_ns

    def keep(self, results: list[FrameResults]) -> None:
        """Record the derived data of these results."""
        if self._asking is not None:
            self._asking.came(sum(map(len, results)), self._loop.session.link.reconnects)
        for result in chain.from_iterable(results):
            self._last_ns = result.panorama.host_utc_ns
            if result.elapsed_us is not None:
                data = timing_json(result.panorama.time_us, result.elapsed_us)
                self._recorder.derived(TIMING_TOPIC, result.panorama.host_utc_ns, data)
            if result.given is not None:
                data = recorded_json(result.panorama, result.given)
                self._recorder.derived(ANSWER_TOPIC, result.panorama.host_utc_ns, data)
        self._keep_identity()
        orientation = self._loop.session.earth_orientation
        if orientation is not None and orientation is not self._orientation_kept:
            self._orientation_kept = orientation
            self._recorder.attach(EARTH_ORIENTATION, "application/json", orientation.to_json().encode())
        for event in self._recorder.news():
            self._place(event)
        self.take_screen(self._last_ns)
        self.take_power()
        if self._link.is_live or self._last_ns:
            for kind, text in self._operator.terminal_news():
                self._event(kind, text)
            self.take_notes()
            self._read_parameters_back()
        self._read_clock()
        self._tick_procedure()

    def _read_parameters_back(self) -> None:
        """Ask for the parameters that the station file states, until they come; a procedure does that by its steps."""
        session, protocol, now_ns = self._loop.session, self._loop.setup.protocol, self._link.mono_ns()
        test, command = session.station.test, protocol.description.parameters
        if command is None or not (test.parameters or test.parameters_sha256) or self._procedure is not None:
            return
        if not session.link.frames or now_ns < self._read_back_due_ns or parameters_of(session.housekeeping):
            return
        if self._read_back_left and self._link.url.partition("://")[0] != "replay":
            self._read_back_left, self._read_back_due_ns = self._read_back_left - 1, now_ns + _READ_BACK_NS
            with contextlib.suppress(PortError, EncodeError):  # a command with arguments is the operator's
                self._link.send(protocol.commands[command].encode())

    def take_notes(self) -> None:
        """Take what the page, ``gse note`` and ``gse sensor`` left."""
        for text in self._operator.notes.take():
            if self._procedure is not None and text.startswith(ANSWER):
                self._procedure.desk.put_note(text)
            elif text.startswith(OF_SENSOR):
                with contextlib.suppress(PortError):  # the port is gone: gse sensor gets no answer and asks again
                    self._link.send(bytes.fromhex(text.removeprefix(OF_SENSOR)))
            else:
                self._event(*event_of(text))

    def begin_procedure(self, procedure: Run) -> None:
        """Record a procedure, let it see the results, and begin its steps."""
        self._recorder.attach(PROCEDURE, "application/yaml", procedure.procedure.text.encode())
        self._loop.listeners = (*self._loop.listeners, procedure.seen)
        self._loop.take_frame = procedure.take_frame
        procedure.begin(_Bench(self._loop, self._link, self._place, self._power, self._operator.ending))
        self._procedure = procedure
        procedure.desk.look = self.take_notes

    def _tick_procedure(self) -> None:
        """Go on with the procedure once all that came is processed, since its events stand after that in the recording.

        A live port puts them into their place itself; on a computer that is behind it goes on now and then.
        """
        now_ns, is_live = self._link.mono_ns(), self._link.is_live
        behind = self._loop.items_left or (is_live and self._link.has_news)
        if self._procedure is not None and (not behind or (is_live and now_ns - self._ticked_ns > _BEHIND_NS)):
            self._ticked_ns = now_ns
            self._procedure.tick()

    def finish_procedure(self, error: str = "") -> None:
        """Do what is left of a procedure, at the end of the session or of the data, or after an ``error``."""
        if self._procedure is not None:
            self._procedure.finish(error or self._operator.ending.reason or "the end of the data")
        self.take_power()

    def take_screen(self, utc_ns: int) -> None:
        """Record what the screen before the sensor showed: truth needs it before the panoramas that saw it."""
        for news in self._operator.screen_news():
            if isinstance(news, Shown):
                self._loop.session.shown.add(news)
                self._recorder.derived(SCREEN_TOPIC, utc_ns or read_clock().utc_ns, shown_json(news))
            else:
                self._event(*news)

    def take_power(self) -> None:
        """Record what the supply did since the last call."""
        for at, news in self._power.news() if self._power else ():
            if not isinstance(news, PowerReading):
                self._link.report(LinkEvent(at.utc_ns, at.mono_ns, *news))
            elif len(self._loop.session.power) < MOST_READINGS:
                self._loop.session.power.append(news)
                self._recorder.derived(POWER_TOPIC, at.utc_ns, power_json(news))

    def _keep_identity(self) -> None:
        """What an external identifier is, and what it wrote to stderr."""
        external = self._loop.setup.external
        if external is None:
            return
        if external.identity != self._identity_kept:
            self._identity_kept = external.identity
            self._recorder.attach(IDENTIFIER, "application/json", json.dumps(self._identity_kept).encode())
        if log := external.take_log():
            self._recorder.derived(LOG_TOPIC, self._last_ns, log)

    def _event(self, kind: str, text: str) -> None:
        """An event of this host, now; in a simulated session at the time of its data."""
        utc_ns = read_clock().utc_ns if self._link.is_live else self._last_ns
        self._place(LinkEvent(utc_ns, self._link.mono_ns(), kind, text))

    def _place(self, event: LinkEvent) -> None:
        """Record an event, and give it to the loop in the same place: on a live port after all that has come by now."""
        if self._link.is_live:
            self._link.report(event)
        else:
            self._recorder.event(event)
            self._loop.take([event])

    def close(self) -> None:
        """Record the end of the session; silence up to this instant counts as part of it."""
        self._keep_identity()
        if self._link.is_live:
            over = "the end of its scene" if self._operator.scene_is_over() else "--duration"
            over = "the end of its procedure" if self._procedure is not None else over
            self._event(StationKind.CLOSED, f"the session was ended by {self._operator.ending.reason or over}")
            while items := self._link.receive(0):  # what came and was left is recorded only
                self._loop.take([item for item in items if isinstance(item, LinkEvent)])

    def _read_clock(self) -> None:
        reading = read_clock() if self._link.is_live else _simulated_clock(self._last_ns)
        # An event that waits happened before this silence, and is recorded before it.
        if self._link.is_live and not self._link.has_news and not self._loop.items_left:
            self._loop.pass_time(reading.utc_ns, reading.mono_ns)
        if reading.mono_ns >= self._clock_due_ns and (self._link.is_live or self._last_ns):
            self._clock_due_ns = reading.mono_ns + CLOCK_EVERY_NS
            self._loop.read_clock(reading)
            self._recorder.derived(CLOCK, reading.utc_ns, clock_json(reading))


class _Bench:
    """What the steps of a procedure act on: this session, its port, its supply."""

    def __init__(
        self,
        loop: StationLoop,
        link: SerialLink,
        place: Callable[[LinkEvent], None],
        power: PowerSwitch | None,
        ending: Ending,
    ) -> None:
        self._link, self._place, self._power, self._ending = link, place, power, ending
        self.session, self.protocol, self.is_live = loop.session, loop.setup.protocol, link.is_live

    def now(self) -> tuple[int, int]:
        """UTC and monotonic nanoseconds of the data."""
        return self._link.utc_ns(), self._link.mono_ns()

    def send(self, data: bytes) -> None:
        """Bytes to the sensor; PortError where the port is gone."""
        self._link.send(data)

    def record(self, kind: str, text: str) -> None:
        """An event of the session, now."""
        self._place(LinkEvent(*self.now(), kind, text))

    def switch(self, *, on: bool) -> "Future[Ran] | None":
        """Switch the supply; a simulated sensor has one of its own, whatever the station file names."""
        if self._power is not None:
            return self._power.switch(on=on)
        simulated: Future[Ran] = Future()
        if self.is_live or not self._link.switch_simulated(on=on):
            return None
        self.record(StationKind.POWER_ON if on else StationKind.POWER_OFF, "the simulated supply")
        simulated.set_result(Ran(True, "the simulated supply"))
        return simulated

    def judge(self, from_ns: int, until_ns: int, watch: Watch) -> tuple[Outcome, str]:
        """Judge a stretch of the session."""
        from gse.verdict.assessment import judge_watch  # what draws conclusions is imported when it is needed

        step = StepRun("", "", StepOutcome.PASS, "", "", from_ns, until_ns)
        assessment = judge_watch(self.session, step, watch)
        return Outcome(assessment.verdict.value), next(iter(assessment.reasons), "")

    def interrupted(self) -> str:
        """Why the run is to end; empty where it is not."""
        return self._ending.reason


def _simulated_clock(utc_ns: int) -> ClockReading:
    return ClockReading(utc_ns, utc_ns, "simulated", synchronised=True, offset_s=0.0, error_bound_s=0.0)
