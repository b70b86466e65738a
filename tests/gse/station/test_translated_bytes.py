"""Bytes that were taken out or translated on their way, by the marks that this leaves."""

import random

import pytest

from gse.station.byte_stream import ByteMarks
from protocols import load_protocol

PROTOCOL = load_protocol("panorama-v1")


def said(data: bytes, *, pieces: int = 1, protocol: str = "panorama-v1") -> str:
    marks = ByteMarks(load_protocol(protocol))
    size = -(-len(data) // pieces)
    for at in range(0, len(data), max(size, 1)):
        marks.feed(data[at : at + size])
    return marks.said()


DONE = {
    "XON/XOFF": lambda data: data.translate(None, b"\x11\x13"),
    "onlcr": lambda data: data.replace(b"\n", b"\r\n"),
    "icrnl": lambda data: data.replace(b"\r", b"\n"),
    "inlcr": lambda data: data.replace(b"\n", b"\r"),
    "telnet": lambda data: data.replace(b"\xff", b"\xff\xff"),
}


@pytest.mark.parametrize("pieces", [1, 700, 9000])
@pytest.mark.parametrize("name", DONE)
def test_what_was_done_to_the_bytes_is_named_however_they_are_cut(name: str, pieces: int) -> None:
    assert name in said(DONE[name](random.Random(1).randbytes(9000)), pieces=pieces)


@pytest.mark.parametrize("seed", range(20))
def test_untouched_bytes_say_nothing(seed: int) -> None:
    assert said(random.Random(seed).randbytes(6000)) == ""


def test_few_bytes_and_lines_of_text_say_nothing() -> None:
    assert said(DONE["XON/XOFF"](random.Random(1).randbytes(1000))) == ""
    assert said(DONE["onlcr"](random.Random(1).randbytes(9000)), protocol="text-lines") == ""
