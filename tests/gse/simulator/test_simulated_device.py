"""The simulated sensor as a station meets it: through sim://."""

import re
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from drivers.chunk import Chunk, LinkEvent
from drivers.errors import UrlError
from drivers.link import SerialLink
from drivers.urlhandlers.protocol_sim import register
from gse.config.station import BUILT_IN_TEXT, Station, parse_station
from gse.simulator import device_factory
from gse.station.reception import Reception
from protocols import (
    Ack,
    AttitudeMessage,
    Command,
    FrameDecoder,
    Message,
    Nak,
    PanoramaMessage,
    StatusMessage,
    built_in_names,
    load_protocol,
)

STATION = parse_station(BUILT_IN_TEXT)
PROTOCOL = load_protocol("panorama-v1")


def built_in(name: str) -> str:
    return (files("protocols") / f"{name}.yaml").read_text()


def chunks(station: Station = STATION, **options: str) -> list[Chunk]:
    return list(iter(device_factory(station)(options).next_chunk, None))


def messages(given: list[Chunk], station: Station = STATION) -> list[Message]:
    protocol = load_protocol(station.protocol)
    decoder = FrameDecoder(protocol)
    pieces = [piece for chunk in given for piece in decoder.feed(chunk.data)] + decoder.finish()
    return [protocol.decode(piece) for piece in pieces]


def panoramas(given: list[Chunk], station: Station = STATION) -> list[PanoramaMessage]:
    return [message for message in messages(given, station) if isinstance(message, PanoramaMessage)]


def test_the_default_is_a_minute_of_night_at_10_hz() -> None:
    given = chunks()
    seen = panoramas(given)
    assert [message.frame_no for message in seen] == list(range(600))
    assert all(20 <= len(message.index) <= 30 for message in seen)
    assert 59.8e9 < given[-1].utc_ns - given[0].utc_ns < 60e9


def test_two_default_runs_give_the_same_bytes_at_the_same_times() -> None:
    assert chunks(frames="50") == chunks(frames="50")


def test_another_seed_gives_other_noise() -> None:
    assert chunks(frames="5") != chunks(frames="5", seed="2")


def test_the_sky_turns_between_frames() -> None:
    seen = panoramas(chunks(frames="600"))
    first, last = seen[0], seen[-1]
    apart_px = np.linalg.norm(last.xy_px[None, :5] - first.xy_px[:5, None], axis=2)
    moved_px = np.median(apart_px.min(axis=1))
    assert moved_px == pytest.approx(59.9 * 15.04 / 49.3, abs=2)


def test_objects_come_brightest_first_on_whole_pixels() -> None:
    for message in panoramas(chunks(frames="20")):
        assert (np.diff(message.index) <= 0).all()
        assert (message.xy_px == np.rint(message.xy_px)).all()
        assert len(np.unique(message.xy_px[:, 1])) == len(message.xy_px)


def test_the_sub_pixel_protocol_carries_32nds_of_a_pixel() -> None:
    station = STATION.model_copy(update={"protocol": "panorama-v1-subpixel"})
    xy_px = panoramas(chunks(station, frames="5"), station)[0].xy_px
    assert (xy_px != np.rint(xy_px)).any()
    assert (xy_px * 32 == np.rint(xy_px * 32)).all()


COMMANDED = [name for name in built_in_names() if "START" in load_protocol(name).types]


@pytest.mark.parametrize("name", COMMANDED)
def test_every_protocol_with_commands_starts_at_one(name: str) -> None:
    station = STATION.model_copy(update={"protocol": name})
    protocol = load_protocol(name)
    device = device_factory(station)({"standby": "yes", "frames": "20"})
    device.command(protocol.encode(Command("START", {"period": 100}), 3), 0)
    said = messages(list(iter(device.next_chunk, None)), station)
    seen = [message for message in said if isinstance(message, PanoramaMessage)]
    assert said[0] == Ack("START", 3)
    assert len(seen) in (19, 20)
    assert all(0 < len(message.index) <= protocol.slots and not message.problems for message in seen)


@pytest.mark.parametrize("name", built_in_names())
def test_every_protocol_can_be_spoken(name: str) -> None:
    station = STATION.model_copy(update={"protocol": name})
    protocol = load_protocol(name)
    wanted = PanoramaMessage if protocol.slots else AttitudeMessage
    said = [message for message in messages(chunks(station, frames="20"), station) if isinstance(message, wanted)]
    assert len(said) in (19, 20)  # an answer comes after its exposure
    assert not any(message.problems for message in said)


