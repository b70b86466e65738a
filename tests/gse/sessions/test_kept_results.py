"""Kept results: the session as it was derived, to the byte, and only where everything is the same."""

import dataclasses
import hashlib
import os
import shutil
from datetime import date
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from skies.synthetic_night import START_NS, small_catalog, synthetic_night

from gse.recording.session_format import PowerReading
from gse.report import summarise
from gse.report.files import write_report
from gse.report.parquet import write_parquet
from gse.report.provenance import ResultKey
from gse.sessions import kept_results
from gse.sessions.kept_results import (
    CONTEXT,
    Judged,
    KeptResultsError,
    judged_session,
    keep,
    kept,
    result_key,
    results_folder,
)
from gse.sessions.replay import replay_session
from gse.station.events import ClockStep, StationKind
from gse.station.session_data import SessionData
from gse.station.setup import versions
from gse.station.star_names import STAR_NAME, StarNames, named_stars
from gse.truth import Alignment
from gse.verdict.assessment import judge
from protocols import AttitudeMessage, StatusMessage
from protocols.description import DelayDescription, TimeDescription

GOLDEN = Path(__file__).parents[3] / "replays" / "golden"
KEY = ResultKey("a" * 64, "b" * 64, "c" * 64)
MADE_BY = {"schema": "gse.provenance/1"}


@pytest.fixture(scope="module")
def session() -> SessionData:
    """A night with something in every field."""
    made = synthetic_night(400)
    made.stars, made.versions = small_catalog().listed, versions()
    made.events.append(ClockStep(START_NS + 10**10, 5, StationKind.CLOCK_STEP, "stepped", -(2 * 10**9), utc_kept=True))
    made.statuses.append((START_NS, StatusMessage(problems=("odd",), firmware=(1, 2, 3), serial=7)))
    for row in made.frames.columns.rows(slice(300)).tolist():
        names = made.frames.columns.dtype.names
        values = dict(zip(names, row, strict=True))
        answer = AttitudeMessage(
            values["time_us"], 120.0, -6.5, 12.0, frame_no=values["frame_no"], state="acquired", latency_s=0.03
        )
        made.sensor_attitudes.append(values["host_utc_ns"], answer)
    made.alignment = Alignment(
        made.station.mount, ((1.0, 0.1, 0.0), (0.1, 2.0, 0.0), (0.0, 0.0, np.inf)), (3.0, 3.0, 30.0), 50, 1, 1, 2
    )
    made.time = TimeDescription(scale="tai", epoch=date(1958, 1, 1), delay_ms=DelayDescription(most=100))
    made.clock_error_s, made.truncated, made.events_not_kept = 0.1, True, 3
    made.power = [PowerReading(START_NS, 0.31, 5.02), PowerReading(START_NS + 1, 0.3, 5.0)]
    return made


