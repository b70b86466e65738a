"""Every end of a session: each signal in each state, and each way in which nobody reads.

    python benchmarks/endings.py [readers] [signals] [stopped]

Real processes: ``gse run`` with a terminal of its own as its controlling one, ``gse emulate`` as the sensor under a sky
where it is night now. Ctrl-C and Ctrl-\\ are typed, a hang-up is the terminal's end, the disk that is closed on is full
until the signal has come. What is compared is the exit code with the verdict of the report: the verdict itself follows
from the length of the session, which a machine that compiles or computes beside it prolongs (a minute of 20 Hz is PASS,
some seconds are INCONCLUSIVE). Prints markdown; some 10 minutes. Root is needed to mount the small disk.
"""

import contextlib
import fcntl
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from drivers.session_file.reader import read_capture, verify
from drivers.session_file.records import EVENTS, RecordedMessage
from gse.config.station import BUILT_IN_TEXT

GSE = [sys.executable, "-m", "gse"]
RATE_HZ = 20
RUN_S = 4.0
AGAIN_S = 1.5
STOPPED_S = (2, 10, 60)
STEADY_S = 15.0
"""Of streaming before and after a stop."""
CODES = {"PASS": 0, "FAIL": 1, "INCONCLUSIVE": 5}
PATIENCE_S = 180.0
HANG_UP = b"hang up"
STATES = ("starting", "preparing", "waiting for the port", "running", "closing", "reporting")
SIGNALS = ("HUP", "INT", "INT twice at once", "INT, and again after 1.5 s", "QUIT", "TERM", "KILL")
MARKS = {
    "preparing": "recording: ",
    "waiting for the port": "waiting for the port",
    "running": "STREAMING",
    "closing": "closing ",
    "reporting": "judging and reporting",
}
Row = tuple[str, str, str]


class Session:
    """A ``gse run`` with a controlling terminal, whose keys are pressed and whose words are read here."""

    def __init__(
        self, out: Path, *options: str, output: int | None = None, before: Callable[[], object] = tuple
    ) -> None:
        self.out, self.words = out, ""
        self.master, slave = os.openpty()

        def own_terminal() -> None:
            os.setsid()
            fcntl.ioctl(slave, termios.TIOCSCTTY, 0)
            for number in (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT):
                signal.signal(number, signal.SIG_DFL)  # this script may run under nohup, or in the background
            before()

        command = [*GSE, "run", "--out", str(out), "--clock-error", "1ms", *options]
        there = slave if output is None else output
        self.process = subprocess.Popen(command, stdin=slave, stdout=there, stderr=there, preexec_fn=own_terminal)
        os.close(slave)
        self._reads = True
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while self._reads:
            if select.select([self.master], [], [], 0.05)[0]:
                try:
                    self.words += os.read(self.master, 4096).decode("utf-8", "replace")
                except OSError:
                    return

    def hang_up(self) -> None:
        """Close the terminal, which takes effect only where no thread reads it."""
        self._reads = False
        self._reader.join()
        os.close(self.master)

    def await_words(self, words: str) -> None:
        """Wait until it has said something."""
        until_s = time.monotonic() + PATIENCE_S
        while words not in self.words:
            if self.process.poll() is not None or time.monotonic() > until_s:
                raise RuntimeError(f"expected {words!r}, but it said:\n{self.words[-2000:]}")
            time.sleep(0.005)

    def send(self, what: str) -> None:
        """One of SIGNALS, as a person, a terminal or the system sends it."""
        if what == "HUP":
            self.hang_up()
        elif what in ("TERM", "KILL"):
            self.process.send_signal(signal.SIGTERM if what == "TERM" else signal.SIGKILL)
        else:
            self.press(b"\x1c" if what == "QUIT" else b"\x03")
        if "again" in what:
            time.sleep(AGAIN_S)
        if "INT," in what or "twice" in what:
            if "twice" in what:
                time.sleep(0.1)  # one that is pending takes the other one in
            self.press(b"\x03")

    def press(self, key: bytes) -> None:
        """A key; where the terminal is gone, nothing."""
        os.write(self.master, key)

    def end(self) -> int:
        """Wait for its end; the exit code."""
        return self.process.wait(PATIENCE_S)

    def left(self) -> str:
        """What it left, in words: exit code, session file, report; where there is none, what gse report says."""
        code = self.end()
        folders = list(self.out.glob("*/session.mcap"))
        if not folders:
            return f"exit {code}; nothing was received, nothing is left"
        folder = folders[0].parent
        closed = "closed" if verify(folder / "session.mcap").is_whole else "not closed"
        if (folder / "report.json").exists():
            return f"{_word(code, folder / 'report.json')}; {closed}, judged, reported"
        report = subprocess.run([*GSE, "report", str(folder)], capture_output=True, text=True)
        return f"exit {code}; {closed}; `gse report`: {report.stderr.splitlines()[-1].removeprefix('exit code ')}"