def test_a_sensor_without_a_word_for_resets_or_panoramas(tmp_path: Path) -> None:
    text = built_in("panorama-v1").replace(", 3: clock reset", "")
    (tmp_path / "terse.yaml").write_text(text)
    terse = STATION.model_copy(update={"protocol": str(tmp_path / "terse.yaml")})
    assert len(panoramas(chunks(terse, scenario="cold-start", rate_hz="1", frames="30"), terse)) > 15
    pattern = re.compile(r"  PANORAMA:\n(?:    .*\n)*")
    dumb = pattern.sub("  PICTURE: {code: 1, direction: from sensor, length: 202, ignored: true}\n", text)
    angles = re.compile(r"  ATTITUDE:\n(?:    .*\n)*")
    dumb = angles.sub("  ANGLES: {code: 3, direction: from sensor, length: 40, ignored: true}\n", dumb)
    (tmp_path / "dumb.yaml").write_text(dumb)
    with pytest.raises(UrlError, match="has no PANORAMA"):
        chunks(STATION.model_copy(update={"protocol": str(tmp_path / "dumb.yaml")}))


def test_a_restart_sets_clock_and_counters_back_and_says_so_once() -> None:
    seen = panoramas(chunks(scenario="cold-start", rate_hz="2"))
    back = [i for i in range(1, len(seen)) if seen[i].time_us < seen[i - 1].time_us]
    assert [i for i, message in enumerate(seen) if "clock reset" in message.flags] == back
    assert len(back) == 1
    assert seen[back[0]].frame_no == 0
    assert seen[0].temperature_c < 0 < seen[-1].temperature_c


def test_a_reset_fault_sets_the_clock_back_and_the_sky_goes_on() -> None:
    register(device_factory(STATION))
    with SerialLink("sim://?frames=300&faults=reset:12.5s") as link:
        items = []
        while not link.at_end:
            items += link.receive(1.0)
    assert [item.text for item in items if isinstance(item, LinkEvent)] == ["reset: the sensor begins again"]
    seen = panoramas([item for item in items if isinstance(item, Chunk)])
    [back] = [i for i in range(1, len(seen)) if seen[i].time_us < seen[i - 1].time_us]
    undisturbed = panoramas(chunks(frames="300"))
    first, then = seen[back], undisturbed[round(14.5 * 10)]  # 2 s to start
    assert (first.frame_no, first.flags) == (0, {"clock reset"})
    apart_px = np.linalg.norm(first.xy_px[:8, None] - then.xy_px[None], axis=2).min(axis=1)
    assert np.median(apart_px) < 2
    long_ago_px = np.linalg.norm(first.xy_px[:8, None] - undisturbed[0].xy_px[None], axis=2).min(axis=1)
    assert np.median(long_ago_px) > 3


def test_stamps_never_go_back_and_the_first_byte_is_read_after_the_exposure() -> None:
    given = chunks(frames="100")
    assert (np.diff([chunk.mono_ns for chunk in given]) >= 0).all()
    assert len({chunk.utc_ns - chunk.mono_ns for chunk in given}) == 1
    reception = Reception(PROTOCOL, baudrate=115200)
    start_ns = 1774018800 * 10**9
    late_ns = []
    for chunk in given:
        for number, panorama in enumerate(reception.receive(reception.stream.feed(chunk)), start=len(late_ns)):
            late_ns.append(panorama.utc_ns - (start_ns + number * 10**8 + 25_000_000))
    assert len(late_ns) == 100
    assert 0 < min(late_ns) <= max(late_ns) < 2_000_000
    assert 0 < np.mean(late_ns[50:]) < 300_000


def test_a_slow_line_loses_exposures_not_bytes() -> None:
    station = STATION.model_copy(update={"port": STATION.port.model_copy(update={"baudrate": 9600})})
    given = chunks(station, frames="100")
    numbers = [message.frame_no for message in panoramas(given)]
    assert 35 < len(numbers) < 50  # 216 bytes of 10 bits at 9600 baud: 0.225 s
    assert numbers == sorted(set(numbers))
    assert sum(len(chunk.data) for chunk in given) == 216 * len(numbers)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"sceanrio": "x"}, "unknown option 'sceanrio'"),
        ({"scenario": "nowhere"}, "expected one of clear-zenith"),
        ({"start": "yesterday"}, "2026-03-20T18:30:00Z"),
        ({"start": "2240-01-01T00:00:00Z"}, "expected an instant from 1972 to 2199"),
        ({"rate_hz": "fast"}, "expected a number"),
        ({"frames": "-1"}, "expected a whole number from 1"),
        ({"frames": "2.5"}, "expected a whole number from 1"),
        ({"seed": "-1"}, "expected a whole number from 0"),
        ({"reset_s": "soon"}, "expected a number"),
        ({"standby": "perhaps"}, "yes or no"),
        ({"level": "photons"}, "panorama, image, image-sub-pixel"),
    ],
)
def test_a_wrong_option_is_told_with_what_was_expected(options: dict[str, str], words: str) -> None:
    with pytest.raises(UrlError, match=words):
        device_factory(STATION)(options)


