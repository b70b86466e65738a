"""Session and station files from strangers: refused in words or read, in bounded time and memory."""

import json
import os
import re
import resource
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from devices.command_line import Done, Gse
from devices.hostile_sessions import (
    FILES,
    write_file,
    write_flood,
    write_kinds,
    write_station,
    write_steering,
    write_times,
)

from gse.catalog import load_catalog
from gse.config.station import BUILT_IN_TEXT, parse_station, read_station
from gse.errors import CatalogError, ConfigError, TableError, TruthError, UsageError
from gse.imaging.image_file import read_picture
from gse.imaging.panorama_table import read_panorama_table
from gse.report.page import read_page
from gse.sessions.expected_answers import read_answers
from gse.sessions.status_file import is_unfinished
from gse.simulator.scenario import load_scenario
from gse.truth.orientation import read_given
from protocols import load_protocol
from protocols.errors import DescriptionError

CPU_S = 10.0
"""Per MB of input; a small one counts as a MB."""
GROWTH_MIB = 200
"""Of the process that runs the tests: the whole of a command stays below 400 MiB, see benchmarks/faults.py."""
STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\ud800-\udfff]")


def shown(done: Done, folder: Path) -> str:
    """All that a person sees of it, and all that a spreadsheet or a browser reads."""
    texts = [path.read_text(encoding="utf-8") for path in folder.rglob("*") if path.suffix in (".html", ".csv", ".xml")]
    return "\n".join([done.out, done.err, *texts])


@pytest.mark.parametrize("name", FILES)
def test_a_hostile_file_is_read_in_bounded_time_and_memory(tmp_path: Path, gse: Gse, name: str) -> None:
    path = write_file(tmp_path / "session.mcap", name)
    assert path.stat().st_size < 20_000
    before_kib, started_s = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    for command in (("verify",), ("info", "--json"), ("export", "--format", "ndjson", "-o", tmp_path / "x.json")):
        done = gse("session", command[0], path, *command[1:])
        assert done.code in (0, 2, 3)
        assert STEERS.search(done.out + done.err) is None
    assert time.process_time() - started_s < 3 * CPU_S
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < GROWTH_MIB << 10


def test_chunks_that_unpack_to_too_much_are_refused_with_the_budget(tmp_path: Path, gse: Gse) -> None:
    done = gse("session", "verify", write_file(tmp_path / "session.mcap", "90 chunks of zeros"))
    assert done.code == 2
    assert "512 times" in done.err


def test_a_flood_of_events_is_counted_and_not_printed(tmp_path: Path, gse: Gse) -> None:
    path = write_flood(tmp_path / "session.mcap")
    done = gse("report", path, "--plots", "--out", tmp_path / "report")
    assert done.code == 5
    assert len(done.err.splitlines()) < 150
    assert json.loads((tmp_path / "report" / "report.json").read_text())["session"]["events"] == 30_000
    assert (tmp_path / "report" / "report.html").stat().st_size < 2_000_000


@pytest.mark.parametrize("write", [write_times, write_steering, write_kinds])
def test_absurd_times_steering_texts_and_foreign_events_give_a_report_like_any_other(
    tmp_path: Path, gse: Gse, write: Callable[[Path], Path]
) -> None:
    path = write(tmp_path / "session.mcap")
    done = gse("report", path, "--plots", "--out", tmp_path / "report")
    assert done.code in (1, 5)
    assert STEERS.search(shown(done, tmp_path)) is None
    for command in (("info",), ("verify",), ("export", "--format", "csv", "-o", tmp_path / "panoramas.csv")):
        assert gse("session", command[0], path, *command[1:]).code == 0
        assert STEERS.search(shown(done, tmp_path)) is None


@pytest.mark.parametrize(
    "stated",
    ['{"start_utc": 5}', '{"start_utc": null, "clock_error_s": 1e999}', f'{{"clock_error_s": {10**400}}}', "[]"],
    ids=str.__len__,
)
def test_statements_that_no_operator_made_are_left_out(tmp_path: Path, gse: Gse, stated: str) -> None:
    path = write_station(tmp_path / "session.mcap", BUILT_IN_TEXT, stated=stated)
    assert gse("report", path, "--out", tmp_path / "report").code == 5


