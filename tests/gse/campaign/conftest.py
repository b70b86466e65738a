"""Sessions of a campaign, made once: short nights of one sensor."""

import shutil
from pathlib import Path

import pytest
from skies.short_nights import make_session

pytest.importorskip("distributed")


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> Path:
    """Four nights, never changed."""
    folder = tmp_path_factory.mktemp("nights")
    for day in range(1, 5):
        make_session(folder / f"night-{day}.mcap", day, seed=day)
    return folder


@pytest.fixture
def nights(made, tmp_path) -> Path:
    """A copy of the four nights, in the test's own folder."""
    return Path(shutil.copytree(made, tmp_path / "nights"))
