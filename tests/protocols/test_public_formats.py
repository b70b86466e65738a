"""The built-in public formats against frames written by hand from the byte tables of docs/protocols.md."""

import random
import struct
from dataclasses import replace

import numpy as np
import pytest
from crccheck.crc import Crc16Ibm3740, Crc16Mcrf4XX
from hypothesis import given, settings
from hypothesis import strategies as st
from spacepackets.ccsds.spacepacket import PacketType, SequenceFlags, SpacePacketHeader

from protocols import (
    Ack,
    Command,
    DescriptionError,
    Discard,
    Frame,
    FrameDecoder,
    PanoramaMessage,
    Protocol,
    StatusMessage,
    built_in_names,
    load_protocol,
    parse_protocol,
)
from protocols.parts import MAX_HELD_BYTES

NSP, CCSDS = load_protocol("nsp-polled"), load_protocol("ccsds-packets")
LINES, OBJECTS = load_protocol("text-lines"), load_protocol("text-objects")


def only(protocol: Protocol, data: bytes, *, from_sensor: bool = True) -> Frame:
    decoder = FrameDecoder(protocol, from_sensor=from_sensor)
    [frame] = [*decoder.feed(data), *decoder.finish()]
    assert isinstance(frame, Frame)
    return frame


def found_in(protocol: Protocol, data: bytes, *, echoes: bool = False) -> list[Frame | Discard]:
    decoder = FrameDecoder(protocol, from_sensor=True, echoes=echoes)
    return [*decoder.feed(data), *decoder.finish()]


def reasons(found: list[Frame | Discard]) -> list[str]:
    return [item.type if isinstance(item, Frame) else item.reason for item in found]


def slip(content: bytes) -> bytes:
    return b"\xc0" + b"".join({0xC0: b"\xdb\xdc", 0xDB: b"\xdb\xdd"}.get(b, bytes([b])) for b in content) + b"\xc0"


def nsp(destination: int, source: int, control: int, data: bytes) -> bytes:
    content = bytes([destination, source, control]) + data
    return slip(content + struct.pack("<H", Crc16Mcrf4XX.calc(content)))


NSP_OBJECTS = [(10.25, 192.0, 4000), (1.5, 2.0, 300)]
NSP_DATA = struct.pack("<QIHhBB", 0xC0DB00, 17, 50, -1250, 2, 2) + b"".join(
    struct.pack("<ffH", *row) for row in NSP_OBJECTS
)


def test_an_answer_over_nsp_is_read_and_written_byte_by_byte() -> None:
    data = nsp(0x11, 0x0E, 0xAA, NSP_DATA)
    message = NSP.decode(only(NSP, data))
    assert isinstance(message, PanoramaMessage)
    assert (message.time_us, message.frame_no, message.exposure_s) == (0xC0DB00, 17, 0.05)
    assert (message.temperature_c, message.flags, message.problems) == (-12.5, {"detector fault"}, ())
    assert np.column_stack((message.xy_px, message.index)).tolist() == [list(row) for row in NSP_OBJECTS]
    assert NSP.encode(message, 0) == data


def test_a_request_over_nsp_goes_from_the_host_to_the_sensor() -> None:
    data = nsp(0x0E, 0x11, 0x8A, b"")
    assert NSP.encode(Command("REQUEST"), 0) == data
    assert NSP.decode(only(NSP, data, from_sensor=False)) == Command("REQUEST")


def test_frames_between_others_are_not_for_us_and_our_own_are_echoes() -> None:
    others = nsp(0x11, 0x0F, 0xAA, NSP_DATA) + nsp(0x0F, 0x11, 0x8A, b"") + nsp(0x11, 0x0F, 0xBF, b"odd")
    ours, echo = nsp(0x11, 0x0E, 0xAA, NSP_DATA), nsp(0x0E, 0x11, 0x8A, b"")
    assert reasons(found_in(NSP, others + ours + echo, echoes=True)) == [*["not for us"] * 3, "PANORAMA", "echo"]
    assert reasons(found_in(NSP, others + ours + echo)) == [*["not for us"] * 3, "PANORAMA", "not for us"]
    other_sensor = NSP.with_addresses(0x0F, None)
    assert reasons(found_in(other_sensor, others)) == ["PANORAMA", "not for us", "unknown type"]


