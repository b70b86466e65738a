"""Notes of the operator: one line, of bounded length, and no more of them than the loop can fetch."""

import pytest

from gse.station.events import MOST_CHARACTERS, Notes, event_of, note_text


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


@pytest.mark.parametrize(
    ("line", "event"),
    [
        ("clouds from the west", ("NOTE", "clouds from the west")),
        ("mount: kicked", ("MOUNT_TOUCHED", "kicked")),
        ("mount:", ("MOUNT_TOUCHED", "the mount was touched")),
        ("the mount: still", ("NOTE", "the mount: still")),
    ],
)
def test_a_note_of_the_mount_is_an_event_of_its_own(line, event):
    assert event_of(line) == event
