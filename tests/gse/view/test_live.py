"""The live view beside a running session: complete when it can be, and never in the way."""

import json
import signal
import subprocess
import threading
import time
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun.error_utils
from devices.items_sensor import ITEMS
from devices.patience import PATIENCE_S
from devices.rerun_recording import moving, rows_of
from skies.one_by_one import results_of
from skies.synthetic_night import small_catalog, synthetic_frames, synthetic_night

from gse.errors import GseError
from gse.station.housekeeping import ITEM, Housekeeping
from gse.view.live import LiveView
from gse.view.live_state import LiveState
from gse.view.rerun_feed import RerunFeed
from gse.view.server import Content, ViewServer
from gse.view.viewer import free_port, quiet_environment, rerun_program

FRAMES = 300


@pytest.fixture(autouse=True)
def _strict() -> None:
    rerun.error_utils.set_strict_mode(True)


@pytest.fixture(scope="module")
def frames():
    return list(synthetic_frames(FRAMES))


@pytest.fixture(scope="module")
def session():
    return synthetic_night(20)


def view_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name in ("live view", "view server")]


def ended_view_threads() -> bool:
    """Whether the view's threads end: closing waits some seconds for what is queued, and a busy machine is slower."""
    for thread in view_threads():
        thread.join(PATIENCE_S)
    return not view_threads()


