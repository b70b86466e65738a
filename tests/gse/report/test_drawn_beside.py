"""The plots that a second process draws."""

import os
import signal

import pytest
from skies.synthetic_night import synthetic_night

from gse.assessment.verdict import judge
from gse.report.drawn_beside import DrawnBeside
from gse.report.page import report_html
from gse.report.session_plots import session_plots
from gse.report.summary import summarise


@pytest.fixture(scope="module")
def session():
    return synthetic_night(100)


@pytest.fixture(scope="module")
def assessment(session):
    return judge(session)


def children() -> set[int]:
    with open(f"/proc/{os.getpid()}/task/{os.getpid()}/children") as file:
        return {int(pid) for pid in file.read().split()}


def test_another_process_draws_the_same_plots_to_the_byte(session, assessment):
    with DrawnBeside() as beside:
        beside.start(session)
        beside.ask(assessment.statistics)
        assert beside.plots() == session_plots(session, assessment.statistics)


def test_two_parts_are_all_plots(session, assessment):
    even, odd = (session_plots(session, assessment.statistics, part=(k, 2)) for k in (0, 1))
    assert not even.keys() & odd.keys()
    assert even | odd == session_plots(session, assessment.statistics)


def test_a_report_has_its_plots_where_the_other_process_is_killed(session, assessment):
    before = children()
    with DrawnBeside() as beside:
        beside.start(session)
        for pid in children() - before:
            os.kill(pid, signal.SIGKILL)
        beside.ask(assessment.statistics)
        page = report_html(session, assessment, summarise(session, assessment), beside=beside)
    assert page == report_html(session, assessment, summarise(session, assessment))


def test_a_report_has_its_plots_where_the_other_process_is_stuck(session, assessment):
    before = children()
    with DrawnBeside(patience_s=0.1) as beside:
        beside.start(session)
        for pid in children() - before:
            os.kill(pid, signal.SIGSTOP)
        beside.ask(assessment.statistics)
        page = report_html(session, assessment, summarise(session, assessment), beside=beside)
    assert page == report_html(session, assessment, summarise(session, assessment))
    assert children() <= before


def test_the_other_process_ends_with_its_block_though_nobody_asked_it(session):
    before = children()
    with DrawnBeside() as beside:
        beside.start(session)
    assert children() <= before
