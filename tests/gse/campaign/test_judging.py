"""What a worker does with one session, and what is in the data set then."""

import json
import os
import re
import shutil
import sys
import threading
from dataclasses import asdict

import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as pads
import pyarrow.parquet as pq
import pytest
from fsspec.implementations.local import LocalFileSystem
from numpy.testing import assert_equal
from skies.short_nights import make_session

import gse as gse_api
from drivers.outside_text import is_plain
from gse.campaign.dataset import ATLAS, FRAMES, SCHEMA, SESSIONS, STARS, UNKNOWN, Committed, DataSet
from gse.campaign.engine import plan_campaign
from gse.campaign.judging import Job, judge_source
from gse.campaign.nights import sessions_of
from gse.campaign.sensor_atlas import errors_of, session_errors
from gse.campaign.sources import find_sources
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.errors import UsageError


def judge_all(sources, dataset):
    """Judge in this process what a campaign would give to workers."""
    campaign = plan_campaign(find_sources([str(sources)]), DataSet.at(str(dataset), create=True))
    outcomes = [judge_source(source, campaign.job) for source in campaign.todo]
    campaign.dataset.renew_index([])
    return outcomes


@pytest.fixture(scope="module")
def judged(made, tmp_path_factory):
    """A data set of two nights, a damaged session, and a file that is not a session."""
    folder = tmp_path_factory.mktemp("judged")
    for name in ("night-1.mcap", "night-2.mcap"):
        shutil.copy(made / name, folder / name)
    (folder / "cut.mcap").write_bytes((made / "night-3.mcap").read_bytes()[:-3000])
    (folder / "foreign.mcap").write_bytes(b"no session at all")
    judge_all(folder, folder / "dataset")
    return folder / "dataset"


def test_a_file_that_is_no_session_is_a_row_with_its_error(judged):
    rows = DataSet.at(str(judged)).sessions(["source", "error", "verdict"]).to_pylist()
    errors = {os.path.basename(row["source"]): row["error"] for row in rows if row["error"]}
    assert list(errors) == ["foreign.mcap"]
    assert "is not a session" in errors["foreign.mcap"]
    assert sum(row["verdict"] is not None for row in rows) == 3


