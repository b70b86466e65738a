"""A protocol of floats, with frames whose fields hold what is not a number of theirs."""

import math
import struct

from protocols import parse_protocol

FIELDS = ("time", "frame_no", "exposure", "temperature", "y", "x", "index")
DESCRIPTION = """\
version: 1
name: floats
byte_order: little
framing: {kind: sync, sync_word: "A5 5A"}
header:
  - {name: type, type: u8}
  - {name: sequence, type: u16}
checksum: {name: crc32}
messages:
  PANORAMA:
    code: 1
    direction: from sensor
    fields:
      - {name: time, type: f64, unit: us}
      - {name: frame_no, type: u32}
      - {name: exposure, type: f64, unit: s}
      - {name: temperature, type: f64, unit: degC}
    slots:
      repeat: 2
      fields:
        - {name: y, type: f64, unit: px}
        - {name: x, type: f64, unit: px}
        - {name: index, type: f64}
"""
NUMBERS = {
    "NaN": math.nan,
    "signalling NaN": struct.unpack("<d", bytes.fromhex("010000000000f07f"))[0],
    "inf": math.inf,
    "-inf": -math.inf,
    "-0": -0.0,
    "denormal": 5e-324,
    "largest": 1.7976931348623157e308,
}
PROTOCOL = parse_protocol(DESCRIPTION, "floats.yaml")


def frame(number: int, **odd: float) -> bytes:
    """A frame whose fields are in order but for the odd ones."""
    values = {"time": 1e5 * number, "exposure": 0.05, "temperature": 20.0, "y": 10.0, "x": 20.0, "index": 100.0, **odd}
    payload = struct.pack("<d", values["time"]) + struct.pack("<I", number)
    payload += struct.pack("<dd", values["exposure"], values["temperature"])
    payload += struct.pack("<ddd", values["y"], values["x"], values["index"]) + struct.pack("<ddd", 30, 40, 50)
    return PROTOCOL.encode_payload("PANORAMA", payload, number)


def cases() -> list[tuple[str, str, bytes]]:
    """Each number in each field of floats."""
    odd = [(field, name) for field in FIELDS if field != "frame_no" for name in NUMBERS]
    return [(field, name, frame(place, **{field: NUMBERS[name]})) for place, (field, name) in enumerate(odd, start=1)]
