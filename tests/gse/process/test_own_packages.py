"""Packages of others that are named as ours, in processes as a user starts them."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gse
from gse.process.own_packages import NAMES

HERE = Path(gse.__file__).parents[1]
USES_THE_API = "import gse; print(gse.identify)"


@pytest.fixture
def foreign(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A package of a user, in the folder where he stands; has the name of one of ours."""
    package = tmp_path / "work" / getattr(request, "param", NAMES[-1]) / "__init__.py"
    package.parent.mkdir(parents=True)
    package.write_text('"""Somebody else\'s."""\n')
    return package


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """Our packages as in site-packages."""
    for name in ("gse", *NAMES):
        shutil.copytree(HERE / name, tmp_path / "site" / name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "site"


def python(*arguments: str, cwd: Path, path: Path = HERE) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(path)}
    return subprocess.run([sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True)


def test_the_program_runs_in_a_folder_with_a_package_of_that_name(foreign: Path) -> None:
    done = python("-m", "gse", "config", "show", cwd=foreign.parents[1])
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("foreign", NAMES, indirect=True)
def test_a_process_of_others_keeps_its_package_and_is_told_why_gse_is_not_imported(foreign: Path) -> None:
    name = foreign.parent.name
    done = python(
        "-c", f"import {name}\ntry:\n    {USES_THE_API}\nfinally:\n    print({name}.__file__)", cwd=foreign.parents[1]
    )
    assert Path(done.stdout.strip()).samefile(foreign)
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: gse needs its own package '{name}' ({HERE / name / '__init__.py'})")
    assert f"Python finds {foreign}. Start Python in another folder or as 'python -P'" in last
    assert python("-P", "-c", USES_THE_API, cwd=foreign.parents[1]).returncode == 0


def test_a_module_of_another_program_that_is_run_with_m_is_not_our_program(foreign: Path) -> None:
    host = foreign.parents[1] / "host"
    host.mkdir()
    (host / "__init__.py").write_text("import gse\n")
    (host / "__main__.py").write_text("")
    done = python("-m", "host", "gse", cwd=foreign.parents[1])
    assert "ImportError: gse needs its own package" in done.stderr


def test_a_folder_that_is_no_package_is_nobodys(foreign: Path) -> None:
    foreign.unlink()
    assert python("-c", USES_THE_API, cwd=foreign.parents[1]).returncode == 0


@pytest.mark.parametrize("change", ["replaced", "gone"])
def test_a_package_that_another_distribution_wrote_over_ours_is_named(
    foreign: Path, installed: Path, tmp_path: Path, change: str
) -> None:
    name = foreign.parent.name
    ours = installed / name / "__init__.py"
    if change == "replaced":
        shutil.copy(foreign, ours)
        metadata = installed / "tape_drives-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: tape-drives\nVersion: 1.0\n")
        (metadata / "top_level.txt").write_text(f"{name}\n")
    else:
        ours.unlink()
    by = " by tape-drives" if change == "replaced" else ""
    words = f"{ours} is not that of gse: it is missing, or was replaced{by}. Install gse into an environment of its own"
    imported = python("-c", USES_THE_API, cwd=tmp_path, path=installed)
    assert f"ImportError: {words}" in imported.stderr
    started = python("-m", "gse", "run", cwd=tmp_path, path=installed)
    assert started.returncode == 2
    assert started.stderr == f"gse: {words}: python3 -m venv gse-env\n"
