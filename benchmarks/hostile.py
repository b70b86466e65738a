"""What a hostile sensor, browser, session folder or clock can bring about: rows of ``faults.py``."""

import contextlib
import http.client
import itertools
import json
import os
import random
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import CommandError
from drivers.host_files import write_whole
from drivers.outside_text import is_plain
from drivers.session_file.reader import segment_files, verify
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.recording.recorder import Recorder
from gse.sessions.commanding import command_sensor
from gse.sessions.status_file import process_mark
from gse.station.events import Notes, StationKind
from gse.station.reception import Reception
from gse.station.results import Verdict
from gse.values.panorama import Panorama
from gse.verdict.assessment import judge
from gse.view.server import MOST_CONNECTIONS, Content, ViewServer
from gse.view.viewer import ViewerFiles
from protocols import Ack, Command, Frame, FrameDecoder, PanoramaMessage, load_protocol

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from devices import float_protocol, own_network
from devices.injected_clocks import MISBEHAVIOURS, Sky, wrong_objects
from devices.terminal import Terminal

PROTOCOL = load_protocol("panorama-v1")
GSE = [sys.executable, "-m", "gse"]
Row = tuple[str, str, str]


def words(folder: Path) -> list[Row]:
    """Wrong stars, or none, while a clock or counter misbehaves: nothing may hide them."""
    sky = Sky()
    wrong, empty = wrong_objects(sky), [np.empty((0, 2))] * len(sky.frames)
    passed = Counter[str]()
    for clocks in MISBEHAVIOURS.values():
        for name, objects in (("wrong", wrong), ("no", empty)):
            session = sky.session(clocks, blind_s=(0.0, 14.0), blind_px=objects)
            passed[name] += judge(session).verdict is Verdict.PASS
    count = len(MISBEHAVIOURS)
    return [
        (f"{count} clocks and counters, {name} stars for 14 of 80 s: PASS", str(passed[name]), "0")
        for name in ("wrong", "no")
    ]


def commands(folder: Path) -> list[Row]:
    """Answers to other commands, and sequence numbers without sense."""
    others: dict[str, Callable[[int], bytes]] = {
        "another type": lambda sequence: _ack("STOP", sequence),
        "another sequence number": lambda sequence: _ack("START", sequence + 1000),
        "before it": lambda sequence: b"",
    }
    rows = []
    for name, answer in others.items():
        taken = sum(_is_taken(folder / f"{name}{number}", answer, early=name == "before it") for number in range(5))
        rows.append((f"5 commands answered by an ACK of {name}: taken for an answer", str(taken), "0"))
    return [*rows, *_chaos()]


def _ack(command: str, sequence: int) -> bytes:
    return PROTOCOL.encode(Ack(command=command, sequence=sequence), 7)


def _is_taken(folder: Path, answer: Callable[[int], bytes], *, early: bool) -> bool:
    folder.mkdir()
    terminal = Terminal(folder / "tty")
    if early:
        terminal.write(_ack("START", 0))
    stop = threading.Event()
    thread = threading.Thread(target=_answer_all, args=(terminal, answer, stop))
    thread.start()
    text = BUILT_IN_TEXT.replace("sim://", str(terminal.path))
    try:
        command_sensor(parse_station(text), text, Command("START", {"period": 100}), folder / "out")
    except CommandError:
        return False
    else:
        return True
    finally:
        stop.set()
        thread.join()
        terminal.unplug()


def _answer_all(terminal: Terminal, answer: Callable[[int], bytes], stop: threading.Event) -> None:
    decoder = FrameDecoder(PROTOCOL)
    os.set_blocking(terminal.master, False)
    while not stop.wait(0.01):
        with contextlib.suppress(BlockingIOError):
            for item in decoder.feed(terminal.read(100)):
                if isinstance(item, Frame):
                    terminal.write(answer(item.sequence))


