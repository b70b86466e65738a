"""The live page over its web server: documents on demand, the verdict, notes, and who may leave them."""

import asyncio
import http.client
import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from socket import create_server

import numpy as np
import pytest
from devices.live_session import LiveSession
from devices.patience import PATIENCE_S
from devices.programs import program
from devices.proxy import Proxy
from skies.one_by_one import results_of
from skies.synthetic_night import synthetic_frames, synthetic_night
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from gse.station.events import MOST_CHARACTERS, MOST_WAITING, Notes
from gse.view.glance import Glance
from gse.view.live_state import LiveState
from gse.view.server import _SHOW_VERDICT_S, _WRONG_TOKEN_S, MOST_BROWSERS, Content, ViewServer
from protocols import PanoramaMessage, load_protocol

MOST_PAGE_BYTES = 100_000


@pytest.fixture
def notes() -> Notes:
    return Notes()


@pytest.fixture
def live() -> LiveState:
    return LiveState(synthetic_night(1).station)


@pytest.fixture
def glance(live: LiveState) -> Glance:
    return Glance(live)


@pytest.fixture
def server(glance: Glance, notes: Notes) -> Iterator[ViewServer]:
    with ViewServer("127.0.0.1", 0, Content(glance=glance, notes=notes)) as server:
        yield server


def post(
    server: ViewServer | Proxy, body: object, *, address: str = "127.0.0.1", **headers: str
) -> tuple[int, dict[str, str]]:
    connection = http.client.HTTPConnection(address, server.port, timeout=PATIENCE_S)
    wanted = {"Content-Type": "application/json"} | {name.replace("_", "-"): text for name, text in headers.items()}
    connection.request("POST", "/note", json.dumps(body), wanted)
    answer = connection.getresponse()
    found = json.loads(answer.read())
    connection.close()
    return answer.status, found


async def documents(server: ViewServer, count: int) -> list[dict[str, object]]:
    """Documents as a browser gets them: each is asked for after the one before."""
    socket = await browser(server)
    found = []
    for _ in range(count):
        found.append(json.loads(str(await socket.read_message())))
        await socket.write_message("next")
    await leave(socket)
    return found


async def first_message(server: ViewServer) -> object:
    socket = await browser(server)
    message = await socket.read_message()
    await leave(socket)
    return message


async def leave(socket: WebSocketClientConnection) -> None:
    """Close, and wait until the server has closed too."""
    socket.close()
    with suppress(TimeoutError):
        async with asyncio.timeout(1):
            while await socket.read_message() is not None:
                pass


async def browser(server: ViewServer) -> WebSocketClientConnection:
    return await websocket_connect(f"ws://127.0.0.1:{server.port}/live")


def test_a_page_of_less_than_a_hundred_kilobytes_that_names_no_other_machine(server: ViewServer) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE_S)
    connection.request("GET", "/")
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    assert answer.status == 200
    assert len(body) < MOST_PAGE_BYTES
    for needs_another_request in (b"src=", b'rel="stylesheet"', b"@import", b"url("):
        assert needs_another_request not in body
    for own in (b"ws://${location.host}/", b"http://www.w3.org/2000/svg"):
        body = body.replace(own, b"")
    assert b"://" not in body
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    assert "'unsafe-inline'" not in re.search(r"script-src [^;]*", answer.headers["Content-Security-Policy"])[0]


def test_a_browser_that_falls_asleep_gets_the_newest_document_when_it_asks_again(
    server: ViewServer, live: LiveState
) -> None:
    session = synthetic_night(20)

    async def sleepy() -> list[int]:
        socket = await browser(server)
        first = json.loads(str(await socket.read_message()))
        for frame in synthetic_frames(20):
            live.on_results(results_of([frame]), session)
        others = await documents(server, 3)  # meanwhile another browser gets several
        await socket.write_message("next")
        second = json.loads(str(await socket.read_message()))
        await leave(socket)
        return [int(first["frames"]), int(str(others[-1]["frames"])), int(second["frames"])]

    assert asyncio.run(sleepy()) == [0, 20, 20]


