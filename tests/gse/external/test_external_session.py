import json

import numpy as np
import pytest
from devices.programs import program

from drivers.session_file.reader import read_capture
from drivers.session_file.records import RecordedMessage
from gse.cli import main
from gse.config.choice import change_to
from gse.config.station import BUILT_IN_TEXT
from gse.recording.session_format import ANSWER_TOPIC, LOG_TOPIC
from gse.report.terminal import external_lines
from gse.sessions.replay import replay_session
from gse.station.frame_results import frame_json

SCENARIO = "sim://?scenario=inclined&frames=120"
"""At 45 deg of altitude refraction is a minute of arc: an answer must lose it as the built-in identifier's does."""

PARROT = """\
import json, sys
own = {frame["frame_no"]: frame for frame in map(json.loads, open(sys.argv[1]))}
sensor = json.loads(sys.stdin.readline())
print("ready", file=sys.stderr)
print(json.dumps({"schema": "gse.identifier/1", "name": "parrot", "version": "1.0"}), flush=True)
for line in sys.stdin:
    frame = own[json.loads(line)["frame_no"]]
    if frame["frame_no"] == 20:
        sys.exit(4)
    keys = ("frame_no", "ra_deg", "de_deg", "roll_deg")
    print(json.dumps({**{key: frame[key] for key in keys}, "elapsed_us": 1500}), flush=True)
"""


class FrameLines:
    """Writes each result as a line of gse.frame/1."""

    def __init__(self, lines):
        self._lines = lines

    def on_results(self, results, session):
        for result in results:
            self._lines.write(json.dumps(frame_json(result)) + "\n")

    def on_event(self, event):
        pass


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("external")


@pytest.fixture(scope="module")
def sessions(folder):
    """The same sky twice: under neighbour, and under a program that gives neighbour's answers."""

    def run(out, *options):
        with pytest.raises(SystemExit):
            main(["run", "--port", SCENARIO, "--no-plots", "--out", str(folder / out), *options])
        (path,) = (folder / out).iterdir()
        return path

    built_in = run("built-in")
    with (folder / "own.ndjson").open("w") as lines:
        replay_session(built_in, make_listeners=lambda loop: [FrameLines(lines)])
    parrot = program(folder, PARROT, head="", name="parrot.py")
    return built_in, run("external", "--identifier", f"command:{parrot} {folder / 'own.ndjson'}")


def report_of(path):
    return json.loads((path / "report.json").read_text())


def test_the_same_answers_give_the_same_errors_as_those_of_a_built_in_identifier(sessions):
    own, other = (report_of(path)["accuracy"]["onboard"] for path in sessions)
    for axis in ("d_ra_cosde", "d_de", "d_roll", "cross_x", "cross_y"):
        # Where the stars are not named, refraction is that of all objects: half an arcsec of sixty.
        assert other[axis]["bias_arcsec"] == pytest.approx(own[axis]["bias_arcsec"], abs=0.15 * own[axis]["std_arcsec"])
        assert other[axis]["std_arcsec"] == pytest.approx(own[axis]["std_arcsec"], rel=0.1)


def test_a_failure_costs_one_frame_and_stands_in_the_report(sessions):
    report = report_of(sessions[1])
    external = report["external_identifier"]
    assert (external["name"], external["version"], external["plug"]) == ("parrot", "1.0", "command")
    assert external["failures"] == {"CRASH": 1}
    assert external["time_of"] == "the identifier's own clock"
    assert report["identification"]["statuses"]["IDENTIFIER_FAULT"] == 1
    assert report["identification"]["subjects"]["onboard"]["time_ms"]["p50"] == 1.5


def test_failures_are_named_on_the_terminal(sessions, folder, gse):
    done = gse("replay", sessions[1], "--out", folder / "words", "--verbose")
    assert f"external identifier: parrot, version 1.0: {external_answers(sessions[1])} answers, 1 CRASH" in done.out


def test_a_comparison_names_the_failures_of_each_side(sessions, gse):
    done = gse("compare", *sessions)
    assert (
        f"second: external identifier: parrot, version 1.0: {external_answers(sessions[1])} answers, 1 CRASH"
        in done.out
    )
    document = json.loads(gse("compare", *sessions, "--json").out)
    assert list(document["external_identifiers"]) == ["second"]
    assert document["external_identifiers"]["second"]["failures"] == {"CRASH": 1}


@pytest.mark.parametrize(("number", "unknown"), [("int(float(star))", True), ("star", False), ("int(star)", False)])
def test_stars_that_no_catalogue_has_are_counted_and_text_keeps_every_digit_of_a_number(
    sessions, folder, gse, number, unknown
):
    body = (
        f"own = {{f['frame_no']: f for f in map(json.loads, open({str(folder / 'own.ndjson')!r}))}}\n"
        "for line in sys.stdin:\n"
        "    f = own[json.loads(line)['frame_no']]\n"
        "    names = [(match['object'], match['star'].partition('Gaia DR3 ')[2]) for match in f['matches']]\n"
        f"    stars = [{{'object': row, 'star': {number}}} for row, star in names if star]\n"
        "    answer(f, ra_deg=f['ra_deg'], de_deg=f['de_deg'], matches=stars)\n"
    )
    script = program(folder, body, name="named.py")
    done = gse("replay", sessions[0], "--identifier", f"command:{script}", "--json")
    external = json.loads(done.out)["external_identifier"]
    assert external["stars_named"] > 1000
    assert (external["stars_unknown"] > 0.5 * external["stars_named"]) is unknown
    assert external["stars_unknown"] == 0 or unknown
    lines = external_lines(external)
    assert len(lines) == 1 + unknown
    assert not unknown or "are in no catalogue: a program with doubles has to write their numbers as text" in lines[1]


