"""Messages: round trips, odd values, values that do not fit."""

import math
import struct
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols import (
    Ack,
    AttitudeMessage,
    Command,
    EncodeError,
    Frame,
    FrameDecoder,
    Message,
    Nak,
    Other,
    PanoramaMessage,
    Protocol,
    StatusMessage,
    load_protocol,
    parse_protocol,
)
from protocols.codec import LARGEST_TIME_US

PIXEL = load_protocol("panorama-v1")
SUBPIXEL = load_protocol("panorama-v1-subpixel")
SLIP = load_protocol("panorama-slip")
ALL = [PIXEL, SUBPIXEL, SLIP]
every = pytest.mark.parametrize("protocol", ALL, ids=lambda p: p.name)

BITS = ["overexposed", "detector fault", "memory fault", "clock reset", "bit 5"]
U16, U32 = st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1)
COMMANDS = st.sampled_from(["PING", "START", "STOP", "REQUEST", "SET_EXPOSURE", "value 7"])
TIMES = st.integers(0, LARGEST_TIME_US)


def there_and_back(protocol: Protocol, message: Message, sequence: int = 0) -> Message:
    [frame] = FrameDecoder(protocol).feed(protocol.encode(message, sequence))
    assert isinstance(frame, Frame)
    return protocol.decode(frame)


def panoramas(steps_per_px: int, slots: int) -> st.SearchStrategy[PanoramaMessage]:
    position = st.integers(0, 2**16 - 1).map(lambda n: n / steps_per_px)
    objects = st.lists(st.tuples(position, position, st.integers(0, 4096)), max_size=slots)
    return st.builds(
        lambda time_us, frame_no, exposure_us, flags, hundredths, rows: PanoramaMessage(
            time_us,
            frame_no,
            exposure_us / 1e6,
            frozenset(flags),
            hundredths / 100,
            np.array([row[:2] for row in rows], dtype=float).reshape(-1, 2),
            np.array([row[2] for row in rows], dtype=float),
        ),
        TIMES,
        U32,
        U32,
        st.sets(st.sampled_from(BITS)),
        st.integers(-(2**15), 2**15 - 1),
        objects,
    )


@given(panoramas(1, 30), U16)
def test_panoramas_come_back_as_they_were_sent(message: PanoramaMessage, sequence: int) -> None:
    assert there_and_back(PIXEL, message, sequence) == message


@given(panoramas(32, 30))
def test_sub_pixel_panoramas_come_back_as_they_were_sent(message: PanoramaMessage) -> None:
    assert there_and_back(SUBPIXEL, message) == message


@given(st.lists(st.tuples(*[st.floats(0, 4096, width=32)] * 2, st.integers(1, 4096)), max_size=16))
def test_positions_as_floats_come_back_as_they_were_sent(rows: list[tuple[float, float, int]]) -> None:
    xy_px = np.array([row[:2] for row in rows], dtype=float).reshape(-1, 2)
    message = PanoramaMessage(1, 2, 0.0625, frozenset(), 20.0, xy_px, np.array([row[2] for row in rows], dtype=float))
    back = there_and_back(SLIP, message)
    assert isinstance(back, PanoramaMessage)
    assert back.temperature_c == pytest.approx(20.0, abs=0.005)
    assert replace(back, temperature_c=20.0) == message


OTHERS = st.one_of(
    st.builds(
        StatusMessage,
        TIMES,
        U32,
        U32,
        U16,
        U16,
        st.integers(-(2**15), 2**15 - 1).map(lambda n: n / 100),
        U16.map(lambda n: n / 1000),
        st.sampled_from(["standby", "streaming", "value 9"]),
        st.tuples(*[st.integers(0, 255)] * 3),
        U32,
    ),
    st.builds(
        AttitudeMessage,
        TIMES,
        st.integers(0, 360_000_000).map(lambda n: n / 1e6),
        st.integers(-90_000_000, 90_000_000).map(lambda n: n / 1e6),
        st.integers(0, 360_000_000).map(lambda n: n / 1e6),
        U32,
        st.integers(0, 255),
        st.sampled_from(["lost", "acquired"]),
        U32.map(lambda n: n / 1e6),
    ),
    st.builds(Ack, COMMANDS, U16),
    st.builds(Nak, COMMANDS, st.sampled_from(["bad CRC", "unknown", "bad length", "out of range", "value 0"]), U16),
    st.sampled_from([Command("PING"), Command("STOP"), Command("REQUEST")]),
    U32.map(lambda n: Command("START", {"period": n})),
    st.integers(1000, 2_000_000).map(lambda n: Command("SET_EXPOSURE", {"exposure": n})),
)


