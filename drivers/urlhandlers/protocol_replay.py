"""The port replay://PATH: a recorded session instead of a sensor.

Options, each once, after a question mark: ``speed`` (max, 1, or a factor), ``from`` and ``to`` (RFC 3339 UTC), ``loop``
(passes), ``cut`` (most bytes per chunk), ``start_utc`` (for a raw capture), and those of drivers/faults.py:
``faults``, ``seed``, ``frame_start``, ``ack_start``.
"""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from drivers.chunk import LinkEvent, LinkKind
from drivers.errors import CaptureError, UrlError
from drivers.faults import OPTIONS as FAULT_OPTIONS
from drivers.faults import inject, parse_faults
from drivers.mock_ports import Item, MockUrl, TimestampedSerial, parse_mock_url
from drivers.playback import check_recording, cut, is_session, raw_items, session_items, utc_option

OPTIONS = ("speed", "from", "to", "loop", "cut", "start_utc", *FAULT_OPTIONS)


class Serial(TimestampedSerial):
    """A recording behind the interface of a serial port."""

    def _open_items(self) -> tuple[Iterator[Item], float]:
        url = parse_mock_url(str(self.port))
        if unknown := sorted(set(url.options) - set(OPTIONS)):
            raise UrlError(f"replay:// has no option {', '.join(unknown)}; it has {', '.join(OPTIONS)}")
        speed, loops, most = url.speed(), url.number("loop", 1, least=1), url.number("cut", 0, least=1)
        faults = parse_faults(url.options)
        first = _pass(url)
        items: Iterator[Item] = chain.from_iterable(_passes(first, url, loops))
        if faults is not None:
            items = inject(items, faults, int(self.baudrate))
        return (cut(items, most) if most else items), speed

    def _take(self, data: bytes) -> None:
        """A recording does not answer; the command is ignored, as by a sensor with a cut transmit line."""


def _pass(url: MockUrl) -> Iterator[Item]:
    path = Path(url.path)
    check_recording(path)
    start_utc_ns = utc_option("start_utc", url.options.get("start_utc"))
    if is_session(path):
        return session_items(path, utc_option("from", url.options.get("from")), utc_option("to", url.options.get("to")))
    if start_utc_ns is None:
        raise CaptureError(
            f"{path} is not a session; as a raw serial capture it needs the UTC of its start, "
            "for example --start-utc 2026-03-20T18:30:00Z"
        )
    return raw_items(path, start_utc_ns)


def _passes(first: Iterator[Item], url: MockUrl, loops: int) -> Iterator[Iterator[Item]]:
    yield first
    for number in range(2, loops + 1):
        yield _again(url, number)


def _again(url: MockUrl, number: int) -> Iterator[Item]:
    for position, item in enumerate(_pass(url)):
        if position == 0:
            yield LinkEvent(item.utc_ns, item.mono_ns, LinkKind.LOOP, f"the recording begins again, pass {number}")
        yield item
