import json
import os
import select
import signal
import subprocess

import numpy as np
import pytest
from devices.patience import PATIENCE_S
from devices.programs import program

from gse.errors import UsageError
from gse.external.answers import ExternalAnswer, Failure, FailureKind
from gse.external.identifier import MOST_FAILURES_IN_A_ROW, MOST_LOG_BYTES, MOST_SILENT_STARTS, RunningIdentifier
from gse.external.panoramas import SensorDescription
from gse.external.plugs import plug_of
from gse.values.camera import Camera
from gse.values.identifier_options import IdentifierOptions
from gse.values.panorama import Panorama

SENSOR = SensorDescription("made", Camera(1024, 1024, 4000.0, (511.5, 511.5)), 4096)


def panoramas(count):
    xy_px, brightness = np.array([[10.0, 20.0], [30.0, 40.0]]), np.array([300.0, 200.0])
    return [Panorama(1_774_000_000_000_000_000 + n, xy_px, brightness, n, 0.1, 1000 * n) for n in range(count)]


def running(path, timeout_ms=1000 * PATIENCE_S):
    options = IdentifierOptions(algorithm="external", command=(str(path),))
    return RunningIdentifier(plug_of(options, SENSOR), timeout_ms / 1000)


def kinds(identifier, count):
    """What comes of panoramas: "" for an answer, otherwise the kind of failure."""
    given = identifier.answers(panoramas(count))
    identifier.close()
    return [one.answer.kind.value if isinstance(one.answer, Failure) else "" for one in given]


def failure_of(folder, body, timeout_ms=1000 * PATIENCE_S):
    """The failure at frame 2 of five, where a program does what ``body`` says; all others must be answered."""
    loop = "for line in sys.stdin:\n    p = json.loads(line)\n    if p['frame_no'] == 2:\n        "
    identifier = running(program(folder, f"{loop}{body}\n    answer(p)\n"), timeout_ms)
    given = identifier.answers(panoramas(5))
    identifier.close()
    assert [isinstance(one.answer, ExternalAnswer) for one in given] == [True, True, False, True, True]
    return given[2].answer


def test_every_panorama_gets_its_own_answer_one_by_one_and_many_at_once(tmp_path):
    body = "for line in sys.stdin:\n    p = json.loads(line)\n    answer(p, ra_deg=p['frame_no'] / 7)\n"
    identifier = running(program(tmp_path, body))
    given = identifier.answers(panoramas(150)) + identifier.answers(panoramas(1))
    identifier.close()
    assert [one.answer.document["ra_deg"] for one in given] == [n / 7 for n in (*range(150), 0)]


@pytest.mark.parametrize(
    ("body", "kind", "text"),
    [
        ("sys.exit(3)", FailureKind.CRASH, "it ended with exit code 3"),
        ("os.kill(os.getpid(), 11)", FailureKind.CRASH, "it was ended by SIGSEGV"),
        ("os.close(1); os.close(2); time.sleep(60)", FailureKind.CRASH, "it closed its output"),
        ("print('half a', end='', flush=True); sys.exit()", FailureKind.CRASH, "it ended with exit code 0"),
        ("print('hello', flush=True)", FailureKind.NONSENSE, "not a line of JSON: 'hello'"),
        ("print('[' * 60000, flush=True)", FailureKind.NONSENSE, "not a line of JSON"),
        ("print('[1, 2]', flush=True)", FailureKind.NONSENSE, "not a JSON object"),
        ("print('\\x1b[2J', flush=True)", FailureKind.NONSENSE, "not a line of JSON"),
        ("p['frame_no'] = 7", FailureKind.NONSENSE, "an answer to frame 7 came, to 2 was expected"),
        ("print('{}', flush=True)", FailureKind.NONSENSE, "an answer to frame 'no frame_no' came"),
        ("answer(p, ra_deg=float('nan')); continue", FailureKind.NONSENSE, "NaN is not a number"),
        ("answer(p, schema='gse.answer/9'); continue", FailureKind.NONSENSE, "gse.answer/1 was expected"),
        ("answer(p, ra_deg=400); continue", FailureKind.NONSENSE, "ra_deg is 400: expected a number from 0 to 360"),
        ("while True: os.write(1, b'x' * 65536)", FailureKind.FLOOD, "a line of more than 65536 bytes"),
    ],
)
def test_a_program_that_fails_costs_its_panorama_alone(tmp_path, body, kind, text):
    failure = failure_of(tmp_path, body)
    assert failure.kind is kind
    assert text in failure.detail


