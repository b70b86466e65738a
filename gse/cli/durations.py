"""Durations on the command line: 90, 90s, 5m, 1h30m."""

import re
from collections.abc import Callable

import click

_PARTS = re.compile(r"(?:(\d+(?:\.\d*)?) ?h)? ?(?:(\d+(?:\.\d*)?) ?m(?:in)?)? ?(?:(\d+(?:\.\d*)?) ?s?)?")
_LONGEST_S = 30 * 86_400.0


def duration_option(*, least_s: float) -> Callable[[click.Context, click.Parameter, str | None], float | None]:
    """A callback of an option: seconds of a text such as 90, 90s, 5m or 1h30m; click's own error otherwise."""

    def read(ctx: click.Context, param: click.Parameter, text: str | None) -> float | None:
        if text is None:
            return None
        found = _PARTS.fullmatch(text.strip().lower())
        hours, minutes, seconds = found.groups() if found else (None, None, None)
        total_s = 3600 * float(hours or 0) + 60 * float(minutes or 0) + float(seconds or 0)
        if not least_s <= total_s <= _LONGEST_S:
            raise click.BadParameter(
                f"{text!r:.60} does not work; expected a time from {least_s:g} s to 30 days, "
                "for example 90, 90s, 5m or 1h30m",
                ctx,
                param,
            )
        return total_s

    return read
