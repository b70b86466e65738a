"""A sensor's line on this computer: formats through ser2net, a fast line, and how evenly a sensor is asked.

    python benchmarks/wire.py [--seconds 20]

The sensor is a pty that is written to from here. ser2net is Debian's program; without it those rows say so.
"""

import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np

from drivers.chunk import Chunk
from drivers.link import SerialLink
from drivers.session_file.reader import read_capture
from drivers.session_file.records import TX, RecordedMessage
from gse.config.station import PollOptions
from gse.recording.recorder import Recorder
from gse.sessions.asking import Asking
from protocols import Frame, FrameDecoder, PanoramaMessage, Protocol, load_protocol

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from devices.ser2net import PROGRAM, Ser2net
from devices.terminal import Terminal

PUBLIC = ("nsp-polled", "ccsds-packets", "text-lines", "panorama-slip-xxhash")
_LAST_WAIT_S = 5.0


def panoramas(protocol: Protocol, count: int, objects: int = 12) -> Iterator[bytes]:
    """Frames of so many panoramas."""
    rng = np.random.default_rng(1)
    for number in range(count):
        xy, index = rng.integers(0, 1000, (objects, 2)).astype(float), np.arange(objects, 0, -1) * 64.0
        yield protocol.encode(PanoramaMessage(number * 5000, number, 0.002, frozenset(), 20.0, xy, index), number)


def sent_and_read(terminal: Terminal, url: str, baudrate: int, protocol: Protocol, rate_hz: float, count: int) -> int:
    """How many of so many panoramas, sent at this rate, are read whole from a URL."""
    frames = list(panoramas(protocol, count))

    def send() -> None:
        start_s = time.monotonic()
        for number, frame in enumerate(frames):
            time.sleep(max(start_s + number / rate_hz - time.monotonic(), 0))
            terminal.write(frame)

    decoder, found = FrameDecoder(protocol, from_sensor=True), 0
    with SerialLink(url, baudrate, wait_port=True) as link:
        time.sleep(1.0)
        sender = threading.Thread(target=send, daemon=True)
        sender.start()
        until_s = time.monotonic() + count / rate_hz + _LAST_WAIT_S
        while found < count and time.monotonic() < until_s:
            chunks = (item.data for item in link.receive(0.2) if isinstance(item, Chunk))
            found += sum(isinstance(piece, Frame) for piece in decoder.feed(b"".join(chunks)))
        sender.join()
    return found


def poll_jitter_ms(terminal: Terminal, folder: Path, seconds: float) -> np.ndarray:
    """How far requests of a sensor that is asked at 10 Hz are from their grid, by the record."""
    protocol, path = load_protocol("nsp-polled"), folder / "polled.mcap"
    answers, over = panoramas(protocol, 100_000), threading.Event()

    def answer() -> None:
        while not over.is_set():
            if terminal.read(4096):
                terminal.write(next(answers))

    threading.Thread(target=answer, daemon=True).start()
    decoder, until_s = FrameDecoder(protocol, from_sensor=True), time.monotonic() + seconds
    with Recorder(path, live=True) as recorder, SerialLink(str(terminal.path), recorder=recorder) as link:
        with Asking(link, protocol, PollOptions(period_ms=100)) as asking:
            while time.monotonic() < until_s:
                chunks = (item.data for item in link.receive(asking.wait_s()) if isinstance(item, Chunk))
                found = decoder.feed(b"".join(chunks))
                asking.came(sum(isinstance(piece, Frame) for piece in found), 0)
        over.set()
    sent = read_capture(path, only=(TX,))
    asked_ms = np.array([one.mono_ns for one in sent if isinstance(one, RecordedMessage) and one.topic == TX]) / 1e6
    off_ms = (asked_ms - asked_ms[0]) - 100 * np.rint((asked_ms - asked_ms[0]) / 100)
    return np.abs(off_ms - np.median(off_ms))


@click.command()
@click.option("--seconds", default=20, show_default=True, help="Length of each part.")
def main(seconds: int) -> None:
    """Print the table of docs/measurements.md."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        terminal = Terminal(folder / "tty")
        print("| what | found |\n|---|---|")
        for fmt in PUBLIC if PROGRAM else ():
            with Ser2net("socket", terminal.path, folder) as server:
                count = 20 * seconds
                found = sent_and_read(terminal, server.url, 115_200, load_protocol(fmt), 20, count)
            print(f"| {fmt} at 20 Hz through ser2net: frames read | {found} of {count} |")
        if not PROGRAM:
            print("| ser2net | not installed |")
        for fmt in PUBLIC:
            count = 200 * seconds
            found = sent_and_read(terminal, str(terminal.path), 921_600, load_protocol(fmt), 200, count)
            print(f"| {fmt} at 200 Hz and 921,600 baud on a pty: frames read | {found} of {count} |")
        off_ms = poll_jitter_ms(terminal, folder, seconds)
        p50, p99 = np.percentile(off_ms, [50, 99])
        print(f"| requests at 10 Hz off their grid, by the record: median, p99 | {p50:.2f}, {p99:.2f} ms |")


if __name__ == "__main__":
    main()