def test_a_view_that_keeps_up_shows_every_frame_and_the_verdict(frames, session, tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    live = LiveState(session.station)
    live.housekeeping = Housekeeping(ITEMS.items)
    live.housekeeping.extend(np.array([(frames[0].panorama.utc_ns, 5.0, list(ITEMS.items).index("supply_v"), 1)], ITEM))
    with live.add(LiveView(live, mode="none", save_rrd=path, catalog=small_catalog())) as view:
        for event in session.events:
            live.on_event(event)
        for frame in frames:
            live.on_results(results_of([frame]), session)
        view.conclude("PASS", ["all limits are kept"])
    rows = rows_of(path)
    assert view.dropped == 0
    assert len(moving(rows["/d_ra/value"])) == FRAMES
    assert len(moving(rows["/clock"])) == len(session.clock)
    assert len(moving(rows["/state/link"])) == len(session.events)
    assert len(moving(rows["/housekeeping/0/supply_v"])) == 1
    assert moving(rows["/verdict"])[-1]["TextDocument:text"][0].startswith("# PASS\n- all limits are kept")
    assert ended_view_threads()


def test_frames_that_the_view_has_no_room_for_are_dropped_and_counted(frames, session, tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    live = LiveState(session.station)
    with live.add(RerunFeed(live, serve=False, save_rrd=path, queue_frames=10)) as view:
        live.on_results(results_of(frames), session)
    assert ended_view_threads()
    shown = len(moving(rows_of(path)["/d_ra/value"]))
    assert view.dropped > 0
    assert shown + view.dropped == FRAMES


def test_what_was_dropped_is_told_in_the_panel(frames, session, tmp_path: Path) -> None:
    path = tmp_path / "live.rrd"
    live = LiveState(session.station)
    view = live.add(RerunFeed(live, serve=False, save_rrd=path, queue_frames=5))
    for frame in frames:
        live.on_results(results_of([frame]), session)
    view.close()
    assert ended_view_threads()
    assert "not shown here:" in moving(rows_of(path)["/verdict"])[-1]["TextDocument:text"][0]


def test_a_page_that_nobody_opens_starts_no_program_and_holds_nothing_up(frames, session) -> None:
    live = LiveState(session.station)
    with live.add(LiveView(live, mode="web")) as view:
        assert view.url.startswith("http://127.0.0.1:")
        for frame in frames:
            live.on_results(results_of([frame]), session)
    assert view.dropped == 0
    assert ended_view_threads()


def wait_until_connected(port: int) -> None:
    """Until a viewer holds a connection to a local port, as Linux tells it."""
    pause = threading.Event()
    for _ in range(round(10 * PATIENCE_S)):
        for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
            _, local, _, state = line.split()[:4]
            if state == "01" and int(local.split(":")[1], 16) == port:
                return
        pause.wait(0.1)
    pytest.fail("the viewer never asked for the data")


def test_a_view_that_breaks_ends_with_one_line_and_the_session_goes_on(
    frames, session, caplog: pytest.LogCaptureFixture
) -> None:
    wrong = replace(frames[0], panorama=replace(frames[0].panorama, xy_px=frames[0].panorama.xy_px[:3]))
    live = LiveState(session.station)
    with live.add(LiveView(live, mode="none")):
        live.on_results(results_of([wrong]), session)
        live.on_results(results_of([frames[1]]), session)
    (record,) = caplog.records
    assert record.getMessage().startswith("the live view has ended")
    assert record.getMessage().endswith("the session goes on")


def test_a_view_that_cannot_open_is_told_and_the_session_goes_on(
    frames, session, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with ViewServer("127.0.0.1", 0, Content()) as page:
        port = page.port
        for mode in ("native", "web"):
            live = LiveState(session.station)
            with live.add(LiveView(live, mode=mode, port=port)) as view:
                live.on_results(results_of([frames[0]]), session)
            assert view.url == ""
    for mode in ("native", "web"):
        live = LiveState(session.station)
        with live.add(LiveView(live, mode=mode, bind="192.0.2.1")) as view:
            live.on_results(results_of([frames[0]]), session)
    native, web, rerun_elsewhere, elsewhere = (record.getMessage() for record in caplog.records)
    assert "no view in rerun: cannot serve on 192.0.2.1" in rerun_elsewhere
    assert "there is no screen for a window here" in native
    assert f"port {port}: Address already in use" in web
    assert "cannot serve the view on 192.0.2.1 port 0: Cannot assign requested address" in elsewhere
    assert native.endswith("the session goes on")


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="needs /proc/net/tcp to see the viewer connect")
@pytest.mark.parametrize("harm", [signal.SIGSTOP, signal.SIGKILL], ids=["frozen", "killed"])
def test_a_viewer_that_is_frozen_or_killed_holds_nothing_up(frames, session, harm: signal.Signals) -> None:
    live = LiveState(session.station)
    view = live.add(RerunFeed(live))
    data = f"rerun+http://127.0.0.1:{view.grpc_port}/proxy"
    viewer = subprocess.Popen(
        [str(rerun_program()), "--headless", "--connect", data, "--port", "auto"],
        env=quiet_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        for frame in frames[:100]:
            live.on_results(results_of([frame]), session)
        wait_until_connected(view.grpc_port)
        viewer.send_signal(harm)
        for _ in range(5):
            for frame in frames:
                live.on_results(results_of([frame]), session)
        closer = threading.Thread(target=view.close)
        closer.start()
        closer.join(PATIENCE_S)
        assert not closer.is_alive()
        assert ended_view_threads()
        assert view.dropped == 0
    finally:
        viewer.kill()
        viewer.wait()


def test_the_rerun_program_sends_no_usage_data_even_where_its_user_allowed_it(tmp_path: Path) -> None:
    (tmp_path / "rerun").mkdir()
    allowed = {
        "analytics_enabled": True,
        "analytics_id": "0" * 32,
        "metadata": {},
        "config_file_path": str(tmp_path / "rerun" / "analytics.json"),
        "data_dir_path": str(tmp_path / "sent"),
    }
    (tmp_path / "rerun" / "analytics.json").write_text(json.dumps(allowed))
    folders = {"XDG_CONFIG_HOME": str(tmp_path), "XDG_DATA_HOME": str(tmp_path), "RUST_LOG": "re_analytics=debug"}
    options = ["--headless", "--bind", "127.0.0.1", "--port", str(free_port("127.0.0.1"))]
    with subprocess.Popen(
        [str(rerun_program()), *options],
        env={**quiet_environment(), **folders},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as viewer:
        guard = threading.Timer(PATIENCE_S, viewer.kill)
        guard.start()
        assert viewer.stdout is not None
        told = next((line for line in viewer.stdout if "nalytics" in line), "nothing")
        viewer.kill()
        guard.cancel()
    assert "disabled" in told
    assert not (tmp_path / "sent").exists()


def get(url: str) -> tuple[bytes, dict[str, str]]:
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(url, timeout=PATIENCE_S) as answer:
        return answer.read(), dict(answer.headers)


def test_the_page_names_no_other_machine_and_forbids_any() -> None:
    with ViewServer("127.0.0.1", 0, Content()) as page:
        for path in ("", "rerun", "rerun.js", "rerun.css"):
            body, headers = get(page.url + path)
            assert b"://" not in body.replace(b"ws://${location.host}/", b"")
            policy = headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy
            assert "connect-src 'self';" in policy
            assert "://" not in policy


def test_the_viewer_itself_comes_out_of_the_rerun_program() -> None:
    with ViewServer("127.0.0.1", 0, Content()) as page:
        assert get(page.url + "re_viewer_bg.wasm")[0][:4] == b"\0asm"
        assert b"wasm_bindgen" in get(page.url + "re_viewer.js")[0]


def test_a_recording_is_served_as_it_is_and_nothing_else_is(tmp_path: Path) -> None:
    recording = tmp_path / "night.rrd"
    recording.write_bytes(b"RRF2" + bytes(1000))
    with ViewServer("127.0.0.1", 0, Content(recording=recording)) as page:
        assert get(page.url + "session.rrd")[0] == recording.read_bytes()
        for path in ("night.rrd", "../night.rrd", "etc/passwd"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                get(page.url + path)


def test_a_port_that_is_taken_is_told_with_what_to_do() -> None:
    with ViewServer("127.0.0.1", 0, Content()) as page:
        port = page.port
        with pytest.raises(GseError, match=f"port {port}: Address already in use; choose another"):
            ViewServer("127.0.0.1", port, Content())


def piece_of(view: LiveView, place: str, path: Path, *, last: str = "") -> tuple[dict[str, list], str, int]:
    """Rows of a piece as a page gets it, its place, and its last instant; in ``path`` with the layout before it."""
    with urllib.request.urlopen(f"{view.url}piece.rrd?after={place}&last={last}", timeout=PATIENCE_S) as answer:
        body = answer.read()
        path.write_bytes(data := body[int(answer.headers["X-Layout-Bytes"]) :])
        rows = rows_of(path) if data else {}
        path.write_bytes(body)
        return rows, answer.headers["X-Place"], int(answer.headers["X-Utc-Ns"])


def printed(path: Path) -> str:
    """What rerun itself says of a recording, a line for each part of it in its order."""
    command = [str(rerun_program()), "rrd", "print", str(path)]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=quiet_environment()).stdout


def wait_for_frames(view: LiveView, frames: list, path: Path) -> tuple[dict[str, list], str]:
    """The first piece of a page with so many frames, and its place."""
    for _ in range(round(10 * PATIENCE_S)):
        rows, place, utc_ns = piece_of(view, "", path)
        if utc_ns == frames[-1].panorama.utc_ns:
            return rows, place
        time.sleep(0.1)
    pytest.fail("the frames never came")


def test_a_page_that_comes_late_gets_the_past_in_one_piece_and_then_only_what_is_new(
    frames, session, tmp_path: Path
) -> None:
    live = LiveState(session.station)
    with live.add(LiveView(live, mode="web", port=free_port("127.0.0.1"), catalog=small_catalog())) as view:
        for event in session.events:
            live.on_event(event)
        for frame in frames[:200]:
            live.on_results(results_of([frame]), session)
        first, place = wait_for_frames(view, frames[:200], tmp_path / "first.rrd")
        for frame in frames[200:]:
            live.on_results(results_of([frame]), session)
        view.conclude("PASS", ["all limits are kept"])
        last, _, utc_ns = piece_of(view, place, tmp_path / "last.rrd", last="1")
        again, place, _ = piece_of(view, "another-recording.7", tmp_path / "again.rrd")
        nothing, _, _ = piece_of(view, place, tmp_path / "nothing.rrd")
    assert utc_ns == frames[-1].panorama.utc_ns
    assert "PASS" in str(moving(last["/verdict"])[-1])
    both = [row["utc"] for rows in (first, last) for row in moving(rows["/d_ra/value"])]
    assert both == [row["utc"] for row in moving(again["/d_ra/value"])]
    assert len(set(both)) == len(both) >= FRAMES
    assert len(first["/sky/catalogue"]) == len(again["/sky/catalogue"]) == 1
    assert "/sky/catalogue" not in last
    assert nothing == {}, "a star that came twice has no name in the viewer"
    assert len(moving(last["/panorama/stars"])) == 1


def test_the_layout_comes_before_all_data_or_else_the_viewer_shows_its_own_and_tells_no_time(
    frames, session, tmp_path: Path
) -> None:
    live = LiveState(session.station)
    with live.add(LiveView(live, mode="web", port=free_port("127.0.0.1"))) as view:
        live.on_results(results_of(frames[:20]), session)
        rows, _ = wait_for_frames(view, frames[:20], tmp_path / "first.rrd")
        for _ in range(12):  # what rerun sends beside it came first in one of five
            piece_of(view, "", tmp_path / "piece.rrd")
            parts = printed(tmp_path / "piece.rrd")
            layout_at = parts.index("BlueprintActivationCommand")
            assert all(parts.index(f" - {path} - ") > layout_at for path in rows)


@pytest.mark.parametrize("place", ["7", "../x.1", "a.b", "a." + "9" * 20])
def test_a_place_that_no_piece_stated_is_refused(session, place: str) -> None:
    live = LiveState(session.station)
    view = live.add(LiveView(live, mode="web", port=free_port("127.0.0.1")))
    with view, pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(f"{view.url}piece.rrd?after={place}", timeout=PATIENCE_S)
