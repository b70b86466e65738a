"""Draws the pictures of README and docs from simulated sessions: report, rerun view, glance page.

    python docs/make_pictures.py

Needs Chromium and the packages of the tests. Each picture is made by the program that it shows.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

DOCS = Path(__file__).parent
GSE = str(Path(sys.executable).with_name("gse"))
SESSION = ("run", "--port", "sim://?frames=900&seed=3")
LIVE = ("run", "--port", "sim://?speed=1&seed=3", "--view", "web", "--duration", "45")
_URL = re.compile(r"http://[^\s/]+")


def report_and_view(folder: Path) -> None:
    """The top of a report, and the session in rerun."""
    subprocess.run([GSE, *SESSION, "--out", str(folder)], check=True, capture_output=True)
    (session,) = folder.iterdir()
    for picture, command in (("report.png", "report"), ("live-view.png", "view")):
        made = folder / picture
        out = ("--out", str(folder / "again")) if command == "report" else ()
        subprocess.run(
            [GSE, command, str(session), *out, "--out" if command == "view" else "--screenshot", str(made)],
            check=True,
            capture_output=True,
        )
        made.replace(DOCS / picture)


def glance(folder: Path) -> None:
    """The glance page on a phone and a laptop, half a minute into a session."""
    with subprocess.Popen([GSE, *LIVE, "--out", str(folder)], stderr=subprocess.PIPE, text=True) as live:
        assert live.stderr is not None
        url = next(found[0] for line in live.stderr if (found := _URL.search(line)))
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path="/usr/bin/chromium")
            for name, width, height in (("glance-phone", 390, 844), ("glance-laptop", 1280, 720)):
                page = browser.new_page(viewport={"width": width, "height": height})
                page.goto(url)
                page.wait_for_timeout(20_000 if "phone" in name else 2_000)
                page.screenshot(path=DOCS / f"{name}.png")
            browser.close()
        live.terminate()
        live.stderr.read()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        report_and_view(Path(folder) / "recorded")
        glance(Path(folder) / "live")
