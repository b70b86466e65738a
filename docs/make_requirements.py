"""Make the table of requirements in docs/metrics.md from gse.assessment.requirements.

Run it after a change of the table: ``python docs/make_requirements.py``. A test holds both together.
"""

from pathlib import Path

from gse.assessment.requirements import REQUIREMENTS, Requirement
from gse.limits import Limits

PAGE = Path(__file__).with_name("metrics.md")
BEGIN, END = "<!-- made by docs/make_requirements.py -->\n", "<!-- end -->\n"


def table() -> str:
    """A line for each row of the verdict."""
    lines = ["| row | what it is | limit | default |", "|---|---|---|---|", *map(_line, REQUIREMENTS)]
    return "\n".join(lines) + "\n"


def _line(requirement: Requirement) -> str:
    default = getattr(Limits(), requirement.limit)
    unit = f" {requirement.unit}" if requirement.unit else ""
    stated = "none: not tested" if default is None else f"{default:g}{unit}"
    cells = requirement.name, requirement.says, f"`limits.{requirement.limit}`", stated
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def page() -> str:
    """The whole page, with the table of today."""
    head, _, rest = PAGE.read_text().partition(BEGIN)
    _, _, tail = rest.partition(END)
    return f"{head}{BEGIN}{table()}{END}{tail}"


if __name__ == "__main__":
    PAGE.write_text(page())
