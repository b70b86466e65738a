"""What a command imports before it answers: each of these packages takes a tenth of a second or more."""

import shutil
import subprocess
import sys
from pathlib import Path

from devices.command_line import Gse

LATE = ("astropy.coordinates", "jinja2", "matplotlib", "pandas", "pyarrow", "rerun")
TABLES_NEED = "scipy.spatial"
"""Where those of the identifiers are not cached yet."""
COMPILING_NEEDS = "scipy.linalg"
"""numba itself, before it reads or makes machine code, and scipy.special from scipy 1.18 on."""
A_BAR_NEEDS = "rich.progress"
"""On a terminal."""
GOLDEN = Path(__file__).parents[3] / "replays/golden"
REPLAYS = GOLDEN.parent / "night-sky"
TABLE = REPLAYS.parents[1] / "benchmarks/real-sky/tables/rooftop-alt60-azi45.csv"
IDENTIFY = ("identify", TABLE, "--station", REPLAYS / "rooftop-alt60-azi45.yaml")
BEFORE_THE_FIRST_FRAME = (
    "gse.cli.run",
    "gse.cli.live_outputs",
    "gse.sessions.live",
    "gse.sessions.forecast",
    "gse.diagnosis.diagnosis",
    "gse.station.setup",
    "gse.view.status",
)


def imported(*codes: str) -> list[set[str]]:
    """Which of the late packages a program has imported after each of its parts."""
    names = (*LATE, TABLES_NEED, COMPILING_NEEDS, A_BAR_NEEDS)
    report = f"\nimport sys\nprint(*[name for name in {names!r} if name in sys.modules], file=sys.stderr)\n"
    program = "".join(code + report for code in codes)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return [set(line.split()) for line in done.stderr.splitlines()]


def test_a_panorama_is_identified_before_anything_that_draws_or_judges_is_imported(gse: Gse) -> None:
    arguments = [str(part) for part in IDENTIFY]
    run = f"from gse.cli import cli\ncli.main({arguments!r}, standalone_mode=False)"

    assert gse(*IDENTIFY).code == 0  # from here on tables and machine code are kept
    assert imported(run)[-1] - {COMPILING_NEEDS} == set()


def test_a_report_from_kept_results_does_not_import_what_tables_and_a_bar_need(gse: Gse, tmp_path: Path) -> None:
    session = shutil.copy(GOLDEN / "clear.mcap", tmp_path / "session.mcap")
    report = f"from gse.cli import cli\ncli.main(['report', {str(session)!r}, '--no-plots'], standalone_mode=False)"

    assert gse("report", session).code == 0  # from here on results and machine code are kept
    assert imported(report)[-1] & {TABLES_NEED, A_BAR_NEEDS} == set()


def test_a_session_begins_before_anything_that_draws_or_judges_is_imported_and_a_simulated_one_needs_astropy() -> None:
    begun, simulated = imported("import " + ", ".join(BEFORE_THE_FIRST_FRAME), "import gse.simulator")
    assert begun - {COMPILING_NEEDS} == set()
    assert simulated - {TABLES_NEED, COMPILING_NEEDS} == {"astropy.coordinates"}
