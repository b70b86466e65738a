"""Faults in runs of procedures: right outcome, cleanup done, session whole, replay equal to the byte.

    python benchmarks/procedure_faults.py            all, a line for each
    python benchmarks/procedure_faults.py --sim      those on the simulated sensor alone

Each run has one fault. The cleanup is always power: off; what it left is read from the session and, on the
emulated sensor, from the file that its supply is.
"""

import argparse
import contextlib
import io
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from devices.emulated_sensor import STATION, EmulatedSensor  # noqa: E402

from drivers.session_file.reader import verify  # noqa: E402
from gse.cli import main  # noqa: E402

HEAD = "version: 1\nname: faults\nstation: station.yaml\nsteps:\n"
CLEANUP = "cleanup:\n  - power: off\n"
WAITS_S = 120.0


@dataclass(frozen=True)
class Fault:
    """One run: its steps, what spoils it, and which outcomes its step may have."""

    name: str
    steps: str
    expected: tuple[str, ...]
    number: str = "1"
    url: str = "sim://"
    scenario: str = ""
    answers: dict[str, str] = field(default_factory=dict)
    power: dict[str, str] = field(default_factory=dict)
    spoil: str = ""


COMMANDS = {
    "PING": "  - send: PING\n",
    "SET_EXPOSURE": "  - send: {command: SET_EXPOSURE, exposure: 80 ms}\n",
    "START": "  - send: {command: START, period: 200 ms}\n",
    "STOP": "  - send: STOP\n",
    "REQUEST": "  - send: REQUEST\n",
}
KINDS = {
    "pause": "  - wait: {for: 60s}\n",
    "wait": "  - wait: {until: {sky: daylight}, at_most: 60s}\n",
    "send": "  - wait: {for: 30s}\n  - send: PING\n",
    "check": "  - check: {power_v: 5, at_most: 60s}\n",
    "watch": "  - watch: {for: 60s}\n",
    "repeat": "  - repeat: {times: 9, steps: [wait: {for: 9s}]}\n",
}
UNTIL = ("state: silent", "mode: standby", "sky: daylight", "stars: [99, null]", "link: no port")
CHECKS = ("supply_v: [5.5, 6]", "temperature_degc: [90, 99]", "mode: standby", "commands_bad: 7", "serial: 3")
LINE = ("flip:1e-4", "drop:1e-4", "double:1e-4", "noise:1e-4", "split:0.1")


def faults() -> Iterator[Fault]:
    """All faults on the simulated sensor."""
    for command, steps in COMMANDS.items():
        for fault in ("nak", "late", "wrong", "silent"):
            scenario = f"firmware: {{commands: {{{command}: {{fault: {fault}}}}}}}\n"
            yield Fault(f"{command} {fault}", steps, ("FAIL",), scenario=scenario)
    for kind, steps in KINDS.items():
        yield Fault(f"data end in {kind}", steps, ("not done",), url="sim://?frames=60")
        outcomes = ("not done", "INCONCLUSIVE", "FAIL", *(["PASS"] if kind in ("pause", "repeat") else []))
        yield Fault(f"port lost in {kind}", steps, outcomes, url="sim://?faults=disconnect:8s/600s")
    for until in UNTIL:
        yield Fault(f"never {until}", f"  - wait: {{until: {{{until}}}, at_most: 4s}}\n", ("FAIL",))
    for item in CHECKS:
        yield Fault(f"not {item}", f"  - check: {{{item}}}\n", ("FAIL",))
    for line in LINE:
        yield Fault(f"line {line}", KINDS["pause"], ("PASS",), url=f"sim://?faults={line}")
    yield Fault("reset in a step", KINDS["pause"], ("PASS",), url="sim://?faults=reset:8s")
    tell, ask = "  - tell: Take the cap off.\n", '  - ask: {label: serial, text: Serial, expect: "SN [0-9]+"}\n'
    yield Fault("nobody confirms", tell, ("not done",))
    yield Fault("nobody answers", ask, ("not done",))
    yield Fault("the operator says no", tell, ("not done",), answers={"1": "no"})
    yield Fault("another answer", ask, ("FAIL",), answers={"serial": "twelve"})
    yield Fault("no answer without power", "  - power: off\n  - send: PING\n", ("FAIL",), number="2")


