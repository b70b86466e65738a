"""Text from outside, fit to be shown."""

import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.outside_text import MAX_CHARACTERS, is_plain, plain_line, plain_lines, table_cell, terminal_text

ANY = st.text(st.characters(exclude_categories=()))


@given(ANY)
def test_nothing_in_a_line_steers_and_every_encoding_takes_it(text: str) -> None:
    line = plain_line(text)
    assert is_plain(line)
    line.encode("utf-8")
    assert line.isprintable() or not text.isprintable()
    assert all(is_plain(part) for part in plain_lines(text).replace("\t", "").split("\n"))


@given(st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "Zs")), max_size=MAX_CHARACTERS))
def test_ordinary_text_stays_as_it_is(text: str) -> None:
    assert plain_line(text) == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (
            "no sftp://me:secret@roof/a, sftp://you:other@roof:22/b",
            "no sftp://me:***@roof/a, sftp://you:***@roof:22/b",
        ),
        (
            "socket://127.0.0.1:4000 at 9600, mail me@roof",
            "socket://127.0.0.1:4000 at 9600, mail me@roof",
        ),
        ("sftp://:secret@roof", "sftp://:***@roof"),
    ],
)
def test_passwords_of_urls_are_not_shown(text: str, shown: str) -> None:
    assert plain_line(text) == plain_lines(text) == shown


def test_a_long_line_is_cut_and_says_so() -> None:
    assert len(plain_line("x" * 10**6)) == MAX_CHARACTERS + 4


@given(ANY)
def test_no_cell_of_a_table_is_a_formula(text: str) -> None:
    assert not table_cell(text).lstrip().startswith(("=", "+", "-", "@"))


@given(ANY)
def test_an_xml_file_takes_every_line(text: str) -> None:
    case = ET.Element("case", name=plain_line(text))
    assert ET.fromstring(ET.tostring(case, encoding="unicode")).get("name") == plain_line(text)


@given(ANY)
def test_a_terminal_gets_no_control_code_but_ends_of_lines(text: str) -> None:
    shown = terminal_text(text.replace("\x1b[", ""))
    assert all(is_plain(part) for part in shown.replace("\t", "").replace("\r", "").split("\n"))


@pytest.mark.parametrize("text", ["\x1b[31mred\x1b[0m", "\x1b[2K\r\x1b[1A", "\x1b[?25l", "a\tb\n"])
def test_colours_and_the_cursor_of_the_program_pass_to_the_terminal(text: str) -> None:
    assert terminal_text(text) == text


@pytest.mark.parametrize("text", ["\x1b]0;title\x07", "\x1bP1$r\x1b\\", "\x9b31m", "\x07", "\udcff", "\u202e"])
def test_titles_bells_and_turned_text_do_not_pass_to_the_terminal(text: str) -> None:
    assert is_plain(terminal_text(text))
