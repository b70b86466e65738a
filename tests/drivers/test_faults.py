"""Seeded faults: the same in every process, each kind by itself, each doing what it says."""

import hashlib
import subprocess
import sys
from collections import Counter
from functools import cache
from itertools import combinations, pairwise
from pathlib import Path

import pytest

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import UrlError
from drivers.faults import KINDS
from drivers.link import SerialLink
from drivers.mock_ports import replay_url, sim_url
from drivers.session_file.writer import CaptureWriter
from drivers.uart import received_at
from drivers.urlhandlers.protocol_sim import register
from protocols import Command, Frame, FrameDecoder, load_protocol

FRAMES = 600
PERIOD_NS = 100_000_000
PROTOCOL = load_protocol("panorama-v1")
BYTE_FAULTS = {"flip": 1e-3, "drop": 1e-3, "double": 1e-3, "insert": 1e-3, "noise": 2e-4}
RATES = {**BYTE_FAULTS, "drop_frame": 0.03, "double_frame": 0.03, "swap_frame": 0.03, "split": 0.02, "stall": 0.2}
SPECS = {kind: f"{kind}:{rate:g}" for kind, rate in RATES.items()} | {
    "disconnect": "disconnect:20s/3s",
    "rename": "rename:f300",
    "reset": "reset:30s",
}


@cache
def frames() -> list[bytes]:
    # Any frame that a CRC protects will do; START has a payload of four bytes and no meaning here.
    return [PROTOCOL.encode(Command("START", {"period": 1000 * (0.001 * (1 + n))}), n) for n in range(FRAMES)]


NUMBER = {frame: number for number, frame in enumerate(frames())}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("faults") / "session.mcap"
    stream = b"".join(frames())
    with CaptureWriter(path) as writer:
        size = len(frames()[0])
        for n in range(FRAMES):
            # Chunks are not frames: each begins 5 bytes into one, inside or right after its start.
            data = stream[n * size + 5 * (n > 0) : (n + 1) * size + 5]
            writer.rx(Chunk(10**18 + n * PERIOD_NS, n * PERIOD_NS, data))
    return path


def replayed(url: str) -> list[Chunk | LinkEvent]:
    items = []
    with SerialLink(url) as link:
        while not link.at_end:
            items += link.receive(1.0)
    return items


def data_of(items: list[Chunk | LinkEvent]) -> bytes:
    return b"".join(item.data for item in items if isinstance(item, Chunk))


def told(items: list[Chunk | LinkEvent], kind: str) -> list[str]:
    texts = [item.text for item in items if isinstance(item, LinkEvent) and item.kind == "FAULT"]
    return [text for text in texts if text.startswith(f"{kind}:")]


def decoded(data: bytes) -> tuple[list[bytes], int]:
    decoder = FrameDecoder(PROTOCOL)
    pieces = decoder.feed(data) + decoder.finish()
    assert decoder.bytes_framed + decoder.bytes_discarded == len(data)
    return [data[p.start : p.start + p.size] for p in pieces if isinstance(p, Frame)], decoder.bytes_discarded


def test_no_fault_changes_nothing(session: Path) -> None:
    assert replayed(replay_url(session, faults="flip:0,drop_frame:0,stall:0")) == replayed(replay_url(session))


@pytest.mark.parametrize("kind", SPECS)
def test_each_kind_strikes_and_is_logged(session: Path, kind: str) -> None:
    clean, faulty = replayed(replay_url(session)), replayed(replay_url(session, faults=SPECS[kind], seed=1))
    if kind != "split":  # harmless, and so not logged
        assert told(faulty, kind)
        assert [item for item in faulty if isinstance(item, Chunk)] != clean
    times = [item.mono_ns for item in faulty if isinstance(item, Chunk)]
    assert times == sorted(times)


@pytest.fixture(scope="module")
def alone(session: Path) -> dict[str, list[str]]:
    """What each kind tells when no other is switched on."""
    return {kind: told(replayed(replay_url(session, faults=spec, seed=5)), kind) for kind, spec in SPECS.items()}


@pytest.mark.parametrize("pair", list(combinations(SPECS, 2)), ids="+".join)
def test_switching_one_kind_on_does_not_move_another(
    session: Path, alone: dict[str, list[str]], pair: tuple[str, str]
) -> None:
    both = replayed(replay_url(session, faults=",".join(SPECS[kind] for kind in pair), seed=5))
    for kind in pair:
        assert told(both, kind) == alone[kind]


def test_the_same_seed_gives_the_same_bytes_in_every_process(session: Path) -> None:
    url = replay_url(session, faults=",".join(SPECS.values()), seed=7)
    script = (
        "import sys, hashlib; from drivers.link import SerialLink; link = SerialLink(sys.argv[1])\n"
        "items = []\n"
        "while not link.at_end: items += link.receive(1)\n"
        "print(hashlib.sha256(repr(items).encode()).hexdigest())"
    )
    there = subprocess.run([sys.executable, "-c", script, url], capture_output=True, text=True, check=True)
    here = hashlib.sha256(repr(replayed(url)).encode()).hexdigest()
    assert there.stdout.strip() == here
    other = replayed(replay_url(session, faults=",".join(SPECS.values()), seed=8))
    assert hashlib.sha256(repr(other).encode()).hexdigest() != here


@pytest.mark.parametrize("kind", BYTE_FAULTS)
def test_a_faulty_byte_costs_at_most_one_frame_and_nothing_false_is_accepted(session: Path, kind: str) -> None:
    items = replayed(replay_url(session, faults=SPECS[kind], seed=3))
    accepted, discarded = decoded(data_of(items))
    assert Counter(accepted) <= Counter(frames())
    strikes = len(told(items, kind))
    assert strikes >= 2
    assert FRAMES - len(accepted) <= strikes
    assert discarded > 0


