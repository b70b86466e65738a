"""A child process that answers requests over its standard input and output, within times and sizes.

It starts with an empty environment but for a mark, no descriptor but its three pipes, and no terminal, in a process
group of its own. At its end the group is killed whole, and each process that has its mark: one that went into a session
of its own (setsid) has it, too. Requests are sent ahead, answers come in their order; the time of a request begins when
the answer before it came. What it writes to stderr is kept, up to a limit.
"""

import contextlib
import os
import selectors
import signal
import subprocess
import time
import uuid
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.outside_text import plain_line
from gse.external.answers import Failure, FailureKind

MOST_REPLY_BYTES = 1 << 16
"""Thirty matches take two kilobytes."""
_READ_BYTES = 1 << 16
_END_S = 2.0
"""How long the end of a killed process is awaited."""
_MOST_TAIL = 200
_MARK = "GSE_CHILD"
"""Variable of the environment by which what a child started is found at its end."""

Split = Callable[[bytearray], bytes | None]
"""Takes the next whole message off the front of a buffer; None where there is none yet."""


@dataclass(frozen=True, slots=True)
class Reply:
    """A message from the child, and this host's time for it in microseconds; None of the first after a start."""

    data: bytes
    elapsed_us: float | None


def split_line(buffer: bytearray) -> bytes | None:
    """The next line, without its end."""
    end = buffer.find(b"\n")
    if end < 0:
        return None
    line = bytes(buffer[:end])
    del buffer[: end + 1]
    return line


def split_record(size: int) -> Split:
    """A function that takes records of one size."""

    def split(buffer: bytearray) -> bytes | None:
        if len(buffer) < size:
            return None
        record = bytes(buffer[:size])
        del buffer[:size]
        return record

    return split


class Log:
    """What programs write to stderr in a session, up to a limit."""

    def __init__(self, most_bytes: int) -> None:
        self._room = most_bytes
        self._kept = bytearray()
        self._tail = b""

    def add(self, data: bytes) -> None:
        """Keep what there is room for."""
        self._tail = (self._tail + data)[-_MOST_TAIL:]
        kept = data[: self._room]
        self._room -= len(kept)
        self._kept += kept

    def take_last_line(self) -> str:
        """The last line that was added, where there is one since the last call: a traceback ends with its reason."""
        lines, self._tail = self._tail.decode("utf-8", "replace").split("\n"), b""
        return next((plain_line(line.strip()) for line in reversed(lines) if line.strip()), "")

    def take(self) -> bytes:
        """What was added since the last call."""
        taken = bytes(self._kept)
        self._kept.clear()
        return taken


