"""The procedure file: steps of a test in YAML, read with the place of every word.

A step is a mapping with one key that says what is done (tell, ask, power, wait, send, check, watch, repeat), and beside
it ``on_failure: go on`` where the test is to go on without it. Conditions are tables, never expressions: an item with
its value, with [low, high], or several, of which all must hold.
"""

import dataclasses
import difflib
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from drivers.host_files import a_file_or_a_shells_pipe
from drivers.outside_text import plain_line
from gse.config.station import MAX_FILE_BYTES, Station
from gse.errors import ConfigError
from gse.station.events import SKY_WORDS
from gse.values.limits import Limits
from gse.values.text import count_text
from protocols import NO_ANSWER, Condition, EncodeError, Item, Protocol
from protocols.items import Wanted, unknown_name
from protocols.yaml_text import load_document, yaml_problem

MOST_RUNS = 900
"""Most steps of a run, each round of a repeat counted: a session keeps 1,000 events of a kind."""
OPERATOR_S = 3600.0
"""Time that a step waits for the operator where it does not say."""
CHECK_S = 15.0
"""Time that a check waits for an item that has not come: STATUS frames come every ten seconds or more often."""
_LONGEST_S = 30 * 86_400.0
_MOST_FRAMES = 1_000_000
_MOST_PLANNED = 600
"""Characters of a step that the as-run log shows."""

Conditions = Mapping[str, Wanted]
Place = tuple[int, int]
"""Line and column, from 1."""


@dataclass(frozen=True, slots=True)
class Tell:
    """The operator is told something, and confirms it."""

    text: str
    at_most_s: float = OPERATOR_S


@dataclass(frozen=True, slots=True)
class Ask:
    """The operator is asked something; ``expect`` is the pattern of the whole answer."""

    label: str
    text: str
    expect: str | None = None
    at_most_s: float = OPERATOR_S


@dataclass(frozen=True, slots=True)
class SwitchPower:
    """The supply is switched."""

    on: bool


@dataclass(frozen=True, slots=True)
class Wait:
    """For a time, or until conditions hold; ``measure`` names the time that it took.

    ``poll`` is a command that is sent again and again meanwhile: items that come only when they are asked for.
    """

    for_s: float | None = None
    until: Conditions = field(default_factory=dict)
    at_most_s: float = 60.0
    measure: str | None = None
    poll: str = ""


@dataclass(frozen=True, slots=True)
class Send:
    """A command goes to the sensor, whose answer is awaited; as long as its description says where None.

    ``refused`` is the reason for which the sensor must refuse it, empty for any; None where it must obey.
    """

    command: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    at_most_s: float | None = None
    refused: str | None = None


@dataclass(frozen=True, slots=True)
class ShareOf:
    """A share of what was measured must be at most a limit, with 95 % confidence."""

    name: str
    share: float
    at_most: float


@dataclass(frozen=True, slots=True)
class CheckNow:
    """Items have their values now; ``shares`` are of what was measured before."""

    items: Conditions
    shares: tuple[ShareOf, ...] = ()
    at_most_s: float = CHECK_S


def exposure_range_s(exposure_s: float) -> tuple[float, float]:
    """From which to which exposure a sensor has the one that it was commanded: its timer may have steps of 1 %."""
    return 0.99 * exposure_s, 1.01 * exposure_s


