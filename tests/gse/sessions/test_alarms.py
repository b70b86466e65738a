"""Alarms: one message when something is wrong for a while, one when it is over, by a program or a URL."""

import http.server
import json
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from devices.command_line import Gse
from skies.synthetic_night import START_NS, synthetic_night

from drivers.chunk import LinkEvent, LinkKind
from drivers.clock import ClockReading
from gse.config.station import BUILT_IN_TEXT, Alarms, parse_station
from gse.errors import GseError
from gse.sessions.alarms import Alarmed, send_message, troubles
from gse.station.events import Notes, StationKind
from gse.values.instant import NS_PER_S
from gse.view.live_state import LiveState


def alarms(text: str) -> Alarms:
    return parse_station(BUILT_IN_TEXT + f"alarms: {text}\n").alarms


def test_the_station_file_says_on_what_after_how_long_and_how() -> None:
    asked = alarms("{on: [link, no answer], after: 2m, command: [say, loud]}")
    assert (asked.on, asked.after_s, asked.command) == (("link", "no answer"), 120.0, ("say", "loud"))
    assert alarms("{post: 'http://x'}").after_s == 60.0
    with pytest.raises(GseError, match="expected a time such as 60s"):
        alarms("{after: soon}")
    with pytest.raises(GseError, match="alarms"):
        alarms("{on: [moon]}")


def test_a_link_that_is_gone_for_long_gives_one_message_and_one_when_it_is_back() -> None:
    live, notes, sent = LiveState(synthetic_night(1).station), Notes(), []
    watch = Alarmed(alarms("{on: [link], after: 10s}"), live, None, notes, send=sent.append)

    def link(kind: LinkKind) -> None:
        live.on_event(LinkEvent(START_NS, 0, kind, "text"))

    link(LinkKind.LOST)
    for second in (0, 5, 9):
        watch.look(second)
    assert sent == []
    for second in (10, 11, 500):
        watch.look(second)
    assert sent == ["LAPAN-like: ALARM link: the port is gone"]
    assert live.alarms == ("link: the port is gone",)
    link(LinkKind.STREAMING)
    watch.look(501)
    assert sent[1:] == ["LAPAN-like: ALARM over, link: it is well again"]
    assert live.alarms == ()
    assert notes.take() == [text.removeprefix("LAPAN-like: ") for text in sent]
    link(LinkKind.STALE)
    watch.look(502)
    link(LinkKind.STREAMING)
    watch.look(505)
    assert len(sent) == 2  # a short one gives none


def test_each_trouble_is_told_by_its_name(tmp_path: Path) -> None:
    live = LiveState(synthetic_night(1).station)
    so_far = live.so_far
    assert list(troubles(so_far, tmp_path)) == []
    clock = ClockReading(0, 0, "kernel", False, 0.0, 1.0)
    assert [kind for kind, _ in troubles(replace(so_far, clock=clock), None)] == ["clock"]
    assert list(troubles(replace(so_far, clock=clock, clock_error_s=0.1), None)) == []
    silent = replace(so_far, frames=9, first_utc_ns=START_NS, utc_ns=START_NS + 30 * NS_PER_S)
    assert list(troubles(silent, None)) == [("no answer", "no panorama was identified for 30 s")]
    live.on_event(LinkEvent(START_NS, 0, StationKind.CLOUDED, "cloud from the west"))
    clouded = replace(silent, sky=live.so_far.sky, sky_text=live.so_far.sky_text)
    assert list(troubles(clouded, None)) == [("cloud", "cloud from the west")]


def test_a_program_gets_the_message_as_its_last_argument(gse: Gse, tmp_path: Path) -> None:
    program = "import sys, pathlib; pathlib.Path(sys.argv[1]).write_text(sys.argv[2])"
    station = tmp_path / "roof.yaml"
    words = json.dumps([sys.executable, "-c", program, str(tmp_path / "told")])
    station.write_text(BUILT_IN_TEXT + f"alarms: {{command: {words}}}\n")
    assert gse("alarms", "test", "-s", station).code == 0
    assert (tmp_path / "told").read_text().startswith("LAPAN-like: a test of the alarms: link, no answer")
    failing = alarms(json.dumps({"command": [sys.executable, "-c", "import sys; sys.exit('no paper')"]}))
    with pytest.raises(GseError, match="ended with 1: no paper"):
        send_message(failing, "x")
    with pytest.raises(GseError, match="try it with: gse alarms test"):
        send_message(alarms("{command: [/nowhere/at-all]}"), "x")
    station.write_text(BUILT_IN_TEXT + "alarms: {command: [/nowhere/at-all]}\n")
    assert gse("alarms", "test", "-s", station).code == 2
    assert "no alarms.command" in gse("alarms", "test").err


def test_a_url_gets_the_message_as_json() -> None:
    got = []

    class Taker(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            got.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *words: object) -> None:
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Taker) as server:
        thread = threading.Thread(target=server.handle_request)
        thread.start()
        send_message(alarms(f"{{post: 'http://127.0.0.1:{server.server_port}/'}}"), "the port is gone")
        thread.join()
    assert got == [{"text": "the port is gone"}]
    with pytest.raises(GseError, match="apprise"):
        send_message(alarms("{post: 'nowhere://x'}"), "x")


def test_a_session_sends_what_is_wrong_with_it_and_records_it_and_a_replay_sends_nothing(
    gse: Gse, tmp_path: Path
) -> None:
    program = "import sys, pathlib; pathlib.Path(sys.argv[1]).open('a').write(sys.argv[2] + '\\n')"
    words = json.dumps([sys.executable, "-c", program, str(tmp_path / "told")])
    station = tmp_path / "roof.yaml"
    station.write_text(BUILT_IN_TEXT + f"alarms: {{on: [cloud], after: 1s, command: {words}}}\n")
    port = "sim://?scenario=daylight&speed=1&frames=80"
    gse("run", station, "--port", port, "--no-plots", "--out", tmp_path / "out")
    told = (tmp_path / "told").read_text()
    assert "ALARM cloud: " in told
    (folder,) = (tmp_path / "out").iterdir()
    assert "NOTE: ALARM cloud" in gse("why", folder).out
    assert (tmp_path / "told").read_text() == told