def test_the_sky_is_as_clear_where_a_program_names_few_stars_or_fails(sessions, folder):
    body = (
        f"own = {{f['frame_no']: f for f in map(json.loads, open({str(folder / 'own.ndjson')!r}))}}\n"
        "for line in sys.stdin:\n"
        "    f = own[json.loads(line)['frame_no']]\n"
        "    numbered = [match for match in f['matches'] if match['star'].startswith('Gaia DR3 ')]\n"
        "    few = [{'object': match['object'], 'star': int(match['star'][9:])} for match in numbered[:2]]\n"
        "    if f['frame_no'] % 2: answer(f, ra_deg=f['ra_deg'], de_deg=f['de_deg'], matches=few)\n"
        "    else: print('nonsense', flush=True)\n"
    )
    script = program(folder, body, name="few.py")
    frames = replay_session(sessions[0], station=change_to(None, f"command:{script}")).session.frames
    assert frames.columns["matched"].max() == 2
    assert frames.columns["stars_seen"].min() > 20


def test_answers_and_stderr_are_in_the_session(sessions):
    messages = [record for record in read_capture(sessions[1] / "session.mcap") if isinstance(record, RecordedMessage)]
    answers = [json.loads(message.data) for message in messages if message.topic == ANSWER_TOPIC]
    assert sum("answer" in answer for answer in answers) == external_answers(sessions[1])
    assert b"".join(message.data for message in messages if message.topic == LOG_TOPIC) == b"ready\nready\n"


def external_answers(path):
    return report_of(path)["external_identifier"]["answers"]


def test_a_replay_starts_no_program_and_gives_the_same_report(sessions, folder, gse):
    (folder / "own.ndjson").rename(folder / "gone")
    try:
        done = gse("replay", sessions[1], "--out", folder / "again", "--json")
    finally:
        (folder / "gone").rename(folder / "own.ndjson")
    assert json.loads(done.out) == report_of(sessions[1])


def test_a_session_with_an_external_identifier_can_be_judged_under_a_built_in_one(sessions):
    replay = replay_session(sessions[1], station=change_to(None, "neighbour"))
    own = replay_session(sessions[0])
    for name in ("ra_deg", "de_deg", "d_de_arcsec"):
        assert np.array_equal(replay.session.frames.columns[name], own.session.frames.columns[name])


def test_the_time_of_one_identifier_is_not_that_of_another_in_a_replay(sessions):
    """The session recorded neighbour's times; a program that answers in its place has none of them."""
    own = replay_session(sessions[0]).session.frames.columns["elapsed_us"]
    other = replay_session(sessions[0], station=change_to(None, "pivot")).session.frames.columns["elapsed_us"]
    assert np.isfinite(own).all()
    assert np.isnan(other).all()


def test_a_program_that_is_given_up_is_told_once(folder, gse):
    ends = program(folder, "import sys\nsys.exit('no licence for this host')\n", head="", name="ends")
    done = gse("run", "--port", "sim://?frames=110", "--identifier", f"command:{ends}", "--out", folder / "given-up")
    assert done.err.count("IDENTIFIER_GIVEN_UP: no answer from frame 100 on: it failed too often in a row") == 1
    assert "events that came again, not shown: IDENTIFIER_FAULT 99\n" in done.err
    (session,) = (folder / "given-up").iterdir()
    assert "gse session export" in gse("why", session).out
    exported = gse("session", "export", session, "--format", "stderr")
    assert exported.out == 100 * "no licence for this host\n"


def test_external_alone_names_no_program(sessions, folder, gse):
    done = gse("replay", sessions[0], "--identifier", "external", "--out", folder / "none")
    assert done.code == 2
    assert "--identifier external names no program" in done.err


def test_a_program_that_cannot_be_started_is_refused_before_a_session(folder, gse):
    done = gse("run", "--identifier", "command:./no-such-program", "--out", folder / "refused")
    assert (done.code, "there is no file" in done.err) == (2, True)
    assert not (folder / "refused").exists()


def test_a_station_file_names_a_program_beside_it(folder, gse):
    program(folder, "for line in sys.stdin: answer(json.loads(line), star='?')\n", name="beside")
    station = folder / "station.yaml"
    station.write_text(f"{BUILT_IN_TEXT}identifier: {{algorithm: external, command: [./beside]}}\n")
    assert gse("config", "check", station).code == 0
    table = folder / "table.csv"
    table.write_text("".join(f"{100 + 40 * k} {900 - 50 * k} {3000 - 100 * k}\n" for k in range(12)))
    done = gse("identify", table, "--station", station, "--json")
    frame = json.loads(done.out)
    assert (frame["status"], frame["identifier"], frame["roll_deg"]) == ("IDENTIFIED", "external", None)
    assert (round(frame["ra_deg"], 6), round(frame["de_deg"], 6)) == (10.0, -20.0)
    (folder / "beside").chmod(0o644)
    refused = gse("config", "check", station)
    assert (refused.code, "is not executable" in refused.err) == (2, True)