def _panorama(number: int, *objects: tuple[float, float, float]) -> PanoramaMessage:
    """A panorama of objects, each a column, a row and an index."""
    columns = np.array(objects or [(10.0, 20.0, 400.0)])
    return PanoramaMessage(
        time_us=100_000 * number,
        frame_no=number,
        exposure_s=0.05,
        flags=frozenset(),
        temperature_c=20.0,
        xy_px=columns[:, :2],
        index=columns[:, 2],
    )


def hopeless(folder: Path) -> list[Row]:
    """Valid panoramas without any star, which both identifiers search to the end."""
    rng, rows = np.random.default_rng(5), []
    for objects in (30, 12):
        cpu_s = []
        for frames in (20, 220):
            found = rng.integers((0, 0, 100), (1024, 1024, 4000), (frames, objects, 3)).astype(float)
            data = b"".join(PROTOCOL.encode(_panorama(k, *found[k]), k) for k in range(frames))
            raw = folder / f"{objects}-{frames}.raw"
            raw.write_bytes(data)
            before = os.times()
            command = ["replay", str(raw), "--start-utc", "2026-03-20T18:30:00Z", "--out", str(raw) + ".out"]
            subprocess.run([*GSE, *command], check=False, capture_output=True, cwd=folder)
            after = os.times()
            cpu_s.append(sum(after[2:4]) - sum(before[2:4]))
        each_s = (cpu_s[1] - cpu_s[0]) / 200
        value = f"{1000 * each_s:.1f} ms a panorama, {each_s * 1e6 * frames / len(data):.0f} s per MB"
        rows.append((f"panoramas of {objects} random objects, CPU of a replay", value, "10 s per MB"))
    return rows


def _chaos() -> list[Row]:
    rng = random.Random(1)
    worst, silent = 0, 0
    for _ in range(100):
        reception = Reception(PROTOCOL, baudrate=115200)
        kinds = Counter[str]()
        for number in range(200):
            data = PROTOCOL.encode(_panorama(number), rng.randrange(65536))
            items = reception.receive(reception.stream.feed(Chunk(10**18 + number * 10**8, number * 10**8, data)))
            kinds.update(item.kind for item in items if isinstance(item, LinkEvent))
        worst = max(worst, reception.counters.frames_lost)
        silent += not kinds[StationKind.SEQUENCE_CHAOS]
    return [
        ("100 x 200 frames with random numbers: most counted as lost", str(worst), "<= 208: 20 s at 10 Hz and 8"),
        ("of these streams, without a SEQUENCE_CHAOS", str(silent), "0"),
    ]


def web(folder: Path) -> list[Row]:
    """Hosts, origins and connections of an attacker at the live page."""
    notes = Notes()
    with ViewServer("127.0.0.1", 0, Content(notes=notes)) as page:
        own = f"127.0.0.1:{page.port}"
        hosts = [
            "",
            "evil.example",
            f"evil.example:{page.port}",
            f"{own}.evil.example",
            f"{own}@evil.example",
            f"{own} x",
        ]
        answered = [_asked(page.port, "GET", "/", {"Host": host}) for host in hosts]
        refused = sum(status in (400, 421) for status, _ in answered)
        echoed = sum("evil" in text for _, text in answered)
        foreign = [
            {"Host": own, "Origin": "http://evil.example", "Content-Type": "application/json"},
            {"Host": own, "Origin": "null", "Content-Type": "application/json"},
            {"Host": own, "Content-Type": "text/plain"},
            {"Host": f"evil.example:{page.port}", "Content-Type": "application/json"},
        ]
        for headers in foreign:
            _asked(page.port, "POST", "/note", headers, b'{"text": "forged"}')
        for body in (b"x" * 10**6, b"[" * 4000, b'{"text": 5}', json.dumps({"text": "x" * 281}).encode()):
            _asked(page.port, "POST", "/note", {"Host": own, "Content-Type": "application/json"}, body)
        taken = len(notes.take())
        crowd = _crowd(page.port, 1000)
        served_s = _served_again_s(page.port, own, crowd)
    return [
        ("hosts that are not this server's: refused, in an answer", f"{refused} of {len(hosts)}, {echoed}", "all, 0"),
        ("forged, huge or broken notes: taken", str(taken), "0"),
        ("1,000 connections that send half a request: served after they end", f"{served_s:.1f} s", "<= 5 s"),
    ]


