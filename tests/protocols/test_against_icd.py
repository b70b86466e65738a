"""Built-in descriptions against frames that are written by hand from the interface control document.

Nothing here uses a description to make a frame: struct and zlib do it, byte by byte as the document says.
"""

import struct
import zlib

import numpy as np
import pytest

from gse.inspection.decode import explain
from protocols import (
    Ack,
    AttitudeMessage,
    Command,
    Discard,
    Frame,
    FrameDecoder,
    Message,
    Nak,
    PanoramaMessage,
    StatusMessage,
    load_protocol,
    parse_protocol,
)


def by_hand(code: int, payload: bytes, sequence: int = 0x1234, flags: int = 0) -> bytes:
    covered = struct.pack(">BBHH", code, flags, len(payload), sequence) + payload
    return b"\x1a\xcf\xfc\x1d" + covered + struct.pack(">I", zlib.crc32(covered))


def panorama_payload(objects: list[tuple[int, int, int]], status: int = 0) -> bytes:
    head = struct.pack(">QIIHhBB", 987_654_321_012, 70_000, 100_000, status, -1234, len(objects), 0)
    slots = objects + [(0, 0, 0)] * (30 - len(objects))
    return head + b"".join(struct.pack(">HHH", *slot) for slot in slots)


OBJECTS = [(1023, 0, 4096), (7, 512, 4095), (0, 1023, 1)]

MESSAGES: list[tuple[int, bytes, Message]] = [
    (
        0x02,
        struct.pack(">QIIHHhHB3BI", 5_000_001, 100, 99, 8, 1, 2150, 12_034, 1, 2, 11, 3, 0xDEADBEEF),
        StatusMessage(5_000_001, 100, 99, 8, 1, 21.5, 12.034, "streaming", (2, 11, 3), 0xDEADBEEF),
    ),
    (
        0x03,
        struct.pack(">QIIiIBBI10x", 6_000_000, 17, 359_999_999, -89_500_001, 180_000_000, 12, 1, 40_000),
        AttitudeMessage(6_000_000, 359.999999, -89.500001, 180.0, 17, 12, "acquired", 0.04),
    ),
    (0x10, bytes([0x82, 0, 0xAB, 0xCD]), Ack("START", 0xABCD)),
    (0x11, bytes([0x85, 4, 0x00, 0x01]), Nak("SET_EXPOSURE", "out of range", 1)),
    (0x81, b"", Command("PING")),
    (0x82, struct.pack(">I", 100), Command("START", {"period": 100})),
    (0x83, b"", Command("STOP")),
    (0x84, b"", Command("REQUEST")),
    (0x85, struct.pack(">I", 2_000_000), Command("SET_EXPOSURE", {"exposure": 2000000})),
]


def only_frame(protocol_name: str, data: bytes) -> Frame:
    [frame] = FrameDecoder(load_protocol(protocol_name)).feed(data)
    assert isinstance(frame, Frame)
    return frame


@pytest.mark.parametrize(("flags", "is_test"), [(0, False), (1, False), (2, True), (3, True), (4, False)])
@pytest.mark.parametrize("name", ["panorama-v1", "panorama-v1-subpixel"])
def test_bit_one_of_the_flags_marks_data_of_no_detector(name: str, flags: int, is_test: bool) -> None:
    frame = only_frame(name, by_hand(0x01, panorama_payload(OBJECTS), flags=flags))
    protocol = load_protocol(name)
    assert protocol.is_test(frame) is is_test
    assert ("test" in protocol.flags_of(frame)) is is_test


@pytest.mark.parametrize("serial", [0, 14014])
@pytest.mark.parametrize("has_flag", [False, True])
def test_a_format_without_room_for_the_flag_says_so_by_the_serial_number_zero(serial: int, has_flag: bool) -> None:
    text = load_protocol("panorama-v1").text
    protocol = parse_protocol(text if has_flag else text.replace("{0: stored, 1: test}", "{0: stored}"), "a file")
    data = by_hand(0x02, struct.pack(">QIIHHhHB3BI", 1, 1, 1, 0, 0, 2150, 5000, 1, 1, 0, 0, serial))
    assert protocol.is_test(only_frame("panorama-v1", data)) is (serial == 0 and not has_flag)


def test_a_panorama_written_byte_by_byte_is_read_as_meant() -> None:
    protocol = load_protocol("panorama-v1")
    data = by_hand(0x01, panorama_payload(OBJECTS, status=0b1001), flags=1)
    assert len(data) == 216
    frame = only_frame("panorama-v1", data)
    assert (frame.start, frame.size, frame.type, frame.flags, frame.sequence) == (0, 216, "PANORAMA", 1, 0x1234)
    assert protocol.flags_of(frame) == {"stored"}
    message = protocol.decode(frame)
    assert isinstance(message, PanoramaMessage)
    assert message.time_us == 987_654_321_012
    assert message.frame_no == 70_000
    assert message.exposure_s == 0.1
    assert message.flags == {"overexposed", "clock reset"}
    assert message.temperature_c == -12.34
    assert message.xy_px.tolist() == [[0, 1023], [512, 7], [1023, 0]]
    assert message.index.tolist() == [4096, 4095, 1]
    assert message.problems == ()
    assert protocol.encode(message, 0x1234, flags=1) == data