@given(OTHERS, U16)
def test_every_other_message_comes_back_as_it_was_sent(message: Message, sequence: int) -> None:
    assert there_and_back(PIXEL, message, sequence) == message


@pytest.mark.parametrize("of", [StatusMessage(), AttitudeMessage(1)], ids=lambda of: type(of).__name__)
def test_messages_are_equal_where_neither_has_a_number(of: Message) -> None:
    numbers = {name: float("nan") for name in of.__slots__ if isinstance(getattr(of, name), float)}
    assert numbers
    assert replace(of, **numbers) == of
    for name in numbers:
        assert replace(of, **{name: 0.5}) != of
    assert replace(of, problems=("late",)) != of
    assert of != Ack("START")


@every
@given(data=st.data())
@settings(max_examples=200)
def test_a_valid_frame_of_any_content_is_decoded_without_complaint(protocol: Protocol, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(protocol.types))
    size = protocol.frame_layout.sizes[{n: c for c, n in protocol.frame_layout.names.items()}[name]]
    payload = data.draw(st.binary(min_size=size, max_size=size))
    [frame] = FrameDecoder(protocol).feed(protocol.encode_payload(name, payload, 0))
    assert isinstance(frame, Frame)
    assert frame.payload == payload
    message = protocol.decode(frame)
    assert isinstance(message.problems, tuple)
    assert 0 <= getattr(message, "time_us", 0) <= LARGEST_TIME_US


def payload_of(rows: list[tuple[int, int, int]], count: int, time_us: int = 5) -> bytes:
    head = struct.pack(">QIIHhBB", time_us, 1, 100_000, 0, 2000, count, 0)
    return head + b"".join(struct.pack(">HHH", *row) for row in rows) + bytes(6 * (30 - len(rows)))


def decoded(payload: bytes, protocol: Protocol = PIXEL) -> PanoramaMessage:
    [frame] = FrameDecoder(protocol).feed(protocol.encode_payload("PANORAMA", payload, 0))
    assert isinstance(frame, Frame)
    message = protocol.decode(frame)
    assert isinstance(message, PanoramaMessage)
    return message


def test_more_objects_than_slots_are_a_problem_and_all_slots_are_given() -> None:
    message = decoded(payload_of([(1, 2, 3)] * 30, count=31))
    assert message.problems == ("count is 31, but there are 30 slots",)
    assert message.xy_px.shape == (30, 2)


def test_an_index_over_the_maximum_is_a_problem() -> None:
    message = decoded(payload_of([(1, 2, 4097), (3, 4, 4096)], count=2))
    assert message.problems == ("index is 4097, over the maximum of 4096",)
    assert message.index.tolist() == [4097, 4096]


def test_an_unused_slot_that_is_not_zero_is_a_problem_and_not_an_object() -> None:
    message = decoded(payload_of([(1, 2, 300), (3, 4, 200)], count=1))
    assert message.problems == ("count is 1, but a slot after that is not zero",)
    assert len(message.xy_px) == 1


@pytest.mark.parametrize("count", [0, 1, 2, 30])
def test_any_number_of_objects_in_order_has_no_problem(count: int) -> None:
    message = decoded(payload_of([(1, 2, 3)] * count, count))
    assert message.problems == ()
    assert message.xy_px.shape == (count, 2)
    assert message.index.shape == (count,)


def test_a_clock_of_half_a_million_years_is_a_problem_and_still_fits_nanoseconds() -> None:
    message = decoded(payload_of([], count=0, time_us=2**64 - 1))
    assert message.problems == (f"time is {2**64 - 1}: no sensor clock runs that long",)
    assert message.time_us * 1000 < 2**63


