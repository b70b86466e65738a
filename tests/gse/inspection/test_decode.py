"""``gse decode``: frames and discards in order, explained, with totals that add up."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from drivers.chunk import Chunk
from drivers.session_file.writer import CaptureWriter
from gse.cli import cli
from gse.inspection.decode import Decoding
from protocols import Command, Discard, Frame, PanoramaMessage, StatusMessage, load_protocol

V1 = load_protocol("panorama-v1")
SLIP = load_protocol("panorama-slip")


def panorama(number: int, objects: int = 3) -> bytes:
    xy_px = np.arange(2.0 * objects).reshape(-1, 2)
    index = np.arange(objects, 0, -1.0)
    message = PanoramaMessage(100_000 * number, number, 0.1, frozenset(), 20.0, xy_px, index)
    return V1.encode(message, number)


def flip(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 0x40]) + data[at + 1 :]


STREAM = [
    b"boot\r\n",
    panorama(1),
    flip(panorama(2), 100),
    panorama(3)[:120],
    flip(panorama(4), 6),
    flip(panorama(5), 4),
    panorama(6),
    panorama(6),
    panorama(7)[:50],
]


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    path = tmp_path / "capture.bin"
    path.write_bytes(b"".join(STREAM))
    return path


def decode(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, ["decode", *map(str, arguments)], catch_exceptions=False)


def test_pieces_come_in_order_and_cover_every_byte(capture: Path) -> None:
    decoding = Decoding(capture)
    pieces = [piece.item for piece in decoding]
    assert [piece.start for piece in pieces] == np.cumsum([0, *map(len, STREAM[:-1])]).tolist()
    totals = decoding.totals["rx"]
    assert totals.bytes_in == totals.bytes_framed + totals.bytes_discarded == capture.stat().st_size
    assert totals.frames == {"PANORAMA": 3}
    assert totals.discards == {"no sync": 1, "bad crc": 2, "bad length": 1, "unknown type": 1, "truncated": 1}
    assert (totals.frames_lost, totals.duplicates) == (4, 1)


def test_each_discard_is_shown_with_the_bytes_around_it(capture: Path) -> None:
    stream = capture.read_bytes()
    for piece in Decoding(capture):
        if isinstance(piece.item, Discard):
            start, end = piece.item.start, piece.item.start + len(piece.item.data)
            assert piece.before == stream[max(0, start - 16) : start]
            assert piece.after == stream[end : end + 16]


def test_explain_says_of_each_reject_what_was_expected(capture: Path) -> None:
    result = decode(capture, "--explain")
    assert result.exit_code == 0
    for said in (
        "no frame begins in these 6 bytes",
        "62 6F 6F 74 0D 0A                                boot..",
        "PANORAMA, sequence 2: crc32 is ",
        "PANORAMA, sequence 3: crc32 is wrong; the next sync word comes 96 bytes too early",
        "PANORAMA, sequence 4: the header says 16586 bytes of payload; it has 202",
        "no message has type 41; known are 01, 02, 03, 10, 11, 81",
        "PANORAMA, sequence 7: the stream ends 166 bytes before the frame does",
    ):
        assert said in result.stdout
    assert "1472 bytes in = 648 framed + 824 discarded" in result.stdout
    assert "2 bad crc (336 bytes)" in result.stdout


def test_json_gives_one_object_per_line_and_totals_that_add_up(capture: Path) -> None:
    lines = [json.loads(line) for line in decode(capture, "--json").stdout.splitlines()]
    assert {line["schema"] for line in lines} == {"gse.decode/1"}
    *pieces, totals = lines
    assert totals["kind"] == "totals"
    assert sum(piece["size"] for piece in pieces) == totals["rx"]["bytes_in"] == capture.stat().st_size
    assert b"".join(bytes.fromhex(p["hex"]) for p in pieces if p["kind"] == "discard") == b"".join(
        part for number, part in enumerate(STREAM) if number not in (1, 6, 7)
    )
    first = pieces[1]
    assert (first["type"], first["sequence"], first["message"]["frame_no"]) == ("PANORAMA", 1, 1)
    assert first["message"]["objects"][1] == {"x_px": 2.0, "y_px": 3.0, "index": 2}
    assert pieces[-2]["arrival"] == "duplicate"


def test_discards_alone_leave_out_the_frames(capture: Path) -> None:
    lines = [json.loads(line) for line in decode(capture, "--json", "--discards").stdout.splitlines()]
    assert [line["kind"] for line in lines] == ["discard"] * 6 + ["totals"]


def session(path: Path, protocol_text: str = SLIP.text) -> Path:
    with CaptureWriter(path) as writer:
        writer.attach("protocol.yaml", "application/yaml", protocol_text.encode())
        writer.tx(Chunk(10**18, 0, SLIP.encode(Command("PING"), 4)))
        answer = SLIP.encode(StatusMessage(time_us=5, temperature_c=20.0, supply_v=5.0, mode="standby", serial=9), 0)
        writer.rx(Chunk(10**18 + 2_000_000, 0, answer[:7]))
        writer.rx(Chunk(10**18 + 3_000_000, 0, answer[7:] + answer[:9]))
    return path


def test_a_session_is_decoded_by_its_own_protocol_in_both_directions_with_times(tmp_path: Path) -> None:
    decoding = Decoding(session(tmp_path / "session.mcap"))
    pieces = list(decoding)
    shown = sorted((p.direction, p.item.type if isinstance(p.item, Frame) else p.item.reason, p.utc_ns) for p in pieces)
    assert shown == [
        ("rx", "STATUS", 10**18 + 2_000_000),
        ("rx", "truncated", 10**18 + 3_000_000),
        ("tx", "PING", 10**18),
    ]
    assert decoding.protocol.name == "panorama-slip"
    assert not decoding.is_damaged


def test_a_session_that_lacks_its_end_is_decoded_and_said_so(tmp_path: Path) -> None:
    path = session(tmp_path / "session.mcap")
    path.write_bytes(path.read_bytes()[:-200])
    result = decode(path)
    assert result.exit_code == 3
    assert "is damaged or incomplete" in result.stderr


def test_another_protocol_may_be_asked_for(capture: Path) -> None:
    result = decode(capture, "--protocol", "panorama-slip")
    assert result.exit_code == 0
    assert "0 framed + 1472 discarded" in result.stdout
    assert "the baud rate was wrong" in result.stderr


def test_values_out_of_order_are_said_with_their_frame(tmp_path: Path) -> None:
    path = tmp_path / "capture.bin"
    message = PanoramaMessage(5, 1, 0.1, frozenset({"overexposed"}), 20.0, np.ones((1, 2)), np.array([5000.0]))
    path.write_bytes(V1.encode(message, 1))
    result = decode(path)
    assert "flags overexposed" in result.stdout
    assert "[index is 5000, over the maximum of 4096]" in result.stdout
    assert "frames with values out of order: 1" in result.stdout


def test_a_reader_that_has_had_enough_ends_it_quietly(tmp_path: Path) -> None:
    capture = tmp_path / "long.bin"
    capture.write_bytes(panorama(1) * 2000)
    command = [sys.executable, "-c", "from gse.cli import main; main()", "decode", str(capture)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert b"PANORAMA 1" in process.stdout.readline()
        process.stdout.close()
        assert (process.stderr.read(), process.wait()) == (b"", 0)


def test_a_full_disk_behind_stdout_is_said_in_one_line(capture: Path) -> None:
    command = [sys.executable, "-c", "from gse.cli import main; main()", "decode", str(capture)]
    with open("/dev/full", "wb") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr == "gse: No space left on device: the output is incomplete; free some disk space and repeat\n"


def test_numbers_are_counted_as_the_description_says(tmp_path: Path) -> None:
    packets, path = load_protocol("ccsds-packets"), tmp_path / "packets.bin"
    begin, empty = 2_000_000_000_000_000, PanoramaMessage.empty()  # of CUC time, from 1958 on
    messages = [dataclasses.replace(empty, time_us=begin + n * 100_000, frame_no=n) for n in range(5)]
    status = StatusMessage(time_us=begin, temperature_c=20.0, mode="streaming")
    sent = [packets.encode(message, n) for n, message in enumerate(messages)]
    path.write_bytes(packets.encode(status, 0) + b"".join(sent) + packets.encode(status, 1) + sent[3])
    decoding = Decoding(path, "ccsds-packets")
    assert [piece.arrival.value for piece in decoding if piece.arrival] == ["next"] * 7 + ["duplicate"]
    totals = decoding.totals["rx"]
    assert (totals.duplicates, totals.frames_lost, totals.resets) == (1, 0, 0)


def test_items_are_shown_beside_their_message(tmp_path: Path) -> None:
    description = """\
extends: text-lines
name: lines-with-items
messages:
  STATUS:
    code: STAT
    direction: from sensor
    fields: [{name: time, type: decimal, unit: us}]
    items: [{name: optics_degc, type: decimal, unit: degC}, {name: heater, type: word, values: {0: idle, 1: busy}}]
"""
    (tmp_path / "items.yaml").write_text(description, encoding="utf-8")
    (tmp_path / "lines.txt").write_text("$STAT,7,1000,21.5,busy*21\n", encoding="utf-8")
    shown = decode(tmp_path / "lines.txt", "--protocol", tmp_path / "items.yaml").stdout
    assert "serial 0  optics_degc 21.5, heater busy\n" in shown
    of_json = decode(tmp_path / "lines.txt", "--protocol", tmp_path / "items.yaml", "--json").stdout
    assert json.loads(of_json.splitlines()[0])["items"] == {"optics_degc": 21.5, "heater": "busy"}
