"""The texts for people name files that exist."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import click
import pytest
from devices.command_line import Gse
from pydantic import BaseModel

from drivers.chunk import LinkKind
from gse.cli import cli
from gse.cli.commands import OLD_NAMES
from gse.config.station import Station
from gse.recording.session_format import RecorderKind
from gse.station.events import StationKind
from gse.values.identifier_options import PLUG_KEYS, IdentifierOptions
from protocols.delimiter import DELIMITERS

ROOT = Path(__file__).parents[1]
TEXTS = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "replays").rglob("*.md")],
    key=lambda path: path.relative_to(ROOT).as_posix(),
)
OF_TODAY = [text for text in TEXTS if text.name != "CHANGELOG.md"]  # which may name what there was
_LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
_HEADING_LINK = re.compile(r"\]\(([^)#: ]*)#([^)]+)\)")
_OUR_FILE = re.compile(r"`((?:gse|drivers|protocols|tests|benchmarks|replays|docs)/[\w./-]*)`")
_COMMAND_LINE = re.compile(r"(?:(?<=`)|^(?: {4})?(?:\$ )?)(gse(?: [^`\n]+(?:\n[^`\n]+(?=`))?)?)(?=`|$)", re.MULTILINE)

_PLACE = re.compile(r"`([\w/]+\.py)` \(`(\w+)`\)")


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_file_that_a_text_names_is_there(text: Path) -> None:
    words = text.read_text(encoding="utf-8")
    linked = [text.parent / name for name in _LINK.findall(words)]
    named = [ROOT / name for name in _OUR_FILE.findall(words)]
    assert [str(path) for path in (*linked, *named) if not path.exists()] == []


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_heading_that_a_text_links_is_there(text: Path) -> None:
    links = _HEADING_LINK.findall(text.read_text(encoding="utf-8"))
    assert [f"{name}#{mark}" for name, mark in links if mark not in marks(text.parent / name if name else text)] == []


def marks(text: Path) -> set[str]:
    """The marks of the headings, as GitHub makes them, and those that the text states."""
    words = text.read_text(encoding="utf-8")
    heads = re.findall(r"^#+ (.*)$", words, re.MULTILINE)
    return set(re.findall(r'<a id="([^"]+)">', words)) | {
        re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads
    }


def test_the_plan_names_functions_that_are_where_it_says() -> None:
    places = _PLACE.findall((ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8"))
    assert len(places) >= 4
    for path, name in places:
        assert re.search(rf"^\s*(?:def|class) {name}\b", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE), name


def test_a_module_that_the_plan_names_without_its_room_is_in_the_room_of_the_path_before_it() -> None:
    rooms, missing = Path(), []
    for line in (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").splitlines():
        for name in re.findall(r"`(\w[\w./]*(?:/|\.py))`", line):
            if "/" in name:
                rooms = ROOT / name if name.endswith("/") else (ROOT / name).parent
            elif not (rooms / name).exists():
                missing.append(f"{name} in {rooms}")
    assert missing == []


PLAN = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")


def test_the_plan_has_each_room() -> None:
    rooms = {path.parent.name for path in (ROOT / "gse").glob("*/__init__.py")}
    _, _, section = PLAN.partition("## Rooms")
    section, _, _ = section.partition("## Decisions")
    assert rooms - set(re.findall(r"gse\.(\w+)", section)) == set()


def test_the_plan_has_each_thread() -> None:
    code = [path.read_text("utf-8") for room in ("gse", "drivers") for path in (ROOT / room).rglob("*.py")]
    names = {name for text in code for name in re.findall(r'Thread\([^)]*name=f?"([\w ]+)', text)}
    assert len(names) > 10
    _, _, section = PLAN.partition("## Threads")
    section, _, _ = section.partition("## State")
    assert [name for name in names if f"`{name}" not in section] == []


def test_the_index_of_the_documentation_lists_every_page() -> None:
    listed = set(_LINK.findall((ROOT / "docs" / "index.md").read_text(encoding="utf-8")))
    assert {path.name for path in (ROOT / "docs").glob("*.md")} - listed == {"index.md"}


def test_the_readme_and_the_guide_for_contributors_give_the_same_two_commands() -> None:
    readme, guide = (
        [
            line
            for line in (ROOT / name).read_text(encoding="utf-8").splitlines()
            if line.startswith("    python3 -m venv")
        ]
        for name in ("README.md", "CONTRIBUTING.md")
    )
    assert len(readme) == 2
    assert readme == guide


SCHEMAS = """
alignment answer benchmark calibration campaign catalog ci compare conventions decode decode.try evaluation frame glance
identifier panorama plan ports preflight protocol.check provenance report selfcheck sensor session session.copy
session.verify sessions station status timing
"""


def test_names_of_schemas_are_what_programs_of_others_look_for() -> None:
    """They do not follow a module that moves: a lab's own identifier reads gse.panorama/1 on its stdin."""
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "gse").rglob("*.py")]
    named = {name for text in texts for name in re.findall(r'"gse\.([a-z.]+)/\d', text)}
    assert named <= set(SCHEMAS.split())
    assert {"panorama", "answer", "calibration", "report", "status"} <= named


def test_the_formats_page_lists_every_kind_of_event() -> None:
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `([A-Z_]+)` \| \S", page, re.MULTILINE)
    assert sorted(listed) == sorted([*LinkKind, *RecorderKind, *StationKind])