@pytest.mark.parametrize("bits", [0x7F800000, 0xFF800000, 0x7FC00000, 0x7F800001])
def test_floats_that_are_no_numbers_are_problems_not_warnings(bits: int) -> None:
    head = struct.pack("<QIIBBH", 5, 1, bits, 0, 0, 29_000)
    slot = struct.pack("<IfH", bits, 1.0, 5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        message = decoded(head + slot + bytes(150), SLIP)
    assert [problem.split(" is ")[0] for problem in message.problems] == ["exposure", "x"]


def test_an_exposure_out_of_range_is_a_problem_of_the_command() -> None:
    assert there_and_back(PIXEL, Command("SET_EXPOSURE", {"exposure": 2500000})).problems == (
        "exposure is 2500000, over the maximum of 2000000",
    )
    assert there_and_back(PIXEL, Command("SET_EXPOSURE", {"exposure": 500})).problems == (
        "exposure is 500, under the minimum of 1000",
    )
    assert there_and_back(PIXEL, Command("SET_EXPOSURE", {"exposure": 2000000})).problems == ()


PANORAMA = PanoramaMessage(1, 2, 0.1, frozenset(), 20.0, np.array([[1.0, 2.0]]), np.array([9.0]))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"xy_px": np.array([[-1.0, 2.0]])}, "x"),
        ({"xy_px": np.array([[1.0, 65536.0]])}, "y"),
        ({"xy_px": np.array([[math.nan, 2.0]])}, "x"),
        ({"index": np.array([70_000.0])}, "index"),
        ({"index": np.array([1.0, 2.0])}, "2 index values"),
        ({"xy_px": np.zeros((31, 2)), "index": np.zeros(31)}, "31 positions"),
        ({"temperature_c": math.nan}, "temperature"),
        ({"temperature_c": 400}, "temperature"),
        ({"exposure_s": -0.1}, "exposure"),
        ({"time_us": -1}, "time"),
        ({"frame_no": 2**32}, "frame_no"),
        ({"flags": frozenset({"on fire"})}, "on fire"),
        ({"flags": frozenset({"bit 16"})}, "status"),
    ],
)
def test_a_value_that_the_wire_cannot_carry_is_refused_by_name(change: dict[str, object], named: str) -> None:
    with pytest.raises(EncodeError, match=named):
        PIXEL.encode(replace(PANORAMA, **change), 0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("message", "named"),
    [
        (StatusMessage(temperature_c=1, supply_v=1, mode="standby", firmware=(1, 2)), "firmware has 2 numbers"),
        (StatusMessage(temperature_c=1, supply_v=1, mode="asleep", firmware=(1, 2, 3)), "known are standby, streaming"),
        (Ack("JUMP", 1), "known are PING"),
        (Ack("value x", 1), "command"),
        (Command("START", {"period": 5000000000}), "period"),
        (Command("START"), "period"),
        (Other("HEARTBEAT", b""), "no HEARTBEAT"),
    ],
)
def test_a_message_that_the_protocol_cannot_say_is_refused(message: Message, named: str) -> None:
    with pytest.raises(EncodeError, match=named):
        PIXEL.encode(message, 0)


def test_flags_that_the_header_cannot_carry_are_refused() -> None:
    with pytest.raises(EncodeError, match="flags"):
        PIXEL.encode(Command("PING"), 0, flags=256)


def test_the_sequence_number_wraps_as_the_protocol_does() -> None:
    assert PIXEL.encode(Command("PING"), 65536 + 3) == PIXEL.encode(Command("PING"), 3)
    assert SLIP.encode(Command("PING"), 256 + 3) == SLIP.encode(Command("PING"), 3)


def test_positions_are_sent_as_the_nearest_step() -> None:
    message = replace(PANORAMA, xy_px=np.array([[10.51, 20.49]]))
    assert there_and_back(PIXEL, message).xy_px.tolist() == [[11, 20]]  # type: ignore[attr-defined]
    assert there_and_back(SUBPIXEL, message).xy_px.tolist() == [[10.5, 20.5]]  # type: ignore[attr-defined]


def test_panoramas_are_equal_by_value_and_differ_in_each_field() -> None:
    same = replace(PANORAMA, xy_px=PANORAMA.xy_px.copy(), index=PANORAMA.index.copy())
    assert same == PANORAMA
    nameless = replace(PANORAMA, temperature_c=math.nan)
    assert nameless == replace(PANORAMA, temperature_c=float("nan"))
    others = [
        replace(PANORAMA, time_us=9),
        replace(PANORAMA, frame_no=9),
        replace(PANORAMA, exposure_s=9.0),
        replace(PANORAMA, flags=frozenset({"overexposed"})),
        nameless,
        replace(PANORAMA, xy_px=PANORAMA.xy_px + 1),
        replace(PANORAMA, index=PANORAMA.index + 1),
        replace(PANORAMA, problems=("odd",)),
    ]
    assert all(other != PANORAMA for other in others)
    assert PANORAMA != "a panorama"


def test_counts_are_not_multiplied_in_their_own_narrow_type() -> None:
    coarse = parse_protocol("extends: panorama-v1\nscale: 100/3\n", "coarse.yaml")
    message = decoded(payload_of([(60_000, 30_000, 5)], count=1), coarse)
    assert message.xy_px.tolist() == [[1_000_000, 2_000_000]]
