"""The pytest fixture ``gse_session``: a session on the station of ``--gse-station``, judged when the test is over."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from gse.sessions.stepped import SteppedSession


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options of the station and of the folder for sessions."""
    group = parser.getgroup("gse", "ground test station for a star sensor")
    group.addoption("--gse-station", metavar="FILE", help="Station file of the fixture gse_session.")
    group.addoption("--gse-out", metavar="FOLDER", default="sessions", help="Folder for its sessions.")


@pytest.fixture
def gse_session(request: pytest.FixtureRequest) -> "Iterator[SteppedSession]":
    """A session with the sensor of --gse-station; its report is written when the test is over."""
    station = request.config.getoption("--gse-station")
    if station is None:
        pytest.skip("no sensor: give its station file with --gse-station FILE")
    from gse.sessions.stepped import SteppedSession  # only tests that use it wait for what it imports

    with SteppedSession(station, out=request.config.getoption("--gse-out"), name=request.node.name) as session:
        yield session
