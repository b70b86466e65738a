"""Time tags in several scales, against astropy's own times."""

from datetime import date, datetime

import numpy as np
import pytest
from astropy.time import Time

from gse.station.host_clock import ClockWitness, looks_like
from gse.values.instant import NS_PER_S, from_text
from gse.values.sensor_time import tag_us_of, to_middle_us, utc_ns_of
from protocols.description import TimeDescription

INSTANTS = [
    "1985-07-01T00:00:10Z",
    "2015-12-31T23:59:50Z",
    "2016-12-30T12:00:00Z",
    "2017-01-01T00:00:05Z",
    "2026-03-20T15:00:00Z",
]


@pytest.mark.parametrize("text", INSTANTS)
@pytest.mark.parametrize(
    ("scale", "epoch", "seconds"),
    [
        ("tai", None, lambda t: (t.tai - Time("1958-01-01", scale="tai")).sec),
        ("gps", None, lambda t: t.gps),
        ("unix", None, lambda t: t.unix),
        ("tai", date(2000, 1, 1), lambda t: (t.tai - Time("2000-01-01", scale="tai")).sec),
        ("gps", datetime(2000, 1, 1, 12), lambda t: t.gps - Time("2000-01-01T12:00:00", scale="tai").gps - 19),
    ],
)
def test_a_tag_is_the_utc_that_astropy_gives(text: str, scale: str, epoch: date | None, seconds) -> None:
    time = TimeDescription(scale=scale, epoch=epoch)
    expected_ns = from_text(text)
    tag_us = round(seconds(Time(text.rstrip("Z"), scale="utc")) * 1e6)
    assert abs(utc_ns_of(tag_us, time) - expected_ns) <= 2000
    assert abs(tag_us_of(expected_ns, time) - tag_us) <= 2


@pytest.mark.parametrize(
    ("tag_of", "added_us"), [("middle", 0), ("start", 100_000), ("end", -100_000), ("sent", -185_000)]
)
def test_any_moment_of_an_exposure_gives_its_middle(tag_of: str, added_us: int) -> None:
    assert to_middle_us(TimeDescription(tag_of=tag_of), 0.2, 0.085) == added_us
    assert to_middle_us(TimeDescription(tag_of="start"), float("nan"), 0) == 0


NOW_NS = from_text("2026-03-20T15:00:00Z")


@pytest.mark.parametrize(
    ("stated", "sent", "words"),
    [
        ({"scale": "utc"}, {"scale": "gps"}, "try `scale: gps, epoch: 1980-01-06`"),
        ({"scale": "utc"}, {"scale": "tai", "epoch": date(1970, 1, 1)}, "try `scale: tai"),
        ({"scale": "gps"}, {"scale": "utc", "epoch": date(1980, 1, 6)}, "try `scale: utc"),
        ({"scale": "tai"}, {"scale": "tai", "epoch": date(1970, 1, 1)}, "epoch: 1970-01-01"),
        ({"scale": "unix"}, {"scale": "unix", "epoch": date(2000, 1, 1)}, "epoch: 2000-01-01"),
    ],
)
def test_a_wrong_scale_or_epoch_is_named(stated: dict[str, object], sent: dict[str, object], words: str) -> None:
    witness, time = ClockWitness(TimeDescription(**stated)), TimeDescription(**sent)
    events = []
    for n in range(40):
        now_ns = NOW_NS + n * NS_PER_S
        tagged_ns = utc_ns_of(tag_us_of(now_ns, time), TimeDescription(**stated))
        events += witness.saw(now_ns + 20_000_000 - tagged_ns, now_ns, 0)
    [event] = events
    assert event.kind == "SENSOR_CLOCK"
    assert words in event.text


@pytest.mark.parametrize(
    ("off_s", "words"),
    [
        (1.0, "leap second"),
        (-7200.1, "-2 hours"),
        (1024 * 604_800 + 0.1, "rolls over"),
        (86_400, "+1 days"),
        (5.0, "others"),
    ],
)
def test_other_differences_are_named_too(off_s: float, words: str) -> None:
    assert words in looks_like(off_s, TimeDescription(scale="utc"), NOW_NS)


def test_a_clock_within_the_delay_of_a_bridge_is_no_event() -> None:
    witness = ClockWitness(TimeDescription(scale="utc"))
    rng = np.random.default_rng(1)
    assert not [event for _ in range(100) for event in witness.saw(int(rng.uniform(0.1, 0.7) * NS_PER_S), 0, 0)]
