"""Coverage-guided fuzzing of what strangers leave in a folder or send to the page, with atheris (pip install atheris).

    python benchmarks/fuzz_strangers.py status -max_total_time=600 CORPUS     status.json: gse status, gse sessions
    python benchmarks/fuzz_strangers.py report -max_total_time=600 CORPUS     report.json: gse ci, gse sessions
    python benchmarks/fuzz_strangers.py parquet -max_total_time=600 CORPUS    a data set: gse.load, gse campaign query
    python benchmarks/fuzz_strangers.py page -max_total_time=600 CORPUS       HTTP and WebSocket of the live page

An input is the file as it is, or tells how a sound one is changed. Anything but an error of ours is a find, and so are
control characters in what is shown, JSON or XML that is none, a traceback in the log of the page, and a page that then
serves nobody. The inputs that were kept are in ``benchmarks/seeds.zip``, in a folder for each.
"""

import contextlib
import importlib
import json
import logging
import pkgutil
import shutil
import socket
import subprocess
import sys
import tempfile
import urllib.request
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import atheris  # type: ignore[import-not-found]
import click

WHICH = sys.argv.pop(1)
if WHICH == "report":
    # What numba compiles cannot be instrumented.
    import gse.identifier
    import gse.station.frame_processor
    import gse.station.setup

    for module in pkgutil.iter_modules(gse.identifier.__path__, "gse.identifier."):
        importlib.import_module(module.name)
with atheris.instrument_imports(include=["gse.cli", "gse.sessions", "gse.campaign", "gse.api", "gse.view", "tornado"]):
    import pyarrow as pa
    import pyarrow.parquet as pq

    import gse.api
    import gse.campaign.dataset  # gse.api and the commands import it when they need it
    import gse.campaign.query
    from drivers.outside_text import is_plain
    from gse.cli.campaign import query_command
    from gse.cli.sessions import command as sessions_command
    from gse.cli.status import command as status_command
    from gse.config.station import BUILT_IN_TEXT, parse_station
    from gse.errors import GseError
    from gse.sessions.golden import check, expected_path, junit_of
    from gse.sessions.replay import ReplayOptions
    from gse.sessions.status_file import process_mark
    from gse.station.events import Notes
    from gse.view.glance import Glance
    from gse.view.live_state import LiveState
    from gse.view.server import Content, ViewServer
    from gse.view.viewer import NextPiece

FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
SESSION = FOLDER / "20260320T183000Z-fuzz"
GSE = [sys.executable, "-m", "gse"]
STATUS = {
    "schema": "gse.status/1", "state": "running", "utc": "2026-03-20T18:30:00.0Z", "pid": 4000, "process": "x:1",
    "port": "/dev/ttyUSB0", "link": "STREAMING", "frames": 7, "frames_lost": 0, "frames_per_s": 10.0, "identified": 0.9,
    "last_answer_utc": "2026-03-20T18:30:00.0Z", "sky": "CLEAR", "so_far": "PASS", "forecast": None, "page": None,
    "session_bytes": 7, "disk_free_bytes": 7, "verdict": None, "exit_code": None,
}  # fmt: skip


def shown(command: click.Command, *words: str) -> str:
    """What a command prints; errors of ours are none."""
    from click.testing import CliRunner

    done = CliRunner().invoke(command, list(words))
    if done.exception is not None and not isinstance(done.exception, SystemExit | GseError | click.ClickException):
        raise done.exception
    text = f"{done.output}{done.exception or ''}"
    assert all(is_plain(line) for line in text.split("\n")), text
    return str(done.stdout)


def any_value(given: "atheris.FuzzedDataProvider", depth: int = 0) -> object:
    """Any value of JSON, and some that only Python's reader takes for one."""
    kind = given.ConsumeIntInRange(0, 8 if depth < 3 else 6)
    if kind == 7:
        return [any_value(given, depth + 1) for _ in range(given.ConsumeIntInRange(0, 3))]
    if kind == 8:
        return {given.ConsumeUnicode(8): any_value(given, depth + 1) for _ in range(given.ConsumeIntInRange(0, 3))}
    choices: list[Callable[[], object]] = [
        lambda: given.ConsumeUnicode(20),
        lambda: given.PickValueInList(["\x1b[2J", "\udc80", "\0", "\u202e", "2026-02-30T00:00:00Z", "9" * 4000, ""]),
        lambda: given.ConsumeIntInRange(-(2**70), 2**70),
        given.ConsumeFloat,
        lambda: given.PickValueInList([1e999, -1e999, 10**400, -1, 0, 2**31, 2**63]),
        given.ConsumeBool,
        lambda: None,
    ]
    return choices[kind]()


