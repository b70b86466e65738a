"""Scripts in benchmarks/ that name places of the code name places that are there."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_every_mutant_made_by_hand_finds_its_text_once_and_the_tests_that_must_notice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    rows = importlib.import_module("named_mutants").NAMED
    found = {row.words: (ROOT / row.module).read_text(encoding="utf-8").count(row.before) for row in rows}
    assert {words: times for words, times in found.items() if times != 1} == {}
    assert [row.tests for row in rows if not (ROOT / row.tests).is_file()] == []
