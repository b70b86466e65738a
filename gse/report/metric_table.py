"""The metrics of a subject as a table: a line for each metric, a column for each axis."""

from typing import Any

from gse.report.summary import plain
from gse.report.terminal import quantity
from gse.statistics.metrics import metrics
from gse.statistics.session_statistics import Statistics
from gse.values.axis import OF_SENSOR

_AXIS_WORDS = {axis.key: axis.label for axis in OF_SENSOR}

Line = tuple[str, str, str, tuple[str, ...], str]


def metric_table(documents: list[dict[str, Any]], subject: str) -> list[Line]:
    """Lines of name, ECSS term, interpretation, cells of its axes (one where a metric has none), and note."""
    lines: dict[str, list[dict[str, Any]]] = {}
    for metric in documents:
        if metric["subject"] == subject:
            lines.setdefault(metric["name"], []).append(metric)
    return [_line(name, found) for name, found in lines.items()]


def metrics_in_markdown(stats: Statistics) -> str:
    """The known metrics as a narrow table in Markdown, for the panel of a view, wrong star names, and the names of the
    metrics that are not known."""
    documents = plain([*metrics(stats)])
    known = [metric for metric in documents if metric["value"] is not None]
    lines = [f"| {_name(metric, of_several=len(stats.subjects) > 1)} | {_cell(metric)} |" for metric in known]
    absent = dict.fromkeys(metric["name"] for metric in documents if metric["value"] is None)
    lines += [f"| wrong star names | {stats.names} |"] if stats.names else []
    table = "\n".join(["| x: along columns, y: along rows | |", "|---|---|", *lines])
    return f"{table}\n\nnot known in this session so far: {'; '.join(absent)}" if absent else table


def _name(metric: dict[str, Any], *, of_several: bool) -> str:
    subject = f"{metric['subject']} " if of_several else ""
    axis = f", {_AXIS_WORDS[metric['axis']]}" if metric["axis"] else ""
    return f"{subject}{metric['name']}{axis}"


def _line(name: str, found: list[dict[str, Any]]) -> Line:
    of_axis = {metric["axis"]: metric for metric in found}
    cells = [_cell(of_axis[None])] if None in of_axis else [_cell(of_axis.get(axis.key)) for axis in OF_SENSOR]
    notes = dict.fromkeys(_note(metric, found) for metric in found if metric["note"])
    return name, found[0]["ecss_term"], found[0]["interpretation"], tuple(cells), "; ".join(notes)


def _note(metric: dict[str, Any], found: list[dict[str, Any]]) -> str:
    """The note of a metric; one on an axis that has no value beside others that have one is on its dash."""
    is_dash = metric["value"] is None and any(other["value"] is not None for other in found)
    return f"a dash: {metric['note']}" if is_dash else str(metric["note"])


def _cell(metric: dict[str, Any] | None) -> str:
    """Value, unit and interval; a dash where there is none."""
    if metric is None or metric["value"] is None:
        return "–"
    word, _, rest = metric["unit"].replace("1 σ", "1\N{NO-BREAK SPACE}σ").partition(" ")
    value = f"{quantity(metric['value'], word)} {rest}".rstrip()
    if metric["low"] is None or metric["high"] is None:
        return value
    if word == "arcsec" and max(abs(metric["low"]), abs(metric["high"])) >= 3600:
        return f"{value} [{quantity(metric['low'], word)}, {quantity(metric['high'], word)}]"
    return f"{value} [{metric['low']:z.2f}, {metric['high']:z.2f}]"
