"""The names that a sensor gives to stars, against the stars that the station finds in its panoramas."""

from pathlib import Path

import pytest
import yaml

from drivers.chunk import Chunk
from drivers.session_file.reader import read_capture
from drivers.session_file.records import RX
from gse.config.station import BUILT_IN_TEXT, parse_station
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
