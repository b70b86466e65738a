"""A report is told from a changed one, and from that of another session."""

import json
from dataclasses import replace

import pytest
from skies.synthetic_night import synthetic_night

from gse.errors import UsageError
from gse.report.files import write_report
from gse.report.page import Answer, compare_pages, read_page, verify
from gse.report.provenance import fingerprint_in, provenance
from gse.verdict.assessment import judge


def of(session):
    return session, judge(session)


@pytest.fixture(scope="module")
def judged():
    return of(synthetic_night(60))


@pytest.fixture(scope="module")
def files(judged, tmp_path_factory):
    return write_report(*judged, tmp_path_factory.mktemp("report"), plots=False)


@pytest.fixture(scope="module")
def page(files):
    return read_page(files["report.html"])


def test_an_unchanged_report_belongs_to_its_session(page, judged) -> None:
    assert verify(page, *judged).answer is Answer.UNCHANGED


def test_a_report_of_another_host_is_unchanged_too(files, judged, tmp_path) -> None:
    other = provenance({"gse-star-sensor": "0.1.0"}, {"outcome": "agrees", "sha256": "ab"}) | {"host": '<"&elsewhere'}
    page = read_page(write_report(*judged, tmp_path, other, plots=False)["report.html"])
    assert page != read_page(files["report.html"])
    assert verify(page, *judged).answer is Answer.UNCHANGED
    assert (tmp_path / "report.json").read_bytes() == files["report.json"].read_bytes()


def test_the_plots_of_a_page_belong_to_it(page, files, judged, tmp_path) -> None:
    paths = write_report(*judged, tmp_path)
    drawn = read_page(paths["report.html"])
    assert drawn.count("</svg>") > 5
    assert "</svg>" not in page
    assert "--no-plots" in page
    assert "--no-plots" not in drawn
    assert verify(drawn, *judged).answer is Answer.UNCHANGED
    assert verify(drawn.replace("<svg", "<svg hidden", 1), *judged).answer is Answer.CHANGED
    assert paths["report.json"].read_bytes() == files["report.json"].read_bytes()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("INCONCLUSIVE</strong>", "PASS</strong>"),
        ("</body>", "<p>and it passed</p></body>"),
        ("\n", "\r\n"),
        ("schema&#34;:&#34;gse.provenance/1", "schema&#34;: &#34;gse.provenance/1"),
    ],
)
def test_any_change_of_the_page_is_told(old: str, new: str, page) -> None:
    assert old in page
    stated = fingerprint_in(page)
    assert stated is not None
    found = compare_pages(page.replace(old, new, 1), page, stated, stated)
    assert found.answer is Answer.CHANGED
    assert found.detail.startswith("line ")


def test_a_provenance_that_is_no_object_is_a_change_not_a_crash(page, judged) -> None:
    start = page.index('data-json="') + len('data-json="')
    changed = page[:start] + "[" * 2000 + page[page.index('"', start) :]
    assert verify(changed, *judged).answer is Answer.CHANGED


def test_a_report_of_other_bytes_is_of_another_session(page) -> None:
    session = synthetic_night(60)
    session.raw_sha256 = "f" * 64
    assert verify(page, *of(session)).answer is Answer.ANOTHER_SESSION


def test_a_report_of_another_version_is_told(page) -> None:
    session = synthetic_night(60)
    session.versions = {"gse-star-sensor": "0.0.1"}
    found = verify(page, *of(session))
    assert found.answer is Answer.ANOTHER_VERSION
    assert "0.0.1" in found.detail


def test_other_limits_and_other_options_are_told_apart(page) -> None:
    session = synthetic_night(60)
    session.station_text += "# changed\n"
    assert "station file" in verify(page, *of(session)).detail
    session = synthetic_night(60)
    session.station = session.station.model_copy(update={"limits": replace(session.station.limits, d_de_arcsec=61.0)})
    found = verify(page, *of(session))
    assert found.answer is Answer.CHANGED
    assert "report.json" in found.detail


@pytest.mark.parametrize("text", ["", "<html>", '<meta name="gse-report" content="[]">'])
def test_what_is_no_report_is_told(text: str, judged) -> None:
    assert verify(text, *judged).answer is Answer.NO_REPORT


def test_a_page_that_cannot_be_read_is_told(tmp_path) -> None:
    with pytest.raises(UsageError, match="cannot read"):
        read_page(tmp_path / "absent.html")


def test_what_belongs_to_the_host_stands_in_the_provenance_alone(files, page) -> None:
    made_by = json.loads(files["provenance.json"].read_text())
    assert made_by["schema"] == "gse.provenance/1"
    assert made_by["self_check"] is None
    assert {"commit", "packages", "python", "platform", "host", "report_sha256"} <= set(made_by)
    above, last = page.split('<section id="provenance"')
    assert "never run" in last
    for name in ("python", "platform"):
        assert made_by[name] in last
        assert made_by[name] not in above + files["report.json"].read_text()
