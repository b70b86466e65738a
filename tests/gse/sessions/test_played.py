"""Recorded sessions played to another program, through a real terminal or socket and the real driver."""

import threading
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from devices.items_sensor import NAMES_TEXT
from devices.patience import PATIENCE_S

from drivers.chunk import Chunk
from drivers.clock import read_clock
from drivers.link import SerialLink
from drivers.playback import session_items
from gse.cli.emulate import command
from gse.errors import UsageError
from gse.sessions.played import PlayedSession, ShiftedFrames, play, played_session
from gse.simulator.emulator import Endpoint, PortEndpoint, TcpEndpoint
from gse.simulator.pty_endpoint import PtyEndpoint
from gse.values.sensor_time import utc_ns_of
from protocols import (
    Discard,
    Frame,
    FrameDecoder,
    PanoramaMessage,
    Protocol,
    StarsMessage,
    load_protocol,
    parse_protocol,
)

GOLDEN = Path(__file__).parents[3] / "replays" / "golden"


def recorded(name: str) -> bytes:
    return b"".join(item.data for item in session_items(GOLDEN / name) if isinstance(item, Chunk))


def heard(recording: PlayedSession, endpoint: Endpoint, size: int) -> tuple[bytes, float]:
    """What a station reads that opens the other end, and the seconds from the first byte to the last."""
    over = threading.Event()
    player = threading.Thread(
        target=play,
        args=[recording.items, endpoint, lambda: read_clock().mono_ns, over.is_set],
        kwargs={"baudrate": 921600},
    )
    player.start()
    received: list[Chunk] = []
    until_ns = read_clock().mono_ns + PATIENCE_S * 1e9
    try:
        with SerialLink(endpoint.address, 921600) as link:
            while sum(len(chunk.data) for chunk in received) < size and read_clock().mono_ns < until_ns:
                received += [item for item in link.receive(0.2) if isinstance(item, Chunk)]
    finally:
        over.set()
        player.join(PATIENCE_S)
        endpoint.close()
    return b"".join(chunk.data for chunk in received), (received[-1].mono_ns - received[0].mono_ns) / 1e9


@pytest.mark.parametrize("make", [PtyEndpoint, lambda: TcpEndpoint("127.0.0.1", 0)], ids=["pty", "tcp"])
def test_a_session_is_played_with_the_same_bytes_at_the_recorded_pace(make: type[PtyEndpoint]) -> None:
    whole = recorded("text-lines.mcap")[:3000]
    times_ns, size = [], 0
    for item in session_items(GOLDEN / "text-lines.mcap"):
        if isinstance(item, Chunk) and size < len(whole):
            times_ns.append(item.mono_ns)
            size += len(item.data)
    recording = played_session(GOLDEN / "text-lines.mcap", is_shifted=False, faults=None, seed=1)
    data, took_s = heard(recording, make(), len(whole))
    assert data[: len(whole)] == whole
    assert took_s == pytest.approx((times_ns[-1] - times_ns[0]) / 1e9, abs=0.5)


def frames_of(protocol: Protocol, data: bytes) -> list[Frame]:
    decoder = FrameDecoder(protocol, from_sensor=True)
    return [piece for piece in [*decoder.feed(data), *decoder.finish()] if isinstance(piece, Frame)]


def shifted_bytes(name: str) -> bytes:
    recording = played_session(GOLDEN / name, is_shifted=True, faults=None, seed=1)
    return b"".join(item.data for item in recording.items if isinstance(item, Chunk))


@pytest.mark.parametrize(
    ("name", "protocol_name"),
    [
        ("clear.mcap", "panorama-v1"),
        ("faults.mcap", "panorama-v1"),
        ("ccsds-packets.mcap", "ccsds-packets"),
        ("nsp-polled.mcap", "nsp-polled"),
        ("slip-polled.mcap", "panorama-slip-xxhash"),
        ("text-lines.mcap", "text-lines"),
        ("text-objects.mcap", "text-objects"),
    ],
)
def test_frames_made_anew_differ_in_time_counter_and_mark_alone(name: str, protocol_name: str) -> None:
    protocol = load_protocol(protocol_name)
    before, after = frames_of(protocol, recorded(name)), frames_of(protocol, shifted_bytes(name))
    is_marked = protocol.is_test(after[0])
    assert is_marked == (name in ("clear.mcap", "faults.mcap", "nsp-polled.mcap"))
    assert all(protocol.is_test(frame) == bool(protocol.test_flag) for frame in after[1:] if frame.type != "STATUS")
    if is_marked and not protocol.test_flag:
        status = after.pop(0)
        assert (status.type, status.sequence) == ("STATUS", 0 if protocol.sequence_modulus else -1)
    assert [frame.type for frame in after] == [frame.type for frame in before]
    modulus = protocol.sequence_modulus or 1
    assert len({(b.sequence - a.sequence) % modulus for a, b in zip(after, before, strict=True)}) == 1
    assert after[0].sequence == (-1 if not protocol.sequence_modulus else int(is_marked and not protocol.test_flag))
    for one, other in zip(before, after, strict=True):
        old, new = protocol.decode(one), protocol.decode(other)
        if isinstance(old, PanoramaMessage) and isinstance(new, PanoramaMessage):
            assert (new.xy_px.tolist(), new.frame_no) == (old.xy_px.tolist(), old.frame_no)


