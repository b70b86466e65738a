"""Bytes without a valid frame: another protocol, another baud rate, or no word."""

import random
from importlib.resources import files

import numpy as np
import pytest

from drivers.uart import USUAL_BAUDS, received_at
from gse.station.byte_stream import what_fits
from protocols import PanoramaMessage, load_protocol, parse_protocol

PROTOCOL = load_protocol("panorama-v1")


def frames(name: str, count: int = 20) -> list[bytes]:
    protocol, rng = load_protocol(name), np.random.default_rng(1)
    made = []
    for number in range(count):
        xy_px, index = rng.uniform(0, 1023, (16, 2)), rng.integers(100, 4096, 16).astype(float)
        message = PanoramaMessage(number * 100_000, number, 0.05, frozenset(), 20.0, xy_px, index)
        made.append(protocol.encode(message, number))
    return made


@pytest.mark.parametrize("name", ["panorama-slip", "panorama-v1-subpixel"])
def test_another_protocol_is_named(name: str) -> None:
    assert f"protocol: {name}" in what_fits(b"".join(frames(name)), PROTOCOL, 115200)


@pytest.mark.parametrize("listening", [115200, 230400, 921600])
def test_a_slower_sensor_is_named_with_its_rate_up_to_a_tenth(listening: int) -> None:
    for baud in (baud for baud in USUAL_BAUDS if baud < listening):
        heard = b"".join(received_at(frame, baud, listening) for frame in frames("panorama-v1"))[:4096]
        expected = f"baudrate: {baud} " if 12 * baud > listening else f"fit {listening // 12} or less"
        assert expected in what_fits(heard, PROTOCOL, listening)


@pytest.mark.parametrize("sensor", [230400, 921600])
def test_a_faster_sensor_and_noise_are_left_open(sensor: int) -> None:
    heard = b"".join(received_at(frame, sensor, 115200) for frame in frames("panorama-v1"))
    assert what_fits(heard, PROTOCOL, 115200) == ""
    assert what_fits(random.Random(2).randbytes(4096), PROTOCOL, 115200) == ""
    assert what_fits(b"", PROTOCOL, 115200) == ""


# Limits, by hand


@pytest.mark.parametrize(("count", "words"), [(1, ""), (2, "they are frames of panorama-v1-subpixel: write")])
def test_two_frames_of_another_protocol_are_enough(count: int, words: str) -> None:
    assert what_fits(b"".join(frames("panorama-v1-subpixel", count)), PROTOCOL, 9600).startswith(words)
    assert bool(what_fits(b"".join(frames("panorama-v1-subpixel", count)), PROTOCOL, 9600)) is bool(words)


def test_frames_of_the_protocol_itself_are_no_other_protocol() -> None:
    assert what_fits(b"".join(frames("panorama-slip")), load_protocol("panorama-slip"), 115200) == ""


@pytest.mark.parametrize(
    ("sync_word", "baud", "head"),
    [
        ("EB90", 57600, "9efe00"),  # of three bytes, as a UART of 115200 baud reads it
        ("55AA", 57600, "6666"),  # two bytes are found by chance
        ("0F0F", 9600, "000000"),  # nothing but zeros
    ],
)
@pytest.mark.parametrize("count", [0, 2, 3, 5])
def test_a_head_of_three_bytes_that_comes_three_times_tells_the_rate(
    sync_word: str, baud: int, head: str, count: int
) -> None:
    text = files("protocols").joinpath("panorama-v1.yaml").read_text()
    protocol = parse_protocol(text.replace("1ACFFC1D", sync_word), "a shorter sync word")
    received = received_at(bytes.fromhex(sync_word), baud, 115200)[:-1]
    assert received.hex() == head
    is_told = sync_word == "EB90" and count >= 3
    words = f"wrong baud rate: they fit port.baudrate: {baud} (here 115200)" if is_told else ""
    assert what_fits((received + b"\x01") * count, protocol, 115200) == words


def test_the_rate_is_told_that_explains_most_bytes() -> None:
    """Three heads of 38400 baud and four of 57600: 18 bytes against 20."""
    word = PROTOCOL.frame_layout.sync_word
    slow, fast = (received_at(word, baud, 115200)[:-1] for baud in (38400, 57600))
    assert (len(slow), len(fast)) == (6, 5)
    for slow_heads, fast_heads, baud in ((3, 4, 57600), (4, 4, 38400), (5, 6, 57600)):  # at last as many bytes of each
        mixed = (slow + b"\x01") * slow_heads + (fast + b"\x01") * fast_heads
        assert what_fits(mixed, PROTOCOL, 115200) == f"wrong baud rate: they fit port.baudrate: {baud} (here 115200)"


@pytest.mark.parametrize("baudrate", [9600, 57600, 115200])
def test_sync_words_that_come_as_they_should_are_of_no_other_rate(baudrate: int) -> None:
    word = PROTOCOL.frame_layout.sync_word
    assert what_fits((word + b"\x01") * 9, PROTOCOL, baudrate) == ""


@pytest.mark.parametrize(
    ("sample", "words"),
    [
        (b"\x00", "wrong baud rate: they fit 9600 or less (here 115200)"),
        (b"\x00" * 50, "wrong baud rate: they fit 9600 or less (here 115200)"),
        (b"\x00" * 50 + b"\x01", ""),
        (b"", ""),
    ],
)
def test_nothing_but_zeros_is_a_sensor_that_is_a_dozen_times_slower(sample: bytes, words: str) -> None:
    assert what_fits(sample, PROTOCOL, 115200) == words
