"""The receiver rules: every byte framed or discarded with its reason, however the stream is cut."""

import random
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import protocols
from protocols import (
    REASONS,
    Ack,
    Command,
    Discard,
    Frame,
    FrameDecoder,
    Protocol,
    StatusMessage,
    load_protocol,
    parse_protocol,
)
from protocols.delimiter import Delimiter
from protocols.frame import MAX_DISCARD_BYTES

SYNC = load_protocol("panorama-v1")
SLIP = load_protocol("panorama-slip")


def framed(name: str, base: str, framing: str) -> Protocol:
    """A built-in protocol in another framing."""
    return parse_protocol(f"extends: {base}\nname: {name}\nframing: {{{framing}}}\n", f"{name}.yaml")


HDLC = framed("hdlc", "panorama-slip", "kind: hdlc")
COBS = framed("cobs", "panorama-slip", "kind: cobs")
STUFFED = framed("stuffed", "panorama-slip", 'kind: stuffed, start: "1F7F", end: "1FFF", escape: "1F"')
LENGTH = framed("length", "panorama-v1", "kind: length")
END_WORD = framed("end-word", "panorama-v1", 'kind: sync, sync_word: "1ACFFC1D", end_word: "0D0A"')
PROTOCOLS = [SYNC, SLIP, HDLC, COBS, STUFFED, LENGTH, END_WORD]
both = pytest.mark.parametrize("protocol", PROTOCOLS[:2], ids=lambda p: p.name)
every = pytest.mark.parametrize("protocol", PROTOCOLS, ids=lambda p: p.name)
marked = pytest.mark.parametrize("protocol", [p for p in PROTOCOLS if p is not COBS], ids=lambda p: p.name)
"""One 00 stands between two COBS frames: where it is lost, so are both."""

MARKS = {
    SYNC.name: b"\x1a\xcf\xfc\x1d",
    SLIP.name: b"\xc0\xdb\xdc\xdd",
    HDLC.name: b"\x7e\x7d\x5e\x5d",
    COBS.name: b"\x00\x01\x02\xff",
    STUFFED.name: b"\x1f\x7f\x1f\xff",
    LENGTH.name: b"\x01\x00\x00\xca",
    END_WORD.name: b"\x1a\xcf\xfc\x1d\x0d\x0a",
}
"""Bytes that mean something to the framing: what a test of it must throw in."""


def decode(protocol: Protocol, *pieces: bytes) -> list[Frame | Discard]:
    """All that a stream in these pieces gives, its accounting checked at every moment."""
    decoder = FrameDecoder(protocol)
    found: list[Frame | Discard] = []
    for piece in pieces:
        found += decoder.feed(piece)
        assert decoder.bytes_in == decoder.bytes_framed + decoder.bytes_discarded + decoder.pending
        assert decoder.pending <= 2 * protocol.frame_layout.largest + 2 * MAX_DISCARD_BYTES
    found += decoder.finish()
    assert decoder.pending == 0
    assert decoder.bytes_in == decoder.bytes_framed + decoder.bytes_discarded == sum(map(len, pieces))
    return found


def frames(found: Iterable[Frame | Discard]) -> list[Frame]:
    return [item for item in found if isinstance(item, Frame)]


def reasons(found: Iterable[Frame | Discard]) -> list[str]:
    return [item.reason for item in found if isinstance(item, Discard)]


def panorama(protocol: Protocol, sequence: int, fill: int = 7) -> bytes:
    sizes = protocol.frame_layout.sizes
    size = sizes[0x01 if 0x01 in sizes else 0x21]
    return protocol.encode_payload("PANORAMA", bytes([fill]) * size, sequence)