@pytest.mark.parametrize(
    "body",
    [
        "time.sleep(3600)",
        "os.kill(os.getpid(), 19)",
        "while True: os.write(2, b'woe' * 20000)",
        """while True: os.write(1, b'{"schema": "gse.identifier/1"}\\n' * 2000)""",
    ],
    ids=["sleeps", "stops itself", "complains without end", "introduces itself without end"],
)
def test_a_program_that_hangs_costs_its_panorama_after_the_time_out(tmp_path, body):
    failure = failure_of(tmp_path, body, timeout_ms=2000)
    assert (failure.kind, failure.detail[:24]) == (FailureKind.TIMEOUT, "no answer within 2000 ms")


def test_what_is_written_after_an_answer_is_not_taken_for_the_next_one(tmp_path):
    body = "for line in sys.stdin:\n    p = json.loads(line)\n    answer(p)\n    if p['frame_no'] == 1: answer(p)\n"
    assert kinds(running(program(tmp_path, body)), 4) == ["", "", "NONSENSE", ""]


def test_a_program_that_reads_nothing_is_given_up_in_the_end(tmp_path):
    found = kinds(running(program(tmp_path, "sys.exit(1)", head="import sys\n")), MOST_FAILURES_IN_A_ROW + 3)
    assert found == ["CRASH"] * MOST_FAILURES_IN_A_ROW + ["GIVEN_UP"] * 3


def test_a_program_that_never_answers_costs_some_starts_and_not_a_night(tmp_path):
    options = IdentifierOptions(algorithm="external", command=(str(program(tmp_path, "time.sleep(60)\n")),))
    found = kinds(RunningIdentifier(plug_of(options, SENSOR), 0.01, start_s=0.05), MOST_SILENT_STARTS + 2)
    assert found == ["TIMEOUT"] * MOST_SILENT_STARTS + ["GIVEN_UP"] * 2


def test_a_program_that_vanished_is_a_failure_to_start(tmp_path):
    path = program(tmp_path, "for line in sys.stdin: answer(json.loads(line))\n")
    identifier = running(path)
    path.unlink()
    assert kinds(identifier, 2) == ["START", "START"]


def test_a_line_that_was_not_ended_is_told_apart_from_silence(tmp_path):
    body = "os.write(1, b'{\"frame_no\": 0}')\ntime.sleep(60)\n"
    options = IdentifierOptions(algorithm="external", command=(str(program(tmp_path, body)),))
    given = RunningIdentifier(plug_of(options, SENSOR), 0.01, start_s=2).answers(panoramas(1))[0]
    assert given.answer.detail == "no answer within 2010 ms; 15 bytes came, and not the end of an answer"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"#!/no/such/interpreter\n", "No such file or directory; is the interpreter of its first line there?"),
        (b"", "Exec format error; a script needs a first line with #!"),
        (b"\x7fELF\x02\x01\x01" + bytes(60), "Exec format error"),
    ],
    ids=["no interpreter", "empty", "another computer's"],
)
def test_what_the_system_cannot_start_is_refused_before_a_session(tmp_path, content, text):
    path = tmp_path / "onboard"
    path.write_bytes(content)
    path.chmod(0o755)
    with pytest.raises(UsageError) as refused:
        plug_of(IdentifierOptions(algorithm="external", command=(str(path),)), SENSOR)
    assert f"{path} cannot be started: {text}" in str(refused.value)


def test_a_child_of_the_program_ends_with_it(tmp_path):
    pid_file = tmp_path / "pid"
    body = (
        "if not os.fork():\n"
        f"    open({str(pid_file)!r}, 'w').write(str(os.getpid()))\n"
        "    time.sleep(3600)\n"
        f"while not os.path.exists({str(pid_file)!r}) or not open({str(pid_file)!r}).read(): pass\n"
        "for line in sys.stdin: answer(json.loads(line))\n"
    )
    identifier = running(program(tmp_path, body))
    assert all(isinstance(one.answer, ExternalAnswer) for one in identifier.answers(panoramas(3)))
    pid = int(pid_file.read_text())
    ended = os.pidfd_open(pid)
    identifier.close()
    assert select.select([ended], [], [], PATIENCE_S)[0], "the program's own child lives on"
    os.close(ended)


def test_the_program_sees_no_environment_but_its_mark_no_descriptor_and_no_terminal(tmp_path):
    kept = (tmp_path / "session.mcap").open("wb")
    os.set_inheritable(kept.fileno(), True)
    body = (
        "for line in sys.stdin:\n"
        "    try: os.open('/dev/tty', os.O_RDWR); terminal = 'yes'\n"
        "    except OSError: terminal = 'no'\n"
        "    seen = [sorted(set(os.environ) - {'LC_CTYPE'}), sorted(os.listdir('/proc/self/fd'))[:4], terminal]\n"
        "    print(json.dumps({'frame_no': json.loads(line)['frame_no'], 'detail': json.dumps(seen)}), flush=True)\n"
    )
    identifier = running(program(tmp_path, body))
    (given,) = identifier.answers(panoramas(1))
    identifier.close()
    kept.close()
    environment, descriptors, terminal = json.loads(given.answer.detail)
    assert (environment, terminal) == (["GSE_CHILD"], "no")
    assert descriptors == ["0", "1", "2", "3"]  # 3 is the folder that is listed


