"""The station's loop gives the same night whether it lives through it or replays it."""

from drivers.chunk import Chunk, LinkEvent
from gse.config import BUILT_IN_TEXT, parse_station
from gse.equipment import prepare
from gse.instant import NS_PER_S
from gse.station import StationLoop
from protocols import StatusMessage, load_protocol

START_NS = 1_774_018_800 * NS_PER_S


def at(seconds: int) -> tuple[int, int]:
    return START_NS + seconds * NS_PER_S, seconds * NS_PER_S


def status() -> bytes:
    message = StatusMessage(time_us=1, temperature_c=20.0, supply_v=5.0, mode="streaming", firmware=(1, 2, 3), serial=1)
    return load_protocol("panorama-v1").encode(message, sequence=1)


def test_a_silence_before_the_port_is_lost_has_its_place_before_it_in_a_replay_too() -> None:
    equipment = prepare(parse_station(BUILT_IN_TEXT), BUILT_IN_TEXT, utc_ns=START_NS)
    live, replayed = StationLoop(equipment), StationLoop(equipment)
    opened, data = LinkEvent(*at(0), "OPENED", "the port is open"), Chunk(*at(1), status())
    lost = LinkEvent(*at(20), "LOST", "the port is gone")
    for item in (opened, data, lost):
        live.pass_time(item.utc_ns, item.mono_ns)
        live.take([item])
        replayed.take([item])
    kinds = [event.kind for event in replayed.night.events]
    assert kinds == ["OPENED", "WAITING", "SYNCING", "STREAMING", "STALE", "LOST", "NO_PORT"]
    assert replayed.night.events == live.night.events
