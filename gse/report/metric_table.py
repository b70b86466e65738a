"""The metrics of a subject as a table: a line for each metric, a column for each axis."""

from typing import Any

from gse.report.metrics import AXES
from gse.report.terminal import quantity

Line = tuple[str, str, str, tuple[str, ...], str]


def metric_table(metrics: list[dict[str, Any]], subject: str) -> list[Line]:
    """Lines of name, ECSS term, interpretation, cells of AXES (one cell where a metric has no axis), and note."""
    lines: dict[str, list[dict[str, Any]]] = {}
    for metric in metrics:
        if metric["subject"] == subject:
            lines.setdefault(metric["name"], []).append(metric)
    return [_line(name, found) for name, found in lines.items()]


def _line(name: str, found: list[dict[str, Any]]) -> Line:
    of_axis = {metric["axis"]: metric for metric in found}
    cells = [_cell(of_axis[None])] if None in of_axis else [_cell(of_axis.get(axis)) for axis in AXES]
    notes = dict.fromkeys(metric["note"] for metric in found if metric["note"])
    return name, found[0]["ecss_term"], found[0]["interpretation"], tuple(cells), "; ".join(notes)


def _cell(metric: dict[str, Any] | None) -> str:
    """Value, unit and interval; a dash where there is none."""
    if metric is None or metric["value"] is None:
        return "–"
    word, _, rest = metric["unit"].partition(" ")
    value = f"{quantity(metric['value'], word)} {rest}".rstrip()
    if metric["low"] is None or metric["high"] is None:
        return value
    if word == "arcsec" and max(abs(metric["low"]), abs(metric["high"])) >= 3600:
        return f"{value} [{quantity(metric['low'], word)}, {quantity(metric['high'], word)}]"
    return f"{value} [{metric['low']:.2f}, {metric['high']:.2f}]"
