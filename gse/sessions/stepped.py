"""A session whose steps a Python program gives, one after the other: the engine of procedures with a caller.

The session runs on a thread of its own, which alone reads the port. Each call hands it a step, and waits for the
outcome. The time of a simulated sensor stands still between two calls.
"""

import dataclasses
import itertools
import threading
from collections.abc import Mapping
from concurrent.futures import Future
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml

from drivers.mock_ports import parse_mock_url
from drivers.urlhandlers.protocol_sim import register
from gse.config.choice import station_of, with_url
from gse.config.station import Station
from gse.errors import UsageError
from gse.procedure.as_run import StepOutcome
from gse.procedure.desk import Desk
from gse.procedure.engine import Done, OpenRun
from gse.procedure.file import check, parse_procedure
from gse.report.files import write_report
from gse.sessions.live import Ending, LiveSession, Operator, run_live, told_once
from gse.station.results import Verdict
from gse.station.setup import protocol_of
from gse.values.screen import Shown
from gse.verdict.assessment import Assessment, judge

_BEGINS_WITHIN_S = 600.0
"""The first session on a computer compiles the identifiers for its processor."""
_SIMULATED_S = 43_200
"""The longest session with a simulated sensor."""


class SteppedSession:
    """A session by steps; a context manager. Each step gives its outcome, which is true where it is PASS.

    ``folder`` is the session's; after the block ``assessment`` is there, and the report in the folder.
    """

    def __init__(
        self, station: Path | str | None = None, *, out: Path | str = "sessions", name: str = "session"
    ) -> None:
        """``station`` is a station file, the built-in one without; ``out`` gets the folder of the session."""
        self._station, self._text = station_of(Path(station) if station is not None else None)
        self._protocol = protocol_of(self._station)
        self._shown: list[Shown] = []
        if self._station.port.url.startswith("sim://"):
            self._station, self._text = simulated_station(*endless(self._station, self._text), self._shown)
        self._out, self._ending = Path(out), Ending()
        self._run = OpenRun(parse_procedure(_text({"power": "on"}, name)), Desk())
        self._numbers = itertools.count(1)
        self._outcomes: list[StepOutcome] = []
        self._opened = threading.Event()
        self._result: Future[LiveSession] = Future()
        self.folder: Path | None = None
        self.assessment: Assessment | None = None

    def __enter__(self) -> Self:
        threading.Thread(target=self._receive, name="session", daemon=True).start()
        if not self._opened.wait(_BEGINS_WITHIN_S) or self._result.done():
            self._result.result(0)  # raises what kept it from its begin
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._run.end("" if error is None else f"{type(error).__name__}: {error}")
        live = self._result.result()
        self.assessment = judge(live.session)
        write_report(live.session, self.assessment, live.folder, plots=False)

    @property
    def verdict(self) -> Verdict:
        """The verdict on the steps so far; after the block that on the session."""
        if self.assessment is not None:
            return self.assessment.verdict
        if StepOutcome.FAIL in self._outcomes:
            return Verdict.FAIL
        return Verdict.PASS if {*self._outcomes} == {StepOutcome.PASS} else Verdict.INCONCLUSIVE

    def power(self, on: bool) -> Done:
        """Switch the supply."""
        return self._do({"power": "on" if on else "off"})

    def send(
        self, command: str, *, at_most_s: float | None = None, expect: str | Mapping[str, str] = "", **arguments: Any
    ) -> Done:
        """Send a command of the description, and await the answer that proves it; ``exposure_s=0.2`` is 0.2 s.

        ``expect="refused"``, or {"refused": "out of range"}, is for a command that the sensor must refuse.
        """
        expected = {"expect": expect} if expect else {}
        return self._do({"send": {"command": command, **arguments, **_at_most(at_most_s), **expected}})

    def wait(
        self,
        for_s: float | None = None,
        *,
        until: Mapping[str, Any] | None = None,
        at_most_s: float | None = None,
        measure: str | None = None,
        poll: str | None = None,
    ) -> Done:
        """Wait for a time, or until items have their values; ``measure`` names the time that it took.

        ``poll`` is a command that is sent each half second meanwhile, for items that come only when they are asked for.
        """
        if until is None:
            return self._do({"wait": {"for": f"{for_s or 0:g} s"}})
        named = {key: word for key, word in (("measure", measure), ("poll", poll)) if word}
        return self._do({"wait": {"until": dict(until), **_at_most(at_most_s), **named}})

    def check(self, items: Mapping[str, Any], *, at_most_s: float | None = None) -> Done:
        """Whether items have their values, or lie in [low, high]; or shares of what was measured."""
        return self._do({"check": {**items, **_at_most(at_most_s)}})

    def watch(self, for_s: float, *, limits: Mapping[str, Any] | None = None) -> Done:
        """Judge a stretch as a session is judged, with other limits than those of the station file."""
        return self._do({"watch": {"for": f"{for_s:g} s", "limits": dict(limits or {})}})

    def _do(self, planned: Mapping[str, Any]) -> Done:
        procedure = parse_procedure(_text(planned, "step"), "this step")
        known = [one for one in check(procedure, self._station, self._protocol) if "is measured as" not in one]
        if known:
            raise UsageError(known[0].rpartition("step 1: ")[2])
        if self._result.done():
            self._result.result()
            raise UsageError(f"the session in {self.folder} has ended; begin another one")
        (step,) = procedure.steps
        done = self._run.do(dataclasses.replace(step, number=str(next(self._numbers))), self._result)
        self._outcomes.append(done.outcome)
        return done

    def _receive(self) -> None:
        def opened(folder: Path, status: object) -> None:
            self.folder = folder

        try:
            self._run.on_begin = self._opened.set
            operator = Operator(self._ending, opened=opened, screen_news=told_once(self._shown))
            self._result.set_result(run_live(self._station, self._text, self._out, operator, procedure=self._run))
        except BaseException as error:
            self._result.set_exception(error)
        finally:
            self._opened.set()


def _at_most(seconds: float | None) -> dict[str, str]:
    return {} if seconds is None else {"at_most": f"{seconds:g} s"}


def _text(planned: Mapping[str, Any], name: str) -> str:
    return yaml.safe_dump({"version": 1, "name": name, "steps": [dict(planned)]}, sort_keys=False, width=10_000)


def simulated_station(station: Station, text: str, shown: list[Shown]) -> tuple[Station, str]:
    """The station with the changes of the scenario in its sim:// URL; registers the simulated sensor.

    What the scenario's scene shows is added to ``shown``.
    """
    from gse.simulator import device_factory  # astropy, which no other port needs
    from gse.simulator.device import scenario_of

    register(device_factory(station))
    scenario = scenario_of(parse_mock_url(station.port.url).options, station)
    shown += scenario.shown(scenario.start_utc_ns)
    return scenario.station_for(station), scenario.station_text(text)


def endless(station: Station, text: str, seconds: float = _SIMULATED_S) -> tuple[Station, str]:
    """The station with a simulated sensor that goes on for so long, unless its URL says how long."""
    from gse.simulator.device import scenario_of

    url = station.port.url
    options = parse_mock_url(url).options
    if "frames" in options:
        return station, text
    own = {name: value for name, value in options.items() if name in ("scenario", "rate_hz", "start")}
    frames = max(round(seconds * scenario_of(own, station).rate_hz), 1)
    return with_url(station, text, f"{url}{'&' if '?' in url else '?'}frames={frames}")
