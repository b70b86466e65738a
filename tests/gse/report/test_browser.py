"""The report in a real browser, offline: it opens, it shows all its figures, it prints."""

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from devices.browser import Visits, browser
from skies.known_nights import VOUCHED
from skies.synthetic_night import synthetic_night

from gse.report.files import write_report
from gse.report.printing import find_browser, print_to_pdf
from gse.verdict.assessment import judge


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    session = synthetic_night(200, station=VOUCHED, bias_arcsec=(100.0, 0.0))
    return write_report(session, judge(session), tmp_path_factory.mktemp("report"))["report.html"]


@pytest.fixture(scope="module")
def visit() -> Iterator[Visits]:
    """Pages of one browser."""
    with browser() as visits:
        yield visits


def test_it_opens_offline_with_the_verdict_in_sight_and_no_request(page: Path, visit: Visits) -> None:
    with visit(offline=True, size=(1100, 700)) as seen:
        seen.page.goto(page.as_uri())
        verdict = seen.page.locator(".verdict strong").first.bounding_box()
        assert verdict["y"] + verdict["height"] < 700
        assert seen.page.locator(".verdict strong").first.inner_text() == "FAIL"
        seen.page.set_viewport_size({"width": 390, "height": 844})
        outcome = seen.page.locator("td.FAIL").first.bounding_box()
        assert outcome["x"] + outcome["width"] <= 390, "the outcome of a row is in sight on a phone"
        assert seen.hosts() == set()
        assert seen.errors == []


def test_nothing_sticks_out_of_the_page_on_a_screen_or_a_phone(page: Path, visit: Visits) -> None:
    with visit(offline=True) as seen:
        seen.page.goto(page.as_uri())
        for width in (1100, 700, 420):
            seen.page.set_viewport_size({"width": width, "height": 700})
            assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
            for figure in seen.page.locator("figure svg").all():
                box = figure.bounding_box()
                assert box["width"] > (0.6 if width < 900 else 0.4) * width  # in pairs on a wide screen
                assert box["height"] > 50
                assert box["x"] + box["width"] <= width


def test_it_prints_to_pages_that_hold_every_section(page: Path) -> None:
    if shutil.which("chromium") is None:
        pytest.skip("no Chromium on this machine (Debian: apt install chromium)")
    pdf = print_to_pdf(find_browser(), page)
    assert pdf.read_bytes()[:5] == b"%PDF-"
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext on this machine (Debian: apt install poppler-utils)")
    text = subprocess.run(["pdftotext", "-layout", str(pdf), "-"], capture_output=True, text=True, check=True).stdout
    first = text.split("\f")[0]
    assert "FAIL" in first
    assert "mean |dRA*|" in first
    for section in (
        "Accuracy",
        "Table 4-1",
        "Identification",
        "Truth uncertainty budget",
        "Link and clock",
        "Configuration",
    ):
        assert section in text
    assert text.count("\f") <= 6  # two of them are its truth uncertainty budget
