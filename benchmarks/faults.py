"""What is lost under faults: on the wire, at the port, in the process, on the disk, in the file.

    python benchmarks/faults.py [PART ...]

Parts: wire, recorder, files, ports, load, readers, signals, stopped, changed, strangers, network, silence, words,
commands, web, floats, hopeless, statuses, foreign, disks, streams, damaged.

Prints a table with the goal beside each figure; without arguments, all of it (some 20 minutes). The stalled and the
full disk are real ones, and need root to mount them.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import CaptureError
from drivers.link import SerialLink
from drivers.mock_ports import replay_url
from drivers.session_file.reader import read_capture, verify
from drivers.session_file.records import RX, Damage, RecordedMessage
from drivers.session_file.writer import CaptureWriter, compact
from drivers.urlhandlers.protocol_sim import register
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.recording.recorder import Recorder
from gse.simulator import device_factory
from protocols import Command, Frame, FrameDecoder, load_protocol

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from damaged import damaged
from devices.hostile_sessions import FILES, write_file, write_flood, write_steering, write_times
from devices.ser2net import PROGRAM, Ser2net
from devices.terminal import Terminal
from endings import readers, signals, stopped
from hostile import commands, floats, foreign, hopeless, silence, statuses, web, words
from refused import disks, streams

PROTOCOL = load_protocol("panorama-v1")
FRAMES = 20_000
FLIPS = 5_000
SCATTERED, AT_ONCE = 10_000, 500
LARGE_FRAMES = 80_000
FRAME_BYTES = 216
REALISTIC = {
    # Per byte: a good cable has an error in 1e9 bits, a bad one in 1e6; a night of 10 h at 10 Hz has 8e7 bytes.
    "flip": 1e-5,
    "drop": 1e-6,
    "double": 1e-6,
    "insert": 1e-6,
    "noise": 1e-6,
    # Per frame.
    "drop_frame": 1e-3,
    "double_frame": 1e-3,
    "swap_frame": 1e-4,
    # Per second.
    "stall": 1e-2,
    "split": 1e-3,
}
ONCE = {
    "disconnect:f5000/3s": "0 false, 30 or 31 frames unheard",
    "rename:f5000/3s": "0 false, 30 or 31 frames unheard",
    "reset:1000s": "0 false, as many frames as sent",
    "baud:9600": "0 false, 0 frames",
}
"""What happens once a night, and what must come of it."""
Row = tuple[str, str, str]


def main() -> None:
    """Measure what was asked for and print the table."""
    parts = {"wire": wire, "recorder": recorder, "files": files, "ports": ports, "load": load}
    parts |= {"readers": readers, "signals": signals, "stopped": stopped}
    parts |= {"changed": changed, "strangers": strangers, "network": network, "silence": silence}
    parts |= {
        "words": words,
        "commands": commands,
        "web": web,
        "floats": floats,
        "hopeless": hopeless,
        "statuses": statuses,
    }
    parts |= {"foreign": foreign, "disks": disks, "streams": streams, "damaged": damaged}
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.2f}", flush=True)
    for name in sys.argv[1:] or parts:
        with tempfile.TemporaryDirectory() as folder:
            for what, value, goal in parts[name](Path(folder)):
                print(f"{what:64}  {value:>34}  {goal}", flush=True)


def simulated_session(path: Path, frames: int, options: str = "") -> Path:
    """A session of the simulated sensor on the built-in station."""
    station = parse_station(BUILT_IN_TEXT)
    register(device_factory(station))
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", BUILT_IN_TEXT.encode())
        writer.attach("protocol.yaml", "application/yaml", PROTOCOL.text.encode())
        with SerialLink(f"sim://?frames={frames}{options}", recorder=writer) as link:
            while not link.at_end:
                link.receive(1.0)
    return path


def replayed(url: str) -> list[Chunk | LinkEvent]:
    """All items of a mock port."""
    items: list[Chunk | LinkEvent] = []
    with SerialLink(url) as link:
        while not link.at_end:
            items += link.receive(1.0)
    return items


def decoded(items: list[Chunk | LinkEvent]) -> tuple[list[bytes], FrameDecoder]:
    """The frames of what came, and the decoder with its counters."""
    data = b"".join(item.data for item in items if isinstance(item, Chunk))
    decoder = FrameDecoder(PROTOCOL)
    pieces = decoder.feed(data) + decoder.finish()
    return [data[piece.start : piece.start + piece.size] for piece in pieces if isinstance(piece, Frame)], decoder


def wire(folder: Path) -> list[Row]:
    """Each fault kind at 10 times its realistic rate; single bytes at a rate that gives statistics."""
    session = simulated_session(folder / "session.mcap", FRAMES)
    true, _ = decoded(replayed(replay_url(session)))
    rows = []
    for kind, rate in REALISTIC.items():
        items = replayed(replay_url(session, faults=f"{kind}:{10 * rate}", seed=1))
        strikes = [item for item in items if isinstance(item, LinkEvent) and item.kind == "FAULT"]
        frames, decoder = decoded(items)
        expected = len(true) - sum(item.text.startswith("drop_frame") for item in strikes)
        false = Counter(frames) - Counter(true) - Counter(true)
        balanced = decoder.bytes_in == decoder.bytes_framed + decoder.bytes_discarded
        lost = expected - len(set(frames))
        rows.append(
            (
                f"{kind} at {10 * rate:g}, {len(true)} frames: {len(strikes)} faults",
                f"{sum(false.values())} false, {lost} lost, {'balanced' if balanced else 'NOT balanced'}",
                "0 false, lost <= faults, balanced",
            )
        )
    for spec, goal in ONCE.items():
        items = replayed(replay_url(session, faults=spec))
        frames, decoder = decoded(items)
        false = Counter(frames) - Counter(true) - Counter(true)
        balanced = decoder.bytes_in == decoder.bytes_framed + decoder.bytes_discarded
        value = f"{sum(false.values())} false, {len(frames)} of {len(true)}"
        rows.append((spec, f"{value}, {'balanced' if balanced else 'NOT balanced'}", goal))
    for kind in ("flip", "drop", "insert"):
        items = replayed(replay_url(session, faults=f"{kind}:2e-4", seed=2))
        strikes = sum(isinstance(item, LinkEvent) and item.kind == "FAULT" for item in items)
        lost = len(true) - len(decoded(items)[0])
        rows.append((f"frames lost per byte, {kind}", f"{lost / strikes:.3f} ({strikes} bytes)", "<= 1.0"))
    return rows


RECORD = """
import sys
from pathlib import Path
from drivers.link import SerialLink
from gse.recording.recorder import Recorder
with Recorder(Path(sys.argv[2]), live=True) as recorder, SerialLink(sys.argv[1], 921600, recorder=recorder) as link:
    print("open", flush=True)
    while True:
        link.receive(1.0)
