"""Frames in received bytes, with the stamps of the chunk that holds their first byte."""

import hashlib
import random

import numpy as np
import pytest

from drivers.chunk import Chunk
from gse.station.byte_stream import ByteMarks, ByteStream
from gse.station.results import LinkCounters
from protocols import PanoramaMessage, load_protocol

PROTOCOL = load_protocol("panorama-v1")


def frame(number):
    message = PanoramaMessage(
        time_us=number,
        frame_no=number,
        exposure_s=0.1,
        flags=frozenset(),
        temperature_c=20.0,
        xy_px=np.array([[10.0, 20.0]]),
        index=np.array([200.0]),
    )
    return PROTOCOL.encode(message, sequence=number)


def stream():
    counters = LinkCounters()
    return ByteStream(PROTOCOL, counters), counters


def stamps(frames):
    return [(at.frame.sequence, at.utc_ns, at.mono_ns, at.completed_utc_ns) for at in frames]


def test_a_frame_bears_the_stamps_of_its_first_byte_and_the_instant_of_its_last():
    """Cut after its first byte, in its middle, and before its last."""
    one, data = frame(1), frame(2)
    bytes_in, counters = stream()
    assert stamps(bytes_in.feed(Chunk(100, 10, one + data[:1]))) == [(1, 100, 10, 100)]
    assert bytes_in.feed(Chunk(200, 20, data[1:20])) == []
    assert bytes_in.feed(Chunk(300, 30, data[20:-1])) == []
    assert stamps(bytes_in.feed(Chunk(400, 40, data[-1:] + one))) == [(2, 100, 10, 400), (1, 400, 40, 400)]
    assert (counters.frames, counters.bytes_framed) == (3, 2 * len(one) + len(data))


def test_a_frame_that_begins_with_a_chunk_bears_its_stamps():
    bytes_in, _ = stream()
    found = [bytes_in.feed(Chunk(100 * place, place, frame(place))) for place in (1, 2, 3)]
    assert [stamps(one) for one in found] == [[(place, 100 * place, place, 100 * place)] for place in (1, 2, 3)]


def test_frames_that_come_together_bear_the_same_stamps():
    bytes_in, counters = stream()
    assert stamps(bytes_in.feed(Chunk(5, 6, frame(1) + frame(2)))) == [(1, 5, 6, 5), (2, 5, 6, 5)]
    assert (counters.frames, counters.bytes_in) == (2, len(frame(1)) + len(frame(2)))


def test_a_frame_after_noise_bears_the_stamps_of_its_own_first_byte():
    bytes_in, counters = stream()
    noise = b"\x00" * 50
    found = [*bytes_in.feed(Chunk(1, 1, noise)), *bytes_in.feed(Chunk(2, 2, noise + frame(1)))]
    assert stamps(found) == [(1, 2, 2, 2)]
    assert counters.bytes_discarded == 100
    assert sum(counters.discarded_bytes_by_reason.values()) == 100


def test_discards_are_summed_by_their_reason_and_the_latest_reasons_are_those_of_the_latest_chunk():
    bytes_in, counters = stream()
    bytes_in.feed(Chunk(1, 1, b"\x00" * 7 + frame(1)))
    bytes_in.feed(Chunk(2, 2, b"\x00" * 5 + frame(2)))
    ((reason, count),) = counters.discarded_bytes_by_reason.items()
    assert (count, counters.bytes_discarded, bytes_in.latest_reasons) == (12, 12, {0: {reason}})
    bytes_in.feed(Chunk(3, 3, frame(3)))
    assert bytes_in.latest_reasons == {}


def test_a_chunk_of_part_of_a_frame_has_no_reasons_either():
    bytes_in, _ = stream()
    bytes_in.feed(Chunk(1, 1, b"\x00" * 7 + frame(1)))
    bytes_in.feed(Chunk(2, 2, frame(2)[:3]))
    assert bytes_in.latest_reasons == {}


def test_the_hash_is_that_of_all_bytes_once_the_stream_has_ended():
    bytes_in, counters = stream()
    data = frame(1) + b"\x00" * 9 + frame(2)[:11]
    for place in range(0, len(data), 4):
        bytes_in.feed(Chunk(1, 1, data[place : place + 4]))
    assert bytes_in.finish() == []
    assert bytes_in.raw_sha256 == hashlib.sha256(data).hexdigest()
    assert counters.bytes_in == counters.bytes_framed + counters.bytes_discarded == len(data)