def tags_us(protocol: Protocol, data: bytes) -> list[int]:
    messages = map(protocol.decode, frames_of(protocol, data))
    return [message.time_us for message in messages if isinstance(message, PanoramaMessage)]


def test_an_absolute_clock_says_now_and_keeps_its_distances() -> None:
    protocol = load_protocol("ccsds-packets")
    now_ns = read_clock().utc_ns
    old, new = (tags_us(protocol, data("ccsds-packets.mcap")) for data in (recorded, shifted_bytes))
    assert utc_ns_of(new[0], protocol.time) == pytest.approx(now_ns, abs=PATIENCE_S * 1e9)
    assert [tag - new[0] for tag in new] == pytest.approx([tag - old[0] for tag in old], abs=2)


def test_a_counter_begins_at_0() -> None:
    protocol = load_protocol("panorama-v1")
    old, new = (tags_us(protocol, data("clear.mcap")) for data in (recorded, shifted_bytes))
    assert new[0] < 1_000_000 < old[-1]
    assert [tag - new[0] for tag in new] == [tag - old[0] for tag in old]


def test_a_list_of_stars_keeps_the_time_of_its_panorama() -> None:
    protocol = parse_protocol(NAMES_TEXT, "names.yaml")
    frames, sent = ShiftedFrames(protocol, protocol.time, lambda: 0), b""
    for number, time_us in enumerate((7_000_000, 7_100_000)):
        panorama = replace(PanoramaMessage.empty(), time_us=time_us)
        stars = StarsMessage(time_us, objects=(0,), stars=(number + 1,), residuals_arcsec=(1.5,))
        sent += protocol.encode(panorama, 2 * number) + protocol.encode(stars, 2 * number + 1)
    played = [protocol.decode(frame) for frame in frames_of(protocol, frames.feed(Chunk(0, 0, sent)))]
    lists = [message for message in played if isinstance(message, StarsMessage)]
    assert [(of.time_us, of.stars) for of in lists] == [(0, (1,)), (100_000, (2,))]
    assert [message.time_us for message in played if isinstance(message, PanoramaMessage)] == [0, 100_000]


def test_bytes_that_are_no_frame_go_out_as_they_came() -> None:
    protocol = load_protocol("panorama-v1")

    def rubbish(data: bytes) -> list[bytes]:
        decoder = FrameDecoder(protocol, from_sensor=True)
        return [piece.data for piece in [*decoder.feed(data), *decoder.finish()] if isinstance(piece, Discard)]

    assert rubbish(shifted_bytes("faults.mcap")) == rubbish(recorded("faults.mcap")) != []


def test_faults_spoil_what_is_played() -> None:
    recording = played_session(GOLDEN / "clear.mcap", is_shifted=False, faults="drop_frame:0.5", seed=1)
    data = b"".join(item.data for item in recording.items if isinstance(item, Chunk))
    assert 0.2 * len(recorded("clear.mcap")) < len(data) < 0.8 * len(recorded("clear.mcap"))


def test_a_serial_port_is_an_end_of_a_cable() -> None:
    cable = PtyEndpoint()
    endpoint = PortEndpoint(
        cable.address, 115200, played_session(GOLDEN / "clear.mcap", is_shifted=False, faults=None, seed=1).port.line
    )
    try:
        endpoint.send(b"to the station")
        assert cable.wait(PATIENCE_S) == b"to the station"
        cable.send(b"to the sensor")
        received = b""
        while len(received) < 13:
            received += endpoint.wait(0.2)
        assert received == b"to the sensor"
    finally:
        endpoint.close()
        cable.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--pty", "--session", str(GOLDEN / "clear.mcap"), "--scenario", "dew"], "leave out --scenario"),
        (["--pty", "--shift", "now"], "give --session too"),
        (["--port", "sim://", "--session", str(GOLDEN / "clear.mcap")], "is no cable"),
        (["--pty", "--session", str(Path(__file__))], "is not a session"),
    ],
)
def test_what_cannot_be_played_is_told(arguments: list[str], words: str) -> None:
    result = CliRunner().invoke(command, arguments)
    assert isinstance(result.exception, UsageError)
    assert words in str(result.exception)
