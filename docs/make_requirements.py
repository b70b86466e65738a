"""Make the table of requirements in docs/metrics.md from gse.verdict.requirements.

Run it after a change of the table: ``python docs/make_requirements.py``. A test holds both together.
"""

from pathlib import Path

from gse.statistics.decision import Claim
from gse.statistics.excuses import EXCUSES, LEFT_OUT
from gse.values.limits import Limits
from gse.verdict.requirements import REQUIREMENTS, Requirement

PAGE = Path(__file__).with_name("metrics.md")
_CLAIMS = {
    Claim.ACCURACY: "errors",
    Claim.ABSENCE: "availability",
    Claim.FALSEHOOD: "false answers",
    Claim.SLOWNESS: "time",
    Claim.CURRENT: "current",
}
BEGIN, END = "<!-- made by docs/make_requirements.py -->\n", "<!-- end -->\n"


def table() -> str:
    """A line for each row of the verdict."""
    head = ["| row | what it is | limit | default | may be excused by |", "|---|---|---|---|---|"]
    lines = [*head, *map(_line, REQUIREMENTS)]
    return "\n".join(lines) + "\n"


def excuses() -> str:
    """A line for each excuse: what it is, and which rows it may touch."""
    lines = ["| excuse | what it is | what it does | rows it may touch |", "|---|---|---|---|"]
    for stretch in LEFT_OUT:
        lines.append(_excuse(stretch.cause, stretch.says, "leaves frames out", stretch.excuses))
    for excuse in EXCUSES:
        lines.append(_excuse(excuse.name, excuse.says, "FAIL becomes INCONCLUSIVE", excuse.excuses))
    return "\n".join(lines) + "\n"


def _excuse(name: str, says: str, does: str, claims: tuple[Claim, ...]) -> str:
    rows = "all" if set(claims) == set(Claim) else ", ".join(_CLAIMS[claim] for claim in claims)
    return f"| {name} | {says} | {does} | {rows} |"


def _line(requirement: Requirement) -> str:
    default = getattr(Limits(), requirement.limit)
    unit = f" {requirement.unit}" if requirement.unit else ""
    stated = "none: not tested" if default is None else f"{default:g}{unit}"
    excuses = [excuse.name for excuse in EXCUSES if requirement.claim in excuse.excuses]
    cells = requirement.name, requirement.says, f"`limits.{requirement.limit}`", stated, ", ".join(excuses)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def page() -> str:
    """The whole page, with the table of today."""
    head, _, rest = PAGE.read_text().partition(BEGIN)
    _, _, tail = rest.partition(END)
    return f"{head}{BEGIN}{table()}\n{excuses()}{END}{tail}"


if __name__ == "__main__":
    PAGE.write_text(page())