@pytest.mark.parametrize("text", OF_TODAY, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_command_line_in_a_text_has_commands_and_options_that_exist(text: Path) -> None:
    lines = _COMMAND_LINE.findall(text.read_text(encoding="utf-8"))
    assert [line for line in lines if not is_understood(line)] == []


def is_understood(line: str) -> bool:
    """Whether the program has the command, and each option that is written with a word."""
    command: click.Command | None = cli
    words = shlex.split(re.split(r" +#| \|| &| >", line)[0])[1:]
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        command = command.get_command(click.Context(command), words.pop(0))
    if command is None:
        return False
    known = {option for parameter in command.get_params(click.Context(command)) for option in parameter.opts}
    return {word.partition("=")[0] for word in words if word.startswith("-")} <= {"-h", "--help", *known}


def commands(command: click.Command, path: str) -> Iterator[tuple[str, click.Command]]:
    """A command and all below it, by the words that call them."""
    yield path, command
    if isinstance(command, click.Group):
        for name in command.list_commands(click.Context(command)):
            below = command.get_command(click.Context(command), name)
            assert below is not None
            yield from commands(below, f"{path} {name}")


def test_the_page_of_the_command_line_has_each_command_with_each_option() -> None:
    """python docs/make_command_line.py writes it."""
    page = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
    parts = dict(re.findall(r"^## (gse[^\n]*)\n\n```\n(.*?)^```$", page, re.MULTILINE | re.DOTALL))
    there = dict(commands(cli, "gse"))
    assert sorted(parts) == sorted(there), "run: python docs/make_command_line.py"
    for path, command in there.items():
        shown = set(re.findall(r"^  (?:-\w, )?(--[a-z][\w-]*)", parts[path], re.MULTILINE))
        today = [param for param in command.params if (path.removeprefix("gse "), param.opts[0]) not in OLD_NAMES]
        hidden = {option for param in today for option in param.opts if option.startswith("--")} - shown
        assert hidden == set(), f"{path}; run: python docs/make_command_line.py"


def keys_of(section: Any) -> dict[str, Any]:
    """The keys of a section of the station file, and what each holds."""
    if not isinstance(section, type) or not section.__module__.startswith("gse."):
        return {}
    if issubclass(section, BaseModel):
        return {key: field.annotation for key, field in section.model_fields.items()}
    return get_type_hints(section) if is_dataclass(section) else {}


def sections_in(hint: Any) -> list[Any]:
    """The sections that a key may hold, by itself, in a list, by name, or not at all."""
    return [hint] if keys_of(hint) else [part for inner in get_args(hint) for part in sections_in(inner)]


def station_keys(section: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every key of the station file that holds a value, with the sections that it is in."""
    for key, hint in keys_of(section).items():
        below = sections_in(hint)
        yield from [(*path, key)] if not below else (k for one in below for k in station_keys(one, (*path, key)))


def test_the_page_of_the_station_file_has_each_key() -> None:
    """A key of a section stands with its section; one further down, and one of a plug, on a page that is linked."""
    pages = ("station-file.md", "uncertainty.md", "conventions.md", "external-identifiers.md")
    page, *linked = ((ROOT / "docs" / name).read_text(encoding="utf-8") for name in pages)
    every = [key for key in station_keys(Station) if key != ("mount", "stated")]  # which the reader itself sets
    assert len(every) > 90
    missing = [
        ".".join(key)
        for key in every
        if f"`{'.'.join(key)}`" not in page
        and not ((len(key) > 2 or key[-1] in PLUG_KEYS) and re.search(rf"\b{key[-1]}\b", "".join([page, *linked])))
    ]
    assert missing == [], "give each a line in docs/station-file.md"


def test_the_page_of_the_station_file_has_each_word_that_an_option_of_an_identifier_may_have() -> None:
    page = (ROOT / "docs" / "station-file.md").read_text(encoding="utf-8")
    hints = get_type_hints(IdentifierOptions)
    words = {key: [word for word in get_args(hint) if isinstance(word, str)] for key, hint in hints.items()}
    assert words["algorithm"]
    missing = [f"identifier.{key}: {word}" for key in words for word in words[key] if f"`{word}`" not in page]
    assert missing == [], "name each in docs/station-file.md"


def test_the_page_of_protocols_has_each_framing_with_an_end() -> None:
    page = (ROOT / "docs" / "protocols.md").read_text(encoding="utf-8")
    assert [kind for kind in DELIMITERS if f"| `{kind}` |" not in page] == [], "give each a row in docs/protocols.md"


STATEMENTS = re.findall(r"^\| ([SN]\d+) \|.*\| ([^|]+) \|$", (ROOT / "docs" / "formulas.md").read_text("utf-8"), re.M)
PRINTED = [each for _, by in STATEMENTS for each in re.findall(r'`gse ([^`]+)` prints "([^"]+)"', by)]


def test_each_statement_of_the_papers_is_shown_by_a_command_or_a_test_that_there_is() -> None:
    code = "".join(path.read_text("utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    known = {*re.findall(r"def (test_\w+)", code), "papers.py", "gse catalog info", *(f"gse {k}" for k, _ in PRINTED)}
    assert [row for row, _ in STATEMENTS] == [*(f"S{k}" for k in range(1, 39)), *(f"N{k}" for k in range(1, 33))]
    named = {row: set(re.findall(r"`([^`]+)`", by)) for row, by in STATEMENTS}
    assert [row for row, names in named.items() if not names or names - known] == []


@pytest.mark.parametrize("command", sorted({command for command, _ in PRINTED}))
def test_a_command_that_shows_a_statement_prints_it(command: str, gse: Gse) -> None:
    out = " ".join(gse(*shlex.split(command)).out.split())
    assert [words for one, words in PRINTED if one == command and words not in out] == []


def test_the_readme_is_read_in_minutes() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 700
