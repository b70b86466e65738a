"""report.html printed to PDF, by a browser that is at hand."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from gse.errors import GseError, UsageError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_WITHIN_S = 120


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
    """Print a page; the PDF stands beside it."""
    pdf = page.with_suffix(".pdf")
    with tempfile.TemporaryDirectory(prefix="gse-print-") as profile:
        options = ["--headless", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={profile}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            options.append("--no-sandbox")  # Chromium refuses to run as root otherwise; the page is our own
        command = [str(browser), *options, f"--print-to-pdf={pdf}", page.absolute().as_uri()]
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_WITHIN_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise GseError(f"{browser} did not print {page} ({error}); open it and print it yourself") from error
    if not pdf.exists():
        told = (done.stderr.decode("utf-8", "replace").splitlines() or ["no message"])[-1]
        raise GseError(f"{browser} printed no PDF ({told:.200}); open {page} and print it yourself")
    return pdf
