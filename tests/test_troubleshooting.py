"""docs/troubleshooting.md has each finding, and a word of each message that ends a session."""

import ast
import functools
import re
from pathlib import Path

import pytest

from gse.cli import cli

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
FINDINGS, MESSAGES = PAGE.split("## Messages that end a session")
ENDING = {
    "CaptureError",
    "CatalogError",
    "CommandError",
    "ConfigError",
    "DescriptionError",
    "GseError",
    "PortError",
    "SerialException",
    "TruthError",
    "UrlError",
}
ROOMS = ("gse/sessions", "gse/station", "gse/config", "gse/identifier", "gse/recording", "gse/truth", "gse/catalog")
FEWEST_LETTERS = 8
"""Less is punctuation around another message."""


def first_cells(text):
    """The words in backticks in the first column of tables."""
    return [word for row in re.findall(r"^\| (`.*?) \|", text, re.M) for word in re.findall(r"`([^`]+)`", row)]


@functools.cache
def sources():
    """The text of each module."""
    paths = (path for room in ("gse", "drivers", "protocols") for path in (ROOT / room).rglob("*.py"))
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


@functools.cache
def everything():
    """All modules in one text, in small letters."""
    return "".join(sources().values()).lower()


def messages():
    """Class, place and constant text of each error that is raised."""
    for name, text in sources().items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                kind = ast.unparse(node.exc.func)
                text = "".join(
                    part.value
                    for part in ast.walk(node.exc.args[0])
                    if isinstance(part, ast.Constant) and isinstance(part.value, str)
                )
                if kind in ENDING or (kind == "UsageError" and name.startswith(ROOMS)):
                    yield f"{name}:{node.lineno}", text


_CAUSES = (
    *("gross_causes", "fine_causes", "fine_findings", "diagnosis", "plain_findings", "misplaced_stars"),
    *("screen_findings", "sensor_convention", "sensor_findings", "sensor_health", "set_up_mistake", "moved_mount"),
)


def source_of(name):
    """The text of a module of the rooms that look for causes."""
    (path,) = (path for room in ("diagnosis", "statistics") for path in (ROOT / "gse" / room).glob(f"{name}.py"))
    return path.read_text(encoding="utf-8")


def causes():
    """The causes that the code names: first texts of findings, hypotheses and tables of them."""
    for name in _CAUSES:
        tree = ast.parse(source_of(name))
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in (
                "Finding",
                "FineHypothesis",
                "GrossHypothesis",
                "of",
            ):
                yield from (arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant) and arg.value)
            if isinstance(node, ast.keyword) and node.arg == "cause" and isinstance(node.value, ast.Constant):
                yield node.value.value
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "CLOCK_SCALES":
                yield from ast.literal_eval(node.value)
            if isinstance(node, ast.FunctionDef) and node.name in ("of_mount", "_clock_words", "event_findings"):
                place = 1 if node.name == "event_findings" else 0
                yield from (
                    of_one.elts[place].value
                    for of_one in ast.walk(node)
                    if isinstance(of_one, ast.Tuple)
                    and len(of_one.elts) > 1
                    and isinstance(of_one.elts[place], ast.Constant)
                )


def test_each_finding_has_its_entry():
    found = set(causes())
    assert {"latitude sign", "roll sign", "clock off by a day", "vibration", "frozen sensor", "none of these"} <= found
    assert found - set(first_cells(FINDINGS)) == set()


def test_each_entry_is_a_finding_of_the_code():
    assert set(first_cells(FINDINGS)) - set(causes()) == set()


def next_steps():
    """Commands in the words of findings and on the page: name and options."""
    for text in (*map(source_of, _CAUSES), *re.findall(r"`(gse [^`]+)`", PAGE)):
        for name, words in re.findall(r"\bgse ([a-z]+)((?: (?:--[a-z-]+|[A-Z][A-Z/]*(?:=[a-z]+)?))*)", text):
            yield name, tuple(re.findall(r"--[a-z-]+", words))


@pytest.mark.parametrize(("name", "options"), sorted(set(next_steps())))
def test_each_next_step_is_a_command_with_its_options(name, options):
    command = cli.get_command(None, name)
    assert command is not None
    below = getattr(command, "commands", {}).values()
    known = {word for one in (command, *below) for option in one.params for word in option.opts}
    assert set(options) <= known


def test_each_message_that_ends_a_session_bears_a_word_of_the_page():
    words = first_cells(MESSAGES)
    told = list(messages())
    assert len(told) > 80
    lost = [
        f"{place}: {text}"
        for place, text in told
        if len(re.findall("[a-z]", text)) >= FEWEST_LETTERS and not any(word.lower() in text.lower() for word in words)
    ]
    assert lost == []


@pytest.mark.parametrize("word", first_cells(MESSAGES))
def test_each_word_of_the_page_is_in_a_message(word):
    assert word.lower() in everything()