class Child:
    """One running child; ``log`` gets what it writes to stderr. OSError where it cannot be started."""

    def __init__(self, command: Sequence[str], directory: Path, log: Log) -> None:
        mark = uuid.uuid4().hex
        self._process = subprocess.Popen(
            list(command),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=directory,
            env={_MARK: mark},
            start_new_session=True,
            bufsize=0,
        )
        process, self._mark = self._process, mark
        # Where memory ends, the system ends the program that leaks, not the session that records.
        with contextlib.suppress(OSError):
            Path(f"/proc/{process.pid}/oom_score_adj").write_text("1000")
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        self._stdin, self._stdout, self._stderr = process.stdin.fileno(), process.stdout.fileno(), process.stderr
        self._log = log
        self._out = memoryview(b"")
        self._received = bytearray()
        self._selector = selectors.DefaultSelector()
        for descriptor in (self._stdin, self._stdout, self._stderr.fileno()):
            os.set_blocking(descriptor, False)
        self._selector.register(self._stdout, selectors.EVENT_READ)
        self._selector.register(self._stderr.fileno(), selectors.EVENT_READ)
        self._end = weakref.finalize(self, _end, process, mark, self._selector)

    def exchange(
        self, requests: Sequence[bytes], split: Split, wanted: int, *, first_s: float, each_s: float
    ) -> tuple[list[Reply], Failure | None]:
        """Send requests, receive so many replies; those that came, and the failure that ended it, None without one.

        ``first_s`` is the time for the first reply, ``each_s`` for each that follows.
        """
        self._out = memoryview(b"".join(requests))
        self._send()  # a pipe has room for most requests: then nothing waits for it
        if self._out:
            self._selector.register(self._stdin, selectors.EVENT_WRITE)
        replies: list[Reply] = []
        began_s, limit_s, is_late = time.perf_counter(), first_s, False
        failure: Failure | None = None
        while failure is None:
            new = self._take(split, wanted - len(replies), began_s)
            replies += new
            if new:
                began_s, limit_s, is_late = time.perf_counter(), each_s, False
            if len(replies) == wanted:
                break
            if len(self._received) > MOST_REPLY_BYTES:
                failure = Failure(FailureKind.FLOOD, f"a line of more than {MOST_REPLY_BYTES} bytes")
            elif is_late:
                failure = Failure(FailureKind.TIMEOUT, f"no answer within {1000 * limit_s:g} ms{self._what_lies()}")
            else:
                # What lies in the pipes when the time is over still counts: the host may have been late, too.
                wait_s = began_s + limit_s - time.perf_counter()
                is_late = wait_s <= 0
                failure = self._serve_pipes(max(wait_s, 0.0))
        if self._out:
            self._stop_sending()
        return replies, failure

    def _what_lies(self) -> str:
        """What came without its end: a program that writes no line ends waits as long as the station does."""
        return f"; {len(self._received)} bytes came, and not the end of an answer" if self._received else ""

    def _serve_pipes(self, wait_s: float) -> Failure | None:
        """Wait for pipes that are ready, and serve each of them once."""
        failure: Failure | None = None
        for key, _ in self._selector.select(wait_s):
            if key.fd == self._stdin:
                self._send()
                if not self._out:
                    self._stop_sending()
            elif key.fd == self._stderr.fileno():
                self._keep_log()
            else:
                failure = self._receive()
        return failure

    def _take(self, split: Split, most: int, began_s: float) -> list[Reply]:
        """Whole messages received so far; those that came together share the time."""
        messages: list[bytes] = []
        while len(messages) < most and (message := split(self._received)) is not None:
            messages.append(message)
        elapsed_us = 1e6 * (time.perf_counter() - began_s) / max(len(messages), 1)
        return [Reply(message, elapsed_us) for message in messages]

    def _send(self) -> None:
        try:
            self._out = self._out[os.write(self._stdin, self._out) :]
        except BlockingIOError:
            return
        except OSError:  # it closed its input; it may still answer what it read
            self._out = self._out[:0]

    def _stop_sending(self) -> None:
        self._selector.unregister(self._stdin)

    def _receive(self) -> Failure | None:
        try:
            data = os.read(self._stdout, _READ_BYTES)
        except BlockingIOError:
            return None
        if not data:
            return Failure(FailureKind.CRASH, self._how_it_ended())
        self._received += data
        return None

    def _how_it_ended(self) -> str:
        try:
            code = self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            return "it closed its output"
        self._keep_log()
        last = self._log.take_last_line()
        return f"{_exit_text(code)}; its last line to stderr: {last}" if last else _exit_text(code)

    def _keep_log(self) -> None:
        try:
            data = os.read(self._stderr.fileno(), _READ_BYTES)
        except BlockingIOError:
            return
        if data:
            self._log.add(data)
        else:
            with contextlib.suppress(KeyError):
                self._selector.unregister(self._stderr.fileno())

    def close(self) -> None:
        """Kill the child with all that it started; what it wrote to stderr until then is kept."""
        if self._end.alive:
            _kill(self._process, self._mark)
            self._keep_log()
            self._end()


def _exit_text(code: int) -> str:
    if code >= 0:
        return f"it ended with exit code {code}"
    with contextlib.suppress(ValueError):
        return f"it was ended by {signal.Signals(-code).name}"
    return f"it was ended by signal {-code}"


def _end(process: "subprocess.Popen[bytes]", mark: str, selector: selectors.BaseSelector) -> None:
    _kill(process, mark)
    selector.close()
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()


def _kill(process: "subprocess.Popen[bytes]", mark: str) -> None:
    # The group lives on after its first process where that one forked.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_END_S)
    for pid in _marked(f"{_MARK}={mark}".encode()):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(pid, signal.SIGKILL)


def _marked(variable: bytes) -> list[int]:
    """Processes with a variable in their environment; none where the system has no /proc."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if variable in path.read_bytes().split(b"\0"):
                found.append(int(path.parent.name))
    return found