def test_lost_doubled_and_swapped_frames_are_whole(session: Path) -> None:
    lost = replayed(replay_url(session, faults="drop_frame:0.05", seed=2))
    assert decoded(data_of(lost)) == ([f for n, f in enumerate(frames()) if str(n + 1) not in numbers(lost)], 0)
    doubled = replayed(replay_url(session, faults="double_frame:0.05", seed=2))
    accepted, discarded = decoded(data_of(doubled))
    assert discarded == 0
    assert Counter(accepted) == Counter(frames()) + Counter(frames()[int(n) - 1] for n in numbers(doubled))
    swapped = replayed(replay_url(session, faults="swap_frame:0.05", seed=2))
    accepted, discarded = decoded(data_of(swapped))
    assert discarded == 0
    assert sorted(accepted) == sorted(frames())
    order = [NUMBER[frame] for frame in accepted]
    assert sum(after < before for before, after in pairwise(order)) == len(numbers(swapped))


def numbers(items: list[Chunk | LinkEvent]) -> list[str]:
    return [i.text.split()[-1] for i in items if isinstance(i, LinkEvent) and "_frame:" in i.text]


def test_a_disconnection_cuts_a_frame_and_says_lost_and_reopened(session: Path) -> None:
    items = replayed(replay_url(session, faults="disconnect:f100/3s"))
    accepted, _ = decoded(data_of(items))
    events = [item for item in items if isinstance(item, LinkEvent) and item.kind != "FAULT"]
    assert [event.kind for event in events] == ["LOST", "REOPENED"]
    assert events[1].mono_ns - events[0].mono_ns == 3_000_000_000
    assert 30 <= FRAMES - len(accepted) <= 32
    assert not any(events[0].mono_ns < item.mono_ns < events[1].mono_ns for item in items)


def test_a_device_that_comes_back_under_another_name_says_so(session: Path) -> None:
    items = replayed(replay_url(session, faults="rename:10s"))
    assert "another name" in [item for item in items if isinstance(item, LinkEvent)][-1].text


def test_a_reset_sensor_begins_again_with_its_first_frames(session: Path) -> None:
    items = replayed(replay_url(session, faults="reset:30s"))
    accepted, _ = decoded(data_of(items))
    jump = next(n for n, (a, b) in enumerate(pairwise(accepted)) if NUMBER[b] < NUMBER[a])
    assert 298 <= jump <= 302
    assert accepted[jump + 1 : jump + 200] == frames()[1:200] or accepted[jump + 1 : jump + 200] == frames()[:199]


def test_a_stall_makes_bytes_late_and_loses_none(session: Path) -> None:
    items = replayed(replay_url(session, faults="stall:0.1", seed=4))
    assert data_of(items) == b"".join(frames())
    assert max(b.mono_ns - a.mono_ns for a, b in pairwise(items)) > 3 * PERIOD_NS


def test_splitting_gives_the_same_bytes_in_more_chunks(session: Path) -> None:
    items = replayed(replay_url(session, faults="split:0.1", seed=4))
    assert data_of(items) == b"".join(frames())
    assert len(items) > FRAMES


def test_a_wrong_baud_rate_gives_bytes_and_no_frame(session: Path) -> None:
    items = replayed(replay_url(session, faults="baud:9600"))
    assert told(items, "baud") == ["baud: the sensor speaks at 9600, the port listens at 115200"]
    assert len(data_of(items)) > 1000
    assert decoded(data_of(items))[0] == []


@pytest.mark.parametrize("ratio", [(9600, 9601), (115200, 115201), (102, 100), (98, 100)])
def test_a_uart_of_nearly_the_same_rate_hears_every_byte(ratio: tuple[int, int]) -> None:
    assert received_at(bytes(range(256)), *ratio) == bytes(range(256))


class AnsweringSensor:
    """Sends START frames as if they were acknowledgements, when asked."""

    def __init__(self) -> None:
        self.pending: list[bytes] = []
        self.now_ns = 0

    def next_chunk(self) -> Chunk:
        self.now_ns += PERIOD_NS
        data = self.pending.pop(0) if self.pending else b""
        return Chunk(self.now_ns, self.now_ns, data)

    def command(self, data: bytes, utc_ns: int) -> None:
        self.pending.append(frames()[len(data)])


def test_faults_work_on_a_simulated_sensor_too_and_an_acknowledgement_can_be_lost() -> None:
    for rate, heard in ((0, True), (1, False)):
        register(lambda options: AnsweringSensor())
        with SerialLink(sim_url(faults=f"lost_ack:{rate}", ack_start="1acffc1d82")) as link:
            link.send(b"?")
            items = [item for _ in range(5) for item in link.receive(0.5)]
        assert (frames()[1] in data_of(items)) == heard
        assert bool(told(items, "lost_ack")) != heard


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        ("flap:1", "there is no kind 'flap'; known are " + ", ".join(KINDS)),
        ("flip:2", "expected a probability"),
        ("flip", "expected a probability"),
        ("disconnect:soon", "expected e.g. disconnect:12.5s"),
        ("reset:f3", "expected e.g. reset:12.5s"),
        ("reset:99999s", "all bytes until then are kept"),
        ("baud:0", "expected a whole number"),
        ("flip:1e-4,flip:1e-3", "flip is given twice"),
    ],
)
def test_a_wrong_fault_is_refused_in_words(session: Path, faults: str, words: str) -> None:
    with pytest.raises(UrlError) as error:
        SerialLink(replay_url(session, faults=faults))
    assert words in str(error.value)