def test_a_count_that_the_bytes_do_not_have_is_a_bad_length() -> None:
    short = nsp(0x11, 0x0E, 0xAA, NSP_DATA[:-10])
    many = bytearray(NSP_DATA)
    many[17] = 25
    assert reasons(found_in(NSP, short + nsp(0x11, 0x0E, 0xAA, bytes(many)))) == ["bad length", "bad length"]


@given(
    seconds=st.integers(0, 2**32 - 1),
    fraction=st.integers(0, 2**24 - 1),
    count=st.integers(0, 2**14 - 1),
    rows=st.lists(st.tuples(*[st.integers(0, 2**24 - 1)] * 2, st.integers(0, 2**16 - 1)), max_size=64),
    status=st.integers(0, 15),
)
@settings(max_examples=60)
def test_space_packets_are_those_of_another_library(
    seconds: int, fraction: int, count: int, rows: list[tuple[int, int, int]], status: int
) -> None:
    """spacepackets makes the primary header; the rest is written as the table says."""
    data = bytes([0x10, 3, 25, 0x2F]) + struct.pack(">I", seconds) + fraction.to_bytes(3, "big")
    data += struct.pack(">HI", status << 12 | len(rows), 99) + (50_000).to_bytes(3, "big") + struct.pack(">h", -105)
    data += b"".join(x.to_bytes(3, "big") + y.to_bytes(3, "big") + struct.pack(">H", index) for x, y, index in rows)
    header = SpacePacketHeader(
        PacketType.TM,
        0x120,
        count,
        len(data) + 1,
        True,
        SequenceFlags.UNSEGMENTED,
    )
    packet = bytes(header.pack()) + data
    packet += struct.pack(">H", Crc16Ibm3740.calc(packet))
    frame = only(CCSDS, packet)
    message = CCSDS.decode(frame)
    assert isinstance(message, PanoramaMessage)
    assert (frame.sequence, message.frame_no, message.exposure_s, message.temperature_c) == (count, 99, 0.05, -1.05)
    assert abs(message.time_us - (seconds * 2**24 + fraction) * 10**6 / 2**24) <= 0.5
    assert np.column_stack((message.xy_px * 4096, message.index)).tolist() == [list(map(float, row)) for row in rows]
    assert len(message.flags) == status.bit_count()
    again = only(CCSDS, CCSDS.encode(message, count))
    assert again.payload[:7] + again.payload[11:] == frame.payload[:7] + frame.payload[11:]


def test_space_packets_follow_each_other_with_nothing_between_and_are_found_in_noise() -> None:
    rng = random.Random(3)
    sent = [CCSDS.encode(StatusMessage(time_us=n * 1_000_000, temperature_c=20, mode="standby"), n) for n in range(200)]
    stream = b"".join(rng.randbytes(rng.randrange(3) * 7) + packet for packet in sent)
    found = [item for item in found_in(CCSDS, stream) if isinstance(item, Frame)]
    assert [frame.sequence for frame in found] == list(range(200))


def line(text: str) -> bytes:
    value = 0
    for byte in text.encode():
        value ^= byte
    return f"${text}*{value:02X}\r\n".encode()


def test_a_line_is_read_and_written_as_the_document_has_it() -> None:
    data = line("STAR,0,123456,17,50.0,2,21.25,2,512.25,300.50,2100,17.00,900.75,1800")
    message = LINES.decode(only(LINES, data))
    assert isinstance(message, PanoramaMessage)
    assert (message.time_us, message.frame_no, message.exposure_s) == (123456, 17, 0.05)
    assert (message.temperature_c, message.flags) == (21.25, {"detector fault"})
    assert message.xy_px.tolist() == [[512.25, 300.5], [17, 900.75]]
    assert message.index.tolist() == [2100, 1800]
    assert LINES.encode(message, 10_000) == data
    assert LINES.encode(Command("START", {"period": 100}), 3) == line("START,3,100")
    assert LINES.decode(only(LINES, line("OK,4,START,3"))) == Ack("START", 3)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("STAR,0,123456,17,50.0,0,21.25,2,512.25,300.50,2100,17.00,900.75", "bad length"),
        ("STAR,0,123456,17,50.0,0,21.25,1,512.25,300.50,2100,17.00,900.75,1800", "bad length"),
        ("STAR,0,123456,17,50.0,0,21.25,1,nan,300.50,2100", "bad length"),
        ("STAR,0,12e3,17,50.0,0,21.25,0", "bad length"),
        ("STAR,10000,123456,17,50.0,0,21.25,0", "bad length"),
        ("MOON,0", "unknown type"),
        ("", "bad length"),
    ],
)
def test_a_line_with_something_else_is_discarded(text: str, reason: str) -> None:
    assert reasons(found_in(LINES, line(text))) == [reason]