def _asked(port: int, method: str, path: str, headers: dict[str, str], body: bytes = b"") -> tuple[int, str]:
    """Status, and all that an answer says; 0 where the connection was cut."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.putrequest(method, path, skip_host=True)
        for name, value in (headers | {"Content-Length": str(len(body))}).items():
            connection.putheader(name, value)
        connection.endheaders(body)
        answer = connection.getresponse()
        return answer.status, str(answer.headers) + answer.read().decode("latin-1")
    except (OSError, http.client.HTTPException):
        return 0, ""
    finally:
        connection.close()


def _crowd(port: int, count: int) -> list[socket.socket]:
    made = []
    for _ in range(count):
        with contextlib.suppress(OSError):
            made.append(socket.create_connection(("127.0.0.1", port), timeout=0.2))
            made[-1].send(b"GET / HTTP/1.1\r\nX: ")
    return made


def _served_again_s(port: int, own: str, crowd: list[socket.socket]) -> float:
    for connection in crowd:
        connection.close()
    began_s = time.monotonic()
    while _asked(port, "GET", "/", {"Host": own})[0] != 200 and time.monotonic() < began_s + 60:
        time.sleep(0.05)
    return time.monotonic() - began_s


def floats(folder: Path) -> list[Row]:
    """NaN, infinities, -0, denormals and the largest number in each field of a protocol of floats."""
    unnoticed = not_finite = 0
    cases = float_protocol.cases()
    for _, name, data in cases:
        reception = Reception(float_protocol.PROTOCOL, baudrate=115200)
        received = reception.receive(reception.stream.feed(Chunk(10**18, 10**9, data)))
        (panorama,) = [item for item in received if isinstance(item, Panorama)]
        unnoticed += bool(panorama.problems) != (name not in ("-0", "denormal"))
        not_finite += not panorama.problems and not np.isfinite(panorama.xy_px).all()
    value = f"{unnoticed}, {not_finite}"
    return [(f"{len(cases)} frames of floats: unnoticed or wrongly refused, not finite", value, "0, 0")]


def statuses(folder: Path) -> list[Row]:
    """A session folder of a stranger with a status.json of its own."""
    sound = {
        "schema": "gse.status/1",
        "state": "running",
        "pid": 4000,
        "process": "x:1",
        "utc": "2026-03-20T18:30:00.0Z",
    }
    steering = dict.fromkeys(("port", "link", "so_far", "verdict", "page"), "\x1b[2J\x9b31m")
    keys = ("state", "pid", "process", "utc", "frames", "identified", "session_bytes", "port")
    values = (None, -1, 10**30, "x" * 5000, [], float("nan"), "\x1b[2J")
    documents = [sound | steering, *(sound | {key: value} for key, value in list(itertools.product(keys, values))[::4])]
    session = folder / "session"
    session.mkdir()
    Recorder(session / "session.mcap", live=False).close()
    victim = subprocess.Popen(["sleep", "600"])
    codes, steered = Counter[int](), 0
    own = {"pid": victim.pid, "process": process_mark(victim.pid)}
    for document in [*documents, sound | {"pid": victim.pid, "process": None}, sound | own]:
        (session / "status.json").write_text(json.dumps(document))
        for option in ([], ["--json"], ["--stop"]):
            done = subprocess.run([*GSE, "status", str(session), *option], capture_output=True, text=True)
            codes[done.returncode] += 1
            steered += not all(is_plain(line) for line in (done.stdout + done.stderr).split("\n"))
    ended = victim.poll() is not None
    victim.kill()
    victim.wait()
    value = f"{codes[70]}, {steered}, {int(ended)}"
    return [(f"{len(documents) + 1} status.json of a stranger: exit 70, steered, process ended", value, "0, 0, 0")]


def silence(folder: Path) -> list[Row]:
    """A connection over the network that gets no packet any more, with the probes that the driver asks for."""
    if not own_network.can_be_made():
        return [("half-open TCP: no network of its own here", "not measured", "")]
    rows = []
    for scheme in ("socket", "rfc2217"):
        found = own_network.half_open(scheme)
        same = "identical" if found["identical"] else "NOT identical"
        value = f"LOST after {found['lost_s']:.1f} s, {same}"
        rows.append((f"{scheme}:// over ser2net, half-open: told, bytes before and after", value, "<= 60 s, identical"))
    return rows


def foreign(folder: Path) -> list[Row]:
    """Files, links and readers that are not what their name or their request says."""
    return [_segments(folder), _links(folder), _slow_readers()]


def _segments(folder: Path) -> Row:
    """Each of two recordings in three files gets each file of the other in the place of each of its own."""
    for name in ("a", "b"):
        with Recorder(folder / f"{name}.mcap", live=False, segment_bytes=10_000) as recorder:
            for number in range(80):
                recorder.rx(Chunk(ord(name) * 10**16 + number, number, bytes(216)))
    own, other = (segment_files(folder / f"{name}.mcap") for name in ("a", "b"))
    taken = 0
    for at, strange in itertools.product(own[1:], other):
        kept = at.read_bytes()
        at.write_bytes(strange.read_bytes())
        taken += not verify(own[0]).foreign
        at.write_bytes(kept)
    return (f"{len(own[1:]) * len(other)} times a file of another recording as a segment: taken", str(taken), "0")


def _links(folder: Path) -> Row:
    """A link to a victim in the place of each file that is written, and of each name that was ever used beside it."""
    victim, written = folder / "victim", 0
    for name in ("a.report.json", "status.json", "report.html", "note-1.txt"):
        victim.write_text("mine")
        path = folder / name
        for planted in (path, path.with_name(f"{name}.part"), path.with_name(f".{name}.part")):
            planted.unlink(missing_ok=True)
            planted.symlink_to(victim)
        write_whole(path, ["new"])
        written += victim.read_text() != "mine"
    return ("links planted beside 4 files: written through", str(written), "0")


def _slow_readers() -> Row:
    """More connections than are served ask for a file of 43 MB and read nothing; then a browser asks for it."""
    files = _LargeFiles()
    with ViewServer("127.0.0.1", 0, Content(files=files)) as page, contextlib.ExitStack() as stack:
        before = psutil.Process().memory_info().rss
        for _ in range(2 * MOST_CONNECTIONS):
            reader = stack.enter_context(socket.create_connection(("127.0.0.1", page.port)))
            reader.sendall(f"GET /re_viewer_bg.wasm HTTP/1.1\r\nHost: 127.0.0.1:{page.port}\r\n\r\n".encode())
        status, text = _asked(page.port, "GET", "/re_viewer_bg.wasm", {"Host": f"127.0.0.1:{page.port}"})
        mib = (psutil.Process().memory_info().rss - before) / 2**20
    what = f"{2 * MOST_CONNECTIONS} readers of 43 MB that read nothing: memory, one more gets it whole"
    return (what, f"{mib:.0f} MiB, {'yes' if status == 200 and len(text) > _LARGE else 'no'}", "<= 128 MiB, yes")


_LARGE = 43 << 20


class _LargeFiles(ViewerFiles):
    """A file of the size of rerun's viewer."""

    def __init__(self) -> None:
        self._file = b"x" * _LARGE

    def __getitem__(self, path: str) -> bytes:
        return self._file