def test_stderr_is_kept_up_to_a_limit(tmp_path):
    body = "for line in sys.stdin:\n    os.write(2, b'word' * 200000)\n    answer(json.loads(line))\n"
    identifier = running(program(tmp_path, body))
    identifier.answers(panoramas(4))
    identifier.close()
    log = identifier.take_log()
    assert log == b"word" * (MOST_LOG_BYTES // 4)
    assert identifier.take_log() == b""


def test_nothing_runs_on_after_the_identifier_is_forgotten(tmp_path):
    body = "for line in sys.stdin: answer(json.loads(line), detail=str(os.getpid()))\n"
    identifier = running(program(tmp_path, body))
    (given,) = identifier.answers(panoramas(1))
    del identifier
    with pytest.raises(ProcessLookupError):
        os.kill(int(given.answer.detail), 0)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({}, "external needs one of command, library and entry_point; none came"),
        ({"command": ("./none",)}, "identifier.command: there is no file"),
        ({"command": ("no-such-program",)}, "there is no program no-such-program in PATH"),
        ({"command": ("./plain",)}, "is not executable; chmod +x"),
        ({"command": ("./plain",), "library": "x.so"}, "command and library came"),
        ({"library": "none.so"}, "identifier.library: there is no file"),
        ({"library": "plain"}, "identifier.library"),
        ({"entry_point": "none"}, "identifier.entry_point: none is not installed"),
        ({"command": ("true",), "config": "none.bin"}, "identifier.config: there is no file"),
        ({"command": ("true",), "directory": "none"}, "identifier.directory"),
    ],
)
def test_what_cannot_be_started_is_refused_before_a_session(tmp_path, options, text):
    (tmp_path / "plain").write_text("no program\n")
    options = {"directory": str(tmp_path), **options}
    if options["directory"] == "none":
        options["directory"] = str(tmp_path / "none")
    with pytest.raises(UsageError) as refused:
        plug_of(IdentifierOptions(algorithm="external", **options), SENSOR)
    assert text in str(refused.value)


def test_name_version_and_hash_are_those_of_the_program(tmp_path):
    body = 'print(json.dumps({"schema": "gse.identifier/1", "name": "flight", "version": "2.1"}), flush=True)\n'
    path = program(tmp_path, body + "for line in sys.stdin: answer(json.loads(line))\n")
    identifier = running(path)
    assert kinds(identifier, 2) == ["", ""]
    sum_of = subprocess.run(["sha256sum", path], capture_output=True, text=True).stdout.split()[0]
    assert (identifier.identity["name"], identifier.identity["version"]) == ("flight", "2.1")
    assert identifier.identity["program_sha256"] == sum_of


def test_a_broken_pipe_to_the_program_is_no_signal_for_the_station(tmp_path):
    handler = signal.getsignal(signal.SIGPIPE)
    body = "os.close(0)\nfor k in range(2): answer({'frame_no': k})\nsys.exit()\n"
    assert kinds(running(program(tmp_path, body)), 3)[:2] == ["", ""]
    assert signal.getsignal(signal.SIGPIPE) is handler


def test_what_a_program_started_in_a_session_of_its_own_ends_with_it(tmp_path):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    body = (
        "if os.fork() == 0:\n"
        "    os.setsid()\n"
        "    if os.fork() == 0:\n"
        f"        held = open({str(fifo)!r}, 'w')\n"
        "        held.write('begun')\n"
        "        held.flush()\n"
        "        time.sleep(3600)\n"
        "    os._exit(0)\n"
        "for line in sys.stdin:\n    answer(json.loads(line))\n"
    )
    identifier = running(program(tmp_path, body))
    opened = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    assert isinstance(identifier.answers(panoramas(1))[0].answer, ExternalAnswer)
    assert select.select([opened], [], [], PATIENCE_S)[0]
    assert os.read(opened, 5) == b"begun"
    identifier.close()
    assert select.select([opened], [], [], PATIENCE_S)[0], "its end of the pipe is still open: it lives"
    assert os.read(opened, 5) == b""
    os.close(opened)


def test_where_memory_ends_the_system_ends_the_program_and_not_the_session(tmp_path):
    body = "for line in sys.stdin:\n    wish = int(open('/proc/self/oom_score_adj').read())\n"
    identifier = running(program(tmp_path, body + "    answer(json.loads(line), ra_deg=wish / 10)\n"))
    (given,) = identifier.answers(panoramas(1))
    identifier.close()
    assert given.answer.document["ra_deg"] == 100.0
