"""Files that stand whole or not at all."""

import os
from pathlib import Path

import pytest
from devices.full_disk import full_disk

from drivers.host_files import whole_files, write_whole


def test_a_link_that_was_planted_beside_the_file_is_not_written_through(tmp_path: Path) -> None:
    victim, path = tmp_path / "victim", tmp_path / "a.report.json"
    victim.write_text("mine")
    path.with_name("a.report.json.part").symlink_to(victim)
    path.symlink_to(victim)
    with whole_files() as write:
        write(path, ["x"])
        (unfinished,) = [each for each in tmp_path.iterdir() if str(os.getpid()) in each.name]
    unfinished.symlink_to(victim)
    write_whole(path, ["new"])
    assert victim.read_text() == "mine"
    assert (path.read_text(), path.is_symlink(), unfinished.is_symlink()) == ("new", False, False)


def write_together(texts: dict[Path, list[str]]) -> None:
    with whole_files() as write:
        for path, parts in texts.items():
            write(path, parts)


@pytest.mark.parametrize("parts", [["x" * 2000], ["\ud800"]])
def test_of_several_files_none_is_left_where_one_cannot_be_written(tmp_path: Path, parts: list[str]) -> None:
    (tmp_path / "first").write_text("old")
    texts = {tmp_path / "first": ["new"], tmp_path / "second": parts}
    with pytest.raises((OSError, UnicodeEncodeError)), full_disk(1000):
        write_together(texts)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"first": "old"}


def test_a_file_has_the_access_rights_that_the_user_asks_for(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "file", ["text"])
    finally:
        os.umask(before)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o640
