"""A session ends with its word, whatever ends it and whoever reads: real processes, ptys, pipes, signals and tmux."""

import fcntl
import os
import shutil
import signal
import socket
import subprocess
import sys
import termios
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import DEVNULL, PIPE

import numpy as np
import pytest
from devices.command_line import Gse
from devices.live_session import PATIENCE_S, LiveSession, ended, run_command
from devices.programs import program

from drivers.session_file.reader import messages, verify
from drivers.session_file.records import RX
from gse.cli.finish import say_exit_code
from gse.sessions.live import SAME_PRESS_S
from protocols import PanoramaMessage, load_protocol

INCONCLUSIVE = 5
"""The verdict on a port where nothing came."""


def full_pipe() -> tuple[int, int]:
    """A pipe that takes nothing more, because nobody reads: both its ends."""
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    os.write(writer, bytes(4096))
    return reader, writer


def test_with_a_reader_that_died_and_one_that_never_reads_the_session_goes_on_until_a_signal(tmp_path: Path) -> None:
    reader, writer = full_pipe()
    dead_reader, dead_writer = os.pipe()
    os.close(dead_reader)
    stuck = subprocess.Popen(run_command(tmp_path / "stuck"), stdout=writer, stderr=writer)
    dead = subprocess.Popen(run_command(tmp_path / "dead"), stdout=dead_writer, stderr=dead_writer)
    os.close(dead_writer)
    sessions = LiveSession(tmp_path / "stuck"), LiveSession(tmp_path / "dead")
    for session in sessions:
        session.await_state("running")
    stuck.send_signal(signal.SIGTERM)
    dead.send_signal(signal.SIGINT)
    dead.send_signal(signal.SIGINT)
    assert (ended(stuck), ended(dead)) == (INCONCLUSIVE, INCONCLUSIVE)
    os.close(reader)
    for session in sessions:
        assert session.is_closed_judged_and_reported()
        assert session.status()["exit_code"] == INCONCLUSIVE
    assert "SIGTERM" in sessions[0].events()["CLOSED"]
    assert "Ctrl-C" in sessions[1].events()["CLOSED"]
    assert sessions[1].events()["TERMINAL_LOST"] == "stderr: Broken pipe; the session goes on without"


def test_a_terminal_that_was_stopped_by_ctrl_s_keeps_no_session_from_its_end(tmp_path: Path) -> None:
    master, slave = os.openpty()
    stopped = subprocess.Popen(run_command(tmp_path / "out"), stdout=slave, stderr=slave)
    session = LiveSession(tmp_path / "out")
    session.await_state("running")
    termios.tcflow(slave, termios.TCOOFF)
    stopped.send_signal(signal.SIGTERM)
    assert ended(stopped) == INCONCLUSIVE
    assert session.is_closed_judged_and_reported()
    os.close(slave)
    os.close(master)


def test_ctrl_c_ends_a_session_that_is_far_behind_and_all_that_came_is_in_its_file(gse: Gse, tmp_path: Path) -> None:
    slow = program(tmp_path, "for line in sys.stdin:\n    time.sleep(0.1)\n    answer(json.loads(line))\n")
    nothing, protocol = (np.zeros((0, 2)), np.zeros(0)), load_protocol("panorama-v1")
    panoramas = (PanoramaMessage(100_000 * n, n, 0.05, frozenset(), 20.0, *nothing) for n in range(5000))
    sent = b"".join(protocol.encode(panorama, sequence=panorama.frame_no) for panorama in panoramas)  # 500 s of work
    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor(1) as pool:

        def serve() -> socket.socket:
            connection, _ = server.accept()
            connection.sendall(sent)
            return connection

        serving = pool.submit(serve)
        command = [sys.executable, "-m", "gse", "run", "--port", f"socket://127.0.0.1:{server.getsockname()[1]}"]
        command += ["--identifier", f"command:{slow}", "--out", str(tmp_path / "out"), "--no-plots"]
        running = subprocess.Popen(command, stdout=DEVNULL, stderr=PIPE, text=True)
        session = LiveSession(tmp_path / "out")
        with serving.result():
            session.await_frames(1)
            running.send_signal(signal.SIGINT)
            with pytest.raises(subprocess.TimeoutExpired):
                running.wait(SAME_PRESS_S + 0.2)
            running.send_signal(signal.SIGINT)
            _, told = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 130
    assert f"make the report with: gse report {session.folder}" in told.splitlines()[-1]
    assert verify(session.folder / "session.mcap").is_whole
    received = b"".join(message.data for message in messages(session.folder / "session.mcap", RX))
    assert received == sent[: len(received)]
    assert len(received) > len(sent) / 2


@pytest.mark.skipif(shutil.which("tmux") is None, reason="needs tmux")
def test_a_killed_tmux_ends_the_session_with_its_report(tmp_path: Path) -> None:
    command = run_command(tmp_path / "out")
    tmux = ["tmux", "-f", "/dev/null", "-S", str(tmp_path / "tmux")]
    subprocess.run([*tmux, "new-session", "-d", *command], check=True)
    session = LiveSession(tmp_path / "out")
    session.await_state("running")
    subprocess.run([*tmux, "kill-server"], check=True)
    session.await_state("ended")
    assert session.is_closed_judged_and_reported()
    assert "SIGHUP" in session.events()["CLOSED"]


