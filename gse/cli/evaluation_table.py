"""The tables of ``gse evaluate`` for a person, within 80 columns."""

from typing import Any

_CELL_HEAD = f"{'identifier':11}{'arcsec':>7}{'mag':>4}{'false':>6}{'miss':>5}"


def table(document: dict[str, Any]) -> list[str]:
    """The report for a person, within 80 columns: shares with their intervals, then frames and times."""
    from gse.evaluation.plan import KINDS, failure_lines

    shares = [_CELL_HEAD + "".join(f"{kind + ' %':>20}" for kind in KINDS[:2]) + f"{KINDS[2] + ' %':>7}"]
    rest = [_CELL_HEAD + f"{'frames':>9}{'few':>5}{KINDS[3] + ' %':>9}{'median':>8}{'p95':>8}{'max ms':>8}"]
    for cell in document["cells"]:
        about, rates, cpu_ms = _cell(cell), cell["rates"], cell["cpu_ms"]
        intervals = "".join(f"{_interval(rates[kind]):>20}" for kind in KINDS[:2])
        shares.append(f"{about}{intervals}{_percent(rates[KINDS[2]], 7)}")
        few = sum(cell["excluded"].values())
        line = f"{about}{cell['frames_counted']:9d}{few:5d}{_percent(rates[KINDS[3]], 9)}"
        rest.append(line + f"{_ms(cpu_ms['median']):>8}{_ms(cpu_ms['p95']):>8}{_ms(cpu_ms['max']):>8}")
    few_false = sum(cell["excluded"]["false"] for cell in document["cells"])
    return [
        *shares,
        "",
        *rest,
        "",
        f"shares of the frames with at least {document['fewest_stars']} real stars, with 95 % bounds",
        f"few: frames with fewer stars; false answers in them: {few_false}",
        "times: CPU time of one call, all frames; of an external identifier its own,",
        "otherwise by this host's clock",
        *failure_lines(document["cells"]),
        *_distinct_star(document),
    ]


def _distinct_star(document: dict[str, Any]) -> list[str]:
    """Eqs 1 and 2 of the pivot paper in words, where the document has them."""
    found = document.get("distinct_star")
    if found is None:
        return []
    return [
        f"eqs 1, 2: one star a field to magnitude {found['magnitude']:.2f} ({found['fields_eq_1']:.0f} fields);",
        f"the source has {found['stars']}, and {100 * found['fields_with_one']:.1f} % of the fields have one",
    ]


def _cell(cell: dict[str, Any]) -> str:
    return (
        f"{cell['identifier']:11.11}{cell['noise_arcsec']:7g}{cell['magnitude_noise']:4g}"
        f"{cell['false_objects']:6d}{cell['missing_share']:5g}"
    )


def _interval(rate: dict[str, Any]) -> str:
    if rate["share"] is None:
        return "-"
    low, high = rate["interval"]
    return f"{100 * rate['share']:.2f} [{100 * low:.1f} {100 * high:.1f}]"


def _percent(rate: dict[str, Any], width: int) -> str:
    return f"{'-':>{width}}" if rate["share"] is None else f"{100 * rate['share']:{width}.2f}"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}" if value < 100 else f"{value:.0f}"
