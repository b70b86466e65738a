"""The web view answers to its own name alone: DNS rebinding, and a Host that would enter a header."""

import http.client
import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from devices.patience import PATIENCE_S
from skies.synthetic_night import synthetic_night

from gse.view.glance import Glance
from gse.view.live_state import LiveState
from gse.view.server import MOST_CONNECTIONS, Content, ViewServer, names_of_machine
from gse.view.viewer import ViewerFiles


@pytest.fixture
def page(tmp_path: Path) -> Iterator[ViewServer]:
    recording = tmp_path / "session.rrd"
    recording.write_bytes(b"the session")
    with ViewServer("127.0.0.1", 0, Content(recording=recording)) as page:
        yield page


def port_of(page: ViewServer) -> int:
    return page.port


def ask(page: ViewServer, *hosts: str, path: str = "/session.rrd") -> tuple[int, str, bytes]:
    """Status, headers and body of an answer to a request with these Host headers."""
    connection = http.client.HTTPConnection("127.0.0.1", port_of(page), timeout=PATIENCE_S)
    connection.putrequest("GET", path, skip_host=True)
    for host in hosts:
        connection.putheader("Host", host.encode("latin-1"))
    connection.endheaders()
    answer = connection.getresponse()
    headers, body = str(answer.headers), answer.read()
    connection.close()
    return answer.status, headers, body


@pytest.mark.parametrize(
    "host",
    [
        "attacker.example:{port}",
        "attacker.example:1",
        "127.0.0.1.attacker.example:{port}",
        "localhost.attacker.example:{port}",
        "attacker.localhost:{port}",
        "{machine}.attacker.example:{port}",
        "{machine}.local:{port}",
        "127.0.0.1:123456",
        "127.0.0.1:",
        "192.0.2.1:{port}",
        "127.0.0.1:{port}; script-src *",
        "127.0.0.1:{port}@attacker.example",
        "evil'\"><script>:{port}",
        "",
    ],
)
def test_a_host_that_is_not_this_servers_is_refused_and_enters_no_header(page: ViewServer, host: str) -> None:
    status, headers, body = ask(page, host.format(port=port_of(page), machine=socket.gethostname()))
    assert status in (400, 421)
    assert "attacker" not in headers + body.decode()
    assert "script" not in headers + body.decode()
    assert b"the session" not in body


def test_two_hosts_or_none_are_refused(page: ViewServer) -> None:
    own = f"127.0.0.1:{port_of(page)}"
    assert ask(page)[0] in (400, 421)
    assert ask(page, own, own)[0] in (400, 421)
    assert ask(page, own, "attacker.example")[0] in (400, 421)


@pytest.mark.parametrize("host", ["127.0.0.1:{port}", "localhost:{port}", "[::1]:9000", "localhost:9000", "127.0.0.1"])
def test_its_own_names_are_answered_at_any_port_with_the_policy_of_that_name(host: str) -> None:
    with ViewServer("127.0.0.1", 0, Content(glance=Glance(LiveState(synthetic_night(1).station)))) as page:
        name = host.format(port=page.port)
        status, headers, _ = ask(page, name, path="/")
    assert status == 200
    assert f"connect-src 'self' ws://{name};" in headers


@pytest.mark.parametrize("host", ["{machine}:{port}", "{machine}.local:{port}", "{machine}.LOCAL:9000", "192.0.2.7"])
def test_bound_to_all_addresses_it_answers_to_the_names_of_its_machine(host: str) -> None:
    with ViewServer("0.0.0.0", 0, Content()) as page:
        assert ask(page, host.format(port=page.port, machine=socket.gethostname()), path="/")[0] == 200


def test_the_names_of_a_machine_are_its_own_and_those_with_a_domain_in_its_hosts_file() -> None:
    lines = [
        "127.0.1.1 station.obs.example Station ads.example",
        "# 10.0.0.1 station.old.example",
        "10.0.0.2 stations.b",
    ]
    own = {"station", "station.local", "station.obs.example"}
    assert names_of_machine("Station", lines) == own
    assert names_of_machine("station.obs.example", []) == own


def test_bound_to_all_addresses_it_answers_to_an_address_and_to_no_foreign_name(tmp_path: Path) -> None:
    with ViewServer("0.0.0.0", 0, Content()) as page:
        port = port_of(page)
        assert ask(page, f"192.0.2.7:{port}", path="/")[0] == 200
        machine = socket.gethostname()
        for name in ("attacker.example", "attacker.local", f"{machine}.attacker.example", f"attacker.{machine}.local"):
            assert ask(page, f"{name}:{port}", path="/")[0] == 421


WASM = bytes(range(256)) * (40 << 12)


class LargeFiles(ViewerFiles):
    """Files of the size of rerun's, without the program."""

    def __getitem__(self, path: str) -> bytes:
        return WASM


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def hold(page: ViewServer, stack: ExitStack, request: str, address: str = "127.0.0.1") -> socket.socket:
    """A connection that sends a request, or half of one, and reads nothing."""
    connection = stack.enter_context(socket.socket())
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.bind((address, 0))
    connection.connect(("127.0.0.1", page.port))
    connection.sendall(request.replace("HOST", f"127.0.0.1:{page.port}").encode())
    return connection


GET = "GET {} HTTP/1.1\r\nHost: HOST\r\n\r\n"
HALF = "POST /note HTTP/1.1\r\nHost: HOST\r\nContent-Type: application/json\r\nContent-Length: 4000\r\n\r\n{"


def test_readers_that_read_nothing_cost_a_part_of_a_file_each_and_lock_nobody_out() -> None:
    with ViewServer("127.0.0.1", 0, Content(files=LargeFiles())) as page, ExitStack() as stack:
        host = f"127.0.0.1:{page.port}"
        assert ask(page, host, path="/re_viewer_bg.wasm")[2] == WASM
        before = resident_bytes()
        for _ in range(MOST_CONNECTIONS + 10):
            hold(page, stack, GET.format("/re_viewer_bg.wasm"))
        status, _, body = ask(page, host, path="/re_viewer_bg.wasm")
        assert (status, body == WASM) == (200, True)
        assert resident_bytes() - before < 80 << 20, "each of 64 would have 40 MiB"


@pytest.mark.parametrize("request_text", [HALF, "GET / HT", GET.format("/session.rrd") + HALF])
def test_requests_that_never_end_lock_nobody_out(page: ViewServer, request_text: str) -> None:
    with ExitStack() as stack:
        for number in range(2 * MOST_CONNECTIONS):
            hold(page, stack, request_text, address=f"127.0.0.{2 + number % 2}")
        assert ask(page, f"127.0.0.1:{page.port}")[0] == 200


def test_a_connection_of_another_address_stays_while_one_address_opens_more_and_more(page: ViewServer) -> None:
    with ExitStack() as stack:
        ours = stack.enter_context(socket.create_connection(("127.0.0.1", page.port), source_address=("127.0.0.3", 0)))
        ours.settimeout(PATIENCE_S)
        for _ in range(3 * MOST_CONNECTIONS):
            hold(page, stack, HALF, address="127.0.0.2")
        assert ask(page, f"127.0.0.1:{page.port}")[0] == 200
        ours.sendall(GET.format("/session.rrd").replace("HOST", f"127.0.0.1:{page.port}").encode())
        assert ours.recv(12) == b"HTTP/1.1 200"
