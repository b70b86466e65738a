"""Notes of the operator: one line, of bounded length, and no more of them than the loop can fetch."""

import pytest

from gse.station.notes import MOST_CHARACTERS, Notes, note_text


def test_notes_are_fetched_once_in_their_order_and_too_many_are_refused():
    notes = Notes()
    assert [notes.put(str(number)) for number in range(21)] == [True] * 20 + [False]
    assert notes.take() == [str(number) for number in range(20)]
    assert notes.take() == []
    assert notes.put("again") is True


def test_a_note_is_one_line_of_printable_characters():
    assert note_text("  clouds\n from\tthe \x07 west ") == "clouds from the west"


def test_a_note_has_280_characters_at_most():
    assert note_text("x" * MOST_CHARACTERS) == "x" * 280
    with pytest.raises(ValueError, match="281 characters; expected 280 at most"):
        note_text("x" * 281)
    with pytest.raises(ValueError, match="the note is empty"):
        note_text(" \n ")