@pytest.mark.parametrize("what", ["catalog: {path}", "protocol: {path}"])
def test_a_session_opens_no_file_of_this_host_unless_a_station_file_is_given(
    tmp_path: Path, gse: Gse, what: str
) -> None:
    secret = tmp_path / "secret.yaml"
    secret.write_text("the secret: 1\n")
    path = write_station(tmp_path / "session.mcap", BUILT_IN_TEXT + what.format(path=secret) + "\n")
    done = gse("report", path)
    assert done.code == 2
    assert "--station" in done.err
    assert "the secret" not in done.err
    own = tmp_path / "own.yaml"
    own.write_text(BUILT_IN_TEXT)
    assert gse("report", path, "--station", own).code in (1, 5)


LIST = b"id,ra_deg,de_deg,magnitude,epoch\n"


@pytest.mark.parametrize(
    ("head", "pattern", "told"),
    [
        (b"", b"H|", "line 1: no Hipparcos star"),
        (LIST, b"1,", "line 2: this is not a flight catalogue: at most"),
        (LIST, b"1\n", "line 100002: this is not a flight catalogue: at most"),
        (b"id,", b"    ", "more than 32000000 bytes"),
    ],
    ids=["one line", "one row", "short rows", "too large"],
)
def test_a_catalogue_of_20_mb_in_few_or_many_lines_is_refused_in_little_memory(
    tmp_path: Path, gse: Gse, head: bytes, pattern: bytes, told: str
) -> None:
    (tmp_path / "catalog").write_bytes(head + pattern * 10_000_000)
    (tmp_path / "station.yaml").write_text(f"{BUILT_IN_TEXT}catalog: {tmp_path / 'catalog'}\n")
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    done = gse("catalog", "info", "--station", tmp_path / "station.yaml")
    assert (done.code, told in done.err) == (2, True)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < GROWTH_MIB << 10


def test_aliases_in_a_station_file_are_refused(tmp_path: Path, gse: Gse) -> None:
    laughs = "a0: &a0 [lol, lol]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12))
    station = tmp_path / "station.yaml"
    station.write_text(BUILT_IN_TEXT + laughs)
    done = gse("config", "check", station)
    assert done.code == 2
    assert "aliases" in done.err
    assert gse("report", write_station(tmp_path / "session.mcap", BUILT_IN_TEXT + laughs)).code == 2


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("0x" + "f" * 20_000, "line 22: a number of more than 300 digits"),
        (":".join(["59"] * 20_000), "line 22: version is given twice"),
        ("9" * 20_000, "is not a value of the kind"),
        ("a\0b", "the character U+0000 in line 22"),
    ],
)
def test_a_value_that_python_does_not_write_down_is_refused_with_its_line(
    tmp_path: Path, gse: Gse, value: str, told: str
) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(f"{BUILT_IN_TEXT}version: {value}\n")
    done = gse("config", "check", station)
    assert (done.code, told in done.err) == (2, True)


@pytest.mark.parametrize("key", ['"\\x1b[2J": 1', 'site: {name: "\\x1b]0;x\\x07"}', 'protocol: "\\ud800"'])
def test_a_station_file_cannot_steer_the_terminal(tmp_path: Path, gse: Gse, key: str) -> None:
    path = write_station(tmp_path / "session.mcap", f"{BUILT_IN_TEXT}{key}\n")
    done = gse("report", path)
    assert done.code == 2
    assert STEERS.search(done.out + done.err) is None


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    """Nobody ever writes into it."""
    os.mkfifo(tmp_path / "pipe.mcap")
    return tmp_path / "pipe.mcap"


@pytest.mark.parametrize(
    "command", ["report {}", "session info {}", "replay {}", "decode {}", "compare {} {}", "why {}"]
)
def test_a_pipe_or_a_device_in_the_place_of_a_session_is_refused(command: str, pipe: Path, gse: Gse) -> None:
    for path in (pipe, "/dev/zero"):
        done = gse(*command.format(path, path).split())
        assert (done.code, "it is a pipe or a device; expected a file" in done.err) == (2, True)


