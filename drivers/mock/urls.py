"""URLs of the mock ports: replay://PATH?option=value&... and sim://?option=value&..."""

from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import parse_qsl, quote, unquote, urlencode

from drivers.errors import UrlError


@dataclass(frozen=True, slots=True)
class MockUrl:
    """A mock port's URL, taken apart: the path is unquoted, the options are in ``options``."""

    scheme: str
    path: str
    options: dict[str, str] = field(default_factory=dict)

    def number(self, name: str, default: int, least: int) -> int:
        """A whole-number option; UrlError says what was expected."""
        text = self.options.get(name, "")
        if not text:
            return default
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise UrlError(f"{self.scheme}://: {name}={text} does not work: expected a whole number from {least} on")
        return value

    def speed(self) -> float:
        """The pace against the recorded or simulated time; infinite for ``max``, which is the default."""
        text = self.options.get("speed", "max")
        try:
            speed = float("inf") if text == "max" else float(text)
        except ValueError:
            speed = 0.0
        if not speed > 0:
            raise UrlError(f"{self.scheme}://: speed={text} does not work: expected max, 1, or a factor such as 20")
        return speed


def parse_mock_url(url: str) -> MockUrl:
    """The parts of a mock port's URL; an option given twice is refused."""
    scheme, _, rest = url.partition("://")
    path, _, query = rest.partition("?")
    pairs = parse_qsl(query, keep_blank_values=True)
    options = dict(pairs)
    if len(options) != len(pairs):
        raise UrlError(f"{url}: an option is given twice")
    return MockUrl(scheme.lower(), unquote(path, errors="surrogateescape"), options)


def replay_url(path: Path | str, **options: object) -> str:
    """The URL that replays a recording; any path works, also with spaces, question marks or bytes that are not UTF-8.

    Options: speed, from and to (RFC 3339 UTC; write ``from_`` in Python), loop, cut, start_utc, faults, seed.
    """
    query = urlencode(
        {name.rstrip("_"): value for name, value in options.items() if value is not None}, quote_via=quote
    )
    return "replay://" + quote(str(path), safe="/:\\", errors="surrogateescape") + ("?" + query if query else "")


def sim_url(**options: object) -> str:
    """The URL of a simulated sensor with options."""
    query = urlencode(
        {name.rstrip("_"): value for name, value in options.items() if value is not None}, quote_via=quote
    )
    return "sim://" + ("?" + query if query else "")
