"""Output that waits for nobody, against real pipes, terminals and devices."""

import io
import os
import subprocess
import sys
import termios
import threading
from pathlib import Path
from typing import TextIO

import pytest

from gse.cli.output import LIMIT_CHARS, QueuedOutput


def writing_to(fd: int) -> TextIO:
    return open(fd, "w", encoding="utf-8", closefd=False)


def test_everything_comes_in_its_order_to_a_slow_reader() -> None:
    reader, writer = os.pipe()
    output = QueuedOutput(writing_to(writer), "stdout")
    lines = [f"line {number} of °ß\n" for number in range(20_000)]
    for line in lines:
        output.write(line)
    received: list[str] = []
    with open(reader, encoding="utf-8") as file:
        reading = threading.Thread(target=lambda: received.extend(file))
        reading.start()
        assert output.end()
        os.close(writer)
        reading.join()
    assert received == lines
    assert output.news() == []


@pytest.mark.parametrize("device", ["pipe", "terminal", "/dev/full"])
def test_a_reader_that_is_gone_is_news_once_and_nothing_is_raised(device: str) -> None:
    if device == "/dev/full":
        fd = os.open(device, os.O_WRONLY)
    else:
        reader, fd = os.pipe() if device == "pipe" else os.openpty()
        os.close(reader)
    output = QueuedOutput(writing_to(fd), "stderr")
    for number in range(3):
        output.write(f"{number}\n")
    assert output.settle()
    ((kind, text),) = output.news()
    assert kind == "TERMINAL_LOST"
    assert text.startswith("stderr: ")
    assert output.news() == []
    os.close(fd)


def test_a_stopped_terminal_takes_what_it_got_when_it_goes_on_and_is_not_waited_for() -> None:
    master, slave = os.openpty()
    termios.tcflow(slave, termios.TCOOFF)
    output = QueuedOutput(writing_to(slave), "stderr")
    assert output.isatty()
    output.write("first\n")
    assert not output.settle()
    termios.tcflow(slave, termios.TCOON)
    assert os.read(master, 100) == b"first\r\n"
    while not output.settle():
        pass
    assert output.end()
    os.close(master)
    os.close(slave)


def test_what_nobody_takes_is_dropped_beyond_a_limit() -> None:
    reader, writer = os.pipe()
    output = QueuedOutput(writing_to(writer), "stdout")
    for character in "abc":
        output.write(character * LIMIT_CHARS)
    received: list[str] = []
    with open(reader, encoding="utf-8") as file:
        reading = threading.Thread(target=lambda: received.append(file.read()))
        reading.start()
        assert output.end()
        os.close(writer)
        reading.join()
    assert received == ["a" * LIMIT_CHARS + "b" * LIMIT_CHARS]


def test_a_stream_without_a_descriptor_is_written_to_and_bytes_are_refused() -> None:
    stream = io.StringIO()
    output = QueuedOutput(stream, "stdout")
    output.write("words")
    with pytest.raises(TypeError, match="expected text"):
        output.write(b"bytes")  # type: ignore[arg-type]
    assert output.end()
    assert stream.getvalue() == "words"


def test_closed_standard_streams_are_not_taken_by_a_session_file(tmp_path: Path) -> None:
    script = "import os; from gse.__main__ import _fill_standard_descriptors as f; f(); print(os.open('x', 65))"
    command = f'"{sys.executable}" -c "{script}" 2>&- <&-'
    done = subprocess.run(command, shell=True, cwd=tmp_path, stdout=subprocess.PIPE, text=True, check=True)
    assert int(done.stdout) > 2
