"""Durations on the command line: 90, 90s, 5m, 1h30m."""

import re
from typing import Any

import click

_PARTS = re.compile(r"(?:(\d+(?:\.\d*)?) ?h)? ?(?:(\d+(?:\.\d*)?) ?m(?:in)?)? ?(?:(\d+(?:\.\d*)?) ?s?)?")
_LONGEST_S = 30 * 86_400.0


class Duration(click.ParamType):
    """Seconds of a text such as 90, 90s, 5m or 1h30m."""

    name = "duration"

    def __init__(self, *, least_s: float) -> None:
        self._least_s = least_s

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Seconds; click's own error otherwise."""
        found = _PARTS.fullmatch(str(value).strip().lower())
        hours, minutes, seconds = found.groups() if found else (None, None, None)
        total_s = 3600 * float(hours or 0) + 60 * float(minutes or 0) + float(seconds or 0)
        if not self._least_s <= total_s <= _LONGEST_S:
            self.fail(
                f"{str(value)!r:.60} does not work; expected a time from {self._least_s:g} s to 30 days, "
                "for example 90, 90s, 5m or 1h30m",
                param,
                ctx,
            )
        return total_s
