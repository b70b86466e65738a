"""``gse view`` and ``gse report`` on a recorded session."""

import json
import shutil
import signal
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

import pytest
from devices.browser import chromium
from devices.command_line import Gse
from devices.patience import PATIENCE_S
from devices.rerun_recording import moving, rows_of
from PIL import Image

FRAMES = 320
GSE = (sys.executable, "-c", "from gse.cli import main; main()")
"""The command in a process of its own."""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a simulated session."""
    from gse.cli import main

    out = tmp_path_factory.mktemp("night")
    with pytest.raises(SystemExit):
        main(["run", "--port", f"sim://?frames={FRAMES}", "--no-plots", "--out", str(out)])
    (folder,) = out.iterdir()
    return folder


def test_a_saved_view_holds_every_frame_of_the_session(gse: Gse, session: Path, tmp_path: Path) -> None:
    path = tmp_path / "night.rrd"
    done = gse("view", session / "session.mcap", "--save", path)
    assert done.code == 0
    assert f"saved: {path}" in done.err
    rows = rows_of(path)
    report = json.loads((session / "report.json").read_text())
    errors = [row["Scalars:scalars"][0] for row in moving(rows["/d_de/value"])]
    assert len(errors) == FRAMES
    assert sum(errors) / FRAMES == pytest.approx(report["accuracy"]["onboard"]["d_de"]["bias_arcsec"], abs=0.001)
    (text,) = [row["TextDocument:text"][0] for row in rows["/verdict"] if row["static"]]
    assert report["verdict"] in text.splitlines()[0]


def test_nothing_is_overwritten(gse: Gse, session: Path, tmp_path: Path) -> None:
    path = tmp_path / "night.rrd"
    path.write_text("mine")
    done = gse("view", session / "session.mcap", "--save", path)
    assert done.code == 2
    assert "exists already; choose another name" in done.err
    assert path.read_text() == "mine"


def test_a_picture_is_drawn_without_a_screen(gse: Gse, session: Path, tmp_path: Path) -> None:
    picture = tmp_path / "night.png"
    done = gse("view", session / "session.mcap", "--out", picture)
    if "needs Vulkan" in done.err:
        pytest.skip("no Vulkan on this machine (Debian: apt install mesa-vulkan-drivers)")
    assert done.code == 0, done.err
    with Image.open(picture) as image:
        assert image.size == (1920, 1080)
        assert len(image.convert("RGB").getcolors(1 << 24) or []) > 500


def test_the_picture_must_be_a_new_png(gse: Gse, session: Path, tmp_path: Path) -> None:
    done = gse("view", session / "session.mcap", "--out", tmp_path / "night.jpg")
    assert done.code == 2
    assert "name it .png" in done.err


def test_the_web_view_serves_the_session_until_it_is_interrupted(session: Path) -> None:
    command = [*GSE, "view", str(session / "session.mcap"), "--view", "web"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
        assert running.stderr is not None
        guard = threading.Timer(2 * PATIENCE_S, running.kill)
        guard.start()
        line = next(line for line in running.stderr if "http://" in line)
        url = line.split()[1]
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(url + "session.rrd", timeout=PATIENCE_S) as answer:
            assert answer.read(3) == b"RRF"
        running.send_signal(signal.SIGINT)
        assert running.wait(PATIENCE_S) == 0
        guard.cancel()


def test_the_report_command_gives_the_report_of_the_run_beside_the_session(gse: Gse, session: Path) -> None:
    done = gse("report", session / "session.mcap")
    assert done.code == 0
    for name in ("report.json", "report.html", "frames.csv", "junit.xml"):
        assert (session / "report" / name).read_bytes() == (session / name).read_bytes(), name


def test_a_folder_that_is_there_is_not_written_into(gse: Gse, session: Path, tmp_path: Path) -> None:
    done = gse("report", session / "session.mcap", "--out", tmp_path)
    assert done.code == 2
    assert "exists already; choose another name" in done.err


def test_the_report_is_printed_where_there_is_a_browser(gse: Gse, session: Path, tmp_path: Path) -> None:
    chromium()
    picture = ("--screenshot", tmp_path / "top.png")
    done = gse("report", session / "session.mcap", "--out", tmp_path / "printed", "--pdf", "--json", *picture)
    assert done.code == 0
    assert json.loads(done.out)["schema"] == "gse.report/1"
    assert (tmp_path / "printed" / "report.pdf").read_bytes()[:5] == b"%PDF-"
    with Image.open(tmp_path / "top.png") as image:
        assert image.size == (1000, 1400)
        colours = image.convert("RGB").getcolors(1 << 24) or []
    assert max(count for count, colour in colours if colour == (0, 107, 79)) > 10_000, "the green of PASS"


def test_without_a_browser_it_is_said_before_any_work(
    gse: Gse, session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    out = tmp_path / "printed"
    done = gse("report", session / "session.mcap", "--out", out, "--pdf")
    assert done.code == 2
    assert "no browser to print with" in done.err
    assert not out.exists()


@pytest.mark.parametrize("command", ["view", "report"])
def test_a_missing_or_foreign_file_is_told_in_a_line(gse: Gse, tmp_path: Path, command: str) -> None:
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(b"no session at all" * 100)
    for path in (tmp_path / "absent.mcap", foreign):
        options = ["--save", tmp_path / "x.rrd"] if command == "view" else []
        done = gse(command, path, *options)
        assert done.code == 2
        assert path.name in done.err
        assert len(done.err.splitlines()) <= 2
    assert not (tmp_path / "x.rrd").exists()


def test_a_pdf_stands_beside_the_report_that_is_there_and_over_no_older_one(
    gse: Gse, session: Path, tmp_path: Path
) -> None:
    chromium()
    folder = tmp_path / "night"
    shutil.copytree(session, folder)
    assert gse("report", session, "--plots", "--out", tmp_path / "plotted").code == 0
    shutil.copy(tmp_path / "plotted" / "report.html", folder)
    (folder / "report.pdf").write_text("an older one")
    before = {path.name for path in folder.iterdir()}
    done = gse("report", folder, "--pdf")
    assert f"PDF: {folder / 'report-2.pdf'}" in done.err
    assert {path.name for path in folder.iterdir()} - before == {"report-2.pdf"}
    assert (folder / "report-2.pdf").read_bytes()[:5] == b"%PDF-"
    assert (folder / "report.pdf").read_text() == "an older one"
