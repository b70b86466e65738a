"""Whether a report.html belongs to a session, and was changed since.

The report is made again from the session, with the provenance that the page states, and compared byte for byte. Nothing
vouches for the provenance itself: it is of the host that made the report.
"""

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from drivers.host_files import only_a_file
from gse.errors import UsageError
from gse.report.page import NO_PLOTS, PAPER, report_html
from gse.report.provenance import fingerprint, fingerprint_in, provenance_in
from gse.report.summary import summarise
from gse.station.session_data import SessionData
from gse.verdict.assessment import Assessment

MAX_PAGE_BYTES = 50_000_000
"""A report takes 2 MB; anything bigger is another file."""


class Answer(Enum):
    """What a verification found."""

    UNCHANGED = "belongs to this session and is unchanged"
    CHANGED = "belongs to this session but was changed"
    ANOTHER_SESSION = "is of another session"
    ANOTHER_VERSION = "belongs to this session but is of another version of gse"
    NO_REPORT = "is not a report of gse"


@dataclass(frozen=True, slots=True)
class Verification:
    """An answer, and in a line what it follows from."""

    answer: Answer
    detail: str


def read_page(path: Path) -> str:
    """The text of a page as it is, line ends too; UsageError where it cannot be read."""
    try:
        with open(path, "rb", opener=only_a_file) as file:
            content = file.read(MAX_PAGE_BYTES + 1)
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from error
    if len(content) > MAX_PAGE_BYTES:
        raise UsageError(f"{path} is larger than {MAX_PAGE_BYTES} bytes: this is not a report")
    return content.decode("utf-8", "surrogateescape")


def verify(page: str, session: SessionData, assessment: Assessment) -> Verification:
    """Compare a page with the report of a session that was judged with the same options."""
    stated = fingerprint_in(page)
    if stated is None:
        return Verification(Answer.NO_REPORT, "its head holds no fingerprint, or a changed one")
    report = summarise(session, assessment)
    found = fingerprint(report)
    if stated["raw_sha256"] != found["raw_sha256"]:
        return Verification(Answer.ANOTHER_SESSION, _differ("received bytes", stated, found, "raw_sha256"))
    if stated["version"] != found["version"]:
        line = f"made by gse {stated['version']}, this is {found['version']}: verify it with that version"
        return Verification(Answer.ANOTHER_VERSION, line)
    shown = {"plots": NO_PLOTS not in page, "paper": PAPER in page}
    again = report_html(session, assessment, report, provenance_in(page), **shown)
    return compare_pages(page, again, stated, found)


def compare_pages(page: str, again: str, stated: dict[str, Any], found: dict[str, Any]) -> Verification:
    """Compare a page with the one that was made again; ``stated`` and ``found`` are their fingerprints."""
    if page == again:
        line = f"SHA-256 of report.json {found['report_sha256']}; its section Provenance cannot be verified"
        return Verification(Answer.UNCHANGED, line)
    return Verification(Answer.CHANGED, _what_changed(page, again, stated, found))


def _what_changed(page: str, again: str, stated: dict[str, Any], found: dict[str, Any]) -> str:
    if stated["station_sha256"] != found["station_sha256"]:
        return _differ("station file", stated, found, "station_sha256") + "; --station gives another one"
    if stated["report_sha256"] != found["report_sha256"]:
        return (
            _differ("report.json", stated, found, "report_sha256")
            + "; options of the report (--station, --clock-error, --leave-out, --earth-orientation) are needed here too"
        )
    lines, expected = page.split("\n"), again.split("\n")
    pairs = zip([*lines, ""], [*expected, ""], strict=False)
    number, (line, other) = next((place, pair) for place, pair in enumerate(pairs, 1) if pair[0] != pair[1])
    column = next((place for place, (a, b) in enumerate(zip(line, other, strict=False)) if a != b), 0)
    shown = slice(max(column - 20, 0), column + 40)
    return f"line {number}: expected {other[shown]!r}, found {line[shown]!r}"


def _differ(what: str, stated: dict[str, Any], found: dict[str, Any], key: str) -> str:
    return f"SHA-256 of the {what}: {str(stated[key])[:16]}... in the report, {str(found[key])[:16]}... in the session"