def test_the_sub_pixel_twin_reads_the_same_bytes_in_steps_of_a_32nd_of_a_pixel() -> None:
    protocol = load_protocol("panorama-v1-subpixel")
    data = by_hand(0x01, panorama_payload([(32 * 1023 + 31, 33, 4096)]))
    message = protocol.decode(only_frame("panorama-v1-subpixel", data))
    assert isinstance(message, PanoramaMessage)
    assert message.xy_px.tolist() == [[33 / 32, 1023 + 31 / 32]]
    assert message.index.tolist() == [4096]
    assert protocol.encode(message, 0x1234) == data


@pytest.mark.parametrize(("code", "payload", "message"), MESSAGES, ids=[type(m).__name__ for *_, m in MESSAGES])
def test_every_other_message_reads_and_writes_the_bytes_of_the_document(
    code: int, payload: bytes, message: Message
) -> None:
    protocol = load_protocol("panorama-v1")
    data = by_hand(code, payload)
    assert protocol.decode(only_frame("panorama-v1", data)) == message
    assert protocol.encode(message, 0x1234) == data


@pytest.mark.parametrize("from_sensor", [True, False])
@pytest.mark.parametrize("cut", [1, 13, 10_000])
def test_a_message_of_the_other_direction_is_of_an_unknown_type(from_sensor: bool, cut: int) -> None:
    protocol = load_protocol("panorama-v1")
    stream = b"".join(by_hand(code, payload, number) for number, (code, payload, _) in enumerate(MESSAGES))
    decoder = FrameDecoder(protocol, from_sensor=from_sensor)
    pieces = [piece for at in range(0, len(stream), cut) for piece in decoder.feed(stream[at : at + cut])]
    pieces += decoder.finish()
    ours = [number for number, (code, *_) in enumerate(MESSAGES) if (code < 0x80) is from_sensor]
    assert [piece.sequence for piece in pieces if isinstance(piece, Frame)] == ours
    refused = [piece for piece in pieces if isinstance(piece, Discard)]
    assert {piece.reason for piece in refused} == {"unknown type"}
    assert sum(len(piece.data) for piece in refused) + decoder.bytes_framed == len(stream)
    assert "goes the other way" in explain(protocol.frame_layout, refused[0])


def test_what_a_sensor_sends_is_no_frame_in_what_it_is_sent() -> None:
    protocol = load_protocol("panorama-slip")
    data = protocol.encode_payload(next(t for t in protocol.types if protocol.is_from_sensor(t)), bytes(180), 1)
    decoder = FrameDecoder(protocol, from_sensor=False)
    assert not any(isinstance(piece, Frame) for piece in [*decoder.feed(data), *decoder.finish()])


def test_every_type_has_the_length_of_the_document() -> None:
    lengths = {0x01: 202, 0x02: 32, 0x03: 40, 0x10: 4, 0x11: 4, 0x81: 0, 0x82: 4, 0x83: 0, 0x84: 0, 0x85: 4}
    for name in ("panorama-v1", "panorama-v1-subpixel"):
        protocol = load_protocol(name)
        assert dict(protocol.frame_layout.sizes) == lengths
        assert protocol.slots == 30
        assert protocol.sequence_modulus == 65536


def test_the_slip_protocol_reads_a_packet_written_byte_by_byte() -> None:
    protocol = load_protocol("panorama-slip")
    head = struct.pack("<QIfBBH", 1_000_000, 0xC0DB, 100.0, 2, 9, 29_440)
    slots = struct.pack("<ffH", 10.25, 20.5, 4000) + struct.pack("<ffH", 1.5, 2.0, 300) + bytes(14 * 10)
    content = bytes([0x21, 0, 0xDB]) + head + slots
    crc = 0xFFFF
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    content += struct.pack("<H", crc)
    packet = b"\xc0" + b"".join({0xC0: b"\xdb\xdc", 0xDB: b"\xdb\xdd"}.get(b, bytes([b])) for b in content) + b"\xc0"
    frame = only_frame("panorama-slip", packet)
    assert (frame.size, frame.sequence) == (len(packet), 0xDB)
    message = protocol.decode(frame)
    assert isinstance(message, PanoramaMessage)
    assert (message.time_us, message.frame_no, message.exposure_s) == (1_000_000, 0xC0DB, 0.1)
    assert message.flags == {"detector fault"}
    assert message.temperature_c == pytest.approx(21.25, abs=1e-9)
    assert message.xy_px.tolist() == [[10.25, 20.5], [1.5, 2.0]]
    assert message.index.tolist() == [4000, 300]
    assert np.shares_memory(message.xy_px, message.index) is False
