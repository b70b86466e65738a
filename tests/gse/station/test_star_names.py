"""The names that a sensor gives to stars, against the stars that the station finds in its panoramas."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml
from devices.items_sensor import NAMES_TEXT
from mcap.reader import make_reader

from drivers.chunk import Chunk
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX
from gse.campaign.dataset import DataSet
from gse.campaign.engine import plan_campaign
from gse.campaign.judging import judge_source
from gse.campaign.sources import find_sources
from gse.config.station import BUILT_IN_TEXT, parse_station
from gse.report.tables import names_schema
from gse.station.loop import StationLoop
from gse.station.setup import set_up
from gse.station.star_names import named_stars
from gse.values.instant import NS_PER_S
from protocols import Frame, FrameDecoder, StarsMessage, load_protocol, parse_protocol

CLEAR = Path(__file__).parents[3] / "replays" / "golden" / "clear.mcap"
FRAMES, SPOILT = 60, 6
STARS = """
  code: 0x15
  direction: from sensor
  fields: [{name: time, type: u64, unit: us}, {name: count, type: u8}]
  slots:
    count: count
    most: 30
    fields:
      - {name: object, type: u8, offset: 0}
      - {name: star, type: i64}
      - {name: residual, type: i16, unit: arcsec, scale: 0.1}