def live_faults() -> Iterator[Fault]:
    """All faults on the emulated sensor, whose supply a program switches."""
    for kind, steps in KINDS.items():
        if kind != "check":  # here each item has come
            yield Fault(f"Ctrl-C in {kind}", steps, ("not done",), spoil="SIGINT")
    for word in ("hang", "fail"):
        yield Fault(f"power on: {word}", "  - power: on\n", ("not done",), power={"on": word})
    lies = "  - power: off\n  - wait: {until: {state: silent}, at_most: 4s}\n"
    yield Fault("power off: lie", lies, ("FAIL",), number="2", power={"off": "lie"})
    yield Fault("port lost in wait", KINDS["wait"], ("not done",), spoil="unplug")
    yield Fault("SIGTERM in watch", KINDS["watch"], ("not done",), spoil="SIGTERM")


def run_simulated(fault: Fault, folder: Path) -> int:
    """Run the procedure of a fault in this process; its exit code."""
    url = fault.url
    if fault.scenario:
        (folder / "scenario.yaml").write_text(f"text: one fault\n{fault.scenario}")
        url = f"sim://?scenario={folder}/scenario.yaml"
    (folder / "station.yaml").write_text(f"{STATION}port: {{url: '{url}'}}\n")
    return gse(*command(fault, folder))


def command(fault: Fault, folder: Path) -> list[str]:
    """The command line of a run."""
    (folder / "test.yaml").write_text(HEAD + fault.steps + CLEANUP)
    (folder / "answers.yaml").write_text(json.dumps(fault.answers))
    words = ["procedure", "run", str(folder / "test.yaml"), "--out", str(folder / "out"), "--no-plots"]
    return [*words, "--answers", str(folder / "answers.yaml")]


def gse(*words: str) -> int:
    """Run a command in this process; its exit code."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            main(list(words))
        except SystemExit as ended:
            return int(ended.code or 0)
    return 0


def run_live(fault: Fault, folder: Path) -> bool:
    """Run the procedure of a fault on an emulated sensor; whether its supply is as it should be then."""
    with EmulatedSensor(folder, **fault.power) as sensor:
        process = subprocess.Popen(
            [sys.executable, "-m", "gse", *command(fault, folder)], stderr=subprocess.PIPE, text=True
        )
        assert process.stderr is not None
        if fault.spoil:
            await_begin(folder / "out")
            if fault.spoil == "unplug":
                sensor.unplug()
            else:
                process.send_signal(signal.Signals[fault.spoil])
        process.communicate(timeout=WAITS_S)
        return sensor.supply.read_text() == ("on" if fault.power.get("off") else "off")


def await_begin(out: Path) -> None:
    """Wait until the first step has begun."""
    until_s = time.monotonic() + WAITS_S
    while time.monotonic() < until_s:
        if any(b"STEP_BEGUN" in path.read_bytes() for path in out.glob("*/session.mcap")):
            time.sleep(1.0)
            return
        time.sleep(0.2)


def problems(fault: Fault, folder: Path) -> list[str]:
    """What is wrong with a run; nothing where all is right."""
    (session,) = (folder / "out").iterdir()
    report: dict[str, Any] = json.loads((session / "report.json").read_text())
    steps = {step["number"]: step for step in report["procedure"]["steps"]}
    found = []
    if steps[fault.number]["outcome"] not in fault.expected:
        found.append(f"step {fault.number} is {steps[fault.number]['outcome']}: {steps[fault.number]['seen']}")
    if steps["cleanup 1"]["outcome"] != "PASS":
        found.append(f"cleanup {steps['cleanup 1']['outcome']}: {steps['cleanup 1']['seen']}")
    if not verify(session / "session.mcap").is_whole:
        found.append("the session is not whole")
    gse("replay", str(session), "--out", str(folder / "again"), "--no-plots")
    (again,) = (folder / "again").iterdir()
    if (again / "report.json").read_bytes() != (session / "report.json").read_bytes():
        found.append("the replay differs")
    return found


def bench(*, simulated_only: bool) -> int:
    """Run all; the number of runs that were not right."""
    wrong = count = 0
    runs = [(fault, False) for fault in faults()] + ([] if simulated_only else [(one, True) for one in live_faults()])
    for fault, is_live in runs:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            found = []
            try:
                if not is_live:
                    run_simulated(fault, folder)
                elif not run_live(fault, folder):
                    found.append("the supply was left on")
                found += problems(fault, folder)
            except (OSError, ValueError, KeyError, subprocess.TimeoutExpired) as error:
                found.append(f"{type(error).__name__}: {error}")
        count += 1
        wrong += bool(found)
        print(f"{fault.name:32} {'; '.join(found) or 'right'}", flush=True)
    print(f"{count - wrong} of {count} right")
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sim", action="store_true", help="Only those on the simulated sensor.")
    sys.exit(bool(bench(simulated_only=parser.parse_args().sim)))
