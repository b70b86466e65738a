"""Wire formats in a class of an installed package, here one that a folder on the path holds, as pip leaves it."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from devices.command_line import runner

from protocols import DescriptionError, Frame, FrameDecoder, PanoramaMessage, load_protocol, parse_protocol
from protocols.check import check_protocol

SOURCE = '''
import zlib
from protocols.wire_class import FoundFrame, Skipped

class Packed:
    """AB, a number of bytes, then type, sequence and payload packed by zlib, which has a checksum of its own."""

    longest = 258
    description = """
version: 1
name: packed
byte_order: big
framing: {kind: class, name: packed}
header: [{name: type, type: u8}, {name: sequence, type: u8}]
checksum: {name: none}
messages:
  PANORAMA:
    code: 1
    direction: from sensor
    fields: [{name: time, type: u32, unit: ms}, {name: frame_no, type: u16}, {name: count, type: u8}]
    slots:
      count: count
      most: 30
      fields: [{name: x, type: u16, unit: px}, {name: y, type: u16, unit: px}, {name: index, type: u16}]
  START: {code: 2, direction: to sensor}
"""

    def look(self, data, *, from_sensor):
        if data[0] != 0xAB:
            return Skipped(1, "no sync")
        if len(data) < 2 or len(data) < 2 + data[1]:
            return None
        try:
            plain = zlib.decompress(data[2 : 2 + data[1]])
        except zlib.error:
            return Skipped(1, "bad crc")
        return FoundFrame(2 + data[1], plain[0], plain[2:], plain[1]) if len(plain) >= 2 else Skipped(1, "bad length")

    def make(self, code, payload, sequence, flags):
        packed = zlib.compress(bytes([code, sequence]) + payload)
        return bytes([0xAB, len(packed)]) + packed
'''


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    (tmp_path / "packed_sensor.py").write_text(SOURCE)
    about = tmp_path / "packed_sensor-1.5.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: packed-sensor\nVersion: 1.5\n")
    (about / "entry_points.txt").write_text("[gse.protocols]\npacked = packed_sensor:Packed\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    sys.modules.pop("packed_sensor", None)
    parse_protocol.cache_clear()


def test_frames_of_a_class_are_found_in_noise_and_read_by_its_description(installed: Path) -> None:
    protocol = load_protocol("packed")
    message = PanoramaMessage.empty()
    wire = protocol.encode(message, 259)
    found = FrameDecoder(protocol, from_sensor=True).feed(b"noise" + wire)
    assert [type(item).__name__ for item in found] == ["Discard", "Frame"]
    assert isinstance(found[1], Frame)
    assert (found[1].sequence, found[1].size) == (3, len(wire))
    assert isinstance(protocol.decode(found[1]), PanoramaMessage)


def test_the_kit_finds_the_class_good(installed: Path) -> None:
    assert [of for of in check_protocol(load_protocol("packed")) if not of.holds] == []


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("return bytes([0xAB, len(packed)])", "return bytes([0xAB, len(packed) + 1])", "round trip"),
        ("            return None\n", "            return Skipped(1, 'no sync')\n", "cuts do not matter"),
    ],
)
def test_the_kit_finds_what_a_class_does_wrong(installed: Path, old: str, new: str, name: str) -> None:
    assert old in SOURCE
    (installed / "packed_sensor.py").write_text(SOURCE.replace(old, new))
    failed = [of.name for of in check_protocol(load_protocol("packed")) if not of.holds]
    assert any(of.startswith(name) for of in failed)


def test_a_session_names_the_class_that_it_needs_and_another_version_is_told(installed: Path) -> None:
    text = load_protocol("packed").text
    assert "distribution: packed-sensor" in text
    assert "version: '1.5'" in text
    assert parse_protocol(text, "session").remark == ""
    changed = parse_protocol(re.sub("sha256: .{4}", "sha256: 0000", text), "session")
    assert "recorded with packed-sensor 1.5" in changed.remark
    with pytest.raises(DescriptionError, match=r"packed-sensor 1\.5: install that"):
        parse_protocol(text.replace("name: packed\n  distribution", "name: unpacked\n  distribution"), "session")


def test_an_exception_of_a_class_costs_a_byte_and_no_session(installed: Path) -> None:
    raises = "if data[0] == 0: raise KeyError\n        if data[0] != 0xAB:"
    (installed / "packed_sensor.py").write_text(SOURCE.replace("if data[0] != 0xAB:", raises))
    protocol = load_protocol("packed")
    found = FrameDecoder(protocol, from_sensor=True).feed(bytes(5) + protocol.encode(PanoramaMessage.empty(), 1))
    assert [len(item.data) for item in found if not isinstance(item, Frame)] == [5]


@pytest.mark.parametrize("name", ["panorama-v1", "ccsds-packets", "nsp-polled", "text-lines", "text-objects"])
def test_every_built_in_protocol_passes_the_check(capsys: pytest.CaptureFixture[str], name: str) -> None:
    done = runner(capsys)("protocol", "check", name)
    assert (done.code, "FAILS" in done.out) == (0, False), done.out