def changed(sound: object, given: "atheris.FuzzedDataProvider") -> bytes:
    """A sound document with some of its values changed, taken away or added; sometimes what is none."""
    document = json.loads(json.dumps(sound))
    for _ in range(given.ConsumeIntInRange(0, 6)):
        place = document
        while isinstance(place, dict | list) and place:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            key = given.PickValueInList(keys)
            inner = place[key]
            if not (isinstance(inner, dict | list) and inner) or given.ConsumeIntInRange(0, 3) == 0:
                if given.ConsumeIntInRange(0, 4) == 0:
                    del place[key]
                else:
                    place[key] = any_value(given)
                break
            place = inner
    try:
        return json.dumps(document).encode()
    except ValueError:  # a number of more digits than Python writes
        return b"{}"


def document_of(sound: object, data: bytes) -> bytes:
    """The bytes themselves, or a sound document that they change."""
    if data[:1] == b"\xff":
        return data[1:]
    return changed(sound, atheris.FuzzedDataProvider(data[1:]))


def make_session() -> None:
    """A session of a second, with its report."""
    SESSION.mkdir()
    made = ["simulate", "--seconds", "1", "--rate-hz", "5", "--file", str(SESSION / "session.mcap")]
    subprocess.run([*GSE, *made], check=True, capture_output=True)


def status(data: bytes) -> None:
    """A status.json, that of a running process of ours among them."""
    (SESSION / "status.json").write_bytes(document_of(STATUS | {"process": process_mark(4000)}, data))
    (SESSION / "report.json").unlink(missing_ok=True)
    shown(status_command, str(SESSION))
    if text := shown(status_command, str(SESSION), "--json"):
        json.loads(text)
    shown(sessions_command, str(FOLDER))


def report(data: bytes) -> None:
    """An expected report, and a report beside its session."""
    recording = SESSION / "session.mcap"
    content = document_of(SOUND_REPORT, data)
    expected_path(recording).write_bytes(content)
    (SESSION / "report.json").write_bytes(content)
    checked = check(recording, "fuzz", ReplayOptions())
    assert all(is_plain(line) for text in checked.lines for line in text.split("\n"))
    ET.fromstring(junit_of([checked], SESSION))
    shown(sessions_command, str(FOLDER))


def parquet(data: bytes) -> None:
    """A data set with one file of its tables changed: its bytes, or a column of it."""
    given = atheris.FuzzedDataProvider(data)
    path = given.PickValueInList(TABLES)
    sound = path.read_bytes()
    try:
        path.write_bytes(_other_columns(sound, given) if given.ConsumeBool() else _other_bytes(sound, given))
        results = gse.api.load(DATASET)
        for name in ("sessions", "frames", "stars"):
            with contextlib.suppress(GseError):
                getattr(results, name)
        shown(query_command, str(DATASET), "select * from sessions", "--format", "json")
    except GseError:
        pass
    finally:
        path.write_bytes(sound)


def _other_bytes(sound: bytes, given: "atheris.FuzzedDataProvider") -> bytes:
    content = bytearray(sound)
    for _ in range(given.ConsumeIntInRange(1, 8)):
        # The footer says what the rest is: half of the changes are there.
        most = min(len(content), 4000) if given.ConsumeBool() else len(content)
        content[-given.ConsumeIntInRange(1, most)] = given.ConsumeIntInRange(0, 255)
    return bytes(content[: given.ConsumeIntInRange(0, len(content))] if given.ConsumeIntInRange(0, 9) == 0 else content)


def _other_columns(sound: bytes, given: "atheris.FuzzedDataProvider") -> bytes:
    table = pq.read_table(pa.BufferReader(sound))
    for _ in range(given.ConsumeIntInRange(1, 4)):
        number = given.ConsumeIntInRange(0, table.num_columns - 1)
        name = table.column_names[number]
        kind = given.ConsumeIntInRange(0, 4)
        if kind == 0:
            table = table.remove_column(number)
        elif kind == 1:
            table = table.rename_columns([given.ConsumeUnicodeNoSurrogates(8) if k == number else other
                                          for k, other in enumerate(table.column_names)])  # fmt: skip
        elif kind == 2:
            table = pa.concat_tables([table] * given.ConsumeIntInRange(1, 3)).slice(given.ConsumeIntInRange(0, 1))
        else:
            with contextlib.suppress(pa.ArrowException, OverflowError, TypeError, UnicodeError):
                table = table.set_column(number, name, pa.array([any_value(given)] * len(table)))
    written = pa.BufferOutputStream()
    with contextlib.suppress(pa.ArrowException):
        pq.write_table(table, written)
    return bytes(written.getvalue())