def test_noise_before_a_line_and_a_wrong_checksum_cost_nothing_else() -> None:
    good = line("STAT,1,5,20.00,standby")
    stream = b"noi$e" + good + good.replace(b"20", b"21") + b"\xff\x00" + good + good[:9]
    assert reasons(found_in(LINES, stream)) == ["no sync", "STATUS", "bad crc", "no sync", "STATUS", "truncated"]


MANY = [(float(n), 2.5 * n, 4000.0 - n) for n in range(12)]


def panorama(frame_no: int, rows: list[tuple[float, float, float]]) -> PanoramaMessage:
    table = np.array(rows).reshape(-1, 3)
    return PanoramaMessage(1000 * frame_no, frame_no, 0.05, frozenset(), float("nan"), table[:, :2], table[:, 2])


def test_a_panorama_in_one_line_per_object_is_one_panorama() -> None:
    data = OBJECTS.encode(panorama(17, MANY), 0)
    assert data.splitlines()[1] == b"OBJ;17;17;50.0;2;12;1.00;2.50;3999"
    found = found_in(OBJECTS, data)
    assert reasons(found) == ["PANORAMA"] + ["PART"] * 11
    assert OBJECTS.decode(found[0]) == panorama(17, MANY)  # type: ignore[arg-type]


@pytest.mark.parametrize("missing", range(12))
def test_a_panorama_that_lacks_a_part_is_lost_and_never_short(missing: int) -> None:
    lines = [OBJECTS.encode(panorama(n, MANY), 0).splitlines(keepends=True) for n in (1, 2, 3)]
    del lines[1][missing]
    stream = b"".join(line for of in lines for line in of)
    found = found_in(OBJECTS, stream)
    assert reasons(found) == ["PANORAMA", *["PART"] * 11, *["part missing"] * 11, "PANORAMA", *["PART"] * 11]
    assert b"".join(item.data for item in found if isinstance(item, Discard)) == b"".join(lines[1])


def test_parts_in_another_order_are_no_panorama() -> None:
    lines = OBJECTS.encode(panorama(1, MANY[:3]), 0).splitlines(keepends=True)
    assert set(reasons(found_in(OBJECTS, lines[1] + lines[0] + lines[2]))) == {"part missing"}


def test_parts_are_held_for_a_while_and_not_for_ever() -> None:
    first = OBJECTS.encode(panorama(1, MANY[:2]), 0).splitlines(keepends=True)[0]
    decoder = FrameDecoder(OBJECTS, from_sensor=True)
    found = decoder.feed(first) + [item for _ in range(300) for item in decoder.feed(b"x" * 3999 + b"\n")]
    assert reasons(found)[0] == "part missing"
    assert decoder.pending < MAX_HELD_BYTES


@pytest.mark.parametrize("name", [name for name in built_in_names() if load_protocol(name).slots])
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_every_byte_of_a_built_in_format_is_accounted_for_however_it_is_cut(name: str, data: st.DataObject) -> None:
    protocol = load_protocol(name)
    some = protocol.encode(
        replace(panorama(5, [(n * 16.0, 32.0 * n, 16.0 * (9 - n)) for n in range(8)]), temperature_c=20.0), 3
    )
    broken = st.builds(
        lambda at, byte: some[: at % len(some)] + byte + some[at % len(some) + 1 :],
        st.integers(0, 999),
        st.binary(max_size=2),
    )
    stream = b"".join(data.draw(st.lists(st.one_of(st.just(some), broken, st.binary(max_size=30)), max_size=5)))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    decoder = FrameDecoder(protocol, from_sensor=True)
    pieces = []
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        pieces += decoder.feed(stream[begin:end])
        assert decoder.bytes_in == decoder.bytes_framed + decoder.bytes_discarded + decoder.pending
    pieces += decoder.finish()
    assert pieces == found_in(protocol, stream)
    assert sum(item.size if isinstance(item, Frame) else len(item.data) for item in pieces) == len(stream)


