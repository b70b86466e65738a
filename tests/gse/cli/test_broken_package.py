"""A Python or a package of others that the program cannot run with, each as a real one that a process finds."""

import ast
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from gse.process.broken_package import broken_package

ROOT = Path(__file__).parents[3]
NIGHT_SKY = ROOT / "replays/night-sky"
IDENTIFY = (
    "identify",
    str(ROOT / "benchmarks/real-sky/tables/rooftop-alt60-azi45.csv"),
    "--station",
    str(NIGHT_SKY / "rooftop-alt60-azi45.yaml"),
)
READ_BEFORE_THE_CHECK = ("gse/__init__.py", "gse/version.py", "gse/__main__.py")
_PLACES = [
    *Path.home().glob(".pyenv/versions/3.[789].*/bin/python"),
    *Path.home().glob(".pyenv/versions/3.10.*/bin/python"),
    *(Path(folder, f"python3.{minor}") for minor in range(7, 11) for folder in ("/usr/bin", "/usr/local/bin")),
]
OLDER_PYTHONS = [python for python in _PLACES if python.exists()]
TOO_NEW = "raise ImportError('Numba needs NumPy 2.4 or less. Got NumPy 2.5.')"


def distribution(folder: Path, name: str, version: str, code: str, *requires: str) -> None:
    """A package that pip could have installed there."""
    (folder / name).mkdir()
    (folder / name / "__init__.py").write_text(code)
    about = folder / f"{name}-{version}.dist-info"
    about.mkdir()
    needs = "".join(f"Requires-Dist: {text}\n" for text in requires)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n{needs}")
    (about / "RECORD").write_text(f"{name}/__init__.py,,\n")


def said(arguments: Sequence[str], path: Path, *options: str) -> list[str]:
    """What the program says on stderr with a folder before all others; its exit code is that of wrong usage."""
    found = {**os.environ, "PYTHONPATH": f"{path}{os.pathsep}{ROOT}"}
    command = [sys.executable, *options, "-m", "gse", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=found, cwd=path)
    assert (done.returncode, done.stdout) == (2, "")
    return done.stderr.splitlines()


def test_a_package_that_needs_an_older_one_is_named_with_both(tmp_path: Path) -> None:
    distribution(tmp_path, "numba", "0.65.1", TOO_NEW, "numpy<2,>=1.22", "absent; extra == 'gpu'")
    first, second = said(IDENTIFY, tmp_path)
    assert first.startswith("gse: numpy 2.")
    assert "is installed, and numba needs numpy<2,>=1.22 (ImportError: Numba needs NumPy 2.4 or less" in first
    assert second == f"Install it with: {sys.executable} -m pip install 'numpy<2,>=1.22'"


def test_a_package_that_is_too_old_is_named_with_what_is_needed(tmp_path: Path) -> None:
    distribution(tmp_path, "numpy", "1.26.4", "raise AttributeError('ndarray')")
    first, second = said(IDENTIFY, tmp_path)
    assert first.startswith("gse: numpy 1.26.4 is installed, and gse-star-sensor needs numpy>=2.0")
    assert second == f"Install it with: {sys.executable} -m pip install 'numpy>=2.0'"


def test_a_broken_package_is_named_with_its_version_and_place(tmp_path: Path) -> None:
    distribution(tmp_path, "numba", "0.68.1", "import llvmlite_of_another_machine")
    distribution(tmp_path, "llvmlite_of_another_machine", "0.50.0", "raise OSError('wrong ELF class')")
    first, second = said(IDENTIFY, tmp_path)
    place = tmp_path / "llvmlite_of_another_machine"
    assert first == f"gse: {place.name} 0.50.0 in {place} cannot be imported (OSError: wrong ELF class)"
    assert second == f"Install it with: {sys.executable} -m pip install --force-reinstall {place.name}"


def test_a_file_that_hides_a_package_is_named(tmp_path: Path) -> None:
    (tmp_path / "pyarrow.py").write_text("raise RuntimeError('a note on arrows')\n")
    first, second = said(("campaign", "query", ".", "select 1"), tmp_path)
    assert first == f"gse: {tmp_path / 'pyarrow.py'} hides the package pyarrow (RuntimeError: a note on arrows)"
    assert second == "Rename it, or take its folder out of PYTHONPATH."


def test_a_source_tree_without_its_packages_says_which_is_missing(tmp_path: Path) -> None:
    """``-S``: without those that are installed."""
    first, second = said(IDENTIFY, tmp_path, "-S")
    assert first.startswith("gse: ")
    assert "click" in first
    assert second.startswith(f"Install it with: {sys.executable} -m pip install ")


def test_an_error_of_our_own_is_no_package_s() -> None:
    with pytest.raises(ImportError) as of_ours:
        from gse.values.instant import no_such_name  # type: ignore[attr-defined]  # noqa: F401
    with pytest.raises(ValueError, match="first") as of_a_function:
        raise ValueError("first")
    assert broken_package(of_ours.value) is None
    assert broken_package(of_a_function.value) is None


@pytest.mark.parametrize("path", READ_BEFORE_THE_CHECK)
def test_an_older_python_can_read_what_checks_for_it(path: str) -> None:
    ast.parse((ROOT / path).read_text(encoding="utf-8"), feature_version=(3, 7))


@pytest.mark.skipif(not OLDER_PYTHONS, reason="without an older Python")
def test_an_older_python_says_in_one_line_which_is_needed() -> None:
    done = subprocess.run([OLDER_PYTHONS[0], "-m", "gse", "run"], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("gse: Python 3.11 or newer is needed; this is 3.")
    assert done.stderr.count("\n") == 1