@pytest.fixture
def ask() -> Callable[[list[Message]], list[Message]]:
    """Sends commands to a sensor in standby through sim:// and gives all that it says in the next 2 s."""
    register(device_factory(STATION))

    def asked(commands: list[Message | bytes]) -> list[Message]:
        with SerialLink("sim://?standby=yes&frames=20") as link:
            for number, command in enumerate(commands):
                link.send(command if isinstance(command, bytes) else PROTOCOL.encode(command, number))
            given = []
            while not link.at_end:
                given += [item for item in link.receive(0) if isinstance(item, Chunk)]
        return messages(given)

    return asked


def test_a_sensor_in_standby_is_silent(ask: Callable[[list[Message]], list[Message]]) -> None:
    assert ask([]) == []


def test_start_stop_and_status_are_obeyed() -> None:
    device = device_factory(STATION)({"standby": "yes", "frames": "50"})
    given = [device.next_chunk()]

    def run_until(seconds: float) -> None:
        while given[-1].utc_ns < given[0].utc_ns + seconds * 1e9:
            given.append(device.next_chunk())

    device.command(PROTOCOL.encode(Command("START", {"period": 200}), 0), given[-1].utc_ns)
    run_until(2.0)
    device.command(PROTOCOL.encode(Command("PING"), 1), given[-1].utc_ns)
    device.command(PROTOCOL.encode(Command("STOP"), 2), given[-1].utc_ns)
    run_until(4.0)
    device.command(PROTOCOL.encode(Command("REQUEST"), 3), given[-1].utc_ns)
    run_until(4.5)
    said = messages([chunk for chunk in given if chunk is not None])
    assert said[0] == Ack("START", 0)
    names = [type(message).__name__ for message in said[1:]]
    stop = names.index("Ack")
    assert names == ["PanoramaMessage"] * (stop - 1) + ["StatusMessage", "Ack", "Ack", "PanoramaMessage"]
    assert 9 <= stop - 1 <= 11
    status = next(message for message in said if isinstance(message, StatusMessage))
    assert (status.mode, status.commands_ok, status.frames_sent) == ("streaming", 2, stop - 1)


def test_what_is_out_of_range_or_broken_is_refused_and_echoes_are_not_answered(
    ask: Callable[[list[Message | bytes]], list[Message]],
) -> None:
    broken = bytearray(PROTOCOL.encode(Command("PING"), 7))
    broken[-1] ^= 1
    said = ask(
        [
            Command("SET_EXPOSURE", {"exposure": 3000000}),
            Command("SET_EXPOSURE", {"exposure": 500000}),
            Command("START", {"period": 100}),
            bytes(broken),
            PROTOCOL.encode(Ack("PING", 0), 4),
            Command("PING"),
        ]
    )
    status = said.pop()
    assert isinstance(status, StatusMessage)
    assert (status.commands_ok, status.commands_bad) == (2, 4)
    assert said == [
        Nak("SET_EXPOSURE", "out of range", 0),
        Ack("SET_EXPOSURE", 1),
        Nak("START", "out of range", 2),
        Nak("PING", "bad CRC", 7),
    ]


@pytest.mark.parametrize(("change", "reason"), [((-1, 1), "bad CRC"), ((4, 0x0E), "unknown"), ((7, 5), "bad length")])
def test_a_frame_that_is_refused_is_answered_at_once_and_once(
    ask: Callable[[list[Message | bytes]], list[Message]], change: tuple[int, int], reason: str
) -> None:
    broken = bytearray(PROTOCOL.encode(Command("PING"), 7))
    broken[change[0]] ^= change[1]
    [alone] = ask([bytes(broken)])
    assert isinstance(alone, Nak)
    assert (alone.reason, alone.sequence) == (reason, 7)
    assert ask([bytes(broken), b"noise", Command("PING")])[:1] == [alone]
    in_halves = ask([bytes(broken[:9]), bytes(broken[9:]), Command("PING")])
    assert in_halves[0] == alone
    assert isinstance(in_halves[1], StatusMessage)


def test_a_longer_exposure_shows_fainter_stars() -> None:
    device = device_factory(STATION)({"standby": "yes", "frames": "50"})
    given = [device.next_chunk()]
    for number, exposure_us in enumerate((10_000, 500_000)):
        device.command(
            PROTOCOL.encode(Command("SET_EXPOSURE", {"exposure": exposure_us}), 2 * number), given[-1].utc_ns
        )
        device.command(PROTOCOL.encode(Command("REQUEST"), 2 * number + 1), given[-1].utc_ns)
        for _ in range(20):
            given.append(device.next_chunk())
    short, long = panoramas([chunk for chunk in given if chunk is not None])
    assert (short.exposure_s, long.exposure_s) == (0.01, 0.5)
    assert len(short.index) < len(long.index)
    assert long.index[0] > 5 * short.index[0]