@dataclass(frozen=True, slots=True)
class Watch:
    """A stretch that is judged as a session is; ``limits`` take the place of those of the station file.

    It ends before ``for_s`` where so many ``frames`` came; frames of another exposure than ``exposure_s`` do not count.
    """

    for_s: float
    limits: Mapping[str, Any] = field(default_factory=dict)
    requirements: Mapping[str, Any] = field(default_factory=dict)
    frames: int | None = None
    exposure_s: float | None = None

    def counts(self, exposure_s: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Which frames (M,) of these exposures are judged."""
        if self.exposure_s is None:
            return np.ones(len(exposure_s), dtype=np.bool_)
        low, high = exposure_range_s(self.exposure_s)
        return (low <= exposure_s) & (exposure_s <= high)


@dataclass(frozen=True, slots=True)
class Repeat:
    """Steps that are done again and again."""

    times: int
    steps: tuple["Step", ...]


Act = Tell | Ask | SwitchPower | Wait | Send | CheckNow | Watch | Repeat


@dataclass(frozen=True, slots=True)
class Step:
    """One step with its place in the file; ``planned`` is what it says there, in one line of YAML."""

    number: str
    act: Act
    planned: str
    line: int
    column: int
    goes_on: bool = False
    places: Mapping[str, Place] = field(default_factory=dict)
    """Of the words in it, by name."""


@dataclass(frozen=True, slots=True)
class Procedure:
    """A procedure file: ``station`` is the path that it names, ``text`` all of it."""

    name: str
    station: Path | None
    steps: tuple[Step, ...]
    cleanup: tuple[Step, ...]
    source: str = "procedure"
    text: str = ""

    def all_steps(self) -> Iterator[Step]:
        """Every step of the file, once, also those of repeats and of the cleanup."""
        yield from _flat((*self.steps, *self.cleanup))


def _flat(steps: Sequence[Step]) -> Iterator[Step]:
    for step in steps:
        yield step
        if isinstance(step.act, Repeat):
            yield from _flat(step.act.steps)


# A document whose every value knows its place.


@dataclass(frozen=True, slots=True)
class _Node:
    """A value with its place; ``text`` is how a scalar is written."""

    value: Any
    line: int
    column: int
    text: str = ""

    def shown(self) -> str:
        """The value in one line of YAML."""
        if isinstance(self.value, dict):
            return "{" + ", ".join(f"{key}: {node.shown()}" for key, node in self.value.items()) + "}"
        if isinstance(self.value, list):
            return "[" + ", ".join(node.shown() for node in self.value) + "]"
        return (
            self.text if re.fullmatch(r"[^\s,\[\]{}#:\"'|&*!%@`>][^,\[\]{}#:\"'|]*", self.text) else _quoted(self.text)
        )


def _quoted(text: str) -> str:
    return json.dumps(" ".join(text.split()), ensure_ascii=False)


def _places(node: _Node) -> Iterator[tuple[str, Place]]:
    """Where the values of a step stand, by their names; those of steps in it are their own."""
    for name, below in node.value.items() if isinstance(node.value, dict) else ():
        if name != "steps":
            yield name, (below.line, below.column)
            yield from _places(below)


_OF_SEND = ("command", "at_most", "expect")
"""Words of a ``send`` itself; an argument of such a name stands in ``arguments``."""


class _Reader:
    """Reads one file; problems are ConfigErrors with file, line and column."""

    def __init__(self, source: str) -> None:
        self._source = source

    def problem(self, node: _Node, text: str) -> ConfigError:
        return ConfigError(f"{self._source}, line {node.line}, column {node.column}: {plain_line(text)}")

    def located(self, node: yaml.Node, value: Any) -> _Node:
        line, column = node.start_mark.line + 1, node.start_mark.column + 1
        if isinstance(node, yaml.MappingNode) and isinstance(value, dict):
            found: dict[str, _Node] = {}
            for (key, below), item in zip(node.value, self._items(node, value), strict=True):
                name = str(key.value)
                place = _Node(name, key.start_mark.line + 1, key.start_mark.column + 1)
                if name in found:
                    raise self.problem(place, f"{name} stands here twice; leave one out")
                found[name] = self.located(below, item)
            return _Node(found, line, column)
        if isinstance(node, yaml.SequenceNode) and isinstance(value, list):
            pairs = zip(node.value, value, strict=True)
            return _Node([self.located(below, item) for below, item in pairs], line, column)
        return _Node(value, line, column, str(node.value))

    def _items(self, node: yaml.MappingNode, value: dict[Any, Any]) -> list[Any]:
        if len(value) != len(node.value):  # a key twice, or a merge
            seen: set[str] = set()
            for key, _ in node.value:
                if str(key.value) in seen:
                    place = _Node("", key.start_mark.line + 1, key.start_mark.column + 1)
                    raise self.problem(place, f"{key.value} stands here twice; leave one out")
                seen.add(str(key.value))
        return list(value.values())

    def table(self, node: _Node, known: Sequence[str], needed: Sequence[str] = ()) -> dict[str, _Node]:
        """A mapping with known keys only, and all that are needed."""
        if not isinstance(node.value, dict):
            raise self.problem(node, f"expected a mapping with {', '.join(known)}, came {node.shown():.60}")
        for name, below in node.value.items():
            if name not in known:
                raise self.problem(below, f"unknown key {name}; {near_words(name, known)}")
        for name in needed:
            if name not in node.value:
                raise self.problem(node, f"{name} is missing; known here: {', '.join(known)}")
        return dict(node.value)

    def text(self, node: _Node) -> str:
        if isinstance(node.value, dict | list) or not node.text.strip():
            raise self.problem(node, "expected a text")
        return plain_line(" ".join(node.text.split()))

    def duration(self, node: _Node) -> float:
        try:
            return seconds_of(node.text if not isinstance(node.value, dict | list) else "")
        except ValueError as error:
            raise self.problem(node, str(error)) from None

    def whole(self, node: _Node, least: int, most: int) -> int:
        if isinstance(node.value, bool) or not isinstance(node.value, int) or not least <= node.value <= most:
            raise self.problem(
                node, f"{node.shown():.40} does not work: expected a whole number from {least} to {most}"
            )
        return node.value

    def number(self, node: _Node) -> float:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float) or math.isnan(node.value):
            raise self.problem(node, f"{node.shown():.40} is not a number")
        return float(node.value)

    # Conditions

    def conditions(self, node: _Node) -> dict[str, Wanted]:
        if not isinstance(node.value, dict) or not node.value:
            raise self.problem(node, "expected a table of items, such as {mode: standby, supply_v: [4.8, 5.2]}")
        return {name: self._wanted(name, below) for name, below in node.value.items()}

    def _wanted(self, name: str, node: _Node) -> Wanted:
        if isinstance(node.value, list):
            if len(node.value) != 2:
                raise self.problem(node, f"{name}: expected [low, high]; null leaves an end open")
            ends = [end.text if isinstance(end.value, str) else end.value for end in node.value]
            if any(isinstance(end, bool | list | dict) for end in ends):
                raise self.problem(node, f"{name}: {node.shown():.60} is no range; expected [low, high]")
            return ends
        if isinstance(node.value, dict):
            raise self.problem(node, f"{name}: expected a value, or [low, high]")
        if node.value == "":
            return ""  # none of the bits is set
        if node.value is None:
            raise self.problem(node, f"{name} has no value; none of the bits of an item is ''")
        is_number = isinstance(node.value, int | float) and not isinstance(node.value, bool)
        return self.number(node) if is_number else self.text(node)

    # Steps

    def steps(self, node: _Node, prefix: str, kinds: Mapping[str, Callable[[_Node, str], Act]]) -> tuple[Step, ...]:
        if not isinstance(node.value, list) or not node.value:
            raise self.problem(node, "expected a list of steps, each with a dash: - power: on")
        return tuple(self._step(below, f"{prefix}{n}", kinds) for n, below in enumerate(node.value, 1))

    def _step(self, node: _Node, number: str, kinds: Mapping[str, Callable[[_Node, str], Act]]) -> Step:
        found = self.table(node, (*kinds, "on_failure"))
        acts = [name for name in found if name != "on_failure"]
        if len(acts) != 1:
            raise self.problem(node, f"a step does one thing, here are {len(acts)}; known: {', '.join(kinds)}")
        below = found[acts[0]]
        goes_on = "on_failure" in found
        if goes_on and found["on_failure"].text != "go on":
            raise self.problem(found["on_failure"], "expected on_failure: go on, or no such key: the run ends then")
        planned = f"{acts[0]}: {below.shown()}"
        planned = planned if len(planned) <= _MOST_PLANNED else f"{planned[: _MOST_PLANNED - 4]} ..."
        act, places = kinds[acts[0]](below, number), dict(_places(below))
        return Step(number, act, plain_line(planned), node.line, node.column, goes_on, places)

    @property
    def in_cleanup(self) -> dict[str, Callable[[_Node, str], Act]]:
        """What can be done with nobody there."""
        return {"power": self._power, "send": self._send, "wait": self._pause}

    @property
    def kinds(self) -> dict[str, Callable[[_Node, str], Act]]:
        """What a step can do."""
        return {
            "tell": self._tell,
            "ask": self._ask,
            "power": self._power,
            "wait": self._wait,
            "send": self._send,
            "check": self._check,
            "watch": self._watch,
            "repeat": self._repeat,
        }

    def _tell(self, node: _Node, number: str) -> Tell:
        if not isinstance(node.value, dict):
            return Tell(self.text(node))
        found = self.table(node, ("text", "at_most"), ("text",))
        return Tell(self.text(found["text"]), self._at_most(found, OPERATOR_S))

    def _ask(self, node: _Node, number: str) -> Ask:
        found = self.table(node, ("label", "text", "expect", "at_most"), ("label", "text"))
        expect = self.text(found["expect"]) if "expect" in found else None
        try:
            re.compile(expect or "")
        except re.error as error:
            raise self.problem(found["expect"], f"{expect!r:.60} is not a pattern: {error}") from None
        return Ask(self.text(found["label"]), self.text(found["text"]), expect, self._at_most(found, OPERATOR_S))

    def _power(self, node: _Node, number: str) -> SwitchPower:
        if node.text not in ("on", "off"):
            raise self.problem(node, f"power: {node.shown():.40}: expected on or off")
        return SwitchPower(node.text == "on")

    def _wait(self, node: _Node, number: str) -> Wait:
        found = self.table(node, ("for", "until", "at_most", "measure", "poll"))
        if ("for" in found) == ("until" in found):
            raise self.problem(node, "expected one of for: 5s and until: {item: value}")
        if "for" in found:
            if len(found) > 1:
                raise self.problem(node, "a wait for a time has no at_most, measure or poll")
            return Wait(self.duration(found["for"]))
        measure = self.text(found["measure"]) if "measure" in found else None
        if measure is not None and not measure.endswith("_s"):
            raise self.problem(found["measure"], f"{measure} is a time: its name ends in _s, such as first_fix_s")
        until = self.conditions(found["until"])
        if until.get("state") == "acquired" and until.get("link", "streaming") != "streaming":
            raise self.problem(found["until"], f"a sensor that is acquired is not {until['link']}: both never hold")
        poll = self.text(found["poll"]) if "poll" in found else ""
        return Wait(None, until, self._at_most(found, 60.0), measure, poll)

    def _pause(self, node: _Node, number: str) -> Wait:
        return Wait(self.duration(self.table(node, ("for",), ("for",))["for"]))

    def _send(self, node: _Node, number: str) -> Send:
        if not isinstance(node.value, dict):
            return Send(self.text(node))
        if "command" not in node.value:
            raise self.problem(
                node, "command is missing; expected for example {command: SET_EXPOSURE, exposure: 200 ms}"
            )
        given = {name: below for name, below in node.value.items() if name not in _OF_SEND}
        named = given["arguments"].value if "arguments" in given else None
        if isinstance(named, dict):
            del given["arguments"]
            if twice := given.keys() & named.keys():
                raise self.problem(named[min(twice)], f"{min(twice)} stands here twice; leave one out")
            given |= named
        arguments = {name: below.text if isinstance(below.value, str) else below.value for name, below in given.items()}
        at_most_s = self.duration(node.value["at_most"]) if "at_most" in node.value else None
        refused = self._refused(node.value["expect"]) if "expect" in node.value else None
        return Send(self.text(node.value["command"]), arguments, at_most_s, refused)

    def _refused(self, node: _Node) -> str:
        if node.text == "refused":
            return ""
        if isinstance(node.value, dict) and [*node.value] == ["refused"]:
            return self.text(node.value["refused"])
        raise self.problem(
            node,
            f"{node.shown():.60}: expected refused, {{refused: REASON}}, or no expect where the sensor is to obey",
        )

    def _check(self, node: _Node, number: str) -> CheckNow:
        if not isinstance(node.value, dict) or not node.value:
            raise self.problem(node, "expected a table of items, such as {supply_v: [4.8, 5.2]}")
        rest = {name: below for name, below in node.value.items() if name != "at_most"}
        shares = {name: below for name, below in rest.items() if isinstance(below.value, dict)}
        items = {name: below for name, below in rest.items() if name not in shares}
        return CheckNow(
            self.conditions(_Node(items, node.line, node.column)) if items else {},
            tuple(self._share(name, below) for name, below in shares.items()),
            self._at_most(node.value, CHECK_S),
        )

    def _share(self, name: str, node: _Node) -> ShareOf:
        found = self.table(node, ("share", "at_most"), ("share", "at_most"))
        share = self.number(found["share"])
        if not 0 < share < 1:
            raise self.problem(
                found["share"], f"share {share:g} does not work: expected above 0 and below 1, such as 0.95"
            )
        limit = found["at_most"]
        return ShareOf(name, share, self.duration(limit) if isinstance(limit.value, str) else self.number(limit))

    def _watch(self, node: _Node, number: str) -> Watch:
        found = self.table(node, ("for", "limits", "requirements", "frames", "exposure"), ("for",))
        limits = {name: below.value for name, below in self._mapping(found.get("limits")).items()}
        names = list(Limits.__dataclass_fields__)
        for name, below in self._mapping(found.get("limits")).items():
            if name not in names:
                raise self.problem(below, f"unknown limit {name}; {near_words(name, names)}")
            try:
                TypeAdapter(Limits).validate_python({name: below.value})
            except ValidationError as error:
                raise self.problem(
                    below, f"{name} is {below.shown():.40}: {error.errors()[0]['msg'].lower()}"
                ) from None
        requirements = {name: below.shown() for name, below in self._mapping(found.get("requirements")).items()}
        frames = self.whole(found["frames"], 1, _MOST_FRAMES) if "frames" in found else None
        exposure_s = self.duration(found["exposure"]) if "exposure" in found else None
        return Watch(self.duration(found["for"]), limits, requirements, frames, exposure_s)

    def _mapping(self, node: _Node | None) -> dict[str, _Node]:
        if node is None:
            return {}
        if not isinstance(node.value, dict):
            raise self.problem(node, "expected a mapping of names and values")
        return dict(node.value)

    def _repeat(self, node: _Node, number: str) -> Repeat:
        found = self.table(node, ("times", "steps"), ("times", "steps"))
        times = self.whole(found["times"], 1, MOST_RUNS)
        return Repeat(times, self.steps(found["steps"], f"{number}.", self.kinds))

    def _at_most(self, found: Mapping[str, _Node], default_s: float) -> float:
        return self.duration(found["at_most"]) if "at_most" in found else default_s


_PARTS = re.compile(
    r"(?:(\d+(?:\.\d*)?) ?h)? ?(?:(\d+(?:\.\d*)?) ?(?:min|m))? ?(?:(\d+(?:\.\d*)?) ?s)? ?(?:(\d+(?:\.\d*)?) ?ms)?"
)


def seconds_of(text: str) -> float:
    """The seconds of a time such as 10s, 200 ms, 10 min or 1h30m; ValueError says what was expected."""
    found = _PARTS.fullmatch(text.strip())
    hours, minutes, seconds, thousandths = found.groups() if found else (None,) * 4
    total_s = 3600 * float(hours or 0) + 60 * float(minutes or 0) + float(seconds or 0) + float(thousandths or 0) / 1000
    if not 0 < total_s <= _LONGEST_S:
        raise ValueError(
            f"{text!r:.40} is not a time; expected one with its unit, such as 10s, 200 ms, 10 min or 1h30m"
        )
    return total_s


def near_words(name: str, known: Sequence[str]) -> str:
    """The known name that is meant, or all of them."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"


def read_procedure(path: Path) -> Procedure:
    """The procedure of a file; ConfigError with file, line and column where it is none."""
    try:
        with open(path, encoding="utf-8", opener=a_file_or_a_shells_pipe) as file:
            text = file.read(MAX_FILE_BYTES + 1)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(
            f"cannot read the procedure file {path}: {reason}; 'gse procedure init' writes one to start from"
        ) from error
    return parse_procedure(text, str(path), folder=path.parent)


def parse_procedure(text: str, source: str = "procedure", *, folder: Path = Path()) -> Procedure:
    """The procedure of a YAML text; ``folder`` is where a relative path of its station file begins."""
    if len(text) > MAX_FILE_BYTES:
        raise ConfigError(f"{source} is larger than {MAX_FILE_BYTES} characters: this is not a procedure")
    try:
        node, document = load_document(text)
    except yaml.YAMLError as error:
        raise ConfigError(yaml_problem(error, source)) from error
    keys = ("version", "name", "station", "steps", "cleanup")
    if node is None or not isinstance(document, dict):
        raise ConfigError(f"{source}: expected a mapping with the keys {', '.join(keys)}")
    read = _Reader(source)
    found = read.table(read.located(node, document), keys, ("version", "name", "steps"))
    if found["version"].value != 1:
        raise read.problem(found["version"], f"version {found['version'].shown():.20}: this gse reads version 1")
    procedure = Procedure(
        read.text(found["name"]),
        folder / read.text(found["station"]) if "station" in found else None,
        read.steps(found["steps"], "", read.kinds),
        read.steps(found["cleanup"], "cleanup ", read.in_cleanup) if "cleanup" in found else (),
        source,
        text,
    )
    if (runs := runs_of(procedure.steps)) > MOST_RUNS:
        raise read.problem(
            found["steps"], f"the run has {count_text(runs, 'step')}, each round counted; expected at most {MOST_RUNS}"
        )
    return procedure


def runs_of(steps: Sequence[Step]) -> int:
    """How many steps a run has, each round of a repeat counted."""
    return sum(1 + (step.act.times * runs_of(step.act.steps) if isinstance(step.act, Repeat) else 0) for step in steps)


def duration_s(steps: Sequence[Step], protocol: Protocol, settle_s: float = 0.0) -> tuple[float, float]:
    """The least and the longest time of steps without the operator's, where each one ends well."""
    least = longest = 0.0
    for step in steps:
        low, high = _duration_s(step.act, protocol, settle_s)
        least, longest = least + low, longest + high
    return least, longest


def _duration_s(act: Act, protocol: Protocol, settle_s: float) -> tuple[float, float]:
    match act:
        case Watch(for_s=for_s, frames=int()):
            return 0.0, for_s
        case Wait(for_s=float(for_s)) | Watch(for_s=for_s):
            return for_s, for_s
        case Wait() | CheckNow():
            return 0.0, act.at_most_s
        case Send():
            layout = protocol.commands.get(act.command)
            if layout is None or (layout.answer == NO_ANSWER and act.refused is None):
                return 0.0, 0.0  # no answer is awaited
            return 0.0, act.at_most_s or layout.timeout_s
        case SwitchPower(on=True):
            return settle_s, settle_s
        case Repeat():
            low, high = duration_s(act.steps, protocol, settle_s)
            return act.times * low, act.times * high
        case _:
            return 0.0, 0.0


# What a procedure may name, and whether it does.

_STATES = ("acquired", "searching", "silent")
_LINKS = ("streaming", "syncing", "waiting", "silent", "no port")


def _words(name: str, words: Sequence[str]) -> Item:
    return Item(name, "", name, "", dict(enumerate(words)), False, 1.0)


STATION_ITEMS = {
    "state": _words("state", _STATES),
    "link": _words("link", _LINKS),
    "sky": _words("sky", [*SKY_WORDS.values()]),
    "stars": Item("stars", "", "stars", "", {}, False, 1.0),
    "exposure_s": Item("exposure_s", "", "exposure_s", "s", {}, False, 1e-6),
    "power_v": Item("power_v", "", "power_v", "V", {}, False, 1e-3),
    "power_a": Item("power_a", "", "power_a", "A", {}, False, 1e-3),
}
"""What the station itself knows; an item of the sensor that has the same name takes its place."""


def items_of(protocol: Protocol) -> dict[str, Item]:
    """Every item that a condition may name; a sensor that sends its state has words of its own beside ours."""
    items = {**STATION_ITEMS, **protocol.items}
    return items | {"state": _words("state", list(dict.fromkeys([*items["state"].words.values(), *_STATES])))}


def check(procedure: Procedure, station: Station, protocol: Protocol) -> list[str]:
    """Every word of the steps that station or description do not know, with its place; empty where all is known."""
    return [
        f"{procedure.source}, line {line}, column {column}: step {step.number}: {plain_line(text)}"
        for step, (line, column), text in _problems(procedure, station, protocol)
    ]


def _problems(procedure: Procedure, station: Station, protocol: Protocol) -> Iterator[tuple[Step, Place, str]]:
    measured: list[str] = []
    for step in procedure.all_steps():
        here, act = (step.line, step.column), step.act
        match act:
            case SwitchPower() if station.power is None and not station.port.url.startswith("sim://"):
                yield step, here, "the station file has no power: {on: [program], off: [program]}"
            case Wait():
                yield from _of_conditions(step, act.until, protocol)
                yield from _of_command(step, Send(act.poll), protocol) if act.poll else ()
                measured += [act.measure] if act.measure else []
            case Send():
                yield from _of_command(step, act, protocol)
            case CheckNow():
                yield from _of_conditions(step, act.items, protocol)
                for share in act.shares:
                    if share.name not in measured:
                        near = near_words(share.name, measured) if measured else "a wait with measure: names it"
                        words = f"nothing is measured as {share.name} before; {near}"
                        yield step, step.places.get(share.name, here), words
            case Watch():
                try:
                    dataclasses.replace(station.limits, **act.limits)
                except (TypeError, ValueError) as error:
                    yield step, here, str(error)


def _of_conditions(step: Step, wanted: Conditions, protocol: Protocol) -> Iterator[tuple[Step, Place, str]]:
    for name, one in wanted.items():
        try:
            Condition({name: one}, items_of(protocol))
        except ValueError as error:
            yield step, step.places.get(name, (step.line, step.column)), str(error)


def _of_command(step: Step, act: Send, protocol: Protocol) -> Iterator[tuple[Step, Place, str]]:
    layout = protocol.commands.get(act.command)
    if layout is None:
        place = step.places.get("command", (step.line, step.column))
        yield step, place, unknown_name(act.command, protocol.commands, "command")
        return
    if act.refused is not None:
        place = step.places.get("expect", (step.line, step.column))
        if "NAK" not in protocol.types:
            words = (
                f"{protocol.name} has no message NAK, with which a sensor refuses; check an item that counts refusals"
            )
            yield step, place, words
        elif act.refused and protocol.reasons and act.refused not in protocol.reasons:
            yield step, place, unknown_name(act.refused, dict.fromkeys(protocol.reasons), "reason")
    try:
        protocol.encode((layout if act.refused is None else layout.free).made(**act.arguments), 0)
    except EncodeError as error:
        named = next((name for name in act.arguments if name in str(error)), "command")
        words = str(error)
        if taken := [one.name for one in layout.arguments if one.name in _OF_SEND and one.name not in act.arguments]:
            words += f"; {taken[0]} is a word of the step: write arguments: {{{taken[0]}: ..}}"
        yield step, step.places.get(named, (step.line, step.column)), words
