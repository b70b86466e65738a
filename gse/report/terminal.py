"""The verdict on the terminal: its conclusion; where asked every row, reason and fact, or Table 4-1 of the paper."""

from itertools import groupby
from operator import itemgetter
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gse.report.conclusion import EQUALS, SET_UP, conclusion_lines
from gse.statistics.decision import Outcome
from gse.values.limits import Decision

_COLOURS = {"PASS": "green", "FAIL": "red", "INCONCLUSIVE": "yellow"}
_LEAST_RISK = 1e-3
_HEAD = ("subject", "row", "value", "U (95 %, one-sided)", "limit", "outcome")


def print_verdict(
    report: dict[str, Any], session: str, console: Console | None = None, *, verbose: bool = False, paper: bool = False
) -> None:
    """Print a report (as ``summarise`` gives it) on the ``session`` at a path to stdout; coloured on a terminal.

    The conclusion has at most eleven lines. ``verbose`` adds all else, ``paper`` Table 4-1 of the LAPAN paper.
    """
    console = console or Console(highlight=False)
    if not console.is_terminal:
        console.print(
            "\n".join(plain_lines(report, session, verbose=verbose, paper=paper)), markup=False, soft_wrap=True
        )
        return
    head, *lines = conclusion_lines(report["conclusion"], session, console.width)
    console.print(Text(head, style=f"bold {_COLOURS[report['verdict']]}"))
    console.print(Text("\n".join(lines)), soft_wrap=True)
    if verbose:
        console.print()
        console.print(_table(_head(report)[1:], _below_subjects(measurement_rows(report))))
        console.print()
        console.print("\n".join(facts(report)), markup=False, highlight=False)
    if paper:
        console.print()
        console.print(_table(TABLE_4_1_HEAD, table_4_1_rows(report)))


def plain_lines(report: dict[str, Any], session: str, *, verbose: bool = False, paper: bool = False) -> list[str]:
    """The same as lines of plain text, none of them folded."""
    lines = conclusion_lines(report["conclusion"], session)
    if verbose:
        lines += ["", *aligned(_head(report), measurement_rows(report)), "", *facts(report)]
    if paper:
        lines += ["", *aligned(TABLE_4_1_HEAD, table_4_1_rows(report))]
    return lines


TABLE_4_1_HEAD = ("as table 4-1 of the LAPAN paper", "|dRA| deg", "arcmin", "|dDE| deg", "arcmin", "time")


def measurement_rows(report: dict[str, Any]) -> list[tuple[str, ...]]:
    """Subject, name, value, uncertainty, limit and outcome of each row, by simple acceptance with its risk."""
    simple = is_simple(report)
    return [
        (
            item["subject"],
            item["name"] + (" (relative)" if item["relative"] else ""),
            *(quantity(item[key], item["unit"]) for key in ("value", "uncertainty", "limit")),
            item["outcome"],
            *([risk_text(item)] if simple else []),
        )
        for item in report["measurements"]
    ]


def _head(report: dict[str, Any]) -> tuple[str, ...]:
    return (*_HEAD, "risk of a false PASS") if is_simple(report) else _HEAD


def is_simple(report: dict[str, Any]) -> bool:
    """Whether values alone decide."""
    return bool(report["decision"]["rule"] == Decision.SIMPLE)


def risk_text(row: dict[str, Any]) -> str:
    """How often a sensor outside its limit is seen as a row that is PASS by its value alone."""
    if row["outcome"] != Outcome.PASS:
        return "-"
    risk = row["false_pass_risk"]
    if risk is None:
        return "not known"
    return f"{100 * risk:.1f} %" if risk >= _LEAST_RISK else f"below {100 * _LEAST_RISK:g} %"


def table_4_1_rows(report: dict[str, Any]) -> list[tuple[str, ...]]:
    """The sensor under test above those of the paper, in degrees and arcmin."""
    return [
        (row["name"], *_degrees(row["mean_d_ra_deg"]), *_degrees(row["mean_d_de_deg"]), row["time"])
        for row in report["table_4_1"]["rows"]
    ]


def facts(report: dict[str, Any]) -> list[str]:
    """What the conclusion leaves out, a line each: frames, link, truth, sky, the other reasons and findings."""
    found, link, budget = report["identification"], report["link"], report["truth_budget"]
    lines = [
        f"frames: {sum(found['statuses'].values())} of {found['frames_expected']} expected, "
        f"{found['statuses'].get('IDENTIFIED', 0)} identified",
        f"link: {link['bytes_in']} bytes, {link['bytes_discarded']} discarded, {link['frames_lost']} frames lost, "
        f"{link['duplicates']} duplicates, {link['reconnects']} reconnects",
        f"truth: known to {_amount(budget['ra_arcsec'])} in dRA* and {_amount(budget['de_arcsec'])} in dDE (95 %)",
    ]
    lines += external_lines(report.get("external_identifier"))
    if is_simple(report):
        lines.insert(0, "decision: simple: the value alone decides, uncertainty does not count")
    lines += sky_lines(report["sky"])
    lines += [f"excluded: {exclusion_line(item)}" for item in report["exclusions"]]
    lines += [f"seen: {incident_line(item)}" for item in report["incidents"]]
    lines += [f"also: {line}" for line in further_lines(report)]
    if link["truncated"]:
        lines.append("the session is damaged or lost its end: this covers what is left of it")
    return lines


