"""gse ci --identifier: the answers of a program, or of a built-in identifier, against those that it gave before."""

import json
import os
import random
import shutil
import xml.etree.ElementTree as ET

import pytest
from devices.command_line import runner
from devices.programs import program

from gse.cli import main

FLIGHT = """\
import json, sys, time
answers, off_deg, habit = sys.argv[1:]
own = {line["frame_no"]: line for line in map(json.loads, open(answers)) if "frame_no" in line}
sys.stdin.readline()
for line in sys.stdin:
    frame_no = json.loads(line)["frame_no"]
    answer = dict(own[frame_no])
    if "de_deg" in answer:
        answer["de_deg"] += float(off_deg)
    if frame_no == 20 and habit == "hangs":
        time.sleep(60)
    if frame_no == 20 and habit == "ends":
        sys.exit(3)
    if habit == "blind" or (frame_no == 20 and habit == "misses"):
        answer = {"frame_no": frame_no, "status": "NO_MATCH"}
    print(json.dumps(answer), flush=True)
"""
"""Gives the answers of a file, so many degrees off, and does at frame 20 what its habit is."""

ARCSEC = 1 / 3600


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a session, the answers of neighbour to it, and those of the program, which are the same."""
    folder = tmp_path_factory.mktemp("answers")
    (folder / "replays").mkdir()
    program(folder, FLIGHT, head="", name="flight")
    with pytest.raises(SystemExit):
        main(["simulate", "--seconds", "10", "--rate-hz", "10", "--file", str(folder / "replays" / "night.mcap")])
    with pytest.raises(SystemExit) as done:
        main(["ci", str(folder / "replays"), "--identifier", "neighbour", "--update"])
    assert done.value.code == 0
    shutil.copy(folder / "replays" / "night.answers.ndjson", folder / "own.ndjson")
    return folder


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "made")


@pytest.fixture
def ci(folder, capsys):
    """``gse ci`` of the session under the program, with its offset and its habit."""

    def run(*options, off_arcsec=0.0, habit="none"):
        command = f"command:{folder / 'flight'} {folder / 'own.ndjson'} {off_arcsec * ARCSEC} {habit}"
        return runner(capsys)("ci", folder / "replays", "--identifier", command, *options)

    return run


def expected(folder):
    return folder / "replays" / "night.answers.ndjson"


def lines_of(path):
    return path.read_text().splitlines(keepends=True)


def test_a_program_that_answers_as_before_differs_nowhere(ci, folder):
    assert ci("--update").code == 0
    head, *answers = map(json.loads, lines_of(expected(folder)))
    assert (head["schema"], head["name"], len(answers)) == ("gse.identifier/1", "flight", 100)
    assert set(answers[0]) == {"frame_no", "ra_deg", "de_deg", "roll_deg"}
    same = ci()
    assert same.code == 0
    assert same.out.splitlines()[-1] == "0 of 100 answers differ; 1 of 1 sessions give the expected ones"


def test_a_program_that_is_180_arcsec_off_differs_in_every_answer(ci, folder, tmp_path):
    junit = tmp_path / "junit.xml"
    off = ci("--junit", junit, off_arcsec=180)
    assert off.code == 1
    assert "100 of 100 answers differ, by up to 180 arcsec; the expected answers are of neighbour" in off.out
    assert "frame 0: 180 arcsec away, ra_deg " in off.out
    suite = ET.parse(junit).getroot()
    assert (suite.get("failures"), suite.get("errors")) == ("1", "0")
    assert "frame 0: 180 arcsec away" in suite.find("testcase/failure").get("message")
    document = json.loads(ci("--json", off_arcsec=180).out)["recordings"][0]
    assert (document["answers"]["different"], len(document["differences"])) == (100, 5)


def test_within_an_angle_answers_are_the_same(ci):
    assert ci(off_arcsec=0.4).code == 1
    assert ci("--within", "1arcsec", off_arcsec=0.4).code == 0
    assert ci("--within", "300 mas", off_arcsec=0.4).code == 1


def test_the_order_of_the_expected_answers_does_not_matter(ci, folder):
    head, *answers = lines_of(expected(folder))
    random.Random(1).shuffle(answers)
    expected(folder).write_text("".join([head, *answers]))
    assert ci().code == 0


def test_a_frame_without_an_expected_answer_and_an_answer_without_a_frame_differ(ci, folder):
    lines = lines_of(expected(folder))
    expected(folder).write_text("".join(lines[:-2]))
    fewer = ci()
    assert (fewer.code, "0 of 98 answers differ; 2 frames without an expected answer" in fewer.out) == (1, True)
    expected(folder).write_text("".join([*lines, '{"frame_no": 100, "ra_deg": 1, "de_deg": 2}\n']))
    more = ci()
    assert (more.code, "0 of 100 answers differ; 1 expected answer without a frame" in more.out) == (1, True)


def test_no_answer_where_one_is_expected_differs_and_one_where_none_is_expected(ci, folder):
    misses = ci(habit="misses")
    assert (misses.code, "frame 20: no answer (NO_MATCH); expected ra_deg " in misses.out) == (1, True)
    ci("--update", habit="misses")
    assert ci(habit="misses").code == 0
    found = ci()
    assert found.code == 1
    assert "1 of 100 answers differ" in found.out
    assert "; expected no answer (NO_MATCH)" in found.out


def test_a_crash_differs(ci):
    ends = ci(habit="ends")
    assert (ends.code, "frame 20: no answer (failure CRASH); expected ra_deg " in ends.out) == (1, True)


@pytest.mark.parametrize("when", ["now", "then"])
def test_a_time_out_is_counted_apart(ci, when):
    if when == "then":
        kept = ci("--update", habit="hangs")
        assert "repeat this on a quiet host" in kept.out
    done = ci("--json", habit="hangs" if when == "now" else "none")
    assert done.code == 0
    answers = json.loads(done.out)["recordings"][0]["answers"]
    assert answers[f"timeouts_{when}"] >= 1  # a busy host may add some
    assert answers["different"] == 0
    assert answers["compared"] == 100 - answers["timeouts_now"] - answers["timeouts_then"]


def test_a_program_that_answers_nothing_shows_nothing(ci):
    ci("--update", habit="blind")
    blind = ci(habit="blind")
    assert (blind.code, "0 of 100 answers differ; 100 of them are no answer on both sides" in blind.out) == (5, True)


def test_the_report_of_the_session_is_neither_compared_nor_written(ci, folder):
    report = folder / "replays" / "night.report.json"
    report.write_text("{}")
    assert ci().code == 0
    ci("--update", off_arcsec=9)
    assert report.read_text() == "{}"


def test_a_built_in_identifier_is_compared_too(folder, gse):
    words = ("ci", folder / "replays", "--identifier")
    assert gse(*words, "neighbour").code == 0
    assert gse(*words, "robust").code == 1


BROKEN = {
    "missing": (None, "there are no expected answers night.answers.ndjson; 'gse ci --update' writes them"),
    "empty": ("\n", "has no answer: expected a line of JSON for each frame"),
    "half a line": ('{"frame_no": 1, "ra_de', "line 1: expected an answer as JSON"),
    "a list": ("[1, 2]\n", "line 1: expected an answer as JSON"),
    "deep": ("[" * 90_000, "line 1: expected an answer as JSON"),
    "no number": ('{"ra_deg": 1, "de_deg": 2}\n', "line 1: frame_no is None"),
    "a huge number": ('{"frame_no": 9223372036854775808}\n', "line 1: frame_no is 9223372036854775808"),
    "NaN": ('{"frame_no": 1, "ra_deg": NaN, "de_deg": 2}\n', "line 1: ra_deg is nan; expected a number"),
    "RA alone": ('\n{"frame_no": 1, "ra_deg": 1}\n', "line 2: ra_deg stands alone"),
    "3 numbers": ('{"frame_no": 1, "quaternion": [0, 0, 1]}\n', "line 1: quaternion is [0, 0, 1]; expected four"),
    "no order": ('{"frame_no": 1, "quaternion": [0, 0, 0, 1]}\n', "line 1: a quaternion needs its order and maps"),
    "long": ('{"frame_no": 1, "x": "' + 100_000 * "x", "line 1 is longer than 100000 characters"),
    "bytes": (b"\xff\xfe", "is not UTF-8 text"),
    "another session": ('{"schema": "gse.identifier/1", "session_sha256": "ab"}\n', "the answers to another session"),
}


@pytest.mark.parametrize(("content", "words"), BROKEN.values(), ids=BROKEN)
def test_a_missing_or_damaged_file_is_an_error_that_says_what_to_do(content, words, ci, folder):
    expected(folder).unlink()
    if content is not None:
        expected(folder).write_bytes(content if isinstance(content, bytes) else content.encode())
    done = ci()
    assert (done.code, words in done.out) == (1, True), done.out


def test_a_file_that_is_too_large_or_a_pipe_is_not_read(ci, folder):
    os.truncate(expected(folder), 200_000_001)
    assert "is larger than 200000000 bytes" in ci().out
    expected(folder).unlink()
    os.mkfifo(expected(folder))
    assert "it is a pipe or a device" in ci().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--within", "1"), "--within is '1'; expected an angle with its unit (mas, arcsec, arcmin, deg): 1arcsec"),
        (("--within", "1arcsec", "--update"), "give --identifier with it, and not --update"),
    ],
)
def test_a_tolerance_that_makes_no_sense_is_refused(options, words, ci):
    done = ci(*options)
    assert (done.code, words in done.err) == (2, True)


def test_a_tolerance_without_an_identifier_is_refused(folder, gse):
    done = gse("ci", folder / "replays", "--within", "1arcsec")
    assert (done.code, "give --identifier with it" in done.err) == (2, True)