def test_every_open_page_has_the_verdict_before_the_server_ends(glance: Glance) -> None:
    server = ViewServer("127.0.0.1", 0, Content(glance=glance))
    connected = threading.Event()

    async def last_word(socket: WebSocketClientConnection) -> str:
        document = {"ended": False}
        while not document["ended"]:
            document = json.loads(str(await socket.read_message()))
            await socket.write_message("next")
        await leave(socket)
        return str(document["word"]["text"])

    async def last_words() -> list[str]:
        sockets = [await browser(server) for _ in range(3)]
        connected.set()
        return await asyncio.gather(*map(last_word, sockets))

    words: list[str] = []
    pages = threading.Thread(target=lambda: words.extend(asyncio.run(last_words())))
    pages.start()
    assert connected.wait(PATIENCE_S)
    glance.conclude("PASS", ("all limits are kept",))
    server.close()
    pages.join(PATIENCE_S)
    assert words == ["DONE: PASS"] * 3


def test_the_end_does_not_wait_for_a_page_that_is_asleep(glance: Glance) -> None:
    async def fall_asleep() -> float:
        socket = await browser(server)
        await socket.read_message()
        glance.conclude("PASS", ())
        await asyncio.sleep(0.3)
        began_s = time.monotonic()
        await asyncio.to_thread(server.close)
        await leave(socket)
        return time.monotonic() - began_s

    server = ViewServer("127.0.0.1", 0, Content(glance=glance), asleep_s=0.2)
    assert asyncio.run(fall_asleep()) < _SHOW_VERDICT_S


def test_one_browser_more_than_the_station_can_serve_takes_the_place_of_the_one_that_was_silent_longest(
    server: ViewServer,
) -> None:
    async def many() -> tuple[object, ...]:
        sockets = [await browser(server) for _ in range(MOST_BROWSERS)]
        for socket in sockets:
            await socket.read_message()
        await sockets[0].write_message("next")
        await sockets[0].read_message()
        one_more = await first_message(server)
        silent = await sockets[1].read_message()
        await sockets[0].write_message("next")
        asking = await sockets[0].read_message()
        for socket in sockets:
            await leave(socket)
        return one_more is None, silent, asking is None

    assert asyncio.run(many()) == (False, None, False)


def test_a_note_reaches_the_session_as_one_printable_line(server: ViewServer, notes: Notes) -> None:
    assert post(server, {"text": "clouds \x1b[31m from\nthe west "}) == (200, {"note": "clouds [31m from the west"})
    assert notes.take() == ["clouds [31m from the west"]


NO_NOTES = [{"text": " \n"}, {"text": 7}, {}, [], {"text": "x" * (MOST_CHARACTERS + 1)}]


@pytest.mark.parametrize("body", NO_NOTES)
def test_no_note_without_a_line_of_text(server: ViewServer, notes: Notes, body: object) -> None:
    status, answer = post(server, body)
    assert status == 400
    assert "expected" in answer["error"]
    assert notes.take() == []


def test_too_many_notes_at_once_are_refused(server: ViewServer, notes: Notes) -> None:
    answers = [post(server, {"text": f"note {number}"})[0] for number in range(MOST_WAITING + 1)]
    assert answers == [200] * MOST_WAITING + [429]


def test_a_page_of_somebody_else_leaves_no_note(server: ViewServer, notes: Notes) -> None:
    assert post(server, {"text": "x"}, Origin="http://attacker.example")[0] == 403
    assert post(server, {"text": "x"}, Content_Type="text/plain")[0] == 403
    assert notes.take() == []


def test_notes_and_documents_come_through_a_tunnel_with_another_port(
    server: ViewServer, glance: Glance, notes: Notes
) -> None:
    with Proxy(server.port) as tunnel:
        own = f"http://localhost:{tunnel.port}"
        assert post(tunnel, {"text": "x"}, Host=f"localhost:{tunnel.port}", Origin=own) == (200, {"note": "x"})
        assert notes.take() == ["x"]
        for foreign in (f"http://localhost:{server.port}", "http://attacker.example", "null"):
            assert post(tunnel, {"text": "x"}, Host=f"localhost:{tunnel.port}", Origin=foreign)[0] == 403
            assert asyncio.run(status_of_live(tunnel.port, foreign)) == 403
        assert notes.take() == []
        assert asyncio.run(status_of_live(tunnel.port, own)) == 101


