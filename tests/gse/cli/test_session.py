"""gse session: info, verify, recover, trim, export, import."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from devices.command_line import runner

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import CaptureError
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX, RecordedMessage
from drivers.session_file.writer import CaptureWriter
from gse.cli.session import command
from gse.config.station import BUILT_IN_TEXT
from gse.errors import UsageError
from protocols import PanoramaMessage, load_protocol

START_NS = 1_774_000_000_000_000_000  # 2026-03-20T09:46:40Z
FRAMES = 20


def panorama(number: int) -> PanoramaMessage:
    return PanoramaMessage(
        time_us=1_000_000 + number * 100_000,
        frame_no=number,
        exposure_s=0.1,
        flags=frozenset({"overexposed"}) if number == 3 else frozenset(),
        temperature_c=20.5,
        xy_px=np.array([[10.0 + number, 20.0], [30.0, 40.0]]) if number else np.empty((0, 2)),
        index=np.array([400.0, 300.0]) if number else np.empty(0),
    )


@pytest.fixture
def session(tmp_path: Path) -> Path:
    protocol = load_protocol("panorama-v1")
    path = tmp_path / "session.mcap"
    with CaptureWriter(path) as writer:
        writer.attach("station.yaml", "application/yaml", BUILT_IN_TEXT.encode())
        writer.attach("protocol.yaml", "application/yaml", protocol.text.encode())
        writer.event(LinkEvent(START_NS, 0, "OPENED", "here we go"))
        for number in range(FRAMES):
            stamp_ns = number * 100_000_000
            writer.rx(Chunk(START_NS + stamp_ns, stamp_ns, protocol.encode(panorama(number), number)))
    return path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


def rx_bytes(path: Path) -> bytes:
    return b"".join(r.data for r in read_capture(path) if isinstance(r, RecordedMessage) and r.topic == RX)


def test_info_says_what_stands_in_a_session(session: Path) -> None:
    document = json.loads(run("info", session, "--json").stdout)
    assert document["schema"] == "gse.session/1"
    assert (document["closed"], document["whole"], document["seconds"]) == (True, True, 1.9)
    assert (document["start"], document["rx_bytes"]) == ("2026-03-20T09:46:40.000000Z", FRAMES * 216)
    assert document["attachments"] == ["station.yaml", "protocol.yaml"]
    assert document["events"] == {"OPENED": 1}
    assert f"rx_bytes     {FRAMES * 216}" in run("info", session.parent).stdout


def test_verify_is_content_with_a_whole_session_and_not_with_another(session: Path) -> None:
    assert run("verify", session).exit_code == 0
    content = bytearray(session.read_bytes())
    content[len(content) // 2] ^= 4
    session.write_bytes(content[:-100])
    result = run("verify", session)
    assert result.exit_code == 3
    assert "cut off" in result.stdout
    assert "message with a wrong checksum" in result.stdout
    document = json.loads(run("verify", session, "--json").stdout)
    assert not document["whole"]
    assert document["files"][0]["damages"][0]["bytes"] == 247  # one message of 216 bytes with its head


def test_recover_makes_a_new_session_of_every_whole_record(session: Path) -> None:
    protocol = load_protocol("panorama-v1")
    content = bytearray(session.read_bytes())
    content[content.index(protocol.encode(panorama(7), 7)) + 50] ^= 1
    session.write_bytes(content)
    result = run("recover", session)
    recovered = session.with_name("session.recovered.mcap")
    assert result.exit_code == 3
    assert f"{FRAMES} messages with {(FRAMES - 1) * 216} received bytes" in result.stdout
    assert rx_bytes(recovered) == rx_bytes(session)
    assert run("verify", recovered).exit_code == 0
    assert isinstance(run("recover", session).exception, CaptureError)  # never overwritten


def test_recovering_a_whole_session_loses_nothing(session: Path, tmp_path: Path) -> None:
    assert run("recover", session, "-o", tmp_path / "copy.mcap").exit_code == 0
    assert list(read_capture(tmp_path / "copy.mcap")) == list(read_capture(session))


def test_trim_keeps_a_part_and_all_attachments(session: Path) -> None:
    span = ["--from", "2026-03-20T09:46:40.500Z", "--to", "2026-03-20T09:46:41Z"]
    assert run("trim", session, *span).exit_code == 0
    trimmed = session.with_name("session.trimmed.mcap")
    assert rx_bytes(trimmed) == rx_bytes(session)[5 * 216 : 10 * 216]
    assert json.loads(run("info", trimmed, "--json").stdout)["attachments"] == ["station.yaml", "protocol.yaml"]
    assert isinstance(run("trim", session).exception, UsageError)
    assert isinstance(run("trim", session, "--from", "noon").exception, UsageError)


def test_a_part_that_holds_nothing_is_not_written(session: Path) -> None:
    result = run("trim", session, "--from", "2030-01-01T00:00:00Z", "-o", session.with_name("none.mcap"))
    assert "holds nothing from 2030-01-01T00:00:00Z to its end" in str(result.exception)
    assert not session.with_name("none.mcap").exists()


def test_csv_has_a_line_for_each_object(session: Path) -> None:
    rows = list(csv.DictReader(io.StringIO(run("export", session, "--format", "csv").stdout)))
    assert len(rows) == 1 + 2 * (FRAMES - 1)
    assert (rows[0]["frame_no"], rows[0]["object"], rows[0]["x_px"]) == ("0", "", "")
    assert (rows[5]["flags"], rows[5]["x_px"], rows[5]["y_px"], rows[5]["index"]) == (
        "overexposed",
        "13.00000",
        "20.00000",
        "400",
    )
    assert rows[1]["utc"].startswith("2026-03-20T09:46:40.0")


def test_ndjson_has_a_line_for_each_record(session: Path, tmp_path: Path) -> None:
    out = tmp_path / "night.ndjson"
    assert run("export", session, "--format", "ndjson", "-o", out).exit_code == 0
    documents = [json.loads(line) for line in out.read_text().splitlines()]
    assert [document.get("attachment") for document in documents[:2]] == ["station.yaml", "protocol.yaml"]
    assert documents[2]["json"] == {"kind": "OPENED", "text": "here we go"}
    assert bytes.fromhex("".join(d["hex"] for d in documents[3:])) == rx_bytes(session)
    assert isinstance(run("export", session, "--format", "ndjson", "-o", out).exception, UsageError)


def test_raw_gives_the_received_bytes(session: Path, tmp_path: Path) -> None:
    assert run("export", session, "--format", "raw", "-o", tmp_path / "night.bin").exit_code == 0
    assert (tmp_path / "night.bin").read_bytes() == rx_bytes(session)


@pytest.mark.parametrize("words", [["info"], ["verify"], ["recover"], ["export", "--format", "csv"]])
def test_a_missing_or_foreign_file_is_told_in_words(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "foreign.mcap").write_bytes(b"something else entirely")
    for name in ("missing.mcap", "foreign.mcap"):
        error = run(*words, tmp_path / name).exception
        assert isinstance(error, CaptureError)
        assert "session" in str(error) or "recording" in str(error)


def test_an_imported_capture_gives_the_report_of_the_capture_itself(tmp_path, capsys):
    gse = runner(capsys)
    protocol = load_protocol("panorama-v1")
    messages = [replace(PanoramaMessage.empty(), time_us=5_000_000 + 100_000 * n, frame_no=n) for n in range(40)]
    capture = tmp_path / "night.bin"
    capture.write_bytes(b"".join(protocol.encode(message, n) for n, message in enumerate(messages)))
    start = ("--start-utc", "2026-03-20T15:00:00Z", "--clock-error", "10ms")
    done = gse("session", "import", capture, *start)
    session = tmp_path / "night.mcap"
    assert (done.code, done.out.strip()) == (0, str(session))
    gse("replay", capture, *start, "--out", tmp_path / "a")
    gse("replay", session, "--out", tmp_path / "b")
    [mine], [theirs] = ([json.loads(path.read_text()) for path in (tmp_path / of).glob("*/report.json")] for of in "ab")
    assert mine == theirs
    again = gse("session", "import", capture, *start)
    assert (again.code, "exists; nothing is overwritten" in again.err) == (2, True)
    again = gse("session", "import", session, *start)
    assert (again.code, "is a session already" in again.err) == (2, True)
