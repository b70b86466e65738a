"""Text from outside, fit to be shown."""

from hypothesis import given
from hypothesis import strategies as st

from drivers.outside_text import MAX_CHARACTERS, is_plain, plain_line, plain_lines, table_cell

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


def test_a_long_line_is_cut_and_says_so() -> None:
    assert len(plain_line("x" * 10**6)) == MAX_CHARACTERS + 4


@given(ANY)
def test_no_cell_of_a_table_is_a_formula(text: str) -> None:
    assert not table_cell(text).lstrip().startswith(("=", "+", "-", "@"))
