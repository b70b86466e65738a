"""The host's clock as the witness of a sensor's own absolute clock: is the difference one that makes sense?"""

import itertools
from datetime import UTC, date, datetime, timedelta

from drivers.chunk import LinkEvent
from gse.station.events import StationKind
from gse.values.instant import NS_PER_S
from gse.values.sensor_time import epoch_ns, tag_us_of, utc_ns_of
from protocols.description import TimeDescription

LEAST_OFF_S = 0.75
"""A bridge of TCP or Bluetooth delays bytes by up to 0.7 s."""
_WITNESSES = 20
"""Frames whose least difference is judged."""


class ClockWitness:
    """Compares the tags of an absolute clock with the host's, once, after some frames."""

    def __init__(self, time: TimeDescription) -> None:
        self._time = time
        self._least_ns: int | None = None
        self._frames = 0

    def saw(self, host_minus_sensor_ns: int, utc_ns: int, mono_ns: int) -> list[LinkEvent]:
        """The host saw a frame so much later than its tag says that it left; the event, where that makes no sense."""
        self._frames += 1
        least = self._least_ns
        self._least_ns = host_minus_sensor_ns if least is None else min(least, host_minus_sensor_ns)
        if self._frames != _WITNESSES:
            return []
        off_s = self._least_ns / NS_PER_S
        if abs(off_s) < LEAST_OFF_S:
            return []
        looks = looks_like(off_s, self._time, utc_ns)
        text = f"the sensor's clock ({self._time.scale}) is {-off_s:+.3f} s from the host's: {looks}"
        return [LinkEvent(utc_ns, mono_ns, StationKind.SENSOR_CLOCK, text)]


_EPOCHS = (None, date(1958, 1, 1), date(1970, 1, 1), date(1980, 1, 6), date(2000, 1, 1))


def _epoch(time: TimeDescription) -> datetime:
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=epoch_ns(time) // 1000)


def looks_like(off_s: float, time: TimeDescription, utc_ns: int) -> str:
    """What the difference host minus sensor looks like, and what to write; ``utc_ns`` is the host's time."""
    for scale, epoch in itertools.product(("utc", "gps", "tai"), _EPOCHS):
        other = TimeDescription(scale=scale, epoch=epoch or _epoch(time))
        tagged_ns = utc_ns_of(tag_us_of(utc_ns, other), time)
        if tagged_ns != utc_ns and abs(off_s - (utc_ns - tagged_ns) / NS_PER_S) < LEAST_OFF_S:
            words = [f"scale: {scale}"] * (scale != time.scale) + [f"epoch: {epoch}"] * (epoch is not None)
            return f"its tags look like another scale or epoch; try `{', '.join(words)}`"
    if abs(abs(off_s) - 1) < 0.3:
        return "one leap second: its list of leap seconds, or the host's, is old"
    weeks = round(off_s / (1024 * 604_800))
    if weeks and abs(off_s - weeks * 1024 * 604_800) < 100:
        return f"{weeks:+d} times the 1024 weeks after which the week number of GPS rolls over"
    hours = round(off_s / 1800) / 2
    if hours and abs(hours) <= 14 and abs(off_s - hours * 3600) < 30:
        return f"{hours:g} hours: a time zone, or daylight saving time"
    days = round(off_s / 86_400)
    if days and abs(off_s - days * 86_400) < 30:
        return f"{days:+d} days: the date of one of the two clocks is wrong"
    return "one of the two clocks is wrong, or scale and epoch of the tags are others"