"""


def recorder(folder: Path) -> list[Row]:
    """kill -9 at random moments, with frames coming in at 400 per second."""
    rng = random.Random(1)
    missing = late = unreadable = unplayable = 0
    worst_ms = 0.0
    for number in range(50):
        path = folder / f"{number}.mcap"
        terminal = Terminal(folder / f"tty{number}")
        command = [sys.executable, "-c", RECORD, str(terminal.path), str(path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            sent = _feed(terminal, rng.uniform(0.02, 0.6))
            process.send_signal(signal.SIGKILL)
            killed_s = time.monotonic()
            process.wait()
        terminal.unplug()
        received = b"".join(r.data for r in read_capture(path) if isinstance(r, RecordedMessage) and r.topic == RX)
        whole = len(received) // FRAME_BYTES
        unreadable += any(damage.reason != "cut off" for file in verify(path).files for damage in file.damages)
        unplayable += b"".join(c.data for c in replayed(replay_url(path)) if isinstance(c, Chunk)) != received
        due = sum(sent_s < killed_s - 0.010 for sent_s in sent)
        missing += max(0, due - whole)
        late += len(sent) - whole
        if whole < len(sent):
            worst_ms = max(worst_ms, (killed_s - sent[whole]) * 1e3)
    return [
        ("kill -9 at 50 moments: frames lost that were sent 10 ms before", str(missing), "0"),
        ("frames lost at all, age of the oldest", f"{late}, {worst_ms:.1f} ms", ""),
        ("files that do not verify up to their end, or do not replay", f"{unreadable}, {unplayable}", "0, 0"),
    ]


def _feed(terminal: Terminal, seconds: float) -> list[float]:
    """Send frames at 400 per second; when each was sent."""
    sent = []
    started = time.monotonic()
    while time.monotonic() - started < seconds:
        terminal.write(bytes(FRAME_BYTES))
        sent.append(time.monotonic())
        time.sleep(max(0.0, started + len(sent) / 400 - time.monotonic()))
    return sent


def files(folder: Path) -> list[Row]:
    """Truncation at every byte of a small session, flipped bits in a large one, plain and compressed."""
    rows = []
    small = simulated_session(folder / "small.mcap", 20)
    for form in ("plain", "compressed"):
        if form == "compressed":
            compact(small)
        rows.append(_truncations(small, folder / "cut.mcap", form))
    large = simulated_session(folder / "large.mcap", 400)
    for form in ("plain", "compressed"):
        if form == "compressed":
            compact(large)
        rows += _flips(large, folder / "flipped.mcap", form)
    huge = simulated_session(folder / "huge.mcap", LARGE_FRAMES)
    for form in ("plain", "compressed"):
        if form == "compressed":
            compact(huge)
        rows.append(_scattered(huge, folder / "flipped.mcap", form))
    return rows


def _scattered(path: Path, flipped: Path, form: str) -> Row:
    """Many flips at once in a session as large as a night's."""
    content, true = path.read_bytes(), list(read_capture(path))
    known = set(true)
    rng = random.Random(5)
    wrong = unseen = lost = 0
    for _ in range(SCATTERED // AT_ONCE):
        damaged = bytearray(content)
        for _ in range(AT_ONCE):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        flipped.write_bytes(damaged)
        given = [record for record in read_capture(flipped) if not isinstance(record, Damage)]
        wrong += sum(record not in known for record in given)
        unseen += verify(flipped).is_whole
        lost += len(true) - len(given)
    size = f"{len(content) / 1e6:.1f} MB"
    what = (
        f"{SCATTERED} flips, {AT_ONCE} at once, in {len(true)} records, {size} ({form}): wrong, unseen, lost per flip"
    )
    return (what, f"{wrong}, {unseen}, {lost / SCATTERED:.2f}", "0, 0")


def _truncations(path: Path, cut: Path, form: str) -> Row:
    content, true = path.read_bytes(), list(read_capture(path))
    wrong = unseen = 0
    for size in range(len(content)):
        cut.write_bytes(content[:size])
        try:
            capture = read_capture(cut)
            given = [record for record in capture if not isinstance(record, Damage)]
            wrong += given != true[: len(given)]
            unseen += verify(cut).is_whole
        except CaptureError:
            continue
    what = f"truncation at each of {len(content)} bytes ({form}): wrong, unseen"
    return (what, f"{wrong}, {unseen}", "0, 0")


def _flips(path: Path, flipped: Path, form: str) -> list[Row]:
    content = bytearray(path.read_bytes())
    true = list(read_capture(path))
    known = set(true)
    rng = random.Random(3)
    wrong = unseen = lost = most = 0
    for _ in range(FLIPS):
        position, bit = rng.randrange(len(content)), 1 << rng.randrange(8)
        content[position] ^= bit
        flipped.write_bytes(content)
        content[position] ^= bit
        try:
            given = [record for record in read_capture(flipped) if not isinstance(record, Damage)]
            unseen += verify(flipped).is_whole
        except CaptureError:
            given = []
        wrong += any(record not in known for record in given)
        lost += len(true) - len(given)
        most = max(most, len(true) - len(given))
    return [
        (f"{FLIPS} flipped bits in {len(content)} bytes ({form}): wrong, unseen", f"{wrong}, {unseen}", "0, 0"),
        (f"records lost per flipped bit of {len(true)}, most ({form})", f"{lost / FLIPS:.2f}, {most}", ""),
    ]


def ports(folder: Path) -> list[Row]:
    """20 unplugs and returns, within a frame."""
    terminal = Terminal(folder / "tty")
    rng = random.Random(4)
    received = bytearray()
    sent: list[bytes] = []
    slowest_s = 0.0
    frames = [PROTOCOL.encode(Command("START", {"period": 1000 * (0.001 * n + 0.001)}), n) for n in range(2000)]
    with SerialLink(str(terminal.path), 115200) as link:
        for _ in range(20):
            whole = [frames.pop(0) for _ in range(rng.randrange(5, 40))]
            sent += whole
            cut = frames.pop(0)[: rng.randrange(1, 18)]
            terminal.write(b"".join(whole) + cut)
            while terminal.unread():
                time.sleep(0.001)
            time.sleep(0.03)  # what is on its way within the kernel counts as unread only when it is there
            terminal.unplug()
            time.sleep(rng.uniform(0.0, 1.5))
            back_s = time.monotonic()
            terminal.plug(frames.pop(0)[5:])
            until_s = back_s + 10
            reopened = False
            while not reopened and time.monotonic() < until_s:
                for item in link.receive(0.05):
                    if isinstance(item, Chunk):
                        received += item.data
                    elif item.kind == "REOPENED":
                        reopened = True
                        slowest_s = max(slowest_s, item.mono_ns * 1e-9 - back_s)
        received += b"".join(item.data for item in link.receive(0.3) if isinstance(item, Chunk))
    terminal.unplug()
    found, _ = decoded([Chunk(0, 0, bytes(received))])
    return [
        ("20 unplugs within a frame: whole frames sent, lost, false", _whole(sent, found), "lost 0, false 0"),
        ("slowest reconnection", f"{slowest_s:.3f} s", "<= 1 s"),
    ]


def _whole(sent: list[bytes], found: list[bytes]) -> str:
    return f"{len(sent)}, {len(set(sent) - set(found))}, {len(set(found) - set(sent))}"


STATION_921600 = BUILT_IN_TEXT.replace("url: sim://", "url: sim://\n  baudrate: 921600")
SECONDS = 20
FEED = """
import os, sys, time
fd, size, data = int(sys.argv[1]), int(sys.argv[2]), open(sys.argv[3], "rb").read()
os.set_blocking(fd, True)
started, worst = time.monotonic(), 0.0
for number in range(len(data) // size):
    due = started + number / 400
    time.sleep(max(0.0, due - time.monotonic()))
    view = memoryview(data)[number * size : (number + 1) * size]
    while view:
        view = view[os.write(fd, view):]
    worst = max(worst, time.monotonic() - due)
print(worst)
"""


def load(folder: Path) -> list[Row]:
    """921600 baud, 400 frames per second over a pty, the live view on, the disk frozen for 2 s."""
    station = folder / "station.yaml"
    station.write_text(STATION_921600)
    register(device_factory(parse_station(STATION_921600)))
    with SerialLink(f"sim://?rate_hz=400&frames={400 * SECONDS}", 921600) as link:
        items: list[Chunk | LinkEvent] = []
        while not link.at_end:
            items += link.receive(1.0)
    frames = [frame for frame in decoded(items)[0] if len(frame) == FRAME_BYTES]  # no STATUS, which FEED would cut
    stream = folder / "stream.bin"
    stream.write_bytes(b"".join(frames))
    disk = _Disk(folder)
    terminal = Terminal(folder / "tty")
    command = [str(Path(sys.executable).parent / "gse"), "run", "--station", str(station), "--port"]
    command += [str(terminal.path), "--view", "web", "--duration", str(SECONDS + 15), "--out", str(disk.folder)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        _await_running(disk.folder)
        fd = terminal.master
        feed = subprocess.Popen(
            [sys.executable, "-c", FEED, str(fd), str(FRAME_BYTES), str(stream)], pass_fds=[fd], stdout=subprocess.PIPE
        )
        time.sleep(6)
        disk.stall(2.0)
        late_s = float(feed.communicate()[0])
        process.wait()
    terminal.unplug()
    (session,) = disk.folder.glob("*/session.mcap")
    received, _ = decoded(
        [r.chunk() for r in read_capture(session) if isinstance(r, RecordedMessage) and r.topic == RX]
    )
    disk.close()
    return [
        (f"{len(frames)} frames at 400/s, view on, {disk.kind}: lost", str(len(frames) - len(received)), "0"),
        ("the sensor had to wait at most (a real one cannot wait)", f"{late_s * 1e3:.0f} ms", "< 600 ms: 64 KiB"),
    ]


def _await_running(out: Path) -> None:
    """Wait until the session below a folder has loaded its tables: on a busy machine that takes long."""
    until_s = time.monotonic() + 120
    while not any('"running"' in path.read_text(encoding="utf-8") for path in out.glob("*/status.json")):
        assert time.monotonic() < until_s, "the session does not run"
        time.sleep(0.2)


class _Disk:
    """A disk of its own that can be frozen; without root, the folder as it is."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "disk"
        self.folder.mkdir()
        self.kind = "disk frozen 2 s"
        image = folder / "image"
        try:
            with image.open("wb") as file:
                file.truncate(64 << 20)
            subprocess.run(["mkfs.ext4", "-q", str(image)], check=True, capture_output=True)
            subprocess.run(["mount", "-o", "loop", str(image), str(self.folder)], check=True, capture_output=True)
            self._mounted = True
        except (OSError, subprocess.CalledProcessError) as error:
            self._mounted = False
            self.kind = f"disk NOT frozen ({error})"

    def stall(self, seconds: float) -> None:
        """Let nothing be written for a while."""
        if self._mounted:
            subprocess.run(["fsfreeze", "-f", str(self.folder)], check=True)
            time.sleep(seconds)
            subprocess.run(["fsfreeze", "-u", str(self.folder)], check=True)

    def close(self) -> None:
        """Unmount it."""
        if self._mounted:
            subprocess.run(["umount", str(self.folder)], check=True)


HARMS = 200


def changed(folder: Path) -> list[Row]:
    """A file that another program changes while it is written: a byte, a sector, its end."""
    rng = random.Random(6)
    rows = []
    for harm in ("a byte flipped", "16 KiB zeroed", "truncated"):
        silent = lost = rewritten = unwhole = 0
        for number in range(HARMS):
            path = folder / f"{harm}{number}" / "session.mcap"
            path.parent.mkdir()
            chunks = [Chunk(10**18 + n, n, rng.randbytes(FRAME_BYTES)) for n in range(400)]
            recording = Recorder(path, live=False)
            for chunk in chunks[:200]:
                recording.rx(chunk)
            before = _harm(path, harm, rng)
            for chunk in chunks[200:]:
                recording.rx(chunk)
            recording.close()
            silent += recording.damage is None
            rewritten += path.read_bytes()[: len(before)] != before
            saved = path.with_name("session.recovered.mcap")
            received = b"".join(r.data for r in read_capture(saved) if isinstance(r, RecordedMessage) and r.topic == RX)
            lost += len(chunks) * FRAME_BYTES - len(received)
            unwhole += not verify(saved).is_whole
        value = f"{silent}, {rewritten}, {lost}, {unwhole}"
        rows.append((f"{HARMS} x {harm} during the run: silent, rewritten, bytes lost, not whole", value, "0, 0, 0, 0"))
    return rows


def _harm(path: Path, harm: str, rng: random.Random) -> bytes:
    """Change a file that is written on; its content up to where writing goes on, as it is then."""
    content = bytearray(path.read_bytes())
    place = rng.randrange(len(content) - (16 << 10))
    if harm == "truncated":
        os.truncate(path, place)
        return bytes(content[:place])
    if harm == "a byte flipped":
        content[place] ^= 1 << rng.randrange(8)
    else:
        content[place : place + (16 << 10)] = bytes(16 << 10)
    with path.open("r+b") as file:
        file.write(content)
    return bytes(content)


def strangers(folder: Path) -> list[Row]:
    """Hostile sessions through the commands, each in a process of its own: exit code, memory, time per MB of input."""
    makers = {name: (lambda path, name=name: write_file(path, name)) for name in FILES}
    makers |= {"a flood of events": write_flood, "absurd times": write_times, "texts that steer": write_steering}
    rows = []
    for name, make in makers.items():
        path = make(folder / "session.mcap")
        megabytes = max(path.stat().st_size / 1e6, 1.0)
        codes, most_mib, most_s = set(), 0.0, 0.0
        for command in (("session", "verify"), ("session", "info"), ("report",)):
            code, mib, seconds = _measured([str(Path(sys.executable).parent / "gse"), *command, str(path)])
            codes.add(code)
            most_mib, most_s = max(most_mib, mib), max(most_s, seconds / megabytes)
        path.unlink()
        value = f"{'/'.join(map(str, sorted(codes)))}, {most_mib:.0f} MiB, {most_s:.1f} s/MB"
        rows.append((f"stranger: {name}: exit codes, memory, CPU", value, "never 70, <= 400 MiB, <= 10 s/MB"))
    return rows


def _measured(command: list[str]) -> tuple[int, float, float]:
    """Exit code, largest resident memory in MiB, and CPU seconds of a command."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    return os.waitstatus_to_exitcode(status), usage.ru_maxrss / 1024, usage.ru_utime + usage.ru_stime


def network(folder: Path) -> list[Row]:
    """Debian's ser2net between sensor and station, killed and started again."""
    if PROGRAM is None:
        return [("ser2net is not installed", "not measured", "")]
    rows = []
    for scheme in ("rfc2217", "socket"):
        terminal = Terminal(folder / f"tty-{scheme}")
        rng = random.Random(7)
        sent, received = bytearray(), bytearray()
        told = Counter[str]()
        with (
            Ser2net(scheme, terminal.path, folder) as server,
            SerialLink(server.url, 115200, wait_port=True) as link,
        ):
            for number in range(10):
                while not told["OPENED"] + told["REOPENED"] > number:
                    told.update(item.kind for item in link.receive(1.0) if isinstance(item, LinkEvent))
                server.await_open(terminal.path)
                for _ in range(40):
                    data = rng.randbytes(FRAME_BYTES)
                    terminal.write(data)
                    sent += data
                while len(received) < len(sent) and (items := link.receive(2.0)):
                    received += b"".join(item.data for item in items if isinstance(item, Chunk))
                server.kill()
                while told["LOST"] <= number:
                    told.update(item.kind for item in link.receive(1.0) if isinstance(item, LinkEvent))
                server.start()
        terminal.unplug()
        same = "identical" if sent == received else "NOT identical"
        value = f"{len(sent)} bytes {same}, {told['LOST']} lost, {told['REOPENED']} back"
        rows.append((f"{scheme}:// over ser2net, killed 10 times", value, "identical, 10 lost, 9 or 10 back"))
    return rows


if __name__ == "__main__":
    main()