def _word(code: int, report: Path) -> str:
    """The exit code beside the verdict that it must follow from; why, where that is FAIL."""
    document = json.loads(report.read_text(encoding="utf-8"))
    verdict, frames = document["verdict"], document["identification"]["frames"]
    if code != CODES[verdict]:
        return f"exit {code}, BUT {verdict}"
    why = f" ({'; '.join(document['reasons'][:2])})" if verdict == "FAIL" else ""
    return f"exit {code} as {verdict}{why} of {frames} frames"


def night_station(folder: Path) -> Path:
    """The built-in station, carried to where it is midnight."""
    now = datetime.now(UTC)
    longitude_deg = -15.0 * (now.hour + now.minute / 60) % 360.0
    lines = [
        f"  longitude_deg: {longitude_deg:.3f}" if line.strip().startswith("longitude_deg") else line
        for line in BUILT_IN_TEXT.splitlines()
    ]
    path = folder / "station.yaml"
    path.write_text("\n".join(lines) + "\nlimits: {identification_ms: 60000}\n")
    return path


@contextmanager
def emulator(station: Path) -> Iterator[str]:
    """A sensor under that sky; the name of its port."""
    command = [*GSE, "emulate", "--pty", "--station", str(station), "--rate-hz", str(RATE_HZ)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait()


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """A disk of its own of 64 MB."""
    disk = folder / "disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(disk)], check=True)
    try:
        yield disk
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


def fill(disk: Path) -> Path:
    """A file that takes all that is left of a disk."""
    path = disk / "filler"
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            return path


def cell(state: str, what: str, station: Path, port: str, disk: Path, number: int) -> str:
    """One signal in one state: what comes out."""
    out = disk / str(number)
    options = ["--station", str(station), "--port", port]
    if state == "waiting for the port":
        options[-1] = str(disk / "absent")
        options.append("--wait-port")
    if state in ("closing", "reporting"):
        options += ["--duration", str(RUN_S)]
    session = Session(out, *options)
    if state == "starting":
        time.sleep(1.0)
        session.send(what)
        return session.left()
    filler = None
    if state == "closing":
        session.await_words("STREAMING")
        time.sleep(RUN_S / 2)
        filler = fill(disk)
    session.await_words(MARKS[state])
    if state == "running":
        time.sleep(RUN_S)
    session.send(what)
    if filler is not None:
        time.sleep(0.5)
        filler.unlink()
    return session.left()


def signals(folder: Path) -> list[Row]:
    """Every signal in every state."""
    station = night_station(folder)
    rows: list[Row] = []
    with emulator(station) as port, small_disk(folder) as disk:
        cell("running", "TERM", station, port, folder, 0)  # what is compiled and computed once prolongs no other
        for state in STATES:
            for what in SIGNALS:
                value = cell(state, what, station, port, disk, len(rows))
                rows.append((f"{what}, {state}", value, "exit as the verdict; reported, or by gse report"))
                print(f"{state}: {what}: {value}", file=sys.stderr, flush=True)
    return rows


def stopped(folder: Path) -> list[Row]:
    """The process is stopped for a while and goes on: what its port could not hold is no fault of the sensor."""
    station = night_station(folder)
    rows: list[Row] = []
    with emulator(station) as port:
        for seconds in STOPPED_S:
            session = Session(folder / str(seconds), "--station", str(station), "--port", port)
            session.await_words("STREAMING")
            time.sleep(STEADY_S)
            session.process.send_signal(signal.SIGSTOP)
            time.sleep(seconds)
            session.process.send_signal(signal.SIGCONT)
            time.sleep(STEADY_S)
            session.send("INT")
            value = session.left()
            (path,) = session.out.glob("*/session.mcap")
            told = "NOT_RUN" if "NOT_RUN" in _event_kinds(path) else "no event"
            rows.append((f"stopped for {seconds} s", f"{value}; {told}", "the event; not FAIL"))
    return rows


def readers(folder: Path) -> list[Row]:
    """Each way in which nobody reads: the session goes on to its verdict."""
    station = night_station(folder)
    rows: list[Row] = []
    with emulator(station) as port, small_disk(folder) as disk:
        fill(disk)
        for number, (what, output, before, key) in enumerate(_ways(disk)):
            options = ("--station", str(station), "--port", port, "--duration", str(RUN_S + 8))
            started_s = time.monotonic()
            session = Session(folder / str(number), *options, output=output, before=before)
            if key:
                session.await_words("STREAMING")
                session.press(key) if key != HANG_UP else session.hang_up()
            value = session.left()
            (path,) = session.out.glob("*/session.mcap")
            noted = sorted(kind for kind in _event_kinds(path) if kind.startswith("TERMINAL"))
            seconds = time.monotonic() - started_s
            rows.append((what, f"{value}; {', '.join(noted) or 'no event'}; {seconds:.0f} s", "a verdict, an event"))
            print(*rows[-1], sep=": ", file=sys.stderr, flush=True)
    return rows


def _ways(disk: Path) -> list[tuple[str, int | None, Callable[[], object], bytes]]:
    """Name, where output goes, what is done in the new process, and what its terminal then does."""
    dead_reader, dead = os.pipe()
    os.close(dead_reader)
    stuck = os.pipe()[1]
    os.set_blocking(stuck, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(stuck, bytes(4096))
    os.set_blocking(stuck, True)
    on_full_disk = os.open(disk / "log", os.O_WRONLY | os.O_CREAT)
    return [
        ("output to a reader that died", dead, tuple, b""),
        ("output to a reader that never reads", stuck, tuple, b""),
        ("output to a full disk", on_full_disk, tuple, b""),
        ("output to /dev/full", os.open("/dev/full", os.O_WRONLY), tuple, b""),
        ("output closed", None, lambda: os.closerange(1, 3), b""),
        ("Ctrl-S on the terminal", None, tuple, b"\x13"),
        ("terminal gone, its hang-up ignored", None, lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN), HANG_UP),
    ]


def _event_kinds(path: Path) -> set[str]:
    records = read_capture(path)
    return {record.event().kind for record in records if isinstance(record, RecordedMessage) and record.topic == EVENTS}


def markdown(rows: list[Row]) -> str:
    """The signals as a table of states, the others as a list."""
    by_name = {name: value for name, value, _ in rows}
    if f"{SIGNALS[0]}, {STATES[0]}" not in by_name:
        return "\n".join(
            ["| what happens | what comes out |", "|---|---|", *(f"| {n} | {v} |" for n, v in by_name.items())]
        )
    lines = [f"| | {' | '.join(SIGNALS)} |", "|---" * (len(SIGNALS) + 1) + "|"]
    lines += [f"| {s} | {' | '.join(by_name[f'{what}, {s}'] for what in SIGNALS)} |" for s in STATES]
    return "\n".join(lines)


if __name__ == "__main__":
    parts = {"readers": readers, "signals": signals, "stopped": stopped}
    for part in sys.argv[1:] or parts:
        with tempfile.TemporaryDirectory() as temporary:
            print(markdown(parts[part](Path(temporary))), flush=True)
