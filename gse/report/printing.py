"""report.html as PDF or as a picture, by a browser that is at hand."""

import itertools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from gse.errors import GseError, UsageError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_WITHIN_S = 120
PICTURE_PX = "1000,1400"
"""Width and height: the verdict, the measurements and the errors against time."""


def find_browser() -> Path:
    """A browser that prints; UsageError where there is none."""
    for name in BROWSERS:
        found = shutil.which(name)
        if found:
            return Path(found)
    raise UsageError(
        "no browser to print with (looked for chromium and google-chrome); open report.html and print it yourself"
    )


def print_to_pdf(browser: Path, page: Path) -> Path:
    """Print a page; the new PDF stands beside it, numbered where there is one."""
    numbered = (page.with_name(f"{page.stem}-{number}.pdf") for number in itertools.count(2))
    pdf = next(path for path in (page.with_suffix(".pdf"), *itertools.islice(numbered, 998)) if not path.exists())
    _run(browser, page, pdf, "--no-pdf-header-footer", f"--print-to-pdf={pdf.absolute()}")
    return pdf


def save_picture(browser: Path, page: Path, picture: Path) -> None:
    """Write a PNG of the top of a page, as a screen shows it."""
    _run(
        browser, page, picture, f"--window-size={PICTURE_PX}", "--hide-scrollbars", f"--screenshot={picture.absolute()}"
    )


def _run(browser: Path, page: Path, result: Path, *options: str) -> None:
    with tempfile.TemporaryDirectory(prefix="gse-print-", ignore_cleanup_errors=True) as profile:
        common = ["--headless", "--disable-gpu", f"--user-data-dir={profile}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            common.append("--no-sandbox")  # Chromium refuses to run as root otherwise; the page is our own
        command = [str(browser), *common, *options, page.absolute().as_uri()]
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_WITHIN_S)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise GseError(f"{browser} did not print {page} ({error}); open it and print it yourself") from error
    if not result.exists():
        told = (done.stderr.decode("utf-8", "replace").splitlines() or ["no message"])[-1]
        raise GseError(f"{browser} made no {result.name} ({told:.200}); open {page} and print it yourself")
