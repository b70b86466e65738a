"""The golden sessions, through replay:// and the station's own loop, give their reports to the last digit."""

from pathlib import Path

import pytest

from gse.sessions.golden import check, expected_path, recordings_in
from gse.sessions.replay import ReplayOptions, replay_session

GOLDEN = Path(__file__).parents[3] / "replays" / "golden"
RECORDINGS = recordings_in(GOLDEN)


@pytest.mark.parametrize("recording", RECORDINGS, ids=lambda path: path.stem)
def test_a_golden_session_gives_its_report_exactly(recording: Path) -> None:
    outcome = check(recording, recording.stem, ReplayOptions())
    assert outcome.passed, outcome


def test_the_bad_cable_gives_the_same_report_in_pieces_of_13_bytes() -> None:
    outcome = check(GOLDEN / "faults.mcap", "faults", ReplayOptions(chunk_bytes=13))
    assert outcome.passed, outcome


def test_one_thread_gives_the_results_and_events_of_two() -> None:
    one, two = (replay_session(GOLDEN / "faults.mcap", threads=threads).session for threads in (1, 2))
    assert one.frames.columns.rows().tobytes() == two.frames.columns.rows().tobytes()
    assert one.frames.matches.tobytes() == two.frames.matches.tobytes()
    assert one.events == two.events


def test_each_golden_session_is_small_and_has_its_command_and_its_words() -> None:
    make, words = (GOLDEN / "make.sh").read_text(), (GOLDEN / "README.md").read_text()
    own = {"clear", "inclined", "cloudy", "faults", "own-answers"}
    wires = {"nsp-polled", "ccsds-packets", "text-lines", "text-objects", "slip-polled", "items"}
    assert {path.stem for path in RECORDINGS} == own | wires
    for path in RECORDINGS:
        assert path.stat().st_size <= 300_000
        assert expected_path(path).exists()
        assert path.stem in make
        assert f"`{path.stem}`" in words
