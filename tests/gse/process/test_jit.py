"""Compiled functions, kept on disk between runs."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gse
from gse.process.jit import compiled, compiled_part, is_on_disk

_RUN = """
from gse.process.jit import is_on_disk
from gse.truth.refraction import _remove as function
import numpy as np
print(is_on_disk(function))
stars = np.array([[0.0, 0.0, 1.0]])
function(stars, stars, 1e-4, 1e-7, stars.copy())
print(is_on_disk(function))
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A copy of the program, in a folder for itself."""
    for name in ("gse", "drivers", "protocols"):
        source = Path(gse.__file__).parents[1] / name
        shutil.copytree(source, tmp_path / "program" / name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "program"


def before_and_after(program: Path, cache: Path, wanted: Path | str = "") -> list[str]:
    """Whether machine code of a function is on disk: at the start of a new process, and once the function ran."""
    return ran(program, cache, wanted).stdout.split()


def ran(program: Path, cache: Path, wanted: Path | str = "") -> "subprocess.CompletedProcess[str]":
    own = dict.fromkeys(("HOME", "LOCALAPPDATA", "XDG_CACHE_HOME"), str(cache))
    own |= {"NUMBA_CACHE_DIR": str(wanted), "PYTHONPATH": str(program), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, "-P", "-c", _RUN], env=os.environ | own, capture_output=True, text=True, check=True
    )


def test_machine_code_is_kept_for_exactly_this_program_and_never_beside_it(program: Path, tmp_path: Path) -> None:
    files = set(program.rglob("*"))
    cache = tmp_path / "cache"
    assert before_and_after(program, cache) == ["False", "True"]
    assert before_and_after(program, cache) == ["True", "True"]
    # A function holds what it takes from other modules: a change in one of them makes it another function.
    with (program / "gse" / "values" / "constants.py").open("a", encoding="utf-8") as file:
        file.write("\n# Changed.\n")
    assert before_and_after(program, cache) == ["False", "True"]
    assert set(program.rglob("*")) == files


def test_machine_code_is_kept_where_the_user_of_numba_wants_it(program: Path, tmp_path: Path) -> None:
    cache, wanted = tmp_path / "cache", tmp_path / "wanted"
    assert before_and_after(program, cache, wanted) == ["False", "True"]
    assert [*wanted.rglob("refraction._remove-*.nbi")]
    assert not cache.exists()
    assert before_and_after(program, cache, Path(os.devnull) / "wanted") == ["False", "True"]
    assert [*cache.rglob("refraction._remove-*.nbi")]


def test_numba_keeps_the_code_of_others_where_it_did_before_gse_was_imported(tmp_path: Path) -> None:
    code = """
import numba
before = numba.config.CACHE_DIR
from gse.truth.refraction import _remove
assert numba.config.CACHE_DIR == before, numba.config.CACHE_DIR
"""
    own = {"NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code], env=os.environ | own, check=True)


def test_where_nothing_can_be_kept_the_function_runs_and_stderr_says_once_what_to_do(program: Path) -> None:
    done = ran(program, Path(os.devnull) / "cache")
    assert done.stdout.split() == ["False", "False"]
    assert done.stderr.startswith("machine code cannot be kept in /dev/null/cache")
    assert done.stderr.count("set XDG_CACHE_HOME, or NUMBA_CACHE_DIR for machine code alone") == 1


def test_a_function_that_is_not_compiled_has_nothing_to_wait_for() -> None:
    assert is_on_disk(len)


@compiled_part
def _third(number: float) -> float:
    """A third, with numpy's division."""
    return number / 3.0


@compiled
def _ninth(number: float) -> float:
    return _third(_third(number))


def test_a_part_of_machine_code_gives_the_same_where_python_calls_it() -> None:
    assert _third(2.0) == 2.0 / 3.0
    assert _ninth(2.0) == _third(_third(2.0))
    assert (_third.__name__, _third.__doc__) == ("_third", "A third, with numpy's division.")
