"""``gse report --verify`` on a simulated session."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from gse.cli import cli


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("verify") / "night.mcap"
    call("simulate", "--seconds", 5, "--file", path)
    call("report", path, "--no-plots", "--out", path.parent / "report")
    return path


def call(*arguments):
    return CliRunner().invoke(cli, [str(item) for item in arguments], catch_exceptions=False)


def test_a_report_is_verified_and_a_changed_one_is_not(session: Path, tmp_path: Path) -> None:
    page = session.parent / "report" / "report.html"
    assert "</svg>" not in page.read_text()
    good = call("report", "--verify", page, session)
    assert good.exit_code == 0
    assert "belongs to this session and is unchanged" in good.stdout
    assert "its section Provenance cannot be verified" in good.stdout
    changed = tmp_path / "changed.html"
    changed.write_bytes(page.read_bytes().replace(b"INCONCLUSIVE</strong>", b"PASS</strong>"))
    bad = call("report", "--verify", changed, session)
    assert bad.exit_code == 1
    assert "belongs to this session but was changed" in bad.stdout
    assert not (session.parent / "report-2").exists()


def test_options_of_the_report_are_needed_to_verify_it(session: Path, tmp_path: Path) -> None:
    call("report", session, "--clock-error", "2s", "--no-plots", "--out", tmp_path / "stated")
    page = tmp_path / "stated" / "report.html"
    without = call("report", "--verify", page, session)
    assert without.exit_code == 1
    assert "--clock-error" in without.stdout
    assert call("report", "--verify", page, session, "--clock-error", "2s").exit_code == 0


def test_another_session_and_no_report_are_told(session: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    call("simulate", "--seconds", 5, "--seed", 2, "--file", other)
    page = session.parent / "report" / "report.html"
    assert "is of another session" in call("report", "--verify", page, other).stdout
    nothing = call("report", "--verify", session, session)
    assert nothing.exit_code == 1
    assert "is not a report of gse" in nothing.stdout