BITS = """\
version: 1
name: bits
byte_order: {order}
framing: {{kind: sync, sync_word: "EB90"}}
header:
  - {{name: spare, type: u24, mask: 0xF00000, value: 9}}
  - {{name: type, type: u24, mask: 0x0FF000}}
  - {{name: sequence, type: u24, mask: 0x000FFF}}
sequence: {{step: 3, modulus: 4095}}
checksum: {{name: crc24-openpgp, covers: {{from: payload, to: payload}}}}
messages:
  PANORAMA:
    code: 0xA5
    direction: from sensor
    fields:
      - {{name: time, type: u64, unit: us}}
      - {{name: temperature, type: i16, mask: 0x7FF0, unit: degC, scale: 0.5}}
      - {{name: count, type: u16, mask: 0x000F}}
      - {{name: frame_no, type: u24}}
    slots:
      count: count
      most: 15
      fields:
        - {{name: x, type: i24, unit: px, scale: 1/256}}
        - {{name: y, type: u32, mask: 0x0FFF0000, unit: px}}
        - {{name: index, type: u32, mask: 0x0000FFF0}}
"""


@pytest.mark.parametrize("order", ["big", "little"])
@given(
    temperature=st.integers(-1024, 1023),
    frame_no=st.integers(0, 2**24 - 1),
    sequence=st.integers(0, 1364),
    rows=st.lists(st.tuples(st.integers(-(2**23), 2**23 - 1), st.integers(0, 4095), st.integers(0, 4095)), max_size=15),
)
@settings(max_examples=40)
def test_bits_of_words_and_numbers_of_24_bits_stand_where_they_should(
    order: str, temperature: int, frame_no: int, sequence: int, rows: list[tuple[int, int, int]]
) -> None:
    protocol = parse_protocol(BITS.format(order=order), "bits.yaml")
    message = PanoramaMessage(
        77, frame_no, 0.0, frozenset(), temperature / 2,
        np.array([(x / 256, y) for x, y, _ in rows], dtype=float).reshape(-1, 2),
        np.array([index for *_, index in rows], dtype=float),
    )  # fmt: skip
    payload = (77).to_bytes(8, order)  # type: ignore[arg-type]
    payload += ((temperature % 2048) << 4 | len(rows)).to_bytes(2, order)  # type: ignore[arg-type]
    payload += frame_no.to_bytes(3, order)  # type: ignore[arg-type]
    for x, y, index in rows:
        payload += (x % 2**24).to_bytes(3, order) + (y << 16 | index << 4).to_bytes(4, order)  # type: ignore[arg-type]
    head = (9 << 20 | 0xA5 << 12 | 3 * sequence).to_bytes(3, order)  # type: ignore[arg-type]
    data = protocol.encode(message, 3 * sequence)
    assert data[:-3] == b"\xeb\x90" + head + payload
    frame = only(protocol, data)
    assert (frame.sequence, protocol.decode(frame)) == (3 * sequence, message)


def test_a_header_that_is_not_always_the_same_is_of_an_unknown_type() -> None:
    protocol = parse_protocol(BITS.format(order="big"), "bits.yaml")
    data = bytearray(protocol.encode(replace(panorama(1, []), temperature_c=20.0), 0))
    data[2] ^= 0x10
    assert reasons(found_in(protocol, bytes(data))) == ["unknown type"]