def test_a_detached_session_outlives_its_terminal_and_is_asked_and_ended_from_elsewhere(
    gse: Gse, tmp_path: Path
) -> None:
    master, slave = os.openpty()
    command = run_command(tmp_path / "out", "--detach")
    starting = subprocess.Popen(
        command,
        stdin=slave,
        stdout=PIPE,
        stderr=slave,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )
    told, _ = starting.communicate(timeout=PATIENCE_S)
    os.close(slave)
    os.close(master)
    session = LiveSession(tmp_path / "out")
    assert starting.returncode == 0
    assert f"session: {session.folder}" in told
    status = session.await_state("running")
    assert f"process: {status['pid']}" in told
    assert os.getsid(status["pid"]) != os.getsid(0)
    asked = gse("status", tmp_path / "out")
    assert asked.code == 0
    assert f"running, process {status['pid']}" in asked.out
    assert gse("status", session.folder, "--stop").code == 0
    session.await_state("ended")
    assert session.is_closed_judged_and_reported()
    assert "ended" in gse("status", session.folder).out
    assert "INCONCLUSIVE" in (session.folder / "run.log").read_text()
    assert gse("status", session.folder, "--stop").code == 2


LOGGING = """
import os, sys
from pathlib import Path
from gse.cli.run import Detachment
detachment = Detachment(os.pipe()[1])
detachment.into(Path(sys.argv[1]))
for number in range(50):
    os.write(1, b"%d%s" % (number, b" " * (1 << 20)))
    detachment.keep_small()
"""


def test_the_log_of_a_detached_session_keeps_its_newest_part_and_takes_no_disk(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", LOGGING, str(tmp_path)], check=True)
    newest, older = ((tmp_path / name).read_bytes() for name in ("run.log", "run.1.log"))
    assert [int(word) for word in (older + newest).split()] == [*range(32, 50)]


def test_a_detached_start_that_fails_says_so_on_the_terminal(tmp_path: Path) -> None:
    command = [*run_command(tmp_path / "out"), "--detach", "--port", "/dev/ttyNONE"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout) == (4, "")
    assert "/dev/ttyNONE" in done.stderr


def test_a_killed_session_is_offered_to_the_next_run_and_reported_by_gse_report(gse: Gse, tmp_path: Path) -> None:
    killed = subprocess.Popen(run_command(tmp_path / "out"), stdout=DEVNULL, stderr=DEVNULL)
    session = LiveSession(tmp_path / "out")
    session.await_state("running")
    killed.kill()
    ended(killed)
    asked = gse("status", tmp_path / "out")
    assert asked.code == 1
    assert f"died while running, last seen {session.status()['utc']}" in asked.out
    offer = f"gse report {session.folder}"
    assert offer in asked.out
    assert offer in gse("session", "info", session.folder).err
    assert offer in gse("run", "--port", "/dev/ttyNONE", "--out", tmp_path / "out").err
    done = gse("report", session.folder)
    assert done.code == 3
    assert done.err.splitlines()[-1] == ("exit code 3: the session is damaged or lost its end (3), INCONCLUSIVE (5)")
    assert offer not in gse("run", "--port", "/dev/ttyNONE", "--out", tmp_path / "out").err


@pytest.mark.parametrize(
    ("found", "code", "line"),
    [
        ([(0, "PASS")], 0, "exit code 0: PASS (0)"),
        ([(1, "FAIL"), (3, "9 bytes lost")], 3, "exit code 3: 9 bytes lost (3), FAIL (1)"),
        ([(3, "lost"), (70, "broken")], 70, "exit code 70: broken (70), lost (3)"),
        ([(130, "left"), (3, "lost")], 3, "exit code 3: lost (3), left (130)"),
        ([(0, "PASS"), (130, "left")], 130, "exit code 130: left (130), PASS (0)"),
        ([(130, "left"), (5, "INCONCLUSIVE")], 5, "exit code 5: INCONCLUSIVE (5), left (130)"),
        ([(5, "INCONCLUSIVE"), (1, "FAIL")], 1, "exit code 1: FAIL (1), INCONCLUSIVE (5)"),
    ],
)
def test_the_weightiest_exit_code_wins_and_all_are_said(
    capsys: pytest.CaptureFixture[str], found: list[tuple[int, str]], code: int, line: str
) -> None:
    assert say_exit_code(found) == code
    assert capsys.readouterr().err == f"{line}\n"


def test_a_session_whose_working_folder_is_deleted_is_whole_and_judged(tmp_path: Path) -> None:
    working = tmp_path / "working"
    working.mkdir()
    command = [sys.executable, "-m", "gse", "run", "--port", "sim://?speed=1", "--duration", "5", "--no-plots"]
    with subprocess.Popen(command, cwd=working, stdout=DEVNULL, stderr=PIPE, text=True) as process:
        assert process.stderr is not None
        next(line for line in process.stderr if "STREAMING" in line)
        shutil.rmtree(working)
        assert "FILE_RESTORED" in process.stderr.read()
        assert process.wait(PATIENCE_S) == INCONCLUSIVE
    (session,) = (working / "sessions").glob("*/session.mcap")
    assert verify(session).is_whole
    assert session.with_name("report.json").is_file()