@pytest.fixture(scope="module")
def once_kept(session, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept") / "night.results"
    keep(session, judge(session), KEY, folder)
    return folder


@pytest.fixture
def folder(once_kept: Path, tmp_path: Path) -> Path:
    """A copy of the kept results, in the test's own folder."""
    return Path(shutil.copytree(once_kept, tmp_path / "night.results"))


def of(folder: Path, session: SessionData, key: ResultKey = KEY) -> SessionData | None:
    return kept(key, folder, session.station, session.station_text)


def test_every_field_of_a_session_comes_back(session, folder: Path) -> None:
    back = of(folder, session)
    for field in dataclasses.fields(SessionData):
        was, found = getattr(session, field.name), getattr(back, field.name)
        if field.name == "frames":
            assert found.columns.rows().tobytes() == was.columns.rows().tobytes()
        elif field.name == "sensor_attitudes":
            assert found.columns.dtype == was.columns.dtype
            assert found.columns.tobytes() == was.columns.tobytes()
        elif field.name == "housekeeping":
            assert (found.items, found.summaries, found.stride) == (was.items, was.summaries, was.stride)
            assert found.rows.rows().tobytes() == was.rows.rows().tobytes()
        elif field.name == "star_names":
            assert found.rows.tobytes() == was.rows.tobytes()
        elif field.name == "stars":
            rows = session.frames.matches["star"]
            np.testing.assert_array_equal(found.ids[rows], was.ids[rows])
        elif field.name == "statuses":
            assert repr(found) == repr(was)  # with NaN in it
        else:
            assert found == was, field.name
    assert back.frames.matches.tobytes() == session.frames.matches.tobytes()
    assert back.frames.others.dtype == session.frames.others.dtype
    assert back.frames.others.tobytes() == session.frames.others.tobytes() != b""
    assert back.frames.picture_stride == session.frames.picture_stride
    assert [type(event) for event in back.events] == [type(event) for event in session.events]


def test_names_of_stars_come_back_with_the_catalogue_that_judges_them(session, tmp_path: Path) -> None:
    names = np.zeros(4, STAR_NAME)
    ids = session.stars.ids
    matched = np.unique(session.frames.matches["star"])
    other = np.setdiff1d(np.arange(len(ids)), matched)[-1]  # a number of a star that no frame matches
    names["number"], names["star"] = (ids[0], ids[other], 5, ids[0]), (0, 1, 2, -1)
    names["utc_ns"], names["list"], names["residual_arcsec"] = START_NS, 1, (1.5, np.nan, 2.5, 0)
    made = dataclasses.replace(session, star_names=StarNames(names))
    keep(made, judge(made), KEY, tmp_path / "night.results")
    back = of(tmp_path / "night.results", made)
    assert back.star_names.rows.tobytes() == names.tobytes()
    assert (named_stars(names, session.stars).known, named_stars(names, session.stars).wrong) == (2, 1)
    assert judge(back).statistics.names == judge(made).statistics.names


@pytest.mark.parametrize("golden", ["clear.mcap", "ccsds-packets.mcap"])  # a counter, and an absolute clock
def test_the_report_from_kept_results_has_the_bytes_of_a_derivation(tmp_path: Path, golden: str) -> None:
    path = tmp_path / golden
    shutil.copy(GOLDEN / golden, path)
    told: list[str] = []
    reports = []
    for number, anew in enumerate((False, False, True)):
        out = tmp_path / str(number)
        out.mkdir()
        judged = judged_session(
            path, station=lambda own: own, derive=lambda: replay_session(path), tell=told.append, anew=anew
        )
        # Both kinds are drawn alike, from columns that test_every_field_of_a_session_comes_back compares.
        write_report(judged.session, judged.assessment, out, MADE_BY, plots=golden == "clear.mcap")
        reports.append({file.name: file.read_bytes() for file in out.iterdir()})
        assert bool(judged.own_elapsed_us) == (number != 1)
    assert told == [f"results kept in {results_folder(path)} are used"]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["0", "1", "2", golden]  # and nothing beside it
    assert reports[0] == reports[1] == reports[2]


def test_whatever_changed_the_key_is_another(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    path.write_bytes(b"one")
    key = result_key(path, "version: 1")
    assert result_key(path, "version: 1") == key
    assert result_key(path, "version: 1 # changed").text != key.text
    (tmp_path / "session.part2.mcap").write_bytes(b"two")
    assert result_key(path, "version: 1").text != key.text
    assert dataclasses.replace(key, software_sha256="0" * 64).text != key.text


def test_results_of_another_key_are_not_found(session, folder: Path) -> None:
    assert of(folder, session, ResultKey("0" * 64, "b" * 64, "c" * 64)) is None
    other = ResultKey("0" * 64, "b" * 64, "c" * 64)
    (folder / KEY.text).rename(folder / other.text)
    with pytest.raises(KeptResultsError, match="its key is"):
        of(folder, session, other)


@pytest.mark.parametrize(
    "name", ["frames.parquet", "stars.parquet", "answers.parquet", "others.parquet", "names.parquet", CONTEXT]
)
def test_a_damaged_file_is_told(session, folder: Path, name: str) -> None:
    path = folder / KEY.text / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(KeptResultsError, match=f"is not used: {name} does not have its SHA-256"):
        of(folder, session)
    path.unlink()
    with pytest.raises(KeptResultsError, match="is not a file"):
        of(folder, session)


def forge(folder: Path, table: pa.Table) -> None:
    """Another table as the frames, with the hashes that belong to it: only its content is wrong."""
    whole = folder / KEY.text
    before = hashlib.sha256((whole / "frames.parquet").read_bytes()).hexdigest()
    (whole / "frames.parquet").unlink()
    write_parquet([table], whole / "frames.parquet")
    after = hashlib.sha256((whole / "frames.parquet").read_bytes()).hexdigest()
    text = (whole / CONTEXT).read_text().partition("\n")[2].replace(before, after)
    (whole / CONTEXT).write_text(f"{hashlib.sha256(text.encode()).hexdigest()}\n{text}")


@pytest.mark.parametrize("folder_of_it", [Path("session.results"), Path("results")])
def test_results_that_lie_beside_a_session_of_somebody_else_are_not_looked_at(
    tmp_path: Path, folder_of_it: Path
) -> None:
    mine, theirs = tmp_path / "mine" / "session.mcap", tmp_path / "theirs" / "session.mcap"
    for path in (mine, theirs):
        path.parent.mkdir()
        shutil.copy(GOLDEN / "clear.mcap", path)
    assert judged(mine)[1] == []
    shutil.copytree(results_folder(mine), theirs.parent / folder_of_it)
    derived, told = judged(theirs)
    assert derived.own_elapsed_us
    assert told == []


def test_a_table_with_other_columns_is_not_used(session, folder: Path) -> None:
    table = pq.read_table(folder / KEY.text / "frames.parquet")
    forge(folder, table.drop_columns(["utc"]))
    with pytest.raises(KeptResultsError, match="has other columns"):
        of(folder, session)


def test_a_table_that_unpacks_to_very_much_is_not_read(session, folder: Path) -> None:
    table = pq.read_table(folder / KEY.text / "frames.parquet")
    rows = pa.array(np.zeros(len(table), np.int32))
    word = pa.DictionaryArray.from_arrays(rows, pa.array(["x" * (16 << 20)])).cast(table.schema.field("key").type)
    forge(folder, table.set_column(0, table.schema.field("key"), word))
    with pytest.raises(KeptResultsError, match="too much"):
        of(folder, session)


def test_a_writer_that_was_killed_leaves_nothing_that_counts(session, tmp_path: Path) -> None:
    folder = tmp_path / "night.results"
    (folder / f".{KEY.text}.123.part").mkdir(parents=True)
    assert of(folder, session) is None
    whole = keep(session, judge(session), KEY, folder)
    assert whole == folder / KEY.text
    assert of(folder, session) is not None


def test_what_was_used_longest_ago_goes_where_all_kept_results_take_too_much(
    session, tmp_path: Path, monkeypatch
) -> None:
    assessment, folders = judge(session), [tmp_path / "results" / name for name in ("first", "second", "third")]
    keep(session, assessment, KEY, folders[0])
    size = sum(file.stat().st_size for file in (folders[0] / KEY.text).iterdir())
    monkeypatch.setattr(kept_results, "MOST_BYTES", round(2.5 * size))
    keep(session, assessment, KEY, folders[1])
    for number, folder in enumerate(folders[:2]):
        os.utime(folder / KEY.text, ns=(number, number))
    assert of(folders[0], session) is not None  # it was used just now
    keep(session, assessment, KEY, folders[2])
    assert [folder.exists() for folder in folders] == [True, False, True]


def judged(path: Path) -> tuple[Judged, list[str]]:
    """A session as a command has it, and what that says."""
    told: list[str] = []
    found = judged_session(path, station=lambda own: own, derive=lambda: replay_session(path), tell=told.append)
    return found, told


def test_damaged_results_are_derived_anew_with_a_line_and_kept_again(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    shutil.copy(GOLDEN / "clear.mcap", path)
    judged(path)
    (kept_in,) = results_folder(path).iterdir()
    (kept_in / CONTEXT).write_text("{}")
    again, told = judged(path)
    assert again.own_elapsed_us
    assert len(told) == 1
    assert told[0].startswith(f"{kept_in} is not used: ")
    assert told[0].endswith("; derived anew")
    found, told = judged(path)
    assert told == [f"results kept in {kept_in.parent} are used"]
    assert summarise(found.session, found.assessment)["session"]["raw_sha256"]


def test_a_folder_that_cannot_be_written_costs_only_a_line(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    shutil.copy(GOLDEN / "clear.mcap", path)
    results_folder(path).write_text("a file where the folder should be")
    found, told = judged(path)
    assert found.assessment.verdict
    assert told == [f"results cannot be kept in {results_folder(path)}: Not a directory"]


def test_a_user_without_a_cache_directory_derives_anew_each_time_without_a_word(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    path = tmp_path / "session.mcap"
    shutil.copy(GOLDEN / "clear.mcap", path)
    for _ in range(2):
        found, told = judged(path)
        assert found.own_elapsed_us
        assert told == []