def test_stamps_of_decoded_bytes_are_forgotten():
    bytes_in, _ = stream()
    for place in range(30):
        bytes_in.feed(Chunk(place, place, frame(place)))
    assert len(bytes_in._chunks) == 1


def test_a_frame_comes_with_its_last_byte_when_bytes_come_one_by_one():
    bytes_in, _ = stream()
    data = frame(1) + frame(2)
    came = [place for place in range(len(data)) if bytes_in.feed(Chunk(place, place, data[place : place + 1]))]
    assert came == [len(frame(1)) - 1, len(data) - 1]


def test_a_frame_that_a_broken_one_swallowed_bears_the_stamps_of_its_own_first_byte():
    """The begin of a frame, and another frame behind it, which is known once the first has all of its length."""
    whole = frame(2)
    broken = frame(9)[:30]
    until = len(whole) - len(broken)
    bytes_in, counters = stream()
    pieces = [broken, whole[:10], whole[10:until], whole[until:]]
    found = [stamps(bytes_in.feed(Chunk(100 * n, n, piece))) for n, piece in enumerate(pieces, start=1)]
    assert found == [[], [], [], [(2, 200, 2, 400)]]
    assert (counters.bytes_discarded, counters.frames) == (30, 1)


def test_chunks_that_come_together_give_what_they_give_one_by_one():
    """Frames in parts, noise between them, a broken frame that swallows the begin of another."""
    data = frame(1) + b"\x00" * 9000 + frame(2) + frame(3)[:40] + frame(4) + frame(5) + b"\x00" * 7 + frame(6)[:11]
    chunks = [Chunk(100 + n, n, data[place : place + 37]) for n, place in enumerate(range(0, len(data), 37))]
    one_by_one, counters_one = stream()
    expected, reasons = [], {}
    for place, chunk in enumerate(chunks):
        expected += [at._replace(completed_by=place) for at in one_by_one.feed(chunk)]
        if one_by_one.latest_reasons:
            reasons[place] = one_by_one.latest_reasons[0]
    together, counters = stream()
    assert together.feed(*chunks) == expected
    assert together.latest_reasons == reasons
    assert (together.finish(), counters) == (one_by_one.finish(), counters_one)
    assert together.raw_sha256 == one_by_one.raw_sha256
    assert [at.frame.sequence for at in expected] == [1, 2, 4, 5]


def test_no_chunks_give_no_frames():
    bytes_in, counters = stream()
    assert (bytes_in.feed(), bytes_in.finish(), counters.bytes_in) == ([], [], 0)


# What was done to the bytes on the way


def said(data: bytes, *, pieces: int = 1, protocol: str = "panorama-v1") -> str:
    marks = ByteMarks(load_protocol(protocol))
    size = -(-len(data) // pieces)
    for at in range(0, len(data), max(size, 1)):
        marks.feed(data[at : at + size])
    return marks.said()


DONE = {
    "XON/XOFF": lambda data: data.translate(None, b"\x11\x13"),
    "onlcr": lambda data: data.replace(b"\n", b"\r\n"),
    "icrnl": lambda data: data.replace(b"\r", b"\n"),
    "inlcr": lambda data: data.replace(b"\n", b"\r"),
    "telnet": lambda data: data.replace(b"\xff", b"\xff\xff"),
}


@pytest.mark.parametrize("pieces", [1, 700, 9000])
@pytest.mark.parametrize("name", DONE)
def test_what_was_done_to_the_bytes_is_named_however_they_are_cut(name: str, pieces: int) -> None:
    assert name in said(DONE[name](random.Random(1).randbytes(9000)), pieces=pieces)


@pytest.mark.parametrize("seed", range(20))
def test_untouched_bytes_say_nothing(seed: int) -> None:
    assert said(random.Random(seed).randbytes(6000)) == ""


def test_few_bytes_and_lines_of_text_say_nothing() -> None:
    assert said(DONE["XON/XOFF"](random.Random(1).randbytes(1000))) == ""
    assert said(DONE["onlcr"](random.Random(1).randbytes(9000)), protocol="text-lines") == ""