"""


def with_stars():
    """The protocol panorama-v1 of a sensor that also lists its stars."""
    description = yaml.safe_load(load_protocol("panorama-v1").text)
    description["messages"]["STARS"] = yaml.safe_load(STARS)
    return yaml.safe_dump(description, sort_keys=False)


class Found:
    """A listener that keeps the objects of each panorama with their stars, by time tag."""

    def __init__(self):
        self.stars = {}

    def on_results(self, results, session):
        for k in range(len(results)):
            rows = results.matches.parts.rows(k)
            objects, stars = results.matches.objects[rows].tolist(), results.matches.stars[rows]
            self.stars[int(results.panoramas.time_us[k])] = list(
                zip(objects, stars.tolist(), session.stars.ids[stars].tolist(), strict=True)
            )

    def on_event(self, event):
        pass


@pytest.fixture(scope="module")
def night():
    """Panoramas of a clear night, and the stars of each."""
    decoder, protocol = FrameDecoder(load_protocol("panorama-v1")), load_protocol("panorama-v1")
    records = [record for record in read_capture(CLEAR) if getattr(record, "topic", "") == RX]
    frames = [piece for record in records for piece in decoder.feed(record.data)]
    panoramas = [protocol.decode(frame) for frame in frames if isinstance(frame, Frame) and frame.type == "PANORAMA"][
        :FRAMES
    ]
    found, loop = Found(), StationLoop(set_up(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT))
    loop.listeners = [found]
    for n, panorama in enumerate(panoramas):
        loop.take([chunk_at(protocol.encode(panorama, n), n)])
    assert sum(map(len, found.stars.values())) > 8 * FRAMES
    return panoramas, found.stars


def chunk_at(data, n):
    at_ns = n * NS_PER_S // 10
    return Chunk(1_774_018_800 * NS_PER_S + at_ns, at_ns, data)


def heard(tmp_path, night, number, *, lists_first=False, piece=None):
    """The names of a session whose sensor swaps two names in the last lists; ``number`` makes one of (row, id)."""
    (tmp_path / "stars.yaml").write_text(with_stars())
    text = BUILT_IN_TEXT + f"\nprotocol: {tmp_path / 'stars.yaml'}\n"
    loop, protocol = StationLoop(set_up(parse_station(text), text)), parse_protocol(with_stars(), "stars.yaml")
    for n, panorama in enumerate(night[0]):
        objects, rows, ids = zip(*night[1][panorama.time_us], strict=True)
        names = [number(row, one) for row, one in zip(rows, ids, strict=True)]
        if n >= FRAMES - SPOILT:
            names[0], names[1] = names[1], names[0]
        stars = StarsMessage(panorama.time_us, 0, objects, tuple(names), (1.5,) * len(names))
        sent = [protocol.encode(panorama, 2 * n), protocol.encode(stars, 2 * n + 1)]
        data = b"".join(sent[::-1] if lists_first else sent)
        for at in range(0, len(data), piece or len(data)):
            loop.take([chunk_at(data[at : at + (piece or len(data))], n)])
    loop.finish()
    return loop.session


def by_id(row, one):
    return one


def own(row, one):
    return 7 * row + 3


@pytest.mark.parametrize("number", [by_id, own])
def test_names_that_are_swapped_are_found(tmp_path, night, number):
    session = heard(tmp_path, night, number)
    names = named_stars(session.star_names.rows, session.stars)
    assert (names.lists, names.own_numbers) == (FRAMES, number is own)
    assert (names.wrong, names.wrong_lists) == (2 * SPOILT, SPOILT)
    assert names.known_lists == FRAMES
    assert names.names >= names.known > 8 * FRAMES
    assert names.residual_arcsec == pytest.approx(1.5)
    assert sum(of.names for of in names.most) == 2 * SPOILT


def test_it_does_not_matter_how_the_bytes_are_cut_and_which_comes_first(tmp_path, night):
    rows = heard(tmp_path, night, by_id).star_names.rows
    assert len(rows) > 8 * FRAMES
    for other in ({"piece": 37}, {"lists_first": True}):
        assert (heard(tmp_path, night, by_id, **other).star_names.rows == rows).all()


def test_a_list_is_read_as_it_was_written():
    protocol = parse_protocol(with_stars(), "stars.yaml")
    sent = StarsMessage(12_000, 0, (0, 4), (5_853_498_713_160_606_720, -1), (0.5, -3.0))
    (frame,) = FrameDecoder(protocol).feed(protocol.encode(sent, 3))
    assert protocol.decode(frame) == sent


ORION = """
station: {mount: {inertial: {ra_deg: 83, de_deg: 0, roll_deg: 10}}}
scene: {steps: [{ra_deg: 83, de_deg: 0, for_s: 60}]}
"""


def run(gse, folder, swapped, text=NAMES_TEXT, more=""):
    """The folder of 100 frames of a simulated sensor that swaps names in a share of its lists."""
    (folder / "sensor.yaml").write_text(text, encoding="utf-8")
    (folder / "scenario.yaml").write_text(
        f"text: names\nfirmware: {{swapped_names: {swapped}}}\n{more}", encoding="utf-8"
    )
    station = f"{BUILT_IN_TEXT}\nprotocol: sensor.yaml\nlimits: {{wrong_names_share: 0.1}}\n"
    (folder / "station.yaml").write_text(station, encoding="utf-8")
    port = f"sim://?frames=100&scenario={folder / 'scenario.yaml'}"
    gse("run", "--station", folder / "station.yaml", "--port", port, "--out", folder / "out")
    (made,) = (folder / "out").iterdir()
    return made


def judged(session):
    """The report of a session, and the row of its star names."""
    report = json.loads((session / "report.json").read_text(encoding="utf-8"))
    return report, next(row for row in report["measurements"] if row["name"] == "wrong star names")


def assert_exported(gse, session, folder, names):
    """The tables and topics of a session, and of a campaign of it, have the names of its report."""
    assert gse("session", "export", "--format", "parquet", session, "-o", folder / "tables").code == 0
    table = pq.read_table(folder / "tables" / "names.parquet")
    assert table.schema.equals(names_schema(), check_metadata=True)
    rows = table.drop_columns("utc").to_pylist()
    assert len(rows) == names["names"]
    assert len([row for row in rows if row["wrong"] is not None]) == names["known"]
    wrong = [row for row in rows if row["wrong"]]
    assert (len(wrong), len({row["list"] for row in wrong})) == (names["wrong"], names["wrong_lists"])
    assert all(row["number"] != row["star_id"] for row in wrong)
    assert all(row["number"] == row["star_id"] and row["star"] for row in rows if row["wrong"] is False)
    assert all((row["star"] is None) == (row["star_id"] is None) for row in rows)
    assert gse("session", "export", "--format", "mcap", session, "-o", folder / "results.mcap").code == 0
    with (folder / "results.mcap").open("rb") as file:
        sent = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages(["/results/name"])]
    assert [(of["list"], of["object"], of["wrong"]) for of in sent] == [
        (row["list"], row["object"], row["wrong"]) for row in rows
    ]
    campaign = plan_campaign(find_sources([str(session)]), DataSet.at(str(folder / "data"), create=True))
    (outcome,) = [judge_source(source, campaign.job) for source in campaign.todo]
    assert outcome.error == ""
    campaign.dataset.renew_index([])
    sql = "select count(*) as wrong from names where wrong"
    assert gse("campaign", "query", folder / "data", sql, "--format", "csv").out.split() == ["wrong", str(len(wrong))]


def test_the_simulated_sensor_names_its_stars_and_a_scenario_swaps_some(gse, tmp_path):
    session = run(gse, tmp_path, 0.4)
    report, row = judged(session)
    names = report["star_names"]
    assert (names["lists"], names["known_lists"], names["own_numbers"]) == (100, 100, False)
    assert names["known"] > 800
    assert names["residual_arcsec"] == pytest.approx(14, abs=3)  # 10 arcsec of noise along x and along y
    assert 20 < names["wrong_lists"] < 60
    assert row["outcome"] == "FAIL"
    written = (session / "report.json").read_bytes()
    assert "are used" in gse("report", session).err  # the kept results
    assert (session / "report.json").read_bytes() == written
    assert_exported(gse, session, tmp_path, names)
    gse("replay", session, "--out", tmp_path / "replayed")
    (replayed,) = (tmp_path / "replayed").iterdir()
    assert (replayed / "report.json").read_bytes() == (session / "report.json").read_bytes()


def test_a_narrow_field_has_numbers_of_the_sensors_own(gse, tmp_path):
    assert "star, type: i64" in NAMES_TEXT
    report, row = judged(run(gse, tmp_path, 0, NAMES_TEXT.replace("star, type: i64", "star, type: u16")))
    names = report["star_names"]
    assert (names["lists"], names["own_numbers"], names["wrong"]) == (100, True, 0)
    assert row["outcome"] == "PASS"


def test_of_two_stars_side_by_side_each_has_its_own_name(gse, tmp_path):
    names = judged(run(gse, tmp_path, 0, more=ORION))[0]["star_names"]
    assert (names["known_lists"], names["wrong"]) == (100, 0)
    assert names["known"] > 1000


def test_objects_that_are_no_stars_have_no_names(gse, tmp_path):
    no_stars = ORION.replace("scene: {", "scene: {dropped: 1, false_objects: 5, ")
    session = run(gse, tmp_path, 0, more=no_stars)
    report = judged(session)[0]
    assert "star_names" not in report
    assert report["link"]["frames"] == 200  # a list beside each panorama