def test_instants_keep_their_nanoseconds_in_utc_wherever_the_question_is_asked(judged, gse, monkeypatch):
    monkeypatch.setenv("TZ", "Asia/Jakarta")
    sql = "select min(utc) first, [max(utc)] last from frames where night = '2026-03-01'"
    utc = pads.dataset(judged / "frames" / "sensor=LAPAN-like" / "night=2026-03-01").to_table()["utc"].cast(pa.int64())
    first, last = min(utc.to_pylist()), max(utc.to_pylist())
    assert first % 1000
    text = [f"2026-03-01 15:{ns // 60 % 60:02d}:{ns % 60:02d}" for ns in (first // 10**9, last // 10**9)]
    wanted = [f"{head}.{ns % 10**9:09d}".rstrip("0") + "+00" for head, ns in zip(text, (first, last), strict=True)]
    done = gse("campaign", "query", judged, sql, "--format", "csv").out
    assert done.splitlines()[1] == f"{wanted[0]},['{wanted[1]}']"
    assert json.loads(gse("campaign", "query", judged, sql, "--format", "json").out)["first"] == wanted[0]
    assert wanted[0][:19] in gse("campaign", "query", judged, sql).out


def test_a_report_reads_instants_as_numbers_for_pyarrow_alone_cannot_make_pythons_of_nanoseconds(judged):
    starts = [one.row["first_utc"] for one in sessions_of(DataSet.at(str(judged))) if not one.left_out]
    assert len(starts) == 3
    assert all(type(start) is int and start % 1000 for start in starts)


def test_sessions_too_short_for_a_verdict_show_trends_and_make_a_page(made, gse, tmp_path):
    (tmp_path / "short").mkdir()
    for day in (1, 2):
        make_session(tmp_path / "short" / f"{day}.mcap", day, seed=day, frames=3)
    judge_all(tmp_path / "short", tmp_path / "dataset")
    done = gse("campaign", "report", tmp_path / "dataset", "--out", tmp_path / "report", "--json")
    (sensor,) = json.loads(done.out)["sensors"]
    assert (done.code, sensor["verdict"], sensor["nights"], sensor["rows"]) == (5, "INCONCLUSIVE", 0, [])
    assert {len(trend["nights"]) for trend in sensor["trends"] if "bias" in trend["name"]} == {2}
    page = (tmp_path / "report" / "campaign.html").read_text()
    assert "LAPAN-like: INCONCLUSIVE, 0 nights: no session counts" in page


def test_a_pipe_among_the_sources_is_named_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    (outcome,) = judge_all(tmp_path, tmp_path / "dataset")
    assert (outcome.key, outcome.error) == (
        "",
        f"{tmp_path / 'pipe.mcap'} is not a file of bytes, but a pipe or a device",
    )


def test_pandas_polars_and_pyarrow_read_the_tables_as_they_lie(judged):
    for table, least in (("sessions", 4), ("frames", 80), ("stars", 300)):
        counts = {
            len(pd.read_parquet(judged / table)),
            pl.scan_parquet(judged / table, hive_partitioning=True).select(pl.len()).collect().item(),
            pads.dataset(judged / table, partitioning="hive").count_rows(),
        }
        assert len(counts) == 1
        assert counts.pop() >= least
        schema = pq.read_schema(next((judged / table).glob("sensor=LAPAN-like/*/*.parquet")))
        assert [of.name for of in schema if of.metadata is None or b"unit" not in of.metadata] == []
    frames = pd.read_parquet(judged / "frames")
    assert set(frames["sensor"]) == {"LAPAN-like"}
    assert frames["onboard_d_de_arcsec"].abs().median() < 60


def test_a_query_sees_the_same_rows_with_and_without_the_index(judged, gse, tmp_path):
    copy = shutil.copytree(judged, tmp_path / "copy")
    sql = "select night, verdict, frames from sessions order by all"
    answers = [gse("campaign", "query", copy, sql, "--format", "csv").out]
    shutil.rmtree(copy / "index")
    answers.append(gse("campaign", "query", copy, sql, "--format", "csv").out)
    assert answers[0] == answers[1]
    assert all(night in answers[0] for night in ("2026-03-01", "2026-03-02"))
    assert "unknown" in answers[0]


def test_an_index_of_rows_that_workers_sent_is_that_of_the_files(made, tmp_path):
    (tmp_path / "bad.mcap").write_bytes(b"no session at all")
    shutil.copy(made / "night-1.mcap", tmp_path / "night.mcap")
    outcomes = judge_all(tmp_path, tmp_path / "dataset")
    dataset = DataSet.at(str(tmp_path / "dataset"))
    index = tmp_path / "dataset" / "index" / "sessions.parquet"
    of_files = pq.ParquetFile(index).read()
    assert len(of_files) == len(outcomes) == 2
    for sent in (outcomes, outcomes[:1]):  # all of them, and one beside one that the index has
        have = of_files.filter(
            pc.is_in(of_files["key"], pa.array([one.key for one in outcomes if one not in sent], pa.string()))
        )
        index.unlink()
        if len(have):
            pq.write_table(have, index)
        for one in sent:
            (tmp_path / "dataset" / Committed(one.sensor, one.night, one.key).path(SESSIONS)).write_bytes(b"not read")
        dataset.renew_index([], {one.key: one.row for one in sent})
        assert pq.ParquetFile(index).read().equals(of_files)


def test_frames_of_a_session_that_is_not_whole_are_not_seen(judged, gse, tmp_path):
    copy = shutil.copytree(judged, tmp_path / "copy")
    next((copy / "sessions" / "sensor=LAPAN-like" / "night=2026-03-01").iterdir()).unlink()
    answer = gse("campaign", "query", copy, "select distinct night from frames order by all", "--format", "csv").out
    assert "2026-03-01" not in answer
    assert "2026-03-02" in answer


def test_the_atlas_of_a_session_is_that_of_its_stars_to_the_last_bit(judged):
    dataset = DataSet.at(str(judged))
    places = [place for place in dataset.committed() if place.sensor != UNKNOWN]
    found = [errors_of(dataset.read(place.path(ATLAS))) for place in places]
    camera = parse_station(BUILT_IN_TEXT).sensor.camera()
    for place, errors in zip(places, found, strict=True):
        made = session_errors(dataset.read(place.path(STARS)), dataset.read(place.path(FRAMES)), camera)
        assert_equal(*(None if one is None else asdict(one) for one in (errors, made)))
    assert any(found)


def test_a_session_without_its_atlas_is_named_by_the_report(judged, gse, tmp_path):
    copy = shutil.copytree(judged, tmp_path / "copy")
    sorted((copy / "atlas").glob("*/*/*.parquet"))[0].unlink()
    done = gse("campaign", "report", copy, "--out", tmp_path / "report")
    assert (done.code, "is missing or damaged; delete the file" in " ".join(done.err.split())) == (3, True)


@pytest.mark.parametrize(
    "damage", [lambda data: data[: len(data) // 2], lambda data: b"", lambda data: bytes(len(data))]
)
def test_a_damaged_table_is_named_with_what_to_do(judged, gse, tmp_path, damage):
    copy = shutil.copytree(judged, tmp_path / "copy")
    for table, command in (
        ("frames", ("query", copy, "select count(*) from frames")),
        ("atlas", ("report", copy, "--out", tmp_path / "report")),
    ):
        file = sorted((copy / table).glob("*/*/*.parquet"))[0]
        file.write_bytes(damage(file.read_bytes()))
        done = gse("campaign", *command)
        assert done.code in (2, 3)
        assert file.name in done.err.replace("\n", "")
        assert "delete the file of the same name below sessions/" in " ".join(done.err.split())
    with pytest.raises(UsageError, match="delete the file of the same name"):
        _ = gse_api.load(copy).frames


FORGED = {
    "many rows": lambda row: pa.concat_tables([row] * 1000),
    "no row": lambda row: row.slice(0, 0),
    "other columns": lambda row: row.select(["key", "verdict"]),
    "a file that unpacks to gigabytes": lambda row: pa.table({"key": pa.nulls(20_000_000, pa.string())}),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_row_of_a_session_that_somebody_forged_is_refused(judged, gse, tmp_path, name):
    copy = shutil.copytree(judged, tmp_path / "copy")
    shutil.rmtree(copy / "index")
    session = sorted((copy / "sessions").glob("*/*/*.parquet"))[0]
    pq.write_table(FORGED[name](pq.ParquetFile(session).read()), session)
    done = gse("campaign", "report", copy, "--out", tmp_path / "report")
    assert (done.code, session.name in done.err.replace("\n", ""), "is damaged" in done.err) == (3, True, True)


@pytest.mark.parametrize(
    "forge",
    [
        lambda rows: pa.concat_tables([rows, rows]),
        lambda rows: rows.drop_columns(["key"]),
        lambda rows: rows.drop_columns(["night"]),
        lambda rows: rows.append_column("key", rows["key"]),
        lambda rows: rows.set_column(0, rows.column_names[0], pa.array([1] * len(rows))),
        lambda rows: pa.table({"x": [1, 2]}),
    ],
    ids=["each session twice", "no key", "no night", "two keys", "a number for a text", "something else"],
)
@pytest.mark.parametrize("columns", [("verdict",), None], ids=["a column", "all"])
def test_an_index_that_is_none_of_ours_is_not_used(judged, tmp_path, forge, columns):
    copy = shutil.copytree(judged, tmp_path / "copy")
    index = copy / "index" / "sessions.parquet"
    rows = pq.ParquetFile(index).read()
    expected = DataSet.at(str(copy)).sessions(columns)
    pq.write_table(forge(rows), index)
    assert DataSet.at(str(copy)).sessions(columns).select(expected.column_names) == expected


def test_texts_of_a_forged_data_set_steer_neither_terminal_nor_spreadsheet(judged, gse):
    question = "select '=1+1' || chr(27) || '[2J' || chr(155) || chr(8238) as text, repeat('x', 2000) as long"
    for form in ("text", "csv"):
        out = gse("campaign", "query", judged, question, "--format", form).out
        assert all(is_plain(line) for line in out.splitlines())
    assert "'=1+1\\x1b[2J\\x9b\\u202e" in out
    assert "x" * 2000 in out


def test_a_wrong_question_is_answered_by_duckdb_in_words(judged, gse):
    done = gse("campaign", "query", judged, "select nothing from sessions")
    assert done.code == 2
    assert "nothing" in done.err


def test_a_data_set_of_another_version_is_refused_and_a_foreign_folder_too(gse, made, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "dataset.json").write_text(json.dumps({"schema": "gse.dataset/999"}))
    done = gse("campaign", "judge", made, "--to", other)
    assert (done.code, "gse.dataset/999" in done.err, SCHEMA in done.err) == (2, True, True)
    assert gse("campaign", "judge", made, "--to", made).code == 2
    assert "there is no data set" in gse("campaign", "query", tmp_path / "nowhere", "select 1").err


@pytest.fixture
def full_disk():
    pytest.importorskip("resource")
    return pytest.importorskip("devices.full_disk").full_disk


def test_a_full_disk_leaves_nothing_half_written(judged, full_disk, tmp_path):
    dataset = DataSet.at(str(tmp_path / "dataset"), create=True)
    place = DataSet.at(str(judged)).committed()[0]
    with full_disk(20_000), pytest.raises(OSError, match="large"):
        dataset.put(place, "sessions", judged / place.path("frames"))
    assert dataset.committed() == []
    assert not list((tmp_path / "dataset" / ".parts").iterdir())
    dataset.put(place, "sessions", judged / place.path("frames"))
    assert dataset.committed() == [place]


def test_a_worker_without_room_of_its_own_names_its_folder_and_ends_the_run(made, full_disk, tmp_path):
    dataset = DataSet.at(str(tmp_path / "dataset"), create=True)
    source, job = find_sources([str(made / "night-1.mcap")])[0], Job("one", dataset.url, None)
    with full_disk(20_000):
        outcome = judge_source(source, job)
    assert outcome.ends_run
    assert re.match(r"no room is left under .*session-.* of ", outcome.error)
    assert dataset.committed() == []
    assert judge_source(source, job).error == ""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process that may end")
def test_a_worker_that_is_too_long_at_a_session_ends_and_leaves_nothing(made, tmp_path):
    dataset = DataSet.at(str(tmp_path / "dataset"), create=True)
    source = find_sources([str(made / "night-1.mcap")])[0]
    short = Job("one", dataset.url, None, limit_s=0.02)
    if not (worker := os.fork()):
        judge_source(source, short)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(worker, 0)[1]) == 1
    assert "minutes; --session-limit gives it more" in judge_source(source, short).error
    assert dataset.committed() == []
    assert judge_source(source, Job("next run", dataset.url, None)).error == ""


def test_a_data_set_that_cannot_be_written_ends_the_run(made, tmp_path):
    dataset = DataSet.at(str(tmp_path / "dataset"), create=True)
    (tmp_path / "dataset" / "stars").write_text("in the way")
    outcome = judge_source(find_sources([str(made / "night-1.mcap")])[0], Job("one", dataset.url, None))
    assert outcome.ends_run
    assert outcome.error.startswith(f"{dataset.url} cannot be used")
    assert dataset.committed() == []


class ReadByOneThread(LocalFileSystem):
    """Files that only one thread may read: Arrow's others may hold a file of Python's when the program ends."""

    cachable = False

    def _open(self, path, mode="rb", **options):
        file, owner = super()._open(path, mode, **options), threading.get_ident()
        plain_read = file.read

        def read(*arguments):
            assert threading.get_ident() == owner
            return plain_read(*arguments)

        file.read = read
        return file


def test_the_files_of_a_data_set_are_read_by_the_calling_thread(judged):
    dataset = DataSet(str(judged), ReadByOneThread(), str(judged))
    assert all(dataset.read(place.path("stars")).num_rows for place in dataset.committed() if place.sensor != UNKNOWN)


def test_sources_are_folders_globs_and_files_each_session_once(made, tmp_path):
    everything = [str(made), str(made / "*.mcap"), str(made / "night-1.mcap")]
    assert [os.path.basename(source.url) for source in find_sources(everything)] == [f"night-{n}.mcap" for n in "1234"]
    second = tmp_path / "session.part2.mcap"
    for path in (tmp_path / "session.mcap", second, tmp_path / "session.part10.mcap"):
        shutil.copy(made / "night-1.mcap", path)
    (found,) = find_sources([str(tmp_path)])
    assert [os.path.basename(url) for url in found.segments] == [
        "session.mcap",
        "session.part2.mcap",
        "session.part10.mcap",
    ]
    second.touch()
    assert find_sources([str(tmp_path / "session.mcap")])[0].state != found.state


@pytest.mark.parametrize("url", ["http://127.0.0.1/a", "simplecache::s3://a/b", "github://a:b@/c"])
def test_other_storage_than_that_of_campaigns_is_refused(url):
    with pytest.raises(UsageError, match=r"is not a storage of campaigns|expected a path"):
        find_sources([url])


def test_a_report_names_what_was_left_out_and_is_the_same_again(judged, gse, tmp_path):
    first = gse("campaign", "report", judged, "--out", tmp_path / "first", "--json")
    second = gse("campaign", "report", judged, "--out", tmp_path / "second", "--json")
    assert first.out == second.out
    assert (tmp_path / "first" / "campaign.html").read_bytes() == (tmp_path / "second" / "campaign.html").read_bytes()
    report = json.loads(first.out)
    assert (first.code, report["verdict"]) == (5, "INCONCLUSIVE")
    left_out = {os.path.basename(one["source"]): one["why"] for one in report["left_out"]}
    assert "could not be judged" in left_out["foreign.mcap"]
    (sensor,) = report["sensors"]
    assert {row["name"]: row["nights"] for row in sensor["rows"]}["mean |dDE|"] == sensor["nights"] >= 2
    assert [row["name"] for row in report["requirements"]] == [row["name"] for row in sensor["rows"]]
    (cell,) = next(row["cells"] for row in report["requirements"] if row["name"] == "mean |dDE|")
    assert cell["nights"] == sensor["nights"] == cell["of_nights"] - sensor["nights_not_used"]
    page = (tmp_path / "first" / "campaign.html").read_text()
    assert page.index("Sensors and requirements") < page.index("Requirements of LAPAN-like over its nights")
    assert "foreign.mcap" in page
    assert sum(part["frames"] for part in sensor["conditions"][0]["bins"]) > 0
    assert "Conditions, LAPAN-like" in page
    assert "<strong>INCONCLUSIVE (SIMULATED)</strong>" in page
    assert page.count("<svg") >= 3
    assert gse("campaign", "report", judged, "--out", tmp_path / "first").code == 2


def test_a_sensor_that_is_not_of_the_campaign_has_a_section_of_its_own(judged, made, gse, tmp_path):
    copy = shutil.copytree(judged, tmp_path / "copy")
    judge_all(make_session(tmp_path / "other.mcap", 9, sensor="Other one"), copy)
    done = gse("campaign", "report", copy, "--out", tmp_path / "report", "--json")
    report = json.loads(done.out)
    assert [sensor["name"] for sensor in report["sensors"]] == ["LAPAN-like", "Other one"]
    assert all(len(row["cells"]) == 2 for row in report["requirements"])
    page = (tmp_path / "report" / "campaign.html").read_text()
    assert "<h2>Other one</h2>" in page
    assert "1 session in 1 night, 2026-03-09" in page
    answer = gse("campaign", "query", copy, "select distinct sensor from frames order by all", "--format", "csv")
    assert answer.out.splitlines()[1:] == ["LAPAN-like", "Other one"]


def test_without_its_packages_a_campaign_says_how_to_install_them(gse, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "duckdb", None)
    done = gse("campaign", "query", tmp_path, "select 1")
    assert (done.code, "pip install '.[campaign]'" in done.err) == (2, True)


@pytest.mark.parametrize("url", ["sftp:///folder", "s3://"])
def test_a_url_that_names_no_server_is_refused(url):
    with pytest.raises(UsageError, match="names no server; expected for example"):
        find_sources([url])


@pytest.mark.parametrize("where", ["source", "data set"])
def test_a_password_in_a_url_is_refused_and_never_shown(gse, made, tmp_path, where):
    url = "sftp://user:geheim@127.0.0.1:9/folder"
    places = (url, tmp_path / "set") if where == "source" else (made, url)
    done = gse("campaign", "judge", places[0], "--to", places[1])
    assert done.code == 2
    assert "sftp://user:***@127.0.0.1:9/folder has a password" in " ".join(done.err.split())
    assert "geheim" not in done.err + done.out


@pytest.mark.parametrize("name", ["new\nline.mcap", "red\x1b[31m.mcap", b"no text \xff.mcap"])
def test_a_name_that_steers_a_terminal_is_refused_at_the_door(tmp_path, name):
    file = os.path.join(os.fsencode(tmp_path), os.fsencode(name))
    with open(file, "wb"), pytest.raises(UsageError, match="cannot be shown; rename the file") as refused:
        find_sources([str(tmp_path)])
    assert str(refused.value).isprintable()