def test_a_protocol_without_type_and_checksum_has_one_message_a_direction() -> None:
    text = """\
version: 1
name: bare
byte_order: big
framing: {kind: stuffed, start: "1F7F", end: "1FFF", escape: "1F"}
checksum: {name: none}
messages:
  PANORAMA:
    direction: from sensor
    fields: [{name: time, type: u16, unit: ms}, {name: count, type: u8}]
    slots: {count: count, most: 4, fields: [{name: x, type: u8, unit: px}, {name: y, type: u8, unit: px}]}
  PING: {direction: to sensor}
"""
    protocol = parse_protocol(text, "bare.yaml")
    message = protocol.decode(only(protocol, bytes.fromhex("1F7F 0010 02 1F1F 05 07 08 1FFF".replace(" ", ""))))
    assert isinstance(message, PanoramaMessage)
    assert message.xy_px.tolist() == [[0x1F, 5], [7, 8]]
    assert message.index.tolist() == [2, 1]  # the order of the wire is that of brightness
    assert protocol.encode(Command("PING"), 0) == bytes.fromhex("1F7F1FFF")
    assert reasons(found_in(protocol, bytes.fromhex("1F7F00101F7F0010001FFF"))) == ["bad length", "PANORAMA"]


FIXES = """\
version: 1
name: fixes
byte_order: big
framing: {kind: line}
header: [{name: type, type: word}]
checksum: {name: none}
messages:
  ATTITUDE:
    code: ATT
    direction: from sensor
    fields:
      - {name: time, type: decimal, unit: ms}
      - {name: state, type: word, values: {0: lost, 1: acquired}, words: {FIX: 1, NOFIX: 0, DARK: 0}}
      - {name: ra, type: decimal, unit: h}
      - {name: de, type: decimal, unit: deg}
    items:
      - {name: optics_degc, type: decimal, unit: degC}
"""


SECONDS = """
version: 1
name: seconds
byte_order: big
framing: {kind: line}
header: [{name: type, type: word}]
checksum: {name: none}
messages:
  ATTITUDE:
    code: ATT
    direction: from sensor
    fields:
      - {name: time, type: decimal, unit: s, digits: 3}
      - {name: ra, type: decimal, unit: deg, digits: 1}
      - {name: de, type: decimal, unit: deg, digits: 1}
"""


def test_a_time_of_a_line_may_have_a_point() -> None:
    protocol = parse_protocol(SECONDS, "seconds")
    line = b"ATT,1774018800.007,10.0,20.0\r\n"
    message = protocol.decode(only(protocol, line))
    assert message.time_us == 1_774_018_800_007_000
    assert protocol.encode(message, 0) == line
    assert protocol.decode(only(protocol, b"ATT,12,0,0\n")).time_us == 12_000_000
    without_digits = parse_protocol(SECONDS.replace("unit: s, digits: 3", "unit: s"), "seconds")
    assert "ATTITUDE" not in reasons(found_in(without_digits, line))


def test_fields_between_blanks_may_stand_in_columns() -> None:
    protocol = parse_protocol(SECONDS.replace("{kind: line}", '{kind: line, separator: " "}'), "blanks")
    for line in (b"ATT 12.500 10.0 -20.0\r\n", b"ATT    12.500\t10.0   -20.0 \r\n"):
        message = protocol.decode(only(protocol, line))
        assert (message.time_us, message.ra_deg, message.de_deg) == (12_500_000, 10.0, -20.0)
        assert protocol.encode(message, 0) == b"ATT 12.500 10.0 -20.0\r\n"


def test_words_of_a_line_may_be_others_than_their_names() -> None:
    protocol, lines = parse_protocol(FIXES, "fixes"), "ATT,100,FIX,6,-45.5,21.5\nATT,200,DARK,0,0,21\n"
    frames = [piece for piece in FrameDecoder(protocol).feed(lines.encode()) if isinstance(piece, Frame)]
    assert [protocol.decode(frame).state for frame in frames] == ["acquired", "lost"]
    sent = [protocol.encode(protocol.decode(frame), 0, items=protocol.items_of(frame)) for frame in frames]
    assert b"".join(sent).split(b",")[2::5] == [b"FIX", b"NOFIX"]
    with pytest.raises(DescriptionError, match=r"words: BUSY is 2, and `values` names no such number"):
        parse_protocol(FIXES.replace("DARK: 0", "BUSY: 2"), "fixes")
    with pytest.raises(DescriptionError, match=r"words: a field of the type `word` has them"):
        parse_protocol(FIXES.replace("state, type: word", "state, type: decimal"), "fixes")
