"""Scripts in benchmarks/ that name places and commands of the code name those that are there."""

import importlib
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from gse.cli import cli

ROOT = Path(__file__).parents[1]


def test_every_mutant_made_by_hand_finds_its_text_once_and_the_tests_that_must_notice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    rows = importlib.import_module("named_mutants").NAMED
    found = {row.words: (ROOT / row.module).read_text(encoding="utf-8").count(row.before) for row in rows}
    assert {words: times for words, times in found.items() if times != 1} == {}
    assert [row.tests for row in rows if not (ROOT / row.tests).is_file()] == []


def leaves(group: click.Group, before: str = "") -> Iterator[str]:
    """Commands that have none below them, as they are typed after ``gse``."""
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        words = f"{before}{name}"
        if isinstance(command, click.Group):
            yield from leaves(command, f"{words} ")
        else:
            yield words


def test_every_command_is_disturbed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    every = importlib.import_module("refused").EVERY
    assert set(every) == set(leaves(cli))
    assert [name for name, line in every.items() if not line.startswith(name)] == []
