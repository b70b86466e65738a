"""What a command imports before it answers: each of these packages takes a tenth of a second or more."""

import subprocess
import sys
from pathlib import Path

LATE = ("astropy.coordinates", "jinja2", "matplotlib", "pandas", "pyarrow", "rerun")
TABLES_NEED = "scipy.spatial"
"""Where those of the identifiers are not cached yet."""
REPLAYS = Path(__file__).parents[3] / "replays/night-sky"
IDENTIFY = ("identify", REPLAYS / "tables/rooftop-alt60-azi45.csv", "--station", REPLAYS / "rooftop-alt60-azi45.yaml")
BEFORE_THE_FIRST_FRAME = (
    "gse.cli.run",
    "gse.cli.live_outputs",
    "gse.sessions.live",
    "gse.sessions.forecast",
    "gse.assessment.live_diagnosis",
    "gse.station.setup",
    "gse.view.status",
)


def imported(code: str) -> set[str]:
    """Which of the late packages a program has imported at its end."""
    names = (*LATE, TABLES_NEED)
    report = f"\nimport sys\nprint(*[name for name in {names!r} if name in sys.modules], file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code + report], capture_output=True, text=True, check=True)
    return set(done.stderr.split())


def test_a_panorama_is_identified_before_anything_that_draws_or_judges_is_imported() -> None:
    arguments = [str(part) for part in IDENTIFY]
    run = f"from gse.cli import cli\ncli.main({arguments!r}, standalone_mode=False)"

    assert imported(run) <= {TABLES_NEED}


def test_a_session_begins_before_anything_that_draws_or_judges_is_imported() -> None:
    assert imported("import " + ", ".join(BEFORE_THE_FIRST_FRAME)) == set()


def test_the_simulator_needs_astropy_and_nothing_that_draws() -> None:
    assert imported("import gse.simulator") - {TABLES_NEED} == {"astropy.coordinates"}
