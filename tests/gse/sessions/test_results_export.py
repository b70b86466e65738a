"""Export of results: Parquet that other programs read, MCAP with the bytes and the results of a session."""

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from drivers.session_file.reader import messages
from drivers.session_file.records import RX
from gse.report.tables import frames_schema, stars_schema

GOLDEN = Path(__file__).parents[3] / "replays" / "golden"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "clear.mcap"
    shutil.copy(GOLDEN / "clear.mcap", path)
    return path


def test_results_are_exported_as_parquet_with_units(gse, session: Path, tmp_path: Path) -> None:
    done = gse("session", "export", "--format", "parquet", session, "-o", tmp_path / "tables")
    assert done.code == 0
    frames = pq.read_table(tmp_path / "tables" / "frames.parquet")
    assert frames.schema.equals(frames_schema(), check_metadata=True)
    assert pq.read_table(tmp_path / "tables" / "stars.parquet").schema.equals(stars_schema(), check_metadata=True)
    assert f"{frames.num_rows + pq.read_metadata(tmp_path / 'tables' / 'stars.parquet').num_rows + 1} rows" in done.err
    again = gse("session", "export", "--format", "parquet", session, "-o", tmp_path / "tables")
    assert again.code == 2
    assert "is a directory" in again.err


def test_results_are_topics_with_a_schema_beside_the_bytes(gse, session: Path, tmp_path: Path) -> None:
    before = session.read_bytes()
    gse("session", "export", "--format", "parquet", session, "-o", tmp_path / "tables")
    assert gse("session", "export", "--format", "mcap", session, "-o", tmp_path / "results.mcap").code == 0
    assert session.read_bytes() == before
    with (tmp_path / "results.mcap").open("rb") as file:
        found = [(schema, channel, message) for schema, channel, message in make_reader(file).iter_messages()]
    assert [message.log_time for _, _, message in found] == sorted(message.log_time for _, _, message in found)
    assert all(message.publish_time == message.log_time for _, _, message in found)
    raw = b"".join(message.data for _, channel, message in found if channel.topic == RX)
    assert raw == b"".join(message.data for message in messages(session, RX))
    onboard = [(schema, message) for schema, channel, message in found if channel.topic == "/results/onboard"]
    frames = pq.read_table(tmp_path / "tables" / "frames.parquet")
    given = [json.loads(message.data)["d_de_arcsec"] for _, message in onboard]
    assert given == frames["onboard_d_de_arcsec"].to_pylist()
    schema = onboard[0][0]
    assert schema.encoding == "jsonschema"
    described = json.loads(schema.data)["properties"]
    assert described["d_de_arcsec"] == {"type": ["number", "null"], "description": "arcsec"}
    assert set(json.loads(onboard[0][1].data)) == set(described)
    verdict = next(json.loads(message.data) for _, channel, message in found if channel.topic == "/results/verdict")
    assert verdict == {"verdict": "PASS", "reasons": []}
    assert not any(channel.topic == "/results/sensor" for _, channel, _ in found)


def test_results_need_a_name(gse, session: Path) -> None:
    done = gse("session", "export", "--format", "mcap", session)
    assert done.code == 2
    assert "-o results.mcap" in done.err
