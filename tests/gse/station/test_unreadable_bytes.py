"""Bytes without a valid frame: another protocol, another baud rate, or no word."""

import random

import numpy as np
import pytest

from drivers.uart import USUAL_BAUDS, received_at
from gse.station.unreadable_bytes import what_fits
from protocols import PanoramaMessage, load_protocol

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