def page(data: bytes) -> None:
    """A connection to the page of a running session: raw bytes, a request, or a WebSocket with its frames."""
    given = atheris.FuzzedDataProvider(data)
    kind = given.ConsumeIntInRange(0, 3)
    own = f"127.0.0.1:{SERVER.port}".encode()
    if kind == 0:
        sent = given.ConsumeBytes(2000)
    elif kind == 1:
        sent = _request(given, own)
    else:
        head = b"GET /live HTTP/1.1\r\nHost: %s\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n" % own
        key = b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        frames = b"".join(_frame(given) for _ in range(3)) if kind == 2 else given.ConsumeBytes(2000)
        sent = head + key + frames
    address = ("127.0.0.1", SERVER.port)
    with contextlib.suppress(ConnectionError), socket.create_connection(address, timeout=10) as connection:
        connection.sendall(sent)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(1 << 16):
            pass
    NOTES.take()
    with urllib.request.urlopen(f"http://127.0.0.1:{SERVER.port}/rerun.css", timeout=10) as answer:
        assert answer.status == 200
    assert not LOGGED, LOGGED


def _request(given: "atheris.FuzzedDataProvider", own: bytes) -> bytes:
    method = given.PickValueInList([b"GET", b"POST", b"PUT", b"HEAD", b"OPTIONS", given.ConsumeBytes(6)])
    paths = [b"/", b"/note", b"/live", b"/rerun", b"/session.rrd", b"/piece.rrd?after=", b"/piece.rrd?last=1&after=a.1"]
    path = given.PickValueInList(paths) + given.PickValueInList([b"", given.ConsumeBytes(20)])
    lines = [b"Host: " + given.PickValueInList([own, own, own, given.ConsumeBytes(12)])]
    names = [b"Origin", b"Content-Type", b"X-Gse-Token", b"Content-Length", b"Transfer-Encoding", b"Range", b"Cookie"]
    names += [b"Expect", b"Connection", b"Upgrade", b"Accept-Encoding", b"Content-Encoding", given.ConsumeBytes(8)]
    values = [b"application/json", b"chunked", b"gzip", b"-1", b"0", b"9" * 40, b"100-continue", b"bytes=0-"]
    for _ in range(given.ConsumeIntInRange(0, 5)):
        lines.append(given.PickValueInList(names) + b": " + given.PickValueInList([*values, given.ConsumeBytes(12)]))
    body = json.dumps({"text": any_value(given)}).encode() if given.ConsumeBool() else given.ConsumeBytes(300)
    if given.ConsumeBool():
        lines += [b"Content-Type: application/json", b"Content-Length: %d" % len(body)]
    return b"\r\n".join([method + b" " + path + b" HTTP/1.1", *lines, b"", body])


def _frame(given: "atheris.FuzzedDataProvider") -> bytes:
    content = given.PickValueInList([b"next", b"", b"[" * 900, given.ConsumeBytes(200)])
    first = given.PickValueInList([0x81, 0x82, 0x01, 0x80, 0x88, 0x89, 0x8A, 0xC1, given.ConsumeIntInRange(0, 255)])
    size = given.PickValueInList([len(content), len(content), 126, 127, given.ConsumeIntInRange(0, 127)])
    return bytes([first, 0x80 | size & 0x7F]) + bytes(4) + content


class _Kept(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        LOGGED.append(self.format(record))


LOGGED: list[str] = []
NOTES = Notes()
if __name__ == "__main__":
    sys.stderr.write(f"{FOLDER}\n")
    with contextlib.ExitStack() as stack:
        if WHICH in ("status", "report"):
            make_session()
        if WHICH == "report":
            kept = check(SESSION / "session.mcap", "fuzz", ReplayOptions(), update=True)
            SOUND_REPORT = json.loads(expected_path(SESSION / "session.mcap").read_bytes())
        if WHICH == "parquet":
            make_session()
            DATASET = FOLDER / "dataset"
            judged = ["campaign", "judge", str(SESSION), "--out", str(DATASET), "--workers", "1"]
            subprocess.run([*GSE, *judged], check=True, capture_output=True)
            TABLES = sorted(DATASET.rglob("*.parquet"))
        if WHICH == "page":
            logging.getLogger("tornado.application").addHandler(_Kept())
            glance = Glance(LiveState(parse_station(BUILT_IN_TEXT)))
            content = Content(glance=glance, notes=NOTES, piece_after=lambda place, *, last: NextPiece(b"x", "a.1"))
            SERVER = stack.enter_context(ViewServer("127.0.0.1", 0, content))
        stack.callback(shutil.rmtree, FOLDER, ignore_errors=True)
        atheris.Setup(sys.argv, {"status": status, "report": report, "parquet": parquet, "page": page}[WHICH])
        atheris.Fuzz()
