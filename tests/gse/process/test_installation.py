"""The folder of this program in the user's cache directory."""

import os
from pathlib import Path

import pytest

from gse.process.installation import cache_folder, own_cache_folder


@pytest.fixture(autouse=True)
def _of_the_test(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


@pytest.mark.skipif(os.name != "posix", reason="modes are of POSIX")
def test_it_is_made_for_this_user_alone() -> None:
    folder = own_cache_folder("results")
    assert folder == cache_folder("results")
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can give a folder away")
def test_the_folder_of_another_user_is_not_used() -> None:
    folder = own_cache_folder("results")
    assert folder is not None
    os.chown(folder, 12_345, -1)
    assert own_cache_folder("results") is None


def test_where_none_can_be_made_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    assert own_cache_folder("results") is None
