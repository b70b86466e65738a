"""The report of several sessions: table 4-1 as the paper has it, a row for each sensor and their mean."""

import json
from statistics import fmean

import pytest
from skies.known_nights import session as made_session

from gse.report.several import sessions_html, sessions_report
from gse.report.summary import PAPER
from gse.verdict.assessment import judge


@pytest.fixture(scope="module")
def report():
    named = []
    for name, bias in (("first", (5.0, 0.0, 0.0)), ("<second>", (30.0, -8.0, 0.0))):
        session = made_session(400, bias=bias)
        named.append((name, session, judge(session)))
    return sessions_report(named)


def test_each_session_has_its_verdict_and_its_row_and_their_mean_follows(report):
    assert [one["name"] for one in report["sessions"]] == ["first", "<second>"]
    assert all(one["verdict"] in ("PASS", "FAIL", "INCONCLUSIVE") for one in report["sessions"])
    rows = report["table_4_1"]["rows"]
    first, second, mean = rows[:3]
    assert [row["name"].split(", ", 1)[1] for row in (first, second)] == ["first, onboard", "<second>, onboard"]
    assert mean["name"] == "mean of 2, onboard"
    for key in ("mean_d_ra_deg", "mean_d_de_deg"):
        assert mean[key] == pytest.approx(fmean((first[key], second[key])), abs=1e-6)
    assert [row["name"] for row in rows[3:]] == [row.name for row in PAPER]
    assert json.loads(json.dumps(report, allow_nan=False)) == report


def test_the_page_shows_the_table_and_runs_nothing_that_a_name_says(report):
    page = sessions_html(report)
    assert "mean of 2, onboard" in page
    assert "&lt;second&gt;" in page
    assert "<second>" not in page