READERS: dict[str, tuple[Callable[[Path], object], type[Exception]]] = {
    "a station file": (read_station, ConfigError),
    "a scenario": (lambda path: load_scenario(str(path)), ConfigError),
    "a catalogue": (lambda path: load_catalog(str(path)), CatalogError),
    "Earth orientation": (lambda path: read_given([path]), TruthError),
    "a panorama table": (read_panorama_table, TableError),
    "an image": (read_picture, TableError),
    "a report": (read_page, UsageError),
    "a protocol": (lambda path: load_protocol(str(path)), DescriptionError),
}


@pytest.mark.parametrize("name", READERS)
def test_no_file_that_somebody_names_may_be_a_pipe(tmp_path: Path, name: str) -> None:
    read, error = READERS[name]
    os.mkfifo(tmp_path / "pipe.png")
    for path in (tmp_path / "pipe.png", Path("/dev/zero")):
        with pytest.raises(error):
            read(path)


def test_a_pipe_in_a_folder_of_sessions_holds_nobody_up(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "session.mcap")
    assert is_unfinished(tmp_path)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("session info {}", "File name too long; give another path"),
        ("report {}", "File name too long; give another path"),
        ("status {}", "no session of gse run in"),
        ("view {} --save {}", "File name too long; give another path"),
    ],
)
def test_a_name_that_no_file_can_have_is_answered_as_one(command: str, words: str, tmp_path: Path, gse: Gse) -> None:
    path = tmp_path / ("x" * 300)
    done = gse(*command.format(path, tmp_path / "new.rrd").split())
    assert (done.code, words in done.err) == (2, True)


HOSTILE_ANSWERS = {
    "a pipe": (None, "is a pipe or a device"),
    "a line without end": ('{"frame_no": 1, "ra_deg": "' + "x" * 200_000, "longer than"),
    "deep": ("[" * 50_000, "expected an answer"),
    "no number": ('{"frame_no": NaN}', "frame_no is nan; expected the number of a panorama"),
    "a list": ('{"frame_no": [1]}', "frame_no is .1.; expected the number of a panorama"),
    "no text": ('{"frame_no": 1, "status": "\\ud800"}\n\xff', "not UTF-8"),
}


@pytest.mark.parametrize("name", HOSTILE_ANSWERS)
def test_expected_answers_of_a_stranger_are_refused(name: str, pipe: Path, tmp_path: Path) -> None:
    text, told = HOSTILE_ANSWERS[name]
    path = pipe
    if text is not None:
        path = tmp_path / "expected.jsonl"
        path.write_bytes(text.encode("latin-1"))
    with pytest.raises(TableError, match=told):
        read_answers(path)


@pytest.mark.parametrize("wrong", ['"ra_deg": [[1e999]]', '"de_deg": NaN', '"roll_deg": {"a": 1}', '"ra_deg": 1e999'])
def test_expected_angles_that_are_no_numbers_are_refused_in_words(tmp_path: Path, wrong: str) -> None:
    path = tmp_path / "expected.jsonl"
    path.write_text(f'{{"frame_no": 1, "detail": [1], "ra_deg": 1, "de_deg": 2, {wrong}}}\n')
    with pytest.raises(TableError, match=r"line 1: \w+ is .*; expected a number, or no answer"):
        read_answers(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: " + "[" * 40_000, "nested too deeply"),
        ("a: " + "9" * 10_000, "is not a value of the kind"),
        (BUILT_IN_TEXT + "site: {latitude_deg: 1, longitude_deg: 2, height_m: 3}\n", "site is given twice"),
        ("limits: {d_ra_cosde_arcsec: 60, d_ra_cosde_arcsec: 600}\n", "d_ra_cosde_arcsec is given twice"),
    ],
)
def test_a_station_file_of_absurd_values_is_refused_in_words(text: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        parse_station(text)
