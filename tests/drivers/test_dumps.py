"""Captures in another form than raw bytes: named, with the program that undoes it."""

import base64
import gzip
import random
from pathlib import Path

import pytest

from drivers.errors import CaptureError
from drivers.playback import raw_items, refuse_dump

RAW = random.Random(1).randbytes(4000)


def xxd(data: bytes) -> bytes:
    rows = [data[at : at + 16] for at in range(0, len(data), 16)]
    return "".join(f"{16 * n:08x}: {row.hex(' ', 2)}  {'.' * len(row)}\n" for n, row in enumerate(rows)).encode()


FORMS = {
    "gzip": (gzip.compress(RAW), "gunzip"),
    "a hex dump": (xxd(RAW), "xxd -r "),
    "hexadecimal digits": (RAW.hex().encode(), "xxd -r -p"),
    "hexadecimal digits with commas": (RAW.hex(",").upper().encode(), "xxd -r -p"),
    "base64": (base64.encodebytes(RAW), "base64 -d"),
}


@pytest.mark.parametrize("name", FORMS)
def test_a_dump_is_refused_with_what_undoes_it(tmp_path: Path, name: str) -> None:
    data, program = FORMS[name]
    path = tmp_path / "capture.bin"
    path.write_bytes(data)
    with pytest.raises(CaptureError, match=program):
        raw_items(path, 0)


@pytest.mark.parametrize(
    "data", [RAW, b"$STAR,0,123456,17,50.0,0,21.25,2,512.25,300.50,2100*0A\r\n" * 9, b"\0" * 500, b""]
)
def test_raw_bytes_and_lines_of_text_are_none(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "capture.bin"
    path.write_bytes(data)
    refuse_dump(path)
