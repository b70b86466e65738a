import json
from pathlib import Path

import numpy as np
import pytest
from devices.command_line import runner

from gse.inspection.unknown_capture import look
from protocols import AttitudeMessage, PanoramaMessage, load_protocol, parse_protocol

FITS = {
    "panorama-v1": ("sync word 1ACFFC1D", "crc32", "big"),
    "panorama-slip": ("slip", "crc16-mcrf4xx", "little"),
    "panorama-slip-xxhash": ("slip", "xxhash32", "little"),
    "attitude-quaternion": ("sync word A5C33C5A", "xxhash32", "big"),
    "nsp-polled": ("slip", "crc16-mcrf4xx", "little"),
    "ccsds-packets": ("CCSDS space packets (kind: length)", "crc16-ccitt-false", "big"),
    "text-lines": ("line, begin $", "xor8", "big"),
}
OTHERS = {
    "kind: cobs": "cobs",
    "kind: hdlc": "hdlc",
    'kind: stuffed, start: "1F7F", end: "1FFF", escape: "1F"': "stuffed, start 1F7F, end 1FFF, escape 1F",
}


def message(rng, number):
    xy_px = rng.uniform(0, 1000, (9, 2)).round()
    index = np.sort(rng.integers(20, 4000, 9))[::-1].astype(float)
    return PanoramaMessage(100_000 * number, number, 0.1, frozenset(), 12.0, xy_px, index)


def attitude(rng, number):
    numbers = rng.normal(size=4)
    q1, q2, q3, q4 = (numbers / np.linalg.norm(numbers)).tolist()
    time_us, state = 100_000 * number, "acquired"
    return AttitudeMessage(time_us=time_us, frame_no=number, q1=q1, q2=q2, q3=q3, q4=q4, state=state, latency_s=0.1)


def capture(folder: Path, name: str, framing: str = "") -> Path:
    """Forty frames with noise before, between and after."""
    rng = np.random.default_rng(4)
    protocol = load_protocol(name)
    if framing:
        protocol = parse_protocol(f"extends: {name}\nname: other\nframing: {{{framing}}}\n", "other.yaml")
    make = attitude if name == "attitude-quaternion" else message
    parts = [rng.bytes(50)]
    for number in range(40):
        parts.append(protocol.encode(make(rng, number), number))
        if number % 10 == 3:
            parts.append(rng.bytes(7))
    path = folder / "capture.bin"
    path.write_bytes(b"".join(parts))
    return path


@pytest.mark.parametrize("name", FITS)
def test_framing_checksum_and_byte_order_of_an_unknown_capture_are_found(tmp_path, name):
    looked = look(capture(tmp_path, name))
    best = looked.fits[0]
    assert (best.framing, best.checksum, best.byte_order) == FITS[name]
    assert best.right >= 30
    assert best.lengths[0][1] >= 30 or name == "text-lines"
    assert looked.built_in[0][0] == name
    assert looked.built_in[0][1] > 0.9


@pytest.mark.parametrize("framing", OTHERS)
def test_every_framing_of_a_description_is_found(tmp_path, framing):
    best = look(capture(tmp_path, "panorama-slip", framing)).fits[0]
    assert (best.framing, best.checksum, best.byte_order) == (OTHERS[framing], "crc16-mcrf4xx", "little")
    assert best.right >= 30


def test_in_noise_nothing_fits(tmp_path):
    path = tmp_path / "noise.bin"
    path.write_bytes(np.random.default_rng(1).bytes(200_000))
    looked = look(path)
    assert (looked.fits, looked.built_in) == ((), ())
    assert "no framing with a known checksum fits" in looked.lines()[-1]


@pytest.mark.parametrize("content", [b"", b"\xc0" * 5000, b"\x1a\xcf\xfc\x1d" * 1000, b"a"])
def test_no_content_is_a_failure(tmp_path, content):
    path = tmp_path / "odd.bin"
    path.write_bytes(content)
    assert look(path).fits == ()


def test_decode_try_says_it_as_text_and_as_json(tmp_path, capsys):
    gse = runner(capsys)
    path = capture(tmp_path, "panorama-slip-xxhash")
    assert "slip, xxhash32 little-endian: right in" in gse("decode", path, "--try").out
    document = json.loads(gse("decode", path, "--try", "--json").out)
    assert (document["schema"], document["fits"][0]["checksum"]) == ("gse.decode.try/1", "xxhash32")
    assert gse("decode", tmp_path / "none.bin", "--try").code == 2