def cut(data: bytes, cuts: Iterable[int]) -> list[bytes]:
    edges = [0, *sorted(c % (len(data) + 1) for c in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


def stream_of(protocol: Protocol) -> st.SearchStrategy[bytes]:
    """Whole frames, broken frames, noise, and bytes that mean something to the framing, in any order."""
    mark = MARKS[protocol.name]
    frame = st.builds(
        lambda n, fill: panorama(protocol, n, fill), st.integers(0, 255), st.sampled_from([0, 7, mark[0]])
    )
    small = st.integers(0, 255).map(lambda n: protocol.encode(Command("PING"), n))
    broken = st.builds(lambda f, at: f[: at % len(f)], frame, st.integers(0, 300))
    flipped = st.builds(
        lambda f, at, bit: flip(f, at % len(f), 1 << bit), frame, st.integers(0, 300), st.integers(0, 7)
    )
    marks = st.lists(st.sampled_from([bytes([b]) for b in mark] + [mark]), max_size=12).map(b"".join)
    noise = st.binary(max_size=60)
    long = st.binary(min_size=1, max_size=4).map(lambda b: b * 1500)
    return st.lists(st.one_of(frame, small, broken, flipped, marks, noise, long), max_size=8).map(b"".join)


def flip(data: bytes, at: int, mask: int) -> bytes:
    return data[:at] + bytes([data[at] ^ mask]) + data[at + 1 :]


@every
@given(data=st.data())
@settings(max_examples=50)
def test_every_byte_is_in_exactly_one_frame_or_discard_in_order(protocol: Protocol, data: st.DataObject) -> None:
    stream = data.draw(stream_of(protocol))
    at = 0
    for item in decode(protocol, stream):
        assert item.start == at
        if isinstance(item, Frame):
            at += item.size
        else:
            assert item.reason in REASONS
            assert 0 < len(item.data) <= MAX_DISCARD_BYTES
            assert item.data == stream[at : at + len(item.data)]
            at += len(item.data)
    assert at == len(stream)


@every
@given(data=st.data(), cuts=st.lists(st.integers(0, 20_000), max_size=30))
@settings(max_examples=70)
def test_cuts_change_neither_frames_nor_discards(protocol: Protocol, data: st.DataObject, cuts: list[int]) -> None:
    stream = data.draw(stream_of(protocol))
    assert decode(protocol, *cut(stream, cuts)) == decode(protocol, stream)


@every
@given(data=st.data())
@settings(max_examples=20, deadline=None)
def test_what_is_found_says_with_which_byte_it_was_known(protocol: Protocol, data: st.DataObject) -> None:
    """Byte for byte it comes with that one; what comes at the end of the stream, with the last one."""
    stream = data.draw(stream_of(protocol))
    decoder = FrameDecoder(protocol)
    came = [(item, n + 1) for n in range(len(stream)) for item in decoder.feed(stream[n : n + 1])]
    came += [(item, len(stream)) for item in decoder.finish()]
    assert [(item, item.known_at) for item in decode(protocol, stream)] == came


@every
def test_one_byte_at_a_time_gives_the_same_as_all_at_once(protocol: Protocol) -> None:
    noise = random.Random(3).randbytes(9_000)
    stream = noise + panorama(protocol, 1) + noise[:50] + panorama(protocol, 2)[:-1]
    assert decode(protocol, *(bytes([b]) for b in stream)) == decode(protocol, stream)


@every
def test_who_reads_as_many_bytes_as_are_wanted_has_the_frame_and_none_of_the_next(protocol: Protocol) -> None:
    decoder, frame, read = FrameDecoder(protocol), panorama(protocol, 1), 0
    stream = frame + panorama(protocol, 2)
    found: list[Frame | Discard] = []
    while not found:
        piece = stream[read : read + decoder.wanted]
        read += len(piece)
        found = decoder.feed(piece)
    assert (read, [item.size for item in frames(found)]) == (len(frame), [len(frame)])


@every
def test_frames_in_noise_are_all_found(protocol: Protocol) -> None:
    noise = random.Random(1)
    sent = [panorama(protocol, n) for n in range(200)]
    stream = b"".join(noise.randbytes(noise.randrange(300)) + MARKS[protocol.name][:1] + frame for frame in sent)
    found = frames(decode(protocol, stream))
    assert [f.sequence for f in found if f.type == "PANORAMA"] == list(range(200))


@every
def test_frames_of_both_directions_are_told_apart_by_their_type(protocol: Protocol) -> None:
    sent = [
        StatusMessage(supply_v=5, temperature_c=20, mode="standby", firmware=(1, 0, 0)),
        Command("PING"),
        Ack("PING", 4),
    ]
    found = frames(decode(protocol, *(protocol.encode(message, n) for n, message in enumerate(sent))))
    assert [(f.type, f.sequence) for f in found] == [("STATUS", 0), ("PING", 1), ("ACK", 2)]


@marked
@given(at=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_one_flipped_bit_costs_one_frame_at_most(protocol: Protocol, at: int, bit: int) -> None:
    sent = [panorama(protocol, n, fill=n) for n in range(5)]
    stream = b"".join(sent)
    found = frames(decode(protocol, flip(stream, at % len(stream), 1 << bit)))
    whole = {f.sequence: f.payload for f in found}
    assert len(found) >= 4
    assert all(whole[n] == frames(decode(protocol, sent[n]))[0].payload for n in whole)


@both
@given(at=st.integers(0, 10_000), inserted=st.binary(max_size=1))
def test_one_byte_more_or_less_costs_one_frame_at_most(protocol: Protocol, at: int, inserted: bytes) -> None:
    stream = b"".join(panorama(protocol, n) for n in range(5))
    at %= len(stream)
    changed = stream[:at] + (inserted + stream[at:] if inserted else stream[at + 1 :])
    assert len(frames(decode(protocol, changed))) >= 4


def damaged(rng: random.Random, frame: bytes) -> bytes:
    """A frame with one byte changed, dropped, doubled or inserted, or a burst of noise in it or before it."""
    at = rng.randrange(len(frame))
    match rng.choice(["change", "drop", "double", "insert", "burst", "noise"]):
        case "change":
            return flip(frame, at, rng.randrange(1, 256))
        case "drop":
            return frame[:at] + frame[at + 1 :]
        case "double":
            return frame[: at + 1] + frame[at:]
        case "insert":
            return frame[:at] + rng.randbytes(1) + frame[at:]
        case "burst":
            return frame[:at] + rng.randbytes(20) + frame[at + 20 :]
    return rng.randbytes(40) + frame


@marked
def test_faults_cost_the_frames_that_they_hit_and_nothing_false_is_accepted(protocol: Protocol) -> None:
    rng = random.Random(7)
    sent = [panorama(protocol, n, fill=rng.randrange(256)) for n in range(2000)]
    hit = [rng.random() < 0.1 for _ in sent]
    stream = b"".join(damaged(rng, frame) if bad else frame for frame, bad in zip(sent, hit, strict=True))
    found = frames(decode(protocol, *cut(stream, [rng.randrange(len(stream)) for _ in range(500)])))
    payloads = {frames(decode(protocol, frame))[0].payload for frame in sent}
    assert {frame.payload for frame in found} <= payloads
    assert len(sent) - sum(hit) <= len(found) <= len(sent)


def test_a_frame_inside_a_broken_frame_is_found() -> None:
    inner = SYNC.encode(Command("PING"), 9)
    outer = panorama(SYNC, 1)
    stream = flip(outer[:50] + inner + outer[50 + len(inner) :], 20, 1)
    found = decode(SYNC, stream)
    assert [f.type for f in frames(found)] == ["PING"]
    assert reasons(found) == ["bad crc", "no sync"]


def test_a_frame_inside_a_truncated_frame_is_found_at_the_end() -> None:
    inner = SYNC.encode(Command("PING"), 9)
    found = decode(SYNC, panorama(SYNC, 1)[:100] + inner)
    assert [f.type for f in frames(found)] == ["PING"]
    assert reasons(found) == ["truncated"]


def test_a_frame_that_lost_bytes_does_not_take_the_next_one_with_it() -> None:
    found = decode(SYNC, panorama(SYNC, 1)[:100] + panorama(SYNC, 2) + panorama(SYNC, 3))
    assert [f.sequence for f in frames(found)] == [2, 3]
    assert reasons(found) == ["bad crc"]


def test_a_length_that_the_type_does_not_allow_is_not_believed_and_holds_nothing_up() -> None:
    decoder = FrameDecoder(SYNC)
    long_claim = b"\x1a\xcf\xfc\x1d\x01\x00\x04\x00\x00\x05"
    found = decoder.feed(long_claim + panorama(SYNC, 1))
    assert [type(item) for item in found] == [Discard, Frame]
    assert reasons(found) == ["bad length"]


@both
def test_each_reason_is_given_for_what_it_says(protocol: Protocol) -> None:
    good, type_at = panorama(protocol, 1), 4 if protocol is SYNC else 1
    cases = {
        "no sync": b"hello" + good,
        "unknown type": flip(good, type_at, 0x40) + good,
        "bad length": (flip(good, 7, 1) if protocol is SYNC else good[:50] + good[51:]) + good,
        "bad crc": flip(good, 100, 1) + good,
        "truncated": good + good[:-1],
    }
    for reason, stream in cases.items():
        found = decode(protocol, stream)
        assert reasons(found) == [reason]
        assert len(frames(found)) == 1


def test_one_broken_frame_is_one_discard_of_all_its_bytes() -> None:
    for protocol in PROTOCOLS:
        good = panorama(protocol, 1)
        broken = flip(good, 60, 0x10)
        found = decode(protocol, good + broken + good)
        [discard] = [item for item in found if isinstance(item, Discard)]
        assert (discard.start, discard.data) == (len(good), broken)


def test_the_start_of_a_sync_word_at_the_end_of_the_stream_is_truncated() -> None:
    for begun in (b"\x1a", b"\x1a\xcf", b"\x1a\xcf\xfc"):
        found = decode(SYNC, b"noise" + begun)
        discarded = [(item.reason, item.data) for item in found if isinstance(item, Discard)]
        assert discarded == [("no sync", b"noise"), ("truncated", begun)]


def test_slip_frames_with_one_end_between_them_are_found() -> None:
    stream = b"".join(panorama(SLIP, n)[1:] for n in range(4))
    found = decode(SLIP, stream)
    assert [f.sequence for f in frames(found)] == [0, 1, 2, 3]
    assert reasons(found) == []


def test_frames_that_are_ended_twice_are_found() -> None:
    found = decode(HDLC, b"".join(panorama(HDLC, n)[1:] + b"\x7e" for n in range(4)))
    assert [f.sequence for f in frames(found)] == [0, 1, 2, 3]
    assert [len(item.data) for item in found if isinstance(item, Discard)] == [1]  # the last, which opens no frame


def test_an_end_of_two_bytes_is_refused_with_what_to_do() -> None:
    with pytest.raises(ValueError, match=r"^twice: the end has 2 bytes, expected one; .* packed writes it twice$"):
        Delimiter("twice", b"\x7e\x7e", bytes, bytes, "")


def test_idle_slip_ends_are_one_discard_not_one_each() -> None:
    found = decode(SLIP, panorama(SLIP, 0) + b"\xc0" * 1000 + panorama(SLIP, 1))
    assert reasons(found) == ["no sync"]
    assert len(frames(found)) == 2


def test_a_wrong_slip_escape_is_no_frame_even_if_the_checksum_would_fit() -> None:
    good = panorama(SLIP, 1, fill=0x41)
    found = decode(SLIP, good[:20] + b"\xdb" + good[20:] + good)
    assert reasons(found) == ["bad crc"]


@every
def test_garbage_without_end_is_given_back_in_bounded_pieces(protocol: Protocol) -> None:
    found = decode(protocol, *[b"\x55" * 1000] * 50)
    assert set(reasons(found)) == {"no sync"}
    assert max(len(item.data) for item in found if isinstance(item, Discard)) == MAX_DISCARD_BYTES
    assert len(found) == -(-50_000 // MAX_DISCARD_BYTES)


@both
def test_garbage_after_a_broken_frame_is_no_sync_beyond_the_first_piece(protocol: Protocol) -> None:
    stream = flip(panorama(protocol, 1), 60, 0x10) + b"\x55" * 10_000
    whole, in_pieces = decode(protocol, stream), decode(protocol, *cut(stream, range(0, len(stream), 100)))
    assert whole == in_pieces
    assert reasons(whole)[0] == "bad crc"
    assert set(reasons(whole)[1:]) == {"no sync"}


def test_endless_idle_slip_ends_are_given_back_in_bounded_pieces() -> None:
    found = decode(SLIP, *[b"\xc0" * 1000] * 20, panorama(SLIP, 1))
    assert set(reasons(found)) == {"no sync"}
    assert [f.size for f in frames(found)] == [len(panorama(SLIP, 1))]


def test_a_slip_end_at_the_end_of_a_stream_opens_no_frame_of_the_next() -> None:
    decoder = FrameDecoder(SLIP)
    assert len(decoder.feed(panorama(SLIP, 1) + b"\xc0") + decoder.finish()) == 2
    assert [f.sequence for f in frames(decoder.feed(panorama(SLIP, 2)[1:]))] == [2]


def test_idle_slip_ends_before_garbage_belong_to_it() -> None:
    found = decode(SLIP, b"\xc0" * 3 + b"\x55" * 1000)
    assert [(item.start, len(item.data)) for item in found if isinstance(item, Discard)] == [(0, 1003)]


def test_a_truncated_frame_that_ends_like_a_sync_word_begins_is_one_discard() -> None:
    assert reasons(decode(SYNC, panorama(SYNC, 1)[:100] + b"\x1a\xcf")) == ["truncated"]


def test_the_worst_garbage_costs_no_more_than_a_checksum_per_sync_word() -> None:
    header = b"\x1a\xcf\xfc\x1d\x01\x00\x00\xca\x00\x00"
    found = decode(SYNC, header * 2000)
    assert Counter(reasons(found)) == {"bad crc": 2000 - 21, "truncated": 21}


@every
def test_after_the_end_the_decoder_takes_a_new_stream(protocol: Protocol) -> None:
    decoder = FrameDecoder(protocol)
    first = decoder.feed(panorama(protocol, 1) + b"half" + panorama(protocol, 2)[:40]) + decoder.finish()
    second = decoder.feed(panorama(protocol, 3))
    assert len(frames(first)) == 1
    assert [(f.sequence, f.start) for f in frames(second)] == [(3, decoder.bytes_in - len(panorama(protocol, 3)))]


@pytest.mark.parametrize("noise", [b"\xaa", b"\xaa\xaa", b"\xaa" * 5])
def test_a_frame_is_found_behind_bytes_that_are_those_of_its_sync_word_too(noise: bytes) -> None:
    """AA AA begins in each of AA AA AA: a refused one costs one byte, and the next is looked at."""
    text = (Path(protocols.__file__).parent / "panorama-v1.yaml").read_text(encoding="utf-8")
    protocol = parse_protocol(text.replace('"1ACFFC1D"', '"AAAA"'), "doubled.yaml")
    whole = protocol.encode(Command("PING"), 5)
    (frame,) = frames(decode(protocol, noise + whole))
    assert (frame.start, frame.sequence) == (len(noise), 5)