async def status_of_live(port: int, origin: str) -> int:
    """101 where a page of this origin gets the documents, else the answer's status."""
    request = HTTPRequest(f"ws://localhost:{port}/live", headers={"Origin": origin})
    try:
        socket = await websocket_connect(request)
    except HTTPClientError as error:
        return error.code
    assert json.loads(str(await socket.read_message()))
    await leave(socket)
    return 101


def test_a_note_from_another_address_needs_the_token(glance: Glance, notes: Notes) -> None:
    with ViewServer("0.0.0.0", 0, Content(glance=glance, notes=notes)) as server:
        # 127.0.0.2 is this machine too, but not the address that counts as local.
        status, answer = from_elsewhere(server, token="00000000")
        assert status == 403
        assert "token" in answer
        assert notes.take() == []
        assert from_elsewhere(server, token=server.token)[0] == 200
        assert notes.take() == ["from the roof"]


def test_wrong_tokens_are_answered_at_once_while_one_of_their_address_waits(glance: Glance, notes: Notes) -> None:
    ended_s = []

    def wrong(number: int) -> int:
        status, _ = from_elsewhere(server, token=f"{number:08x}")
        ended_s.append(time.monotonic())
        return status

    with ViewServer("0.0.0.0", 0, Content(glance=glance, notes=notes)) as server, ThreadPoolExecutor(10) as pool:
        assert set(pool.map(wrong, range(10))) == {403}
    assert min(after - before for before, after in pairwise(ended_s)) < _WRONG_TOKEN_S / 2
    assert notes.take() == []


def from_elsewhere(server: ViewServer, *, token: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection(
        "127.0.0.1", server.port, timeout=PATIENCE_S, source_address=("127.0.0.2", 0)
    )
    headers = {"Content-Type": "application/json", "X-Gse-Token": token}
    connection.request("POST", "/note", json.dumps({"text": "from the roof"}), headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, text


def test_a_saved_session_takes_no_notes_and_has_no_live_page(tmp_path: Path) -> None:
    (tmp_path / "session.rrd").write_bytes(b"RRF2")
    with ViewServer("127.0.0.1", 0, Content(recording=tmp_path / "session.rrd")) as server:
        assert post(server, {"text": "x"})[0] == 404
        assert asyncio.run(first_message(server)) is None


async def until_the_word_is(word: str, address: str) -> str:
    """The words of a page up to one; PATIENCE_S at most."""
    page = await websocket_connect(address)
    async with asyncio.timeout(PATIENCE_S):
        while not (said := json.loads(str(await page.read_message()))["word"]["text"]).startswith(word):
            await page.write_message("next")
    await leave(page)
    return str(said)


def test_a_panorama_that_waits_for_this_computer_is_not_held_against_the_sensor(tmp_path: Path) -> None:
    """An identifier that takes minutes, while panoramas go on to come."""
    slow = program(tmp_path, "for line in sys.stdin:\n    time.sleep(100)\n")
    protocol, nothing = load_protocol("panorama-v1"), (np.zeros((0, 2)), np.zeros(0))
    with create_server(("127.0.0.1", 0)) as sensor:
        command = [sys.executable, "-m", "gse", "run", "--port", f"socket://127.0.0.1:{sensor.getsockname()[1]}"]
        command += [
            "--identifier",
            f"command:{slow}",
            "--view",
            "web",
            "--http-port",
            "0",
            "--out",
            str(tmp_path / "out"),
        ]
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        connection, _ = sensor.accept()
        with connection:
            for number in range(20):
                panorama = PanoramaMessage(100_000 * number, number, 0.05, frozenset(), 20.0, *nothing)
                connection.sendall(protocol.encode(panorama, sequence=number))
            page = LiveSession(tmp_path / "out").await_state("running")["page"]
            said = asyncio.run(until_the_word_is("BEHIND", f"{page.replace('http', 'ws')}live"))
        running.kill()
        running.wait()
    assert said.endswith(" s")