def further_lines(report: dict[str, Any]) -> list[str]:
    """The reasons and findings that the conclusion does not say, each once."""
    told = report["conclusion"]
    causes = (told[key].partition(EQUALS)[0] for key in ("cause", "note"))
    said = tuple(text for text in (told["reason"], *causes) if text)
    lines = dict.fromkeys(line.removeprefix(SET_UP) for line in (*report["reasons"], *report["findings"]))
    return [line for line in lines if not line.startswith(said)]  # the conclusion says a cause without its next step


def exclusion_line(item: dict[str, Any]) -> str:
    """A stretch that was left out: when, why, and how far off the answers in it were."""
    line = f"{item['frames']} frames from {item['from'][:19]}Z, {item['cause']}: {item['reason']}"
    for one in item["answers"]:
        taken = "taken out" if item["takes_answers_out"] else "judged all the same"
        off = ""
        if one["compared"]:
            off = f", {_amount(one['mean_arcsec'])} off in the mean and {_amount(one['worst_arcsec'])} at worst"
        line += f"; {one['answers']} answers of {one['subject']} in it are {taken}{off}"
    return line


def incident_line(item: dict[str, Any]) -> str:
    """Something that a reader must know of: when, for how long, and how much."""
    many = f" in {item['frames']} frames" if item["frames"] else ""
    many += f" in {item['stretches']} stretches" if item["stretches"] > 1 else ""
    until = "" if item["until"] == item["from"] else f" to {item['until'][:19]}Z"
    worst = "" if item["worst_arcsec"] is None else f", up to {_amount(item['worst_arcsec'])} off"
    return f"{item['subject']}: {item['what']}{many}, {item['from'][:19]}Z{until}{worst}"


def external_lines(program: dict[str, Any] | None) -> list[str]:
    """The external identifier with its failures, and stars that do not exist; none of a session without one."""
    if program is None:
        return []
    failures = ", ".join(f"{count} {kind}" for kind, count in program["failures"].items()) or "no failure"
    name = f"{program['name']}, version {program['version']}"
    lines = [f"external identifier: {name}: {program['answers']} answers, {failures}"]
    if unknown := program.get("stars_unknown"):
        lines.append(
            f"{unknown} of the {program['stars_named']} stars that it names are in no catalogue: a program with "
            'doubles has to write their numbers as text, "star": "5853498713190525696"'
        )
    return lines


THIN_CLOUD = "Thin cloud that lasts the whole session cannot be seen; set sensor.zero_point_mag to detect it."


def sky_lines(sky: dict[str, Any] | None) -> list[str]:
    """What the sky was like; nothing of a session without frames."""
    if sky is None:
        return []
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in sky["shares"].items())
    depth = "" if sky["limiting_mag"] is None else f"; stars to magnitude {sky['limiting_mag']:.1f}"
    seen = "" if sky["seen_share"] is None else f", {100 * sky['seen_share']:.0f} % of the expected ones"
    is_own = "clear" in sky["shares"] and "stated_zero_point_mag" not in sky
    lines = [f"sky: {shares}{depth}{seen}"]
    if is_own:
        lines.append(f"sky: {THIN_CLOUD}")
    return lines


def quantity(value: float | None, unit: str) -> str:
    """A value with its unit, degrees where arcseconds make no sense; shares (no unit) with four decimals."""
    if value is None:
        return "-"
    if unit == "arcsec" and abs(value) >= 3600:
        return f"{value / 3600:.3f} deg"
    if unit:
        return f"{value:z.2f} {unit}" if abs(value) < 1000 else f"{value:.0f} {unit}"
    return str(value) if isinstance(value, int) else f"{value:.4f}"


def _amount(arcsec: float | None) -> str:
    return "an unknown amount" if arcsec is None else f"{arcsec:.2f} arcsec"


def _degrees(value: float | None) -> tuple[str, str]:
    return ("unknown", "") if value is None else (f"{value:.6f}", f"{60 * value:.3f}")


def _below_subjects(rows: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Rows without the subject, those of each subject below a line with it: a terminal has 80 columns."""
    return [row for subject, group in groupby(rows, itemgetter(0)) for row in ((subject,), *(row[1:] for row in group))]


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
    for name in head:
        table.add_column(Text(name))
    for row in rows:
        table.add_row(*(Text(cell, style=_COLOURS.get(cell, "bold" if len(row) == 1 else "")) for cell in row))
    return table


def aligned(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """Lines of a table in columns."""
    widths = [max(len(row[place]) for row in (head, *rows)) for place in range(len(head))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in (head, *rows)
    ]
